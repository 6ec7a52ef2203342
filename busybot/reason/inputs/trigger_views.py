"""How pictures show each trigger of a board in its first-frame box, and what each action changed there.

Under a camera that is still, a frame shows what its picture does. Under another one (`steady`), a trigger shows one
state between two actions on it: the median of these pictures, without what is hidden in it. One that is not seen at all
keeps how it looked. Colours and depth are told in units of what is left of their noise, by more than which a pixel
changed; and more of them did than while nobody touched the trigger.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from busybot.common.errors import BusybotError
from busybot.common.limits import MAX_WATCHED_PIXELS
from busybot.episodes.episode import Image
from busybot.reason.inputs.object_masks import ChangeConfig, ObjectMasks, Region
from busybot.reason.inputs.observation import Frame, ObservedEpisode

USUAL, ABOVE, MOST = 0.8, 3.0, 3.0
"""Of a pixel's noise: what so large a share of its pictures stays within, and how far beyond a change lies. In units of
that, no pixel differs by more from what it usually shows: what single pictures have at edges counts no more."""
LEAST, FEWEST, IDLE = 8.0, 10, 0.5
"""In the median of several pictures less is a change than in one: so much of a pixel, and more than so many pixels, or
than differ in so large a share of the pairs of pictures between which nobody touched the trigger."""
COLOURS = 3
"""Channels of a look; behind them comes depth, if it is there."""
LEVEL, DEEP = 1e-4, 10.0
"""Depth is told in levels of so many board units, of which more than so many are a change, as of colours."""


@dataclass(frozen=True)
class Move:
    """What an action changed in a trigger's box: which pixels, bool (h, w), and by how much, float32 (h, w, C)."""

    step: int
    changed: np.ndarray
    difference: np.ndarray


class View:
    """A trigger's box in the pictures of T + 1 frames.

    Args:
        pictures: looks, float32 (h, w, C), by their number.
        frames: int (T + 1,), number of the picture that each frame shows; more of them when the recording grows.
        least: float (C,) or (1,), what a pixel that did not change may differ by.
        masks: of two frames, which pixels may have changed, bool (h, w).
        pixels: more than so many changed, if any did.
        corner: row and column of the box's first pixel in the picture.
    """

    def __init__(
        self,
        pictures: Mapping[int, np.ndarray],
        frames: np.ndarray,
        least: np.ndarray,
        masks: Callable[[int, int], np.ndarray],
        pixels: float = 0,
        corner: tuple[int, int] = (0, 0),
    ):
        self.pictures, self.frames, self.corner = pictures, frames, corner
        self._least, self._masks, self._pixels = least, masks, pixels
        self._moves: dict[int, Move | None] = {}

    def moves(self, steps: np.ndarray) -> list[Move]:
        """The actions on the trigger, of these, that changed pixels of it."""
        for step in steps.tolist():
            if step not in self._moves:
                self._moves[step] = self._move(step)
        return [move for step in steps.tolist() if (move := self._moves[step]) is not None]

    def _move(self, step: int) -> Move | None:
        if self.frames[step] == self.frames[step + 1]:
            return None
        before, after = (self.pictures[int(self.frames[number])] for number in (step, step + 1))
        changed = (np.abs(after - before) > self._least).any(axis=-1)
        if changed.any():
            changed &= self._masks(step, step + 1)
        if changed.sum() <= self._pixels:
            return None
        return Move(step, changed, np.where(changed[..., None], after - before, 0))


