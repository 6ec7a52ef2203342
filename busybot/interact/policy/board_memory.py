"""The policy's memory of one board: the links that it saw moving, what responded, and what failed where.

The paper keeps a count of picks per window (UCB, section 4.1). Here what moved around a rewarded action becomes one
link, so that neighbouring buttons stay apart, and a failure lowers the belief in what lies near it. An object that
changed its looks while another one was acted on responds, so it is hardly a trigger: whoever learns causes tells a lamp
from a lever by what switches it on. One of which a link moved is a trigger, and likely to have another.

Only what the agent may read enters: the pictures before and after its own actions, the directions executed, the reward.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from busybot.episodes.episode import Observation
from busybot.interact.policy.config import EFFECT, FAILURE_SIGMA, SAME_LINK, PolicyConfig
from busybot.interact.policy.direction_pairs import ELEVATED, PAIR_OF, logit, sigmoid
from busybot.interact.policy.noisy_pictures import is_noisy, least_depth, looks_otherwise, settled_depth

BESIDE = 3
"""Pixels beyond those that can have moved, so that the border of what is looked at is empty."""
NEGLIGIBLE = 0.05
"""Failures whose weight at a candidate is lower do not reach it."""
MOVED = 8
"""A link moved if the depth of so many pixels changed where it was taken hold of."""
ANOTHER_COLOUR = 16
"""Levels of 256 by which a channel of a pixel differs that looks otherwise; compressed pictures differ by less."""


@dataclass(frozen=True)
class Failure:
    """An action without reward.

    Attributes:
        pixel: (u, v).
        pairs: the direction pairs that were tried, and the belief that each would have moved what is there.
        weight: how much it tells of other places, 0 to 1.
        held: how probable it is that there is a link that something holds: it tells so much less of other places, and
            of how what is there is pushed.
    """

    pixel: tuple[int, int]
    pairs: dict[int, float]
    weight: float = 1.0
    held: float = 0.0


class BoardMemory:
    """One board's memory.

    Args:
        height: float32 (H, W), board units above the board, at the first look. Connected pixels of objects are one
            component.
        nearest: least depth at the first look, board units, 0 if that is not known: a hand is nearer.

    Attributes:
        links: int32 (H, W), number of the known link that was seen moving at the pixel, 0 for none.
        pairs: link to the direction pair that moved it last.
        failures: those that no later success has explained.
        responders: components that looked otherwise after another one was acted on, and of which no link has moved.
    """

    def __init__(self, height: np.ndarray, config: PolicyConfig, nearest: float = 0.0):
        self._config, self._nearest, self._noisy = config, nearest, False
        _, self._components = cv2.connectedComponents((height > ELEVATED).astype(np.uint8))
        self.links = np.zeros(height.shape, np.int32)
        self.pairs: dict[int, int] = {}
        self.failures: list[Failure] = []
        self.responders: set[int] = set()
        self._moved: set[int] = set()  # components of which a link has moved, and 0 where one reached beyond them

    def succeeded(self, pixel: tuple[int, int], direction: int, before: Observation, after: Observation) -> int:
        """Remember an action with reward; returns the number of the link that moved.

        Args:
            direction: the one that worked.
            before, after: what was seen.
        """
        depth, differs = self._compared(before, after)
        around, moved = self._beneath(pixel, before.depth, depth)
        components, links = self._components[around], self.links[around]
        link = self._link(moved, links)
        links[enlarged(moved) & (links == 0)] = link
        links[moved] = link
        self._moved |= set(np.flatnonzero(np.bincount(components[links > 0])).tolist())
        self.pairs[link] = int(PAIR_OF[direction])
        explained = np.zeros(self.links.shape, bool)
        explained[around] = moved
        self.failures = [one for one in self.failures if not explained[one.pixel[1], one.pixel[0]]]
        self.responders |= self._responding(differs)
        self.responders -= self._moved
        return link

    def moved_at(self, pixel: tuple[int, int], before: Observation, after: Observation) -> bool | None:
        """Whether something moved where an action took hold, however few pixels changed. Before a noisy camera, whose
        depth frays at edges, nobody can tell: None."""
        self._noisy = self._noisy or is_noisy(before.rgb, after.rgb)
        if self._noisy:
            return None
        around, region = self._beneath(pixel, before.depth, after.depth)
        differs = np.abs(before.depth[around] - after.depth[around]) > self._config.change
        return int(np.count_nonzero(differs & region)) >= MOVED

    def _beneath(
        self, pixel: tuple[int, int], before: np.ndarray, after: np.ndarray
    ) -> tuple[tuple[slice, slice], np.ndarray]:
        """What is near enough to (u, v) to move with it, and which of that is the link there, as of `moved_region`."""
        around = _within_reach(pixel, self._config, self.links.shape)
        components = self._components[around]
        body = (components == self._components[pixel[1], pixel[0]]) & (components > 0)
        middle = (pixel[0] - around[1].start, pixel[1] - around[0].start)
        return around, moved_region(before[around], after[around], middle, body, self._config)

    def _compared(self, before: Observation, after: Observation) -> tuple[np.ndarray, np.ndarray]:
        """Depth after an action that differs from that before where something moved, and pixels that look otherwise,
        bool (H, W). A camera that was noisy once is from then on."""
        self._noisy = self._noisy or is_noisy(before.rgb, after.rgb)
        if not self._noisy:
            return after.depth, _another_colour(before, after)
        self._nearest = max(self._nearest, least_depth(before.depth), least_depth(after.depth))
        settled = settled_depth(before.depth, after.depth, self._config.change, self._nearest)
        return settled, looks_otherwise(before, after, self._nearest)

    def _responding(self, differs: np.ndarray) -> set[int]:
        """Components that look otherwise, from the pixels that do, bool (H, W)."""
        counts = np.bincount(self._components[differs & (self._components > 0)])
        return set(np.flatnonzero(counts >= EFFECT).tolist())

    def _link(self, moved: np.ndarray, links: np.ndarray) -> int:
        """The known link that overlaps the moved region enough to be the same, else a new number.

        Args:
            moved, links: bool and int32, what can have moved of (H, W).
        """
        shared = np.bincount(links[moved], minlength=len(self.pairs) + 1)[1:]
        if not shared.any():
            return len(self.pairs) + 1
        likely = int(shared.argmax()) + 1
        smaller = min(np.count_nonzero(moved), np.count_nonzero(self.links == likely))
        return likely if shared[likely - 1] > SAME_LINK * smaller else len(self.pairs) + 1

    def failed(self, failure: Failure) -> None:
        """Remember an action without reward."""
        self.failures.append(failure)

    @property
    def failed_pixels(self) -> np.ndarray:
        """Where the failures were, int (F, 2), u and v."""
        return np.array([one.pixel for one in self.failures], int).reshape(-1, 2)

    def explain(self, held: Sequence[float]) -> None:
        """Believe of each failure so much that a link is there which something holds."""
        self.failures = [replace(one, held=now) for one, now in zip(self.failures, held, strict=True)]

    def doubted(
        self, pixels: np.ndarray, logits: np.ndarray, pairs: np.ndarray, elsewhere: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """What remains of the model's beliefs after what happened on this board.

        Args:
            pixels: int (K, 2), u and v.
            logits: (K,), that something can be moved at the pixel.
            pairs: (K, 9), that a direction pair moves it.
            elsewhere: bool (F, K), which failures took hold of something else than what is at a pixel, however near.

        Returns:
            probabilities (K,) and (K, 9).
        """
        columns, rows = pixels.T
        links, nears = self.links[rows, columns], [self._near(failure, pixels) for failure in self.failures]
        if elsewhere is not None:
            nears = [np.where(other, 0, near) for near, other in zip(nears, elsewhere, strict=True)]
        penalty, components = np.zeros(len(pixels)), self._components[rows, columns]
        for failure, near in zip(self.failures, nears, strict=True):
            same = components == self._components[failure.pixel[1], failure.pixel[0]]
            far = (1 - near) * (1 - failure.held) * failure.weight
            penalty += far * (self._config.component_penalty * same + self._config.failure_penalty)
        penalty += self._config.responder_penalty * _among(components, self.responders)
        penalty -= self._config.trigger_bonus * _among(components, self._triggers())
        beliefs, pairs = sigmoid(logits - np.where(links == 0, penalty, 0)), pairs.copy()
        for failure, near in zip(self.failures, nears, strict=True):
            for pair, pair_belief in failure.pairs.items():
                beliefs = (1 - near) * beliefs + near * _posterior(beliefs, pair_belief)
                pairs = self._without(pairs, pair, near * (1 - failure.held))
        for link, pair in self.pairs.items():
            pairs[links == link, pair] = np.maximum(pairs[links == link, pair], self._config.known_pair)
        return beliefs, pairs

    def _triggers(self) -> set[int]:
        """Components of which a link has moved and no action failed."""
        return self._moved - {0} - {int(self._components[one.pixel[1], one.pixel[0]]) for one in self.failures}

    def tried(self, pixels: np.ndarray) -> np.ndarray:
        """Which of the pixels (K, 2) lie where a pair has failed, bool (K,)."""
        nears = [self._near(failure, pixels) for failure in self.failures]
        return np.max([np.zeros(len(pixels)), *nears], axis=0) > 0.5

    def visits(self, picks: list[tuple[int, int]], pixels: np.ndarray) -> np.ndarray:
        """How many of the picks (u, v) lay on the same elevated component as each of the pixels (K, 2), int (K,)."""
        columns, rows = np.array(picks, int).reshape(-1, 2).T
        counts = np.bincount(self._components[rows, columns], minlength=int(self._components.max()) + 1)
        return np.asarray(counts[self._components[pixels[:, 1], pixels[:, 0]]])

    def tried_here(self, pixels: np.ndarray) -> np.ndarray:
        """At which of the pixels (K, 2) an action has failed, as near as no two candidates are, bool (K,)."""
        apart = np.abs(self.failed_pixels[:, None] - pixels).max(axis=2)
        return np.asarray((apart <= self._config.peak_radius).any(axis=0))

    def _near(self, failure: Failure, pixels: np.ndarray) -> np.ndarray:
        """How much a failure says about what is at the pixels (K, 2) itself, (K,) from 0 to 1."""
        distance = ((pixels - np.array(failure.pixel)) ** 2).sum(axis=1)
        near = np.exp(-distance / (2 * FAILURE_SIGMA**2))
        return np.where(near < NEGLIGIBLE, 0, near)

    def _without(self, pairs: np.ndarray, failed: int, near: np.ndarray) -> np.ndarray:
        """Beliefs (K, 9) after a pair failed so near: in training, some pairs worked where that one had failed."""
        table = self._config.after_failure
        remaining = pairs.copy() if table is None else sigmoid(logit(pairs) + near[:, None] * np.array(table[failed]))
        remaining[:, failed] = pairs[:, failed] * (1 - near)
        return remaining


def _another_colour(before: Observation, after: Observation) -> np.ndarray:
    """Pixels that look otherwise to a camera that repeats itself, bool (H, W)."""
    return np.asarray(cv2.inRange(cv2.absdiff(before.rgb, after.rgb), (0, 0, 0), (ANOTHER_COLOUR,) * 3) == 0)


def _among(components: np.ndarray, some: set[int]) -> np.ndarray:
    """Which of the few numbers are in the set, bool (K,); `np.isin` takes ten times as long."""
    return np.array([one in some for one in components.tolist()], bool)


def _posterior(belief: Any, pair_belief: Any) -> Any:
    """Belief that something can be moved after a pair believed in so much did not move it (Bayes)."""
    return belief * (1 - pair_belief) / (1 - belief * pair_belief + 1e-6)


def moved_window(
    before: np.ndarray, after: np.ndarray, pixel: tuple[int, int], reach: int, change: float
) -> np.ndarray:
    """Pixels near (u, v) whose depth changed, bool (H, W).

    Args:
        before, after: depth images, float32 (H, W), board units.
        reach: how near in rows and columns, pixels.
        change: smaller differences are none, board units.
    """
    moved = np.zeros(before.shape, bool)
    around = _around(pixel, reach, before.shape)
    moved[around] = np.abs(after[around] - before[around]) > change
    return moved


def moved_region(
    before: np.ndarray, after: np.ndarray, pixel: tuple[int, int], body: np.ndarray, config: PolicyConfig
) -> np.ndarray:
    """The link under the action: pixels near it whose depth changed, closed, connected to it or on the same body.

    Args:
        before, after: depth images, float32 (H, W), board units.
        pixel: where the agent held, (u, v).
        body: bool (H, W), the object that the pixel belongs to. A link that jumped leaves two places behind, where it
            was and where it is: they need not be connected, but both are on its object.

    Returns:
        bool (H, W); holds the pixel in any case.
    """
    around = _within_reach(pixel, config, before.shape)
    middle = (pixel[0] - around[1].start, pixel[1] - around[0].start)
    moved = moved_window(before[around], after[around], middle, config.reach, config.change).astype(np.uint8)
    disc = np.asarray(cv2.circle(np.zeros(moved.shape, np.uint8), middle, config.disc, 1, -1), np.uint8)
    _, labels = cv2.connectedComponents(cv2.morphologyEx(moved | disc, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)))
    on_body = np.unique(labels[(moved > 0) & body[around]])
    mine = np.isin(labels, [labels[middle[1], middle[0]], *on_body[on_body > 0]])
    # the disc reaches what moved beside it, but is a region of its own only where nothing moved
    region = np.zeros(before.shape, bool)
    region[around] = mine & ((disc == 0) | (moved > 0)) if (mine & (moved > 0)).any() else mine
    region[pixel[1], pixel[0]] = True
    return region


def _within_reach(pixel: tuple[int, int], config: PolicyConfig, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Where the link under an action can be, with an empty border."""
    return _around(pixel, max(config.reach, config.disc) + BESIDE, shape)


def _around(pixel: tuple[int, int], reach: int, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """The square around (u, v), as far as it is within (H, W)."""
    rows, columns = (
        slice(max(middle - reach, 0), min(middle + reach + 1, side))
        for middle, side in zip(reversed(pixel), shape, strict=True)
    )
    return rows, columns


def enlarged(region: np.ndarray) -> np.ndarray:
    """A region (H, W) and the pixels next to it."""
    return cv2.dilate(region.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
