"""Augmented crops: what is drawn stays what it was, and labels follow the picture."""

from pathlib import Path

import numpy as np
import pytest
import torch
from pydantic import ValidationError

from busybot.boards.directions import DIRECTIONS
from busybot.common.rng import generator
from busybot.interact.affordance.fast import crop_around
from busybot.interact.affordance.inputs import Pinhole, picture_features
from busybot.interact.affordance.networks import KINDS, Kind
from busybot.interact.training.augmentation import (
    MIRROR_X,
    MIRROR_Y,
    TRANSPOSE,
    Batch,
    _draw_sides,
    _resize,
    apply_symmetry,
    cut_batch,
    draw_batch,
    remapped_directions,
)
from busybot.interact.training.config import Augmentation, FitConfig, TrainConfig
from busybot.interact.training.sample_cache import Samples, cache_samples, open_samples
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode


@pytest.fixture
def samples(tmp_path: Path) -> Samples:
    return open_samples([cache_samples(make_dataset(tmp_path / "toys"), tmp_path, "depth")], "depth", 1000)


@pytest.mark.parametrize("matrix", [MIRROR_X, MIRROR_Y, TRANSPOSE])
def test_directions_are_remapped_as_vectors_are(matrix: np.ndarray) -> None:
    order = remapped_directions(matrix)
    assert sorted(order) == list(range(18))
    assert np.allclose(DIRECTIONS[order] @ matrix.T, DIRECTIONS)


def test_training_crops_are_those_that_the_model_cuts(samples: Samples) -> None:
    episode = make_episode(0)
    depth = episode.images[0].depth
    assert depth is not None
    whole = picture_features(depth, Pinhole(episode.camera)).numpy()
    expected = crop_around(whole, samples.pixels[0])[None]
    batch = cut_batch(samples, np.array([0]), 64)
    rows = samples.pixels[0, 1] + np.arange(64) - 32
    columns = samples.pixels[0, 0] + np.arange(64) - 32
    inside = ((rows > 0) & (rows < 119))[:, None] & ((columns > 5) & (columns < 159))
    assert inside.sum() > 1000
    same = np.isclose(batch.features[0].numpy(), expected[0], atol=2e-2)
    assert same[:, inside].mean() > 0.999  # depth is stored in steps of 4e-5
    assert (batch.rows[0], batch.columns[0]) == (32, 32)


@pytest.mark.parametrize("matrix", [MIRROR_X, MIRROR_Y, TRANSPOSE])
def test_a_symmetry_twice_is_none_and_the_labelled_pixel_keeps_its_height(samples: Samples, matrix: np.ndarray) -> None:
    everything = np.arange(len(samples))
    before, batch = (cut_batch(samples, everything, 32, np.full((len(samples), 2), (3, -5))) for _ in range(2))
    chosen = torch.arange(len(samples)) % 2 == 0
    apply_symmetry(batch, matrix, chosen, True)
    assert not torch.equal(batch.labels, before.labels)
    old, new = (one.features[everything, :, one.rows, one.columns] for one in (before, batch))
    assert torch.equal(old[:, 0], new[:, 0])
    assert torch.allclose(new[chosen, 1:], old[chosen, 1:] @ torch.tensor(matrix, dtype=torch.float32).T)
    apply_symmetry(batch, matrix, chosen, True)
    for name in ("features", "rows", "columns", "labels", "known"):
        assert torch.equal(getattr(batch, name), getattr(before, name)), name


def test_a_mirrored_picture_has_mirrored_features(samples: Samples) -> None:
    """The synthetic camera looks straight down from the middle, so a mirrored picture is a mirrored board."""
    episode = make_episode(0)
    depth = episode.images[0].depth
    assert depth is not None
    camera = Pinhole(episode.camera)
    plain = picture_features(depth, camera)
    for matrix, axis in ((MIRROR_X, 2), (MIRROR_Y, 1)):
        mirrored = picture_features(np.ascontiguousarray(np.flip(depth, axis - 1)), camera)
        expected = plain.flip(axis)
        expected[1:] = torch.einsum("ij,jhw->ihw", torch.tensor(matrix, dtype=torch.float32), expected[1:])
        assert torch.allclose(mirrored, expected, atol=1e-3)


