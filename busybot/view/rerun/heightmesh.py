"""The board as a solid thing, from one depth image: a clean face and a relief of every object. No drawing here."""

from dataclasses import dataclass

import cv2
import numpy as np

from busybot.episodes.camera import Rays, project
from busybot.episodes.episode import Camera, Episode, Image

FACE_PIXELS = 512
OBJECT_HEIGHT = 0.015
"""Board units; what is higher is an object, where no segmentation was recorded."""
SIDE_SHADE = 0.45


@dataclass(frozen=True)
class Relief:
    """A coloured triangle mesh in the board frame.

    Attributes:
        vertices: float32 (V, 3), board units.
        triangles: uint32 (T, 3).
        colors: uint8 (V, 3).
    """

    vertices: np.ndarray
    triangles: np.ndarray
    colors: np.ndarray


def object_pixels(episode: Episode, image: Image, rays: Rays) -> np.ndarray:
    """1 + index of the object that each pixel shows, 0 for board and table; int (H, W)."""
    if image.segmentation is not None:
        owner = np.array([0, *(link.object + 1 for link in episode.links)])
        return owner[image.segmentation]
    pixels = np.zeros(image.rgb.shape[:2], int)
    if image.depth is None:
        return pixels
    high = rays.heights(image.depth) > OBJECT_HEIGHT
    for index, (u0, v0, u1, v1) in enumerate(np.maximum(image.boxes.astype(int), 0)):
        pixels[v0:v1, u0:u1][high[v0:v1, u0:u1]] = index + 1
    return pixels


def board_face(image: Image, objects: np.ndarray, camera: Camera, size: tuple[float, float]) -> np.ndarray:
    """The board's face seen from straight above with the objects painted over, uint8 (FACE_PIXELS, FACE_PIXELS, 3).

    The upper left corner is the board's (-x, +y) corner.
    """
    half = np.array(size) / 2
    corners = np.array([[-half[0], half[1], 0], [half[0], half[1], 0], [half[0], -half[1], 0], [-half[0], -half[1], 0]])
    seen = project(corners, camera)[0].astype(np.float32)
    target = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32) * FACE_PIXELS
    warp = cv2.getPerspectiveTransform(seen, target)
    covered = cv2.dilate((objects > 0).astype(np.uint8), np.ones((7, 7), np.uint8))
    shape = (FACE_PIXELS, FACE_PIXELS)
    face = cv2.warpPerspective(image.rgb, warp, shape, borderMode=cv2.BORDER_REPLICATE)
    holes = cv2.warpPerspective(covered, warp, shape, flags=cv2.INTER_NEAREST)
    return cv2.inpaint(face, holes, 5, cv2.INPAINT_TELEA)


def object_relief(image: Image, own: np.ndarray, rays: Rays) -> Relief | None:
    """The pixels `own` (bool (H, W)) as a surface whose rim falls down to the board; None if nothing is visible."""
    assert image.depth is not None
    box = cv2.boundingRect(own.astype(np.uint8))
    if box[2] == 0:
        return None
    rows = slice(max(box[1] - 2, 0), box[1] + box[3] + 2)
    columns = slice(max(box[0] - 2, 0), box[0] + box[2] + 2)
    inner = _without_threads(own[rows, columns].astype(np.uint8))
    used = cv2.dilate(inner, np.ones((3, 3), np.uint8)).astype(bool)
    points = rays.directions[rows, columns] * image.depth[rows, columns, None] + rays.origin
    rim = used & (inner == 0)
    points[rim] = _on_the_board(rays, rows, columns)[rim]
    colors = np.where(rim[..., None], _rim_colors(image.rgb[rows, columns], inner), image.rgb[rows, columns])
    number = np.full(used.shape, -1)
    number[used] = np.arange(int(used.sum()))
    return Relief(points[used].astype(np.float32), _triangles(number), colors[used].astype(np.uint8))


def _without_threads(inner: np.ndarray) -> np.ndarray:
    """The pixels without parts of one or two pixels' width, which would stand on the board as tall thin fences."""
    solid = cv2.morphologyEx(inner, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return solid if solid.any() else inner


def _on_the_board(rays: Rays, rows: slice, columns: slice) -> np.ndarray:
    """Where the viewing rays meet the board's plane z = 0; (h, w, 3)."""
    directions = rays.directions[rows, columns]
    return directions * (-rays.origin[2] / directions[..., 2:]) + rays.origin


def _rim_colors(rgb: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """The object's colours carried over its outline and darkened: the sides, which no camera saw."""
    weight = cv2.blur(inner.astype(np.float32), (3, 3))
    spread = cv2.blur(rgb.astype(np.float32) * inner[..., None], (3, 3))
    return SIDE_SHADE * spread / np.maximum(weight, 1e-6)[..., None]


def _triangles(number: np.ndarray) -> np.ndarray:
    """Two triangles for every 2 x 2 block of numbered pixels, counter-clockwise seen from the camera."""
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    whole = (a >= 0) & (b >= 0) & (c >= 0) & (d >= 0)
    upper = np.stack([a[whole], c[whole], b[whole]], axis=1)
    lower = np.stack([b[whole], c[whole], d[whole]], axis=1)
    return np.concatenate([upper, lower]).astype(np.uint32)
