"""The paper's bonus, computed by hand."""

import numpy as np
import pytest

from busybot.interact.policy.paper import ucb_bonus


def test_the_formula() -> None:
    bonus = ucb_bonus((100, 120), [(50, 40), (52, 41), (110, 90)], c=0.5, window=10)
    assert bonus[40, 50] == pytest.approx(0.5 * np.sqrt(np.log(4) / 3))  # in two windows, and the step itself
    assert bonus[90, 110] == pytest.approx(0.5 * np.sqrt(np.log(4) / 2))
    assert bonus[0, 0] == pytest.approx(0.5 * np.sqrt(np.log(4)))
    assert not ucb_bonus((100, 120), [(50, 40)], c=0).any()


def test_the_authors_bonus_is_that_of_another_c() -> None:
    bonus = ucb_bonus((100, 120), [(50, 40)], c=0.5 * np.sqrt(2))
    assert bonus[40, 50] == pytest.approx(0.5 * np.sqrt(2 * np.log(2) / 2))


def test_the_window_is_ten_by_ten_and_ends_with_the_picture() -> None:
    bonus = ucb_bonus((100, 120), [(50, 40)])
    rows, columns = np.nonzero(bonus < bonus.max())
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (35, 44, 45, 54)
    assert len(rows) == 100
    corner = ucb_bonus((100, 120), [(0, 99)])
    assert (corner < corner.max()).sum() == 5 * 6


def test_nothing_is_known_before_the_first_step() -> None:
    assert not ucb_bonus((10, 10), []).any()
