"""The paper's own policy on one board (paper sections 4.1 and 4.2, appendix A.1).

It takes the affordance with a bonus for new places, and epsilon; for data to reason from, a random one of the tops of
its clusters. It remembers nothing but where it acted. What the paper leaves open:

- Positions are pixels that lie above the board, because nothing else can be held; in the first 10 epochs, and where
  epsilon says so, one of them is drawn, all alike.
- Where all directions are tried, each is followed by its opposite, in a random order, until one works.
- Where no affordance is above the threshold of clusters, the highest is taken.
- For t and N of the bonus see `ucb_bonus`.
"""

from collections.abc import Sequence
from typing import Annotated, Generic, Literal

import numpy as np
from pydantic import Field

from busybot.boards.directions import DIRECTIONS
from busybot.common.frozen_model import FrozenModel
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Observation
from busybot.interact.policy.candidates import ActionModel, V, cluster_tops, is_likely
from busybot.interact.policy.config import Share
from busybot.interact.policy.direction_pairs import ELEVATED, pixel_at, random_pixel, sigmoid
from busybot.sim.policy import Action, StatelessPolicy


class PaperRules(FrozenModel):
    """How the paper's policy chooses.

    Attributes:
        epsilon_position, epsilon_direction: share of random choices.
        all_directions: try all directions until one works, instead of one.
        ucb_c, ucb_window: of the bonus; c = 0 is the row "w/o exploration" of Table 1.
        clusters: choose any of the best positions of so many clusters, all alike, as data to reason from are collected;
            0 for the highest of all.
        cluster_belief: pixels with a higher affordance than this are clustered; see `PolicyConfig`.
    """

    epsilon_position: Share = 0.0
    epsilon_direction: Share = 0.0
    all_directions: bool = False
    ucb_c: Annotated[float, Field(ge=0)] = 0.5
    ucb_window: Annotated[int, Field(ge=2, le=200, multiple_of=2)] = 10
    clusters: Annotated[int, Field(ge=0, le=100)] = 0
    cluster_belief: Share | Literal["middle"] = "middle"

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
        rules, elevated = self._rules, np.nan_to_num(self._rays.heights(observation.depth), nan=-1) > ELEVATED
        random_position, random_direction = rng.random(2) < (rules.epsilon_position, rules.epsilon_direction)
        if random_position or not elevated.any():
            pixel = random_pixel(elevated, rng)
        else:
            pixel = self._any_cluster(observation, elevated, rng) or self._best_position(observation, elevated)
        self._picks.append(pixel)
        if rules.all_directions:
            return Action(pixel, tuple(map(int, rng.permutation(len(DIRECTIONS)))))
        if random_direction:
            return Action(pixel, (int(rng.integers(len(DIRECTIONS))),))
        assert self._model is not None
        _, scores = self._model.directions(self._look(observation), np.array([pixel]))
        return Action(pixel, (int(np.asarray(scores)[0].argmax()),))

    def _any_cluster(self, seen: Observation, elevated: np.ndarray, rng: np.random.Generator) -> tuple[int, int] | None:
        """The best position of a cluster of likely ones; None where the rules want none, or nothing is likely."""
        if not self._rules.clusters:
            return None
        affordance = self._look(seen).affordance
        likely = elevated & is_likely(sigmoid(affordance), self._rules.cluster_belief)
        tops = cluster_tops(affordance, likely, self._rules.clusters)
        if not len(tops):
            return None
        column, row = map(int, rng.choice(tops))
        return column, row

    def _best_position(self, seen: Observation, elevated: np.ndarray) -> tuple[int, int]:
        """The elevated pixel with the highest P + c sqrt(ln t / N)."""
        affordance = sigmoid(self._look(seen).affordance)
        scores = affordance + ucb_bonus(affordance.shape, self._picks, self._rules.ucb_c, self._rules.ucb_window)
        return pixel_at(np.where(elevated, scores, -1).argmax(), scores.shape)

    def _look(self, seen: Observation) -> V:
        assert self._model is not None
        if self._view is None or seen is not self._seen:
            self._seen, self._view = seen, self._model.look(seen, self._rays)
        return self._view


def ucb_bonus(shape: tuple[int, ...], picks: Sequence[tuple[int, int]], c: float = 0.5, window: int = 10) -> np.ndarray:
    """The bonus for places that were not picked yet (Upper Confidence Bound): c sqrt(ln t / N), float (H, W).

    t counts steps, and N those whose window holds the pixel. The paper does not say what happens where no window holds
    it: N = 0, the bonus infinite. Here both counts include the step that is being decided, as if it picked the pixel:
    t = 1 + earlier picks, N = 1 + earlier picks whose window x window square holds the pixel. The authors' program has
    sqrt(2 ln(t + 1) / N) with t earlier picks: the 2, which the text does not have, is c = .71.

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
