"""Label-free states: looks of one state together, of different states apart."""

from pathlib import Path

import numpy as np
import pytest

from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.episodes.mcap.reader import read_episode
from busybot.reason.evaluation.ground_truth import states_of
from busybot.reason.inputs.feature_store import features_of
from busybot.reason.inputs.sequence import UNSEEN, clusters_of, fit_threshold, threshold_of


def looks(*states: int, noise: float = 0.0, apart: float = 10.0) -> np.ndarray:
    """float (T, 1, 256), each state at a place of its own."""
    rng = np.random.default_rng(3)
    places = apart * rng.normal(size=(4, 256)) / np.sqrt(2 * 256)
    return (places[list(states)] + noise * rng.normal(size=(len(states), 256)) / np.sqrt(2 * 256))[:, None]


@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_states_are_numbered_as_they_appear(noise: float) -> None:
    assert clusters_of(looks(2, 0, 0, 2, 3, 0, noise=noise), 2.0)[:, 0].tolist() == [0, 1, 1, 0, 2, 1]


def test_the_threshold_decides_what_is_alike() -> None:
    features = looks(0, 1, 0)
    assert clusters_of(features, 100.0)[:, 0].tolist() == [0, 0, 0]
    assert clusters_of(looks(0, 0, noise=5.0), 1.0)[:, 0].tolist() == [0, 1]


def test_what_differs_by_a_small_share_of_the_largest_difference_may_be_noise() -> None:
    """One look of the first state is off by a third of the way to the second."""
    features = looks(0, 1, 0, 0, 1)
    features[3] += (features[1] - features[0]) / 3
    assert clusters_of(features, 2.0)[:, 0].tolist() == [0, 1, 0, 2, 1]
    assert clusters_of(features, 2.0, 0.45)[:, 0].tolist() == [0, 1, 0, 0, 1]


def test_objects_are_told_apart_and_some_have_no_looks() -> None:
    features = np.concatenate([looks(0, 0, 1), np.zeros((3, 1, 256)), looks(1, 0, 1)], axis=1)
    assert clusters_of(features, 2.0).T.tolist() == [[0, 0, 1], [UNSEEN] * 3, [0, 1, 0]]


def test_one_frame_is_one_state() -> None:
    assert clusters_of(looks(1), 2.0).tolist() == [[0]]


def test_a_fitted_threshold_lies_between() -> None:
    rng = np.random.default_rng(0)
    alike, different = rng.uniform(0, 0.3, 1000), rng.uniform(1.5, 9, 1000)
    assert 0.3 < fit_threshold(alike, different) < 1.5
    assert 0 < fit_threshold(np.zeros(10), different) < 1.5


def test_encoders_without_a_threshold_have_that_of_a_board_or_are_refused() -> None:
    assert threshold_of("embedded") == threshold_of("embedded", looks(0, 1))
    with pytest.raises(BusybotError, match="fit_threshold"):
        threshold_of("random")
    change = np.linalg.norm(looks(0, 1)[1] - looks(0, 1)[0])
    assert threshold_of("random", looks(0, 1, 1, 0)) == pytest.approx(0.01 * change)
    assert threshold_of("random", looks(0, 0)) > 0


@pytest.mark.parametrize("encoder", ["embedded", "random"])
def test_clusters_are_the_true_states_of_rendered_boards(encoder: str, tiny: Path, tmp_path: Path) -> None:
    dataset = Dataset.open(tiny)
    features = features_of(dataset, encoder, store=tmp_path, episodes=range(4), workers=1)
    for index in features:
        truth = states_of(read_episode(dataset.episode_path(index), "lazy"))
        assert truth is not None
        found = clusters_of(features[index], threshold_of(encoder, features[index]))
        for number in np.flatnonzero(found[0] != UNSEEN):
            pairs = set(zip(found[:, number].tolist(), truth.states[:, number].tolist(), strict=True))
            assert len(pairs) == len(set(found[:, number])) == len(set(truth.states[:, number]))
