"""Makes the pictures of a camera that shakes, rustles and drifts comparable: what a real camera adds is taken away.

Whether a recording needs it is told by itself: where nothing was touched, most pixels of two pictures of a perfect
camera are equal. If they are in all pictures, the recording is left as it is, to the last bit. Else each picture is

- moved back onto the one that the boxes are of, by the shift at which the two correlate best;
- made as bright as that one, by the median ratio around each place: what changes is smaller than half of the window,
  and what is too bright for the camera is as bright as it was there;
- smoothed, as depth is, by about the size of what a sensor does to an edge.

What a hand hides is not mended: masks tell it by its depth (`object_masks`).
"""

from dataclasses import replace

import cv2
import numpy as np

from busybot.episodes.comparing import in_squares, light_between
from busybot.episodes.episode import Image
from busybot.reason.inputs.observation import NO_BOXES, Frame, ObservedEpisode

SHIFT, MOST = 16, 1.0
"""No camera shakes by more pixels: a larger shift was not found, but made up. So was one that leaves the picture's
details no more like those of the other one, where they differ by so many stops at most."""
FINE, COARSE = 1.0, 8.0
"""Details are coarser than a sensor's noise and finer than light: deviations of the smoothings that tell, in pixels of
the smaller picture. Grey values would not do: under another exposure they differ everywhere, however they lie."""
HALF = 2
"""Pictures are correlated in squares of so many pixels a side: the shift is found to a tenth of one."""
BRIGHTEST = 245
"""A channel that is as bright, but for noise, is as bright as the camera can tell, or brighter."""
SMOOTH, EDGE = 1.0, 5
"""Deviation of the smoothing of colours, and window of the median of depth, pixels."""


class Steady:
    """Steadies pictures of one board.

    Args:
        observed: tells whether its pictures need it, and which one the others are moved onto.

    Attributes:
        needed: whether they do.
    """

    def __init__(self, observed: ObservedEpisode):
        self._first = observed.boxed
        self.needed = still_pictures(observed) < len(pictures_of(observed))

    def of(self, frame: Frame) -> Frame:
        """The picture, comparable with the others."""
        if not self.needed:
            return frame
        moved = _moved_back(frame, self._first)
        rgb = cv2.GaussianBlur(_as_bright(moved.rgb, self._first.rgb), (0, 0), SMOOTH)
        return Frame(rgb, None if moved.depth is None else cv2.medianBlur(moved.depth, EDGE))


def steadied(observed: ObservedEpisode) -> ObservedEpisode:
    """The recording with pictures that differ where the board does; the same recording if all of them already do."""
    steady = Steady(observed)
    if not steady.needed:
        return observed
    images = list(observed.images)
    for one in pictures_of(observed):
        frame = steady.of(Frame(images[one].rgb, images[one].depth))
        images[one] = Image(frame.rgb, frame.depth, None, NO_BOXES)
    return replace(observed, images=images)


def still_pictures(observed: ObservedEpisode, known: int = 1) -> int:
    """How many pictures, of `pictures_of` the first ones, are those of a perfect camera: of most pixels, the next one
    tells the same.

    Args:
        known: so many of them are, as is known of a part of the recording.
    """
    pictures = pictures_of(observed)
    before = cv2.cvtColor(observed.images[pictures[known - 1]].rgb, cv2.COLOR_RGB2GRAY)
    for number, one in enumerate(pictures[known:], start=known):
        after = cv2.cvtColor(observed.images[one].rgb, cv2.COLOR_RGB2GRAY)
        if 2 * cv2.countNonZero(cv2.absdiff(before, after)) >= before.size:
            return number
        before = after
    return len(pictures)


def pictures_of(observed: ObservedEpisode) -> list[int]:
    """Indices of the pictures, as they are first shown: that with the boxes, and those of all frames."""
    boxed = observed.image_of[0] if observed.boxed_in is None else observed.boxed_in
    return list(dict.fromkeys((boxed, *observed.image_of)))


def _moved_back(frame: Frame, first: Frame) -> Frame:
    height, width = frame.rgb.shape[:2]
    size = (width // HALF, height // HALF)
    small = [cv2.resize(one.rgb, size, interpolation=cv2.INTER_AREA) for one in (first, frame)]
    there, here = (cv2.cvtColor(one, cv2.COLOR_RGB2GRAY).astype(np.float32) for one in small)
    shift, _ = cv2.phaseCorrelate(there, here, cv2.createHanningWindow(size, cv2.CV_32F))
    right, down = (HALF * side for side in shift)
    moved = _shifted(here, *shift)
    if max(abs(right), abs(down)) > SHIFT or _unlike(there, moved) >= _unlike(there, here):
        return frame
    rgb = _shifted(frame.rgb, right, down)
    if frame.depth is None:
        return Frame(rgb, None)
    rows, columns = (np.arange(side) + round(shift) for side, shift in ((height, down), (width, right)))
    return Frame(rgb, frame.depth[np.ix_(rows.clip(0, height - 1), columns.clip(0, width - 1))])


def _shifted(picture: np.ndarray, right: float, down: float) -> np.ndarray:
    """The picture moved left and up by so many pixels."""
    back = np.array([[1, 0, -right], [0, 1, -down]])
    return cv2.warpAffine(picture, back, picture.shape[1::-1], borderMode=cv2.BORDER_REPLICATE)


def _unlike(one: np.ndarray, other: np.ndarray) -> float:
    """Mean difference of details, in which what moved on the board counts no more than the rest.

    The border, which a picture that was moved does not show, is left out.
    """
    edge = min(SHIFT // HALF, min(one.shape) // 4)
    inner = np.abs(_details(one) - _details(other))[edge:-edge, edge:-edge]
    return float(np.minimum(inner, MOST).mean())


def _details(grey: np.ndarray) -> np.ndarray:
    stops = np.log2(grey + 8)  # dark pixels are mostly noise
    return np.asarray(cv2.GaussianBlur(stops, (0, 0), FINE) - cv2.GaussianBlur(stops, (0, 0), COARSE))


def _as_bright(rgb: np.ndarray, first: np.ndarray) -> np.ndarray:
    """In the light of the first picture. What is too bright for the camera may be any brighter there, as bright as it
    was then."""
    light = light_between(in_squares(first), in_squares(rgb), rgb.shape[1::-1])
    bright = np.asarray((rgb * light[..., None]).round().clip(0, 255), np.uint8)
    return np.where(rgb >= BRIGHTEST, np.maximum(bright, first), bright)
