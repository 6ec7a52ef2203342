"""Percentile intervals by the bootstrap, which the metrics of several skills share: boards or tasks are drawn anew.

Imports neither torch nor sapien.
"""

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
