"""Detects which objects look different after a step: changed pixels, each given to the object that it shows.

A changed pixel of an object's box counts when it shows the object before or after, and no intruder at all (see
`reason.inputs.object_masks`).

The constants were chosen on training objects, on boards as they are generated and on crowded ones without margins:
there at most 2 % of an unchanged object's pixels count, and at least 14 % of a changed one's.
"""

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from pydantic import Field

from busybot.reason.inputs.object_masks import MaskConfig, ObjectMasks
from busybot.reason.inputs.observation import ObservedEpisode


class ChangeConfig(MaskConfig):
    """When an object counts as changed.

    Attributes:
        tolerance: a pixel changed when a channel differs by more than this (of 255). 10 is above what JPEG of quality
            90 does to the unchanged surroundings of a change.
        share: an object changed when more than this share of its pixels did.
        least: and more pixels than this.
        elevation, margin, depth: see `MaskConfig`.
    """

    tolerance: Annotated[int, Field(ge=0, le=254)] = 10
    share: Annotated[float, Field(ge=0, lt=1)] = 0.05


@dataclass(frozen=True)
class Counts:
    """Changed pixels.

    Attributes:
        changed: int (T, N), changed pixels of every object in every step; 0 for objects without a box.
        area: int (N,), pixels that showed the object in the first frame.
    """

    changed: np.ndarray
    area: np.ndarray


def count_pixels(observed: ObservedEpisode, config: ChangeConfig | None = None) -> Counts:
    """Count changed pixels per object and step."""
    config = config or ChangeConfig()
    before = observed.frame(0)
    pixels = ObjectMasks(observed, config)
    changed = np.zeros((len(observed.actions), len(observed.roles)), int)
    area = np.zeros(len(observed.roles), int)
    for index in pixels.regions:
        area[index] = int(pixels.masks(index, 0)[0].sum())
    for step in range(len(observed.actions)):
        if observed.image_of[step] == observed.image_of[step + 1]:
            continue
        after = observed.frame(step + 1)
        most = (config.tolerance,) * 3
        differs = cv2.inRange(cv2.absdiff(before.rgb, after.rgb), (0, 0, 0), most) == 0
        for index in pixels.regions:
            changed[step, index] = _count(pixels, index, differs, step)
        before = after
    return Counts(changed, area)


def changes(observed: ObservedEpisode, config: ChangeConfig | None = None) -> np.ndarray:
    """Whether each object's appearance changed in each step, bool (T, N)."""
    config = config or ChangeConfig()
    counts = count_pixels(observed, config)
    return counts.changed > np.maximum(config.least, config.share * counts.area)


def _count(pixels: ObjectMasks, index: int, differs: np.ndarray, step: int) -> int:
    region = pixels.regions[index]
    changed = differs[region.rows, region.columns]
    if not changed.any():
        return 0
    own_before, other_before = pixels.masks(index, step)
    own_after, other_after = pixels.masks(index, step + 1)
    return int((changed & (own_before | own_after) & ~other_before & ~other_after).sum())
