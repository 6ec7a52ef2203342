"""States of a link that most tries move, of pictures that do not all show it."""

import numpy as np
import pytest

from busybot.reason.inputs.link_tracking import lasts, tracked
from busybot.reason.inputs.trigger_links import numbered


@pytest.mark.parametrize("looks", [[0, 1, 0.1, 0.55, 0, 1], [0, 1, 0, 1, 0, 0.5], [0, 1, 0, 5, 0, 1]])
def test_a_move_that_pictures_hardly_show_is_told_by_the_others(looks: list[float]) -> None:
    """A link that every try moved; one picture is between both states, or another one altogether."""
    shown, alternating = np.array(looks)[:, None], np.arange(6) % 2
    assert tracked(shown, alternating, 1.0)[1].tolist() == [0, 1, 0, 1, 0, 1]


def test_a_try_that_moves_nothing_is_seen_and_three_states_have_to_be_worth_it() -> None:
    shown = np.array([0, 1, 1, 0, 1, 1, 0, 0, 0])[:, None] + 0.02 * np.arange(9)[:, None] % 0.05
    states = numbered((shown[:, 0] > 0.5).astype(int))
    two, found = tracked(shown, states, 1.0)
    assert found.tolist() == states.tolist() and two < tracked(shown, np.arange(9) % 2, 1.0)[0]
    assert two < tracked(shown, np.where(np.arange(9) == 4, 2, states), 1.0)[0]
    real = np.array([0, 1, 2, 1, 0, 1, 2, 1, 2])
    assert tracked(real[:, None] + 0.01, real, 1.0)[1].tolist() == real.tolist()
    assert tracked(real[:, None] + 0.01, real, 1.0)[0] < tracked(real[:, None] + 0.01, real % 2, 1.0)[0]
    assert np.isinf(tracked(shown, np.zeros(9, int), 1.0)[0]), "what never moved has no two states"


def test_responders_that_change_tell_that_a_link_moved() -> None:
    """A picture hardly shows a move, if it does; that is told by whether responders changed with it, as far as
    they do with other moves."""
    looks, every = np.array([0, 1, 0, 0.3, 0, 1, 0, 1])[:, None], np.array([1, 1, 1, 1, 1, 1, 1], bool)
    moved, stayed = [0, 1, 0, 1, 0, 1, 0, 1], [0, 1, 0, 0, 0, 1, 0, 1]
    neither = np.array([1, 1, 0, 0, 1, 1, 1], bool)
    start = np.array(moved)
    assert tracked(looks, start, 1.0, every)[1].tolist() == moved
    assert tracked(looks, start, 1.0, neither)[1].tolist() == stayed
    flickers = tracked(looks[:3], start[:3], 1.0, np.array([False, True]))[1]
    assert flickers.tolist() == moved[:3], "pictures that show it are believed"


def test_what_drifts_by_less_than_a_move_changes_is_no_move() -> None:
    """Looks of .02 apart, two by two, are two states of a link whose moves change as much, and one of another one."""
    shown, states = np.array([0, 0.02, 0, 0.02, 0, 0.02])[:, None], np.arange(6) % 2
    cost, found = tracked(shown, states, 0.02)
    assert np.isfinite(cost) and found.tolist() == states.tolist()
    assert np.isinf(tracked(shown, states, 1.0)[0])


def test_what_passes_by_once_is_no_move() -> None:
    """A change of 1 that is there in the next picture alone, and one that stays."""
    states = np.array([0, 1])
    assert not lasts(np.array([[0.0], [0.1]]), states, 1.0) and lasts(np.array([[0.0], [0.9]]), states, 1.0)
