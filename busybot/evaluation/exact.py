"""Statistics without approximations: bounds on a share, and whether two methods differ on the same boards.

Imports neither torch nor sapien, and of SciPy nothing that is slow to load.
"""

from itertools import product

import numpy as np
from scipy.special import betainc, betaincinv

from busybot.evaluation.bootstrap import LEVEL

ALL_SIGNS = 12
"""With up to so many differences that are not 0 all signs are gone through; with more, `FLIPS` are drawn."""
FLIPS = 10_000
EQUAL = 1e-12
"""Sums of differences that lie nearer than this are equal."""


def binomial_interval(hits: int, count: int, level: float = LEVEL) -> tuple[float, float] | None:
    """Bounds on the probability of what happened `hits` times in `count` independent trials; None without any.

    Exact (Clopper and Pearson, Biometrika 26, 1934): it holds the true probability at least so often, also where
    everything or nothing was hit, of which a bootstrap says nothing.
    """
    if not count:
        return None
    tail = (1 - level) / 2
    low = float(betaincinv(hits, count - hits + 1, tail)) if hits else 0.0
    high = float(betaincinv(hits + 1, count - hits, 1 - tail)) if hits < count else 1.0
    return low, high


def sign_flip_test(differences: np.ndarray, rng: np.random.Generator) -> float | None:
    """How probable a mean difference at least as large is, either way, if two methods are equally good; None without
    boards.

    A permutation test of paired values (Fisher, The Design of Experiments, 1935): were they equally good, each board's
    difference might as well have the other sign. Exact for up to `ALL_SIGNS` differences that are not 0. Otherwise
    signs are drawn, and what was seen counts as one more draw, so that the result is never 0 (Phipson and Smyth, 2010).

    Args:
        differences: (B,), of the two methods on each board.
    """
    if not len(differences):
        return None
    told = np.asarray(differences, float)
    told = told[told != 0]
    seen = abs(told.sum()) - EQUAL
    if len(told) <= ALL_SIGNS:
        signs = np.array(list(product((-1, 1), repeat=len(told)))).reshape(2 ** len(told), -1)
        return float((np.abs(signs @ told) >= seen).mean())
    signs = rng.choice((-1, 1), size=(FLIPS, len(told)))
    return float((1 + (np.abs(signs @ told) >= seen).sum()) / (1 + FLIPS))


def mcnemar_test(first: np.ndarray, second: np.ndarray) -> float | None:
    """How probable such different successes are, either way, if two methods are equally good; None without boards.

    McNemar's test in its exact form (Psychometrika 12, 1947): of the boards on which only one of them succeeded, each
    has half of them but for chance.

    Args:
        first, second: bool (B,), on which of the same boards each succeeded.
    """
    first, second = np.asarray(first, bool), np.asarray(second, bool)
    if not len(first):
        return None
    one, other = int((first & ~second).sum()), int((second & ~first).sum())
    total, fewer = one + other, min(one, other)
    return min(1.0, 2 * float(betainc(total - fewer, fewer + 1, 0.5))) if total else 1.0
