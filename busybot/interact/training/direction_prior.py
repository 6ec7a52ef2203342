"""Learns from experience which direction pairs to try after one failed.

The direction network has an opinion on every pair of directions by itself. That some of them are right or wrong
together (what is not pressed is pulled sideways) it cannot say. Recorded training does: where pair i failed and another
one was rewarded afterwards, it was pair j in a share T_ij of the cases, and in a share b_j of all cases. By Bayes' rule
the odds of pair j change by the ratio of the odds of T_ij and of b_j.
"""

import numpy as np

from busybot.interact.policy.direction_pairs import PAIR_OF, PAIRS, logit

HALF = 0.5
"""Added to every count of the base rates."""
SHRINK = 10.0
"""As so many cases with the base rates count in every T_i."""
DIGITS = 3


def pair_outcomes(executed: np.ndarray, worked: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which pairs failed and which one worked, both bool (n, 9), in the n rewarded of N recorded actions.

    Args:
        executed: bool (N, 18), directions that were tried.
        worked: int (N,), the direction that was rewarded, -1 for none.
    """
    rewarded = worked >= 0
    right = PAIR_OF[worked[rewarded]][:, None] == np.arange(len(PAIRS))
    tried = np.zeros(right.shape, bool)
    for direction, pair in enumerate(PAIR_OF):
        tried[:, pair] |= executed[rewarded, direction]
    return tried & ~right, right


def after_failure(executed: np.ndarray, worked: np.ndarray) -> tuple[tuple[float, ...], ...]:
    """Logits (9, 9) that pair j gains where pair i failed; arguments as of `pair_outcomes`."""
    failed, right = pair_outcomes(executed, worked)
    base = right.sum(0) + HALF
    base = base / base.sum()  # (9,)
    counts = failed.T.astype(int) @ right.astype(int)  # (9, 9)
    shares = (counts + SHRINK * base) / (counts.sum(1, keepdims=True) + SHRINK)
    gained = np.round(logit(shares) - logit(base), DIGITS)
    return tuple(tuple(float(value) for value in row) for row in gained)
