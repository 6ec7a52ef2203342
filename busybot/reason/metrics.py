"""How good an inferred graph is (protocol "Reasoning"): edges, their probabilities, and what could be known at all.

Pairs are trigger-responder pairs of objects on one board; links are collapsed. All values are shares from 0 to 1. What
is not defined is None: nothing claimed has no precision, no relations have no recall.

*Micro* pools the pairs of all boards, *macro* averages over the boards where the value is defined.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

BINS = 15
UNCERTAIN = (0.05, 0.95)
"""Pairs with a probability between these are the ones about which a reasoner is not sure."""
DRAWS, LEVEL = 1000, 0.95

Interval = tuple[float, float] | None


@dataclass(frozen=True)
class EdgeCounts:
    """One board: claimed edges that are true, claimed edges, true edges, pairs judged rightly, pairs."""

    hits: int
    claimed: int
    true: int
    correct: int
    pairs: int


@dataclass(frozen=True)
class EdgeScores:
    """Precision (Edge-P), recall (Edge-R) and the share of right entries (Edge-Acc)."""

    precision: float | None
    recall: float | None
    accuracy: float | None


@dataclass(frozen=True)
class EdgeIntervals:
    """Intervals of the same three."""

    precision: Interval
    recall: Interval
    accuracy: Interval


@dataclass(frozen=True)
class Calibration:
    """How far probabilities can be believed.

    Attributes:
        ece: expected calibration error over bins of equal mass.
        ece_uncertain: the same over pairs with .05 < p < .95.
        brier: mean squared difference of probability and truth.
        pairs, pairs_uncertain: how many pairs that is.
    """

    ece: float | None
    ece_uncertain: float | None
    brier: float | None
    pairs: int
    pairs_uncertain: int


def count_edges(claimed: np.ndarray, true: np.ndarray, candidates: np.ndarray) -> EdgeCounts:
    """Compare two graphs, bool (N, N), on the candidate pairs, bool (N, N)."""
    claimed, true = claimed[candidates].astype(bool), true[candidates].astype(bool)
    return EdgeCounts(
        hits=int((claimed & true).sum()),
        claimed=int(claimed.sum()),
        true=int(true.sum()),
        correct=int((claimed == true).sum()),
        pairs=len(true),
    )


def micro(counts: Sequence[EdgeCounts]) -> EdgeScores:
    """All boards pooled."""
    hits, claimed, true, correct, pairs = _table(counts).sum(0)
    return EdgeScores(_share(hits, claimed), _share(hits, true), _share(correct, pairs))


def macro(counts: Sequence[EdgeCounts]) -> EdgeScores:
    """Mean over the boards on which the value is defined."""
    scores = [micro([one]) for one in counts]
    return EdgeScores(
        _mean([score.precision for score in scores]),
        _mean([score.recall for score in scores]),
        _mean([score.accuracy for score in scores]),
    )


def intervals(
    counts: Sequence[EdgeCounts], rng: np.random.Generator, draws: int = DRAWS, level: float = LEVEL
) -> EdgeIntervals:
    """Bootstrap over boards: percentile intervals of the micro scores; None if a resample leaves a score undefined."""
    if not counts:
        return EdgeIntervals(None, None, None)
    chosen = rng.integers(len(counts), size=(draws, len(counts)))
    hits, claimed, true, correct, pairs = _table(counts)[chosen].sum(1).T
    ends = [(1 - level) / 2, (1 + level) / 2]

    def interval(part: np.ndarray, whole: np.ndarray) -> Interval:
        if not whole.all():
            return None
        low, high = np.quantile(part / whole, ends)
        return float(low), float(high)

    return EdgeIntervals(interval(hits, claimed), interval(hits, true), interval(correct, pairs))


def calibration(probabilities: np.ndarray, true: np.ndarray, bins: int = BINS) -> Calibration:
    """Calibration over pairs: probabilities in 0..1 and truth, both of shape (pairs,)."""
    probabilities, true = np.asarray(probabilities, float), np.asarray(true, float)
    unsure = (probabilities > UNCERTAIN[0]) & (probabilities < UNCERTAIN[1])
    return Calibration(
        ece=calibration_error(probabilities, true, bins),
        ece_uncertain=calibration_error(probabilities[unsure], true[unsure], bins),
        brier=float(((probabilities - true) ** 2).mean()) if len(true) else None,
        pairs=len(true),
        pairs_uncertain=int(unsure.sum()),
    )


def calibration_error(probabilities: np.ndarray, true: np.ndarray, bins: int = BINS) -> float | None:
    """Expected calibration error over bins of equal mass, None without pairs.

    Equal probabilities share a bin, so the value does not depend on the order of the pairs; bins then differ in mass,
    which the average respects.
    """
    if not len(true):
        return None
    _, group, size = np.unique(probabilities, return_inverse=True, return_counts=True)
    middle = (np.cumsum(size) - size / 2) / len(true)
    place = np.minimum((middle * bins).astype(int), bins - 1)[group]
    gaps = np.bincount(place, probabilities - true, minlength=bins)
    return float(np.abs(gaps).sum() / len(true))


def shown_share(edges: Sequence[np.ndarray], shown: Sequence[np.ndarray | None], steps: int) -> float | None:
    """edge_r_bound: share of relations whose effect was visible in the first `steps` steps.

    Args:
        edges: bool (N, N) per board.
        shown: int (N, N) per board as in `truth.GraphTruth`; None if a recording does not know.
    """
    known = [when for when in shown if when is not None]
    if len(known) < len(shown):
        return None
    seen = sum(int((edge & (when > 0) & (when <= steps)).sum()) for edge, when in zip(edges, known, strict=True))
    return _share(seen, sum(int(edge.sum()) for edge in edges))


def _table(counts: Sequence[EdgeCounts]) -> np.ndarray:
    """int (boards, 5)."""
    return np.array([[c.hits, c.claimed, c.true, c.correct, c.pairs] for c in counts], int).reshape(-1, 5)


def _share(part: int, whole: int) -> float | None:
    return float(part / whole) if whole else None


def _mean(values: Sequence[float | None]) -> float | None:
    defined = [value for value in values if value is not None]
    return float(np.mean(defined)) if defined else None