def test_a_batch_depends_on_its_generator_alone(samples: Samples) -> None:
    chosen, config = np.array([0, 4, 7]), FitConfig()
    first, again, other = (
        draw_batch(samples, chosen, config, generator(0, "train", index, "position")) for index in (1, 1, 2)
    )
    assert torch.equal(first.features, again.features)
    assert first.features.shape == (3, 4, 96, 96)
    assert not torch.equal(first.features, other.features)


def test_scaled_crops_scale_their_heights(samples: Samples) -> None:
    """What is shown k times as wide is shown k times as high."""
    plain = Augmentation(scaled=1, log_scale=0.3, log_stretch=0, log_height=0, transposed=0)
    config = FitConfig(side=64, jitter=0, augmentation=plain)
    height = cut_batch(samples, np.array([0]), 64).features[0, 0, 32, 32]
    factors = []
    for index in range(4):
        first, again = (generator(0, "train", index, "scale") for _ in range(2))
        factors.append(64 / _draw_sides(config, first)[0])
        batch = draw_batch(samples, np.array([0]), config, again)
        ratio = batch.features[0, 0, batch.rows[0], batch.columns[0]] / height
        assert float(ratio) == pytest.approx(factors[-1], rel=0.03)
    assert min(factors) < 0.95 and max(factors) > 1.05


def test_a_stretched_slope_has_the_normal_of_the_stretched_slope() -> None:
    """A plane with slopes a and b, shown twice as wide and half as high again: the normal follows."""
    a, b, factor = 0.5, -0.25, 1.5
    columns, rows = np.meshgrid(np.arange(32.0), np.arange(64.0))
    normal = np.array([-a, -b, 1]) / np.linalg.norm([-a, -b, 1])
    planes = [a * columns - b * rows, *(np.full((64, 32), part) for part in normal)]  # rows run against y
    batch = Batch(
        features=torch.tensor(np.array(planes)[None], dtype=torch.float32),
        rows=torch.tensor([32]),
        columns=torch.tensor([16]),
        reward=torch.ones(1),
        labels=torch.ones(1, 18),
        known=torch.ones(1, 18),
    )
    _resize(batch, 64, torch.tensor([factor]))
    height = batch.features[0, 0]
    along_x = float(height[32, 40] - height[32, 30]) / 10  # per pixel; all lengths are in pixels here
    along_y = -float(height[40, 32] - height[30, 32]) / 10
    expected = torch.tensor([-along_x, -along_y, 1.0])
    assert torch.allclose(batch.features[0, 1:, 32, 32], expected / expected.norm(), atol=1e-3)
    assert along_x == pytest.approx(a * factor * 2**0.5 / 2, rel=1e-3)
    assert (int(batch.rows[0]), int(batch.columns[0])) == (32, 33)


@pytest.mark.parametrize(("inputs", "unseen"), [("depth", "colour"), ("rgb", "log_height")])
@pytest.mark.parametrize("kind", KINDS)
def test_what_the_inputs_do_not_show_cannot_be_varied(inputs: str, unseen: str, kind: Kind) -> None:
    """It would change nothing, and stand on the model's card."""
    seen = {"colour": "log_height", "log_height": "colour"}[unseen]
    asked = {"inputs": inputs, kind: {"augmentation": {seen: 0.1}}}
    assert getattr(TrainConfig.model_validate(asked).learn(kind).augmentation, seen) == 0.1
    usual = Augmentation.model_fields[unseen].default
    assert TrainConfig.model_validate({"inputs": inputs, kind: {"augmentation": {unseen: usual}}})
    with pytest.raises(ValidationError, match=rf"{kind}\.augmentation\.{unseen}: with inputs={inputs}"):
        TrainConfig.model_validate({"inputs": inputs, kind: {"augmentation": {unseen: 0.0}}})