class StillTriggers:
    """The triggers that the first frame shows, in pictures of a still camera. No look depends on later ones: of a
    recording that grows only what is new is looked at.

    From the first picture on of which most of the depth differs from the last one's, depth tells nothing.

    Attributes:
        views: by the trigger's index; of more frames when the recording grows.
    """

    def __init__(self, observed: ObservedEpisode):
        self._observed, self._pixels = observed, ObjectMasks(observed)
        regions = self._pixels.regions
        self._regions = {int(one): regions[one] for one in observed.triggers if one in regions}
        self._looks: dict[int, dict[int, np.ndarray]] = {one: {} for one in self._regions}
        self._deep, self._resting, self._seen = observed.boxed.depth, True, set[int]()
        least = np.array([ChangeConfig().tolerance] * COLOURS + [DEEP] * (self._deep is not None), np.float32)
        self.views = {
            one: View(
                self._looks[one],
                np.array(observed.image_of),
                least,
                partial(self._masks, one),
                corner=(region.rows.start, region.columns.start),
            )
            for one, region in self._regions.items()
        }
        self.grow(observed)

    def grow(self, observed: ObservedEpisode) -> None:
        """Look at what is new in what the recording has grown to; a part of it has nothing new."""
        if len(observed.image_of) < len(self._observed.image_of):
            return
        self._observed = observed
        for number in dict.fromkeys(observed.image_of):
            if number not in self._seen:
                self._look(number, observed.images[number])
        for view in self.views.values():
            view.frames = np.array(observed.image_of)

    def _look(self, number: int, image: Image) -> None:
        self._seen.add(number)
        if self._deep is not None and image.depth is not None and self._resting:
            now = np.where(image.depth > 0, image.depth, self._deep)  # what lies in a hole is where it was seen last
            self._resting = 2 * int(np.count_nonzero(now != self._deep)) < now.size
            self._deep = now if self._resting else self._deep
        for one, region in self._regions.items():
            place = region.rows, region.columns
            rgb, deep = image.rgb[place].astype(np.float32), self._deep
            self._looks[one][number] = rgb if deep is None else np.dstack([rgb, deep[place] / np.float32(LEVEL)])

    def _masks(self, trigger: int, one: int, other: int) -> np.ndarray:
        before, after = (self._pixels.masks_of(trigger, self._observed.frame(number)) for number in (one, other))
        return np.asarray((before[0] | after[0]) & ~before[1] & ~after[1])


class UnsteadyTriggers:
    """The triggers that the first frame shows, in all pictures of a recording that was steadied, looked at once."""

    def __init__(self, observed: ObservedEpisode):
        pixels, frames = ObjectMasks(observed), [observed.frame(k) for k in range(len(observed.image_of))]
        self._deep = np.array([frame.depth is not None for frame in frames])
        self._own, self._looks = dict[int, np.ndarray](), dict[int, np.ndarray]()
        for trigger in (int(one) for one in observed.triggers if one in pixels.regions):
            masks = (pixels.masks(trigger, k) for k in range(len(frames)))
            self._own[trigger], hidden = (np.array(one) for one in zip(*masks, strict=True))
            looks = np.array([_look(frame, pixels.regions[trigger]) for frame in frames], np.float32)
            looks[hidden] = np.nan
            self._looks[trigger] = looks
        self._latest: tuple[int, dict[int, View]] = (-1, {})

    def views(self, acted: np.ndarray) -> dict[int, View]:
        """As of `StillTriggers`, of the first so many actions; asked for the same ones again, the same.

        Args:
            acted: int (T,), the trigger that each of these took hold of.
        """
        if self._latest[0] != len(acted):
            count = len(acted) + 1
            channels = None if self._deep[:count].all() else COLOURS
            views = {
                trigger: _calm(
                    looks[:count, ..., :channels], self._own[trigger][:count].mean(axis=0) > 0.5, acted == trigger
                )
                for trigger, looks in self._looks.items()
            }
            self._latest = len(acted), views
        return self._latest[1]


def refuse_too_many(observed: ObservedEpisode) -> None:
    """Refuse a recording, as it was read, of which `UnsteadyTriggers` would keep more than fits into memory."""
    boxes = observed.boxes[observed.triggers].astype(int)
    area = int((boxes[:, 2:] - boxes[:, :2]).clip(min=0).prod(axis=1).sum())
    if (asked := area * len(observed.image_of)) > MAX_WATCHED_PIXELS:
        what = f"{getattr(observed.images, 'where', 'a recording')}: {len(observed.image_of)} frames before a camera "
        what += f"that is not still, in which boxes of triggers have {asked:,} pixels, at most {MAX_WATCHED_PIXELS:,}"
        raise BusybotError(what, "make shorter recordings, or smaller pictures (`import --width`)")


