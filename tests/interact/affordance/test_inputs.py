"""Height and normals from depth: right, and the same for pictures and crops."""

import numpy as np
import pytest
import torch

from busybot.episodes.camera import Rays, normals
from busybot.episodes.episode import Camera
from busybot.interact.affordance.inputs import LOWEST, Pinhole, heights_of, picture_features
from busybot.sim.scene.render import RenderConfig, camera_model
from tests.episodes.synthetic import make_episode

CAMERA = camera_model(RenderConfig(width=160, height=120))


def depth_of_board(camera: Camera, height: float = 0.0) -> np.ndarray:
    """What a camera measures that sees nothing but a plane `height` above the board."""
    rays = Rays(camera)
    return ((height - rays.origin[2]) / rays.directions[..., 2]).astype(np.float32)


def test_an_empty_board_is_flat_and_faces_up() -> None:
    features = picture_features(depth_of_board(CAMERA, 0.25), Pinhole(CAMERA))
    assert features.shape == (4, 120, 160)
    assert torch.allclose(heights_of(features), torch.tensor(0.25), atol=1e-5)
    up = torch.tensor([0.0, 0.0, 1.0])[:, None, None]
    assert torch.allclose(features[1:], up.expand(3, 120, 160), atol=2e-2)


def test_agrees_with_the_geometry_of_episodes() -> None:
    episode = make_episode(0)
    image = episode.images[0]
    assert image.depth is not None
    features = picture_features(image.depth, Pinhole(episode.camera)).numpy()
    rays = Rays(episode.camera)
    seen = image.depth > 0
    assert np.allclose(features[0][seen] / 4, rays.heights(image.depth)[seen], atol=1e-5)
    inner = (slice(1, -1), slice(6, -1))
    expected = normals(rays.points(image.depth))[inner].transpose(2, 0, 1)
    assert np.allclose(features[1:, *inner], expected, atol=1e-3)


def test_where_nothing_was_hit_the_height_is_lowest_and_the_normal_zero() -> None:
    depth = depth_of_board(CAMERA)
    depth[40:50, 60:70] = 0
    features = picture_features(depth, Pinhole(CAMERA))
    assert torch.isfinite(features).all()
    assert heights_of(features)[45, 65].item() == pytest.approx(LOWEST)
    assert features[1:, 45, 65].abs().max() == 0
