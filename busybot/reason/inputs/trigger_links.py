"""What pictures show of a board's trigger links, without labels: which link each action moved, and how all stand.

Where a trigger's own pixels change, a link moved; moves that change the same pixels, one way or the other, are those of
one link. How it stands is read from these pixels: pictures in which they look alike show one state. An action that
changed nothing on its trigger belongs to the link that was taken hold of nearest to it. Pictures do not tell which
state is "on", nor that there is a link that never moved.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from busybot.reason.inputs.object_masks import ChangeConfig, ObjectMasks, Region
from busybot.reason.inputs.observation import ObservedEpisode, acted_objects

STATES = 3
"""A link has so many at most."""
TOGETHER = 0.7
"""Moves are those of one link when what they change in the picture is so alike on average (1 less the absolute cosine):
a link that goes back changes the same pixels the other way round."""
REACH = 0.1
"""An action that moved nothing belongs to a link that was taken hold of so near, board units."""
OFTEN = 0.3
"""How a link stands is read from pixels that so large a share of its moves changed."""
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
    """

    clusters: np.ndarray
    states: np.ndarray
    owners: np.ndarray
    places: np.ndarray
    directions: tuple[np.ndarray, ...]

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of states that each link was seen in, at least two."""
        return tuple(max(2, int(column.max()) + 1) for column in self.states.T)


@dataclass(frozen=True)
class _Move:
    """What an action changed in a trigger's box: which pixels, bool (h, w), and by how much, float32 (h, w, 3)."""

    step: int
    owner: int
    changed: np.ndarray
    difference: np.ndarray


def observe_links(observed: ObservedEpisode, config: ChangeConfig | None = None) -> ObservedLinks:
    """Watch the links of a recording."""
    config, acted = config or ChangeConfig(), acted_objects(observed)
    pixels, contacts = ObjectMasks(observed, config), np.array([one.position for one in observed.actions], float)
    pictures = [observed.frame(observed.image_of.index(one)).rgb for one in sorted(set(observed.image_of))]
    frames = np.unique(observed.image_of, return_inverse=True)[1]  # the picture of each frame
    moves = _moves(observed, acted, pixels, pictures, frames, config)
    clusters = np.full(len(acted), -1)
    places: list[np.ndarray] = []
    owners: list[int] = []
    states: list[np.ndarray] = []
    directions: list[np.ndarray] = []
    for trigger in observed.triggers:
        own = [move for move in moves if move.owner == trigger]
        for group in _together(own):
            steps = np.array([move.step for move in group])
            seen = _states(pictures, pixels.regions[int(trigger)], group)[frames]
            moved = seen[steps] != seen[steps + 1]
            if not moved.any():
                continue
            clusters[steps] = len(places)
            places.append(contacts[steps, :2].mean(0))
            owners.append(int(trigger))
            states.append(seen)
            directions.append(_directions(observed, seen, steps))
    _join_failed(clusters, acted, contacts, np.array(owners, int), np.array(places).reshape(-1, 2))
    told = np.array(states, int).T.reshape(len(observed.image_of), len(states))
    return ObservedLinks(clusters, told, np.array(owners, int), np.array(places).reshape(-1, 2), tuple(directions))


def _moves(
    observed: ObservedEpisode,
    acted: np.ndarray,
    pixels: ObjectMasks,
    pictures: Sequence[np.ndarray],
    frames: np.ndarray,
    config: ChangeConfig,
) -> list[_Move]:
    """The actions that changed pixels of their trigger."""
    found = []
    for step, owner in enumerate(acted.tolist()):
        if owner not in pixels.regions or frames[step] == frames[step + 1]:
            continue
        region = pixels.regions[owner]
        before, after = (pictures[frames[number]][region.rows, region.columns] for number in (step, step + 1))
        changed = cv2.inRange(cv2.absdiff(before, after), (0, 0, 0), (config.tolerance,) * 3) == 0
        if changed.any():
            masks = [pixels.masks(owner, number) for number in (step, step + 1)]
            changed &= (masks[0][0] | masks[1][0]) & ~masks[0][1] & ~masks[1][1]
        if changed.any():
            difference = np.where(changed[..., None], after.astype(np.float32) - before, 0)
            found.append(_Move(step, owner, changed, difference))
    return found


def _together(moves: list[_Move]) -> list[list[_Move]]:
    from scipy.cluster.hierarchy import fcluster, linkage  # what only reads features does without
    from scipy.spatial.distance import squareform

    if len(moves) < 2:
        return [moves] if moves else []
    changes = np.array([move.difference.ravel() / np.linalg.norm(move.difference) for move in moves])
    apart = np.maximum(1 - np.abs(changes @ changes.T), 0)
    labels = fcluster(linkage(squareform(apart, checks=False), "average"), TOGETHER, "distance")
    return [[move for move, label in zip(moves, labels, strict=True) if label == each] for each in sorted(set(labels))]


def _states(pictures: Sequence[np.ndarray], region: Region, moves: list[_Move]) -> np.ndarray:
    """State of a link in each picture, int: looks of the pixels that its moves changed."""
    from scipy.cluster.hierarchy import fcluster, linkage

    often = np.sum([move.changed for move in moves], axis=0)
    where = often >= min(max(1, OFTEN * len(moves)), often.max())
    looks = np.array([one[region.rows, region.columns][where].ravel() for one in pictures], np.float32)
    tree = linkage(looks, "average", "cityblock")
    labels = fcluster(tree, ALIKE * tree[:, 2].max(), "distance")
    if len(set(labels)) > STATES:
        labels = fcluster(tree, STATES, "maxclust")
    return _numbered(labels)


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


def _directions(observed: ObservedEpisode, states: np.ndarray, steps: np.ndarray) -> np.ndarray:
    found = np.zeros((STATES, STATES, 3))
    for step in steps.tolist():
        found[states[step], states[step + 1]] += observed.actions[step].direction
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
