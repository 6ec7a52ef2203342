"""Policies that collect a training round: many places, and at each one direction pair after the other.

Round 0 knows nothing: it visits the elevated connected components evenly and inside of one half of the time its rarer
heights and slopes, because small movable parts are a small share of all pixels. Later rounds look with the network of
the round before: half of the actions take the best place that was not moved yet, as the policy would, the others a
place where the network is unsure or a random one in proportion to the affordance.

The pairs are tried until one works (at most 9; the paper's first 100 epochs try all directions), half of the time
those first that the direction network believes in, else in random order.
"""

from typing import Annotated, Generic

import cv2
import numpy as np
from pydantic import Field

from busybot.boards.directions import OPPOSITE
from busybot.common.frozen_model import FrozenModel
from busybot.episodes.camera import Rays, normals
from busybot.episodes.episode import Observation
from busybot.interact.policy.board_memory import moved_window
from busybot.interact.policy.candidates import ActionModel, V, held
from busybot.interact.policy.config import Share
from busybot.interact.policy.direction_pairs import ELEVATED, PAIRS, pair_scores, pixel_at, sigmoid
from busybot.interact.policy.noisy_pictures import is_noisy, settled_depth
from busybot.sim.policy import Action, StatelessPolicy


class ExplorationConfig(FrozenModel):
    """How training data are collected.

    Attributes:
        elevation: what lies higher above the board can be chosen, board units.
        smallest: connected components with fewer pixels are not visited, pixels.
        stratified: share of round 0's actions that take a random class of height and slope of the component first.
        height_classes: number of height classes of a component.
        best: share of later actions at the best place that was not moved yet.
        unsure: share of later actions where the network is unsure; the rest is drawn by affordance.
        noise: lowest factor on affordance when the best place is sought, so that it varies.
        prior: its logarithm is added to the network's logits; few of the places that one might try work.
        moved, moved_unsure: what remains of the attraction of a place that moved, for being best and for being unsure.
        failed: what remains near a failure.
        near: so far, pixels.
        reach: a link's motion is looked for this far around the action, pixels.
        change: depth that differs by more than this has moved, board units.
        by_network: share of actions that try the pairs in the direction network's order.
        pairs: tried at most.
    """

    elevation: Annotated[float, Field(ge=0)] = ELEVATED
    smallest: Annotated[int, Field(ge=1)] = 30
    stratified: Share = 0.5
    height_classes: Annotated[int, Field(ge=1, le=100)] = 6
    best: Share = 0.5
    unsure: Share = 0.35
    noise: Share = 0.6
    prior: Annotated[float, Field(gt=0, lt=1)] = 0.2
    moved: Share = 0.1
    moved_unsure: Share = 0.3
    failed: Share = 0.1
    near: Annotated[int, Field(ge=0, le=100)] = 3
    reach: Annotated[int, Field(ge=0, le=200)] = 36
    change: Annotated[float, Field(gt=0)] = 2e-4
    by_network: Share = 0.5
    pairs: Annotated[int, Field(ge=1, le=9)] = 9


