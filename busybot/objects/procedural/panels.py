"""Multi-link triggers: panels of rockers, toggles and buttons; novel: a DIP switch and piano keys."""

import numpy as np

from busybot.objects.procedural import hardware, palette
from busybot.objects.procedural.design import (
    SWITCH_SCALE,
    Design,
    MovingLink,
    Part,
    hinge_directions,
    shifted,
    slide_directions,
)
from busybot.objects.procedural.hardware import PLATE_THICKNESS as TOP
from busybot.objects.procedural.palette import in_turn, pick
from busybot.objects.procedural.solids import box, lathe, prism, rectangle, torus
from busybot.objects.procedural.switches import button_link, rocker_link, toggle_link


def rockers(variant: int, rng: np.random.Generator) -> Design:
    """2, 3 or 4 rockers in frames on one plate; they tilt along x and stand above each other."""
    count = (2, 3, 4, 2)[variant % 4]
    cover, keys = in_turn((palette.WHITE, palette.GRAPHITE, palette.STEEL), variant), []
    places = {2: [(0, 0.075), (0, -0.075)], 3: [(0, 0.12), (0, 0.0), (0, -0.12)]}.get(
        count, [(-0.11, 0.075), (0.11, 0.075), (-0.11, -0.075), (0.11, -0.075)]
    )
    width, height = {2: (0.30, 0.34), 3: (0.30, 0.44), 4: (0.46, 0.34)}[count]
    body = hardware.plate(width, height, cover, rng, "corners" if count < 4 else "poles")
    rim = pick(rng, (palette.STEEL, palette.BLACK, palette.BRASS))
    same = pick(rng, (palette.WHITE, palette.IVORY, palette.GRAPHITE), unlike=cover)
    for k, (x, y) in enumerate(places):
        body += shifted(hardware.bezel(0.195, 0.105, 0.014, 0.020, rim), (x, y, TOP - 0.001))
        color = same if variant % 2 else palette.ACCENTS[(k + int(rng.integers(8))) % 8]
        keys.append(rocker_link(x, y, TOP + 0.024, 0.072, 0.16, 0.20, color))
    return Design("Switch", SWITCH_SCALE, body, keys, directions=hinge_directions("x"))


def toggles(variant: int, rng: np.random.Generator) -> Design:
    """2 or 3 bat levers with indicator jewels."""
    count = (2, 3)[variant % 2]
    cover = in_turn((palette.IVORY, palette.NAVY), variant)
    body = hardware.plate(0.30, 0.15 * count + 0.06, cover, rng, "corners")
    links = []
    for k in range(count):
        y = 0.145 * (k - (count - 1) / 2)
        body += shifted(hardware.hex_collar(0.056, palette.CHROME), (0.0, y, TOP - 0.002))
        body += shifted(
            hardware.indicator(0.012, pick(rng, palette.ACCENTS, unlike=cover), palette.BRASS), (-0.115, y, TOP)
        )
        links.append(toggle_link(0.0, y, TOP + 0.025, 0.15, 0.030, 0.46, rng))
    return Design("Switch", SWITCH_SCALE, body, links, directions=hinge_directions("x"))


def buttons(variant: int, rng: np.random.Generator) -> Design:
    """3 round buttons in a row, like a lift's."""
    cover = pick(rng, (palette.STEEL, palette.GRAPHITE, palette.WHITE))
    body = hardware.plate(0.46, 0.20, cover, rng, "none", 0.09)
    links = []
    for k, x in enumerate((-0.14, 0.0, 0.14)):
        cap = palette.ACCENTS[(2 * k + int(rng.integers(8))) % 8]
        body += shifted(hardware.round_bezel(0.064, 0.048, 0.022, palette.CHROME), (x, 0, TOP - 0.001))
        parts = [
            Part(hardware.dish_cap(0.046, 0.0), cap),
            Part(torus(0.026, 0.003, 22, 6).moved(z=-0.003), palette.WHITE),
        ]
        links.append(button_link(parts, x, 0, TOP + 0.048, 0.028))
    return Design("Switch", SWITCH_SCALE, body, links, directions=hinge_directions("x"))


def dip(variant: int, rng: np.random.Generator) -> Design:
    """Novel: a DIP switch, white sliders side by side in a red or blue block; they move along y."""
    count = (2, 3, 4)[variant % 3]
    block = (palette.RED, palette.NAVY, palette.TEAL)[variant % 3]
    pitch = 0.115
    width, height = pitch * count + 0.07, 0.30
    body = [Part(prism(rectangle(width, height, 0.012), 0, 0.09, bevel=0.01, steps=2), block)]
    for k in range(6):
        x = (k - 2.5) * width / 6
        for y in (-1, 1):
            pin = box(0.022, 0.035, 0.02, 0.004).moved(x, y * (height / 2 + 0.008), 0.0)
            body.append(Part(pin, palette.STEEL))
    links = []
    for k in range(count):
        x = pitch * (k - (count - 1) / 2)
        body += shifted(hardware.bezel(0.092, 0.21, 0.008, 0.006, palette.WHITE, 0.008), (x, -0.01, 0.089))
        grip = [Part(box(0.068, 0.085, 0.035, 0.008), palette.WHITE)]
        grip += [Part(box(0.058, 0.008, 0.004, 0.001).moved(0, y, 0.034), palette.STONE) for y in (-0.018, 0.0, 0.018)]
        where = (x, -0.01, 0.092)
        links.append(MovingLink(shifted(grip, where), "prismatic", where, (0, 1, 0), -0.05, 0.05, "small", "slider"))
        mark = hardware.mark_bar(0.022).moved(x, 0.119, 0.0895)
        body.append(mark)
    return Design("Switch", SWITCH_SCALE, body, links, directions=slide_directions("y"))


def keys(variant: int, rng: np.random.Generator) -> Design:
    """Novel: 3 or 4 piano keys hinged at their far ends in a wooden case."""
    count = (3, 4)[variant % 2]
    wood = pick(rng, (palette.WALNUT, palette.CHERRY, palette.BLACK))
    pitch = 0.088
    width = pitch * count + 0.05
    body = [Part(box(width, 0.36, 0.026, 0.006), wood)]
    body += [Part(box(0.024, 0.36, 0.082, 0.008).moved(sx * (width / 2 - 0.012)), wood) for sx in (-1, 1)]
    body.append(Part(box(width, 0.09, 0.098, 0.014).moved(0, 0.135), wood))
    body.append(Part(box(width - 0.05, 0.008, 0.004).moved(0, 0.088, 0.097), palette.BRASS))
    medal = lathe([(0.022, 0.097), (0.020, 0.101), (0, 0.102)], 24)
    body.append(Part(medal.moved(0, 0.135), palette.BRASS))
    links = []
    for k in range(count):
        x = pitch * (k - (count - 1) / 2)
        color = palette.IVORY if (k + variant) % 2 == 0 else pick(rng, (palette.SKY, palette.CORAL, palette.MUSTARD))
        key = prism(rectangle(pitch - 0.008, 0.25, 0.008, 3), -0.022, 0.0, bevel=0.006)
        lip = box(pitch - 0.03, 0.03, 0.003, 0.001).moved(0, -0.09, -0.0005)
        parts = [Part(key, color), Part(lip, palette.STONE)]
        where = (x, -0.045, 0.080)
        hinge = (x, 0.08, 0.072)
        links.append(MovingLink(shifted(parts, where), "revolute", hinge, (1, 0, 0), 0.0, 0.12, "small", "key"))
    return Design("Switch", SWITCH_SCALE, body, links, directions=hinge_directions("y"))
