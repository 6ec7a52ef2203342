"""Switches that are pressed (caps, plungers, a bell, pads in rows, bars, slabs), and multi-link triggers.

Multi-link: panels of rockers, toggles and buttons; novel: a DIP switch and piano keys.
"""

import numpy as np

from busybot.objects.procedural import cad, fixtures, palette
from busybot.objects.procedural.design import (
    HINGE_X,
    HINGE_Y,
    SLIDE_Y,
    Design,
    Material,
    MovingLink,
    Part,
    shifted,
    switch,
)
from busybot.objects.procedural.fixtures import TOP, clutter, corners, ground, pressed, row
from busybot.objects.procedural.grips import OUTLINES, PROFILES, cap_on, collar, head, outline
from busybot.objects.procedural.palette import in_turn, pick
from busybot.objects.procedural.switches.basic import rocker_link, toggle_link


def cap(variant: int, rng: np.random.Generator) -> Design:
    """One cap: its outline, profile, size, base, and whether it is sunk, flush or raised, go through all there are."""
    size = float(np.geomspace(0.042, 0.105, 8)[(5 * variant + 2) % 8])
    rim = outline(OUTLINES[variant % len(OUTLINES)], size)
    width, height = (float(v) + float(rng.uniform(0.07, 0.16)) for v in np.ptp(rim, axis=0))
    width, height = max(width, 0.21), max(height, 0.21)
    base = ground(width, height, variant + variant // 5, rng)
    travel = float(rng.choice([0.012, 0.022, 0.034]))
    rise = (0.0, 0.035, 0.012)[variant % 3]  # of the rim over the collar
    lip = float(rng.uniform(0.010, 0.026)) if rise else 0.034
    metal = pick(rng, (*palette.METALS, palette.BLACK, palette.WHITE), unlike=base.cover)
    body = [*base.parts, *shifted(collar(rim, float(rng.uniform(0.012, 0.03)), lip, metal), (0, 0, base.top - 0.001))]
    body += clutter(base, corners(width, height), rng) if variant % 5 < 4 else []
    color = pick(rng, (*palette.ACCENTS, palette.WHITE, palette.MINT), unlike=base.cover)
    top = cap_on(rim, PROFILES[(variant + variant // 5) % len(PROFILES)], 0.9 * (lip + rise) + 0.004)
    z = base.top + max(lip + rise, travel + 0.012)
    return switch(body, [pressed([Part(top, color)], (0, 0, z), travel)], HINGE_X)


def plunger(variant: int, rng: np.random.Generator) -> Design:
    """A head on a thin stem that goes into a tower: a disc, a block, a ball, an egg, a cone, a flower."""
    base = ground(0.26, 0.26, variant + 1, rng)
    tower, radius = ((0.05, 0.085), (0.10, 0.06), (0.035, 0.10))[variant % 3]
    metal, color = pick(rng, palette.METALS), pick(rng, palette.ACCENTS, unlike=base.cover)
    profile = [(0.06, 0), (0.052, 0.3 * tower), (0.038, 0.9 * tower), (0.034, tower), (0.0, tower)]
    body = [*base.parts, Part(cad.lathe(profile, 24).moved(z=base.top - 0.001), pick(rng, (palette.BLACK, metal)))]
    body += clutter(base, corners(0.26, 0.26), rng)
    stem = cad.lathe([(0.013, -0.06), (0.013, 0.01)], 12)
    parts = [Part(stem, metal), *_plunger_head(variant, radius, color)]
    return switch(body, [pressed(parts, (0, 0, base.top + tower + 0.045), 0.038)], HINGE_X)


def _plunger_head(variant: int, radius: float, color: Material) -> list[Part]:
    if variant % 2:
        return head(("ball", "egg", "drum")[variant // 2 % 3], 0.8 * radius, color)
    rim = outline(("round", "octagon", "flower")[variant // 2 % 3], radius)
    slab = cap_on(rim, ("flat", "stepped", "conical")[variant // 2 % 3], 0.014)
    return [Part(slab.moved(z=0.014), color)]


def bell(variant: int, rng: np.random.Generator) -> Design:
    """A hotel's bell: the big dome stands still, the little button on top goes down."""
    metal, wood = in_turn((palette.BRASS, palette.CHROME), variant), pick(rng, palette.WOODS)
    reach = (0.125, 0.10)[variant % 2]
    body = [Part(cad.lathe([(reach + 0.03, 0), (reach + 0.03, 0.018), (reach + 0.02, 0.03), (0, 0.03)], 36), wood)]
    rows = [(reach, 0.045), (0.98 * reach, 0.06), (0.75 * reach, 0.105), (0.4 * reach, 0.13), (0.045, 0.136)]
    body.append(Part(cad.lathe([(0.9 * reach, 0.03), *cad.smooth(rows, 3), (0.0, 0.137)], 36), metal))
    button = cad.lathe(cad.smooth([(0.030, -0.03), (0.036, 0.0), (0.034, 0.016), (0.018, 0.026), (0.0, 0.028)], 2), 22)
    color = pick(rng, (palette.BLACK, palette.RED, palette.TEAL))
    return switch(body, [pressed([Part(button, color)], (0, 0, 0.165), 0.024)], HINGE_X)


PATTERNS = (
    ((-0.5, 0), (0.5, 0)),
    ((0, 1), (0, 0), (0, -1)),
    ((-0.5, -0.42), (0.5, -0.42), (0, 0.45)),
    ((-0.5, 0.5), (0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)),
    ((-1.5, 0), (-0.5, 0), (0.5, 0), (1.5, 0)),
)
"""Where the pads of a panel lie, in units of their distance."""


def pads(variant: int, rng: np.random.Generator) -> Design:
    """2 to 4 small caps in a row, a column, a triangle or a square; some give by thousandths only."""
    pattern = np.array(PATTERNS[variant % len(PATTERNS)], float)
    size = (0.052, 0.042, 0.048, 0.058, 0.036)[variant % 5]
    rim = outline(("square", "round", "flower", "stadium", "octagon")[variant % 5], size)
    rim *= 0.8 if variant % 5 == 3 else 1.0
    step = float(np.ptp(rim, axis=0).max()) + float(rng.uniform(0.03, 0.055))
    places = pattern * step
    width, height = (float(v) + 2.0 * size + 0.09 for v in np.ptp(places, axis=0))
    base = ground(max(width, 0.2), max(height, 0.2), (variant + variant // 5) % 4, rng)
    travel = (0.022, 0.006, 0.018, 0.026, 0.016)[variant % 5]
    lip = 0.012 if variant % 2 else 0.02
    body, links = list(base.parts), []
    metal = pick(rng, (palette.STEEL, palette.BLACK, palette.WHITE), unlike=base.cover)
    for k, (x, y) in enumerate(places.tolist()):
        body += shifted(collar(rim, 0.009, lip, metal, 0.003), (x, y, base.top - 0.001))
        color = palette.ACCENTS[(3 * k + variant) % len(palette.ACCENTS)]
        top = cap_on(rim, PROFILES[(variant + 1) % len(PROFILES)], 0.02)
        links.append(pressed([Part(top, color)], (x, y, base.top + lip + travel + 0.006), travel))
    return switch(body, links, HINGE_X)


def bars(variant: int, rng: np.random.Generator) -> Design:
    """3 or 4 long bars side by side, like chimes, which go straight down."""
    count, pitch, length = (3, 4)[variant % 2], (0.095, 0.075)[variant % 2], (0.26, 0.20)[variant % 2]
    width = pitch * count + 0.05
    base = ground(width, length + 0.10, (1, 3)[variant % 2], rng, palette.WOODS)
    body, links = list(base.parts), []
    for k, x in enumerate(row(count, pitch)):
        reach = length * (1.0 - 0.11 * k)
        body.append(Part(cad.box(pitch - 0.008, reach + 0.012, 0.005).moved(x, z=base.top - 0.003), palette.SHADOW))
        bar = cad.prism(cad.rectangle(pitch - 0.024, reach, 0.014), -0.024, 0.0, bevel=0.006)
        studs = [cad.ball(0.008, 10, 6).moved(0, s * 0.36 * reach, 0.0) for s in (-1, 1)]
        color = palette.ACCENTS[(k + 2 * variant) % len(palette.ACCENTS)]
        parts = [Part(bar, color), *(Part(stud, palette.CHROME) for stud in studs)]
        links.append(pressed(parts, (x, 0, base.top + 0.032), 0.022))
    return switch(body, links, HINGE_X, variant % 2)


def cushion(variant: int, rng: np.random.Generator) -> Design:
    """One big soft pad that covers nearly all of its base."""
    width, height = ((0.30, 0.22), (0.22, 0.31), (0.26, 0.26))[variant % 3]
    base = ground(width + 0.05, height + 0.05, (3, 1, 0)[variant % 3], rng)
    rim = cad.rectangle(width - 0.05, height - 0.05, (0.03, 0.08, 0.05)[variant % 3], 6)
    rows = ((1.0, -0.02), (1.0, 0.002), (0.97, 0.012), (0.86, 0.021), (0.6, 0.027), (0.25, 0.029))
    soft = cad.loft([cad.ring(share * rim, z) for share, z in rows])
    color = pick(rng, (palette.CORAL, palette.SKY, palette.MINT, palette.MUSTARD, palette.PLUM), unlike=base.cover)
    well = cad.prism(1.035 * rim, 0, 0.003).moved(z=base.top - 0.002)
    button = Part(cad.lathe([(0.014, 0.024), (0.012, 0.030), (0.0, 0.031)], 14), palette.IVORY)
    sign = [button] if variant % 2 else [Part(cad.prism(cad.circle(0.02, 20), 0.024, 0.0305), palette.WHITE)]
    link = pressed([Part(soft, color), *sign], (0, 0, base.top + 0.024), (0.02, 0.008, 0.016)[variant % 3])
    return switch([*base.parts, Part(well, palette.SHADOW)], [link], HINGE_X)


def rockers(variant: int, rng: np.random.Generator) -> Design:
    """2, 3 or 4 rockers in frames on one plate; they tilt along x and stand above each other."""
    count = (2, 3, 4, 2)[variant % 4]
    cover, keys = in_turn((palette.WHITE, palette.GRAPHITE, palette.STEEL), variant), []
    xs, ys, width, height = {
        2: ([0.0], [0.075, -0.075], 0.30, 0.34),
        3: ([0.0], [0.12, 0.0, -0.12], 0.30, 0.44),
        4: ([-0.11, 0.11], [0.075, -0.075], 0.46, 0.34),
    }[count]
    body = fixtures.plate(width, height, cover, rng, "corners" if count < 4 else "poles")
    rim = pick(rng, (palette.STEEL, palette.BLACK, palette.BRASS))
    same = pick(rng, (palette.WHITE, palette.IVORY, palette.GRAPHITE), unlike=cover)
    for k, (x, y) in enumerate((x, y) for y in ys for x in xs):
        body += shifted(fixtures.bezel(0.195, 0.105, 0.014, 0.020, rim), (x, y, TOP - 0.001))
        color = same if variant % 2 else palette.ACCENTS[(k + int(rng.integers(8))) % 8]
        keys.append(rocker_link(x, y, TOP + 0.024, 0.072, 0.16, 0.20, color))
    return switch(body, keys, HINGE_X)


def toggles(variant: int, rng: np.random.Generator) -> Design:
    """2 or 3 bat levers with indicator jewels."""
    count = (2, 3)[variant % 2]
    cover = in_turn((palette.IVORY, palette.NAVY), variant)
    body = fixtures.plate(0.30, 0.15 * count + 0.06, cover, rng, "corners")
    links = []
    for y in row(count, 0.145):
        body += shifted(fixtures.hex_collar(0.056, palette.CHROME), (0.0, y, TOP - 0.002))
        jewel = fixtures.indicator(0.012, pick(rng, palette.ACCENTS, unlike=cover), palette.BRASS)
        body += shifted(jewel, (-0.115, y, TOP))
        links.append(toggle_link(0.0, y, TOP + 0.025, 0.15, 0.030, 0.46, rng))
    return switch(body, links, HINGE_X)


def buttons(variant: int, rng: np.random.Generator) -> Design:
    """3 round buttons in a row, like a lift's."""
    cover = pick(rng, (palette.STEEL, palette.GRAPHITE, palette.WHITE))
    body = fixtures.plate(0.46, 0.20, cover, rng, "none", 0.09)
    links = []
    for k, x in enumerate((-0.14, 0.0, 0.14)):
        cap = palette.ACCENTS[(2 * k + int(rng.integers(8))) % 8]
        body += shifted(fixtures.round_bezel(0.064, 0.048, 0.022, palette.CHROME), (x, 0, TOP - 0.001))
        glow = cad.torus(0.026, 0.003, 22, 6).moved(z=-0.003)
        parts = [Part(fixtures.dish_cap(0.046, 0.0), cap), Part(glow, palette.WHITE)]
        links.append(pressed(parts, (x, 0, TOP + 0.048), 0.028))
    return switch(body, links, HINGE_X)


def dip(variant: int, rng: np.random.Generator) -> Design:
    """Novel: a DIP switch, white sliders side by side in a red or blue block; they move along y."""
    count = (2, 3, 4)[variant % 3]
    block = (palette.RED, palette.NAVY, palette.TEAL)[variant % 3]
    width, height = 0.115 * count + 0.07, 0.30
    body = [Part(cad.prism(cad.rectangle(width, height, 0.012), 0, 0.09, bevel=0.01, steps=2), block)]
    pin = cad.box(0.022, 0.035, 0.02, 0.004)
    places = [((k - 2.5) * width / 6, side * (height / 2 + 0.008)) for k in range(6) for side in (-1, 1)]
    body += [Part(pin.moved(x, y), palette.STEEL) for x, y in places]
    links = []
    for x in row(count, 0.115):
        body += shifted(fixtures.bezel(0.092, 0.21, 0.008, 0.006, palette.WHITE, 0.008), (x, -0.01, 0.089))
        grip = [Part(cad.box(0.068, 0.085, 0.035, 0.008), palette.WHITE)]
        ridge = cad.box(0.058, 0.008, 0.004, 0.001)
        grip += [Part(ridge.moved(0, y, 0.034), palette.STONE) for y in (-0.018, 0.0, 0.018)]
        where = (x, -0.01, 0.092)
        links.append(MovingLink(shifted(grip, where), "prismatic", where, (0, 1, 0), -0.05, 0.05, "small", "slider"))
        body.append(fixtures.mark_bar(0.022).moved(x, 0.119, 0.0895))
    return switch(body, links, SLIDE_Y)


def keys(variant: int, rng: np.random.Generator) -> Design:
    """Novel: 3 or 4 piano keys hinged at their far ends in a wooden case."""
    count, pitch = (3, 4)[variant % 2], 0.088
    wood = pick(rng, (palette.WALNUT, palette.CHERRY, palette.BLACK))
    width = pitch * count + 0.05
    body = [Part(cad.box(width, 0.36, 0.026, 0.006), wood)]
    body += [Part(cad.box(0.024, 0.36, 0.082, 0.008).moved(sx * (width / 2 - 0.012)), wood) for sx in (-1, 1)]
    body.append(Part(cad.box(width, 0.09, 0.098, 0.014).moved(0, 0.135), wood))
    body.append(Part(cad.box(width - 0.05, 0.008, 0.004).moved(0, 0.088, 0.097), palette.BRASS))
    medal = cad.lathe([(0.022, 0.097), (0.020, 0.101), (0, 0.102)], 24)
    body.append(Part(medal.moved(0, 0.135), palette.BRASS))
    links = []
    for k, x in enumerate(row(count, pitch)):
        color = palette.IVORY if (k + variant) % 2 == 0 else pick(rng, (palette.SKY, palette.CORAL, palette.MUSTARD))
        key = cad.prism(cad.rectangle(pitch - 0.008, 0.25, 0.008, 3), -0.022, 0.0, bevel=0.006)
        lip = cad.box(pitch - 0.03, 0.03, 0.003, 0.001).moved(0, -0.09, -0.0005)
        parts = shifted([Part(key, color), Part(lip, palette.STONE)], (x, -0.045, 0.080))
        links.append(MovingLink(parts, "revolute", (x, 0.08, 0.072), (1, 0, 0), 0.0, 0.12, "small", "key"))
    return switch(body, links, HINGE_Y)