class UnguidedExplorer(StatelessPolicy):
    """Round 0: places drawn without a network. Reads depth only."""

    name = "explore-unguided"

    def __init__(self, rays: Rays, config: ExplorationConfig | None = None):
        self._rays, self._config = rays, config or ExplorationConfig()
        self._seen: Observation | None = None
        self._components: list[tuple[np.ndarray, np.ndarray]] = []

    def select_action(self, observation: Observation, rng: np.random.Generator) -> Action:
        if observation is not self._seen:
            self._seen, self._components = observation, self._divide(observation.depth)
        pixel = self._place(observation.depth.shape, rng)
        return Action(pixel, _in_order(rng.permutation(len(PAIRS)), rng, self._config))

    def _divide(self, depth: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Elevated components as flat pixel indices, and each pixel's class of height and slope."""
        config = self._config
        points = self._rays.points(depth)
        height, slopes = points[..., 2].ravel(), normals(points).reshape(-1, 3)
        elevated = (points[..., 2] > config.elevation).astype(np.uint8)
        count, labels, sizes, _ = cv2.connectedComponentsWithStats(elevated, connectivity=8)
        large = [label for label in range(1, count) if sizes[label, cv2.CC_STAT_AREA] >= config.smallest]
        found = [np.flatnonzero(labels.ravel() == label) for label in large]
        return [(pixels, _classes(height[pixels], slopes[pixels], config.height_classes)) for pixels in found]

    def _place(self, shape: tuple[int, ...], rng: np.random.Generator) -> tuple[int, int]:
        if not self._components:
            height, width = shape
            return int(rng.integers(width)), int(rng.integers(height))
        pixels, classes = self._components[int(rng.integers(len(self._components)))]
        if rng.random() < self._config.stratified:
            pixels = pixels[classes == rng.choice(np.unique(classes))]
        return pixel_at(rng.choice(pixels), shape)


class GuidedExplorer(Generic[V]):
    """Later rounds: places by the affordance of the round before."""

    name = "explore"

    def __init__(self, model: ActionModel[V], rays: Rays, config: ExplorationConfig | None = None):
        self._model, self._rays, self._config = model, rays, config or ExplorationConfig()
        self._seen: Observation | None = None
        self._view: V | None = None
        self._moved: np.ndarray | None = None
        self._failed: list[tuple[int, int]] = []

    def select_action(self, observation: Observation, rng: np.random.Generator) -> Action:
        if observation is not self._seen or self._view is None:
            self._seen, self._view = observation, self._model.look(observation, self._rays)
            self._weigh(self._view)
        pixel = self._place(rng)
        if rng.random() < self._config.by_network:
            _, directions = self._model.directions(self._view, np.array([pixel]))
            order = np.argsort(-pair_scores(np.asarray(directions, float))[0], kind="stable")
        else:
            order = rng.permutation(len(PAIRS))
        return Action(pixel, _in_order(order, rng, self._config))

    def observe(self, action: Action, executed: tuple[int, ...], reward: int, after: Observation) -> None:
        before, config = self._seen, self._config
        assert before is not None and self._moved is not None
        noisy = after is not before and is_noisy(before.rgb, after.rgb)
        depth = settled_depth(before.depth, after.depth, config.change, 0.0) if noisy else after.depth
        moved = moved_window(before.depth, depth, action.pixel, config.reach, config.change)
        if reward:
            self._moved |= moved
        if after is before or (noisy and not reward and not moved.any()):
            # nothing moved; what moves without a reward ("w/o responder") may be tried again
            self._failed.append(action.pixel)
            self._shun(action.pixel)
        else:
            self._failed.clear()  # what held it may have let go

    def _shun(self, pixel: tuple[int, int]) -> None:
        """Places beside one that failed attract less."""
        (column, row), near = pixel, self._config.near
        around = (slice(max(row - near, 0), row + near + 1), slice(max(column - near, 0), column + near + 1))
        self._best[around] *= self._config.failed
        self._unsure[around] *= self._config.failed

    def _weigh(self, view: V) -> None:
        """How much each pixel attracts: by affordance, and by the network's doubt."""
        if self._moved is None:
            self._moved = np.zeros(view.height.shape, bool)
        belief = sigmoid(view.affordance + np.log(self._config.prior))
        belief[~held(view.affordance)] = 0
        self._best = belief * np.where(self._moved, self._config.moved, 1)
        self._unsure = belief * (1 - belief) * np.where(self._moved, self._config.moved_unsure, 1)
        for pixel in self._failed:  # before a camera that is not still every picture is another one
            self._shun(pixel)

    def _place(self, rng: np.random.Generator) -> tuple[int, int]:
        draw, config, shape = rng.random(), self._config, self._best.shape
        if draw < config.best:
            return pixel_at((self._best * rng.uniform(config.noise, 1, shape)).argmax(), shape)
        total = np.cumsum(self._unsure if draw < config.best + config.unsure else self._best)
        if total[-1] > 0:
            return pixel_at(np.searchsorted(total, rng.random() * total[-1], side="right"), shape)
        return pixel_at(rng.integers(len(total)), shape)


def _classes(height: np.ndarray, slopes: np.ndarray, levels: int) -> np.ndarray:
    """A number for height level and rounded normal of each pixel (P,) and (P, 3)."""
    span = height.max() - height.min() + 1e-6
    level = np.clip(((height - height.min()) / span * levels).astype(int), 0, levels - 1)
    facing = np.round(slopes / 0.58).clip(-1, 1).astype(int) + 1
    return level * 27 + facing @ np.array([9, 3, 1])


def _in_order(order: np.ndarray, rng: np.random.Generator, config: ExplorationConfig) -> tuple[int, ...]:
    """First directions of the pairs in this order, the first of each drawn."""
    first = PAIRS[order[: config.pairs]]
    flipped = rng.random(len(first)) < 0.5
    return tuple(int(one) for one in np.where(flipped, OPPOSITE[first], first))
