"""Metrics of inferred graphs and predictions (protocol "Reasoning"), and bounds on what could be known.

Pairs are trigger-responder pairs of objects on one board; links are collapsed. All values are shares from 0 to 1. What
is not defined is None: nothing claimed has no precision, no relations have no recall.

A step is predicted rightly (Pred-A) when all responders of the board are.

*Micro* pools the pairs or steps of all boards, *macro* averages over the boards where the value is defined.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np

from busybot.evaluation.bootstrap import LEVEL, Interval, share_interval

BINS = 15
UNCERTAIN = (0.05, 0.95)
"""Pairs with a probability between these are the ones about which a reasoner is not sure."""
DRAWS = 1000

EDGE_COLUMNS, PREDICTION_COLUMNS = 5, 8
"""Numbers counted per board."""


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


@dataclass(frozen=True)
class PredictionCounts:
    """One board's predicted steps and responders, and how many of them are right.

    Attributes:
        steps, right: all steps; right means that all responders are.
        successful, right_successful: steps whose action changed a trigger's state.
        responders, right_responders: responders in all steps.
        changed, right_changed: of these, the ones that changed in the step.
    """

    steps: int
    right: int
    successful: int
    right_successful: int
    responders: int
    right_responders: int
    changed: int
    right_changed: int


@dataclass(frozen=True)
class PredictionScores:
    """Share of steps predicted rightly (Pred-A), of all and of successful ones; of responders, by what they did."""

    steps: float | None
    successful: float | None
    responders: float | None
    changed: float | None
    unchanged: float | None


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
    hits, claimed, true, correct, pairs = _table(counts, EDGE_COLUMNS).sum(0)
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
    hits, claimed, true, correct, pairs = _resampled(_table(counts, EDGE_COLUMNS), rng, draws)
    return EdgeIntervals(
        share_interval(hits, claimed, level), share_interval(hits, true, level), share_interval(correct, pairs, level)
    )


def count_predictions(
    right: np.ndarray, changed: np.ndarray, responders: np.ndarray, successful: np.ndarray
) -> PredictionCounts:
    """Compare predictions with what happened in S steps on a board of N objects.

    Args:
        right: bool (S, N), whether the predicted state is the true one.
        changed: bool (S, N), whether the true state changed in the step.
        responders: bool (N,), which objects are judged.
        successful: bool (S,), whether the step's action changed a trigger's state.
    """
    right, changed = right[:, responders], changed[:, responders]
    whole = np.asarray(right.all(axis=1))
    return PredictionCounts(
        steps=len(whole),
        right=int(whole.sum()),
        successful=int(successful.sum()),
        right_successful=int((whole & successful).sum()),
        responders=right.size,
        right_responders=int(right.sum()),
        changed=int(changed.sum()),
        right_changed=int((right & changed).sum()),
    )


def prediction_scores(counts: Sequence[PredictionCounts]) -> PredictionScores:
    """All boards pooled."""
    return PredictionScores(
        *(_share(part, whole) for part, whole in _prediction_ratios(_table(counts, PREDICTION_COLUMNS).sum(0)))
    )


def macro_predictions(counts: Sequence[PredictionCounts]) -> float | None:
    """Mean over boards of the share of steps predicted rightly."""
    return _mean([_share(one.right, one.steps) for one in counts])


def prediction_intervals(
    counts: Sequence[PredictionCounts], rng: np.random.Generator, draws: int = DRAWS, level: float = LEVEL
) -> dict[str, Interval]:
    """Bootstrap over boards: intervals of the scores by their names; None as for `intervals`."""
    names = list(PredictionScores.__dataclass_fields__)
    if not counts:
        return dict.fromkeys(names)
    ratios = _prediction_ratios(_resampled(_table(counts, PREDICTION_COLUMNS), rng, draws))
    return {name: share_interval(part, whole, level) for name, (part, whole) in zip(names, ratios, strict=True)}


def _prediction_ratios(sums: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Part and whole of each of `PredictionScores`, from sums (8, ...)."""
    steps, right, successful, right_successful, responders, right_responders, changed, right_changed = sums
    return [
        (right, steps),
        (right_successful, successful),
        (right_responders, responders),
        (right_changed, changed),
        (right_responders - right_changed, responders - changed),
    ]


def _resampled(table: np.ndarray, rng: np.random.Generator, draws: int) -> np.ndarray:
    """Sums (columns, draws) over boards drawn with replacement from a table (boards, columns)."""
    chosen = rng.integers(len(table), size=(draws, len(table)))
    return np.asarray(table[chosen].sum(1).T)


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
        shown: int (N, N) per board as in `ground_truth.GraphTruth`; None if a recording does not know.
    """
    known = [when for when in shown if when is not None]
    if len(known) < len(shown):
        return None
    seen = sum(int((edge & (when > 0) & (when <= steps)).sum()) for edge, when in zip(edges, known, strict=True))
    return _share(seen, sum(int(edge.sum()) for edge in edges))


def _table(counts: Sequence[EdgeCounts] | Sequence[PredictionCounts], columns: int) -> np.ndarray:
    """int (boards, columns)."""
    return np.array([astuple(one) for one in counts], int).reshape(-1, columns)


def _share(part: int | np.ndarray, whole: int | np.ndarray) -> float | None:
    return float(part / whole) if whole else None


def _mean(values: Sequence[float | None]) -> float | None:
    defined = [value for value in values if value is not None]
    return float(np.mean(defined)) if defined else None
