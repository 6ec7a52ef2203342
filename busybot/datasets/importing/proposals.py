"""Boxes and roles that nobody gave, proposed from what moves in the pictures, and from depth where it was recorded.

Pixels that a step changed belong to an object; places that lie together are one. With depth, an object is what stands
raised there; what stands raised and never changed is one by request. It is a trigger if actions on it changed it more
often than others did, else a responder. Actions on places where nothing ever changed make triggers, too. Proposals are
to be looked at: `busybot annotate` shows them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from busybot.common.errors import naming
from busybot.datasets.importing.recording import KnownObject, Recording, acted_pixel, image_camera, refuse_large
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Camera

TOLERANCE = 16
"""A pixel changed when a channel of the blurred picture differs by more (of 255)."""
BLUR = 5
LEAST = 2e-4
"""An object covers so large a share of the picture at least,"""
MOST = 0.15
"""and at most: what is larger is light, or somebody's arm."""
JOIN = 0.008
"""Changed places this near are one object, share of the picture's width."""
RIBS = 0.005
"""What stands this near is one object, as the keys of a keyboard; neighbours on a board are farther apart."""
ELEVATION = 0.02
"""What is higher above the board stands on it, board units."""
MAX_OBJECTS = 64


@dataclass
class _Place:
    """A part of the picture: which pixels, bool (H, W); in how many steps it changed, in how many of these somebody
    acted on it, and in how many of all."""

    mask: np.ndarray
    changed: int = 0
    own: int = 0
    acted: int = 0

    def moves(self, steps: int) -> bool:
        """Whether actions on it change it more often than others do; of what never changed whether there were any."""
        if not self.changed:
            return self.acted > 0
        return self.own * (steps - self.acted) > (self.changed - self.own) * self.acted


@dataclass(frozen=True)
class Proposal:
    """An object that may be there.

    Attributes:
        box: u0, v0, u1, v1 (exclusive) in the first picture.
    """

    role: Literal["trigger", "responder"]
    box: tuple[int, int, int, int]


def propose_objects(recording: Recording) -> list[KnownObject]:
    """Objects with boxes and roles; all pictures are decoded."""
    refuse_large(recording)
    camera, pixels = recording.camera or image_camera(*recording.size), []
    for action, shown in zip(recording.actions, recording.shown, strict=False):  # the last picture is of no action
        with naming(action.where):
            pixels.append(acted_pixel(action, camera, shown))
    found = propose(recording.pictures(), pixels, camera)
    return [
        KnownObject("", one.role, one.box, None, f"{recording.place}: proposed object {number}")
        for number, one in enumerate(found)
    ]


def propose(
    pictures: Iterable[tuple[np.ndarray, np.ndarray | None]],
    pixels: Sequence[tuple[int, int] | None],
    camera: Camera,
    still: bool = False,
) -> list[Proposal]:
    """Triggers, then responders, each from the top to the bottom.

    Args:
        pictures: T + 1 times RGB uint8 (H, W, 3) and depth (H, W), None without depth.
        pixels: T times where was acted between them, (u, v).
        still: whether what stands there is proposed, too, if nothing changed it: as a trigger where somebody acted on
            it, else as a responder.
    """
    steps, raised = _changes(pictures, camera)
    width, height = camera.width, camera.height
    reach = max(1, round(JOIN * width))
    kernel = np.ones((2 * reach + 1,) * 2, np.uint8)
    every = np.zeros((height, width), np.uint8)
    for changed in steps:
        every |= changed
    places = [_Place(part) for part in _parts(cv2.morphologyEx(every, cv2.MORPH_CLOSE, kernel))]
    if raised is not None:
        ribbed = np.ones((2 * max(1, round(RIBS * width)) + 1,) * 2, np.uint8)
        places = _standing(places, _parts(cv2.morphologyEx(raised, cv2.MORPH_CLOSE, ribbed)), still)
    for changed, pixel in zip(steps, pixels, strict=True):
        for place in places:
            acted = pixel is not None and _holds(_box(place.mask), pixel, reach)
            differs = int((changed > 0)[place.mask].sum()) > LEAST / 4 * width * height
            place.changed, place.own = place.changed + differs, place.own + (acted and differs)
            place.acted += acted
    found = [Proposal("trigger" if one.moves(len(pixels)) else "responder", _box(one.mask)) for one in places]
    sides = [max(one.box[2] - one.box[0], one.box[3] - one.box[1]) for one in found]
    half = max(1, (int(np.median(sides)) if sides else width // 16) // 2)
    for pixel in pixels:
        if pixel is not None and not any(_holds(one.box, pixel, reach) for one in found):
            u, v = pixel
            box = (max(0, u - half), max(0, v - half), min(width, u + half), min(height, v + half))
            found.append(Proposal("trigger", box))
    found.sort(key=lambda one: (one.role != "trigger", one.box[1], one.box[0]))
    return found[:MAX_OBJECTS]


def _changes(
    pictures: Iterable[tuple[np.ndarray, np.ndarray | None]], camera: Camera
) -> tuple[list[np.ndarray], np.ndarray | None]:
    """Pixels that each step changed, and those that stand raised at the beginning, uint8 (H, W) each; None without
    depth."""
    before, raised = None, None
    steps: list[np.ndarray] = []
    for rgb, depth in pictures:
        smooth = cv2.GaussianBlur(rgb, (BLUR, BLUR), 0)
        if before is None and depth is not None:
            heights = Rays(camera).heights(depth)
            raised = (np.nan_to_num(heights) > ELEVATION).astype(np.uint8)
        if before is not None:
            differs = (cv2.absdiff(before, smooth).max(-1) > TOLERANCE).astype(np.uint8)
            steps.append(cv2.morphologyEx(differs, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)))
        before = smooth
    return steps, raised


def _parts(mask: np.ndarray) -> list[np.ndarray]:
    """Connected parts of a sensible size, bool (H, W) each, the largest first."""
    count, labels, facts, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    areas = facts[1:, cv2.CC_STAT_AREA]
    kept = [number for number in range(1, count) if LEAST * mask.size <= areas[number - 1] <= MOST * mask.size]
    return [labels == number for number in sorted(kept, key=lambda number: -areas[number - 1])]


def _standing(places: list[_Place], raised: list[np.ndarray], still: bool) -> list[_Place]:
    """What moves at an object that stands there is that object; what moves where nothing stands stays, and what stands
    still only if that is asked for."""
    owners = [max(range(len(raised)), key=lambda n: int((raised[n] & p.mask).sum()), default=-1) for p in places]
    owners = [n if n >= 0 and (raised[n] & p.mask).any() else -1 for n, p in zip(owners, places, strict=True)]
    kept = [place for owner, place in zip(owners, places, strict=True) if owner < 0]
    return kept + [_Place(raised[n]) for n in (range(len(raised)) if still else sorted(set(owners) - {-1}))]


def _box(mask: np.ndarray) -> tuple[int, int, int, int]:
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def _holds(box: tuple[int, int, int, int], pixel: tuple[int, int], reach: int) -> bool:
    u0, v0, u1, v1 = box
    return u0 - reach <= pixel[0] < u1 + reach and v0 - reach <= pixel[1] < v1 + reach
