"""Encoders by name: what each is given, and that only the oracle reads the truth."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from busybot.common.errors import BusybotError
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.encoders.resnet import drawn
from busybot.reason.inputs.observation import observe_episode
from tests.episodes.synthetic import make_episode, make_real_episode
from tests.reason.inputs.test_observation import garbled


@pytest.mark.parametrize("name", ["embedded", "embedded-box", "random", "random-centre"])
def test_the_truth_makes_no_difference(name: str) -> None:
    episode = make_episode(steps=6)
    np.testing.assert_array_equal(
        make_extractor(name).of_episode(episode), make_extractor(name).of_episode(garbled(episode))
    )
    np.testing.assert_array_equal(
        make_extractor(name).of_episode(episode), make_extractor(name).of(observe_episode(episode))
    )


def test_features_change_when_states_do() -> None:
    episode = make_episode(steps=12)
    features = make_extractor().of_episode(episode)
    observed = observe_episode(episode)
    assert features.shape == (13, len(observed.roles), 256) and features.dtype == np.float16
    assert not features[:, observed.triggers].any() and features[:, observed.responders].any((0, 2)).all()
    before, after = (
        np.array([getattr(s, f"responder_states_{w}") for s in episode.steps]) for w in ("before", "after")
    )
    moved = np.any(features[1:] != features[:-1], axis=-1)
    np.testing.assert_array_equal(moved[:, observed.responders], (before != after)[:, observed.responders])


def test_the_oracle_needs_the_episode_and_says_what_it_is() -> None:
    episode = make_episode(steps=2)
    oracle = make_extractor("embedded-mask")
    assert oracle.oracle and not make_extractor("embedded").oracle and not make_extractor("embedded-box").oracle
    assert oracle.of_episode(episode).any()
    with pytest.raises(BusybotError, match="segmentation.*\n  hint: "):
        oracle.of(observe_episode(episode))


def test_a_recording_without_depth_is_encoded_from_its_boxes() -> None:
    episode = make_episode(steps=4)
    episode.images = [replace(image, depth=None) for image in episode.images]
    np.testing.assert_array_equal(
        make_extractor("embedded").of_episode(episode), make_extractor("embedded-box").of_episode(episode)
    )
    assert make_extractor("embedded").of_episode(episode).any()


def test_a_recording_without_boxes_has_no_features() -> None:
    assert not make_extractor("embedded").of_episode(make_real_episode()).any()


def test_keys_tell_encoders_apart() -> None:
    names = ["embedded", "embedded-box", "embedded-mask", "random", "random-box", "random-centre"]
    keys = [make_extractor(name).key for name in names]
    assert len(set(keys)) == 6
    assert all(key.startswith(f"{name}-") for name, key in zip(names, keys, strict=True))


@pytest.mark.parametrize("name", ["ambedded", "embedded-", "embedded-all", "", "-box", "../embedded"])
def test_other_names_are_refused(name: str) -> None:
    with pytest.raises(BusybotError, match="there is no encoder"):
        make_extractor(name)


def test_weights_go_with_resnet50_alone() -> None:
    with pytest.raises(BusybotError, match="takes no weights"):
        make_extractor("embedded", Path("w.pth"))


def test_the_centre_is_that_of_the_first_box_in_every_picture() -> None:
    episode = make_episode(steps=6)
    features, observed = make_extractor("random-centre").of_episode(episode), observe_episode(episode)
    assert features.shape == (7, len(observed.roles), 256) and features.dtype == np.float16
    assert not features[:, observed.triggers].any() and features[:, observed.responders].any((0, 2)).all()
    index = observed.responders[0]
    u0, v0, u1, v1 = observed.boxes[index]
    picture = observed.frame(3).rgb
    place = np.array([[(u0 + u1) / 2 / picture.shape[1], (v0 + v1) / 2 / picture.shape[0]]])
    np.testing.assert_allclose(features[3, index], drawn().encode_at([picture], place)[0, 0], rtol=1e-2, atol=1e-2)
    assert not make_extractor("random-centre").of_episode(make_real_episode()).any()


def test_the_centre_goes_with_encoders_of_places() -> None:
    with pytest.raises(BusybotError, match="embedded does not encode single places"):
        make_extractor("embedded-centre")
