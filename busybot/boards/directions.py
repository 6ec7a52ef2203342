"""The 18 directions in which the gripper may move (paper section 3.1, protocol "Interaction").

All vectors of {-1, 0, 1}^3 with one or two non-zero entries, normalised: the 6 faces and 12 edges of a cube. Frame:
the board's (x right, y up in the picture, z towards the camera). The order is that of numpy's C-order indices.
"""

import numpy as np

_GRID = np.array([d for d in np.ndindex(3, 3, 3)]) - 1
_CHOSEN = _GRID[(np.abs(_GRID).sum(1) > 0) & (np.abs(_GRID).sum(1) < 3)].astype(np.float64)

DIRECTIONS: np.ndarray = _CHOSEN / np.linalg.norm(_CHOSEN, axis=1, keepdims=True)
"""Unit vectors, shape (18, 3), float64."""

OPPOSITE: np.ndarray = np.argmin(((DIRECTIONS[:, None] + DIRECTIONS[None]) ** 2).sum(-1), axis=1)
"""Index of the opposite direction, shape (18,)."""
