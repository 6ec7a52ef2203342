"""Which objects look different after a step: changed pixels, each given to the object that it shows.

A pixel inside an object's first-frame box may show the object, the board, or something that reaches in: a neighbour's
door leaf, a tall neighbour seen at an angle, a lever. Depth tells them apart. Every object has a *home*: the rectangle
on the board over which its visible points lay in the first frame. Layouts keep homes apart, so a raised point above
another place is an intruder. A changed pixel counts when it shows the object before or after, and no intruder at all.

Without depth, a pixel belongs to the smallest box that holds it.

The constants were chosen on training objects, on boards as they are generated and on crowded ones without margins:
there at most 2 % of an unchanged object's pixels count, and at least 14 % of a changed one's.
"""

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from busybot.episodes.geometry import Rays
from busybot.reason.observed import Frame, Observed

CERTAIN = 0.2
"""Share of the raised pixels of a box that must lie in no other box to place the object by them."""


class ChangeConfig(BaseModel):
    """When an object counts as changed.

    Attributes:
        tolerance: a pixel changed when a channel differs by more than this (of 255). 10 is above what JPEG of quality
            90 does to the unchanged surroundings of a change.
        share: an object changed when more than this share of its pixels did.
        least: and more pixels than this.
        elevation: points higher than this above the board belong to an object, board units.
        margin: points so far outside of an object's home still belong to it, board units.
        depth: use depth where it was recorded.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    tolerance: Annotated[int, Field(ge=0, le=254)] = 10
    share: Annotated[float, Field(ge=0, lt=1)] = 0.05
    least: Annotated[int, Field(ge=0)] = 16
    elevation: Annotated[float, Field(gt=0)] = 0.01
    margin: Annotated[float, Field(ge=0)] = 0.03
    depth: bool = True


@dataclass(frozen=True)
class Counts:
    """Changed pixels.

    Attributes:
        changed: int (T, N), changed pixels of every object in every step; 0 for objects without a box.
        area: int (N,), pixels that showed the object in the first frame.
    """

    changed: np.ndarray
    area: np.ndarray


@dataclass(frozen=True)
class _Region:
    """An object's place in the image and on the board.

    Attributes:
        rows, columns: of its first-frame box.
        mine: bool, box shape: pixels in no smaller box.
        home: x0, y0, x1, y1, board units; None if depth does not tell.
    """

    rows: slice
    columns: slice
    mine: np.ndarray
    home: np.ndarray | None


def count_pixels(observed: Observed, config: ChangeConfig | None = None) -> Counts:
    """Count changed pixels per object and step."""
    config = config or ChangeConfig()
    rays = Rays(observed.camera)
    before = observed.frame(0)
    regions = _regions(observed, before, rays, config)
    changed = np.zeros((len(observed.actions), len(observed.roles)), int)
    area = np.zeros(len(observed.roles), int)
    for index, region in regions.items():
        area[index] = _area(region, before, rays, config)
    for step in range(len(observed.actions)):
        if observed.image_of[step] == observed.image_of[step + 1]:
            continue
        after = observed.frame(step + 1)
        differs = cv2.absdiff(before.rgb, after.rgb).max(-1) > config.tolerance
        for index, region in regions.items():
            changed[step, index] = _count(region, differs, before, after, rays, config)
        before = after
    return Counts(changed, area)


def changes(observed: Observed, config: ChangeConfig | None = None) -> np.ndarray:
    """Whether each object's appearance changed in each step, bool (T, N)."""
    config = config or ChangeConfig()
    counts = count_pixels(observed, config)
    return counts.changed > np.maximum(config.least, config.share * counts.area)


def _regions(observed: Observed, first: Frame, rays: Rays, config: ChangeConfig) -> dict[int, _Region]:
    """The visible objects' regions, by object index."""
    boxes = {i: tuple(int(side) for side in box) for i, box in enumerate(observed.boxes)}
    shown = {i: box for i, box in boxes.items() if 0 <= box[0] < box[2] and 0 <= box[1] < box[3]}
    # painted from the largest to the smallest, so the smallest box of a pixel stays on top
    top = np.full(first.rgb.shape[:2], -1, int)
    for i, (u0, v0, u1, v1) in sorted(shown.items(), key=lambda item: -_size(item[1])):
        top[v0:v1, u0:u1] = i
    homes = _homes(shown, first, rays, config)
    return {
        i: _Region(slice(v0, v1), slice(u0, u1), top[v0:v1, u0:u1] == i, homes.get(i))
        for i, (u0, v0, u1, v1) in shown.items()
    }


