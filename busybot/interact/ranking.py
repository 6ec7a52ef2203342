"""How well scores order what works before what does not: numpy only."""

import numpy as np

from busybot.boards.directions import OPPOSITE


def average_precision(scores: np.ndarray, works: np.ndarray) -> float | None:
    """Mean precision at the ranks of what works, in the order of falling scores; None if nothing works."""
    if not works.any():
        return None
    ordered = works[np.argsort(-scores, kind="stable")].astype(float)
    precision = np.cumsum(ordered) / np.arange(1, len(ordered) + 1)
    return float((precision * ordered).sum() / ordered.sum())


def area_under_curve(scores: np.ndarray, works: np.ndarray) -> float | None:
    """Probability that something that works has a higher score than something that does not; ties count half."""
    positives, negatives = int(works.sum()), int((~works).sum())
    if not positives or not negatives:
        return None
    _, inverse, counts = np.unique(scores, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(counts) - (counts - 1) / 2)[inverse]
    return float((ranks[works].sum() - positives * (positives + 1) / 2) / (positives * negatives))


def precision_at_count(scores: np.ndarray, works: np.ndarray) -> float | None:
    """Precision of the n highest scores where n things work: equals the recall there."""
    count = int(works.sum())
    if not count:
        return None
    return float(works[np.argsort(-scores, kind="stable")[:count]].mean())


def position_figures(scores: np.ndarray, works: np.ndarray) -> dict[str, float | None]:
    """Figures of a position score, float (N,), against whether acting there works, bool (N,)."""
    return {
        "position_ap": average_precision(scores, works),
        "position_auc": area_under_curve(scores, works),
        "position_precision": precision_at_count(scores, works),
    }


def direction_figures(logits: np.ndarray, labels: np.ndarray, known: np.ndarray) -> dict[str, float | None]:
    """Figures of direction logits, float (N, 18), where it is known (bool) which directions work (bool).

    A pair (a direction and its opposite) works when one of the two does: `pair_auc` judges 1 - (1 - p)(1 - p').
    """
    failing = 1 / (1 + np.exp(np.clip(logits, -30, 30)))  # 1 - p
    first = np.flatnonzero(np.arange(len(OPPOSITE)) < OPPOSITE)
    second = OPPOSITE[first]
    pairs = 1 - failing[:, first] * failing[:, second]
    pair_known = known[:, first] | known[:, second]
    pair_works = labels[:, first] | labels[:, second]
    return {
        "direction_auc": area_under_curve(logits[known], labels[known]),
        "pair_auc": area_under_curve(pairs[pair_known], pair_works[pair_known]),
    }
