"""What changed between two pictures of a camera that has noise, shakes and hangs in changing light.

A clean camera repeats itself to the last bit where nothing happens, so that each pixel that differs tells something. Of
a real one every pixel differs. Whether a camera is clean is read off the pictures themselves.
"""

import cv2
import numpy as np

from busybot.episodes.episode import Observation
from busybot.sim.scene.real_camera import SQUARE, changed_squares

REPEATS = 1
"""Levels of 256 by which half of all channels differ at most where a camera repeats itself; JPEG makes less."""
SPARSE = 16
"""Of so many rows and columns one is looked at to tell that."""
TOLERANCE = 0.1
"""Squares that differ by more, as a share of the range, look otherwise."""
SHAKES = 5
"""Pixels by which two pictures may lie beside each other."""
FRAYED = 2
"""Pixels within which depth at an edge may be that of either side."""
STEP = 0.005
"""Depth that differs by more within `FRAYED` pixels is an edge, board units."""
EDGE_PIXELS = 4000
"""So many of them tell how pictures lie."""
NEARER = 0.9
"""What has less than this share of the least depth is in front of the board: a hand."""


def is_noisy(before: np.ndarray, after: np.ndarray) -> bool:
    """Whether the camera that took two pictures of a board, uint8 (H, W, 3), does not repeat itself."""
    one, other = before[::SPARSE, ::SPARSE], after[::SPARSE, ::SPARSE]
    return bool(np.median(cv2.absdiff(np.ascontiguousarray(one), np.ascontiguousarray(other))) > REPEATS)


def looks_otherwise(before: Observation, after: Observation) -> np.ndarray:
    """Pixels whose colours changed by more than camera and light explain, and that nothing hides, bool (H, W)."""
    height, width = before.depth.shape
    squares = changed_squares(before.rgb, after.rgb, TOLERANCE)
    differs = squares.repeat(SQUARE, axis=0).repeat(SQUARE, axis=1)[:height, :width]
    return differs & ~_hidden(before.depth, after.depth)


def settled_depth(before: np.ndarray, after: np.ndarray, change: float) -> np.ndarray:
    """The depth of the second picture as a camera would see it that neither shakes nor frays edges, float32 (H, W):
    that of the first, except where it truly changed.

    One is laid upon the other. A pixel changed that lies by more than `change` outside of what the other one has around
    it, asked both ways, as in `changed_squares`. Holes, and what hides the board, have not changed.
    """
    after = _shifted(after, *_shake(before, after))
    changed = (_outside(before, after) > change) | (_outside(after, before) > change)
    changed &= (before > 0) & (after > 0) & ~_hidden(before, after)
    return np.where(changed, after, before)


def _hidden(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Pixels, bool (H, W), where something lies before the board in either: its objects are no nearer than in the one
    of both that has nothing there."""
    least = max(np.min(depth, where=depth > 0, initial=np.inf) for depth in (before, after))
    return np.logical_or(*((depth > 0) & (depth < NEARER * least) for depth in (before, after)))


def _range(depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest depth around each pixel, without holes."""
    around = np.ones((2 * FRAYED + 1,) * 2, np.uint8)
    return cv2.erode(np.where(depth > 0, depth, np.float32(np.inf)), around), cv2.dilate(depth, around)


def _outside(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """By how much each pixel lies outside of what the other picture has around it; nothing where that is unknown."""
    low, high = _range(before)
    return np.where(np.isfinite(low), np.maximum(after - high, low - after), 0)


def _shake(before: np.ndarray, after: np.ndarray) -> tuple[int, int]:
    """Rows and columns by which the second picture must be shifted to lie upon the first: most edges agree."""
    low, high = _range(before)
    inside = np.zeros(before.shape, bool)
    inside[SHAKES:-SHAKES, SHAKES:-SHAKES] = True
    rows, columns = np.nonzero(inside & (high - low > STEP) & np.isfinite(low))
    if not len(rows):
        return 0, 0
    some = slice(None, None, -(-len(rows) // EDGE_PIXELS))
    rows, columns = rows[some], columns[some]
    steps = sorted(range(-SHAKES, SHAKES + 1), key=abs)  # of equal ones the smallest wins
    unlike = [
        [int((np.abs(after[rows - down, columns - right] - before[rows, columns]) > STEP).sum()) for right in steps]
        for down in steps
    ]
    down, right = divmod(int(np.argmin(unlike)), len(steps))
    return steps[down], steps[right]


def _shifted(picture: np.ndarray, down: int, right: int) -> np.ndarray:
    """Moved so many rows and columns; its border is repeated."""
    height, width = picture.shape
    rows, columns = (np.arange(height) - down).clip(0, height - 1), (np.arange(width) - right).clip(0, width - 1)
    return picture[np.ix_(rows, columns)]
