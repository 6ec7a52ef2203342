"""Switches whose shapes a seed draws: families that nobody chose, to judge models that are frozen.

What is taken hold of is a lump between outlines of the superformula [1], which a few heights widen, narrow, twist and
lean. A draw tells how it moves, too: what is pressed, tilts, is lifted, thrown, slid or turned; how far, with two rests
or three; one alone, or up to four of a kind side by side. Bases and clutter are those of the other families, so that
what is new is what moves.

[1] Gielis, A generic geometric transformation that unifies a wide range of natural and abstract shapes, 2003.
"""

from collections.abc import Callable

import numpy as np

from busybot.objects.procedural import cad, palette
from busybot.objects.procedural.design import (
    HINGE_X,
    SLIDE_X,
    TURN_Z,
    Design,
    Material,
    MovingLink,
    Part,
    Vector,
    switch,
)
from busybot.objects.procedural.fixtures import (
    Kind,
    clutter,
    corners,
    ground,
    lifted,
    pressed,
    row,
    slid,
    slot,
    swung,
    turned,
)
from busybot.objects.procedural.grips import rod
from busybot.objects.procedural.palette import pick

POINTS, LEVELS = 48, 9
"""Of an outline; heights of a lump."""
CORE = 0.45
"""An outline comes no nearer to its middle than this share of its reach: thinner spikes nobody could hold."""


def outline(rng: np.random.Generator) -> np.ndarray:
    """A closed curve about the origin, counter-clockwise, float64 (`POINTS`, 2), which reaches 1 at most."""
    lobes, bend = int(rng.integers(0, 9)), float(np.exp(rng.uniform(-1.0, 1.6)))
    first, second = np.exp(rng.uniform(-0.7, 1.6, 2)).tolist()
    angle = np.arange(POINTS) * 2 * np.pi / POINTS
    spread = np.abs(np.cos(lobes * angle / 4)) ** first + np.abs(np.sin(lobes * angle / 4)) ** second
    reach = np.maximum(spread, 1e-6) ** (-1 / bend)
    reach = np.maximum(reach / reach.max(), CORE)
    reach = 0.5 * reach + 0.25 * (np.roll(reach, 1) + np.roll(reach, -1))  # no edge is sharper than a mould's
    turned_by = angle + float(rng.uniform(0, 2 * np.pi))
    return np.asarray(reach[:, None] * np.stack([np.cos(turned_by), np.sin(turned_by)], axis=1))[
        np.argsort(turned_by % (2 * np.pi))
    ]


def lump(rng: np.random.Generator, size: tuple[float, float, float], skirt: float = 0.0) -> cad.Solid:
    """A lump of about this length, width and height on z = 0, or from -skirt on.

    Args:
        skirt: how far its lowest outline goes straight down.
    """
    rim = outline(rng) * np.array([size[0] / 2, size[1] / 2])
    share = np.linspace(0, 1, LEVELS)
    widths = np.interp(share, (0, 0.35, 0.7, 1), (1.0, *rng.uniform((0.6, 0.5, 0.35), (1.25, 1.2, 0.9))))
    widths[-1] = min(widths[-1], 0.85 * widths[-2])  # its upper edge is broken
    twist, lean = float(rng.choice([0.0, rng.uniform(-0.8, 0.8)])), rng.uniform(-0.15, 0.15, 2) * size[0]
    rings = [cad.ring(rim, -skirt)] if skirt else []
    for level, width in zip(share.tolist(), widths.tolist(), strict=True):
        cosine, sine = np.cos(level * twist), np.sin(level * twist)
        section = width * rim @ np.array([[cosine, sine], [-sine, cosine]]) + level**2 * lean
        rings.append(cad.ring(section, level * size[2]))
    top = rings[-1].mean(axis=0) + np.array([0, 0, float(rng.uniform(-0.1, 0.25)) * size[2]])
    return cad.loft(rings, (None, top))


def _colours(rng: np.random.Generator, cover: Material) -> tuple[Material, Material]:
    color = pick(rng, (*palette.ACCENTS, palette.WHITE, palette.BLACK, palette.MINT), unlike=cover)
    return color, pick(rng, (*palette.METALS, palette.IRON), unlike=cover)


Mechanism = tuple[list[Part], MovingLink]
"""What stands still, and what moves."""


def _press(rng: np.random.Generator, place: Vector, width: float, cover: Material) -> Mechanism:
    color, metal = _colours(rng, cover)
    travel, rise = float(rng.uniform(0.012, 0.04)), float(rng.uniform(0.01, 0.03))
    solid = lump(rng, (rng.uniform(0.7, 1.1) * width, width, rng.uniform(0.02, 0.07)), travel + rise)
    at = (place[0], place[1], place[2] + travel + 0.012)
    collar = cad.lathe([(0.62 * width, 0), (0.60 * width, rise), (0.5 * width, rise), (0.0, rise)], 32)
    return [Part(collar.moved(*place), metal)], pressed([Part(solid, color)], at, travel)


