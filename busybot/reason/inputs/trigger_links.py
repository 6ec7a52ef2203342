"""What pictures show of a board's trigger links, without labels: which link each action moved, and how all stand.

Where a trigger's own pixels change, a link moved; moves that change the same pixels, one way or the other, are those of
one link. How it stands is read from these pixels, as far as no other link changes them: pictures in which they look
alike show one state. A link with three states changes other pixels by its second move than by its first, but some of
them again: two links that share pixels and never stand in all four ways are one. An action that changed nothing on its
trigger belongs to the link that was taken hold of nearest to it. Pictures do not tell which state is "on", nor that
there is a link that never moved.

Pictures of a camera that is not still (`steady`) differ where nothing moved. Between two actions on a trigger it shows
one state: the median of these pictures is taken for each of them, without what is hidden in it, and a trigger that is
not seen at all keeps how it looked. A pixel then changed if it did by more than what is left of the noise.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import combinations

import numpy as np

from busybot.reason.inputs.object_masks import ChangeConfig, ObjectMasks
from busybot.reason.inputs.observation import ObservedEpisode, acted_objects
from busybot.reason.inputs.steady import pictures_of, steadied, still_pictures

STATES = 3
"""A link has so many at most."""
TOGETHER = 0.7
"""Moves are those of one link when what they change in the picture is so alike on average (1 less the absolute cosine):
a link that goes back changes the same pixels the other way round."""
REACH = 0.1
"""An action that moved nothing belongs to a link that was taken hold of so near, board units."""
SHARED = 0.28
"""The moves of a link with three states have so large a share of pixels in common, of those that the smaller one
changed: .31 or more on boards of training objects, where those of two links never had more than .24."""
OFTEN = 0.3
"""How a link stands is read from pixels that so large a share of its moves changed."""
ALIKE = 0.45
"""Two pictures of a link show one state if they differ by less than this share of the largest difference."""
USUAL, ABOVE = 0.8, 3.0
"""Of a pixel's noise: what so large a share of its pictures stays within, and how far beyond a change lies."""


@dataclass(frozen=True)
class ObservedLinks:
    """L links in T actions.

    Attributes:
        clusters: int (T,), the link that each action took hold of, -1 for none.
        states: int (T + 1, L), numbered as they appear, except that the middle one of three is 1.
        owners: int (L,), the object of each link.
        places: float (L, 2), mean contact, board units.
        directions: tuple of L float arrays (states, states, 3): mean direction of the actions that led from one state
            to another, zeros where none did.
    """

    clusters: np.ndarray
    states: np.ndarray
    owners: np.ndarray
    places: np.ndarray
    directions: tuple[np.ndarray, ...]
    steadied: bool = False

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of states that each link was seen in, at least two."""
        return tuple(max(2, int(column.max()) + 1) for column in self.states.T)


@dataclass(frozen=True)
class _Move:
    """What an action changed in a trigger's box: which pixels, bool (h, w), and by how much, float32 (h, w, 3)."""

    step: int
    changed: np.ndarray
    difference: np.ndarray


@dataclass(frozen=True)
class _Link:
    """The actions that moved one link, its states in all F frames, and the pixels of its trigger's box that it changes.

    Attributes:
        steps: int (n,).
        states: int (F,).
        changed: bool (h, w).
    """

    steps: np.ndarray
    states: np.ndarray
    changed: np.ndarray


class _View:
    """A trigger's box in the pictures of T + 1 frames.

    Args:
        pictures: uint8 or float32 (h, w, 3), by their number.
        frames: int (T + 1,), number of the picture that each frame shows.
        least: float (h, w), what a pixel that did not change may differ by.
        masks: of two frames, which pixels may have changed, bool (h, w).
        pixels: more than so many changed, if any did.
    """

    def __init__(
        self,
        pictures: Mapping[int, np.ndarray],
        frames: np.ndarray,
        least: np.ndarray,
        masks: Callable[[int, int], np.ndarray],
        pixels: int = 0,
    ):
        self.pictures, self.frames = pictures, frames
        self._least, self._masks, self._pixels = least, masks, pixels
        self._moves: dict[int, _Move | None] = {}

    def moves(self, steps: np.ndarray) -> list[_Move]:
        """The actions on the trigger, of these, that changed pixels of it."""
        for step in steps.tolist():
            if step not in self._moves:
                self._moves[step] = self._move(step)
        return [move for step in steps.tolist() if (move := self._moves[step]) is not None]

    def _move(self, step: int) -> _Move | None:
        if self.frames[step] == self.frames[step + 1]:
            return None
        before, after = (self.pictures[int(self.frames[number])].astype(np.float32) for number in (step, step + 1))
        changed = np.abs(after - before).max(axis=-1) > self._least
        if changed.any():
            changed &= self._masks(step, step + 1)
        if changed.sum() <= self._pixels:
            return None
        return _Move(step, changed, np.where(changed[..., None], after - before, 0))


