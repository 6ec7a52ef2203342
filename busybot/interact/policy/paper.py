"""The paper's policy on one board (section 3.1 and appendix A.1): affordance with a bonus for new places, and epsilon.

What the paper leaves open: positions are pixels that lie above the board, because nothing else can be held; in the
first 10 epochs, and where epsilon says so, one of them is drawn, all alike. Where all directions are tried, each is
followed by its opposite, in a random order, until one works. For t and N of the bonus see `ucb_bonus`.
"""

from collections.abc import Sequence
from typing import Annotated, Generic

import numpy as np
from pydantic import Field

from busybot.boards.directions import DIRECTIONS
from busybot.common.frozen_model import FrozenModel
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Observation
from busybot.interact.policy.candidates import ActionModel, V
from busybot.interact.policy.direction_pairs import ELEVATED, sigmoid
from busybot.sim.policy import Action, StatelessPolicy

Share = Annotated[float, Field(ge=0, le=1)]


class PaperRules(FrozenModel):
    """How the paper's policy chooses.

    Attributes:
        epsilon_position, epsilon_direction: share of random choices.
        all_directions: try all directions until one works, instead of one.
        ucb_c, ucb_window: of the bonus; c = 0 is the row "w/o exploration" of Table 1.
    """

    epsilon_position: Share = 0.0
    epsilon_direction: Share = 0.0
    all_directions: bool = False
    ucb_c: Annotated[float, Field(ge=0)] = 0.5
    ucb_window: Annotated[int, Field(ge=2, le=200, multiple_of=2)] = 10

    def needs_model(self) -> bool:
        """Whether a network is asked at all."""
        return self.epsilon_position < 1 or (self.epsilon_direction < 1 and not self.all_directions)


class PaperPolicy(StatelessPolicy, Generic[V]):
    """Reads depth (and RGB, if the model sees colours) and where it acted before.

    Args:
        model: None where the rules leave everything to chance.
    """

    def __init__(self, model: ActionModel[V] | None, rays: Rays, rules: PaperRules, name: str):
        self.name = name
        self._model, self._rays, self._rules = model, rays, rules
        self._picks: list[tuple[int, int]] = []
        self._seen: Observation | None = None
        self._view: V | None = None

    def select_action(self, observation: Observation, rng: np.random.Generator) -> Action:
        random_position, random_direction = rng.random(2) < (
            self._rules.epsilon_position,
            self._rules.epsilon_direction,
        )
        pixel = (self._random_position if random_position else self._best_position)(observation, rng)
        self._picks.append(pixel)
        if self._rules.all_directions:
            return Action(pixel, tuple(map(int, rng.permutation(len(DIRECTIONS)))))
        if random_direction:
            return Action(pixel, (int(rng.integers(len(DIRECTIONS))),))
        view = self._look(observation)
        assert self._model is not None
        _, scores = self._model.directions(view, np.array([pixel]))
        return Action(pixel, (int(np.asarray(scores)[0].argmax()),))

    def _best_position(self, seen: Observation, rng: np.random.Generator) -> tuple[int, int]:
        """The elevated pixel with the highest P + c sqrt(ln t / N)."""
        elevated = self._elevated(seen)
        if not elevated.any():
            return self._random_position(seen, rng)
        affordance = sigmoid(self._look(seen).affordance)
        scores = affordance + ucb_bonus(affordance.shape, self._picks, self._rules.ucb_c, self._rules.ucb_window)
        row, column = divmod(int(np.where(elevated, scores, -1).argmax()), scores.shape[1])
        return column, row

    def _random_position(self, seen: Observation, rng: np.random.Generator) -> tuple[int, int]:
        elevated = np.flatnonzero(self._elevated(seen))
        chosen = int(rng.choice(elevated)) if len(elevated) else int(rng.integers(seen.depth.size))
        row, column = divmod(chosen, seen.depth.shape[1])
        return column, row

    def _elevated(self, seen: Observation) -> np.ndarray:
        return np.nan_to_num(self._rays.heights(seen.depth), nan=-1) > ELEVATED

    def _look(self, seen: Observation) -> V:
        assert self._model is not None
        if self._view is None or seen is not self._seen:
            self._seen, self._view = seen, self._model.look(seen, self._rays)
        return self._view


def ucb_bonus(shape: tuple[int, ...], picks: Sequence[tuple[int, int]], c: float = 0.5, window: int = 10) -> np.ndarray:
    """The bonus for places that were not picked yet (Upper Confidence Bound): c sqrt(ln t / N), float (H, W).

    t counts steps, and N those whose window holds the pixel. The paper does not say what happens where no window holds
    it: N = 0, the bonus infinite. Here both counts include the step that is being decided, as if it picked the pixel:
    t = 1 + earlier picks, N = 1 + earlier picks whose window x window square holds the pixel.

    Args:
        shape: rows and columns of the picture.
        picks: pixels (u, v) chosen on this board so far. A window reaches from window / 2 pixels before its pick to
            window / 2 - 1 after it.
        window: its side, pixels, even.
    """
    counts, half = np.ones(shape), window // 2
    for column, row in picks:
        counts[max(row - half, 0) : row + half, max(column - half, 0) : column + half] += 1
    return c * np.sqrt(np.log(len(picks) + 1) / counts)
