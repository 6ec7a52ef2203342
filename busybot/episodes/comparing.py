"""Compares pictures of one board that a real camera took: their light, and where more than noise and light differs."""

import cv2
import numpy as np

SQUARE, WINDOW = 4, 21
"""Pictures are compared in squares of so many pixels a side: noise averages out, and a shake moves by one at most.
Light is the same in a window of so many squares a side: what changes is smaller than half of that."""
TOLERANCE = 0.1
"""Pictures differ at a pixel by more than this share of the range."""
DARK, LEVELS = 3, 120
"""Added to the sum of the channels, which is mostly noise where it is dark; levels of brightness to a stop."""


def changed_squares(before: np.ndarray, after: np.ndarray, tolerance: float = TOLERANCE) -> np.ndarray:
    """Where two photos, uint8 (H, W, 3), differ by more than camera and light would explain: bool, squares of `SQUARE`
    pixels.

    One is made as bright as the other, against drift and shadows. A square differs if a channel lies more than
    tolerance * 255 outside of what the other photo has in the 3 x 3 around it, against shake and blur; asked both ways,
    because what is thin can vanish. A hand does count.
    """
    first, second = in_squares(before), in_squares(after)
    second *= light_between(first, second)[..., None]
    margin, around = np.float32(tolerance * 255), np.ones((3, 3), np.uint8)
    differs = np.zeros(first.shape[:2], bool)
    for one, other in ((first, second), (second, first)):
        outside = np.maximum(one - cv2.dilate(other, around), cv2.erode(other, around) - one)
        differs |= (outside > margin).any(axis=-1)
    return differs


def in_pixels(squares: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """What is told of squares, of their pixels: (H, W).

    Args:
        size: H and W.
    """
    return squares.repeat(SQUARE, axis=0).repeat(SQUARE, axis=1)[: size[0], : size[1]]


def in_squares(rgb: np.ndarray) -> np.ndarray:
    """Means of squares of `SQUARE` pixels, float32 (h, w, 3), of uint8 (H, W, 3)."""
    size = (-(-rgb.shape[1] // SQUARE), -(-rgb.shape[0] // SQUARE))
    return cv2.resize(rgb, size, interpolation=cv2.INTER_AREA).astype(np.float32)


def light_between(first: np.ndarray, other: np.ndarray, size: tuple[int, int] | None = None) -> np.ndarray:
    """By how much brighter it was around each square of the first, between a half and twice: the median ratio there.

    Args:
        first, other: of `in_squares`.
        size: columns and rows to interpolate to; those of squares by default.

    Returns:
        float32 (rows, columns).
    """
    stops = np.log2((first.sum(axis=-1) + DARK) / (other.sum(axis=-1) + DARK)).clip(-1, 1)
    levels = cv2.medianBlur((128 + LEVELS * stops).round().astype(np.uint8), WINDOW)
    levels = levels if size is None else cv2.resize(levels, size)
    return np.asarray(np.exp2((levels.astype(np.float32) - 128) / LEVELS))
