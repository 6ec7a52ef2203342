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
    """A part of the picture: u0, v0, u1, v1 around it; in how many steps it changed, in how many of these somebody
    acted on it, and in how many of all."""

    box: tuple[int, int, int, int]
    changed: int = 0
    own: int = 0
    acted: int = 0

    def moves(self, steps: int) -> bool:
        """Whether actions on it change it more often than others do; of what never changed whether there were any."""
        if not self.changed:
            return self.acted > 0
        return self.own * (steps - self.acted) > (self.changed - self.own) * self.acted


@dataclass(frozen=True)
class _Parts:
    """Parts of the picture, none of which overlap: int (H, W), the number of each pixel's, from 1 on, or 0; and u0, v0,
    u1, v1 around each."""

    labels: np.ndarray
    boxes: list[tuple[int, int, int, int]]

    def only(self, kept: Sequence[int] | np.ndarray) -> "_Parts":
        """Some of them, counted from 0."""
        numbers = np.zeros(len(self.boxes) + 1, int)
        numbers[np.asarray(kept, int) + 1] = np.arange(len(kept)) + 1
        return _Parts(numbers[self.labels], [self.boxes[one] for one in kept])


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
        every |= np.unpackbits(changed, axis=1, count=width)
    parts = _parts(cv2.morphologyEx(every, cv2.MORPH_CLOSE, kernel))
    if raised is not None:
        ribbed = np.ones((2 * max(1, round(RIBS * width)) + 1,) * 2, np.uint8)
        parts = _standing(parts, _parts(cv2.morphologyEx(raised, cv2.MORPH_CLOSE, ribbed)), still)
    places = [_Place(box) for box in parts.boxes]
    for changed, pixel in zip(steps, pixels, strict=True):
        touched = parts.labels[np.unpackbits(changed, axis=1, count=width) > 0]
        counts = np.bincount(touched, minlength=len(places) + 1)[1:]
        for place, count in zip(places, counts.tolist(), strict=True):
            acted = pixel is not None and _holds(place.box, pixel, reach)
            differs = count > LEAST / 4 * width * height
            place.changed, place.own = place.changed + differs, place.own + (acted and differs)
            place.acted += acted
    found = [Proposal("trigger" if one.moves(len(pixels)) else "responder", one.box) for one in places]
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
    """Pixels that each step changed, packed as bits, uint8 (H, W / 8) each; and those that stand raised at the
    beginning, uint8 (H, W), None without depth."""
    before, raised = None, None
    steps: list[np.ndarray] = []
    for rgb, depth in pictures:
        smooth = cv2.GaussianBlur(rgb, (BLUR, BLUR), 0)
        if before is None and depth is not None:
            heights = Rays(camera).heights(depth)
            raised = (np.nan_to_num(heights) > ELEVATION).astype(np.uint8)
        if before is not None:
            differs = (cv2.absdiff(before, smooth).max(-1) > TOLERANCE).astype(np.uint8)
            opened = cv2.morphologyEx(differs, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
            steps.append(np.packbits(opened > 0, axis=1))  # thousands are kept
        before = smooth
    return steps, raised


def _parts(mask: np.ndarray) -> _Parts:
    """Connected parts of a sensible size."""
    _, labels, facts, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    areas = facts[1:, cv2.CC_STAT_AREA]
    boxes = [(u, v, u + width, v + height) for u, v, width, height in facts[1:, : cv2.CC_STAT_AREA].tolist()]
    sensible = (LEAST * mask.size <= areas) & (areas <= MOST * mask.size)
    return _Parts(labels, boxes).only(np.flatnonzero(sensible))


def _standing(moving: _Parts, raised: _Parts, still: bool) -> _Parts:
    """What moves at an object that stands there is that object; what moves where nothing stands stays, and what stands
    still only if that is asked for."""
    count = len(raised.boxes) + 1
    pairs = np.bincount((moving.labels * count + raised.labels).ravel(), minlength=(len(moving.boxes) + 1) * count)
    shared = pairs.reshape(-1, count)[1:, 1:]
    loose = ~shared.any(1)
    owners = set() if loose.all() else set(shared[~loose].argmax(1).tolist())
    kept, found = moving.only(np.flatnonzero(loose)), raised.only(range(count - 1) if still else sorted(owners))
    labels = np.where(found.labels > 0, found.labels + len(kept.boxes), kept.labels)
    return _Parts(labels, kept.boxes + found.boxes)


def _holds(box: tuple[int, int, int, int], pixel: tuple[int, int], reach: int) -> bool:
    u0, v0, u1, v1 = box
    return u0 - reach <= pixel[0] < u1 + reach and v0 - reach <= pixel[1] < v1 + reach
