"""Metrics of inferred graphs against values computed by hand."""

from typing import Any

import numpy as np
import pytest

from busybot.evaluation.statistics import binomial_interval
from busybot.reason.evaluation.metrics import (
    EDGES,
    calibration,
    calibration_error,
    calibration_error_by_chance,
    count_edges,
    intervals,
    macro,
    micro,
    shown_share,
    totals,
)

CANDIDATES = np.array([[0, 1, 1, 1], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]], bool)
"""Object 0 is a trigger, 1 to 3 are responders."""


def of(*values: int) -> dict[str, int]:
    """One board's claimed edges that are true, claimed edges, true edges, pairs judged rightly, pairs."""
    return dict(zip(("hits", "claimed", "true", "correct", "pairs"), values, strict=True))


def three(*values: Any) -> dict[str, Any]:
    """What is said of precision, recall and accuracy."""
    return dict(zip(("precision", "recall", "accuracy"), values, strict=True))


def graph(*pairs: tuple[int, int]) -> np.ndarray:
    edges = np.zeros((4, 4), bool)
    for pair in pairs:
        edges[pair] = True
    return edges


TRUE = graph((0, 1), (0, 2))


def test_counts_of_a_half_right_graph() -> None:
    assert count_edges(graph((0, 1), (0, 3)), TRUE, CANDIDATES) == of(1, 2, 2, 1, 3)


def test_pairs_that_are_no_candidates_do_not_count() -> None:
    assert count_edges(graph((0, 1), (1, 0), (2, 3)), TRUE, CANDIDATES) == of(1, 1, 2, 2, 3)


def test_the_perfect_graph() -> None:
    assert micro([count_edges(TRUE, TRUE, CANDIDATES)], EDGES) == three(1.0, 1.0, 1.0)


def test_the_empty_graph_has_no_precision() -> None:
    assert micro([count_edges(graph(), TRUE, CANDIDATES)], EDGES) == three(None, 0.0, pytest.approx(1 / 3))


def test_the_all_ones_graph_has_the_density_as_precision_and_accuracy() -> None:
    scores = micro([count_edges(CANDIDATES, TRUE, CANDIDATES)], EDGES)
    assert scores == three(pytest.approx(2 / 3), 1.0, pytest.approx(2 / 3))


def test_a_board_without_relations_has_no_recall() -> None:
    assert micro([count_edges(graph((0, 1)), graph(), CANDIDATES)], EDGES) == three(0.0, None, pytest.approx(2 / 3))
    assert micro([count_edges(graph(), graph(), CANDIDATES)], EDGES) == three(None, None, 1.0)


def test_no_boards_no_scores() -> None:
    assert micro([], EDGES) == macro([], EDGES) == three(None, None, None)
    assert totals([], EDGES) == of(0, 0, 0, 0, 0)


def test_micro_pools_pairs_and_macro_averages_boards() -> None:
    counts = [of(1, 1, 4, 7, 10), of(1, 3, 1, 8, 10)]
    assert micro(counts, EDGES) == three(pytest.approx(2 / 4), pytest.approx(2 / 5), pytest.approx(15 / 20))
    assert macro(counts, EDGES) == three(
        pytest.approx((1 + 1 / 3) / 2), pytest.approx((1 / 4 + 1) / 2), pytest.approx(0.75)
    )


def test_macro_leaves_out_boards_where_a_score_is_undefined() -> None:
    """A board on which nothing is claimed is not one of perfect precision."""
    assert macro([of(0, 0, 2, 4, 6), of(1, 2, 2, 4, 6)], EDGES)["precision"] == pytest.approx(0.5)
    assert macro([of(0, 0, 2, 4, 6)], EDGES)["precision"] is None


def test_intervals_hold_the_score_and_are_reproducible() -> None:
    counts = [of(1, 2, 2, 10, 16), of(3, 3, 3, 16, 16), of(2, 4, 3, 12, 16)] * 5
    first, second = (intervals(counts, EDGES, np.random.Generator(np.random.PCG64(1))) for _ in range(2))
    assert first == second
    for interval, score in zip(first.values(), (6 / 9, 6 / 8, 38 / 48), strict=True):
        assert interval is not None
        assert interval[0] < score < interval[1]


