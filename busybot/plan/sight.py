"""Features of pictures as they come, one after the other: what `features_of` does for recorded episodes.

Places of the objects come from the first frame of the recorded interactions, and so does what an object looks like
where something hides it.
"""

import numpy as np

from busybot.reason.encoders.choose import Chosen
from busybot.reason.looks import Watched
from busybot.reason.observed import Frame, Observed
from busybot.reason.own_pixels import OwnConfig, OwnPixels
from busybot.reason.sequence import CHANNELS


class Sight:
    """Watches the responders of one board.

    Args:
        observed: the recorded interactions; its first frame is seen first.
        chosen: an encoder that is no oracle.
    """

    def __init__(self, observed: Observed, chosen: Chosen):
        self._pixels = OwnPixels(observed, OwnConfig(depth=chosen.pixels == "own"))
        self._encoder = chosen.encoder
        regions = self._pixels.regions
        self._watched = {i: Watched(region) for i, region in regions.items() if observed.roles[i] == "responder"}
        self._features = np.zeros((len(observed.roles), CHANNELS), np.float32)
        self._known: dict[int, list[np.ndarray]] = {index: [] for index in self._watched}
        self._see(observed.frame(0))

    def see(self, frame: Frame) -> np.ndarray:
        """Features float32 (N, 256) of the next picture; zeros for triggers and objects without a box."""
        self._see(frame)
        return self._features.copy()

    def _see(self, frame: Frame) -> None:
        for index, one in self._watched.items():
            if one.unchanged(frame):
                continue
            number = one.update(*self._pixels.masks_of(index, frame))
            known = self._known[index]
            if number == len(known):
                # as precise as what is stored of recorded episodes
                known.append(self._encoder.encode([one.look])[0].astype(np.float16).astype(np.float32))
            self._features[index] = known[number]
