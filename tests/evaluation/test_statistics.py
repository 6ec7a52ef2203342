"""Bounds, intervals and tests against values computed by hand."""

import numpy as np
import pytest

from busybot.common.rng import generator
from busybot.evaluation.statistics import (
    FLIPS,
    binomial_interval,
    compare_boards,
    interval_over_boards,
    mcnemar_test,
    sign_flip_test,
    swap_test,
    two_level_interval,
    widest,
)


def rng(name: str = "test") -> np.random.Generator:
    return generator(0, "train", 0, name)


def test_nothing_and_everything_hit_have_bounds() -> None:
    """Of 10 trials without a hit the upper bound is 1 - .025^(1/10)."""
    assert binomial_interval(0, 10) == (0.0, pytest.approx(1 - 0.025 ** (1 / 10)))
    assert binomial_interval(10, 10) == (pytest.approx(0.025 ** (1 / 10)), 1.0)
    assert binomial_interval(0, 0) is None


def test_boards_that_are_all_right_are_so_many_trials() -> None:
    """However many actions each of them has; a board without any says nothing."""
    whole, chosen = np.array([4, 9, 1, 0]), rng().integers(4, size=(1000, 4))
    assert interval_over_boards(whole, whole, chosen) == binomial_interval(3, 3)
    assert interval_over_boards(0 * whole, whole, chosen) == binomial_interval(0, 3)
    assert interval_over_boards(0 * whole, 0 * whole, chosen) is None
    some, every = np.array([1, 2, 3, 1]), np.full(4, 4)
    found = interval_over_boards(some, every, chosen)
    assert found == tuple(np.quantile(some[chosen].sum(1) / 16, (0.025, 0.975)))
    assert interval_over_boards(some[1:2], every[:1], 0 * chosen[:, :1]) is None, "one board tells of no other"


def test_the_binomial_bounds_leave_out_what_they_promise() -> None:
    """At the lower bound 5 or more of 10 hits are as rare as 2.5 %: the binomial sum itself."""
    found = binomial_interval(5, 10)
    assert found is not None and found == (pytest.approx(0.18709, abs=1e-5), pytest.approx(0.81291, abs=1e-5))
    ways = np.array([252, 210, 120, 45, 10, 1])
    low = found[0]
    assert sum(ways * low ** np.arange(5, 11) * (1 - low) ** np.arange(5, -1, -1)) == pytest.approx(0.025)


def test_five_equal_differences_are_as_rare_as_two_in_32() -> None:
    assert sign_flip_test(np.full(5, 0.3), rng()) == 2 / 32
    assert sign_flip_test(np.array([0.5, -0.5]), rng()) == 1.0
    assert sign_flip_test(np.zeros(4), rng()) == 1.0
    assert sign_flip_test(np.zeros(0), rng()) is None


def test_a_partial_sum_counts_every_sign_that_reaches_it() -> None:
    """Of |+-1 +-1 +-2| the values 4, 2, 2, 0, 0, 2, 2, 4: what was seen is 2."""
    assert sign_flip_test(np.array([-1.0, 1.0, 2.0]), rng()) == 6 / 8


def test_drawn_signs_are_near_the_exact_ones_and_never_say_impossible() -> None:
    assert sign_flip_test(np.ones(40), rng()) == pytest.approx(1 / (1 + FLIPS))
    exact = 2 * sum(np.array([1, 14, 91])) / 2**14  # at most 2 of 14 signs are the others
    assert sign_flip_test(np.array([1.0] * 12 + [-1.0] * 2), rng()) == pytest.approx(exact, abs=0.005)


def test_swapped_boards_say_how_rare_a_difference_of_shares_is() -> None:
    """On five boards one method always has 1 of 2 and the other 2 of 2: only all boards swapped are as far apart."""
    half, whole = np.tile([1, 2], (5, 1)), np.tile([2, 2], (5, 1))
    assert swap_test(half, whole, rng()) == 2 / 32 == swap_test(whole, half, rng())
    assert swap_test(half, half, rng()) == 1.0
    assert swap_test(half[:0], half[:0], rng()) is None
    assert swap_test(np.zeros((5, 2)), whole, rng()) is None, "who claimed nothing has no precision"
    assert swap_test(np.tile(half, (8, 1)), np.tile(whole, (8, 1)), rng()) == pytest.approx(1 / (1 + FLIPS))


