"""Encoder `embedded`: 256 numbers that describe an object's own pixels, without parameters.

The box is scaled to 32 x 32 cells, the object's share of each taken as its weight; what is not the object counts for
nothing. All numbers lie between about -1 and 2 and are weighted so that Euclidean distance is a measure of change:
what differs between two states of a responder moves many of them, what JPEG does moves none by much.

| numbers | what |
|---|---|
| 16 | mean, spread and brightest value of each colour channel, saturation, area, centre and extent |
| 64 | colour histogram, 4 x 4 x 4, softly binned, square roots of shares |
| 64 | occupancy, 8 x 8 |
| 48 | colour, 4 x 4 x 3, weighted by occupancy |
| 64 | gradients of the grey value, 4 x 4, four directions |

The paper takes the first stage of an ImageNet ResNet-50 instead (encoder `resnet50`); `benchmarks/studies/features.py`
compares them.
"""

import numpy as np

from busybot.reason.inputs.appearances import Appearance, scaled
from busybot.reason.inputs.sequence import CHANNELS

SIDE = 32
BINS = 4
GREY = np.array([0.299, 0.587, 0.114], np.float32)
LEAST_WEIGHT = 1e-3
"""A cell of which the object covers less has no colour of its own."""

COLOUR_GAIN, GRADIENT_GAIN, PLACE_GAIN = 2.0, 4.0, 2.0

_CELLS = (np.arange(SIDE, dtype=np.float32) + 0.5) / SIDE - 0.5
_AXES = np.arange(4) * np.pi / 2


class Descriptor:
    """The encoder `embedded`."""

    key = "1"

    def encode(self, looks: list[Appearance]) -> np.ndarray:
        """float32 (n, 256)."""
        rows = [describe(look) for look in looks]
        return np.stack(rows) if rows else np.zeros((0, CHANNELS), np.float32)


def describe(look: Appearance) -> np.ndarray:
    """The descriptor of one look, float32 (256,); zeros where nothing shows the object."""
    weight = scaled(look.own.astype(np.float32), SIDE)
    total = float(weight.sum())
    if total <= 0:
        return np.zeros(CHANNELS, np.float32)
    light = scaled(look.rgb * look.own[..., None].astype(np.float32), SIDE) / 255  # colour times weight
    colour = light / np.maximum(weight, LEAST_WEIGHT)[..., None]
    shares = weight / total
    parts = (
        _summary(colour, weight, shares),
        _histogram(colour, shares),
        _pooled(weight, 8),
        COLOUR_GAIN * _pooled(light, 4),
        GRADIENT_GAIN * _gradients(light @ GREY),
    )
    return np.concatenate([part.ravel() for part in parts]).astype(np.float32)


def _summary(colour: np.ndarray, weight: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """16 numbers over the whole object."""
    mean = np.tensordot(shares, colour, 2)
    spread = np.sqrt(np.tensordot(shares, (colour - mean) ** 2, 2))
    brightest = (colour * (weight > 0.5)[..., None]).max((0, 1))
    saturation = (shares * (colour.max(-1) - colour.min(-1))).sum()
    across, down = shares.sum(0), shares.sum(1)
    centre = np.array([across @ _CELLS, down @ _CELLS])
    extent = np.sqrt([across @ (_CELLS - centre[0]) ** 2, down @ (_CELLS - centre[1]) ** 2])
    area = weight.mean()
    place = PLACE_GAIN * np.array([area, np.sqrt(area), *centre, *extent])
    return np.concatenate([mean, spread, brightest, [saturation], place])


def _histogram(colour: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Every cell's share goes to the bins whose colours are nearest, in proportion to nearness."""
    levels = colour.reshape(-1, 3, 1) * (BINS - 1)
    near = np.clip(1 - np.abs(levels - np.arange(BINS, dtype=np.float32)), 0, 1)
    pairs = (near[:, 0, :, None] * near[:, 1, None, :]).reshape(len(near), -1)
    return np.asarray(np.sqrt(pairs.T @ (near[:, 2] * shares.reshape(-1, 1))))


def _gradients(grey: np.ndarray) -> np.ndarray:
    """Mean strength of the gradients in four directions, in 4 x 4 places; opposite directions are different."""
    down, across = np.zeros_like(grey), np.zeros_like(grey)
    down[1:-1], across[:, 1:-1] = grey[2:] - grey[:-2], grey[:, 2:] - grey[:, :-2]
    along = [np.maximum(np.cos(axis) * across + np.sin(axis) * down, 0) for axis in _AXES]
    return _pooled(np.stack(along, axis=-1), 4)


def _pooled(values: np.ndarray, cells: int) -> np.ndarray:
    """Means over cells x cells places."""
    size = SIDE // cells
    return np.asarray(values.reshape(cells, size, cells, size, -1).mean((1, 3)))
