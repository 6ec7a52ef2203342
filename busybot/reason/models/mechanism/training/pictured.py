"""What pictures would tell of a board that was moved without a simulator: less than is true, and some of it wrongly."""

from itertools import pairwise

import numpy as np

from busybot.reason.models.mechanism.config import Blur
from busybot.reason.models.mechanism.contexts import Trace

COVERED = 4
"""What is hidden is hidden for so many pictures at most."""
STILL = 0.03
"""A board before a still camera is seen so badly."""
PHANTOM_MOVES = 2
"""A link that is none seems to move so often."""


def pictured(
    trace: Trace, parents: np.ndarray, blur: Blur, badly: float, rng: np.random.Generator
) -> tuple[Trace, np.ndarray, np.ndarray]:
    """A true trace as pictures tell it, without links that were not seen moving; the parents among what is left; and
    whether the states of its links are numbered as they rise, int (L,): 1 or -1, 0 of what is no link.

    Args:
        parents: bool (T, I, R), as of `LabelledTrace`.
        blur: of a board that is seen as badly as can be.
        badly: how badly this one is seen, 0 to 1.
    """
    responders = trace.responders
    seen = (trace.links != trace.links[0]).any(0)
    seen &= rng.random(len(seen)) >= badly * blur.hidden
    links = _mistaken(trace.links, trace.sizes, badly * blur.confused, rng)
    links, sizes = _missed(links, badly * blur.missed, rng)[:, seen], np.array(trace.sizes)[seen]
    kept = parents[:, np.concatenate([seen, np.ones(responders.shape[1], bool)])]
    rises = np.where(turned(Trace(links, responders, tuple(sizes.tolist()))), -1, 1)
    if rng.random() < badly * blur.phantoms:
        moves = rng.random(len(links)) < PHANTOM_MOVES / len(links)
        kept = np.insert(kept, links.shape[1], False, axis=1)
        links, sizes = np.hstack([links, np.cumsum(moves)[:, None] % 2]), np.append(sizes, 2)
        rises = np.append(rises, 0)
    shown = np.stack([_shown(column, badly, blur, rng) for column in responders.T], axis=1)
    told = as_pictured(Trace(links, shown, tuple(sizes.tolist())))
    return Trace(told.links, told.responders, tuple((told.links.max(0, initial=1) + 1).tolist())), kept, rises


def as_pictured(trace: Trace) -> Trace:
    """The same with states numbered as pictures number them: as they appear, but for the middle one of three links'."""
    links = np.where(turned(trace), np.array(trace.sizes) - 1 - trace.links, trace.links)
    responders = np.stack([_as_they_appear(column) for column in trace.responders.T], axis=1)
    return Trace(links, responders, trace.sizes)


def turned(trace: Trace) -> np.ndarray:
    """Which links' states pictures number from the highest one on, bool (L,)."""
    return np.asarray(trace.links[0] > (np.array(trace.sizes) - 1) / 2)


def _as_they_appear(states: np.ndarray) -> np.ndarray:
    order = list(dict.fromkeys(states.tolist()))
    return np.array([order.index(state) for state in states.tolist()])


def _mistaken(true: np.ndarray, sizes: tuple[int, ...], share: float, rng: np.random.Generator) -> np.ndarray:
    """States of the links, some of whose moves are taken for those of another one."""
    links = true.copy()
    for step in range(1, len(links)):
        links[step] = links[step - 1]
        for link in np.flatnonzero(true[step] != true[step - 1]):
            other = int(rng.integers(len(sizes)))
            if rng.random() < share and other != link:
                links[step, other] = (links[step, other] + 1) % sizes[other]
            else:
                links[step, link] = true[step, link]
    return links


def _missed(true: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """States of the links, some of whose moves are seen at their next one only."""
    links = true.copy()
    for column in links.T:
        moves = np.flatnonzero(np.diff(column)) + 1
        for start, end in pairwise([*moves, len(column)]):
            if rng.random() < share:
                column[start:end] = column[start - 1]
    return links


def _shown(true: np.ndarray, badly: float, blur: Blur, rng: np.random.Generator) -> np.ndarray:
    """States that a responder seems to be in: always the same, or another one in single pictures, or what it was
    before something hid it."""
    if rng.random() < badly * blur.still:
        return np.full_like(true, true[0])
    flashes = rng.random(len(true)) < badly * blur.flashes
    states = np.where(flashes, rng.choice(np.unique(true), len(true)), true)
    for start in np.flatnonzero(rng.random(len(true) - 1) < badly * blur.covered) + 1:
        states[start : start + int(rng.integers(COVERED)) + 1] = states[start - 1]
    return states