def _tilt(rng: np.random.Generator, place: Vector, width: float, cover: Material) -> Mechanism:
    color, metal = _colours(rng, cover)
    length, swing = float(rng.uniform(1.2, 2.2)) * width, float(rng.uniform(0.12, 0.3))
    clearance = length / 2 * float(np.sin(swing)) * 0.8 + 0.006
    post = cad.lathe([(0.3 * width, 0), (0.16 * width, clearance), (0.0, clearance)], 20)
    solid = lump(rng, (length, width, rng.uniform(0.02, 0.05)))
    at = (place[0], place[1], place[2] + clearance)
    return [Part(post.moved(*place), metal)], swung([Part(solid, color)], at, swing, label="rocker")


def _throw(rng: np.random.Generator, place: Vector, width: float, cover: Material) -> Mechanism:
    color, metal = _colours(rng, cover)
    reach, swing, kind = float(rng.uniform(0.07, 0.16)), float(rng.uniform(0.35, 0.6)), _kind(rng)
    solid = lump(rng, (0.75 * width, 0.75 * width, rng.uniform(0.04, 0.09)))
    parts = [Part(rod((0, 0, 0), (0, 0, reach + 0.02), 0.014), metal), Part(solid.moved(z=reach), color)]
    nest = cad.lathe([(0.5 * width, 0), (0.4 * width, 0.02), (0.0, 0.022)], 24)
    return [Part(nest.moved(*place), metal)], swung(parts, place, swing, kind)


def _lift(rng: np.random.Generator, place: Vector, width: float, cover: Material) -> Mechanism:
    color, metal = _colours(rng, cover)
    length = float(rng.uniform(1.3, 2.2)) * width
    solid = lump(rng, (length, width, rng.uniform(0.015, 0.04))).moved(length / 2)
    rail = rod((0, -width / 2, 0), (0, width / 2, 0), 0.012).moved(place[0] - length / 2, place[1], place[2] + 0.014)
    at = (place[0] - length / 2, place[1], place[2] + 0.012)
    return [Part(rail, metal)], lifted([Part(solid, color)], at, float(rng.uniform(0.45, 0.9)))


def _slide(rng: np.random.Generator, place: Vector, width: float, cover: Material) -> Mechanism:
    color, metal = _colours(rng, cover)
    travel = float(rng.uniform(0.09, 0.2))
    kind: Kind = "large" if travel > 0.16 else "small"
    groove = [part.moved(*place) for part in slot(travel + width, 0.4 * width, metal)]
    solid = lump(rng, (rng.uniform(0.6, 0.9) * width, 0.9 * width, rng.uniform(0.03, 0.09)))
    return groove, slid([Part(solid, color)], (place[0], place[1], place[2] + 0.011), travel, kind)


def _turn(rng: np.random.Generator, place: Vector, width: float, cover: Material) -> Mechanism:
    color, metal = _colours(rng, cover)
    reach, tall = float(rng.uniform(0.9, 1.4)) * width, float(rng.uniform(0.035, 0.08))
    solid = lump(rng, (2 * reach, 0.6 * width, tall)).moved(0.35 * reach)
    foot = cad.lathe([(0.4 * width, 0), (0.36 * width, 0.008), (0.0, 0.008)], 28)
    at = (place[0], place[1], place[2] + 0.009)
    kind = _kind(rng)
    link = turned([Part(solid, color)], at, float(rng.uniform(0.7, 0.9) if kind == "large" else 0.6), kind)
    return [Part(foot.moved(*place), metal)], link


def _kind(rng: np.random.Generator) -> Kind:
    return "large" if rng.random() < 0.4 else "small"


MOTIONS: dict[str, tuple[Callable[[np.random.Generator, Vector, float, Material], Mechanism], tuple[Vector, ...], int]]
MOTIONS = {
    "press": (_press, HINGE_X, 4),
    "tilt": (_tilt, HINGE_X, 3),
    "throw": (_throw, HINGE_X, 3),
    "lift": (_lift, HINGE_X, 2),
    "slide": (_slide, SLIDE_X, 3),
    "turn": (_turn, TURN_Z, 1),
}
"""How each moves: what makes it, the annotated directions, and how many may stand side by side. As with the other
families, a lever that rests midway, too, is annotated like what slides."""


def drawn(variant: int, rng: np.random.Generator) -> Design:
    """A switch whose motion goes through all there are, and whose shapes, sizes, rests and number are drawn."""
    make, directions, most = MOTIONS[tuple(MOTIONS)[variant % len(MOTIONS)]]
    count = 1 if rng.random() < 0.6 else int(rng.integers(1, most + 1))
    width = float(rng.uniform(0.08, 0.15)) if count == 1 else float(rng.uniform(0.055, 0.085))
    pitch = 1.35 * width
    base = ground(float(rng.uniform(0.30, 0.36)), max(pitch * count + 0.06, 0.2), int(rng.integers(5)), rng)
    body, links, state = list(base.parts), [], rng.bit_generator.state
    for y in row(count, pitch):
        rng.bit_generator.state = state  # of a kind
        fixed, link = make(rng, (0.0, y, base.top - 0.001), width, base.cover)
        body += fixed
        links.append(link)
    body += clutter(base, corners(0.3, max(pitch * count + 0.06, 0.2), 0.03), rng) if count == 1 else []
    along = SLIDE_X if make is _throw and links[0].kind == "large" else directions
    return switch(body, links, along, int(rng.integers(4)))
