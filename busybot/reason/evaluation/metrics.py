"""Metrics of inferred graphs and predictions (docs/reference/measures.md), and bounds on what could be known.

Pairs are trigger-responder pairs of objects on one board; links are collapsed. All values are shares from 0 to 1. What
is not defined is None: nothing claimed has no precision, no relations have no recall.

A step is predicted rightly (Pred-A) when all responders of the board are.

*Micro* pools the pairs or steps of all boards, *macro* averages over the boards where the value is defined. Both take
the counts of each board and a table of shares: which count is divided by which.
"""

from collections.abc import Mapping, Sequence
from itertools import chain

import numpy as np

from busybot.evaluation.statistics import DRAWS, Interval, interval_over_boards

BINS = 15
UNCERTAIN = (0.05, 0.95)
"""Pairs with a probability between these are the ones about which a reasoner is not sure."""

Counts = Mapping[str, int]
"""Of one board."""
Shares = dict[str, tuple[str, str]]
"""The names of the counts of a part and of its whole, by the name of their share."""

EDGES: Shares = {"precision": ("hits", "claimed"), "recall": ("hits", "true"), "accuracy": ("correct", "pairs")}
"""Edge-P, Edge-R and Edge-Acc, the share of right entries."""
PREDICTIONS: Shares = {
    "pred_a": ("right", "steps"),
    "pred_a_successful": ("right_successful", "successful"),
    "pred_a_responder": ("right_responders", "responders"),
    "pred_a_changed": ("right_changed", "changed"),
    "pred_a_unchanged": ("right_unchanged", "unchanged"),
}
"""Of steps predicted rightly, all and successful ones; of responders, all and by what they did."""


def count_edges(claimed: np.ndarray, true: np.ndarray, candidates: np.ndarray) -> Counts:
    """Compare two graphs, bool (N, N), on the candidate pairs, bool (N, N).

    Returns:
        claimed edges that are true, claimed edges, true edges, pairs judged rightly, pairs: names as in `EDGES`.
    """
    claimed, true = claimed[candidates].astype(bool), true[candidates].astype(bool)
    return {
        "hits": int((claimed & true).sum()),
        "claimed": int(claimed.sum()),
        "true": int(true.sum()),
        "correct": int((claimed == true).sum()),
        "pairs": len(true),
    }


def count_predictions(right: np.ndarray, changed: np.ndarray, responders: np.ndarray, successful: np.ndarray) -> Counts:
    """Compare predictions with what happened in S steps on a board of N objects; names as in `PREDICTIONS`.

    Args:
        right: bool (S, N), whether the predicted state is the true one.
        changed: bool (S, N), whether the true state changed in the step.
        responders: bool (N,), which objects are judged.
        successful: bool (S,), whether the step's action changed a trigger's state.
    """
    right, changed = right[:, responders], changed[:, responders]
    whole = np.asarray(right.all(axis=1))
    return {
        "steps": len(whole),
        "right": int(whole.sum()),
        "successful": int(successful.sum()),
        "right_successful": int((whole & successful).sum()),
        "responders": right.size,
        "right_responders": int(right.sum()),
        "changed": int(changed.sum()),
        "right_changed": int((right & changed).sum()),
        "unchanged": int((~changed).sum()),
        "right_unchanged": int((right & ~changed).sum()),
    }


def totals(counts: Sequence[Counts], of: Shares) -> dict[str, int]:
    """Sums over all boards of the counts that the shares are made of."""
    return {name: sum(one[name] for one in counts) for name in dict.fromkeys(chain(*of.values()))}


def micro(counts: Sequence[Counts], of: Shares) -> dict[str, float | None]:
    """All boards pooled."""
    sums = totals(counts, of)
    return {name: _share(sums[part], sums[whole]) for name, (part, whole) in of.items()}


def macro(counts: Sequence[Counts], of: Shares) -> dict[str, float | None]:
    """Mean over the boards on which the value is defined."""
    scores = [micro([one], of) for one in counts]
    return {name: mean([one[name] for one in scores]) for name in of}


def mean(values: Sequence[float | None] | np.ndarray) -> float | None:
    """Of those that are defined; None without any."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def intervals(counts: Sequence[Counts], of: Shares, rng: np.random.Generator) -> dict[str, Interval]:
    """Of the micro scores, over boards (`interval_over_boards`); None if a resample leaves a score undefined."""
    if not counts:
        return dict.fromkeys(of)
    chosen = rng.integers(len(counts), size=(DRAWS, len(counts)))
    each = {name: np.array([one[name] for one in counts]) for name in totals(counts, of)}
    return {name: interval_over_boards(each[part], each[whole], chosen) for name, (part, whole) in of.items()}


def calibration(probabilities: np.ndarray, true: np.ndarray) -> dict[str, float | None]:
    """How far probabilities can be believed: those of pairs, 0 to 1, against the truth, both of shape (pairs,).

    Returns:
        `ece`, the expected calibration error over bins of equal mass; `ece_uncertain`, the same over pairs with
        .05 < p < .95; `brier`, the mean squared difference of probability and truth; `pairs` and `pairs_uncertain`, how
        many pairs that is.
    """
    probabilities, true = np.asarray(probabilities, float), np.asarray(true, float)
    unsure = are_uncertain(probabilities)
    return {
        "ece": calibration_error(probabilities, true),
        "ece_uncertain": calibration_error(probabilities[unsure], true[unsure]),
        "brier": float(((probabilities - true) ** 2).mean()) if len(true) else None,
        "pairs": len(true),
        "pairs_uncertain": int(unsure.sum()),
    }


def calibration_error(probabilities: np.ndarray, true: np.ndarray, bins: int = BINS) -> float | None:
    """Expected calibration error over bins of equal mass, None without pairs.

    Equal probabilities share a bin, so the value does not depend on the order of the pairs; bins then differ in mass,
    which the average respects.
    """
    if not len(true):
        return None
    gaps = np.bincount(_bin_of(probabilities, bins), probabilities - true, minlength=bins)
    return float(np.abs(gaps).sum() / len(true))


def calibration_error_by_chance(
    probabilities: np.ndarray, rng: np.random.Generator, bins: int = BINS, draws: int = 200
) -> float | None:
    """What `calibration_error` is on average where every probability is right, each pair by itself: with few pairs in
    a bin it is far from 0. None without pairs."""
    if not len(probabilities):
        return None
    place, drawn = _bin_of(probabilities, bins), (rng.random(len(probabilities)) < probabilities for _ in range(draws))
    gaps = [np.abs(np.bincount(place, probabilities - true, minlength=bins)).sum() for true in drawn]
    return float(np.mean(gaps) / len(probabilities))


def are_uncertain(probabilities: np.ndarray) -> np.ndarray:
    """Of which pairs a reasoner is not sure, bool."""
    return np.asarray((probabilities > UNCERTAIN[0]) & (probabilities < UNCERTAIN[1]))


def _bin_of(probabilities: np.ndarray, bins: int) -> np.ndarray:
    """The bin of each pair."""
    _, group, size = np.unique(probabilities, return_inverse=True, return_counts=True)
    middle = (np.cumsum(size) - size / 2) / len(probabilities)
    return np.asarray(np.minimum((middle * bins).astype(int), bins - 1)[group])


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


def _share(part: int, whole: int) -> float | None:
    return part / whole if whole else None
