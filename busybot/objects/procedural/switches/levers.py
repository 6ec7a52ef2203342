"""Levers: multi-direction triggers, which rest at both ends and midway, and training levers that stand up and swing.

Multi-direction: throttle, joystick, fader; novel: T-bar, rails. Others: sticks with many heads and boots, blades,
stirrups, rows of levers.
"""

import numpy as np

from busybot.objects.procedural import cad, fixtures, palette
from busybot.objects.procedural.design import HINGE_X, SLIDE_X, Design, Material, MovingLink, Part, shifted, switch
from busybot.objects.procedural.fixtures import TOP, Ground, clutter, corners, ground, row, slid, swung
from busybot.objects.procedural.grips import HEADS, collar, head, lying
from busybot.objects.procedural.palette import in_turn, pick


def drum(radius: float, width: float, edge: float = 0.012) -> cad.Solid:
    """A half cylinder that lies on z = 0 along y."""
    angles = np.linspace(0, np.pi, 19)
    outline = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return cad.prism(outline, -width / 2, width / 2, bevel=edge, foot=edge).turned("x", np.pi / 2)


def ticks(places: list[tuple[float, float]], z: float, rng: np.random.Generator) -> list[Part]:
    """Three dots of different colours that mark the rest positions."""
    colors = rng.permutation(len(palette.ACCENTS))[:3]
    dot = cad.lathe([(0.014, 0), (0.013, 0.002), (0, 0.0025)], 16)
    return [Part(dot.moved(x, y, z), palette.ACCENTS[c]) for (x, y), c in zip(places, colors, strict=True)]


def lever_link(parts: list[Part], z: float) -> MovingLink:
    """A lever with three rests that swings along x about (0, 0, z); its parts stand upright there."""
    return swung(parts, (0, 0, z), 0.5, "large")


def throttle(variant: int, rng: np.random.Generator) -> Design:
    """A lever with a ball, out of a slotted drum."""
    cover = in_turn((palette.NAVY, palette.IVORY), variant)
    metal = pick(rng, palette.METALS)
    body = fixtures.plate(0.38, 0.24, cover, rng, "corners")
    shell = pick(rng, (palette.STEEL, palette.PEARL, palette.BLACK), unlike=cover)
    body.append(Part(drum(0.115, 0.15).moved(z=TOP - 0.002), shell))
    body.append(Part(drum(0.117, 0.045, 0.002).moved(z=TOP - 0.002), palette.SHADOW))
    body += [Part(drum(0.122, 0.012, 0.004).moved(y=y, z=TOP - 0.002), metal) for y in (-0.065, 0.065)]
    body += ticks([(-0.145, 0.0), (0.0, 0.10), (0.145, 0.0)], TOP, rng)
    stem = cad.pipe([(0, 0, 0.0), (0, 0, 0.1), (0, 0, 0.205)], 0.014, 12)
    pear = [(0.016, 0.0), (0.026, 0.02), (0.050, 0.065), (0.044, 0.10), (0.020, 0.115), (0.0, 0.117)]
    knob = cad.lathe(cad.smooth(pear, 3), 22).moved(z=0.175) if variant % 2 else cad.ball(0.052, 24, 12).moved(z=0.232)
    parts = [Part(stem, metal), Part(cad.torus(0.018, 0.008, 18, 8).moved(z=0.185), metal)]
    parts.append(Part(knob, pick(rng, palette.ACCENTS, unlike=shell)))
    return switch(body, [lever_link(parts, TOP)], SLIDE_X)


def joystick(_variant: int, rng: np.random.Generator) -> Design:
    """A stick with a knurled knob, out of a rubber bellows; it moves along x only."""
    cover = pick(rng, (palette.WHITE, palette.STEEL, palette.MUSTARD, palette.TEAL))
    body = fixtures.plate(0.32, 0.32, cover, rng, "corners", 0.07)
    folds = [(0.105, 0.0), (0.112, 0.012), (0.09, 0.022), (0.097, 0.034), (0.074, 0.044), (0.08, 0.056), (0.055, 0.066)]
    body.append(Part(cad.lathe([*cad.smooth(folds, 2), (0.0, 0.068)], 28).moved(z=TOP - 0.001), palette.BLACK))
    body += ticks([(-0.135, 0.0), (0.0, 0.135), (0.135, 0.0)], TOP, rng)
    parts = [Part(cad.lathe([(0.020, 0.0), (0.016, 0.10), (0.015, 0.19)], 14), palette.CHROME)]
    color = pick(rng, (palette.RED, palette.ORANGE, palette.PLUM), unlike=cover)
    knob = cad.prism(cad.wavy(0.052, 0.00182, 20, 4), 0.18, 0.225, bevel=0.00624)
    disc = cad.lathe([(0.03744, 0.225), (0.0364, 0.228), (0.0, 0.2285)], 28)
    parts += [Part(knob, color), Part(disc, palette.CHROME)]
    return switch(body, [lever_link(parts, TOP + 0.02)], SLIDE_X)


