"""From pixels to the board and back, for one static pinhole camera (paper section 4.1, appendix "Network detail")."""

import numpy as np

from busybot.episodes.episode import Camera


class Rays:
    """The camera's viewing rays, computed once.

    Attributes:
        directions: float32 (H, W, 3), board-frame vector per unit of depth through each pixel's centre.
        origin: float32 (3,), the camera's position in the board frame.
    """

    def __init__(self, camera: Camera):
        columns = (np.arange(camera.width) + 0.5 - camera.matrix[0, 2]) / camera.matrix[0, 0]
        rows = (np.arange(camera.height) + 0.5 - camera.matrix[1, 2]) / camera.matrix[1, 1]
        grid = np.stack([*np.meshgrid(columns, rows), np.ones((camera.height, camera.width))], axis=-1)
        self.camera = camera
        self.directions = (grid @ camera.pose[:3, :3].T).astype(np.float32)
        self.origin = camera.pose[:3, 3].astype(np.float32)

    def points(self, depth: np.ndarray) -> np.ndarray:
        """Board-frame position of every pixel, float32 (H, W, 3); NaN where depth is 0."""
        points = self.directions * depth[..., None] + self.origin
        points[depth <= 0] = np.nan
        return points

    def point(self, depth: np.ndarray, pixel: tuple[int, int]) -> np.ndarray:
        """Board-frame position of pixel (u, v), float32 (3,)."""
        column, row = pixel
        return self.directions[row, column] * depth[row, column] + self.origin

    def heights(self, depth: np.ndarray) -> np.ndarray:
        """Height above the board's surface, float32 (H, W), board units; NaN where depth is 0."""
        heights = self.directions[..., 2] * depth + self.origin[2]
        return np.where(depth > 0, heights, np.float32(np.nan))


def project(points: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Board-frame points (..., 3) to pixel coordinates (..., 2), not finite at depth 0, and depth (...,)."""
    local = (np.asarray(points, float) - camera.pose[:3, 3]) @ camera.pose[:3, :3]
    depth = local[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = local[..., :2] / depth[..., None] * camera.matrix[[0, 1], [0, 1]] + camera.matrix[:2, 2]
    return pixels, depth


def normals(points: np.ndarray) -> np.ndarray:
    """Surface normals towards the camera from neighbouring positions (paper appendix "Network detail").

    Args:
        points: float32 (H, W, 3) from `Rays.points`.

    Returns:
        float32 (H, W, 3), unit length; zero at the image's border and where a neighbour has no depth.
    """
    across, down = np.zeros_like(points), np.zeros_like(points)
    across[:, 1:-1] = points[:, 2:] - points[:, :-2]
    down[1:-1] = points[2:] - points[:-2]
    crossed = np.cross(down, across)
    length = np.linalg.norm(crossed, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = crossed / length
    return np.where(np.isfinite(unit), unit, 0).astype(np.float32)
