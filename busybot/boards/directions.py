"""The 18 directions in which the gripper may move (paper section 4.1).

All vectors of {-1, 0, 1}^3 with one or two non-zero entries, normalised: the 6 faces and 12 edges of a cube. Frame:
the board's (x right, y up in the picture, z towards the camera). The order is that of numpy's C-order indices.
"""

from collections.abc import Sequence

import numpy as np

from busybot.common.errors import BusybotError

_GRID = np.array([d for d in np.ndindex(3, 3, 3)]) - 1
_CHOSEN = _GRID[(np.abs(_GRID).sum(1) > 0) & (np.abs(_GRID).sum(1) < 3)].astype(np.float64)

DIRECTIONS: np.ndarray = _CHOSEN / np.linalg.norm(_CHOSEN, axis=1, keepdims=True)
"""Unit vectors, shape (18, 3), float64."""

OPPOSITE: np.ndarray = np.argmin(((DIRECTIONS[:, None] + DIRECTIONS[None]) ** 2).sum(-1), axis=1)
"""Index of the opposite direction, shape (18,)."""

_WORDS = {
    "left": (-1, 0, 0),
    "right": (1, 0, 0),
    "up": (0, 1, 0),
    "down": (0, -1, 0),
    "press": (0, 0, -1),
    "pull": (0, 0, 1),
}
DIRECTION_HINT = f"write {', '.join(_WORDS)}, two of them as up-left, or a number from 0 to {len(DIRECTIONS) - 1}"


def direction_of(vector: Sequence[float]) -> int:
    """The direction nearest to a vector of the board's frame.

    Raises:
        BusybotError: the vector has no length.
    """
    if not np.linalg.norm(vector) > 0:
        raise BusybotError("a direction without length", DIRECTION_HINT)
    return int(np.argmax(DIRECTIONS @ np.asarray(vector, float)))


def annotated_directions(vectors: Sequence[Sequence[float]], yaw: float) -> np.ndarray:
    """Unit vectors float64 (n, 3) in the board's frame of directions in which an object's annotation says that it can
    be moved.

    Args:
        vectors: of any length but none, in the frame of the object as it stands where it is not turned.
        yaw: how far it is turned about z, radians.
    """
    x, y, z = np.array(vectors, float).reshape(-1, 3).T
    cos, sin = np.cos(yaw), np.sin(yaw)
    turned = np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=1)
    return np.asarray(turned / np.linalg.norm(turned, axis=1, keepdims=True))


def direction_named(text: str) -> int:
    """The direction that a cell names: words, or its number.

    Raises:
        BusybotError: it names none.
    """
    cell = text.strip().lower()
    if cell.isascii() and cell.isdigit():
        if int(cell) < len(DIRECTIONS):
            return int(cell)
        raise BusybotError(f"there are {len(DIRECTIONS)} directions, not {cell[:20]}", DIRECTION_HINT)
    words = [_WORDS.get(word) for word in cell.split("-")]
    vector = np.sum([word for word in words if word is not None], axis=0)
    if None in words or not 1 <= len(words) <= 2 or np.count_nonzero(vector) != len(words):
        raise BusybotError(f"{text[:40]!r} is no direction", DIRECTION_HINT)
    return direction_of(vector)
