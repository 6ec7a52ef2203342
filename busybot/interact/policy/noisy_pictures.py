"""What changed between two pictures of a camera that has noise, shakes and hangs in changing light.

A clean camera repeats itself to the last bit where nothing happens, so that each pixel that differs tells something. Of
a real one every pixel differs. Whether a camera is clean is read off the colours of the pictures themselves: one that
shakes but has no noise is taken for clean. Pictures that lie more than `SHAKES` pixels apart are not laid upon each
other (`reason.inputs.steady` does so for whole recordings, by their colours; here depth tells, in whole pixels).
"""

import cv2
import numpy as np

from busybot.episodes.comparing import changed_squares, in_pixels
from busybot.episodes.episode import Observation

REPEATS = 1
"""Levels of 256 by which half of all channels differ at most where a camera repeats itself; JPEG makes less."""
SPARSE = 16
"""Of so many rows and columns one is looked at to tell that."""
SHAKES = 5
"""Pixels by which two pictures may lie beside each other: those of a camera that shakes by up to 2.5."""
FRAYED = 2
"""Pixels within which depth at an edge may be that of either side."""
STEP = 0.005
"""Depth that differs by more within `FRAYED` pixels is an edge, board units."""
EDGE_PIXELS = 4000
"""So many of them tell how pictures lie."""
NEARER, RIM = 0.9, 6
"""What has less than this share of the least depth of the board is in front of it: a hand. So many pixels beside it its
colours and its depth are mixed with what is behind."""


def is_noisy(before: np.ndarray, after: np.ndarray) -> bool:
    """Whether the camera that took two pictures of a board, uint8 (H, W, 3), does not repeat itself."""
    one, other = before[::SPARSE, ::SPARSE], after[::SPARSE, ::SPARSE]
    return bool(np.median(cv2.absdiff(np.ascontiguousarray(one), np.ascontiguousarray(other))) > REPEATS)


def least_depth(depth: np.ndarray) -> float:
    """The depth of what is nearest, board units; holes are not; 0 if nothing was seen."""
    seen = depth[depth > 0]
    return float(seen.min()) if seen.size else 0.0


def looks_otherwise(before: Observation, after: Observation, nearest: float) -> np.ndarray:
    """Pixels whose colours changed by more than camera and light explain, and that nothing hides, bool (H, W).

    Args:
        nearest: as of `settled_depth`.
    """
    differs = in_pixels(changed_squares(before.rgb, after.rgb), before.depth.shape)
    return differs & ~_hidden(before.depth, after.depth, nearest)


def settled_depth(before: np.ndarray, after: np.ndarray, change: float, nearest: float) -> np.ndarray:
    """The depth of the second picture as a camera would see it that neither shakes nor frays edges, float32 (H, W):
    that of the first, except where it truly changed.

    One is laid upon the other. A pixel changed that lies by more than `change` outside of what the other one has around
    it, asked both ways, as in `changed_squares`. Holes, and what is hidden, have not changed.

    Args:
        before, after: float32 (H, W), board units.
        change: board units.
        nearest: the least depth of the board and its objects, as far as that is known. A hand may be in both pictures.
    """
    shown = ~_hidden(before, after, nearest)
    after = _shifted(after, *_shake(before, after, shown))
    changed = (_outside(before, after) > change) | (_outside(after, before) > change)
    changed &= (before > 0) & (after > 0) & shown
    return np.where(changed, after, before)


def _hidden(before: np.ndarray, after: np.ndarray, nearest: float) -> np.ndarray:
    """Pixels, bool (H, W), where something lies before the board in either picture, and those beside it."""
    least = NEARER * max(nearest, least_depth(before), least_depth(after))
    found = ((before > 0) & (before < least)) | ((after > 0) & (after < least))
    return cv2.dilate(found.view(np.uint8), np.ones((2 * RIM + 1,) * 2, np.uint8)) > 0


def _range(depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest depth around each pixel, without holes."""
    around = np.ones((2 * FRAYED + 1,) * 2, np.uint8)
    return cv2.erode(np.where(depth > 0, depth, np.float32(np.inf)), around), cv2.dilate(depth, around)


def _outside(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """By how much each pixel lies outside of what the other picture has around it; nothing where that is unknown."""
    low, high = _range(before)
    return np.where(np.isfinite(low), np.maximum(after - high, low - after), 0)


def _shake(before: np.ndarray, after: np.ndarray, shown: np.ndarray) -> tuple[int, int]:
    """Rows and columns by which the second picture must be shifted to lie upon the first: most edges agree of what is
    shown in both, bool (H, W); a hand moves by itself."""
    low, high = _range(before)
    inside = np.zeros(before.shape, bool)
    inside[SHAKES:-SHAKES, SHAKES:-SHAKES] = True
    rows, columns = np.nonzero(inside & shown & (high - low > STEP) & np.isfinite(low))
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
