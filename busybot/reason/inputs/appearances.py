"""Appearances of each object in each frame: its own pixels within its first-frame box, each appearance once.

A place of the box that an intruder hides keeps what it showed before, so that a neighbour's door that swings in front
of a lamp does not change the lamp. Pictures that did not change are not looked at again, and neither are boxes in which
nothing changed.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from busybot.reason.inputs.object_masks import ObjectMasks, OracleMasks, Region
from busybot.reason.inputs.observation import Frame, ObservedEpisode


@dataclass(frozen=True)
class Appearance:
    """One appearance of one object.

    Attributes:
        rgb: uint8 (h, w, 3), the object's box. Outside of `own` it shows whatever was there.
        own: bool (h, w), pixels that show the object.
    """

    rgb: np.ndarray
    own: np.ndarray


def scaled(values: np.ndarray, side: int) -> np.ndarray:
    """A box's values, scaled to side x side cells."""
    return np.asarray(cv2.resize(values, (side, side), interpolation=cv2.INTER_AREA))


@dataclass(frozen=True)
class Appearances:
    """All looks of a board's responders.

    Attributes:
        looks: each different from all others of its object.
        of: int (T + 1, N), index into `looks` for every frame and object; -1 for triggers and objects without a box.
    """

    looks: list[Appearance]
    of: np.ndarray


class TrackedObject:
    """One object over the frames: what its box last showed, with what hid it taken away.

    Attributes:
        look: the present one.
    """

    def __init__(self, region: Region):
        self._place = (region.rows, region.columns)
        self._seen: tuple[np.ndarray, np.ndarray | None] | None = None
        self._rgb = np.zeros((*region.mine.shape, 3), np.uint8)
        self._own = np.zeros(region.mine.shape, bool)
        self.look = Appearance(self._rgb, self._own)
        self._known: dict[tuple[bytes, bytes], int] = {}

    def unchanged(self, frame: Frame) -> bool:
        """Whether the box shows exactly what it showed last."""
        before = self._seen
        depth = None if frame.depth is None else frame.depth[self._place]
        self._seen = (frame.rgb[self._place], depth)
        if before is None or not np.array_equal(before[0], self._seen[0]):
            return False
        return before[1] is None or depth is None or np.array_equal(before[1], depth)

    def update(self, own: np.ndarray, hidden: np.ndarray) -> int:
        """Take in what was asked about last; returns the number of the look among this object's, from 0."""
        assert self._seen is not None
        self._rgb = np.where(hidden[..., None], self._rgb, self._seen[0])
        self._own = np.where(hidden, self._own, own)
        self.look = Appearance(self._rgb, self._own)
        return self._known.setdefault((self._own.tobytes(), self._rgb[self._own].tobytes()), len(self._known))


def appearances_of(observed: ObservedEpisode, pixels: ObjectMasks | OracleMasks) -> Appearances:
    """The looks of all responders that have a box in the first frame."""
    of = np.full((len(observed.image_of), len(observed.roles)), -1, int)
    watched = {i: TrackedObject(region) for i, region in pixels.regions.items() if observed.roles[i] == "responder"}
    places: dict[int, list[int]] = {index: [] for index in watched}
    looks: list[Appearance] = []
    for number, picture in enumerate(observed.image_of):
        of[number] = of[max(0, number - 1)]
        if number and picture == observed.image_of[number - 1]:
            continue
        frame = observed.frame(number)
        for index, one in watched.items():
            if one.unchanged(frame):
                continue
            look = one.update(*pixels.masks(index, number))
            if look == len(places[index]):
                places[index].append(len(looks))
                looks.append(one.look)
            of[number, index] = places[index][look]
    return Appearances(looks, of)
