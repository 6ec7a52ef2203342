"""Small patches of one colour on a switch: a key that lies flush with its panel shows there, and hardly in depth.

How many of them are links, by what an interaction model believes of candidates on them, `benchmarks.studies.
policy_constants patches` counts on training boards. Sizes are pixels, as all of a policy's constants.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

TOLERANCE = 8
"""Neighbouring pixels are of one colour if no channel, of 255, differs by more."""
LEAST, MOST = 16, 600
"""A patch has so many pixels: less is texture, more is a panel."""
SIDE, SOLID = 3, 0.6
"""The rectangle around it has at least so long sides, and is filled to so large a share: a line is none, nor a rim."""
STEEPER, EVEN = 1.8, -2.0
"""The logit of what a model believes of a candidate is, on a patch, so many times as far from the latter: patches of
which it believes little are seldom links, others oftener than it believes."""
PATCHES = {
    "tolerance": TOLERANCE, "least": LEAST, "most": MOST, "side": SIDE, "solid": SOLID,
    "steeper": STEEPER, "even": EVEN,
}  # fmt: skip
"""All of these, as recordings tell them."""


@dataclass(frozen=True)
class Patches:
    """What was found in a picture.

    Attributes:
        labels: int32 (H, W), number of the patch that a pixel is part of, from 1; 0 for none.
        centres: int (P, 2), u and v of a pixel of each, the one nearest to its middle.
    """

    labels: np.ndarray
    centres: np.ndarray

    def at(self, pixels: np.ndarray) -> np.ndarray:
        """The labels of pixels (K, 2), int (K,); 0 outside of the picture."""
        height, width = self.labels.shape
        columns, rows = pixels.T
        inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        return np.where(inside, self.labels[rows * inside, columns * inside], 0)

    def middles_without(self, pixels: np.ndarray, radius: int) -> np.ndarray:
        """The centres so near which none of the pixels (K, 2) is on the patch, int (N, 2)."""
        near = np.abs(self.centres[:, None] - pixels).max(axis=2, initial=0) <= radius
        mine = self.at(pixels) == np.arange(1, len(self.centres) + 1)[:, None]
        return np.asarray(self.centres[~(near & mine).any(axis=1)])

    def elsewhere(self, failed: np.ndarray, pixels: np.ndarray) -> np.ndarray:
        """Which failures, at pixels (F, 2), took hold of something else than the patch that one of the pixels (K, 2) is
        on, bool (F, K)."""
        own = self.at(pixels)
        return np.asarray((own > 0) & (self.at(failed)[:, None] != own))


def patches_of(rgb: np.ndarray, boxes: np.ndarray, where: np.ndarray) -> Patches:
    """The patches in some boxes of a picture.

    Args:
        rgb: uint8 (H, W, 3).
        boxes: int (K, 4), u0, v0, u1, v1; what lies outside of the picture is cut off.
        where: bool (H, W), which pixels may be part of one.
    """
    labels, centres = np.zeros(where.shape, np.int32), list[tuple[int, int]]()
    if not len(boxes):
        return Patches(labels, np.zeros((0, 2), int))
    inside = np.zeros(where.shape, np.uint8)
    for u0, v0, u1, v1 in np.maximum(boxes, 0).tolist():
        inside[v0:v1, u0:u1] = 1
    where = where & (inside > 0)
    _, _, together, _ = cv2.connectedComponentsWithStats(inside)  # boxes that overlap are looked at as one
    for left, top, width, height, _ in together[1:].tolist():
        place = slice(top, top + height), slice(left, left + width)
        numbers, counts, sides = _of_one_colour(rgb[place], where[place])
        solid = (sides.min(axis=1) >= SIDE) & (counts >= SOLID * sides.prod(axis=1))
        for number in np.flatnonzero(solid & (counts >= LEAST) & (counts <= MOST)).tolist():
            mine = numbers == number
            labels[place][mine] = len(centres) + 1
            column, row = _middle(mine)
            centres.append((left + column, top + row))
    return Patches(labels, np.array(centres, int).reshape(-1, 2))


def on_patches(logits: Any) -> Any:
    """What is believed of candidates on patches, logits, from what a model believes of them as of any others."""
    return STEEPER * (logits - EVEN)


def from_patches(logits: Any) -> Any:
    """The inverse of `on_patches`."""
    return logits / STEEPER + EVEN


def _of_one_colour(rgb: np.ndarray, where: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Connected pixels of one colour: their numbers (h, w), how many there are of each, and the rows and columns that
    each spans; nothing is counted of number 0, which is nowhere.

    Between two pixels of a grid twice as fine there is a third one, which is set if they are of one colour.
    """
    if not where.any():
        return np.zeros(where.shape, np.int32), np.zeros(1, int), np.zeros((1, 2), int)
    rows, columns = where.shape
    fine, colour = np.zeros((2 * rows - 1, 2 * columns - 1), np.uint8), rgb.astype(np.int16)
    fine[::2, ::2] = where
    fine[::2, 1::2] = _alike(colour[:, 1:], colour[:, :-1]) & where[:, 1:] & where[:, :-1]
    fine[1::2, ::2] = _alike(colour[1:], colour[:-1]) & where[1:] & where[:-1]
    _, numbers, around, _ = cv2.connectedComponentsWithStats(fine, connectivity=4)
    numbers = numbers[::2, ::2]
    counts = np.bincount(numbers.ravel(), minlength=len(around))
    counts[0] = 0
    return numbers, counts, around[:, [cv2.CC_STAT_HEIGHT, cv2.CC_STAT_WIDTH]] // 2 + 1


def _alike(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.asarray(np.abs(one - other).max(axis=-1) <= TOLERANCE)


def _middle(mine: np.ndarray) -> tuple[int, int]:
    """Of the pixels that are set, bool (h, w), the column and row of the one nearest to the mean of all."""
    rows, columns = np.nonzero(mine)
    nearest = int(((columns - columns.mean()) ** 2 + (rows - rows.mean()) ** 2).argmin())
    return int(columns[nearest]), int(rows[nearest])
