"""Mean and spread of the colours of an object's own pixels."""

import numpy as np

from busybot.reason.inputs.appearances import Appearance


class MeanColour:
    """256 numbers for each look: mean and spread of three colours, then zeros.

    Attributes:
        key: another one when the numbers change, so that stored features are computed again.
        threshold: looks whose numbers lie farther apart show two states (`reason.inputs.sequence.fit_threshold`).
    """

    key = "1"
    threshold = 0.01

    def encode(self, looks: list[Appearance]) -> np.ndarray:
        """float32 (n, 256)."""
        rows = np.zeros((len(looks), 256), np.float32)
        for row, look in zip(rows, looks, strict=True):
            own = look.rgb[look.own] / 255
            if len(own):
                row[:3], row[3:6] = own.mean(0), own.std(0)
        return rows
