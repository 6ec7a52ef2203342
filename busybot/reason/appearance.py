"""Which objects look different after a step: changed pixels, each given to the object that it shows.

A pixel inside an object's first-frame box may show the object, the board, or something that reaches in: a neighbour's
door leaf, a tall neighbour seen at an angle, a lever. Depth tells them apart. Every object has a *home*: the rectangle on
the board over which its visible points lay in the first frame. Layouts keep homes apart, so a raised point above
another place is an intruder. A changed pixel counts when it shows the object before or after, and no intruder at all.

Without depth, pixels inside the box of another object are left out, and all others count.

The constants were chosen on training objects: an unchanged object has 0 counted pixels there, a changed one at least
12 % of its box.
"""

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from busybot.episodes.geometry import Rays
from busybot.reason.observed import Frame, Observed


class ChangeConfig(BaseModel):
    """When an object counts as changed.

    Attributes:
        tolerance: a pixel changed when a channel differs by more than this (of 255). 10 is above what JPEG at quality 90
            does to the unchanged surroundings of a change.
        share: an object changed when more than this share of its box's pixels did.
        least: and more pixels than this.
        elevation: points higher than this above the board belong to an object, board units.
        margin: points so far outside of an object's home still belong to it, board units.
        depth: use depth where it was recorded.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    tolerance: Annotated[int, Field(ge=0, le=254)] = 10
    share: Annotated[float, Field(ge=0, lt=1)] = 0.04
    least: Annotated[int, Field(ge=0)] = 16
    elevation: Annotated[float, Field(gt=0)] = 0.01
    margin: Annotated[float, Field(ge=0)] = 0.03
    depth: bool = True


@dataclass(frozen=True)
class _Region:
    """An object's place in the image and on the board.

    Attributes:
        rows, columns: of its first-frame box.
        alone: bool, box shape: pixels in no other object's box.
        home: x0, y0, x1, y1, board units; None if depth does not tell.
    """

    rows: slice
    columns: slice
    alone: np.ndarray
    home: np.ndarray | None


def changed_pixels(observed: Observed, config: ChangeConfig | None = None) -> np.ndarray:
    """Changed pixels of every object in every step, int (T, N); 0 for objects without a box."""
    config = config or ChangeConfig()
    counts = np.zeros((len(observed.actions), len(observed.roles)), int)
    if not observed.actions:
        return counts
    rays = Rays(observed.camera)
    before = observed.frame(0)
    regions = _regions(observed, before, rays, config)
    for step in range(len(observed.actions)):
        if observed.image_of[step] == observed.image_of[step + 1]:
            continue
        after = observed.frame(step + 1)
        differs = cv2.absdiff(before.rgb, after.rgb).max(-1) > config.tolerance
        for index, region in regions.items():
            counts[step, index] = _count(region, differs, before, after, rays, config)
        before = after
    return counts


def changes(observed: Observed, config: ChangeConfig | None = None) -> np.ndarray:
    """Whether each object's appearance changed in each step, bool (T, N)."""
    config = config or ChangeConfig()
    boxes = observed.boxes.astype(int)
    areas = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
    return changed_pixels(observed, config) > np.maximum(config.least, config.share * areas)


def _regions(observed: Observed, first: Frame, rays: Rays, config: ChangeConfig) -> dict[int, _Region]:
    """The visible objects' regions, by object index."""
    boxes = {i: tuple(int(side) for side in box) for i, box in enumerate(observed.boxes)}
    shown = {i: box for i, box in boxes.items() if 0 <= box[0] < box[2] and 0 <= box[1] < box[3]}
    covered = np.zeros(first.rgb.shape[:2], np.uint8)
    for u0, v0, u1, v1 in shown.values():
        covered[v0:v1, u0:u1] += 1
    regions = {}
    for index, (u0, v0, u1, v1) in shown.items():
        rows, columns = slice(v0, v1), slice(u0, u1)
        alone = covered[rows, columns] == 1
        if not alone.any():
            alone = np.ones_like(alone)
        home = _home(first, alone, rows, columns, rays, config)
        regions[index] = _Region(rows, columns, alone, home)
    return regions


def _home(
    first: Frame, alone: np.ndarray, rows: slice, columns: slice, rays: Rays, config: ChangeConfig
) -> np.ndarray | None:
    """Where the object's raised points lie; None without depth, or if the object is too flat to be told by it."""
    if first.depth is None or not config.depth:
        return None
    points = _points(first, rows, columns, rays)
    raised = alone & (points[..., 2] > config.elevation)
    if raised.sum() <= max(config.least, config.share * alone.size):
        return None
    places = points[raised][:, :2]
    return np.concatenate([places.min(0) - config.margin, places.max(0) + config.margin])


def _count(
    region: _Region, differs: np.ndarray, before: Frame, after: Frame, rays: Rays, config: ChangeConfig
) -> int:
    changed = differs[region.rows, region.columns]
    if not changed.any():
        return 0
    if region.home is None:
        return int((changed & region.alone).sum())
    own_before, other_before = _who(region, before, rays, config)
    own_after, other_after = _who(region, after, rays, config)
    return int((changed & (own_before | own_after) & ~other_before & ~other_after).sum())


def _who(region: _Region, frame: Frame, rays: Rays, config: ChangeConfig) -> tuple[np.ndarray, np.ndarray]:
    """Masks of the box: pixels that show the object, and pixels that show an intruder."""
    assert region.home is not None
    points = _points(frame, region.rows, region.columns, rays)
    raised = points[..., 2] > config.elevation
    x, y = points[..., 0], points[..., 1]
    x0, y0, x1, y1 = region.home
    inside = (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)
    return raised & inside, raised & ~inside


def _points(frame: Frame, rows: slice, columns: slice, rays: Rays) -> np.ndarray:
    """Board-frame positions of the box's pixels, float32 (h, w, 3), NaN where there is no depth."""
    assert frame.depth is not None
    depth = frame.depth[rows, columns]
    points = rays.directions[rows, columns] * depth[..., None] + rays.origin
    points[depth <= 0] = np.nan
    return points