def fader(variant: int, rng: np.random.Generator) -> Design:
    """A mixing-desk fader along x."""
    cover = in_turn((palette.GRAPHITE, palette.IVORY, palette.STEEL), variant)
    grip = pick(rng, (palette.WHITE, *palette.ACCENTS), unlike=cover)
    width, travel = (0.48, 0.44, 0.52)[variant % 3], (0.24, 0.21, 0.27)[variant % 3]
    body = fixtures.plate(width, 0.20, cover, rng, "ends", (0.02, 0.06, 0.03)[variant % 3])
    body += shifted(fixtures.slot(travel + 0.05, 0.022, palette.STEEL, 0.008), (0, 0, TOP - 0.001))
    line = palette.WHITE if sum(cover.color) < 1.8 else palette.GRAPHITE
    for k in range(9):
        x = travel * (k / 8 - 0.5)
        tick = cad.box(0.005, 0.022 if k % 4 == 0 else 0.012, 0.0015)
        body += [Part(tick.moved(x, y, TOP - 0.0003), line) for y in (0.055, -0.055)]
    body += ticks([(-travel / 2, 0.083), (0.0, 0.083), (travel / 2, 0.083)], TOP - 0.002, rng)
    return switch(body, [slid(_fader_cap(grip), (0, 0, TOP + 0.006), travel, "large")], SLIDE_X)


def _fader_cap(grip: Material) -> list[Part]:
    """A waisted cap with a white line: high at both ends, low in the middle."""
    xs = np.linspace(0.034, -0.034, 9)
    section = [(-0.042, 0.0), (0.042, 0.0), *((float(x), 0.034 + 14.0 * float(x) ** 2) for x in xs)]
    body = cad.prism(np.array(section), -0.045, 0.045, bevel=0.006, foot=0.006).turned("x", np.pi / 2)
    mark = palette.WHITE if sum(grip.color) < 2.4 else palette.RED
    return [Part(body, grip), Part(cad.box(0.007, 0.084, 0.002).moved(z=0.0338), mark)]


def tbar(_variant: int, rng: np.random.Generator) -> Design:
    """Novel: an aircraft's throttle, a wide grip on two arms over a rounded console."""
    cover = pick(rng, (palette.PEARL, palette.SAGE, palette.STONE))
    grip = pick(rng, (palette.RED, palette.NAVY, palette.BLACK))
    body = [Part(cad.prism(cad.rectangle(0.36, 0.30, 0.06), 0, 0.05, bevel=0.024, steps=4), cover)]
    body.append(Part(drum(0.085, 0.13, 0.006).moved(z=0.048), cover))
    for y in (-0.082, 0.082):
        outer, inner = cad.rectangle(0.25, 0.030, 0.015, 5), cad.rectangle(0.23, 0.012, 0.006, 5)
        body.append(Part(cad.frame(outer, inner, 0.048, 0.056, 0.003).moved(y=y), palette.CHROME))
        body.append(Part(cad.box(0.23, 0.014, 0.003).moved(y=y, z=0.0485), palette.SHADOW))
    body += ticks([(-0.11, 0.122), (0.0, 0.122), (0.11, 0.122)], 0.047, rng)
    parts = []
    for y in (-0.082, 0.082):
        arm = cad.bent([(0, y, 0.0), (0, y, 0.12), (0, y * 0.75, 0.185)], 0.04, 4)
        parts.append(Part(cad.pipe(arm, 0.011, 10), palette.CHROME))
    parts.append(Part(cad.pipe([(0, y, 0.19) for y in (-0.11, -0.10, 0.10, 0.11)], 0.030, 18), grip))
    band = cad.torus(0.031, 0.004, 20, 6).turned("x", np.pi / 2)
    parts += [Part(band.moved(y=y, z=0.19), palette.CHROME) for y in (-0.07, 0.07)]
    return switch(body, [lever_link(parts, 0.045)], SLIDE_X)


