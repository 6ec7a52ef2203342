"""Which part of the picture moved with the link that the agent held."""

import cv2
import numpy as np

from busybot.interact.policy_config import PolicyConfig


def moved_window(
    before: np.ndarray, after: np.ndarray, pixel: tuple[int, int], reach: int, change: float
) -> np.ndarray:
    """Pixels near (u, v) whose depth changed, bool (H, W).

    Args:
        before, after: depth images, float32 (H, W), board units.
        reach: how near in rows and columns, pixels.
        change: smaller differences are none, board units.
    """
    moved = np.zeros(before.shape, bool)
    rows, columns = (slice(max(middle - reach, 0), middle + reach + 1) for middle in reversed(pixel))
    moved[rows, columns] = np.abs(after[rows, columns] - before[rows, columns]) > change
    return moved


def moved_region(
    before: np.ndarray, after: np.ndarray, pixel: tuple[int, int], body: np.ndarray, config: PolicyConfig
) -> np.ndarray:
    """The link under the action: pixels near it whose depth changed, closed, connected to it or on the same body.

    Args:
        before, after: depth images, float32 (H, W), board units.
        pixel: where the agent held, (u, v).
        body: bool (H, W), the object that the pixel belongs to. A link that jumped leaves two places behind, where it
            was and where it is: they need not be connected, but both are on its object.

    Returns:
        bool (H, W); holds the pixel in any case.
    """
    moved = moved_window(before, after, pixel, config.reach, config.change).astype(np.uint8)
    disc = np.asarray(cv2.circle(np.zeros(moved.shape, np.uint8), pixel, config.disc, 1, -1), np.uint8)
    _, labels = cv2.connectedComponents(cv2.morphologyEx(moved | disc, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)))
    on_body = np.unique(labels[(moved > 0) & body])
    mine = np.isin(labels, [labels[pixel[1], pixel[0]], *on_body[on_body > 0]])
    # the disc reaches what moved beside it, but is a region of its own only where nothing moved
    region = mine & ((disc == 0) | (moved > 0)) if (mine & (moved > 0)).any() else mine
    region[pixel[1], pixel[0]] = True
    return np.asarray(region)


def enlarged(region: np.ndarray) -> np.ndarray:
    """A region (H, W) and the pixels next to it."""
    return cv2.dilate(region.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
