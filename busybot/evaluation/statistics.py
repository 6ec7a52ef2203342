"""Intervals and tests that the metrics of several skills share: what chance alone may have made of a figure.

The same objects stand on many boards, and many boards have mechanisms of one kind. An interval over boards therefore
says what other boards *with these objects* would give. `two_level_interval` also draws the objects anew (Davison and
Hinkley, Bootstrap Methods and their Application, 1997, section 3.8), and so says more about others. Of shares of 0 and
1 a bootstrap says nothing; they have exact bounds.

Imports neither torch nor sapien, and of SciPy nothing that is slow to load.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
from scipy.special import betainc, betaincinv

LEVEL, DRAWS = 0.95, 1000
"""Of intervals: how much lies within; how often `two_level_interval` draws anew."""
ALL_SIGNS = 12
"""With up to so many differences that are not 0 all signs are gone through; with more, `FLIPS` are drawn."""
FLIPS = 10_000
EQUAL = 1e-12
"""Sums of differences that lie nearer than this are equal."""
LEAST_PAIRS = 500
"""With fewer pairs that somebody doubts nothing is said about how far beliefs can be trusted."""
Interval = tuple[float, float] | None
"""Least and greatest value; None where it is undefined."""


def percentile_interval(drawn: np.ndarray) -> tuple[float, float]:
    """What the middle `LEVEL` of the values of all draws lie between."""
    low, high = np.quantile(drawn, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)


def share_interval(part: np.ndarray, whole: np.ndarray) -> Interval:
    """Of the share part / whole, both (draws,); None if a draw has no whole."""
    return percentile_interval(part / whole) if whole.all() else None


def interval_over_boards(part: np.ndarray, whole: np.ndarray, chosen: np.ndarray) -> Interval:
    """Of the share that boards have together, if other boards like them had been drawn.

    Args:
        part, whole: (B,), of each board; the share is the sum of `part` divided by the sum of `whole`.
        chosen: int (draws, B), the boards of each draw.

    Returns:
        `extreme_interval` where there is one; None if a draw has no whole, or one board alone has, which says nothing
        of others.
    """
    if extreme := extreme_interval(part, whole):
        return extreme
    return share_interval(part[chosen].sum(1), whole[chosen].sum(1)) if np.count_nonzero(whole) > 1 else None


def widest(intervals: Iterable[Sequence[float] | None]) -> Interval:
    """From the least to the greatest end of several seeds' intervals; None if one of them has none."""
    found = list(intervals)
    known = [interval for interval in found if interval is not None]
    return (min(one[0] for one in known), max(one[1] for one in known)) if known and len(known) == len(found) else None


def extreme_interval(part: np.ndarray, whole: np.ndarray) -> Interval:
    """Exact bounds of a share of 0 or 1, of boards as `interval_over_boards` takes them; None of any other.

    Each board (or object) with a whole is one trial: what it has in its parts is not independent.
    """
    boards = int((whole > 0).sum())
    return binomial_interval(boards if part.any() else 0, boards) if part.sum() in (0, whole.sum()) else None


def two_level_interval(
    part: np.ndarray, whole: np.ndarray, groups: Sequence[str], boards: Sequence[int], rng: np.random.Generator
) -> Interval:
    """Of a pooled share, with groups drawn anew, and of each of these its boards.

    What a group (an object, a kind of mechanism) has on one board stays together. A group that is drawn twice has its
    boards drawn twice, each time by itself.

    Args:
        part, whole: (R,), of each record; the share is the sum of `part` divided by the sum of `whole`.
        groups: to which each record belongs.
        boards: number of the board of each.

    Returns:
        None without records, or if a draw has no whole.
    """
    if not len(part):
        return None
    names, group = np.unique(np.array(groups, str), return_inverse=True)
    cells = np.unique(np.stack([group, np.asarray(boards, int)]), axis=1, return_inverse=True)
    owner, cell = cells[0][0], cells[1].reshape(-1)
    sums = np.stack([np.bincount(cell, values) for values in (part, whole)], axis=1)  # (cells, 2)
    drawn = np.zeros((DRAWS, 2))
    times = rng.multinomial(len(names), np.full(len(names), 1 / len(names)), size=DRAWS)  # (draws, groups)
    for number in range(len(names)):
        own = sums[owner == number]
        weights = rng.multinomial(times[:, number] * len(own), np.full(len(own), 1 / len(own)))
        drawn += weights @ own
    return share_interval(drawn[:, 0], drawn[:, 1])


