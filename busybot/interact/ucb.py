"""The paper's bonus for places that were not picked yet (section 3.1 "Exploration")."""

from collections.abc import Sequence

import numpy as np


def ucb_bonus(shape: tuple[int, ...], picks: Sequence[tuple[int, int]], c: float = 0.5, window: int = 10) -> np.ndarray:
    """Upper Confidence Bound: c sqrt(ln t / N) for every pixel, float (H, W).

    t counts steps, and N those whose window holds the pixel. The paper does not say what happens where no window holds
    it: N = 0, the bonus infinite. Here both counts include the step that is being decided, as if it picked the pixel:
    t = 1 + earlier picks, N = 1 + earlier picks whose window x window square holds the pixel.

    Args:
        shape: rows and columns of the picture.
        picks: pixels (u, v) chosen on this board so far. A window reaches from window / 2 pixels before its pick to
            window / 2 - 1 after it.
        window: its side, pixels, even.
    """
    counts, half = np.ones(shape), window // 2
    for column, row in picks:
        counts[max(row - half, 0) : row + half, max(column - half, 0) : column + half] += 1
    return c * np.sqrt(np.log(len(picks) + 1) / counts)
