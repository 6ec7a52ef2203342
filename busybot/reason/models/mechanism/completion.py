"""What follows in a situation that was never met, told by what a parent is.

An explanation says which inputs decide a responder. Each of them matters then: in some situation it alone changes what
follows. Of all functions that agree with what was met only those are left in which every input matters, often one; of
several, those are likelier in which each input works one way.
"""

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from busybot.reason.models.mechanism.contexts import LONGEST

BOTH_WAYS = 0.25
"""A function in which an input works one way here and the other way there, as in an exclusive or, is so much less
likely than one in which each works one way."""
MOST = 1024
"""So many functions are compared at most; with more, nothing is told."""


def completed(
    known: Mapping[tuple[int, ...], int], sizes: Sequence[int], states: int, rising: Sequence[float] = ()
) -> dict[tuple[int, ...], np.ndarray]:
    """What may follow each situation that was not met: the share of functions in which each state does.

    Args:
        known: what followed each situation that was met, states of the inputs; one with a state that an input is not
            known to have tells nothing.
        sizes: number of states of each input.
        states: so many may follow.
        rising: log odds that the inputs' states are numbered as they rise; nobody knows by default. Functions in which
            all inputs work the same way are likelier.

    Returns:
        float (states,) by situation; nothing if all were met, or no function is left, or too many are.
    """
    situations = list(product(*map(range, sizes)))
    unmet = [one for one in situations if one not in known]
    if not unmet or states ** len(unmet) > MOST:
        return {}
    ways = np.array(list(product(range(states), repeat=len(unmet))), int)  # (functions, unmet)
    tables = np.zeros((*sizes, len(ways)), int)
    for situation in set(situations) & known.keys():
        tables[situation] = known[situation]
    for column, situation in zip(ways.T, unmet, strict=True):
        tables[situation] = column
    matter = [(tables.max(one) != tables.min(one)).reshape(-1, len(ways)).any(0) for one in range(len(sizes))]
    left = ways[np.all(matter, axis=0)]
    if not len(left):
        return {}
    weights = _likelihoods(tables[..., np.all(matter, axis=0)], rising or np.zeros(len(sizes)))
    shares = np.einsum("f,fus->us", weights, np.eye(states)[left]) / weights.sum()
    return dict(zip(unmet, shares, strict=True))


def lasting(known: Mapping[tuple[int, ...], int], states: int) -> dict[tuple[int, ...], np.ndarray]:
    """As `completed`, of situations that tell since how many actions something is so, up to `LONGEST`: one state
    follows for some actions, another one later."""
    ways = [
        [first] * actions + [then] * (LONGEST + 1 - actions)
        for actions in range(1, LONGEST + 1)
        for first in range(states)
        for then in range(states)
        if first != then
    ]
    left = np.array([way for way in ways if all(way[one] == state for (one,), state in known.items())])
    unmet = [one for one in range(LONGEST + 1) if (one,) not in known]
    return {(one,): np.bincount(left[:, one], minlength=states) / len(left) for one in unmet} if len(left) else {}


def _likelihoods(tables: np.ndarray, rising: Sequence[float] | np.ndarray) -> np.ndarray:
    """Of functions, the last axis, float (functions,). Where each input works one way, how probable it is, times how
    many ways there are, that all raise what follows when they rise, or all lower it."""
    ways, fits = np.zeros((tables.ndim - 1, tables.shape[-1])), np.ones(tables.shape[-1], bool)
    for axis in range(tables.ndim - 1):
        steps = np.diff(tables, axis=axis).reshape(-1, tables.shape[-1])
        ups, downs = (steps > 0).any(0), (steps < 0).any(0)
        fits &= ~(ups & downs)
        ways[axis] = 1.0 * ups - 1.0 * downs
    spins = np.tanh(np.asarray(rising) / 2)[:, None] * ways
    alike = ((1 + spins).prod(0) + (1 - spins).prod(0)) / 2
    return np.where(fits, alike, BOTH_WAYS)
