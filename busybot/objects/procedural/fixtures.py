"""Things that switches share: joints, plates, screws, collars, rockers, bat levers, caps, marks, bases and clutter.

Functions return parts around the origin, standing on z = 0 unless they say otherwise. The parts of joints are given
around the origin, or around the hinge; `at` says where that is on the object.

Bases of training switches have many outlines and thicknesses. Clutter keeps a policy from taking everything that stands
out for a switch: screws, labels, vents, bumps, pegs, jewels. It is small, low, does not move, and has no gap around it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from busybot.objects.procedural import cad, palette
from busybot.objects.procedural.design import Material, MovingLink, Part, Vector, shifted
from busybot.objects.procedural.palette import pick

Kind = Literal["small", "large"]


def pressed(parts: Sequence[Part], at: Vector, travel: float) -> MovingLink:
    """Straight down by `travel`."""
    return MovingLink(shifted(parts, at), "prismatic", at, (0, 0, -1), 0.0, travel, "small", "button")


def swung(parts: Sequence[Part], at: Vector, swing: float, kind: Kind = "small", label: str = "lever") -> MovingLink:
    """To both sides along x, by `swing` radians each."""
    return MovingLink(shifted(parts, at), "revolute", at, (0, 1, 0), -swing, swing, kind, label)


def lifted(parts: Sequence[Part], at: Vector, angle: float) -> MovingLink:
    """Hinged at `at`: what lies at higher x comes up by `angle` radians."""
    return MovingLink(shifted(parts, at), "revolute", at, (0, -1, 0), 0.0, angle, "small", "lever")


def trodden(parts: Sequence[Part], at: Vector, angle: float) -> MovingLink:
    """Hinged at `at`: what lies at higher x goes down by `angle` radians."""
    return MovingLink(shifted(parts, at), "revolute", at, (0, 1, 0), 0.0, angle, "small", "pedal")


def slid(parts: Sequence[Part], at: Vector, travel: float, kind: Kind = "small") -> MovingLink:
    """Along x, by half of `travel` to both sides."""
    return MovingLink(shifted(parts, at), "prismatic", at, (1, 0, 0), -travel / 2, travel / 2, kind, "slider")


def turned(parts: Sequence[Part], at: Vector, swing: float, kind: Kind = "small") -> MovingLink:
    """About z, by `swing` radians to both sides."""
    return MovingLink(shifted(parts, at), "revolute", at, (0, 0, 1), -swing, swing, kind, "knob")


TOP = 0.03
"""Height of the upper face of a cover plate."""


def screw(
    x: float, y: float, z: float, turn: float, material: Material = palette.STEEL, radius: float = 0.012
) -> list[Part]:
    """A slotted screw head with its foot at (x, y, z)."""
    head = cad.lathe([(radius, 0), (radius, 0.003), (0.7 * radius, 0.0065), (0, 0.0072)], 12)
    slot = cad.box(1.5 * radius, 0.22 * radius, 0.0015).moved(z=0.0068).turned("z", turn)
    return [Part(head.moved(x, y, z), material), Part(slot.moved(x, y, z), palette.SHADOW)]


def plate(
    width: float,
    height: float,
    material: Material,
    rng: np.random.Generator,
    screws: str = "corners",
    radius: float = 0.03,
) -> list[Part]:
    """A cover plate with a rounded rim and screws: `corners`, `ends` (left and right), `poles` or `none`."""
    outline = cad.rectangle(width, height, radius)
    parts = [Part(cad.prism(outline, 0, TOP, bevel=0.010, steps=3), material)]
    x, y = width / 2 - 0.028, height / 2 - 0.028
    places = {
        "corners": [(sx * x, sy * y) for sx in (-1, 1) for sy in (-1, 1)],
        "ends": [(-x, 0.0), (x, 0.0)],
        "poles": [(0.0, -y), (0.0, y)],
        "none": [],
    }[screws]
    for place in places:
        parts += screw(*place, TOP - 0.001, float(rng.uniform(0, np.pi)))
    return parts


def bezel(
    width: float, height: float, rim: float, rise: float, material: Material, radius: float = 0.016
) -> list[Part]:
    """A raised frame around a dark well; outer size is width x height."""
    outer = cad.rectangle(width, height, radius)
    inner = cad.rectangle(width - 2 * rim, height - 2 * rim, max(radius - rim, 0.004))
    floor = cad.prism(cad.rectangle(width - rim, height - rim, radius), 0, 0.002)
    return [Part(cad.frame(outer, inner, 0, rise, bevel=0.3 * rim), material), Part(floor, palette.SHADOW)]


def round_bezel(outer: float, inner: float, rise: float, material: Material) -> list[Part]:
    """A turned collar around a dark well."""
    lip = 0.35 * (outer - inner)
    rings = [(outer, 0.0), (outer, rise - lip), (outer - 0.4 * lip, rise - 0.3 * lip), (outer - lip, rise)]
    rings += [(inner + 0.5 * lip, rise), (inner, rise - 0.5 * lip), (inner, 0.0)]
    collar = cad.closed_loft([cad.ring(cad.circle(radius, 32), z) for radius, z in rings])
    return [Part(collar, material), Part(cad.lathe([(inner + lip, 0), (inner + lip, 0.002)], 32), palette.SHADOW)]


def rocker_body(width: float, length: float, ends: float, middle: float, depth: float) -> cad.Solid:
    """A rocker that tilts about y: its top dips from `ends` (at x = +-length / 2) to `middle`."""
    xs = np.linspace(length / 2, -length / 2, 13)
    dip = middle + (ends - middle) * np.abs(2 * xs / length) ** 1.6
    section = [(-length / 2, -depth), (length / 2, -depth), *zip(xs.tolist(), dip.tolist(), strict=True)]
    outline = np.array(section)
    edge = 0.006
    rings = [cad.ring(cad.inset(outline, edge), -width / 2), cad.ring(outline, -width / 2 + edge)]
    rings += [cad.ring(outline, width / 2 - edge), cad.ring(cad.inset(outline, edge), width / 2)]
    # the end fans start low, where they see every point of the dipping top
    first, last = (np.array([0.0, -0.8 * depth, side * width / 2]) for side in (-1, 1))
    # the section's plane is x-z: its y becomes z
    return cad.loft(rings, (first, last)).turned("x", np.pi / 2)


def mark_bar(length: float, material: Material = palette.WHITE) -> Part:
    """The sign for on: a bar along y."""
    return Part(cad.box(0.18 * length, length, 0.002, 0.0008), material)


def mark_ring(radius: float, material: Material = palette.WHITE) -> Part:
    """The sign for off: a flat ring."""
    outline = cad.circle(radius, 20)
    return Part(cad.frame(outline, 0.68 * outline, 0, 0.002, 0.0006), material)


def indicator(radius: float, material: Material, metal: Material) -> list[Part]:
    """A small jewel lamp in a metal ring."""
    jewel = cad.ball(radius, 14, 6).stretched(z=0.7)
    return [Part(cad.torus(1.15 * radius, 0.3 * radius, 18, 6).moved(z=0.001), metal), Part(jewel, material)]


def hex_collar(radius: float, metal: Material) -> list[Part]:
    """Washer, hexagonal nut and threaded neck of a toggle switch; the neck ends at z = 0.6 radius."""
    washer = cad.lathe([(1.25 * radius, 0), (1.25 * radius, 0.008), (1.18 * radius, 0.012)], 28)
    nut = cad.prism(cad.circle(radius, 6, 0.2), 0.008, 0.40 * radius, bevel=0.006)
    turns = enumerate(np.linspace(0.3 * radius, 0.6 * radius, 4).tolist())
    profile = [(0.62 * radius - 0.004 * (k % 2), z) for k, z in turns]
    neck = cad.lathe([*profile, (0.45 * radius, 0.62 * radius)], 16)
    return [Part(solid, metal) for solid in (washer, nut, neck)]


def bat(length: float, radius: float, metal: Material, tip: Material) -> list[Part]:
    """A tapered toggle lever along z with a plastic tip; its foot is at the origin."""
    foot, neck = [(0.45 * radius, -0.02), (0.5 * radius, 0)], [(0.8 * radius, share * length) for share in (0.55, 0.6)]
    stem = cad.lathe([*foot, *neck], 16)
    profile = [(0.86 * radius, 0.5 * length), (radius, 0.58 * length), (1.08 * radius, 0.78 * length)]
    profile += [(0.98 * radius, 0.91 * length), (0.6 * radius, 0.985 * length), (0.0, length)]
    return [Part(stem, metal), Part(cad.lathe(cad.smooth(profile, 2), 18), tip)]


def dish_cap(radius: float, height: float) -> cad.Solid:
    """A round button with a dished top; its rim is at `height`, its hidden skirt reaches down to -0.03."""
    top = [(radius, height - 0.010), (0.97 * radius, height - 0.003), (0.90 * radius, height)]
    dish = [(0.80 * radius, height - 0.001), (0.5 * radius, height - 0.005), (0.0, height - 0.007)]
    return cad.lathe([(radius, -0.03), *top, *dish], 32)


def slot(width: float, height: float, material: Material, rim: float = 0.012) -> list[Part]:
    """A stadium-shaped groove with a thin rim; inner size is width x height."""
    outer = cad.rectangle(width + 2 * rim, height + 2 * rim, 0.5 * min(width, height) + rim, corner=6)
    inner = cad.rectangle(width, height, 0.5 * min(width, height), corner=6)
    floor = cad.prism(cad.rectangle(width + rim, height + rim, 0.5 * min(width, height), corner=6), 0, 0.002)
    return [Part(cad.frame(outer, inner, 0, 0.010, bevel=0.004), material), Part(floor, palette.SHADOW)]


def ridged_cap(length: float, width: float, height: float, material: Material) -> list[Part]:
    """A slider's grip: a rounded block with five ridges across x."""
    block = cad.prism(cad.rectangle(length, width, 0.2 * min(length, width)), 0, height, bevel=0.2 * height, steps=3)
    ridge = cad.box(0.09 * length, 0.86 * width, 0.008, 0.003).moved(z=height - 0.002)
    ridges = [ridge.moved(share * length) for share in np.linspace(-0.32, 0.32, 5).tolist()]
    return [Part(solid, material) for solid in (block, *ridges)]


