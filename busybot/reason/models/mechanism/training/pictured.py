"""What pictures would tell of a board that was moved without a simulator: less than is true, and some of it wrongly."""

from itertools import pairwise

import numpy as np

from busybot.reason.inputs.trigger_links import numbered
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
    """A true trace as pictures tell it, with states numbered as they number them and without links that were not seen
    moving; the parents among what is left; and which way round its links are numbered, as of `way_round`.

    Args:
        parents: bool (T, I, R), as of `LabelledTrace`.
        blur: of a board that is seen as badly as can be.
        badly: how badly this one is seen, 0 to 1.
    """
    links = _mistaken(trace.links, trace.sizes, badly * blur.confused, rng)
    links = _missed(links, badly * blur.missed, rng)
    seen = _moved(trace.links) & _moved(links)
    seen &= rng.random(len(seen)) >= badly * blur.hidden
    kept = parents[:, np.concatenate([seen, np.ones(trace.responders.shape[1], bool)])]
    true, links = trace.links[:, seen], links[:, seen]
    moves = rng.random(len(links)) < PHANTOM_MOVES / len(links)
    if rng.random() < badly * blur.phantoms and moves[1:].any():
        kept = np.insert(kept, links.shape[1], False, axis=1)
        links = np.hstack([links, np.cumsum(moves)[:, None] % 2])
        true = np.hstack([true, np.zeros((len(true), 1), int)])
    told = np.array([numbered(column) for column in links.T], int).reshape(-1, len(links)).T
    shown = [as_they_appear(_shown(column, badly, blur, rng)) for column in trace.responders.T]
    sizes = tuple((told.max(0, initial=1) + 1).tolist())
    return Trace(told, np.stack(shown, axis=1), sizes), kept, way_round(true, told)


def way_round(true: np.ndarray, told: np.ndarray) -> np.ndarray:
    """Whether told states of links, int (T + 1, L), are numbered as they rise: int (L,), 1 if so, -1 if the other way
    round, 0 where that is open or the true state was always the same."""
    apart = [states - states.mean(axis=0) for states in (true, told)]
    return np.sign((apart[0] * apart[1]).sum(axis=0)).astype(int)


def _moved(links: np.ndarray) -> np.ndarray:
    """bool (L,), of states (T + 1, L)."""
    return np.asarray((links != links[0]).any(axis=0))


def as_they_appear(states: np.ndarray) -> np.ndarray:
    """A responder's states, int (T + 1,), numbered in the order in which they appear."""
    order = list(dict.fromkeys(states.tolist()))
    return np.array([order.index(state) for state in states.tolist()])


def _mistaken(true: np.ndarray, sizes: tuple[int, ...], share: float, rng: np.random.Generator) -> np.ndarray:
    """States of the links, int (T + 1, L), some of whose moves are taken for those of another one."""
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
    """States of the links, int (T + 1, L), some of whose moves are seen at their next one only."""
    links = true.copy()
    for column in links.T:
        moves = np.flatnonzero(np.diff(column)) + 1
        for start, end in pairwise([*moves, len(column)]):
            if rng.random() < share:
                column[start:end] = column[start - 1]
    return links


def _shown(true: np.ndarray, badly: float, blur: Blur, rng: np.random.Generator) -> np.ndarray:
    """States that a responder seems to be in, int (T + 1,) of as many true ones: always the same, or another one in
    single pictures, or what it was before something hid it."""
    if rng.random() < badly * blur.still:
        return np.full_like(true, true[0])
    flashes = rng.random(len(true)) < badly * blur.flashes
    states = np.where(flashes, rng.choice(np.unique(true), len(true)), true)
    for start in np.flatnonzero(rng.random(len(true) - 1) < badly * blur.covered) + 1:
        states[start : start + int(rng.integers(COVERED)) + 1] = states[start - 1]
    return states
