"""Materials that go together on a wooden board, and draws from them."""

from collections.abc import Sequence

import numpy as np

from busybot.objects.procedural.design import Material, Vector

IVORY = Material("ivory", (0.93, 0.90, 0.82), 0.35)
WHITE = Material("white", (0.94, 0.94, 0.93), 0.4)
PEARL = Material("pearl", (0.80, 0.81, 0.82), 0.4)
STONE = Material("stone", (0.62, 0.62, 0.60), 0.25)
GRAPHITE = Material("graphite", (0.25, 0.27, 0.29), 0.4)
BLACK = Material("black", (0.07, 0.07, 0.08), 0.4)
NAVY = Material("navy", (0.14, 0.21, 0.36), 0.4)
TEAL = Material("teal", (0.10, 0.44, 0.45), 0.4)
FOREST = Material("forest", (0.15, 0.36, 0.25), 0.35)
SAGE = Material("sage", (0.58, 0.68, 0.54), 0.3)
SKY = Material("sky", (0.47, 0.68, 0.84), 0.35)
MINT = Material("mint", (0.62, 0.83, 0.74), 0.35)
CORAL = Material("coral", (0.91, 0.42, 0.34), 0.4)
RED = Material("red", (0.79, 0.13, 0.13), 0.45)
WINE = Material("wine", (0.45, 0.11, 0.17), 0.4)
MUSTARD = Material("mustard", (0.92, 0.70, 0.20), 0.35)
ORANGE = Material("orange", (0.93, 0.49, 0.13), 0.4)
PLUM = Material("plum", (0.40, 0.23, 0.43), 0.35)
BLUSH = Material("blush", (0.91, 0.72, 0.68), 0.3)

STEEL = Material("steel", (0.68, 0.70, 0.73), 0.9)
CHROME = Material("chrome", (0.82, 0.84, 0.87), 1.0)
BRASS = Material("brass", (0.83, 0.66, 0.30), 0.9)
COPPER = Material("copper", (0.77, 0.46, 0.30), 0.85)
IRON = Material("iron", (0.19, 0.19, 0.20), 0.6)
OAK = Material("oak", (0.76, 0.58, 0.37), 0.2)
WALNUT = Material("walnut", (0.42, 0.27, 0.17), 0.25)
CHERRY = Material("cherry", (0.60, 0.32, 0.19), 0.25)
BIRCH = Material("birch", (0.88, 0.77, 0.60), 0.2)
GLASS = Material("glass", (0.62, 0.79, 0.87), 1.0)
SHADOW = Material("shadow", (0.10, 0.10, 0.12), 0.0)
UNLIT = Material("unlit", (0.04, 0.04, 0.04), 0.3)

PLATES = (IVORY, WHITE, PEARL, GRAPHITE, NAVY, SAGE, STEEL)
ACCENTS = (CORAL, RED, MUSTARD, TEAL, ORANGE, SKY, FOREST, PLUM)
METALS = (STEEL, CHROME, BRASS, COPPER)
WOODS = (OAK, WALNUT, CHERRY, BIRCH)

LIGHTS: tuple[Vector, ...] = ((1, 1, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1), (0, 1, 0), (0, 1, 1))
"""Saturated colours of lamps that are on."""


def pick(rng: np.random.Generator, materials: Sequence[Material], *, unlike: Material | None = None) -> Material:
    """One of the materials, at least a visible step away from `unlike`."""
    allowed = [m for m in materials if unlike is None or _contrast(m, unlike) > 0.35]
    return (allowed or list(materials))[int(rng.integers(len(allowed or materials)))]


def in_turn(materials: Sequence[Material], variant: int) -> Material:
    """The materials one after the other, so that variants of a family differ."""
    return materials[variant % len(materials)]


def _contrast(first: Material, second: Material) -> float:
    return float(np.abs(np.subtract(first.color, second.color)).max())


def light_colors(hue: int, rng: np.random.Generator) -> tuple[Vector, Vector, Vector]:
    """Three different saturated colours: the single-stage on state, counted by `hue`, and the steps 1 and 2."""
    first = hue % len(LIGHTS)
    second, third = rng.permutation([k for k in range(len(LIGHTS)) if k != first])[:2]
    return LIGHTS[first], LIGHTS[second], LIGHTS[third]