CLUTTER = ("screw", "bump", "stud", "peg", "jewel", "label", "vent")
COVERS = (*palette.PLATES, *palette.WOODS, palette.MINT, palette.SKY, palette.BLUSH, palette.STONE, palette.BLACK)


@dataclass(frozen=True, eq=False)
class Ground:
    """A base: its parts, the height of its upper face, and what it is made of."""

    parts: list[Part]
    top: float
    cover: Material


def thin_plate(width: float, height: float, cover: Material, rng: np.random.Generator) -> Ground:
    """A thin cover plate, its corners more or less round."""
    radius = float(rng.uniform(0.012, 0.3 * min(width, height)))
    solid = cad.prism(cad.rectangle(width, height, radius, 5), 0, TOP, bevel=0.010, steps=3)
    return Ground([Part(solid, cover)], TOP, cover)


def slab(width: float, height: float, cover: Material, rng: np.random.Generator) -> Ground:
    """A thick block with a soft edge."""
    top = float(rng.uniform(0.045, 0.085))
    solid = cad.prism(cad.rectangle(width, height, 0.03), 0, top, bevel=0.018, steps=4)
    return Ground([Part(solid, cover)], top, cover)


def plinth(width: float, height: float, cover: Material, rng: np.random.Generator) -> Ground:
    """A plate on a wider foot of another colour."""
    foot = pick(rng, (*palette.WOODS, palette.BLACK, palette.STEEL, palette.WHITE), unlike=cover)
    parts = [Part(cad.prism(cad.rectangle(width, height, 0.02), 0, 0.022, bevel=0.007), foot)]
    upper = cad.rectangle(width - 0.04, height - 0.04, 0.015)
    return Ground([*parts, Part(cad.prism(upper, 0.02, 0.042, bevel=0.008), cover)], 0.042, cover)


