"""What pictures show of a board's trigger links, without labels: which link each action moved, and how all stand.

Where a trigger's own pixels change, a link moved; moves that change the same pixels, one way or the other, are those of
one link. How it stands is read from these pixels, as far as no other link changes them: pictures in which they look
alike show one state. A link with three states changes other pixels by its second move than by its first, but some of
them again: two links that share pixels and never stand in all four ways are one, unless each way out of what would be
its middle state is held elsewhere. An action that changed nothing on its trigger belongs to the link that was taken
hold of nearest to it. Pictures do not tell which state is "on", nor that there is a link that never moved.

Before a camera that is not still some moves change hardly more than the camera does. Then what was taken hold of at one
place is one link, whatever its pixels tell; links are read from all that their moves change together, and tracked from
try to try: most of these move them. How pictures show each trigger `trigger_views` tells.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, pairwise
from operator import itemgetter

import numpy as np

from busybot.episodes.camera import project
from busybot.episodes.episode import Camera
from busybot.reason.inputs.link_tracking import lasts, tracked
from busybot.reason.inputs.observation import ObservedEpisode, acted_objects, actions_of, pushes_of
from busybot.reason.inputs.steady import pictures_of, steadied, still_pictures
from busybot.reason.inputs.trigger_views import Move, StillTriggers, UnsteadyTriggers, View, refuse_too_many

STATES = 3
"""A link has so many at most."""
TOGETHER = 0.7
"""Moves are those of one link when what they change in the picture is so alike on average (1 less the absolute cosine):
a link that goes back changes the same pixels the other way round."""
REACH = 0.07
"""An action that moved nothing belongs to a link that was taken hold of so near, board units."""
FRINGE = 0.05
"""So large a share of a link's pixels, on each side, is not told of its outline."""
SHARED = 0.36
"""The moves of a link with three states have so large a share of pixels in common, of those that the smaller one
changed: .39 or more on boards of training objects."""
ONE_PLACE, WHOLE = 0.065, 0.8
"""From its middle state it is moved either way by one place (.05 board units apart at most there; two links that share
as many pixels .08 or more), but what is pressed at two ends, of which so large a share changes either way."""
OFTEN = 0.3
"""How a link stands is read from pixels that so large a share of its moves changed."""
PLACES, NEAR = 0.4, 0.08
"""Before a camera that is not still, which link an action moved is told by pixels and, with this weight, by where it
took hold: two places so far apart are not near at all, board units."""
BESIDE = 0.06
"""There, an action of which no pixels tell anything may have moved a link that was taken hold of so near."""
SECOND = 0.45
"""There, moves change pixels in two ways if the second is so large beside the first."""
CENTRE = 0.5
"""Of a pixel, from its corner."""
ALIKE = 0.45
"""Two pictures of a link show one state if they differ by less than this share of the largest difference."""


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
        steadied: whether the camera was not still.
        pushed: float32 (T, 3), the direction that each action tried last, if anything changed; else the proposed one.
        pixels: L int arrays (n, 2), (u, v) of the pixels that tell how each link stands.
        camera: that sees them. `pushed`, `pixels` and this are known of a still camera alone.
        outlines: float (L, 6), width and height of the owner's box, and of the pixels that tell how the link stands,
            and how far right and down of the box's centre theirs is, in widths of the picture; None if nobody knows.
    """

    clusters: np.ndarray
    states: np.ndarray
    owners: np.ndarray
    places: np.ndarray
    directions: tuple[np.ndarray, ...]
    steadied: bool = False
    pushed: np.ndarray | None = None
    pixels: tuple[np.ndarray, ...] = ()
    camera: Camera | None = None
    outlines: np.ndarray | None = None

    def away(self, place: np.ndarray) -> np.ndarray:
        """How far each link's pixels are from where a place (3,) is seen, float (L,), pixels; infinity if nobody
        knows."""
        if self.camera is None:
            return np.full(len(self.owners), np.inf)
        at, _ = project(place, self.camera)
        return np.array([np.abs(own + CENTRE - at).max(1).min(initial=np.inf) for own in self.pixels])

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of states that each link was seen in, at least two."""
        return tuple(max(2, int(column.max()) + 1) for column in self.states.T)


