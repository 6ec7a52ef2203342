"""From a look at a board to action candidates: where to act, in which direction, how likely it works, on which region.

Paper section 4.1 takes the pixel with the highest affordance, section 4.2 the best position of each K-means cluster.
Here a candidate is a peak of the affordance, so that small and neighbouring links have candidates of their own;
`PolicyConfig.candidates = "kmeans"` selects the paper's clusters. A direction is proposed with its opposite, so a pair
works unless both fail: 1 - (1 - p)(1 - p_opposite).
"""

from dataclasses import dataclass, replace
from typing import Literal, Protocol, TypeVar

import cv2
import numpy as np

from busybot.common.rng import generator
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Observation
from busybot.interact.policy.board_memory import BoardMemory
from busybot.interact.policy.colour_patches import on_patches, patches_of
from busybot.interact.policy.config import OPENING, PolicyConfig
from busybot.interact.policy.direction_pairs import NOT_ELEVATED, better_of_pairs, logit, pair_scores, sigmoid

MOST_POINTS = 4000
"""K-means looks at no more pixels than these, evenly chosen."""
ASIDE = 9
"""Where little is promised, candidates are so far from each other and from where an action failed, pixels."""
EVEN = 16
"""Parts of a picture begin at multiples of this, because connected regions are numbered by squares of pixels."""


class ModelView(Protocol):
    """What a model sees in an image."""

    @property
    def height(self) -> np.ndarray:
        """float32 (H, W), board units above the board."""

    @property
    def affordance(self) -> np.ndarray:
        """float32 (H, W), logits that acting at the pixel has an effect; very low off elevated pixels."""


V = TypeVar("V", bound=ModelView)