def _calm(looks: np.ndarray, mine: np.ndarray, touched: np.ndarray) -> View:
    """The median of what was seen of each pixel since the trigger was touched last, in units of what a pixel that did
    not change may differ by, from what it usually shows.

    Args:
        looks: of the trigger's box, float32 (T + 1, h, w, C), NaN where nothing was seen.
        mine: bool (h, w), which pixels show the trigger.
        touched: bool (T,), which actions took hold of it.
    """
    runs, calm = np.concatenate([[0], np.cumsum(touched)]), np.empty_like(looks)
    usual = last = np.nan_to_num(median_of_seen(looks))
    for run in range(int(runs[-1]) + 1):
        look = median_of_seen(looks[runs == run])
        last = np.where(np.isnan(look), last, look)
        calm[runs == run] = last
    several = np.bincount(runs)[runs] > 1  # one picture alone is its own median
    least = _least(np.abs(looks - calm)[several if several.any() else slice(None)])
    idle = (np.abs(np.diff(looks, axis=0))[~touched] > least).any(axis=-1)
    stirred = np.quantile((idle & mine).sum(axis=(1, 2)), IDLE) if len(idle) else 0
    told = ((calm - usual) / least).clip(-MOST, MOST)
    fewest = max(FEWEST, float(stirred))
    return View(dict(enumerate(told)), np.arange(len(looks)), np.ones(1, np.float32), lambda *_: mine, fewest)


def median_of_seen(looks: np.ndarray) -> np.ndarray:
    """`np.nanmedian` over the first axis of (n, ...), n >= 1, to the same bits; numpy's takes ten times as long for few
    numbers each."""
    count, ordered = (~np.isnan(looks)).sum(axis=0), np.sort(looks, axis=0)  # NaN comes last
    middle = np.maximum(count - 1, 0) // 2, np.minimum(count // 2, len(looks) - 1)
    low, high = (np.take_along_axis(ordered, place[None], axis=0)[0] for place in middle)
    return np.where(count > 0, (low + high) / 2, np.nan).astype(looks.dtype)


def _least(away: np.ndarray) -> np.ndarray:
    """What a pixel that did not change may differ by, (h, w, C), from how far single pictures are off, (n, h, w, C).

    The noise of a pixel's colours is that of the worst of them.
    """
    colours, depth = away[..., :COLOURS], away[..., COLOURS:]
    worst = np.concatenate([colours.max(axis=-1, keepdims=True), depth], axis=-1)
    noise = ABOVE * _usual(worst)
    of_colours = np.maximum(noise[..., :1], LEAST).repeat(COLOURS, axis=-1)
    return np.concatenate([of_colours, np.maximum(noise[..., 1:], DEEP)], axis=-1)


def _usual(numbers: np.ndarray) -> np.ndarray:
    """What so large a share `USUAL` of the numbers (n, ...) stays within, without those that are NaN; 0 if all are.

    As `nanquantile`, which looks at one place after the other.
    """
    told, ordered = np.zeros(numbers.shape[1:], numbers.dtype), np.sort(numbers, axis=0)  # NaN comes last
    counts = np.count_nonzero(~np.isnan(ordered), axis=0)
    for count in np.unique(counts[counts > 0]).tolist():
        told[counts == count] = np.quantile(ordered[:count, counts == count], USUAL, axis=0)
    return told


def _look(frame: Frame, region: Region) -> np.ndarray:
    """Colours of a trigger's box, and depth, NaN in its holes or where there is none; float32 (h, w, C)."""
    place = region.rows, region.columns
    rgb = frame.rgb[place].astype(np.float32)
    depth = np.zeros(rgb.shape[:2], np.float32) if frame.depth is None else frame.depth[place]
    return np.dstack([rgb, np.where(depth > 0, depth / np.float32(LEVEL), np.nan)])