def interval_over_objects(
    part: np.ndarray, whole: np.ndarray, objects: Sequence[str], boards: Sequence[int], rng: np.random.Generator
) -> Interval:
    """`two_level_interval` with objects as groups; of shares of 0 and 1 exact bounds, each object being one trial."""
    if not len(part):
        return None
    own = np.unique(np.array(objects, str), return_inverse=True)[1]
    extreme = extreme_interval(np.bincount(own, part), np.bincount(own, whole))
    return extreme or two_level_interval(part, whole, objects, boards, rng)


def binomial_interval(hits: int, count: int) -> Interval:
    """Bounds on the probability of what happened `hits` times in `count` independent trials; None without any.

    Exact (Clopper and Pearson, Biometrika 26, 1934): it holds the true probability at least so often, also where
    everything or nothing was hit, of which a bootstrap says nothing.
    """
    if not count:
        return None
    tail = (1 - LEVEL) / 2
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
    # one draw after the other: all of many boards would not fit into memory
    sums = np.array([rng.choice((-1, 1), size=len(told)) @ told for _ in range(FLIPS)])
    return float((1 + (np.abs(sums) >= seen).sum()) / (1 + FLIPS))


def swap_test(first: np.ndarray, other: np.ndarray, rng: np.random.Generator) -> float | None:
    """How probable a difference of pooled shares at least as large is, either way, if two methods are equally good;
    None where one of them has no share.

    A permutation test as `sign_flip_test`, of shares that boards have together: were they equally good, what each of
    them did on a board might as well be the other's. A draw that leaves one without a whole counts against them.

    Args:
        first, other: int (B, 2), part and whole on the same boards.
    """
    first, other = np.asarray(first, float).reshape(-1, 2), np.asarray(other, float).reshape(-1, 2)
    both, more = first.sum(0) + other.sum(0), other - first
    seen = _apart(other.sum(0), both)
    if np.isnan(seen):
        return None
    more = more[(more != 0).any(1)]
    every = len(more) <= ALL_SIGNS
    if every:
        moved = np.array(list(product((0, 1), repeat=len(more))), float).reshape(2 ** len(more), -1) @ more
    else:  # as above
        moved = np.stack([rng.integers(2, size=len(more)) @ more for _ in range(FLIPS)])
    extreme = ~(np.abs(_apart(other.sum(0) - moved, both)) < abs(seen) - EQUAL)  # what is not defined, too
    return float(extreme.mean()) if every else float((1 + extreme.sum()) / (1 + FLIPS))


def _apart(own: np.ndarray, both: np.ndarray) -> np.ndarray:
    """Share of `own`, part and whole (..., 2), less the share of the rest of `both`; nan where there is no whole."""
    rest = both - own
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(own[..., 0] / own[..., 1] - rest[..., 0] / rest[..., 1])


Counted = Mapping[str, Mapping[str, Sequence[int]]]
"""Numerators and denominators of shares, `part` and `whole` on each board: `by_board` of an evaluation's result."""


def compare_boards(first: Counted, other: Counted, rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """The second method's shares less the first one's, on the same boards.

    Args:
        first, other: `by_board` of two results. If one has fewer boards, they are the first ones of the other's.

    Returns:
        Of each share that both have: `boards`, `difference` and `p` (`swap_test`); None where one is not defined.
    """
    told: dict[str, dict[str, Any]] = {}
    for name in sorted(first.keys() & other.keys()):  # draws come one after the other: sets have no order
        tables = [np.array([one[name]["part"], one[name]["whole"]]).T for one in (first, other)]
        boards = min(map(len, tables))
        one, two = (table[:boards] for table in tables)
        apart = float(_apart(two.sum(0), one.sum(0) + two.sum(0)))
        difference = None if np.isnan(apart) else apart
        told[name] = {"boards": boards, "difference": difference, "p": swap_test(one, two, rng)}
    return told


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