def rails(variant: int, rng: np.random.Generator) -> Design:
    """Novel: a ring on a carriage that runs on two rods between wooden blocks."""
    wood, metal = ((palette.WALNUT, palette.BRASS), (palette.BIRCH, palette.STEEL))[variant % 2]
    low = cad.prism(cad.rectangle(0.50, 0.22, 0.015), 0, 0.022, bevel=0.008)
    body = [Part(low, pick(rng, (palette.SAGE, palette.NAVY, palette.BLUSH)))]
    for x in (-0.215, 0.215):
        body.append(Part(cad.box(0.05, 0.20, 0.085, 0.014).moved(x), wood))
        body += [part for y in (-0.075, 0.075) for part in fixtures.screw(x, y, 0.083, float(rng.uniform(0, 3)), metal)]
    body += [Part(cad.pipe([(-0.20, y, 0.055), (0.20, y, 0.055)], 0.011, 12), metal) for y in (-0.055, 0.055)]
    body += ticks([(-0.125, 0.0), (0.0, 0.0), (0.125, 0.0)], 0.021, rng)
    color = pick(rng, (palette.ORANGE, palette.TEAL, palette.RED))
    parts = [Part(cad.box(0.085, 0.15, 0.036, 0.012).moved(z=0.037), color)]
    parts.append(Part(cad.torus(0.040, 0.011, 24, 8).turned("x", np.pi / 2).moved(z=0.105), metal))
    parts.append(Part(cad.lathe([(0.022, 0.07), (0.018, 0.078), (0, 0.080)], 18), metal))
    return switch(body, [slid(parts, (0, 0, 0), 0.25, "large")], SLIDE_X)


def _boot(variant: int, base: Ground, travel: float, rng: np.random.Generator) -> list[Part]:
    """Where a lever leaves its base: a slotted plate, a dome, rubber folds, a hexagonal nut."""
    dark = pick(rng, (palette.BLACK, palette.IRON, palette.GRAPHITE), unlike=base.cover)
    if variant % 4 == 0:
        metal = pick(rng, palette.METALS, unlike=base.cover)
        rim = cad.rectangle(travel + 0.05, 0.04, 0.018, 5)
        return shifted(collar(rim, 0.014, 0.012, metal), (0, 0, base.top - 0.001))
    if variant % 4 == 1:
        dome, edge = cad.ball(0.07, 28, 10).stretched(z=0.55), cad.torus(0.07, 0.012, 28, 8)
        return [Part(dome.moved(z=base.top), dark), Part(edge.moved(z=base.top), palette.CHROME)]
    if variant % 4 == 2:
        rows = [(0.085, 0.0), (0.09, 0.01), (0.066, 0.02), (0.072, 0.03), (0.046, 0.04), (0.05, 0.05)]
        return [Part(cad.lathe([*cad.smooth(rows, 2), (0.0, 0.052)], 24).moved(z=base.top - 0.001), dark)]
    walls = [cad.box(travel + 0.10, 0.022, 0.06, 0.008).moved(0, y, base.top - 0.001) for y in (-0.045, 0.045)]
    return [Part(wall, pick(rng, palette.METALS, unlike=base.cover)) for wall in walls]


