"""A task's board with all that can happen on it within a rollout, so that agents practise on it without a simulator.

Where what responders show follows from the trigger links alone, as in the paper's world, `gates` and `lock`, a board's
state between actions is that of its links, and pictures, candidates and what they do depend on it alone: a board is a
small graph. `explore` makes it; here it is data, and what happens to an agent in a
`PracticeRollout`, or in the same as a Gymnasium environment (`GoalEnv`), is what would happen in the simulator. Success
and what leads where are the truth: they serve as reward and for the oracle that BC imitates, no agent sees them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium import spaces

from busybot.boards.directions import DIRECTIONS
from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.plan.interfaces import TaskContext
from busybot.plan.learning.encoding import (
    CHOICES,
    HALF_BOARD,
    OBJECTS,
    SHAPES,
    STOP,
    ActionOutcome,
    CandidateArrays,
    Observation,
    ObservationEncoder,
    shuffled,
)
from busybot.reason.inputs.sequence import BoardSequence
from busybot.training.checkpoint import Checkpoint, load_tensors, save_tensors


@dataclass(frozen=True)
class BoardGraph:
    """What can happen: S states of N objects, of which state 0 is the start.

    Attributes:
        looks: float16 (S, N, 256), features in each state.
        success: float32 (S,), share of the affectable responders that are in their goal state.
        facts, touched: of the choices, (S, 25, 8) and (S, 25), see `encoding.CandidateArrays`.
        leads: int64 (S, 25), state after each choice: the same if nothing happens, -1 where there is no such choice.
        worked: int64 (S, 25), direction that did it, -1 if nothing happens.
    """

    looks: np.ndarray
    success: np.ndarray
    facts: np.ndarray
    touched: np.ndarray
    leads: np.ndarray
    worked: np.ndarray

    @cached_property
    def right(self) -> np.ndarray:
        """bool (S, 25), what an oracle may choose: the first steps of the shortest ways to the greatest success that
        can be reached from a state; where that is reached, to stop."""
        there = self.leads >= 0
        there[:, STOP] = False
        after = np.maximum(self.leads, 0)
        best = self.success.copy()
        for _ in best:
            best = np.maximum(best, np.where(there, best[after], 0).max(axis=1))
        never = len(best) + 1
        far = np.where(self.success >= best, 0, never)
        good = there & (best[after] >= best[:, None])
        for _ in best:
            far = np.minimum(far, 1 + np.where(good, far[after], never).min(axis=1))
        right = np.asarray(good & (far[after] < far[:, None]))
        right[:, STOP] = far == 0
        return right


@dataclass(frozen=True)
class ExploredBoard:
    """A task and its board.

    Attributes:
        briefing: what an agent is told.
        graph: what can happen.
        group: boards of one group look alike.
        cpu_s: processor time that exploring took.
    """

    briefing: TaskContext
    graph: BoardGraph
    group: str = ""
    cpu_s: float = 0.0

    @cached_property
    def encoder(self) -> ObservationEncoder:
        """Of observations on this board."""
        return ObservationEncoder(self.briefing)

    @cached_property
    def history(self) -> Observation:
        """The recorded interactions."""
        return self.encoder.history()


def save_explored(path: Path, board: ExploredBoard) -> None:
    """Write a board as safetensors."""
    briefing = board.briefing
    arrays = {f"history.{name}": value for name, value in briefing.history.arrays.items()}
    arrays |= {name: getattr(briefing, name) for name in ("pixels", "worked", "goal")}
    arrays |= {f"graph.{field.name}": getattr(board.graph, field.name) for field in fields(BoardGraph)}
    values = {"group": board.group, "cpu_s": board.cpu_s, "threshold": briefing.threshold, "steps": briefing.steps}
    save_tensors(path, {name: torch.from_numpy(np.ascontiguousarray(value)) for name, value in arrays.items()}, values)


def load_explored(path: Path) -> ExploredBoard:
    """Read what `save_explored` wrote.

    Raises:
        BusybotError: the file is absent or damaged.
    """
    try:
        return _explored(load_tensors(path))
    except (KeyError, TypeError, ValueError) as error:
        what = f"{path}: it is no explored board: {type(error).__name__}: {error}"
        raise BusybotError(what, "remove it; the same command explores the board again") from None


def _explored(saved: Checkpoint) -> ExploredBoard:
    arrays: dict[str, dict[str, Any]] = {"history": {}, "graph": {}, "": {}}
    for name, tensor in saved.tensors.items():
        part, _, field = name.rpartition(".")
        arrays[part][field] = tensor.numpy()
    told: dict[str, Any] = arrays[""] | {name: saved.values[name] for name in ("threshold", "steps")}
    briefing = TaskContext(BoardSequence(**arrays["history"]), **told)
    return ExploredBoard(briefing, BoardGraph(**arrays["graph"]), saved.values["group"], saved.values["cpu_s"])


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
        graph, state = self._graph, self._state
        offered = CandidateArrays(graph.facts[state], graph.touched[state], len(self.possible))
        seen = self.board.encoder.seen(graph.looks[state], graph.looks[self._before], self._deed, offered)
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


class GoalEnv(gymnasium.Env[Observation, np.int64]):
    """Reach a goal picture on a board of which recorded interactions are known.

    ## Observation space
    A `Dict` of float32 arrays, see `busybot.plan.learning.encoding`.

    ## Action space
    `Discrete(25)`: 0 stops, k takes candidate (k - 1) // 2 in one of its two directions. An episode begins with the
    recorded history, T + 1 observations in which nothing can be chosen: whatever is answered, the next one follows.
    A choice that is not `allowed` stops, too.

    ## Reward
    The change of the success rate: the share of the affectable responders that are in their goal state. Its sum over an
    episode is the success at the end less that at the start.

    ## End of an episode
    Terminated when the agent stops or has acted eight times.

    ## Ground truth
    Only in `info`: `success`, and `deciding` (whether the next answer counts).

    ## Arguments
    `boards`: explored boards; `shuffle`: whether the objects come in an order that is drawn for every episode.
    `reset(seed=...)` decides what is drawn; `reset(options={"board": i})` takes board i, its objects as they are.
    """

    metadata = {"render_modes": []}

    def __init__(self, boards: Sequence[ExploredBoard], shuffle: bool = False):
        self._boards, self._shuffle = boards, shuffle
        self._rng = generator(0, "train", 0, "plan/goal env")
        boxes: dict[str, spaces.Space[Any]] = {
            name: spaces.Box(-np.inf, np.inf, shape, np.float32) for name, shape in SHAPES.items()
        }
        self.observation_space: Any = spaces.Dict(boxes)
        self.action_space: Any = spaces.Discrete(CHOICES)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        super().reset(seed=seed)
        if seed is not None:
            self._rng = generator(seed, "train", 0, "plan/goal env")
        chosen = (options or {}).get("board")
        if chosen is None:
            board = self._boards[int(self._rng.integers(len(self._boards)))]
            self._rollout = PracticeRollout(board, self._rng.permutation(OBJECTS) if self._shuffle else None)
        else:
            self._rollout = PracticeRollout(self._boards[chosen])
        self._history, self._at = self._rollout.history(), 0
        return self._observation(), self._info()

    def step(self, action: np.int64) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        if self._at < self._length:
            self._at += 1
            return self._observation(), 0.0, False, False, self._info()
        before = self._rollout.success
        self._rollout.act(int(action))
        return self._observation(), self._rollout.success - before, self._rollout.over, False, self._info()

    @property
    def _length(self) -> int:
        return len(self._history["allowed"])

    def _observation(self) -> Observation:
        looking_on = self._at < self._length
        seen = {name: value[self._at] for name, value in self._history.items()} if looking_on else None
        # users keep what they are given
        return {name: value.copy() for name, value in (seen or self._rollout.observation()).items()}

    def _info(self) -> dict[str, Any]:
        return {"success": self._rollout.success, "deciding": self._at >= self._length}
