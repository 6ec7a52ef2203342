"""Bases of training switches, of many outlines and thicknesses, and clutter that does not move.

Clutter keeps a policy from taking everything that stands out for a switch: screws, labels, vents, bumps, pegs, jewels.
It is small, low, and has no gap around it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from busybot.objects.procedural import fixtures as hardware
from busybot.objects.procedural import palette
from busybot.objects.procedural.design import Material, Part, shifted
from busybot.objects.procedural.palette import pick
from busybot.objects.procedural.solids import ball, box, circle, ellipse, frame, inset, lathe, prism, rectangle

COVERS = (*palette.PLATES, *palette.WOODS, palette.MINT, palette.SKY, palette.BLUSH, palette.STONE, palette.BLACK)


@dataclass(frozen=True, eq=False)
class Ground:
    """A base: its parts, the height of its upper face, and what it is made of."""

    parts: list[Part]
    top: float
    cover: Material


def plate(width: float, height: float, cover: Material, rng: np.random.Generator) -> Ground:
    """A thin cover plate, its corners more or less round."""
    radius = float(rng.uniform(0.012, 0.3 * min(width, height)))
    solid = prism(rectangle(width, height, radius, 5), 0, hardware.PLATE_THICKNESS, bevel=0.010, steps=3)
    return Ground([Part(solid, cover)], hardware.PLATE_THICKNESS, cover)


def slab(width: float, height: float, cover: Material, rng: np.random.Generator) -> Ground:
    """A thick block with a soft edge."""
    top = float(rng.uniform(0.045, 0.085))
    return Ground([Part(prism(rectangle(width, height, 0.03), 0, top, bevel=0.018, steps=4), cover)], top, cover)


def plinth(width: float, height: float, cover: Material, rng: np.random.Generator) -> Ground:
    """A plate on a wider foot of another colour."""
    foot = pick(rng, (*palette.WOODS, palette.BLACK, palette.STEEL, palette.WHITE), unlike=cover)
    parts = [Part(prism(rectangle(width, height, 0.02), 0, 0.022, bevel=0.007), foot)]
    upper = rectangle(width - 0.04, height - 0.04, 0.015)
    return Ground([*parts, Part(prism(upper, 0.02, 0.042, bevel=0.008), cover)], 0.042, cover)


def tray(width: float, height: float, cover: Material, rng: np.random.Generator) -> Ground:
    """A plate within a raised rim."""
    rim = pick(rng, (*palette.METALS, *palette.WOODS, palette.BLACK), unlike=cover)
    outer, rise = rectangle(width, height, 0.03), float(rng.uniform(0.042, 0.06))
    wall = frame(outer, inset(outer, 0.016), 0, rise, bevel=0.005)
    return Ground([Part(wall, rim), Part(prism(inset(outer, 0.008), 0, 0.03), cover)], 0.03, cover)


def disc(width: float, height: float, cover: Material, rng: np.random.Generator) -> Ground:
    """An oval turned plate, round if its sides are equal."""
    top = float(rng.uniform(0.028, 0.055))
    outline = 1.16 * ellipse(width, height, 40)
    solid = prism(outline, 0, top, bevel=0.016, steps=4)
    return Ground([Part(solid, cover)], top, cover)


GROUNDS: tuple[Callable[[float, float, Material, np.random.Generator], Ground], ...] = (
    plate,
    slab,
    plinth,
    tray,
    disc,
)


def ground(
    width: float, height: float, variant: int, rng: np.random.Generator, covers: Sequence[Material] = COVERS
) -> Ground:
    """One of the bases, counted by the variant, in a colour that is drawn."""
    return GROUNDS[variant % len(GROUNDS)](width, height, pick(rng, covers), rng)


def clutter(base: Ground, places: Sequence[tuple[float, float]], rng: np.random.Generator) -> list[Part]:
    """Something that does not move at some of the places, all of one kind or of several."""
    makers = (_screw, _bump, _stud, _peg, _jewel, _label, _vent)
    kinds = rng.permutation(len(makers))[:2]
    parts: list[Part] = []
    for x, y in places:
        if rng.random() < 0.75:
            maker = makers[int(kinds[int(rng.integers(2))])]
            parts += shifted(maker(base.cover, rng), (x, y, base.top - 0.001))
    return parts


def corners(width: float, height: float, edge: float = 0.035) -> list[tuple[float, float]]:
    """Places near the corners of a base."""
    return [(sx * (width / 2 - edge), sy * (height / 2 - edge)) for sx in (-1, 1) for sy in (-1, 1)]


def _screw(cover: Material, rng: np.random.Generator) -> list[Part]:
    del cover
    return hardware.screw(0, 0, 0, float(rng.uniform(0, np.pi)), pick(rng, palette.METALS), 0.014)


def _bump(cover: Material, rng: np.random.Generator) -> list[Part]:
    radius = float(rng.uniform(0.012, 0.024))
    return [Part(ball(radius, 14, 8).stretched(z=float(rng.uniform(0.5, 1.0))), cover)]


def _stud(cover: Material, rng: np.random.Generator) -> list[Part]:
    side = float(rng.uniform(0.02, 0.04))
    return [Part(box(side, side, float(rng.uniform(0.008, 0.03)), 0.004), cover)]


def _peg(cover: Material, rng: np.random.Generator) -> list[Part]:
    height = float(rng.uniform(0.02, 0.05))
    peg = lathe([(0.012, 0), (0.012, height - 0.004), (0.008, height), (0, height)], 12)
    return [Part(peg, pick(rng, palette.WOODS, unlike=cover))]


def _jewel(cover: Material, rng: np.random.Generator) -> list[Part]:
    return hardware.indicator(float(rng.uniform(0.010, 0.016)), pick(rng, palette.ACCENTS, unlike=cover), palette.BRASS)


def _label(cover: Material, rng: np.random.Generator) -> list[Part]:
    paper = pick(rng, (palette.WHITE, palette.IVORY, palette.BLACK, palette.BRASS), unlike=cover)
    return [Part(prism(rectangle(0.05, 0.022, 0.004), 0, 0.004, bevel=0.001), paper)]


def _vent(cover: Material, rng: np.random.Generator) -> list[Part]:
    del cover, rng
    return [Part(prism(circle(0.006, 8), 0, 0.0022).moved(x), palette.SHADOW) for x in (-0.016, 0.0, 0.016)]