def _lever(kind: str, length: float, size: float, metal: Material, color: Material) -> list[Part]:
    """A stem with a head."""
    thick = (0.016, 0.022)[kind in ("cube", "drum", "fin")]
    stem = cad.lathe([(thick, -0.02), (0.8 * thick, length)], 14)
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
    return switch(body, [swung(parts, (0, 0, base.top + 0.01), swing)], HINGE_X, variant + variant // 4)


def gear(variant: int, rng: np.random.Generator) -> Design:
    """A lever with three rests, between marks."""
    length, size = (0.14, 0.20, 0.16, 0.11)[variant % 4], (0.05, 0.042, 0.055, 0.038)[variant % 4]
    width, height = ((0.36, 0.24), (0.33, 0.30), (0.40, 0.20), (0.34, 0.26))[variant % 4]
    base = ground(width, height, (1, 2, 0, 3)[variant % 4], rng)
    body = [*base.parts, *_boot(variant + 3, base, 0.14, rng)]
    for k, color in enumerate((palette.RED, palette.WHITE, palette.FOREST)):
        dot = cad.lathe([(0.014, 0), (0.012, 0.003), (0, 0.0035)], 14)
        body.append(Part(dot.moved(0.09 * (k - 1), 0.4 * height, base.top - 0.001), color))
    color, metal = pick(rng, palette.ACCENTS, unlike=base.cover), pick(rng, palette.METALS)
    parts = _lever(("bar", "egg", "coin", "fin")[variant % 4], length, size, metal, color)
    return switch(body, [lever_link(parts, base.top + 0.01)], SLIDE_X, variant + variant // 4)


def blade(variant: int, rng: np.random.Generator) -> Design:
    """A wide flat lever, like a fin, in a slot."""
    width, tall = (0.13, 0.18, 0.10)[variant % 3], (0.10, 0.075, 0.13)[variant % 3]
    base = ground(0.25, width + 0.11, (0, 3, 1)[variant % 3], rng)
    rim = cad.rectangle(0.10, width + 0.012, 0.012)
    body = [*base.parts, *shifted(collar(rim, 0.012, 0.014, pick(rng, palette.METALS)), (0, 0, base.top - 0.001))]
    body += clutter(base, [(s * 0.095, 0.0) for s in (-1, 1)], rng)
    color = pick(rng, (*palette.ACCENTS, palette.WHITE), unlike=base.cover)
    fin = cad.prism(cad.rectangle(0.024, width, 0.008), -0.01, tall, bevel=0.007)
    tip = lying(0.017, width).moved(z=tall)
    link = swung([Part(fin, color), Part(tip, color)], (0, 0, base.top + 0.012), (0.45, 0.35, 0.5)[variant % 3])
    return switch(body, [link], HINGE_X, variant)


def stirrup(variant: int, rng: np.random.Generator) -> Design:
    """An upright loop held at both feet that swings to both sides, with rests at the ends and midway."""
    width, tall = (0.15, 0.11, 0.20)[variant % 3], (0.14, 0.19, 0.11)[variant % 3]
    base = ground((0.30, 0.28, 0.32)[variant % 3], width + 0.10, (2, 4, 0)[variant % 3], rng)
    metal, wire = pick(rng, palette.METALS, unlike=base.cover), (0.014, 0.017, 0.012)[variant % 3]
    body = list(base.parts)
    for side in (-1, 1):
        y = side * width / 2
        foot = cad.lathe([(0.034, 0), (0.03, 0.02), (0, 0.024)], 20)
        body.append(Part(foot.moved(0, y, base.top - 0.001), palette.IRON))
        slot = cad.frame(cad.rectangle(0.16, 0.024, 0.012, 5), cad.rectangle(0.14, 0.008, 0.004, 5), 0, 0.006, 0.002)
        body.append(Part(slot.moved(0, y, base.top - 0.001), palette.STEEL))
    path = [(0, -width / 2, 0), (0, -width / 2, tall), (0, width / 2, tall), (0, width / 2, 0)]
    loop = cad.pipe(cad.bent(path, (0.05, 0.055, 0.03)[variant % 3], 5), wire, 12)
    parts = [Part(loop, metal)]
    if variant % 3 != 2:
        parts.append(Part(lying(1.8 * wire, 0.5 * width).moved(z=tall), pick(rng, palette.ACCENTS, unlike=base.cover)))
    return switch(body, [lever_link(parts, base.top + 0.014)], SLIDE_X, variant + 1)


def levers(variant: int, rng: np.random.Generator) -> Design:
    """2 or 3 thin levers side by side that swing in parallel slots."""
    count, pitch = ((2, 0.12), (3, 0.10), (3, 0.085))[variant % 3]
    kind, length, size = (("cube", 0.12, 0.032), ("coin", 0.15, 0.042), ("bar", 0.10, 0.026))[variant % 3]
    base = ground(0.30, pitch * count + 0.08, (1, 2, 3)[variant % 3], rng)
    body, links = list(base.parts), []
    metal = pick(rng, palette.METALS)
    for k, y in enumerate(row(count, pitch)):
        rim = cad.rectangle(0.12, 0.026, 0.012, 5)
        body += shifted(collar(rim, 0.008, 0.010, pick(rng, palette.METALS)), (0, y, base.top - 0.001))
        color = palette.ACCENTS[(k * 3 + variant) % len(palette.ACCENTS)]
        links.append(swung(_lever(kind, length, size, metal, color), (0, y, base.top + 0.008), 0.4))
    return switch(body, links, HINGE_X, variant + 1)
