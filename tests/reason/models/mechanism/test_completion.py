"""What follows in situations that were never met, where each input must matter."""

import numpy as np

from busybot.reason.models.mechanism.completion import BOTH_WAYS, completed, lasting


def test_the_last_situation_is_what_makes_every_input_matter() -> None:
    assert completed({(0, 0): 0, (0, 1): 0, (1, 0): 0}, (2, 2), 2)[1, 1].tolist() == [0, 1]
    told = completed({(0, 0): 0, (0, 1): 1, (1, 0): 1}, (2, 2), 2)[1, 1]
    assert told.tolist() == [BOTH_WAYS / (1 + BOTH_WAYS), 1 / (1 + BOTH_WAYS)], "exclusive or, or, likelier, or"
    assert completed({(0,): 1}, (2,), 2)[1,].tolist() == [1, 0]


def test_shares_are_those_of_the_functions_that_are_left() -> None:
    """Of two inputs ten functions need both: five with each state of any situation, one of them exclusive."""
    told = completed({}, (2, 2), 2)
    assert len(told) == 4 and all(np.allclose(shares, 0.5) for shares in told.values())
    left = completed({(0, 0): 0}, (2, 2), 2)
    five = 4 + BOTH_WAYS
    np.testing.assert_allclose(left[0, 1], [2 / five, (2 + BOTH_WAYS) / five])
    np.testing.assert_allclose(left[1, 1], [(2 + BOTH_WAYS) / five, 2 / five])


def test_what_lasts_for_some_actions_ends_once() -> None:
    """On since the press and one action later, off three actions after it; before any press as long after."""
    told = lasting({(0,): 1, (1,): 1, (3,): 0}, 2)
    assert {since: shares.tolist() for (since,), shares in told.items()} == {2: [0.5, 0.5], 4: [1, 0], 5: [1, 0]}
    assert lasting({(0,): 1, (1,): 0, (2,): 1}, 2) == {}, "it does not last"


def test_nothing_is_told_where_all_was_met_or_nothing_fits_or_too_much_does() -> None:
    assert completed({(0,): 0, (1,): 1}, (2,), 2) == {}
    assert completed({(0,): 0}, (2,), 1) == {}
    assert completed({}, (3, 3, 3), 3) == {}
    assert completed({(0,): 0, (2,): 1}, (2,), 2)[1,].tolist() == [0, 1], "a third state that nobody knew of"


def test_inputs_that_are_the_same_way_round_work_the_same_way() -> None:
    """Of two inputs neither of which does anything while the other is low: both, or the first alone, may matter."""
    known = {(0, 0): 0, (0, 1): 0}
    open_ = completed(known, (2, 2), 2)
    alike, unlike = (completed(known, (2, 2), 2, odds) for odds in ((2.0, 2.0), (2.0, -2.0)))
    assert open_[1, 1].tolist() == [0.5, 0.5]
    assert alike[1, 1][1] > 0.75 > 0.25 > unlike[1, 1][1] and alike[1, 0][1] < 0.25
