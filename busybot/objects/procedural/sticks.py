"""Training levers that stand up and swing: sticks with many heads and boots, blades, stirrups, rows of levers."""

import numpy as np

from busybot.objects.procedural import palette
from busybot.objects.procedural.design import (
    SWITCH_SCALE,
    Design,
    Material,
    MovingLink,
    Part,
    facing,
    hinge_directions,
    shifted,
    slide_directions,
)
from busybot.objects.procedural.grounds import Ground, clutter, corners, ground
from busybot.objects.procedural.mechanisms import swung
from busybot.objects.procedural.palette import pick
from busybot.objects.procedural.shapes import HEADS, collar, head, lying
from busybot.objects.procedural.solids import (
    ball,
    bent,
    box,
    frame,
    lathe,
    prism,
    rectangle,
    smooth,
    torus,
    tube,
)


def _boot(variant: int, base: Ground, travel: float, rng: np.random.Generator) -> list[Part]:
    """Where a lever leaves its base: a slotted plate, a dome, rubber folds, a hexagonal nut."""
    dark = pick(rng, (palette.BLACK, palette.IRON, palette.GRAPHITE), unlike=base.cover)
    if variant % 4 == 0:
        rim = rectangle(travel + 0.05, 0.04, 0.018, 5)
        return shifted(
            collar(rim, 0.014, 0.012, pick(rng, palette.METALS, unlike=base.cover)), (0, 0, base.top - 0.001)
        )
    if variant % 4 == 1:
        dome = ball(0.07, 28, 10).stretched(z=0.55)
        return [Part(dome.moved(z=base.top), dark), Part(torus(0.07, 0.012, 28, 8).moved(z=base.top), palette.CHROME)]
    if variant % 4 == 2:
        rows = [(0.085, 0.0), (0.09, 0.01), (0.066, 0.02), (0.072, 0.03), (0.046, 0.04), (0.05, 0.05)]
        return [Part(lathe([*smooth(rows, 2), (0.0, 0.052)], 24).moved(z=base.top - 0.001), dark)]
    walls = [box(travel + 0.10, 0.022, 0.06, 0.008).moved(0, y, base.top - 0.001) for y in (-0.045, 0.045)]
    return [Part(wall, pick(rng, palette.METALS, unlike=base.cover)) for wall in walls]


def _lever(kind: str, length: float, size: float, metal: Material, color: Material) -> list[Part]:
    """A stem with a head."""
    thick = (0.016, 0.022)[kind in ("cube", "drum", "fin")]
    stem = lathe([(thick, -0.02), (0.8 * thick, length)], 14)
    return [Part(stem, metal), *shifted(head(kind, size, color), (0, 0, length - 0.1 * size))]


