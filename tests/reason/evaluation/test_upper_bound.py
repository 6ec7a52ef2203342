"""What observed transitions determine, on boards of one responder and by hand."""

from collections.abc import Sequence

import numpy as np

from busybot.reason.evaluation.ground_truth import StateTruth, determined


def board(states: Sequence[int], links: Sequence[int]) -> StateTruth:
    """Object 0 is a trigger, object 1 takes these states; these links are held."""
    changed = np.diff(states) != 0
    both = np.stack([np.full(len(states), -1), states], axis=1)
    held = np.minimum(links, 0)
    return StateTruth(both, np.array(links), held, changed, ("one-to-one",) * len(links))


def right(
    truth: StateTruth,
    observed: int,
    knowing: bool = False,
    contacts: Sequence[float] | None = None,
    acted: Sequence[int] | None = None,
) -> list[bool]:
    """Whether the responder's state after each unobserved step is determined."""
    steps = len(truth.links)
    along = np.zeros((steps, 3))
    along[:, 0] = 0 if contacts is None else contacts
    touched = np.zeros(steps, int) if acted is None else np.array(acted)
    return determined(truth, along, touched, observed, knowing)[observed:, 1].tolist()


def test_what_the_link_was_seen_to_do_is_determined_and_so_is_its_reverse() -> None:
    """Seen: 0 to 1 by link 5. Then back, again, and forth."""
    assert right(board([0, 1, 0, 1], [5, 5, 5]), observed=1) == [True, True]


def test_what_was_never_seen_is_not_determined() -> None:
    assert right(board([0, 0, 1], [5, 5]), observed=1) == [False]
    assert right(board([0, 1, 2], [5, 5]), observed=1) == [False], "a third state"
    assert right(board([0, 1, 0], [5, 6]), observed=1) == [False], "another link"


def test_who_does_not_know_which_actions_fail_expects_the_effect() -> None:
    failing = board([0, 1, 1], [5, 5])
    assert right(failing, observed=1) == [False]
    assert right(failing, observed=1, knowing=True) == [True]


def test_an_action_from_which_nothing_is_expected_may_fail() -> None:
    assert right(board([0, 0, 0], [5, 5]), observed=1) == [True]
    assert right(board([0, 1, 1], [5, 6]), observed=1) == [True]


def test_where_several_effects_were_seen_the_true_one_counts() -> None:
    """A lever in the middle: 0 to 1, back, 0 to 2, back; then to either side."""
    assert right(board([0, 1, 0, 2, 0, 1], [5] * 5), observed=4) == [True]
    assert right(board([0, 1, 0, 2, 0, 2], [5] * 5), observed=4) == [True]


def test_an_action_that_held_nothing_is_taken_for_one_on_the_nearest_link() -> None:
    """Link 5 at 0 moves the responder, link 6 at 1 does not; the third action slips off."""
    truth = board([0, 1, 1, 1], [5, 6, -1])
    assert right(truth, 2, contacts=[0, 1, 0.1]) == [False]
    assert right(truth, 2, contacts=[0, 1, 0.9]) == [True]
    assert right(truth, 2, contacts=[0, 1, 0.1], acted=[0, 0, -1]) == [True], "far from any trigger"
    assert right(truth, 2, contacts=[0, 1, 0.1], knowing=True) == [True]


def test_nothing_observed_determines_that_nothing_changes() -> None:
    assert right(board([0, 1, 1], [5, 5]), observed=0) == [False, True]