@dataclass(frozen=True)
class _Link:
    """The actions that moved one link, its states in all F frames, and the pixels of its trigger's box that it changes.

    Attributes:
        steps: int (n,).
        states: int (F,).
        changed: bool (h, w).
        own: bool (h, w), those that tell how it stands.
    """

    steps: np.ndarray
    states: np.ndarray
    changed: np.ndarray
    own: np.ndarray


class LinkWatch:
    """Watches the links of a recording. What several parts of it show is told without looking at all pictures again.

    Args:
        observed: T actions.
        calm: the same as `steadied` makes it, if that was done already.
        shorter: watches the beginning of the same recording: what it has looked at is not looked at again.
    """

    def __init__(
        self, observed: ObservedEpisode, calm: ObservedEpisode | None = None, shorter: "LinkWatch | None" = None
    ):
        self._observed, self._calm = observed, calm
        self._known_still: int = 1 if shorter is None else shorter._known_still
        self._triggers: StillTriggers | None = None if shorter is None else shorter._triggers

    def first(self, steps: int, effects: tuple[bool, ...] | None = None) -> ObservedLinks:
        """What pictures show in the first so many actions.

        Args:
            effects: after which of these any responder changed. Before a camera that is not still that helps to tell
                which ones moved a link; None if nobody knows.
        """
        observed = self._observed.first(steps + 1)
        unsteady = len(pictures_of(observed)) > self._still_pictures
        acted = self._acted[:steps]
        views = self._unsteady.views(acted) if unsteady else self._views
        return _links_of(observed, views, acted, unsteady, None if effects is None else np.array(effects, bool))

    @cached_property
    def _acted(self) -> np.ndarray:
        return acted_objects(self._observed)

    @property
    def still(self) -> bool:
        """Whether all pictures are those of a camera that is still."""
        return self._still_pictures == len(pictures_of(self._observed))

    @cached_property
    def _still_pictures(self) -> int:
        self._known_still = still_pictures(self._observed, self._known_still)
        return self._known_still

    @cached_property
    def _unsteady(self) -> UnsteadyTriggers:
        refuse_too_many(self._observed)
        return UnsteadyTriggers(self._calm or steadied(self._observed))

    @cached_property
    def _views(self) -> dict[int, View]:
        """How a still camera shows a trigger in a frame does not depend on later ones."""
        if self._triggers is None:
            self._triggers = StillTriggers(self._observed)
        self._triggers.grow(self._observed)
        return self._triggers.views


def _links_of(
    observed: ObservedEpisode,
    views: Mapping[int, View],
    acted: np.ndarray,
    unsteady: bool,
    effects: np.ndarray | None = None,
) -> ObservedLinks:
    contacts = np.array([one.position for one in observed.actions], float).reshape(-1, 3)
    pushed = (actions_of if unsteady else pushes_of)(observed)[:, 3:]
    clusters = np.full(len(acted), -1)
    places: list[np.ndarray] = []
    owners: list[int] = []
    states: list[np.ndarray] = []
    pixels: list[np.ndarray] = []
    directions: list[np.ndarray] = []
    outlines: list[np.ndarray] = []
    for trigger, view in views.items():
        touched = np.flatnonzero(acted == trigger)
        groups = _together(view.moves(touched), contacts if unsteady else None)
        shown, frames = np.unique(view.frames[: len(acted) + 1], return_inverse=True)
        pictures = [view.pictures[number] for number in shown.tolist()]
        tries = _tries(groups, touched, contacts) if unsteady else [_steps(group) for group in groups]
        links = []
        for group, own, tried in zip(groups, _own_pixels(groups), tries, strict=True):
            looks = np.array([one[own].ravel() for one in pictures], np.float32)
            if unsteady:
                followed = None if effects is None else effects[tried]
                links.append(_link_by_moves(group, looks[frames], tried, own, followed))
            else:
                links.append(_Link(tried, _states(looks)[frames], _changed(group), own))
        moving = [one for one in links if (one.states[one.steps] != one.states[one.steps + 1]).any()]
        for link in _whole(moving, contacts[:, :2]):
            clusters[link.steps] = len(places)
            places.append(contacts[link.steps, :2].mean(0))
            owners.append(trigger)
            states.append(link.states)
            pixels.append(np.argwhere(link.own)[:, ::-1] + view.corner[::-1])
            directions.append(directions_of(pushed, link.states, link.steps))
            outlines.append(_outline(link.own))
    _join_failed(clusters, acted, contacts, np.array(owners, int), np.array(places).reshape(-1, 2))
    told = np.array(states, int).T.reshape(len(observed.image_of), len(states))
    at = np.array(places).reshape(-1, 2)
    outlined = np.array(outlines).reshape(-1, 6) / observed.frame(0).rgb.shape[1]
    found = ObservedLinks(clusters, told, np.array(owners, int), at, tuple(directions), unsteady, outlines=outlined)
    if unsteady:  # which way worked, and which pixels, is not sure then
        return found
    return replace(found, pushed=pushed, pixels=tuple(pixels), camera=observed.camera)


