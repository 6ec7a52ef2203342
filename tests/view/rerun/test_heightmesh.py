"""The board as a solid: objects rise, their rims touch the board, the board's face is free of them."""

from dataclasses import replace

import cv2
import numpy as np

from busybot.episodes.camera import Rays
from busybot.view.rerun.board import board_face, object_pixels, object_relief
from tests.episodes.synthetic import make_episode, make_real_episode


def test_a_relief_is_as_high_as_the_object_and_stands_on_the_board() -> None:
    episode = make_episode()
    rays, image = Rays(episode.camera), episode.image(0)
    owner = object_pixels(episode, image, rays)
    for index in range(5):
        relief = object_relief(image, owner == index + 1, rays)
        assert relief is not None
        assert np.isfinite(relief.vertices).all()
        np.testing.assert_allclose(relief.vertices[:, 2].min(), 0, atol=1e-5)
        depth = image.depth[owner == index + 1]
        np.testing.assert_allclose(relief.vertices[:, 2].max(), 4 - depth.min(), atol=1e-5)
        assert relief.triangles.max() < len(relief.vertices) == len(relief.colors)


def test_triangles_face_the_camera() -> None:
    episode = make_episode()
    rays, image = Rays(episode.camera), episode.image(0)
    relief = object_relief(image, object_pixels(episode, image, rays) == 1, rays)
    assert relief is not None
    a, b, c = (relief.vertices[relief.triangles[:, k]] for k in range(3))
    towards_camera = rays.origin - a
    assert (np.cross(b - a, c - a) * towards_camera).sum(1).min() > -1e-6


def test_objects_are_told_from_the_board_by_height_where_nothing_is_segmented() -> None:
    episode = make_episode()
    rays, image = Rays(episode.camera), episode.image(0)
    with_segmentation = object_pixels(episode, image, rays)
    np.testing.assert_array_equal(object_pixels(episode, replace(image, segmentation=None), rays), with_segmentation)


def test_a_camera_without_depth_sees_no_objects() -> None:
    episode = make_real_episode()
    assert not object_pixels(episode, episode.image(0), Rays(episode.camera)).any()


def test_what_is_not_visible_has_no_relief() -> None:
    episode = make_episode()
    assert object_relief(episode.image(0), np.zeros((120, 160), bool), Rays(episode.camera)) is None


def test_where_no_depth_was_measured_the_surface_has_a_hole() -> None:
    """A hole's depth is 0, which would be a point at the camera."""
    episode = make_episode()
    rays, image = Rays(episode.camera), episode.image(0)
    own = object_pixels(episode, image, rays) == 1
    whole = object_relief(image, own, rays)
    (row, *_), (column, *_) = np.nonzero(cv2.erode(own.astype(np.uint8), np.ones((3, 3), np.uint8)))
    image.depth[row, column] = 0
    image.depth[own.nonzero()[0].max() + 1] = 0  # also in the rim, which lies on the board whatever was measured
    pierced = object_relief(image, own, rays)
    assert whole is not None and pierced is not None
    assert pierced.vertices[:, 2].max() == whole.vertices[:, 2].max() < 1
    assert len(pierced.vertices) == len(whole.vertices) - 1
    assert len(pierced.triangles) == len(whole.triangles) - 8, "the four squares around the pixel"


def test_an_object_without_any_depth_has_no_relief() -> None:
    episode = make_episode()
    rays, image = Rays(episode.camera), episode.image(0)
    own = object_pixels(episode, image, rays) == 1
    image.depth[own] = 0
    assert object_relief(image, own, rays) is None


def test_the_boards_face_shows_no_object() -> None:
    episode = make_episode()
    image = episode.image(0)
    image.rgb[...] = 100
    owner = object_pixels(episode, image, Rays(episode.camera))
    image.rgb[owner > 0] = (255, 0, 0)
    face = board_face(image, owner, episode.camera, episode.board.size)
    assert np.abs(face.astype(int) - 100).max() <= 15
