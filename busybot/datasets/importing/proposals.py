"""Boxes and roles that nobody gave, proposed from what moves in the pictures, and from depth where it was recorded.

Pixels that a step changed belong to an object; places that lie together are one. With depth, an object is what stands
raised there. It is a trigger if most of the steps that changed it were actions on it, else a responder. Actions on
places where nothing ever changed make triggers, too. Proposals are to be looked at: `busybot annotate` shows them.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from busybot.datasets.importing.recording import KnownObject, Recording, image_camera
from busybot.episodes.camera import Rays

TOLERANCE = 16
"""A pixel changed when a channel of the blurred picture differs by more (of 255)."""
BLUR = 5
LEAST = 2e-4
"""An object covers so large a share of the picture at least,"""
MOST = 0.15
"""and at most: what is larger is light, or somebody's arm."""
JOIN = 0.008
"""Changed places this near are one object, share of the picture's width."""
ELEVATION = 0.02
"""What is higher above the board stands on it, board units."""
MAX_OBJECTS = 64


@dataclass
class _Place:
    """A part of the picture: which pixels, bool (H, W), and in how many steps it changed, and how many of them acted on
    it."""

    mask: np.ndarray
    changed: int = 0
    own: int = 0


def propose_objects(recording: Recording) -> list[KnownObject]:
    """Objects with boxes and roles; all pictures are decoded."""
    steps, raised = _changes(recording)
    width, height = recording.size
    reach = max(1, round(JOIN * width))
    kernel = np.ones((2 * reach + 1,) * 2, np.uint8)
    every = np.zeros((height, width), np.uint8)
    for changed in steps:
        every |= changed
    places = [_Place(part) for part in _parts(cv2.morphologyEx(every, cv2.MORPH_CLOSE, kernel))]
    if raised is not None:
        places = _standing(places, _parts(raised))
    for changed, action in zip(steps, recording.actions, strict=True):
        for place in places:
            if int((changed > 0)[place.mask].sum()) > LEAST / 4 * width * height:
                place.changed += 1
                place.own += action.pixel is not None and _holds(_box(place.mask), action.pixel, reach)
    found = [(_box(place.mask), "trigger" if 2 * place.own > place.changed else "responder") for place in places]
    side = int(np.median([max(box[2] - box[0], box[3] - box[1]) for box, _ in found])) if found else width // 16
    boxes = [box for box, _ in found]
    for action in recording.actions:
        if action.pixel is not None and not any(_holds(box, action.pixel, reach) for box in boxes):
            (u, v), half = action.pixel, side // 2
            boxes.append((max(0, u - half), max(0, v - half), min(width, u + half), min(height, v + half)))
            found.append((boxes[-1], "trigger"))
    found.sort(key=lambda one: (one[1] != "trigger", one[0][1], one[0][0]))
    return [
        KnownObject("", role, box, None, f"{recording.place}: proposed object {number}")
        for number, (box, role) in enumerate(found[:MAX_OBJECTS])
    ]


def _changes(recording: Recording) -> tuple[list[np.ndarray], np.ndarray | None]:
    """Pixels that each step changed, and those that stand raised at the beginning, uint8 (H, W) each; None without
    depth."""
    before, raised = None, None
    steps: list[np.ndarray] = []
    for rgb, depth in recording.pictures():
        smooth = cv2.GaussianBlur(rgb, (BLUR, BLUR), 0)
        if before is None and depth is not None:
            heights = Rays(recording.camera or image_camera(*recording.size)).heights(depth)
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


def _standing(places: list[_Place], raised: list[np.ndarray]) -> list[_Place]:
    """What moves at an object that stands there is that object; what moves where nothing stands stays."""
    owners = [max(range(len(raised)), key=lambda n: int((raised[n] & p.mask).sum()), default=-1) for p in places]
    owners = [n if n >= 0 and (raised[n] & p.mask).any() else -1 for n, p in zip(owners, places, strict=True)]
    kept = [place for owner, place in zip(owners, places, strict=True) if owner < 0]
    return kept + [_Place(raised[number]) for number in sorted(set(owners) - {-1})]


def _box(mask: np.ndarray) -> tuple[int, int, int, int]:
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def _holds(box: tuple[int, int, int, int], pixel: tuple[int, int], reach: int) -> bool:
    u0, v0, u1, v1 = box
    return u0 - reach <= pixel[0] < u1 + reach and v0 - reach <= pixel[1] < v1 + reach
