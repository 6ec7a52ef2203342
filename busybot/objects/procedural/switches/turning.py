"""Training switches that turn about an upright axis (dials, arms on a pivot, taps), tilt about their middle or roll.

Those that tilt or roll: wedges, saucers, tabs, a thumbwheel, a ball in a socket.
"""

import numpy as np

from busybot.objects.procedural import cad, palette
from busybot.objects.procedural.design import HINGE_X, SLIDE_X, TURN_Z, Design, Part, shifted, switch
from busybot.objects.procedural.fixtures import Kind, clutter, corners, ground, row, swung, turned
from busybot.objects.procedural.grips import collar, head, lying, rod
from busybot.objects.procedural.palette import pick

SUNK = 0.02
"""How far wheels and balls may reach below the board's surface."""


def wedge_body(length: float, width: float, ends: float, middle: float) -> cad.Solid:
    """Two flat faces that meet in the middle, at a ridge if it is higher than the ends, else in a valley."""
    depth = 0.03
    xs = length / 2 * np.array([-1, 1, 1, 0, -1])
    outline = np.stack([xs, [-depth, -depth, ends, middle, ends]], axis=1)
    low, high = (np.array([0.0, -0.8 * depth, side * width / 2]) for side in (-1, 1))
    return cad.loft([cad.ring(outline, -width / 2), cad.ring(outline, width / 2)], (low, high)).turned("x", np.pi / 2)


