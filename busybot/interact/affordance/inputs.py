"""Inputs of the interaction networks (paper appendix A.1, "Network detail"): height above the board, surface normals.

The paper concatenates the depth image with normals from neighbouring world coordinates. Here the first channel is the
height above the board instead of the distance from the camera, so that a shape looks the same all over the board. The
camera looks almost straight down: moving right in the picture is +x, moving down is -y of the board frame, and that is
how pictures are turned and mirrored for training (`interact.training.augmentation`).

One function computes the channels for whole pictures and for crops: a crop knows the pixels that it consists of. The
RGB variant (row "RGB" of Table 1) sees colours only.
"""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from busybot.episodes.episode import Camera
from busybot.interact.policy.config import Inputs

CHANNELS: dict[Inputs, int] = {"depth": 4, "rgb": 3}
LOWEST, HIGHEST = -0.3, 1.2
"""Heights are clipped to this range, board units; where nothing was hit the height is `LOWEST`."""
HEIGHT_GAIN = 4.0
"""The height channel is height times this: objects are some tenths of a unit high, normals are of length 1."""
APART = 8
"""What changed in two places is computed in two, if so many pixels lie between them."""

Box = tuple[slice, slice]


class Pinhole:
    """A camera's viewing rays as a linear function of the pixel: position = origin + depth * (base + u du + v dv).

    Attributes:
        base, du, dv: float32 (3,), board frame.
        origin: float32 (3,), the camera's position.
    """

    def __init__(self, camera: Camera):
        rotation = camera.pose[:3, :3]
        (fx, _, cx), (_, fy, cy) = camera.matrix[0], camera.matrix[1]
        corner = rotation @ np.array([(0.5 - cx) / fx, (0.5 - cy) / fy, 1.0])
        self.base, self.du, self.dv = (
            torch.tensor(vector, dtype=torch.float32) for vector in (corner, rotation[:, 0] / fx, rotation[:, 1] / fy)
        )
        self.origin = torch.tensor(camera.pose[:3, 3], dtype=torch.float32)

    def points(self, depth: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
        """Board-frame positions, NaN where nothing was hit.

        Shapes:
            depth: float32 (B, h, w), board units, 0 where nothing was hit.
            rows, columns: (B, h) and (B, w), the pixels in the whole picture.
            returns: float32 (B, 3, h, w).
        """
        depth = torch.where(depth > 0, depth, torch.nan)
        u, v = columns.float()[:, None, :], rows.float()[:, :, None]
        axes = [self.origin[k] + depth * (self.base[k] + u * self.du[k] + v * self.dv[k]) for k in range(3)]
        return torch.stack(axes, dim=1)


def depth_features(points: Tensor) -> Tensor:
    """Scaled height and unit normals towards the camera from the differences of neighbouring positions.

    n = (p(v+1) - p(v-1)) x (p(u+1) - p(u-1)), normalised; zero where a neighbour is missing.

    Shapes:
        points: float32 (B, 3, h, w), NaN where nothing was hit.
        returns: float32 (B, 4, h - 2, w - 2): height times `HEIGHT_GAIN`, then n_x, n_y, n_z.
    """
    across = points[:, :, 1:-1, 2:] - points[:, :, 1:-1, :-2]
    down = points[:, :, 2:, 1:-1] - points[:, :, :-2, 1:-1]
    (ax, ay, az), (dx, dy, dz) = across.unbind(1), down.unbind(1)
    normal = unit(torch.stack([dy * az - dz * ay, dz * ax - dx * az, dx * ay - dy * ax], dim=1))
    height = points[:, 2:3, 1:-1, 1:-1].nan_to_num(LOWEST).clamp(LOWEST, HIGHEST)
    return torch.cat([height * HEIGHT_GAIN, normal], dim=1)


def unit(vectors: Tensor) -> Tensor:
    """Vectors (B, 3, h, w) at length 1; zero where they are zero or NaN. Several times as fast as `Tensor.norm`."""
    x, y, z = vectors.unbind(1)
    squared = x * x + y * y + z * z
    return (vectors * squared.rsqrt()[:, None]).nan_to_num(0.0, 0.0, 0.0)


def picture_features(depth: np.ndarray, camera: Pinhole) -> Tensor:
    """The channels of one whole picture: float32 (H, W) to (4, H, W)."""
    return stack_features(torch.from_numpy(depth.astype(np.float32, copy=False))[None], camera)[0]


def stack_features(depth: Tensor, camera: Pinhole) -> Tensor:
    """The channels of whole pictures; at their borders the nearest pixel stands in for the missing neighbour.

    Shapes:
        depth: float32 (B, H, W), board units, 0 where nothing was hit.
        returns: float32 (B, 4, H, W), on the device of `depth`.
    """
    height, width = depth.shape[-2:]
    rows = torch.arange(-1, height + 1, device=depth.device).clamp(0, height - 1)[None]
    columns = torch.arange(-1, width + 1, device=depth.device).clamp(0, width - 1)[None]
    padded = functional.pad(depth[:, None], (1, 1, 1, 1), mode="replicate")[:, 0]
    return depth_features(camera.points(padded, rows, columns))


def update_features(features: Tensor, before: np.ndarray, depth: np.ndarray, camera: Pinhole) -> np.ndarray:
    """Turn the channels of a picture into those of one that differs little from it, in place.

    Shapes:
        features: float32 (4, H, W), of `before`.
        before, depth: float32 (H, W), board units, 0 where nothing was hit.
        returns: uint8 (H, W), 1 where they may have changed.
    """
    changed = cv2.dilate((depth != before).view(np.uint8), np.ones((3, 3), np.uint8))  # normals reach a pixel far
    for place in rectangles(changed, APART):
        rows, columns = (
            torch.arange(side.start - 1, side.stop + 1).clamp(0, size - 1)
            for side, size in zip(place, depth.shape, strict=True)
        )
        part = torch.from_numpy(depth)[rows[:, None], columns].float()
        features[:, *place] = depth_features(camera.points(part[None], rows[None], columns[None]))[0]
    return changed


def rectangles(mask: np.ndarray, tile: int) -> list[Box]:
    """Of uint8 (H, W), rows and columns around what is set: one for all that is connected, of whole tiles.

    Args:
        tile: side of the squares that are told apart, a power of two.
    """
    if not mask.any():
        return []
    height, width = mask.shape
    if height % tile or width % tile:
        mask = np.pad(mask, ((0, -height % tile), (0, -width % tile)))
    tiles = coarsened(mask, tile)
    found = cv2.connectedComponentsWithStats(tiles)[2][1:, :4] * tile
    return [
        (slice(top, min(height, top + rows)), slice(left, min(width, left + columns)))
        for left, top, columns, rows in found.tolist()
    ]


def coarsened(mask: np.ndarray, cell: int) -> np.ndarray:
    """Cells of so many pixels, a power of two, with any that is set."""
    while cell > 1:
        mask, cell = halved(mask), cell // 2
    return mask


def halved(mask: np.ndarray) -> np.ndarray:
    """Coarser cells with any of the finer ones."""
    rows = mask[::2] | mask[1::2]
    return np.asarray(rows[:, ::2] | rows[:, 1::2])


def heights_of(features: Tensor) -> Tensor:
    """Height above the board in board units, from (..., 4, H, W) to (..., H, W)."""
    return features[..., 0, :, :] / HEIGHT_GAIN


def square_around(pixel: Sequence[int], side: int, height: int, width: int) -> tuple[Any, Any]:
    """Index of the square with (u, v) at (side / 2, side / 2); outside the picture its border is repeated."""
    left, top = (int(middle) - side // 2 for middle in pixel)
    if 0 <= left <= width - side and 0 <= top <= height - side:
        return slice(top, top + side), slice(left, left + side)
    along = np.arange(side)
    return (top + along).clip(0, height - 1)[:, None], (left + along).clip(0, width - 1)


def colour_features(rgb: np.ndarray) -> Tensor:
    """uint8 (..., H, W, 3) to float32 (..., 3, H, W) between -0.5 and 0.5."""
    return torch.from_numpy(np.ascontiguousarray(np.moveaxis(rgb, -1, -3))).float() / 255 - 0.5