class ActionModel(Protocol[V]):
    """What the policy needs of a model; `interact.affordance.fast.AffordanceModel` is one."""

    def look(self, seen: Observation, rays: Rays, earlier: V | None = None) -> V:
        """Affordance of every pixel; what an earlier look at the same board found may save work."""

    def directions(self, view: V, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """For int pixels (K, 2), u and v: position logits (K,) and probabilities of the 18 directions (K, 18)."""


@dataclass(frozen=True)
class Candidates:
    """K possible actions on what one image shows, in no particular order.

    Attributes:
        pixels: int (K, 2), u and v.
        positions: float32 (K, 3), board frame, board units.
        beliefs: float (K,), probability that something can be moved at the position.
        directions: float (K, 18), probability that the direction works where something can be moved.
        pairs: float (K, 9), the same of direction pairs.
        regions: int (K,). Positive: number of a link that the memory has seen moving. Negative: a connected region of
            affordance of which nothing has moved yet.
    """

    pixels: np.ndarray
    positions: np.ndarray
    beliefs: np.ndarray
    directions: np.ndarray
    pairs: np.ndarray
    regions: np.ndarray

    def __len__(self) -> int:
        return len(self.pixels)

    @property
    def scores(self) -> np.ndarray:
        """Expected success of the best direction pair, float (K,)."""
        return self.beliefs * self.pairs.max(axis=1, initial=0)

    @property
    def best_pairs(self) -> np.ndarray:
        """int (K,), which of the 9 pairs is believed in most."""
        return self.pairs.argmax(axis=1)

    @property
    def best_directions(self) -> np.ndarray:
        """int (K,), of the best pair the direction that is believed in more."""
        return better_of_pairs(self.directions, self.best_pairs)

    def take(self, chosen: np.ndarray) -> "Candidates":
        """Those candidates, by index or mask."""
        return replace(self, **{name: getattr(self, name)[chosen] for name in self.__dataclass_fields__})

    def best_of_regions(self) -> "Candidates":
        """One candidate per region, the one with the highest score."""
        return self.take(self.best_in_regions())

    def best_in_regions(self, values: np.ndarray | None = None) -> np.ndarray:
        """Their indices, the highest score first, int (regions,).

        Args:
            values: float (K,), what decides in the place of scores.
        """
        order = np.argsort(-(self.scores if values is None else values), kind="stable")
        _, first = np.unique(self.regions[order], return_index=True)
        return order[np.sort(first)]


def find_candidates(
    model: ActionModel[V],
    seen: Observation,
    rays: Rays,
    memory: BoardMemory | None = None,
    config: PolicyConfig | None = None,
    view: V | None = None,
    within: np.ndarray | None = None,
    triggers: np.ndarray | None = None,
) -> Candidates:
    """Action candidates on what an image shows.

    Args:
        model: affordance of positions and directions.
        seen: `episode.observation(frame)`, or `scene.observe().observation(scene.camera)`.
        rays: of its camera: `Rays(episode.camera)`.
        memory: what was learnt on this board; without it every region is new and nothing has failed yet.
        config: the policy's constants. A model has some of its own, which commands use:
            `policy_factory.policy_config(model.info, {})`. The defaults without it.
        view: what `model.look(seen, rays)` returned, if it was called already.
        within: bool (H, W), where something can be moved whatever the model says: its peaks there are candidates
            however low they are, if they are the highest around, and so is what is beside failures.
        triggers: int (K, 4), boxes of objects that have links: the middles of small patches of one colour on them are
            candidates, too. What is believed of patches is `colour_patches.on_patches`, and what failed beside one took
            hold of something else.

    Returns:
        candidates, empty where nothing can be held. `Candidates.best_of_regions` leaves one per region.
    """
    config = config or PolicyConfig()
    view = model.look(seen, rays) if view is None else view
    links = memory.links if memory is not None else np.zeros(view.height.shape, np.int32)
    window = _occupied(view.affordance, config)
    affordance, links = view.affordance[window], links[window]
    smooth = smoothed(affordance, config.blur)
    inside = _proposals(smooth, affordance, links, config)
    corner = (window[1].start, window[0].start)
    if within is not None:
        failed = np.zeros((0, 2), int) if memory is None else memory.failed_pixels
        there = within[window] & (links == 0)
        further = _further(smooth, affordance, there, failed - corner, config)
        inside = np.concatenate([inside, _apart(further, inside, config)])
    boxes = np.zeros((0, 4), int) if triggers is None else triggers - np.tile(corner, 2)
    patches = patches_of(seen.rgb[window], boxes, held(affordance) & (links == 0))
    inside = np.concatenate([inside, patches.middles_without(inside, config.peak_radius)])
    pixels = inside + corner
    if not len(pixels):
        none, positions = np.zeros(0), np.zeros((0, 3), np.float32)
        return Candidates(pixels, positions, none, np.zeros((0, 18)), np.zeros((0, 9)), none.astype(int))
    at_crop, directions = model.directions(view, pixels)
    new = links[inside[:, 1], inside[:, 0]] == 0
    directions = _doubting(directions, new, config)
    logits = config.dense_weight * smooth[inside[:, 1], inside[:, 0]] + (1 - config.dense_weight) * at_crop
    logits = logits + prior_shift(config) - config.caution * new
    logits = np.where(patches.at(inside) > 0, on_patches(logits), logits)
    beliefs, pairs = sigmoid(logits), pair_scores(directions)
    if memory is not None:
        elsewhere = patches.elsewhere(memory.failed_pixels - corner, inside)
        beliefs, pairs = memory.doubted(pixels, logits, pairs, elsewhere)
    regions = _regions(affordance, links, inside, config)
    columns, rows = pixels.T
    positions = rays.directions[rows, columns] * seen.depth[rows, columns, None] + rays.origin
    return Candidates(pixels, positions, beliefs, directions, pairs, regions)


def pairs_at(
    model: ActionModel[V], view: V, pixel: tuple[int, int], memory: BoardMemory, config: PolicyConfig
) -> np.ndarray:
    """What is believed of the direction pairs at one pixel, as of those of a candidate there, (9,)."""
    pixels = np.array([pixel])
    logits, directions = model.directions(view, pixels)
    new = memory.links[pixels[:, 1], pixels[:, 0]] == 0
    _, pairs = memory.doubted(pixels, logits, pair_scores(_doubting(directions, new, config)))
    return pairs[0]


def _doubting(directions: np.ndarray, new: np.ndarray, config: PolicyConfig) -> np.ndarray:
    """The model's probabilities (K, 18), less sure where nothing has moved yet, bool (K,): their logits are divided."""
    return sigmoid(logit(np.asarray(directions, float)) / np.where(new, config.temperature, 1)[:, None])


def smoothed(affordance: np.ndarray, width: int) -> np.ndarray:
    """Affordance logits (H, W) averaged over a few pixels; holds at a link's border become less attractive."""
    floored = np.maximum(affordance, NOT_ELEVATED).astype(np.float32)
    return cv2.GaussianBlur(floored, (width | 1, width | 1), 0)


def prior_shift(config: PolicyConfig) -> float:
    """What is added to a model's logits, because few places work and half of those that it was trained on did.

    Half of the shift that Bayes' rule asks for: the candidates are chosen, not any places.
    """
    return float(0.5 * np.log(config.prior / (1 - config.prior)))


def held(affordance: np.ndarray) -> np.ndarray:
    """bool (H, W): pixels at which the model sees something that could be held at all."""
    return affordance > NOT_ELEVATED / 2


def _occupied(affordance: np.ndarray, config: PolicyConfig) -> tuple[slice, slice]:
    """Rows and columns of the part of (H, W) beyond which nothing can be held or is near it."""
    left, top, width, height = cv2.boundingRect(held(affordance).view(np.uint8))
    margin = config.blur + config.peak_radius + OPENING
    sides = []
    for first, size, side in zip((top, left), (height, width), affordance.shape, strict=True):
        start = max(0, first - margin) // EVEN * EVEN  # regions are numbered as in the whole picture
        sides.append(slice(start, min(side, first + size + margin)))
    return sides[0], sides[1]


def _proposals(smooth: np.ndarray, affordance: np.ndarray, links: np.ndarray, config: PolicyConfig) -> np.ndarray:
    """Pixels int (K, 2): peaks, or the tops of clusters."""
    if config.candidates == "kmeans":
        belief = sigmoid(smooth + prior_shift(config))
        return cluster_tops(smooth, held(affordance) & is_likely(belief, config.cluster_belief), config.clusters)
    found = _peaks(smooth, held(affordance) & (smooth > config.peak_logit), config)
    if (known := links > 0).any():  # what is left of a region of which a link is known
        rest = np.where(known, np.float32(NOT_ELEVATED), affordance)
        square = np.ones((OPENING, OPENING), np.uint8)
        left = cv2.morphologyEx((rest > config.region_logit).view(np.uint8), cv2.MORPH_OPEN, square)
        rest = smoothed(rest, config.blur)
        rest[known] = NOT_ELEVATED
        found = np.unique(np.concatenate([found, _peaks(rest, left.view(bool), config)]), axis=0)
    return found


def _further(
    smooth: np.ndarray, affordance: np.ndarray, where: np.ndarray, failed: np.ndarray, config: PolicyConfig
) -> np.ndarray:
    """Pixels int (K, 2) to try where a model promises little and somebody knows more: peaks however low, the highest
    around, also of what is left beside the pixels (F, 2) where actions failed, and those pixels themselves. A small
    link that the model's peak is not on, but beside, has no other."""
    where = where & held(affordance)
    near = np.zeros(affordance.shape, np.uint8)
    for u, v in failed.tolist():
        cv2.circle(near, (u, v), ASIDE, 1, -1)
    rest = where & (near == 0)
    found = _peaks(np.where(rest, smooth, np.float32(NOT_ELEVATED)), rest, config, ASIDE)
    inside = ((failed >= 0) & (failed < where.shape[::-1])).all(axis=1)
    again = failed[inside][where[failed[inside, 1], failed[inside, 0]]]
    return np.concatenate([again, found])


def _apart(pixels: np.ndarray, others: np.ndarray, config: PolicyConfig) -> np.ndarray:
    """Of the pixels (K, 2) those that are not as near to one of the others, or of those before, as no two peaks are."""
    kept = others
    for pixel in pixels:
        if not (np.abs(kept - pixel).max(axis=1) <= config.peak_radius).any():
            kept = np.vstack([kept, pixel])
    return kept[len(others) :]


def is_likely(belief: np.ndarray, least: float | Literal["middle"]) -> np.ndarray:
    """Which pixels take part in clusters, bool (H, W): those above a belief, or above the middle between the highest
    and the lowest of the picture, as the paper's authors have it."""
    return np.asarray(belief > ((belief.max() + belief.min()) / 2 if least == "middle" else least))


def cluster_tops(affordance: np.ndarray, likely: np.ndarray, clusters: int) -> np.ndarray:
    """The paper's candidate positions (section 4.2): the likely pixels grouped by K-means, the best of each cluster.

    Args:
        affordance: float (H, W).
        likely: bool (H, W).
        clusters: k; fewer pixels make fewer clusters.

    Returns:
        int (K, 2), u and v. Equal input gives equal output: the clusters' seeds come from a generator of their own.
    """
    rows, columns = np.nonzero(likely)
    if not len(rows):
        return np.zeros((0, 2), int)
    points = np.stack([columns, rows], axis=1).astype(float)
    every = -(-len(points) // MOST_POINTS)
    from scipy.cluster.vq import kmeans2  # half a second to import, for the paper's policy alone

    centres, _ = kmeans2(
        points[::every], min(clusters, len(points[::every])), minit="++", rng=generator(0, "", 0, "interact/kmeans")
    )
    owner = np.argmin(((points[:, None] - centres[None]) ** 2).sum(-1), axis=1)
    values = affordance[rows, columns]
    best = [np.flatnonzero(owner == k)[values[owner == k].argmax()] for k in np.unique(owner)]
    return np.stack([columns[best], rows[best]], axis=1)


def _peaks(smooth: np.ndarray, where: np.ndarray, config: PolicyConfig, radius: int | None = None) -> np.ndarray:
    """Local maxima (u, v) of float32 (H, W), highest first, int (K, 2); one in the middle of each plateau."""
    side = 2 * (config.peak_radius if radius is None else radius) + 1
    top = (smooth == cv2.dilate(smooth, np.ones((side, side), np.uint8))) & where
    if (found := cv2.findNonZero(top.view(np.uint8))) is None:
        return np.zeros((0, 2), int)
    pixels = found.reshape(-1, 2).astype(int)  # (K, 2) or (K, 1, 2), as cv2 is old or new
    if _touching(top):
        pixels = _middles(pixels, cv2.connectedComponents(top.view(np.uint8), connectivity=8)[1])
    return pixels[np.argsort(-smooth[pixels[:, 1], pixels[:, 0]], kind="stable")[: config.most]]


def _touching(top: np.ndarray) -> bool:
    """Whether any two of the pixels that are set, bool (H, W), are neighbours."""
    pairs = ((top[1:], top[:-1]), (top[:, 1:], top[:, :-1]), (top[1:, 1:], top[:-1, :-1]), (top[1:, :-1], top[:-1, 1:]))
    return any(bool((one & other).any()) for one, other in pairs)


def _middles(pixels: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Of the pixels (K, 2) of each plateau (H, W) the one in its middle."""
    plateau = labels[pixels[:, 1], pixels[:, 0]]
    # not cv2's statistics, which take ten times as long because they count every pixel
    sums = np.stack([np.bincount(plateau, axis) for axis in pixels.T], axis=1)
    centres = sums / np.maximum(np.bincount(plateau), 1)[:, None]
    from_centre = ((pixels - centres[plateau]) ** 2).sum(axis=1)
    order = np.lexsort((from_centre, plateau))
    _, first = np.unique(plateau[order], return_index=True)
    return np.asarray(pixels[order[first]])


def _regions(affordance: np.ndarray, links: np.ndarray, pixels: np.ndarray, config: PolicyConfig) -> np.ndarray:
    """Region of each pixel: the known link, else minus a number of its own for each connected rest of affordance."""
    new = (affordance > config.region_logit) & (links == 0)
    count, labels = cv2.connectedComponents(new.view(np.uint8))
    columns, rows = pixels.T
    known, label = links[rows, columns], labels[rows, columns]
    alone = count + np.arange(len(pixels))  # a peak outside of every region is a region of its own
    return np.where(known > 0, known, -np.where(label > 0, label, alone))
