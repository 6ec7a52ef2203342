"""Small patches of one colour on a switch: a key that lies flush with its panel shows there, and hardly in depth.

How many of them are links, by what an interaction model promises at their middle, `benchmarks.studies.policy_constants
patches` counts on training boards.
"""

from dataclasses import dataclass

import cv2
import numpy as np

TOLERANCE = 8
"""Neighbouring pixels are of one colour if no channel, of 255, differs by more."""
LEAST, MOST = 16, 600
"""A patch has so many pixels: less is texture, more is a panel."""
SOLID = 0.6
"""It fills so large a share of the rectangle around it: a rim does not."""


@dataclass(frozen=True)
class Patches:
    """What was found in a picture.

    Attributes:
        labels: int32 (H, W), number of the patch that a pixel is part of, from 1; 0 for none.
        centres: int (P, 2), u and v of a pixel of each, the one nearest to its middle.
    """

    labels: np.ndarray
    centres: np.ndarray


def patches_of(rgb: np.ndarray, boxes: np.ndarray, where: np.ndarray) -> Patches:
    """The patches in some boxes of a picture.

    Args:
        rgb: uint8 (H, W, 3).
        boxes: int (K, 4), u0, v0, u1, v1; what lies outside of the picture is cut off.
        where: bool (H, W), which pixels may be part of one.
    """
    labels, centres = np.zeros(where.shape, np.int32), list[tuple[int, int]]()
    for u0, v0, u1, v1 in np.maximum(boxes, 0).tolist():
        place = slice(v0, v1), slice(u0, u1)
        numbers, counts, around = _of_one_colour(rgb[place], where[place])
        sides = around[:, 1] * around[:, 0]
        for number in np.flatnonzero((counts >= LEAST) & (counts <= MOST) & (counts >= SOLID * sides)).tolist():
            mine = numbers == number
            labels[place][mine] = len(centres) + 1
            column, row = _middle(mine)
            centres.append((u0 + column, v0 + row))
    return Patches(labels, np.array(centres, int).reshape(-1, 2))


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
