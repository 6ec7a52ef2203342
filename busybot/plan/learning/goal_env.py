"""Tasks as a Gymnasium environment, on boards that were explored before (paper appendix "Planning module": PPO)."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from busybot.common.rng import generator
from busybot.plan.learning.board_graph import ExploredBoard
from busybot.plan.learning.encoding import CHOICES, OBJECTS, SHAPES, Observation
from busybot.plan.learning.practice import PracticeRollout


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