class LinkWatch:
    """Watches the links of a recording. What several parts of it show is told without looking at all pictures again.

    Args:
        observed: T actions.
    """

    def __init__(self, observed: ObservedEpisode, config: ChangeConfig | None = None):
        self._observed, self._config = observed, config or ChangeConfig()

    def first(self, steps: int) -> ObservedLinks:
        """What pictures show in the first so many actions."""
        observed = self._observed.first(steps + 1)
        unsteady = len(pictures_of(observed)) > self._still
        views = self._steadied(observed) if unsteady else self._views
        return _links_of(observed, views, self._acted[:steps], unsteady)

    @cached_property
    def _acted(self) -> np.ndarray:
        return acted_objects(self._observed)

    @cached_property
    def _still(self) -> int:
        return still_pictures(self._observed)

    @cached_property
    def _views(self) -> dict[int, _View]:
        """Each trigger's box as a still camera shows it: how it looks in a frame does not depend on later ones."""
        observed, config = self._observed, self._config
        pixels, frames = ObjectMasks(observed, config), np.array(observed.image_of)
        regions = {int(one): pixels.regions[one] for one in observed.triggers if one in pixels.regions}
        boxes: dict[int, dict[int, np.ndarray]] = {one: {} for one in regions}
        for number in dict.fromkeys(observed.image_of):
            picture = observed.images[number].rgb
            for one, region in regions.items():
                boxes[one][number] = picture[region.rows, region.columns].copy()

        def masks(trigger: int, one: int, other: int) -> np.ndarray:
            before, after = (pixels.masks(trigger, number) for number in (one, other))
            return np.asarray((before[0] | after[0]) & ~before[1] & ~after[1])

        return {
            one: _View(boxes[one], frames, np.full(region.mine.shape, float(config.tolerance)), partial(masks, one))
            for one, region in regions.items()
        }

    def _steadied(self, observed: ObservedEpisode) -> dict[int, _View]:
        steady, acted = steadied(observed), self._acted[: len(observed.actions)]
        pixels = ObjectMasks(steady, self._config)
        return {
            int(one): _calm(steady, pixels, int(one), acted == one, self._config)
            for one in observed.triggers
            if one in pixels.regions
        }


def observe_links(observed: ObservedEpisode, config: ChangeConfig | None = None) -> ObservedLinks:
    """Watch the links of a recording."""
    return LinkWatch(observed, config).first(len(observed.actions))


def _links_of(
    observed: ObservedEpisode, views: Mapping[int, _View], acted: np.ndarray, unsteady: bool
) -> ObservedLinks:
    contacts = np.array([one.position for one in observed.actions], float)
    pushed = np.array([one.direction for one in observed.actions], float)
    clusters = np.full(len(acted), -1)
    places: list[np.ndarray] = []
    owners: list[int] = []
    states: list[np.ndarray] = []
    directions: list[np.ndarray] = []
    for trigger, view in views.items():
        groups = _together(view.moves(np.flatnonzero(acted == trigger)))
        shown, frames = np.unique(view.frames[: len(acted) + 1], return_inverse=True)
        pictures = [view.pictures[number] for number in shown.tolist()]
        links = [
            _Link(np.array([move.step for move in group]), _states(pictures, own)[frames], _changed(group))
            for group, own in zip(groups, _own_pixels(groups), strict=True)
        ]
        for link in _whole([one for one in links if (one.states[one.steps] != one.states[one.steps + 1]).any()]):
            clusters[link.steps] = len(places)
            places.append(contacts[link.steps, :2].mean(0))
            owners.append(trigger)
            states.append(link.states)
            directions.append(directions_of(pushed, link.states, link.steps))
    _join_failed(clusters, acted, contacts, np.array(owners, int), np.array(places).reshape(-1, 2))
    told = np.array(states, int).T.reshape(len(observed.image_of), len(states))
    at = np.array(places).reshape(-1, 2)
    return ObservedLinks(clusters, told, np.array(owners, int), at, tuple(directions), unsteady)


def _calm(
    observed: ObservedEpisode, pixels: ObjectMasks, trigger: int, touched: np.ndarray, config: ChangeConfig
) -> _View:
    """A trigger's box in each frame: the median of what was seen of each pixel since the trigger was touched last."""
    region, count = pixels.regions[trigger], len(observed.image_of)
    boxes = np.array([observed.frame(k).rgb[region.rows, region.columns] for k in range(count)], np.float32)
    own, hidden = (np.array(one) for one in zip(*(pixels.masks(trigger, k) for k in range(count)), strict=True))
    boxes[hidden] = np.nan
    runs, calm = np.concatenate([[0], np.cumsum(touched)]), np.empty_like(boxes)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # what was never seen has no median
        last = np.nan_to_num(np.nanmedian(boxes, axis=0))
        for run in range(int(runs[-1]) + 1):
            look = np.nanmedian(boxes[runs == run], axis=0)
            last = np.where(np.isnan(look), last, look)
            calm[runs == run] = last
        usual = np.nan_to_num(np.nanquantile(np.abs(boxes - calm).max(axis=-1), USUAL, axis=0))
    mine = own.mean(axis=0) > 0.5
    least = np.maximum(config.tolerance, ABOVE * usual)
    return _View(dict(enumerate(calm)), np.arange(count), least, lambda *_: mine, config.least)