def _together(moves: list[Move], contacts: np.ndarray | None) -> list[list[Move]]:
    """Moves by links; by pixels alone if no contacts (T, 3) are given."""
    from scipy.cluster.hierarchy import fcluster, linkage  # what only reads features does without
    from scipy.spatial.distance import squareform

    if len(moves) < 2:
        return [moves] if moves else []
    sizes = np.array([np.linalg.norm(move.difference) for move in moves])
    changes = np.array([move.difference.ravel() for move in moves]) / sizes[:, None]
    alike = np.abs(changes @ changes.T)
    if contacts is None:
        apart = np.maximum(1 - alike, 0)
    else:  # what else a passing shadow changed in one of them does not make it another link's
        alike *= np.maximum.outer(sizes, sizes) / np.minimum.outer(sizes, sizes)
        places = contacts[[move.step for move in moves], :2]
        away = np.linalg.norm(places[:, None] - places, axis=-1)
        apart = (1 - PLACES) * np.maximum(1 - alike, 0) + PLACES * np.minimum(away / NEAR, 1)
        np.fill_diagonal(apart, 0)
    labels = fcluster(linkage(squareform(apart, checks=False), "average"), TOGETHER, "distance")
    # in the order in which they moved first: that of the labels depends on the processor
    order = dict.fromkeys(labels.tolist())
    return [[move for move, label in zip(moves, labels, strict=True) if label == each] for each in order]


def _own_pixels(groups: list[list[Move]]) -> list[np.ndarray]:
    """The pixels that tell how each link stands, bool (h, w): often changed by its moves, and not by another link's if
    there are such."""
    changed = [np.sum([move.changed for move in group], axis=0) for group in groups]
    often = [
        count >= min(max(1, OFTEN * len(group)), count.max()) for group, count in zip(groups, changed, strict=True)
    ]
    alone = [own & (np.sum(often, axis=0) == 1) for own in often]
    return [one if one.any() else own for one, own in zip(alone, often, strict=True)]


def _steps(group: Sequence[Move]) -> np.ndarray:
    return np.array([move.step for move in group])


def _tries(groups: Sequence[Sequence[Move]], touched: np.ndarray, contacts: np.ndarray) -> list[np.ndarray]:
    """Of each link its moves, and those actions on the trigger that changed nothing but took hold beside them; in
    order. Such an action is of the nearest link alone."""
    found = [_steps(group) for group in groups]
    for step in np.setdiff1d(touched, np.concatenate(found) if found else []).tolist():
        away = [np.linalg.norm(contacts[_steps(group), :2] - contacts[step, :2], axis=1).min() for group in groups]
        if away and min(away) < BESIDE:
            nearest = int(np.argmin(away))
            found[nearest] = np.union1d(found[nearest], [step])
    return found