def test_a_share_is_of_all_boards_together() -> None:
    """Who claims all 10 pairs of one board and who claims the 2 true ones: swapped, 0.2 and 1 change places."""
    few, many = np.array([[2, 2], [1, 1]]), np.array([[2, 10], [1, 1]])
    assert swap_test(few, many, rng()) == 1.0, "one board that differs says nothing"
    told = compare_boards(counts(few), counts(many), rng())
    assert told == {"edge_p": {"boards": 2, "difference": pytest.approx(3 / 11 - 1), "p": 1.0}}
    told = compare_boards(counts(few), counts(many[1:]), rng())
    assert told["edge_p"]["boards"] == 1, "the first boards alone"
    assert compare_boards(counts(few), {"pred_a": counts(few)["edge_p"]}, rng()) == {}


def test_a_draw_without_a_whole_counts_against_a_difference() -> None:
    """Two boards on each of which one method claimed nothing: swapped alone, nothing is left of one of them."""
    first, other = np.array([[0, 0], [2, 4]]), np.array([[3, 3], [0, 0]])
    assert swap_test(first, other, rng()) == 1.0


def test_draws_are_in_the_order_of_the_names() -> None:
    """Whatever order a process's sets have."""
    first, other = np.random.default_rng(0).integers(1, 9, (2, 40, 2)).cumsum(2)
    one, two = ({name: counts(each)["edge_p"] for name in "fedcba"} for each in (first, other))
    draws = rng()
    expected = [swap_test(first, other, draws) for _ in one]
    assert len(set(expected)) > 1 and [each["p"] for each in compare_boards(one, two, rng()).values()] == expected
    assert list(compare_boards(one, two, rng())) == list("abcdef")


def counts(table: np.ndarray) -> dict[str, dict[str, list[int]]]:
    return {"edge_p": {"part": table[:, 0].tolist(), "whole": table[:, 1].tolist()}}


def test_mcnemar_counts_boards_on_which_one_method_alone_succeeds() -> None:
    """1 and 8 of 9: twice the probability of at most 1 of 9."""
    first, second = np.array([True] * 8 + [False] + [True] * 20), np.array([False] * 8 + [True] + [True] * 20)
    assert mcnemar_test(first, second) == pytest.approx(2 * 10 / 2**9)
    assert mcnemar_test(first, first) == 1.0 and mcnemar_test(first[:0], second[:0]) is None
    assert mcnemar_test(np.array([True, False]), np.array([False, True])) == 1.0


def test_an_interval_over_objects_knows_that_boards_of_one_object_are_alike() -> None:
    """One object is always right and one never: of two drawn ones, one in four times both are the first."""
    part, whole = np.repeat([1, 0], 50), np.ones(100, int)
    groups, boards = ["a"] * 50 + ["b"] * 50, list(range(100))
    assert two_level_interval(part, whole, groups, boards, rng()) == (0.0, 1.0)
    over_boards = two_level_interval(part, whole, [""] * 100, boards, rng())
    assert over_boards is not None and 0.35 < over_boards[0] < 0.45 and 0.55 < over_boards[1] < 0.65


def test_what_stands_on_one_board_stays_together() -> None:
    """Two boards, one all right and one all wrong: the share is 0, 1/2 or 1 however many records they have."""
    part, whole = np.array([1] * 30 + [0] * 30), np.ones(60, int)
    assert two_level_interval(part, whole, ["a"] * 60, [0] * 30 + [1] * 30, rng()) == (0.0, 1.0)
    assert two_level_interval(part[:30], whole[:30], ["a"] * 30, [0] * 30, rng()) == (1.0, 1.0)


def test_what_is_undefined_has_no_interval() -> None:
    nothing = np.zeros(0, int)
    assert two_level_interval(nothing, nothing, [], [], rng()) is None
    assert two_level_interval(np.zeros(2), np.zeros(2), ["a", "b"], [0, 1], rng()) is None


def test_the_widest_of_several_seeds_intervals() -> None:
    assert widest([(0.5, 0.7), [0.4, 0.6]]) == (0.4, 0.7)
    assert widest([(0.5, 0.7), None]) is None and widest([]) is None
