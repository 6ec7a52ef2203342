"""What an oblique camera sees of a board, as one high above it would see it.

The networks were trained on pictures from above, and know a switch by its heights and normals there. The depth of an
oblique picture tells where its points lie: drawn from above, in as many pixels for a board unit as in training, the
same switch looks the same again, whatever the camera's place, angle and field of view. What no point shows, behind
things, is taken for the board.
"""

from dataclasses import replace

import cv2
import numpy as np

from busybot.episodes.camera import Rays, project
from busybot.episodes.episode import Camera, Observation
from busybot.interact.policy.direction_pairs import ELEVATED

OBLIQUE_DEG = 15.0
"""A camera whose axis is farther off the board's normal is oblique; that of the training is 1.4 degrees off it."""
RESOLUTION = 115.5
"""Pixels for a board unit: those of the training's camera at the board."""
DISTANCE = 40.0
"""From so high the whole board is seen from above, board units."""
MARGIN, REACH = 0.6, 6.0
"""What moves may reach so far beyond what stood on the board at first, and nothing is drawn that is farther from the
board's middle: no board is so large, board units."""
FINER, JUMP = 2, 0.06
"""Between two pixels so many points are drawn a side, unless their depths differ by more than this, board units."""


def oblique(camera: Camera) -> bool:
    """Whether pictures of the camera are to be drawn from above."""
    return bool(-camera.pose[2, 2] < np.cos(np.deg2rad(OBLIQUE_DEG)))


class PlanView:
    """Draws pictures of one oblique camera from above.

    Args:
        rays: of the camera.
        first: a picture; others are drawn as large as what stands on the board there needs.

    Attributes:
        above: of the camera that would see what is drawn.
    """

    def __init__(self, rays: Rays, first: Observation):
        points = rays.points(first.depth)
        raised = points[np.nan_to_num(points[..., 2], nan=-1) > ELEVATED][:, :2].clip(-REACH, REACH)
        low, high = (raised.min(0), raised.max(0)) if len(raised) else (np.zeros(2), np.zeros(2))
        middle, (width, height) = (low + high) / 2, np.ceil((high - low + 2 * MARGIN) * RESOLUTION).astype(int).tolist()
        focal = RESOLUTION * DISTANCE
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[:3, 3] = (*middle, DISTANCE)
        matrix = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
        self._rays, self.above = rays, Rays(Camera(width, height, matrix, pose))

    def of(self, seen: Observation) -> tuple[Observation, np.ndarray]:
        """A picture's depth drawn from above, and where each of its pixels is drawn, int (H, W, 2), u and v."""
        camera, points = self.above.camera, self._rays.points(seen.depth)
        size = (FINER * seen.depth.shape[1], FINER * seen.depth.shape[0])
        square = np.ones((3, 3), np.uint8)
        edges = (cv2.dilate(seen.depth, square) - cv2.erode(seen.depth, square) > JUMP).astype(np.uint8)
        near = cv2.resize(points, size, interpolation=cv2.INTER_NEAREST)
        edge = cv2.resize(edges, size, interpolation=cv2.INTER_NEAREST) > 0
        fine = np.where(edge[..., None], near, cv2.resize(points, size, interpolation=cv2.INTER_LINEAR))
        raised = fine[np.nan_to_num(fine[..., 2], nan=-1) > ELEVATED]
        raised = raised[np.argsort(raised[:, 2], kind="stable")]  # what is highest is drawn last
        depth = np.full((camera.height, camera.width), DISTANCE, np.float32)
        (columns, rows), inside = self._pixels(raised)
        depth[rows[inside], columns[inside]] = DISTANCE - raised[inside, 2]
        (columns, rows), _ = self._pixels(np.nan_to_num(points, nan=0.0))
        cells = np.stack([columns.clip(0, camera.width - 1), rows.clip(0, camera.height - 1)], axis=-1)
        # a pixel without a point among some with points is one that was missed
        return replace(seen, depth=cv2.morphologyEx(depth, cv2.MORPH_OPEN, square)), cells

    def _pixels(self, points: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
        """Columns and rows (...,) where points (..., 3) are drawn, and whether that is inside of the picture."""
        columns, rows = np.moveaxis(np.floor(project(points, self.above.camera)[0]).astype(int), -1, 0)
        inside = (columns >= 0) & (rows >= 0) & (columns < self.above.camera.width) & (rows < self.above.camera.height)
        return (columns, rows), inside
