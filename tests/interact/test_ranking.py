"""Ranking figures against values worked out by hand."""

import numpy as np
import pytest

from busybot.boards.directions import OPPOSITE
from busybot.interact.metrics import area_under_curve, average_precision, direction_figures, precision_at_count

SCORES, WORKS = np.array([0.9, 0.8, 0.7, 0.1]), np.array([True, False, True, False])


def test_figures_of_four_scores() -> None:
    assert average_precision(SCORES, WORKS) == pytest.approx((1 + 2 / 3) / 2)
    assert area_under_curve(SCORES, WORKS) == pytest.approx(3 / 4)
    assert precision_at_count(SCORES, WORKS) == pytest.approx(1 / 2)


def test_ties_count_half() -> None:
    assert area_under_curve(np.zeros(4), WORKS) == pytest.approx(0.5)


def test_nothing_to_rank_is_none() -> None:
    nothing = np.zeros(4, bool)
    assert (average_precision(SCORES, nothing), area_under_curve(SCORES, nothing)) == (None, None)


def test_a_pair_works_when_its_opposite_does() -> None:
    logits = np.full((1, 18), -5.0)
    labels, known = np.zeros((1, 18), bool), np.ones((1, 18), bool)
    labels[0, 3] = True
    logits[0, OPPOSITE[3]] = 5.0
    figures = direction_figures(logits, labels, known)
    assert figures["pair_auc"] == 1.0
    assert figures["direction_auc"] is not None and figures["direction_auc"] < 1.0
