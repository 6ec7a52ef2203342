"""How pictures show each trigger of a board in its first-frame box, and what each action changed there.

Under a camera that is still, a frame shows what its picture does. Under another one (`steady`), a trigger shows one
state between two actions on it: the median of these pictures, without what is hidden in it. One that is not seen at all
keeps how it looked. A pixel then changed if it did by more than what is left of the noise.
"""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from busybot.reason.inputs.object_masks import ChangeConfig, ObjectMasks
from busybot.reason.inputs.observation import ObservedEpisode

USUAL, ABOVE = 0.8, 3.0
"""Of a pixel's noise: what so large a share of its pictures stays within, and how far beyond a change lies."""
LEAST, FEWEST = 8.0, 10
"""In the median of several pictures less is a change than in one: so much of a pixel, and more than so many pixels."""


@dataclass(frozen=True)
class Move:
    """What an action changed in a trigger's box: which pixels, bool (h, w), and by how much, float32 (h, w, 3)."""

    step: int
    changed: np.ndarray
    difference: np.ndarray


class View:
    """A trigger's box in the pictures of T + 1 frames.

    Args:
        pictures: uint8 or float32 (h, w, 3), by their number.
        frames: int (T + 1,), number of the picture that each frame shows.
        least: float (h, w), what a pixel that did not change may differ by.
        masks: of two frames, which pixels may have changed, bool (h, w).
        pixels: more than so many changed, if any did.
    """

    def __init__(
        self,
        pictures: Mapping[int, np.ndarray],
        frames: np.ndarray,
        least: np.ndarray,
        masks: Callable[[int, int], np.ndarray],
        pixels: int = 0,
    ):
        self.pictures, self.frames = pictures, frames
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
        before, after = (self.pictures[int(self.frames[number])].astype(np.float32) for number in (step, step + 1))
        changed = np.abs(after - before).max(axis=-1) > self._least
        if changed.any():
            changed &= self._masks(step, step + 1)
        if changed.sum() <= self._pixels:
            return None
        return Move(step, changed, np.where(changed[..., None], after - before, 0))


def still_views(observed: ObservedEpisode, config: ChangeConfig) -> dict[int, View]:
    """The triggers that the first frame shows, by their index."""
    pixels, frames = ObjectMasks(observed, config), np.array(observed.image_of)
    regions = {int(one): pixels.regions[one] for one in observed.triggers if one in pixels.regions}
    boxes: dict[int, dict[int, np.ndarray]] = {one: {} for one in regions}
    for number in dict.fromkeys(observed.image_of):
        picture = observed.images[number].rgb
        for one, region in regions.items():
            boxes[one][number] = picture[region.rows, region.columns].copy()

    def masks(trigger: int, one: int, other: int) -> np.ndarray:
        before, after = (pixels.masks(trigger, number) for number in (one, other))
        return np.asarray((before[0] | after[0]) & ~before[1] & ~after[1])

    return {
        one: View(boxes[one], frames, np.full(region.mine.shape, float(config.tolerance)), partial(masks, one))
        for one, region in regions.items()
    }


def calm_views(observed: ObservedEpisode, acted: np.ndarray, config: ChangeConfig) -> dict[int, View]:
    """The same of a recording that was steadied.

    Args:
        acted: int (T,), the trigger that each action took hold of.
    """
    pixels = ObjectMasks(observed, config)
    triggers = [int(one) for one in observed.triggers if one in pixels.regions]
    return {one: _calm(observed, pixels, one, acted == one, config) for one in triggers}


def _calm(
    observed: ObservedEpisode, pixels: ObjectMasks, trigger: int, touched: np.ndarray, config: ChangeConfig
) -> View:
    """A trigger's box in each frame: the median of what was seen of each pixel since the trigger was touched last."""
    region, count = pixels.regions[trigger], len(observed.image_of)
    boxes = np.array([observed.frame(k).rgb[region.rows, region.columns] for k in range(count)], np.float32)
    own, hidden = (np.array(one) for one in zip(*(pixels.masks(trigger, k) for k in range(count)), strict=True))
    boxes[hidden] = np.nan
    runs, calm = np.concatenate([[0], np.cumsum(touched)]), np.empty_like(boxes)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # what was never seen has no median
        last = np.nan_to_num(np.nanmedian(boxes, axis=0))
        for run in range(int(runs[-1]) + 1):
            look = np.nanmedian(boxes[runs == run], axis=0)
            last = np.where(np.isnan(look), last, look)
            calm[runs == run] = last
        several = np.bincount(runs)[runs] > 1  # one picture alone is its own median
        noise = np.abs(boxes - calm).max(axis=-1)[several if several.any() else slice(None)]
        usual = np.nan_to_num(np.nanquantile(noise, USUAL, axis=0))
    mine = own.mean(axis=0) > 0.5
    least = np.maximum(min(LEAST, config.tolerance), ABOVE * usual)
    return View(dict(enumerate(calm)), np.arange(count), least, lambda *_: mine, min(FEWEST, config.least))
