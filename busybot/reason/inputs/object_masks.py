"""Tells which pixels of an object's first-frame box show the object itself, and which objects changed in a step.

A pixel inside the box may show the object, the board, or something that reaches in: a neighbour's door leaf, a tall
neighbour seen at an angle, a lever, a hand. Depth tells them apart. Every object has a *home*: the rectangle on the
board over which its visible points lay in the first frame. Layouts keep homes apart, so a raised point above another
place is an intruder. So is one that is too high: no part rises above where the highest was by more than the home is
long. What lies in a hole of the depth is not seen either.

Without depth, a pixel belongs to the smallest box that holds it, and nothing is known of intruders. `OracleMasks` reads
the recorded segmentation, for rows that tell what recognising own pixels by depth costs.

An object changed when enough pixels of its box did (`changes`). A changed pixel counts when it shows the object before
or after, and no intruder at all. The constants were chosen on training objects, on boards as they are generated and on
crowded ones without margins: there at most 2 % of an unchanged object's pixels count, and at least 14 % of a changed
one's.
"""

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from pydantic import Field

from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Episode
from busybot.reason.inputs.observation import Frame, ObservedEpisode, observe_episode

MASKS = "4"
"""Changes when masks of the same pictures do, or what steadies pictures; features are then computed anew."""
CERTAIN = 0.2
"""Share of the raised pixels of a box that must lie in no other box to place the object by them."""


class MaskConfig(FrozenModel):
    """What counts as an object's own pixel.

    Attributes:
        least: an object is placed by depth when more than so many raised pixels tell where it stands.
        elevation: points higher than this above the board belong to an object, board units.
        margin: points so far outside of an object's home still belong to it, board units.
        depth: use depth where it was recorded.
    """

    least: Annotated[int, Field(ge=0)] = 16
    elevation: Annotated[float, Field(gt=0)] = 0.01
    margin: Annotated[float, Field(ge=0)] = 0.03
    depth: bool = True


@dataclass(frozen=True)
class Region:
    """An object's place in the image and on the board.

    Attributes:
        rows, columns: of its first-frame box.
        mine: bool, box shape: pixels in no smaller box.
        home: x0, y0, x1, y1, and what it never rises above, board units; None if depth does not tell.
    """

    rows: slice
    columns: slice
    mine: np.ndarray
    home: np.ndarray | None