def _size(box: tuple[int, ...]) -> int:
    return (box[2] - box[0]) * (box[3] - box[1])


def _homes(boxes: dict[int, tuple[int, ...]], first: Frame, rays: Rays, config: ChangeConfig) -> dict[int, np.ndarray]:
    """Where the objects' raised points lie; nothing for an object that is too flat to be told by depth.

    Boxes overlap where a tall object leans over another in the picture. Most objects are placed by what lies in their
    box alone; the others by what does not lie at the home of any of those.
    """
    if first.depth is None or not config.depth:
        return {}
    raised = {}
    for index, (u0, v0, u1, v1) in boxes.items():
        points = _points(first, slice(v0, v1), slice(u0, u1), rays)
        raised[index] = (points, points[..., 2] > config.elevation)
    covered = np.zeros(first.rgb.shape[:2], np.uint8)
    for u0, v0, u1, v1 in boxes.values():
        covered[v0:v1, u0:u1] += 1
    homes: dict[int, np.ndarray] = {}
    uncertain = []
    for index, (u0, v0, u1, v1) in sorted(boxes.items(), key=lambda item: _size(item[1])):
        points, high = raised[index]
        alone = high & (covered[v0:v1, u0:u1] == 1)
        if alone.sum() > max(config.least, CERTAIN * high.sum()):
            homes[index] = _around(points[alone], config)
        else:
            uncertain.append(index)
    for index in uncertain:
        points, own = raised[index]
        for home in list(homes.values()):
            own = own & ~_within(points, home)
        if own.sum() > config.least:
            homes[index] = _around(points[own], config)
    return homes


def _around(points: np.ndarray, config: ChangeConfig) -> np.ndarray:
    """Rectangle x0, y0, x1, y1 around points (n, 3), widened by the margin."""
    return np.concatenate([points[:, :2].min(0) - config.margin, points[:, :2].max(0) + config.margin])


def _within(points: np.ndarray, home: np.ndarray) -> np.ndarray:
    x, y = points[..., 0], points[..., 1]
    return (x >= home[0]) & (x <= home[2]) & (y >= home[1]) & (y <= home[3])


def _area(region: _Region, first: Frame, rays: Rays, config: ChangeConfig) -> int:
    if region.home is None:
        return int(region.mine.sum())
    return int(_who(region, first, rays, config)[0].sum())


def _count(region: _Region, differs: np.ndarray, before: Frame, after: Frame, rays: Rays, config: ChangeConfig) -> int:
    changed = differs[region.rows, region.columns]
    if not changed.any():
        return 0
    if region.home is None:
        return int((changed & region.mine).sum())
    own_before, other_before = _who(region, before, rays, config)
    own_after, other_after = _who(region, after, rays, config)
    return int((changed & (own_before | own_after) & ~other_before & ~other_after).sum())


def _who(region: _Region, frame: Frame, rays: Rays, config: ChangeConfig) -> tuple[np.ndarray, np.ndarray]:
    """Masks of the box: pixels that show the object, and pixels that show an intruder."""
    assert region.home is not None
    points = _points(frame, region.rows, region.columns, rays)
    raised = points[..., 2] > config.elevation
    inside = _within(points, region.home)
    return raised & inside, raised & ~inside


def _points(frame: Frame, rows: slice, columns: slice, rays: Rays) -> np.ndarray:
    """Board-frame positions of the box's pixels, float32 (h, w, 3), NaN where there is no depth."""
    assert frame.depth is not None
    depth = frame.depth[rows, columns]
    points = rays.directions[rows, columns] * depth[..., None] + rays.origin
    points[depth <= 0] = np.nan
    return points
