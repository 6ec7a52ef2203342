"""An episode as a reasoner takes it, step by step."""

from dataclasses import replace

import numpy as np
import pytest

from busybot.reason.evaluation.prediction import Explanation, explain, inferred_over_time
from busybot.reason.models.base import InferredGraph
from busybot.reason.models.lookup import Lookup, Persistence
from tests.episodes.synthetic import make_episode, make_real_episode


def by_hand() -> Explanation:
    """Object 1 changes in step 0 as expected; object 2 is expected to in step 1 and does not; 0 is a trigger."""
    states = np.array([[-1, 0, 0], [-1, 1, 0], [-1, 1, 0]])
    expected = np.array([[-1, 1, 0], [-1, 1, 1]])
    return Explanation(
        InferredGraph("hand", np.zeros((2, 3, 3))), states, expected, np.array([False, True, True]), True
    )


def test_errors_and_events_by_hand() -> None:
    foreseen = by_hand()
    assert [foreseen.wrong(step).tolist() for step in (0, 1)] == [[], [2]]
    assert [foreseen.changed(step).tolist() for step in (0, 1)] == [[1], [2]]


def test_who_expects_no_change_is_surprised_by_every_change() -> None:
    episode = make_episode(steps=6)
    foreseen = explain(episode, Persistence())
    assert foreseen.known and foreseen.states.shape == (7, 5) and foreseen.expected.shape == (6, 5)
    for step, done in enumerate(episode.steps):
        changed = np.flatnonzero(np.array(done.responder_states_before) != done.responder_states_after)
        assert foreseen.wrong(step).tolist() == foreseen.changed(step).tolist() == changed.tolist()


def test_looking_up_is_surprised_less_and_less() -> None:
    foreseen = explain(make_episode(steps=12), Lookup())
    surprises = [len(foreseen.wrong(step)) for step in range(12)]
    assert sum(surprises[:6]) > sum(surprises[6:])
    assert foreseen.graph.probabilities.shape == (12, 5, 5)


@pytest.mark.parametrize("images", [2, 4])
def test_what_comes_after_the_observed_images_teaches_nothing(images: int) -> None:
    short, whole = (explain(make_episode(steps=9), Lookup(), number) for number in (images, 23))
    assert len(short.graph.probabilities) == images - 1
    np.testing.assert_array_equal(short.expected[: images - 1], whole.expected[: images - 1])
    assert sum(len(short.wrong(step)) for step in range(9)) >= sum(len(whole.wrong(step)) for step in range(9))


def test_where_states_are_unknown_looks_stand_in_for_them() -> None:
    """A recording of a board whose states nobody wrote down: clusters are what changes, from 0."""
    episode = make_episode(steps=6)
    unknown = [replace(step, responder_states_before=(), responder_states_after=()) for step in episode.steps]
    foreseen = explain(replace(episode, steps=unknown), Persistence())
    truth = explain(episode, Persistence())
    assert not foreseen.known and (foreseen.states[0, [1, 2]] == 0).all()
    for step in range(6):
        assert foreseen.wrong(step).tolist() == truth.wrong(step).tolist()


def test_of_an_object_whose_box_another_one_has_nothing_is_expected() -> None:
    """No depth tells the lamp from the door, and nobody wrote down states: its own pixels are none."""
    episode = make_episode(steps=6)
    unknown = [replace(step, responder_states_before=(), responder_states_after=()) for step in episode.steps]
    flat = [replace(image, depth=None, boxes=image.boxes[[0, 1, 1, 3, 4]]) for image in episode.images]
    foreseen = explain(replace(episode, steps=unknown, images=flat), Persistence())
    assert foreseen.judged.tolist() == [False, False, True, False, True]


def test_where_nothing_shows_nothing_is_expected() -> None:
    foreseen = explain(make_real_episode(), Lookup())
    assert not foreseen.judged.any() and not any(len(foreseen.wrong(step)) for step in range(4))


def test_what_is_seen_later_counts_unless_it_is_left_out() -> None:
    episode = make_episode(steps=40)
    assert len(explain(episode, Lookup()).graph.probabilities) == 40
    assert len(explain(episode, Lookup(), 23).graph.probabilities) == 22
    assert len(inferred_over_time(episode, "count").probabilities) == 40