class ObjectMasks:
    """Tells the objects of one board from what else their boxes show, by what the first frame showed.

    Attributes:
        regions: of the visible objects, by object index.
    """

    def __init__(self, observed: ObservedEpisode, config: MaskConfig | None = None):
        self._observed, self._config = observed, config or MaskConfig()
        self._rays = Rays(observed.camera)
        first = observed.boxed
        height, width = first.rgb.shape[:2]
        clipped = [(u0, v0, min(u1, width), min(v1, height)) for u0, v0, u1, v1 in observed.boxes.tolist()]
        shown: dict[int, tuple[int, ...]] = {
            i: box for i, box in enumerate(clipped) if 0 <= box[0] < box[2] and 0 <= box[1] < box[3]
        }
        # painted from the largest to the smallest, so the smallest box of a pixel stays on top
        top = np.full((height, width), -1, int)
        for i, (u0, v0, u1, v1) in sorted(shown.items(), key=lambda item: -_size(item[1])):
            top[v0:v1, u0:u1] = i
        homes = self._homes(shown, first)
        self.regions = {
            i: Region(slice(v0, v1), slice(u0, u1), top[v0:v1, u0:u1] == i, homes.get(i))
            for i, (u0, v0, u1, v1) in shown.items()
        }

    def masks(self, index: int, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Of an object's box in frame `number`: pixels that show it, and that are hidden; bool (h, w) each."""
        return self.masks_of(index, self._observed.frame(number))

    def masks_of(self, index: int, frame: Frame) -> tuple[np.ndarray, np.ndarray]:
        """The same of any picture of the board. One whose depth was lost is taken to show the object where the first
        frame did."""
        region = self.regions[index]
        if region.home is None:
            return region.mine, np.zeros_like(region.mine)
        if frame.depth is None:
            frame = self._observed.boxed
        points = _points(frame, region.rows, region.columns, self._rays)
        raised = points[..., 2] > self._config.elevation
        inside = _within(points, region.home)
        return raised & inside, (raised & ~inside) | np.isnan(points[..., 2])

    def _homes(self, boxes: dict[int, tuple[int, ...]], first: Frame) -> dict[int, np.ndarray]:
        """Where the objects' raised points lie; nothing for an object that is too flat to be told by depth.

        Boxes overlap where a tall object leans over another in the picture. Most objects are placed by what lies in
        their box alone; the others by what does not lie at the home of any of those.
        """
        config = self._config
        if first.depth is None or not config.depth:
            return {}
        raised = {}
        for index, (u0, v0, u1, v1) in boxes.items():
            points = _points(first, slice(v0, v1), slice(u0, u1), self._rays)
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
                homes[index] = _around(points[alone], config.margin)
            else:
                uncertain.append(index)
        for index in uncertain:
            points, own = raised[index]
            for home in list(homes.values()):
                own = own & ~_within(points, home)
            if own.sum() > config.least:
                homes[index] = _around(points[own], config.margin)
        return homes


def _size(box: tuple[int, ...]) -> int:
    return (box[2] - box[0]) * (box[3] - box[1])


def _around(points: np.ndarray, margin: float) -> np.ndarray:
    """Rectangle x0, y0, x1, y1 around points (n, 3), widened by the margin; above their highest, its longer side."""
    low, high = points[:, :2].min(0) - margin, points[:, :2].max(0) + margin
    return np.array([*low, *high, points[:, 2].max() + (high - low).max()])


def _within(points: np.ndarray, home: np.ndarray) -> np.ndarray:
    x, y, z = (points[..., axis] for axis in range(3))
    return (x >= home[0]) & (x <= home[2]) & (y >= home[1]) & (y <= home[3]) & (z <= home[4])


def _points(frame: Frame, rows: slice, columns: slice, rays: Rays) -> np.ndarray:
    """Board-frame positions of the box's pixels, float32 (h, w, 3), NaN where there is no depth."""
    assert frame.depth is not None
    depth = frame.depth[rows, columns]
    points = rays.directions[rows, columns] * depth[..., None] + rays.origin
    points[depth <= 0] = np.nan
    return points


class OracleMasks:
    """Like `ObjectMasks`, but the simulator says what each pixel shows. Privileged.

    Attributes:
        regions: of the visible objects, by object index.
    """

    def __init__(self, episode: Episode):
        self.regions = ObjectMasks(observe_episode(episode), MaskConfig(depth=False)).regions
        self._episode = episode
        self._owner = np.array([-1, *(link.object for link in episode.links)])

    def masks(self, index: int, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Of an object's box in frame `number`: pixels that show it, and that show another; bool (h, w) each."""
        region = self.regions[index]
        segmentation = self._episode.image(number).segmentation
        if segmentation is None:
            hint = "choose an encoder without `-mask`"
            raise BusybotError("the recording has no segmentation to tell the objects' pixels by", hint)
        owner = self._owner[segmentation[region.rows, region.columns]]
        return owner == index, (owner >= 0) & (owner != index)


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


def count_pixels(observed: ObservedEpisode, config: ChangeConfig) -> tuple[np.ndarray, np.ndarray]:
    """Changed pixels of every object in every step, int (T, N), and pixels that showed it in the first frame, int (N,).

    Both are 0 for objects without a box.
    """
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
    return changed, area


def changes(observed: ObservedEpisode, config: ChangeConfig | None = None) -> np.ndarray:
    """Whether each object's appearance changed in each step, bool (T, N)."""
    config = config or ChangeConfig()
    changed, area = count_pixels(observed, config)
    return changed > np.maximum(config.least, config.share * area)


def _count(pixels: ObjectMasks, index: int, differs: np.ndarray, step: int) -> int:
    region = pixels.regions[index]
    changed = differs[region.rows, region.columns]
    if not changed.any():
        return 0
    own_before, other_before = pixels.masks(index, step)
    own_after, other_after = pixels.masks(index, step + 1)
    return int((changed & (own_before | own_after) & ~other_before & ~other_after).sum())
