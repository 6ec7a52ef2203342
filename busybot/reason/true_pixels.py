"""Own pixels by the recorded segmentation: an oracle, for rows that tell what recognising them by depth costs."""

import numpy as np

from busybot.episodes.episode import Episode
from busybot.errors import BusybotError
from busybot.reason.observed import observe
from busybot.reason.own_pixels import OwnConfig, OwnPixels


class TruePixels:
    """Like `OwnPixels`, but the simulator says what each pixel shows. Privileged.

    Attributes:
        regions: of the visible objects, by object index.
    """

    def __init__(self, episode: Episode):
        self.regions = OwnPixels(observe(episode), OwnConfig(depth=False)).regions
        self._episode = episode
        self._owner = np.array([-1, *(link.object for link in episode.links)])

    def masks(self, index: int, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Of an object's box in frame `number`: pixels that show it, and that show another; bool (h, w) each."""
        region = self.regions[index]
        segmentation = self._episode.image(number).segmentation
        if segmentation is None:
            mend = "choose an encoder without `-mask`"
            raise BusybotError("the recording has no segmentation to tell the objects' pixels by", mend)
        owner = self._owner[segmentation[region.rows, region.columns]]
        return owner == index, (owner >= 0) & (owner != index)
