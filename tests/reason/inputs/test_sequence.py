"""What models of relations are given: shapes, zeros where nothing is known, and nothing of the truth."""

import numpy as np
import pytest

from busybot.common.errors import BusybotError
from busybot.reason.inputs.observation import acted_objects, observe_episode
from busybot.reason.inputs.sequence import CHANNELS, BoardSequence, sequence_of
from tests.episodes.synthetic import make_episode
from tests.reason.inputs.test_observation import garbled, same
from tests.reason.scenes import Patch, Scene


def filled(episode_steps: int = 5) -> tuple[BoardSequence, np.ndarray]:
    observed = observe_episode(make_episode(steps=episode_steps))
    features = np.random.default_rng(0).normal(size=(episode_steps + 1, len(observed.roles), CHANNELS))
    return sequence_of(observed, features), features.astype(np.float32)


def test_responders_have_features_triggers_have_none() -> None:
    sequence, features = filled()
    assert sequence.triggers.any() and sequence.responders.any()
    np.testing.assert_array_equal(sequence.features[:, sequence.responders], features[:, sequence.responders])
    assert not sequence.features[:, sequence.triggers].any()
    assert sequence.candidates.sum() == sequence.triggers.sum() * sequence.responders.sum()
    assert sequence.candidates[sequence.triggers][:, sequence.responders].all()


def test_actions_and_what_they_took_hold_of_are_the_observed_ones() -> None:
    episode = make_episode(steps=5)
    sequence, _ = filled()
    assert sequence.steps == 5
    np.testing.assert_allclose(sequence.actions[:, :3], [step.position for step in episode.steps], rtol=1e-6)
    np.testing.assert_array_equal(sequence.acted, acted_objects(observe_episode(episode)))
    np.testing.assert_allclose(np.linalg.norm(sequence.actions[:, 3:], axis=1), 1, rtol=1e-6)


def test_the_truth_makes_no_difference() -> None:
    episode = make_episode(steps=6)
    features = np.ones((7, len(episode.board.objects), CHANNELS))
    assert same(
        sequence_of(observe_episode(episode), features), sequence_of(observe_episode(garbled(episode)), features)
    )


def test_an_object_that_does_not_show_has_no_features_and_no_position() -> None:
    scene = Scene(
        ("responder", "trigger"), [(-1, -1, -1, -1), (30, 40, 60, 70)], [[Patch((30, 40, 60, 70), (9, 9, 9))]]
    )
    observed = scene.observed()
    observed.positions[0] = np.nan
    sequence = sequence_of(observed, np.ones((1, 2, CHANNELS)))
    assert not sequence.features.any() and not sequence.positions.any()
    assert sequence.actions.shape == (0, 6) and sequence.acted.shape == (0,)


def test_fewer_images_are_fewer_steps() -> None:
    sequence, _ = filled()
    early = sequence.first(3)
    assert early.steps == 2 and len(early.features) == 3 and len(early.acted) == 2
    np.testing.assert_array_equal(early.features, sequence.features[:3])
    assert sequence.first(99).steps == 5 and sequence.first(0).steps == 0


def test_features_of_another_episode_are_refused() -> None:
    with pytest.raises(BusybotError, match="where the episode has"):
        sequence_of(observe_episode(make_episode(steps=5)), np.zeros((5, 3, CHANNELS)))