def stick(variant: int, rng: np.random.Generator) -> Design:
    """A lever with two rests, short or tall, whose head, boot and direction go through all there are."""
    length, size = (0.15, 0.09, 0.20, 0.12)[variant % 4], (0.044, 0.036, 0.052, 0.030, 0.060)[variant % 5]
    swing = (0.42, 0.50, 0.34)[variant % 3]
    width, height = (0.27, 0.24, 0.31, 0.22)[variant % 4], (0.22, 0.27, 0.24)[variant % 3]
    base = ground(width, height, variant, rng)
    body = [*base.parts, *_boot(variant + variant // 4, base, 0.07, rng)]
    body += clutter(base, corners(width, height), rng) if variant % 5 < 4 else []
    color, metal = pick(rng, palette.ACCENTS, unlike=base.cover), pick(rng, palette.METALS)
    parts = _lever(HEADS[variant % len(HEADS)], length, size, metal, color)
    link = swung(parts, (0, 0, base.top + 0.01), swing)
    design = Design("Switch", SWITCH_SCALE, body, [link], directions=hinge_directions("x"))
    return facing(design, variant + variant // 4)


def gear(variant: int, rng: np.random.Generator) -> Design:
    """A lever with three rests, between marks."""
    length, size = (0.14, 0.20, 0.16, 0.11)[variant % 4], (0.05, 0.042, 0.055, 0.038)[variant % 4]
    width, height = ((0.36, 0.24), (0.33, 0.30), (0.40, 0.20), (0.34, 0.26))[variant % 4]
    base = ground(width, height, (1, 2, 0, 3)[variant % 4], rng)
    body = [*base.parts, *_boot(variant + 3, base, 0.14, rng)]
    for k, color in enumerate((palette.RED, palette.WHITE, palette.FOREST)):
        dot = lathe([(0.014, 0), (0.012, 0.003), (0, 0.0035)], 14)
        body.append(Part(dot.moved(0.09 * (k - 1), 0.4 * height, base.top - 0.001), color))
    color, metal = pick(rng, palette.ACCENTS, unlike=base.cover), pick(rng, palette.METALS)
    parts = _lever(("bar", "egg", "coin", "fin")[variant % 4], length, size, metal, color)
    link = swung(parts, (0, 0, base.top + 0.01), 0.5, "large")
    design = Design("Switch", SWITCH_SCALE, body, [link], directions=slide_directions("x"))
    return facing(design, variant + variant // 4)


def blade(variant: int, rng: np.random.Generator) -> Design:
    """A wide flat lever, like a fin, in a slot."""
    width, tall = (0.13, 0.18, 0.10)[variant % 3], (0.10, 0.075, 0.13)[variant % 3]
    base = ground(0.25, width + 0.11, (0, 3, 1)[variant % 3], rng)
    rim = rectangle(0.10, width + 0.012, 0.012)
    body = [*base.parts, *shifted(collar(rim, 0.012, 0.014, pick(rng, palette.METALS)), (0, 0, base.top - 0.001))]
    body += clutter(base, [(s * 0.095, 0.0) for s in (-1, 1)], rng)
    color = pick(rng, (*palette.ACCENTS, palette.WHITE), unlike=base.cover)
    fin = prism(rectangle(0.024, width, 0.008), -0.01, tall, bevel=0.007)
    tip = lying(0.017, width).moved(z=tall)
    link = swung([Part(fin, color), Part(tip, color)], (0, 0, base.top + 0.012), (0.45, 0.35, 0.5)[variant % 3])
    design = Design("Switch", SWITCH_SCALE, body, [link], directions=hinge_directions("x"))
    return facing(design, variant)


def stirrup(variant: int, rng: np.random.Generator) -> Design:
    """An upright loop held at both feet that swings to both sides, with rests at the ends and midway."""
    width, tall = (0.15, 0.11, 0.20)[variant % 3], (0.14, 0.19, 0.11)[variant % 3]
    base = ground((0.30, 0.28, 0.32)[variant % 3], width + 0.10, (2, 4, 0)[variant % 3], rng)
    metal, wire = pick(rng, palette.METALS, unlike=base.cover), (0.014, 0.017, 0.012)[variant % 3]
    body = list(base.parts)
    for side in (-1, 1):
        y = side * width / 2
        body.append(Part(lathe([(0.034, 0), (0.03, 0.02), (0, 0.024)], 20).moved(0, y, base.top - 0.001), palette.IRON))
        slot = frame(rectangle(0.16, 0.024, 0.012, 5), rectangle(0.14, 0.008, 0.004, 5), 0, 0.006, 0.002)
        body.append(Part(slot.moved(0, y, base.top - 0.001), palette.STEEL))
    path = [(0, -width / 2, 0), (0, -width / 2, tall), (0, width / 2, tall), (0, width / 2, 0)]
    loop = tube(bent(path, (0.05, 0.055, 0.03)[variant % 3], 5), wire, 12)
    parts = [Part(loop, metal)]
    if variant % 3 != 2:
        parts.append(Part(lying(1.8 * wire, 0.5 * width).moved(z=tall), pick(rng, palette.ACCENTS, unlike=base.cover)))
    link = swung(parts, (0, 0, base.top + 0.014), 0.5, "large")
    design = Design("Switch", SWITCH_SCALE, body, [link], directions=slide_directions("x"))
    return facing(design, variant + 1)


def levers(variant: int, rng: np.random.Generator) -> Design:
    """2 or 3 thin levers side by side that swing in parallel slots."""
    count, pitch = (2, 3, 3)[variant % 3], (0.12, 0.10, 0.085)[variant % 3]
    across = pitch * count + 0.08
    base = ground(0.30, across, (1, 2, 3)[variant % 3], rng)
    body, links = list(base.parts), list[MovingLink]()
    metal = pick(rng, palette.METALS)
    for k in range(count):
        y = pitch * (k - (count - 1) / 2)
        rim = rectangle(0.12, 0.026, 0.012, 5)
        body += shifted(collar(rim, 0.008, 0.010, pick(rng, palette.METALS)), (0, y, base.top - 0.001))
        color = palette.ACCENTS[(k * 3 + variant) % len(palette.ACCENTS)]
        kind, length = ("cube", "coin", "bar")[variant % 3], (0.12, 0.15, 0.10)[variant % 3]
        parts = _lever(kind, length, (0.032, 0.042, 0.026)[variant % 3], metal, color)
        links.append(swung(parts, (0, y, base.top + 0.008), 0.4))
    design = Design("Switch", SWITCH_SCALE, body, links, directions=hinge_directions("x"))
    return facing(design, variant + 1)
