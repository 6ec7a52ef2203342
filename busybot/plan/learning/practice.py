"""Playing on explored boards: what happens to an agent there is what would happen in the simulator, at no cost."""

import numpy as np

from busybot.boards.directions import DIRECTIONS
from busybot.plan.learning.board_graph import ExploredBoard
from busybot.plan.learning.encoding import HALF_BOARD, STOP, ActionOutcome, Observation, shuffled


class PracticeRollout:
    """One play.

    Args:
        order: of the objects, int (10,); as on the board if None. In training it is drawn for every rollout, so that
            nothing can be learned of an object's number.

    Attributes:
        steps: actions so far.
        over: whether the agent has stopped, or used its steps up.
    """

    def __init__(self, board: ExploredBoard, order: np.ndarray | None = None):
        self.board, self._graph, self._order = board, board.graph, order
        self.steps, self.over = 0, False
        self._state = self._before = 0
        self._deed: ActionOutcome | None = None

    @property
    def success(self) -> float:
        """Share of the affectable responders that are in their goal state."""
        return float(self._graph.success[self._state])

    @property
    def right(self) -> np.ndarray:
        """bool (25,), what an oracle may choose."""
        return np.asarray(self._graph.right[self._state])

    @property
    def possible(self) -> np.ndarray:
        """Numbers of the actions that may be chosen."""
        return np.flatnonzero(self._graph.leads[self._state] >= 0)

    def history(self) -> Observation:
        """The observations before the first decision, a first axis of length T + 1."""
        return self._ordered(self.board.history)

    def observation(self) -> Observation:
        """The observation at this decision."""
        looks, offered = self._graph.looks, self._graph.offered(self._state)
        seen = self.board.encoder.seen(looks[self._state], looks[self._before], self._deed, offered)
        return self._ordered(seen)

    def act(self, choice: int) -> None:
        """Decide. What is no choice here ends the rollout, as stopping does."""
        after = int(self._graph.leads[self._state, choice])
        if choice == STOP or after < 0:
            self.over = True
            return
        facts, worked = self._graph.facts[self._state, choice], int(self._graph.worked[self._state, choice])
        direction = DIRECTIONS[worked] if worked >= 0 else facts[3:6]
        touched = int(self._graph.touched[self._state, choice])
        self._deed = ActionOutcome(facts[:3] * HALF_BOARD, direction, touched, worked >= 0)
        self._before, self._state = self._state, after
        self.steps += 1
        self.over = self.steps >= self.board.briefing.steps

    def _ordered(self, observation: Observation) -> Observation:
        return observation if self._order is None else shuffled(observation, self._order)
