"""Multi-direction triggers, which rest at both ends and in the middle: throttle, joystick, fader; novel: T-bar, rails."""

import numpy as np

from busybot.objects.procedural import hardware, palette
from busybot.objects.procedural.design import SWITCH_SCALE, Design, MovingLink, Part, shifted, slide_directions
from busybot.objects.procedural.hardware import PLATE_THICKNESS as TOP
from busybot.objects.procedural.palette import pick
from busybot.objects.procedural.solids import (
    ball,
    bent,
    box,
    circle,
    lathe,
    loft,
    prism,
    rectangle,
    ring,
    smooth,
    torus,
    tube,
)

SWING = 0.50
"""Half the range of the levers, radians."""


def _half_drum(radius: float, width: float, edge: float = 0.012) -> np.ndarray:
    """Outline of a half disc on its flat side, for a drum along the third axis."""
    angles = np.linspace(0, np.pi, 21)
    del width, edge
    return np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1)


def _drum(radius: float, width: float, edge: float = 0.012) -> "palette.np.ndarray":
    raise NotImplementedError


def _ticks(places: list[tuple[float, float]], z: float, rng: np.random.Generator) -> list[Part]:
    """Three dots of different colours that mark the rest positions."""
    colors = rng.permutation(len(palette.ACCENTS))[:3]
    dot = lathe([(0.014, 0), (0.013, 0.002), (0, 0.0025)], 16)
    return [Part(dot.moved(x, y, z), palette.ACCENTS[c]) for (x, y), c in zip(places, colors, strict=True)]
