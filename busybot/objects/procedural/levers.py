"""Multi-direction triggers, which rest at both ends and midway: throttle, joystick, fader; novel: T-bar, rails."""

import numpy as np

from busybot.objects.procedural import hardware, palette
from busybot.objects.procedural.design import (
    SWITCH_SCALE,
    Design,
    Material,
    MovingLink,
    Part,
    shifted,
    slide_directions,
)
from busybot.objects.procedural.hardware import PLATE_THICKNESS as TOP
from busybot.objects.procedural.palette import in_turn, pick
from busybot.objects.procedural.solids import (
    Solid,
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

SWING = 0.50
"""Half the range of the levers, radians."""


def drum(radius: float, width: float, edge: float = 0.012) -> Solid:
    """A half cylinder that lies on z = 0 along y."""
    angles = np.linspace(0, np.pi, 19)
    outline = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return prism(outline, -width / 2, width / 2, bevel=edge, foot=edge).turned("x", np.pi / 2)


def ticks(places: list[tuple[float, float]], z: float, rng: np.random.Generator) -> list[Part]:
    """Three dots of different colours that mark the rest positions."""
    colors = rng.permutation(len(palette.ACCENTS))[:3]
    dot = lathe([(0.014, 0), (0.013, 0.002), (0, 0.0025)], 16)
    return [Part(dot.moved(x, y, z), palette.ACCENTS[c]) for (x, y), c in zip(places, colors, strict=True)]


def lever_link(parts: list[Part], z: float) -> MovingLink:
    """A lever with three rests that swings along x about (0, 0, z); its parts stand upright there."""
    return MovingLink(shifted(parts, (0, 0, z)), "revolute", (0, 0, z), (0, 1, 0), -SWING, SWING, "large", "lever")


def throttle(variant: int, rng: np.random.Generator) -> Design:
    """A lever with a ball, out of a slotted drum."""
    cover = in_turn((palette.NAVY, palette.IVORY), variant)
    metal = pick(rng, palette.METALS)
    body = hardware.plate(0.38, 0.24, cover, rng, "corners")
    shell = pick(rng, (palette.STEEL, palette.PEARL, palette.BLACK), unlike=cover)
    body.append(Part(drum(0.115, 0.15).moved(z=TOP - 0.002), shell))
    body.append(Part(drum(0.117, 0.045, 0.002).moved(z=TOP - 0.002), palette.SHADOW))
    body += [Part(drum(0.122, 0.012, 0.004).moved(y=y, z=TOP - 0.002), metal) for y in (-0.065, 0.065)]
    body += ticks([(-0.145, 0.0), (0.0, 0.10), (0.145, 0.0)], TOP, rng)
    stem = tube([(0, 0, 0.0), (0, 0, 0.1), (0, 0, 0.205)], 0.014, 12)
    parts = [Part(stem, metal), Part(torus(0.018, 0.008, 18, 8).moved(z=0.185), metal)]
    head = pick(rng, palette.ACCENTS, unlike=shell)
    knob = ball(0.052, 24, 12).moved(z=0.232) if variant % 2 == 0 else _pear().moved(z=0.175)
    parts.append(Part(knob, head))
    return Design("Switch", SWITCH_SCALE, body, [lever_link(parts, TOP)], directions=slide_directions("x"))


def _pear() -> Solid:
    profile = [(0.016, 0.0), (0.026, 0.02), (0.050, 0.065), (0.044, 0.10), (0.020, 0.115), (0.0, 0.117)]
    return lathe(smooth(profile, 3), 22)


def joystick(variant: int, rng: np.random.Generator) -> Design:
    """A stick with a knurled knob, out of a rubber bellows; it moves along x only."""
    del variant
    cover = pick(rng, (palette.WHITE, palette.STEEL, palette.MUSTARD, palette.TEAL))
    body = hardware.plate(0.32, 0.32, cover, rng, "corners", 0.07)
    rows = [
        (0.105, 0.0),
        (0.112, 0.012),
        (0.090, 0.022),
        (0.097, 0.034),
        (0.074, 0.044),
        (0.080, 0.056),
        (0.055, 0.066),
    ]
    body.append(Part(lathe([*smooth(rows, 2), (0.0, 0.068)], 28).moved(z=TOP - 0.001), palette.BLACK))
    body += ticks([(-0.135, 0.0), (0.0, 0.135), (0.135, 0.0)], TOP, rng)
    parts = [Part(lathe([(0.020, 0.0), (0.016, 0.10), (0.015, 0.19)], 14), palette.CHROME)]
    top = hardware.knob(
        0.052, 0.045, pick(rng, (palette.RED, palette.ORANGE, palette.PLUM), unlike=cover), palette.CHROME
    )
    parts += shifted(top, (0, 0, 0.18))
    return Design("Switch", SWITCH_SCALE, body, [lever_link(parts, TOP + 0.02)], directions=slide_directions("x"))


def fader(variant: int, rng: np.random.Generator) -> Design:
    """A mixing-desk fader along x."""
    cover = in_turn((palette.GRAPHITE, palette.IVORY, palette.STEEL), variant)
    grip = pick(rng, (palette.WHITE, *palette.ACCENTS), unlike=cover)
    width, travel = (0.48, 0.44, 0.52)[variant % 3], (0.24, 0.21, 0.27)[variant % 3]
    body = hardware.plate(width, 0.20, cover, rng, "ends", (0.02, 0.06, 0.03)[variant % 3])
    body += shifted(hardware.slot(travel + 0.05, 0.022, palette.STEEL, 0.008), (0, 0, TOP - 0.001))
    line = palette.WHITE if sum(cover.color) < 1.8 else palette.GRAPHITE
    for k in range(9):
        x, long = travel * (k / 8 - 0.5), k % 4 == 0
        body += [
            Part(box(0.005, 0.022 if long else 0.012, 0.0015).moved(x, s * 0.055, TOP - 0.0003), line) for s in (1, -1)
        ]
    body += ticks([(-travel / 2, 0.083), (0.0, 0.083), (travel / 2, 0.083)], TOP - 0.002, rng)
    return Design(
        "Switch", SWITCH_SCALE, body, [_slide_link(_fader_cap(grip), travel)], directions=slide_directions("x")
    )


def _fader_cap(grip: Material) -> list[Part]:
    """A waisted cap with a white line: high at both ends, low in the middle."""
    xs = np.linspace(0.034, -0.034, 9)
    section = [(-0.042, 0.0), (0.042, 0.0), *((float(x), 0.034 + 14.0 * float(x) ** 2) for x in xs)]
    body = prism(np.array(section), -0.045, 0.045, bevel=0.006, foot=0.006).turned("x", np.pi / 2)
    mark = palette.WHITE if sum(grip.color) < 2.4 else palette.RED
    return [Part(body, grip), Part(box(0.007, 0.084, 0.002).moved(z=0.0338), mark)]


def _slide_link(parts: list[Part], travel: float, z: float = TOP + 0.006) -> MovingLink:
    here = (0.0, 0.0, z)
    return MovingLink(shifted(parts, here), "prismatic", here, (1, 0, 0), -travel / 2, travel / 2, "large", "slider")


def t_bar(variant: int, rng: np.random.Generator) -> Design:
    """Novel: an aircraft's throttle, a wide grip on two arms over a rounded console."""
    cover, grip = (
        pick(rng, (palette.PEARL, palette.SAGE, palette.STONE)),
        pick(rng, (palette.RED, palette.NAVY, palette.BLACK)),
    )
    del variant
    body = [Part(prism(rectangle(0.36, 0.30, 0.06), 0, 0.05, bevel=0.024, steps=4), cover)]
    body.append(Part(drum(0.085, 0.13, 0.006).moved(z=0.048), cover))
    for y in (-0.082, 0.082):
        outer, inner = rectangle(0.25, 0.030, 0.015, 5), rectangle(0.23, 0.012, 0.006, 5)
        body.append(Part(frame(outer, inner, 0.048, 0.056, 0.003).moved(y=y), palette.CHROME))
        body.append(Part(box(0.23, 0.014, 0.003).moved(y=y, z=0.0485), palette.SHADOW))
    body += ticks([(-0.11, 0.122), (0.0, 0.122), (0.11, 0.122)], 0.047, rng)
    parts = []
    for y in (-0.082, 0.082):
        arm = bent([(0, y, 0.0), (0, y, 0.12), (0, y * 0.75, 0.185)], 0.04, 4)
        parts.append(Part(tube(arm, 0.011, 10), palette.CHROME))
    parts.append(Part(tube([(0, -0.11, 0.19), (0, -0.10, 0.19), (0, 0.10, 0.19), (0, 0.11, 0.19)], 0.030, 18), grip))
    parts += [
        Part(torus(0.031, 0.004, 20, 6).turned("x", np.pi / 2).moved(y=y, z=0.19), palette.CHROME)
        for y in (-0.07, 0.07)
    ]
    return Design("Switch", SWITCH_SCALE, body, [lever_link(parts, 0.045)], directions=slide_directions("x"))


def rails(variant: int, rng: np.random.Generator) -> Design:
    """Novel: a ring on a carriage that runs on two rods between wooden blocks."""
    wood, metal = (palette.WALNUT, palette.BIRCH)[variant % 2], (palette.BRASS, palette.STEEL)[variant % 2]
    body = [
        Part(
            prism(rectangle(0.50, 0.22, 0.015), 0, 0.022, bevel=0.008),
            pick(rng, (palette.SAGE, palette.NAVY, palette.BLUSH)),
        )
    ]
    for x in (-0.215, 0.215):
        body.append(Part(box(0.05, 0.20, 0.085, 0.014).moved(x), wood))
        body += [part for y in (-0.075, 0.075) for part in hardware.screw(x, y, 0.083, float(rng.uniform(0, 3)), metal)]
    body += [Part(tube([(-0.20, y, 0.055), (0.20, y, 0.055)], 0.011, 12), metal) for y in (-0.055, 0.055)]
    body += ticks([(-0.125, 0.0), (0.0, 0.0), (0.125, 0.0)], 0.021, rng)
    color = pick(rng, (palette.ORANGE, palette.TEAL, palette.RED))
    parts = [Part(box(0.085, 0.15, 0.036, 0.012).moved(z=0.037), color)]
    parts.append(Part(torus(0.040, 0.011, 24, 8).turned("x", np.pi / 2).moved(z=0.105), metal))
    parts.append(Part(lathe([(0.022, 0.07), (0.018, 0.078), (0, 0.080)], 18), metal))
    return Design("Switch", SWITCH_SCALE, body, [_slide_link(parts, 0.25, 0.0)], directions=slide_directions("x"))