def _together(moves: list[_Move]) -> list[list[_Move]]:
    from scipy.cluster.hierarchy import fcluster, linkage  # what only reads features does without
    from scipy.spatial.distance import squareform

    if len(moves) < 2:
        return [moves] if moves else []
    changes = np.array([move.difference.ravel() / np.linalg.norm(move.difference) for move in moves])
    apart = np.maximum(1 - np.abs(changes @ changes.T), 0)
    labels = fcluster(linkage(squareform(apart, checks=False), "average"), TOGETHER, "distance")
    return [[move for move, label in zip(moves, labels, strict=True) if label == each] for each in sorted(set(labels))]


def _own_pixels(groups: list[list[_Move]]) -> list[np.ndarray]:
    """The pixels that tell how each link stands, bool (h, w): often changed by its moves, and not by another link's if
    there are such."""
    changed = [np.sum([move.changed for move in group], axis=0) for group in groups]
    often = [
        count >= min(max(1, OFTEN * len(group)), count.max()) for group, count in zip(groups, changed, strict=True)
    ]
    alone = [own & (np.sum(often, axis=0) == 1) for own in often]
    return [one if one.any() else own for one, own in zip(alone, often, strict=True)]


def _states(pictures: Sequence[np.ndarray], where: np.ndarray) -> np.ndarray:
    """State of a link in each picture, int: how the pixels look that tell it."""
    from scipy.cluster.hierarchy import fcluster, linkage

    looks = np.array([one[where].ravel() for one in pictures], np.float32)
    tree = linkage(looks, "average", "cityblock")
    labels = fcluster(tree, ALIKE * tree[:, 2].max(), "distance")
    if len(set(labels)) > STATES:
        labels = fcluster(tree, STATES, "maxclust")
    return _numbered(labels)


def _changed(moves: Sequence[_Move]) -> np.ndarray:
    """The pixels that any of these changed, bool (h, w)."""
    return np.any([move.changed for move in moves], axis=0)


def _whole(links: list[_Link]) -> list[_Link]:
    """The links of one trigger, with those joined that are one of three states."""
    for one, other in combinations(links, 2):
        both = one.states * STATES + other.states
        shared = (one.changed & other.changed).sum() / min(one.changed.sum(), other.changed.sum())
        two = one.states.max() == other.states.max() == 1
        if two and shared > SHARED and len(set(both.tolist())) == STATES:
            joined = _Link(np.union1d(one.steps, other.steps), _numbered(both), one.changed | other.changed)
            return _whole([*(each for each in links if each is not one and each is not other), joined])
    return links


def _numbered(labels: np.ndarray) -> np.ndarray:
    """Labels as numbers in the order in which they appear; of three, the one next to most others is in the middle."""
    order = list(dict.fromkeys(labels.tolist()))
    if len(order) == STATES:
        next_to = {one: {b for a, b in zip(labels, labels[1:], strict=False) if a == one != b} for one in order}
        next_to = {one: {*others, *(a for a in order if one in next_to[a])} for one, others in next_to.items()}
        middle = max(order, key=lambda one: len(next_to[one]))
        ends = [one for one in order if one != middle]
        order = [ends[0], middle, ends[1]]
    return np.array([order.index(label) for label in labels.tolist()])


def directions_of(pushed: np.ndarray, states: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Mean direction in which a link was pushed from one state to another, float (STATES, STATES, 3), as of
    `ObservedLinks`.

    Args:
        pushed: float (T, 3), directions of all actions.
        states: int (T + 1,), of the link.
        steps: its actions.
    """
    found = np.zeros((STATES, STATES, 3))
    np.add.at(found, (states[steps], states[steps + 1]), pushed[steps])
    lengths = np.linalg.norm(found, axis=-1, keepdims=True)
    return np.divide(found, lengths, out=np.zeros_like(found), where=lengths > 0)


def _join_failed(
    clusters: np.ndarray, acted: np.ndarray, contacts: np.ndarray, owners: np.ndarray, places: np.ndarray
) -> None:
    """Give actions that moved nothing to the nearest link of their trigger, in place."""
    for step in np.flatnonzero((clusters < 0) & (acted >= 0)):
        own = np.flatnonzero(owners == acted[step])
        if len(own):
            away = np.linalg.norm(places[own] - contacts[step, :2], axis=1)
            if away.min() < REACH:
                clusters[step] = own[away.argmin()]