def test_equal_boards_leave_no_doubt() -> None:
    spread = intervals([of(1, 2, 4, 9, 12)] * 7, EDGES, np.random.Generator(np.random.PCG64(0)))
    assert spread == three((0.5, 0.5), (0.25, 0.25), (0.75, 0.75))


def test_intervals_of_undefined_scores_are_undefined() -> None:
    rng = np.random.Generator(np.random.PCG64(0))
    assert intervals([], EDGES, rng) == three(None, None, None)
    spread = intervals([of(0, 0, 2, 4, 6)] * 3, EDGES, rng)
    assert spread["precision"] is None and spread["recall"] == binomial_interval(0, 3)


def test_calibration_error_by_hand() -> None:
    """Two bins: .1 and .2 with truths 0, 1; .8 and .9 with truths 1, 1. Gaps |.3 - 1| / 4 and |1.7 - 2| / 4."""
    error = calibration_error(np.array([0.1, 0.9, 0.2, 0.8]), np.array([0, 1, 1, 1]), bins=2)
    assert error == pytest.approx(0.7 / 4 + 0.3 / 4)


def test_calibration_error_with_bins_of_one_pair_is_the_mean_distance() -> None:
    probabilities, true = np.linspace(0.01, 0.97, 15), np.arange(15) % 2
    assert calibration_error(probabilities, true) == pytest.approx(np.abs(probabilities - true).mean())


def test_equal_probabilities_share_a_bin_whatever_their_order() -> None:
    """A reasoner that says .25 of everything is calibrated if a quarter is true."""
    true = np.array([1] * 25 + [0] * 75)
    assert calibration_error(np.full(100, 0.25), true) == pytest.approx(0)
    assert calibration_error(np.full(100, 0.25), true[::-1]) == pytest.approx(0)
    assert calibration_error(np.full(100, 0.75), true) == pytest.approx(0.5)


def test_calibration_of_certainty() -> None:
    true = np.array([0, 1, 1, 0, 0])
    right, wrong = calibration(true.astype(float), true), calibration(1.0 - true, true)
    assert right == {"ece": 0, "ece_uncertain": None, "brier": 0, "pairs": 5, "pairs_uncertain": 0}
    assert (wrong["ece"], wrong["brier"]) == (1, 1)


def test_the_uncertain_pairs_are_judged_apart() -> None:
    result = calibration(np.array([0.05, 0.5, 0.5, 0.95]), np.array([0, 1, 1, 1]))
    assert result["pairs_uncertain"] == 2
    assert result["ece_uncertain"] == pytest.approx(0.5)
    assert result["brier"] == pytest.approx((0.05**2 + 0.5 + 0.05**2) / 4)


def test_chance_alone_keeps_right_probabilities_from_an_error_of_zero() -> None:
    """Of one bin the mean distance of a binomial share from its mean; bins of a tenth as many pairs are further off."""
    rng = np.random.default_rng(0)
    one = calibration_error_by_chance(np.full(500, 0.5), rng, draws=4000)
    assert one == pytest.approx((2 / np.pi) ** 0.5 * 0.5 / 500**0.5, rel=0.05)
    spread = np.linspace(0.05, 0.95, 5000)
    few = calibration_error_by_chance(spread[::10], rng)
    many = calibration_error_by_chance(spread, rng)
    assert few is not None and many is not None and few == pytest.approx(10**0.5 * many, rel=0.1)
    errors = [calibration_error(spread, rng.random(5000) < spread) for _ in range(50)]
    assert np.mean([error or 0 for error in errors]) == pytest.approx(many, rel=0.1)
    assert calibration_error_by_chance(np.zeros(0), rng) is None


def test_no_pairs_no_calibration() -> None:
    nothing = calibration(np.zeros(0), np.zeros(0))
    assert (nothing["ece"], nothing["ece_uncertain"], nothing["brier"], nothing["pairs"]) == (None, None, None, 0)


def test_the_bound_counts_relations_seen_in_time() -> None:
    shown = np.zeros((4, 4), int)
    shown[0, 1], shown[0, 2] = 3, 23
    assert [shown_share([TRUE], [shown], steps) for steps in (2, 3, 22, 23)] == [0.0, 0.5, 0.5, 1.0]


def test_the_bound_needs_truth_and_relations() -> None:
    assert shown_share([TRUE, TRUE], [np.ones((4, 4), int), None], 5) is None
    assert shown_share([graph()], [np.zeros((4, 4), int)], 5) is None