def wedge(variant: int, rng: np.random.Generator) -> Design:
    """A rocker of two flat faces, from slim to one that covers its plate, in all four directions."""
    length = (0.22, 0.13, 0.18, 0.25, 0.10, 0.20)[variant % 6]
    width = (0.20, 0.06, 0.11, 0.13, 0.12, 0.05)[variant % 6]
    ends, middle = ((0.016, 0.0), (0.010, 0.026), (0.020, 0.002), (0.004, 0.014), (0.014, 0.0), (0.0, 0.0))[variant % 6]
    tilt = (0.13, 0.25, 0.17, 0.08, 0.22, 0.12)[variant % 6]
    base = ground(length + 0.10, max(width + 0.09, 0.17), variant, rng)
    metal = pick(rng, (palette.STEEL, palette.BLACK, palette.WHITE, base.cover))
    rim = collar(cad.rectangle(length, width, 0.006), 0.012, 0.014, metal)
    body = [*base.parts, *shifted(rim, (0, 0, base.top - 0.001))]
    body += clutter(base, corners(length + 0.10, max(width + 0.09, 0.17), 0.025), rng) if variant % 5 < 4 else []
    color = pick(rng, (palette.WHITE, palette.IVORY, palette.GRAPHITE, *palette.ACCENTS), unlike=base.cover)
    parts = [Part(wedge_body(length, width, ends, middle), color)]
    dot = cad.lathe([(0.012, 0.0), (0.010, 0.003), (0.0, 0.0035)], 14)
    dot = dot.moved(0.36 * length, 0, ends * 0.72 + middle * 0.28)
    parts.append(Part(dot, palette.RED if color is not palette.RED else palette.WHITE))
    link = swung(parts, (0, 0, base.top + 0.022), tilt, label="rocker")
    return switch(body, [link], HINGE_X, variant + variant // 4)


def saucer(variant: int, rng: np.random.Generator) -> Design:
    """A round dish with a raised rim that tips over a post."""
    radius, tilt = (0.115, 0.085, 0.10)[variant % 3], (0.18, 0.26, 0.10)[variant % 3]
    base = ground(2 * radius + 0.09, 2 * radius + 0.06, (0, 1, 4)[variant % 3], rng)
    color = pick(rng, palette.ACCENTS, unlike=base.cover)
    rows = [(0.55 * radius, -0.012), (0.94 * radius, 0.004), (radius, 0.014), (0.93 * radius, 0.019)]
    rows += [(0.85 * radius, 0.012), (0.45 * radius, 0.006)]
    dish = cad.lathe([*rows, (0.0, 0.005)], 36)
    knob = cad.ball(0.2 * radius, 16, 8).moved(z=0.012)
    post = cad.lathe([(0.5 * radius, 0), (0.3 * radius, 0.03), (0.28 * radius, 0.035), (0, 0.035)], 24)
    body = [*base.parts, Part(post.moved(z=base.top - 0.002), palette.BLACK)]
    body += clutter(base, corners(2 * radius + 0.09, 2 * radius + 0.06, 0.03), rng) if variant % 3 < 2 else []
    marks = [Part(cad.ball(0.011, 12, 6).moved(s * 0.88 * radius, 0, 0.016), palette.WHITE) for s in (-1, 1)]
    link = swung([Part(dish, color), Part(knob, palette.WHITE), *marks], (0, 0, base.top + 0.045), tilt)
    return switch(body, [link], HINGE_X, variant)


def tabs(variant: int, rng: np.random.Generator) -> Design:
    """2 to 4 tongues side by side, like the stops of an organ, that tip away or towards."""
    count, pitch, tilt = ((3, 0.085, 0.2), (2, 0.12, 0.17), (4, 0.08, 0.24))[variant % 3]
    length, width = (0.17, 0.21, 0.13)[variant % 3], (0.058, 0.082, 0.046)[variant % 3]
    base = ground(length + 0.12, pitch * count + 0.07, (1, 2, 0)[variant % 3], rng)
    color = pick(rng, (palette.IVORY, palette.WHITE, palette.MUSTARD), unlike=base.cover)
    body, links = list(base.parts), []
    body.append(Part(cad.box(0.03, pitch * count + 0.02, 0.018, 0.005).moved(z=base.top - 0.001), palette.IRON))
    for k, y in enumerate(row(count, pitch)):
        tongue = cad.prism(cad.rectangle(length, width, 0.45 * width, 6), -0.008, 0.010, bevel=0.005, foot=0.004)
        dot = cad.lathe([(0.28 * width, 0.009), (0.25 * width, 0.012), (0, 0.0125)], 16).moved(0.3 * length)
        accent = palette.ACCENTS[(k + 3 * variant) % len(palette.ACCENTS)]
        links.append(swung([Part(tongue, color), Part(dot, accent)], (0, y, base.top + 0.032), tilt, label="tab"))
    return switch(body, links, HINGE_X, variant + 1)


def wheel(variant: int, rng: np.random.Generator) -> Design:
    """A thumbwheel, half sunk, that rolls to both sides; the larger ones rest midway, too."""
    radius, width = (0.10, 0.075)[variant % 2], (0.07, 0.045)[variant % 2]
    base = ground(2 * radius + 0.14, width + 0.17, (1, 0)[variant % 2], rng)
    slot = cad.rectangle(1.75 * radius, width, 0.004)
    metal = pick(rng, (*palette.METALS, palette.BLACK), unlike=base.cover)
    body = [*base.parts, *shifted(collar(slot, 0.014, 0.012, metal), (0, 0, base.top - 0.001))]
    body += clutter(base, corners(2 * radius + 0.14, width + 0.17), rng)
    color = pick(rng, palette.ACCENTS, unlike=base.cover)
    rim = cad.prism(cad.wavy(radius, 0.04 * radius, 18, 4), -width / 2, width / 2, bevel=0.005, foot=0.005)
    flag = cad.box(0.022, 0.8 * width, 0.03, 0.006).moved(z=0.96 * radius)
    parts = [Part(rim.turned("x", np.pi / 2), color), Part(flag, palette.WHITE)]
    kind: Kind = "large" if variant % 2 == 0 else "small"
    link = swung(parts, (0, 0, max(base.top - 0.35 * radius, radius - SUNK)), 0.55, kind, "wheel")
    return switch(body, [link], SLIDE_X, variant // 2 + variant)


def trackball(variant: int, rng: np.random.Generator) -> Design:
    """A ball in a socket with a thumb peg; it rolls along x or y."""
    radius = (0.095, 0.075)[variant % 2]
    base = ground(2 * radius + 0.10, 2 * radius + 0.08, (1, 4)[variant % 2], rng)
    socket = cad.frame(cad.circle(radius + 0.024, 32), cad.circle(0.97 * radius, 32), 0, 0.022, 0.006)
    body = [*base.parts, Part(socket.moved(z=base.top - 0.001), pick(rng, palette.METALS, unlike=base.cover))]
    body += clutter(base, corners(2 * radius + 0.10, 2 * radius + 0.08, 0.028), rng) if variant % 2 == 0 else []
    color = pick(rng, (palette.RED, palette.NAVY, palette.PLUM, palette.BLACK, palette.WHITE), unlike=base.cover)
    band = cad.torus(radius, 0.005, 36, 6).turned("x", np.pi / 2)
    peg = cad.prism(cad.ellipse(0.04, 0.055, 20), 0, 0.034, bevel=0.012).moved(z=0.96 * radius)
    parts = [Part(cad.ball(radius, 30, 14), color), Part(band, palette.STEEL), Part(peg, palette.MUSTARD)]
    link = swung(parts, (0, 0, max(base.top + 0.15 * radius, radius - SUNK)), 0.5, label="ball")
    return switch(body, [link], HINGE_X, variant)


def dial(variant: int, rng: np.random.Generator) -> Design:
    """A knob with a long pointer, over a scale."""
    radius, reach = (0.06, 0.05, 0.075)[variant % 3], (0.115, 0.09, 0.13)[variant % 3]
    side = 2 * reach + 0.07
    base = ground(side, side, (0, 4, 1)[variant % 3], rng)
    scale = cad.frame(cad.circle(reach + 0.022, 36), cad.circle(reach + 0.010, 36), 0, 0.004, 0.001)
    body = [*base.parts, Part(scale.moved(z=base.top - 0.001), pick(rng, palette.METALS, unlike=base.cover))]
    body += clutter(base, corners(side, side, 0.03), rng) if variant % 3 != 1 else []
    color = pick(rng, (*palette.ACCENTS, palette.BLACK), unlike=base.cover)
    tall = (0.06, 0.045, 0.035)[variant % 3]
    skirt = cad.prism(cad.wavy(radius, 0.05 * radius, 12, 4), 0, 0.6 * tall, bevel=0.006)
    pointer = cad.box(reach + 0.8 * radius, 0.034, tall, 0.010).moved((reach - 0.8 * radius) / 2)
    line = cad.box(0.4 * reach, 0.008, 0.003, 0.001).moved(0.7 * reach, 0, tall - 0.001)
    parts = [Part(skirt, color), Part(pointer, color), Part(line, palette.WHITE)]
    at = (0.0, 0.0, base.top + 0.002)
    link = turned(parts, at, 0.8, "large") if variant % 3 == 2 else turned(parts, at, 0.6)
    return switch(body, [link], TURN_Z, variant + variant // 3)


def boom(variant: int, rng: np.random.Generator) -> Design:
    """An arm that sweeps over a plate about a pivot at its end, between two stops."""
    length, swing = (0.26, 0.20, 0.30)[variant % 3], (0.42, 0.55, 0.35)[variant % 3]
    width, height = length + 0.12, 2 * length * float(np.sin(swing)) + 0.10
    base = ground(width, height, (1, 2, 0)[variant % 3], rng)
    x, z = -length / 2, base.top + 0.026
    metal, color = pick(rng, palette.METALS, unlike=base.cover), pick(rng, palette.ACCENTS, unlike=base.cover)
    pivot = cad.lathe([(0.045, 0), (0.045, 0.018), (0.036, 0.024), (0, 0.024)], 24)
    body = [*base.parts, Part(pivot.moved(x, 0, base.top - 0.001), palette.IRON)]
    peg = cad.lathe([(0.014, 0), (0.014, 0.03), (0.008, 0.036), (0, 0.036)], 14)
    for angle in (-swing - 0.20, swing + 0.20):
        away = 0.5 * length * np.array([np.cos(angle), np.sin(angle)])
        body.append(Part(peg.moved(x + float(away[0]), float(away[1]), base.top - 0.001), metal))
    flat, upright = cad.box(length, 0.045, 0.014, 0.005), cad.box(length, 0.022, 0.03, 0.005)
    thin = (rod((0, 0, 0.008), (length, 0, 0.008), 0.012), flat.moved(length / 2), upright.moved(length / 2))
    hub = cad.lathe([(0.034, -0.004), (0.034, 0.022), (0.026, 0.028), (0, 0.028)], 22)
    parts = [Part(thin[variant % 3], metal), Part(hub, metal)]
    parts += shifted(head(("ball", "drum", "egg")[variant % 3], 0.036, color), (length, 0, 0.0))
    return switch(body, [turned(parts, (x, 0, z), swing, "large" if variant % 3 == 1 else "small")], TURN_Z, variant)


def tap(variant: int, rng: np.random.Generator) -> Design:
    """A handle of two or four spokes with knobs at their ends."""
    spokes, reach = (4, 2)[variant % 2], (0.10, 0.13)[variant % 2]
    side = 2 * reach + 0.09
    base = ground(side, side if spokes == 4 else 0.26, (4, 0)[variant % 2], rng)
    metal, color = pick(rng, palette.METALS, unlike=base.cover), pick(rng, palette.ACCENTS, unlike=base.cover)
    tower = cad.lathe([(0.05, 0), (0.036, 0.02), (0.034, 0.05), (0.0, 0.05)], 24)
    body = [*base.parts, Part(tower.moved(z=base.top - 0.001), palette.IRON)]
    parts = [Part(cad.lathe([(0.034, -0.012), (0.036, 0.018), (0.026, 0.026), (0, 0.026)], 22), metal)]
    for angle in np.arange(spokes) * 2 * np.pi / spokes:
        x, y = reach * float(np.cos(angle)), reach * float(np.sin(angle))
        spoke, end = rod((0, 0, 0.004), (x, y, 0.004), 0.013), cad.ball(0.026, 16, 8).moved(x, y, 0.004)
        parts += [Part(spoke, metal), Part(end, color)]
    parts.append(Part(cad.prism(cad.rectangle(0.028, 0.028, 0.008), 0.02, 0.03, bevel=0.003), palette.WHITE))
    if spokes == 2:
        parts.append(Part(lying(0.018, 0.02), metal))
    return switch(body, [turned(parts, (0, 0, base.top + 0.06), 0.45)], TURN_Z, variant)
