"""Percentile intervals by the bootstrap, which the metrics of several skills share: boards or tasks are drawn anew.

The same objects stand on many boards, and many boards have mechanisms of one kind. An interval over boards therefore
says what other boards *with these objects* would give. `two_level_interval` also draws the objects anew (Davison and
Hinkley, Bootstrap Methods and their Application, 1997, section 3.8), and so says more about others.

Imports neither torch nor sapien.
"""

from collections.abc import Sequence

import numpy as np

LEVEL = 0.95
Interval = tuple[float, float] | None
"""Least and greatest value; None where it is undefined."""


def percentile_interval(drawn: np.ndarray, level: float = LEVEL) -> tuple[float, float]:
    """What the middle `level` of the values of all draws lie between."""
    low, high = np.quantile(drawn, [(1 - level) / 2, (1 + level) / 2])
    return float(low), float(high)


def share_interval(part: np.ndarray, whole: np.ndarray, level: float = LEVEL) -> Interval:
    """Of the share part / whole, both (draws,); None if a draw has no whole."""
    return percentile_interval(part / whole, level) if whole.all() else None


def two_level_interval(
    part: np.ndarray,
    whole: np.ndarray,
    groups: Sequence[str],
    boards: Sequence[int],
    rng: np.random.Generator,
    draws: int = 1000,
    level: float = LEVEL,
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
    drawn = np.zeros((draws, 2))
    times = rng.multinomial(len(names), np.full(len(names), 1 / len(names)), size=draws)  # (draws, groups)
    for number in range(len(names)):
        own = sums[owner == number]
        weights = rng.multinomial(times[:, number] * len(own), np.full(len(own), 1 / len(own)))
        drawn += weights @ own
    return share_interval(drawn[:, 0], drawn[:, 1], level)