def tray(width: float, height: float, cover: Material, rng: np.random.Generator) -> Ground:
    """A plate within a raised rim."""
    rim = pick(rng, (*palette.METALS, *palette.WOODS, palette.BLACK), unlike=cover)
    outer, rise = cad.rectangle(width, height, 0.03), float(rng.uniform(0.042, 0.06))
    wall = cad.frame(outer, cad.inset(outer, 0.016), 0, rise, bevel=0.005)
    return Ground([Part(wall, rim), Part(cad.prism(cad.inset(outer, 0.008), 0, 0.03), cover)], 0.03, cover)


def disc(width: float, height: float, cover: Material, rng: np.random.Generator) -> Ground:
    """An oval turned plate, round if its sides are equal."""
    top = float(rng.uniform(0.028, 0.055))
    solid = cad.prism(1.16 * cad.ellipse(width, height, 40), 0, top, bevel=0.016, steps=4)
    return Ground([Part(solid, cover)], top, cover)


_GROUNDS = (thin_plate, slab, plinth, tray, disc)


def ground(
    width: float, height: float, variant: int, rng: np.random.Generator, covers: Sequence[Material] = COVERS
) -> Ground:
    """One of the bases, counted by the variant, in a colour that is drawn."""
    return _GROUNDS[variant % len(_GROUNDS)](width, height, pick(rng, covers), rng)


