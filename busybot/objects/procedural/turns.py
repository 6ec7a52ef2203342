"""Training switches that turn about an upright axis: dials with a pointer, arms on a pivot, crosses like a tap's."""

import numpy as np

from busybot.objects.procedural import palette
from busybot.objects.procedural.design import SWITCH_SCALE, Design, Part, facing, shifted
from busybot.objects.procedural.grounds import clutter, corners, ground
from busybot.objects.procedural.mechanisms import TURNING, turned
from busybot.objects.procedural.palette import pick
from busybot.objects.procedural.shapes import head, lying, rod
from busybot.objects.procedural.solids import ball, box, circle, frame, lathe, prism, rectangle, star


def dial(variant: int, rng: np.random.Generator) -> Design:
    """A knob with a long pointer, over a scale."""
    radius, reach = (0.06, 0.05, 0.075)[variant % 3], (0.115, 0.09, 0.13)[variant % 3]
    side = 2 * reach + 0.07
    base = ground(side, side, (0, 4, 1)[variant % 3], rng)
    scale = frame(circle(reach + 0.022, 36), circle(reach + 0.010, 36), 0, 0.004, 0.001)
    body = [*base.parts, Part(scale.moved(z=base.top - 0.001), pick(rng, palette.METALS, unlike=base.cover))]
    body += clutter(base, corners(side, side, 0.03), rng) if variant % 3 != 1 else []
    color = pick(rng, (*palette.ACCENTS, palette.BLACK), unlike=base.cover)
    tall = (0.06, 0.045, 0.035)[variant % 3]
    skirt = prism(star(radius, 0.05 * radius, 12, 4), 0, 0.6 * tall, bevel=0.006)
    pointer = box(reach + 0.8 * radius, 0.034, tall, 0.010).moved((reach - 0.8 * radius) / 2)
    line = box(0.4 * reach, 0.008, 0.003, 0.001).moved(0.7 * reach, 0, tall - 0.001)
    parts = [Part(skirt, color), Part(pointer, color), Part(line, palette.WHITE)]
    kind_large = variant % 3 == 2
    link = turned(parts, (0, 0, base.top + 0.002), 0.8 if kind_large else 0.6, "large" if kind_large else "small")
    return facing(Design("Switch", SWITCH_SCALE, body, [link], directions=TURNING), variant + variant // 3)


def boom(variant: int, rng: np.random.Generator) -> Design:
    """An arm that sweeps over a plate about a pivot at its end, between two stops."""
    length, swing = (0.26, 0.20, 0.30)[variant % 3], (0.42, 0.55, 0.35)[variant % 3]
    width, height = length + 0.12, 2 * length * float(np.sin(swing)) + 0.10
    base = ground(width, height, (1, 2, 0)[variant % 3], rng)
    x, z = -length / 2, base.top + 0.026
    metal, color = pick(rng, palette.METALS, unlike=base.cover), pick(rng, palette.ACCENTS, unlike=base.cover)
    body = [
        *base.parts,
        Part(
            lathe([(0.045, 0), (0.045, 0.018), (0.036, 0.024), (0, 0.024)], 24).moved(x, 0, base.top - 0.001),
            palette.IRON,
        ),
    ]
    for side in (-1, 1):
        peg = lathe([(0.014, 0), (0.014, 0.03), (0.008, 0.036), (0, 0.036)], 14)
        angle = side * (swing + 0.20)
        body.append(
            Part(
                peg.moved(
                    x + 0.5 * length * float(np.cos(angle)), 0.5 * length * float(np.sin(angle)), base.top - 0.001
                ),
                metal,
            )
        )
    thin = (
        rod((0, 0, 0.008), (length, 0, 0.008), 0.012),
        box(length, 0.045, 0.014, 0.005).moved(length / 2),
        box(length, 0.022, 0.03, 0.005).moved(length / 2),
    )
    parts = [
        Part(thin[variant % 3], metal),
        Part(lathe([(0.034, -0.004), (0.034, 0.022), (0.026, 0.028), (0, 0.028)], 22), metal),
    ]
    parts += shifted(head(("ball", "drum", "egg")[variant % 3], 0.036, color), (length, 0, 0.0))
    kind = "large" if variant % 3 == 1 else "small"
    link = turned(parts, (x, 0, z), swing, "large" if kind == "large" else "small")
    return facing(Design("Switch", SWITCH_SCALE, body, [link], directions=TURNING), variant)


def tap(variant: int, rng: np.random.Generator) -> Design:
    """A handle of two or four spokes with knobs at their ends."""
    spokes, reach = (4, 2)[variant % 2], (0.10, 0.13)[variant % 2]
    side = 2 * reach + 0.09
    base = ground(side, side if spokes == 4 else 0.26, (4, 0)[variant % 2], rng)
    metal, color = pick(rng, palette.METALS, unlike=base.cover), pick(rng, palette.ACCENTS, unlike=base.cover)
    tower = lathe([(0.05, 0), (0.036, 0.02), (0.034, 0.05), (0.0, 0.05)], 24)
    body = [*base.parts, Part(tower.moved(z=base.top - 0.001), palette.IRON)]
    parts = [Part(lathe([(0.034, -0.012), (0.036, 0.018), (0.026, 0.026), (0, 0.026)], 22), metal)]
    for angle in np.arange(spokes) * 2 * np.pi / spokes:
        x, y = reach * float(np.cos(angle)), reach * float(np.sin(angle))
        parts += [
            Part(rod((0, 0, 0.004), (x, y, 0.004), 0.013), metal),
            Part(ball(0.026, 16, 8).moved(x, y, 0.004), color),
        ]
    parts.append(Part(prism(rectangle(0.028, 0.028, 0.008), 0.02, 0.03, bevel=0.003), palette.WHITE))
    if spokes == 2:
        parts.append(Part(lying(0.018, 0.02), metal))
    link = turned(parts, (0, 0, base.top + 0.06), 0.45)
    return facing(Design("Switch", SWITCH_SCALE, body, [link], directions=TURNING), variant)