def _link_by_moves(
    group: Sequence[Move], looks: np.ndarray, tries: np.ndarray, own: np.ndarray, effects: np.ndarray | None
) -> _Link:
    """A link before a camera that is not still: its pixels are read along the one or two ways in which its moves change
    them together, and how it stands is told by all pictures between two tries, and by that most of these move it.

    Args:
        looks: float32 (F, C), of the pixels that tell it in each frame.
        tries: actions that may have moved it.
        own: bool (h, w), where these pixels are.
        effects: bool, after which of these any responder changed; None if nobody knows.
    """
    steps = _steps(group)
    changes = looks[steps + 1] - looks[steps]
    _, sizes, ways = np.linalg.svd(changes, full_matrices=False)
    used = ways[: 1 + int(len(sizes) > 1 and sizes[1] > SECOND * sizes[0])]
    seen, ends = looks @ used.T, [0, *(tries + 1).tolist(), len(looks)]
    shown = np.array([np.median(seen[start:end], axis=0) for start, end in pairwise(ends)])
    alike = _states(seen, "euclidean")
    first = np.array([np.bincount(alike[start:end]).argmax() for start, end in pairwise(ends)])
    moved = np.append(False, np.isin(tries, steps))
    change = float(np.median(np.linalg.norm(changes @ used.T, axis=1)))
    starts = [numbered(first), np.arange(len(shown)) % 2, np.cumsum(moved) % 2]
    if effects is not None:
        starts.append(np.append(0, np.cumsum(effects)) % 2)
    cost, found = min((tracked(shown, start, change, effects) for start in starts), key=itemgetter(0))
    if np.isinf(cost):
        found = starts[0]
    if len(group) == 1 and not lasts(shown, found, change):
        found = np.zeros_like(found)
    states = numbered(np.repeat(found, np.diff(ends)))
    return _Link(np.union1d(steps, tries[states[tries] != states[tries + 1]]), states, _changed(group), own)


def _states(looks: np.ndarray, distance: str = "cityblock") -> np.ndarray:
    """State of a link in each picture, int: how the pixels look that tell it, float32 (pictures, C)."""
    from scipy.cluster.hierarchy import fcluster, linkage

    tree = linkage(looks, "average", distance)
    labels = fcluster(tree, ALIKE * tree[:, 2].max(), "distance")
    if len(set(labels)) > STATES:
        labels = fcluster(tree, STATES, "maxclust")
    return numbered(labels)


def _outline(own: np.ndarray) -> np.ndarray:
    """As of `ObservedLinks.outlines`, in pixels; a few pixels far from the others do not count.

    Args:
        own: bool (h, w), in the owner's box.
    """
    box = np.array(own.shape[::-1], float)
    low, high = np.quantile(np.argwhere(own)[:, ::-1], (FRINGE, 1 - FRINGE), axis=0)
    return np.concatenate([box, high - low, (low + high - box) / 2])


def _changed(moves: Sequence[Move]) -> np.ndarray:
    """The pixels that any of these changed, bool (h, w)."""
    return np.any([move.changed for move in moves], axis=0)


def _whole(links: list[_Link], places: np.ndarray) -> list[_Link]:
    """The links of one trigger, with those joined that are one of three states.

    Args:
        places: float (T, 2), where each action took hold.
    """
    for one, other in combinations(links, 2):
        both = one.states * STATES + other.states
        two = one.states.max() == other.states.max() == 1
        if two and len(set(both.tolist())) == STATES:
            shared = (one.changed & other.changed).sum() / min(one.changed.sum(), other.changed.sum())
            steps = np.union1d(one.steps, other.steps)
            joined = _Link(steps, numbered(both), one.changed | other.changed, one.own | other.own)
            if shared > WHOLE or (shared > SHARED and not _apart(joined, places)):
                return _whole([*(each for each in links if each is not one and each is not other), joined], places)
    return links


def _apart(link: _Link, places: np.ndarray) -> bool:
    """Whether actions took hold at two places, one for each way out of the middle state."""
    middle = link.steps[link.states[link.steps] == 1]
    ways = [places[middle[link.states[middle + 1] == end]] for end in (0, 2)]
    return all(map(len, ways)) and bool(np.linalg.norm(ways[0].mean(0) - ways[1].mean(0)) > ONE_PLACE)


def numbered(labels: np.ndarray) -> np.ndarray:
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