def clutter(base: Ground, places: Sequence[tuple[float, float]], rng: np.random.Generator) -> list[Part]:
    """Something that does not move at some of the places, all of one kind or of several."""
    kinds = rng.permutation(len(CLUTTER))[:2]
    parts: list[Part] = []
    for x, y in places:
        if rng.random() < 0.75:
            kind = CLUTTER[int(kinds[int(rng.integers(2))])]
            parts += shifted(_still(kind, base.cover, rng), (x, y, base.top - 0.001))
    return parts


def _still(kind: str, cover: Material, rng: np.random.Generator) -> list[Part]:
    """One of `CLUTTER`, of a size and a colour that are drawn."""
    if kind == "screw":
        return screw(0, 0, 0, float(rng.uniform(0, np.pi)), pick(rng, palette.METALS), 0.014)
    if kind == "jewel":
        return indicator(float(rng.uniform(0.010, 0.016)), pick(rng, palette.ACCENTS, unlike=cover), palette.BRASS)
    if kind == "vent":
        return [Part(cad.prism(cad.circle(0.006, 8), 0, 0.0022).moved(x), palette.SHADOW) for x in (-0.016, 0.0, 0.016)]
    if kind == "bump":
        radius = float(rng.uniform(0.012, 0.024))
        return [Part(cad.ball(radius, 14, 8).stretched(z=float(rng.uniform(0.5, 1.0))), cover)]
    if kind == "stud":
        side = float(rng.uniform(0.02, 0.04))
        return [Part(cad.box(side, side, float(rng.uniform(0.008, 0.03)), 0.004), cover)]
    if kind == "peg":
        height = float(rng.uniform(0.02, 0.05))
        peg = cad.lathe([(0.012, 0), (0.012, height - 0.004), (0.008, height), (0, height)], 12)
        return [Part(peg, pick(rng, palette.WOODS, unlike=cover))]
    label = cad.prism(cad.rectangle(0.05, 0.022, 0.004), 0, 0.004, bevel=0.001)
    return [Part(label, pick(rng, (palette.WHITE, palette.IVORY, palette.BLACK, palette.BRASS), unlike=cover))]


def row(count: int, pitch: float) -> list[float]:
    """Places side by side, around 0."""
    return [pitch * (k - (count - 1) / 2) for k in range(count)]


def corners(width: float, height: float, edge: float = 0.035) -> list[tuple[float, float]]:
    """Places near the corners of a base."""
    return [(sx * (width / 2 - edge), sy * (height / 2 - edge)) for sx in (-1, 1) for sy in (-1, 1)]
