"""Two-state switches with one movable link: rocker, toggle, push buttons, slider; novel: paddle, knife, mushroom, bolt.

Every family is a function of a variant number and a generator; families of the novel split have shapes of their own.
"""

import numpy as np

from busybot.objects.procedural import cad, fixtures, palette
from busybot.objects.procedural.design import (
    HINGE_X,
    HINGE_Y,
    SLIDE_X,
    Design,
    Material,
    MovingLink,
    Part,
    shifted,
    switch,
)
from busybot.objects.procedural.fixtures import TOP, corners, pressed, slid, swung
from busybot.objects.procedural.palette import in_turn, pick


def rocker_link(
    x: float, y: float, z: float, width: float, length: float, tilt: float, material: Material
) -> MovingLink:
    """A rocker that tilts about y; (x, y, z) is the middle of its dipping top."""
    sign = palette.WHITE if sum(material.color) < 2.2 else palette.GRAPHITE
    parts = [
        Part(fixtures.rocker_body(width, length, 0.014, 0.0, 0.03), material),
        fixtures.mark_bar(0.36 * width, sign).turned("y", -0.10).moved(x=0.30 * length, z=0.0066),
        fixtures.mark_ring(0.17 * width, sign).turned("y", 0.10).moved(x=-0.30 * length, z=0.0066),
    ]
    # pressed left at the lower limit: turning about y lowers +x
    return swung(shifted(parts, (0, 0, 0.02)), (x, y, z - 0.02), tilt, label="rocker")


def rocker(variant: int, rng: np.random.Generator) -> Design:
    """A wide rocker in a raised frame on a cover plate."""
    cover = in_turn((palette.IVORY, palette.GRAPHITE, palette.SAGE, palette.PEARL), variant)
    key = pick(rng, (palette.WHITE, palette.IVORY, *palette.ACCENTS, palette.GRAPHITE), unlike=cover)
    length, width = ((0.20, 0.13), (0.17, 0.10), (0.19, 0.15), (0.15, 0.12))[variant % 4]
    screws, tilt = (("corners", 0.20), ("poles", 0.24), ("none", 0.17), ("poles", 0.07))[variant % 4]
    body = fixtures.plate(0.30 + 0.02 * (variant % 2), 0.30, cover, rng, screws)
    rim = fixtures.bezel(length + 0.045, width + 0.045, 0.018, 0.022, pick(rng, (palette.STEEL, cover, palette.BLACK)))
    body += shifted(rim, (0, 0, TOP - 0.001))
    return switch(body, [rocker_link(0, 0, TOP + 0.026, width, length, tilt, key)], HINGE_X)


def toggle_link(
    x: float, y: float, z: float, length: float, radius: float, swing: float, rng: np.random.Generator, along: str = "x"
) -> MovingLink:
    """A bat lever whose foot is at (x, y, z)."""
    metal = pick(rng, palette.METALS)
    parts = shifted(fixtures.bat(length, radius, metal, pick(rng, (*palette.ACCENTS, metal))), (x, y, z))
    axis = (0.0, 1.0, 0.0) if along == "x" else (-1.0, 0.0, 0.0)
    return MovingLink(parts, "revolute", (x, y, z), axis, -swing, swing, "small", "toggle_button")


def toggle(variant: int, rng: np.random.Generator) -> Design:
    """A bat lever in a hexagonal nut."""
    cover = in_turn((palette.STEEL, palette.NAVY, palette.IVORY, palette.BLACK), variant)
    size, along = ((0.28, "x"), (0.26, "y"), (0.32, "x"), (0.27, "x"))[variant % 4]
    if variant % 4 == 2:  # a round turned plate with a light
        profile = [(0.5, 0), (0.5, 0.016), (0.47, 0.026), (0.40, 0.03), (0.38, 0.024), (0.30, 0.026), (0.0, 0.030)]
        body = [Part(cad.lathe([(share * size, z) for share, z in profile], 40), cover)]
        body += shifted(fixtures.indicator(0.013, palette.RED, palette.CHROME), (0.37 * size, 0, TOP))
    else:
        body = fixtures.plate(size, size, cover, rng, ("ends", "corners", "none", "poles")[variant % 4])
    body += shifted(fixtures.hex_collar(0.07, pick(rng, palette.METALS)), (0, 0, TOP - 0.002))
    link = toggle_link(0, 0, TOP + 0.03, 0.17, 0.034, 0.48, rng, along)
    return switch(body, [link], HINGE_X if along == "x" else HINGE_Y)


def button(variant: int, rng: np.random.Generator) -> Design:
    """A round button with a dished top in a turned collar."""
    cover = in_turn((palette.WHITE, palette.GRAPHITE, palette.SAGE, palette.NAVY), variant)
    cap, metal = pick(rng, palette.ACCENTS, unlike=cover), pick(rng, palette.METALS)
    radius = (0.075, 0.085, 0.068, 0.078)[variant % 4]
    screws, corner = (("corners", 0.03), ("none", 0.09), ("ends", 0.02), ("poles", 0.05))[variant % 4]
    body = fixtures.plate(0.28, 0.28, cover, rng, screws, corner)
    body += shifted(fixtures.round_bezel(radius + 0.028, radius + 0.003, 0.026, metal), (0, 0, TOP - 0.001))
    glow = cad.torus(0.55 * radius, 0.004, 28, 6).moved(z=-0.004)
    parts = [Part(fixtures.dish_cap(radius, 0.0), cap), Part(glow, palette.WHITE if variant % 2 else metal)]
    return switch(body, [pressed(parts, (0, 0, TOP + 0.055), 0.032)], HINGE_X)


def key(variant: int, rng: np.random.Generator) -> Design:
    """A square illuminated key in a square frame."""
    cover = in_turn((palette.GRAPHITE, palette.PEARL), variant)
    cap = in_turn((palette.MINT, palette.CORAL), variant)
    body = [Part(cad.prism(cad.rectangle(0.27, 0.27, 0.02), 0, 0.045, bevel=0.02, steps=3), cover)]
    body += shifted(fixtures.bezel(0.19, 0.19, 0.014, 0.016, palette.STEEL), (0, 0, 0.044))
    top = cad.prism(cad.rectangle(0.145, 0.145, 0.02), -0.03, 0, bevel=0.014, steps=3)
    sign = cad.frame(cad.rectangle(0.085, 0.085, 0.012), cad.rectangle(0.067, 0.067, 0.006), 0, 0.002, 0.0006)
    dot = Part(cad.lathe([(0.016, 0), (0.014, 0.002)], 18), cover)
    inner = fixtures.mark_bar(0.05, cover).moved(z=-0.0004) if variant % 2 else dot
    parts = [Part(top, cap), Part(sign.moved(z=-0.0002), cover), inner]
    return switch(body, [pressed(parts, (0, 0, 0.044 + 0.046), 0.028)], HINGE_X)


def slider(variant: int, rng: np.random.Generator) -> Design:
    """A ridged grip in a groove, moving along x."""
    cover = in_turn((palette.IVORY, palette.NAVY, palette.STEEL), variant)
    grip = pick(rng, (*palette.ACCENTS, palette.BLACK, palette.WHITE), unlike=cover)
    width, height, travel = ((0.36, 0.20, 0.13), (0.33, 0.24, 0.11), (0.40, 0.18, 0.16))[variant % 3]
    screws, corner = (("ends", 0.02), ("corners", 0.03), ("none", 0.08))[variant % 3]
    body = fixtures.plate(width, height, cover, rng, screws, corner)
    body += shifted(fixtures.slot(travel + 0.085, 0.05, pick(rng, (palette.STEEL, palette.BRASS))), (0, 0, TOP - 0.001))
    for sign, material in ((-1, palette.SHADOW), (1, pick(rng, palette.ACCENTS, unlike=cover))):
        dot = cad.lathe([(0.012, 0), (0.011, 0.002), (0, 0.0025)], 16)
        body.append(Part(dot.moved(sign * travel / 2, 0.37 * height, TOP), material))
    cap = shifted(fixtures.ridged_cap(0.075, 0.085, 0.045, grip), (0, 0, 0.004))
    return switch(body, [slid(cap, (0, 0, TOP), travel)], SLIDE_X)


def membrane(variant: int, rng: np.random.Generator) -> Design:
    """Two flat pads that give by a few thousandths of a unit: a small-displacement trigger with two links."""
    cover = in_turn((palette.PEARL, palette.NAVY), variant)
    body = [Part(cad.prism(cad.rectangle(0.42, 0.26, 0.05), 0, 0.034, bevel=0.014, steps=3), cover)]
    links = []
    for k, x in enumerate((-0.095, 0.095)):
        rim = fixtures.bezel(0.165, 0.165, 0.010, 0.006, palette.STEEL, (0.04, 0.075)[variant % 2])
        body += shifted(rim, (x, 0, 0.033))
        pad = cad.prism(cad.rectangle(0.138, 0.138, (0.03, 0.062)[variant % 2], 5), -0.02, 0, bevel=0.006)
        color = pick(rng, palette.ACCENTS, unlike=cover)
        sign = fixtures.mark_bar(0.06) if k else fixtures.mark_ring(0.03)
        parts = [Part(pad, color), sign.moved(z=-0.0004)]
        links.append(pressed(parts, (x, 0, 0.033 + 0.010), (0.004, 0.006)[variant % 2]))
    return switch(body, links, HINGE_X)


def paddle(variant: int, rng: np.random.Generator) -> Design:
    """Novel: one big curved paddle that fills an oval plate; the second variant tilts by 0.12 radians only."""
    cover = in_turn((palette.WALNUT, palette.BIRCH), variant)
    face = in_turn((palette.IVORY, palette.TEAL), variant)
    outline = np.array(cad.wavy(1.0, 0.0, 1, 40)) * np.array([(0.19, 0.155), (0.165, 0.175)][variant % 2])
    body = [Part(cad.prism(outline, 0, TOP, bevel=0.014, steps=3), cover)]
    inner = 0.80 * outline
    body += [Part(cad.frame(0.86 * outline, inner, TOP - 0.002, TOP + 0.008, bevel=0.003), palette.BRASS)]
    rings = []
    for share, z in ((0.97, -0.03), (0.97, 0.004), (0.93, 0.010), (0.80, 0.014), (0.55, 0.010), (0.25, 0.004)):
        flat = cad.ring(share * inner, z)
        flat[:, 2] += 0.30 * flat[:, 0] ** 2 / 0.15 if z > 0 else 0.0
        rings.append(flat)
    paddle = Part(cad.loft(rings).moved(z=0.01), face)
    link = swung([paddle], (0, 0, TOP + 0.018 - 0.01), (0.19, 0.06)[variant % 2], label="paddle")
    return switch(body, [link], HINGE_X)


def knife(variant: int, rng: np.random.Generator) -> Design:
    """Novel: a knife switch, two copper blades with a wooden handle on a ceramic base."""
    base, metal = ((palette.WHITE, palette.COPPER), (palette.GRAPHITE, palette.BRASS))[variant % 2]
    body = [Part(cad.prism(cad.rectangle(0.42, 0.19, 0.025), 0, 0.035, bevel=0.012, steps=3), base)]
    for x, y in ((-0.185, 0.07), (-0.185, -0.07), (0.185, 0.07), (0.185, -0.07)):
        body += fixtures.screw(x, y, 0.034, float(rng.uniform(0, 3)), metal)
    for y in (-0.038, 0.038):
        body.append(Part(cad.box(0.05, 0.03, 0.012, 0.004).moved(-0.13, y, 0.034), metal))
        for dy in (-0.009, 0.009):
            body.append(Part(cad.box(0.036, 0.005, 0.05, 0.002).moved(-0.13, y + dy, 0.034), metal))
            body.append(Part(cad.box(0.028, 0.005, 0.042, 0.002).moved(0.075, y + dy, 0.034), metal))
        body.append(Part(cad.box(0.045, 0.03, 0.012, 0.004).moved(0.075, y, 0.034), metal))
    z = 0.066
    parts = [Part(cad.box(0.25, 0.009, 0.026, 0.003).moved(0.0, y, z - 0.013), metal) for y in (-0.038, 0.038)]
    parts.append(Part(cad.pipe([(-0.13, -0.055, z), (-0.13, 0.055, z)], 0.010, 12), metal))
    parts.append(Part(cad.box(0.03, 0.10, 0.022, 0.006).moved(0.125, 0, z - 0.011), palette.BLACK))
    handle = cad.smooth([(0.014, 0), (0.022, 0.015), (0.030, 0.045), (0.026, 0.075), (0.012, 0.092), (0.0, 0.095)], 3)
    wood = pick(rng, (palette.CHERRY, palette.WALNUT, palette.RED))
    parts.append(Part(cad.lathe(handle, 18).turned("y", np.pi / 2).moved(0.135, 0, z), wood))
    # closed at 0; turning about -y lifts the handle
    link = MovingLink(parts, "revolute", (-0.13, 0, z), (0, -1, 0), 0.0, 0.85, "small", "lever")
    return switch(body, [link], HINGE_X)


def mushroom(variant: int, rng: np.random.Generator) -> Design:
    """Novel: an emergency stop, a mushroom head over a yellow box."""
    box_color, head = ((palette.MUSTARD, palette.RED), (palette.PEARL, palette.FOREST))[variant % 2]
    body = [Part(cad.prism(cad.rectangle(0.30, 0.30, 0.045), 0, 0.07, bevel=0.02, steps=3), box_color)]
    for x, y in corners(0.30, 0.30, 0.038):
        body += fixtures.screw(x, y, 0.068, float(rng.uniform(0, 3)))
    body += [Part(cad.lathe([(0.115, 0.069), (0.115, 0.073), (0.112, 0.0745), (0.0, 0.0745)], 40), palette.WHITE)]
    body += [Part(cad.lathe([(0.055, 0.07), (0.055, 0.095), (0.05, 0.10), (0, 0.10)], 28), palette.BLACK)]
    skirt = [(0.0484, -0.045), (0.05456, -0.012), (0.0836, -0.010)]
    dome = [(0.088 * float(np.cos(a)), 0.04 * float(np.sin(a))) for a in np.linspace(0, np.pi / 2, 7)[:-1]]
    arrow = cad.torus(0.05, 0.005, 26, 6).moved(z=0.034)
    parts = [Part(cad.lathe([*skirt, *dome, (0.0, 0.04)], 32), head), Part(arrow, palette.WHITE)]
    return switch(body, [pressed(parts, (0, 0, 0.145), 0.035)], HINGE_X)


def bolt(variant: int, rng: np.random.Generator) -> Design:
    """Novel: a door bolt that slides through brackets."""
    metal = (palette.BRASS, palette.IRON)[variant % 2]
    wood = pick(rng, palette.WOODS)
    body = [Part(cad.prism(cad.rectangle(0.46, 0.17, 0.02), 0, 0.028, bevel=0.008, steps=3), wood)]
    body.append(Part(cad.prism(cad.rectangle(0.30, 0.12, 0.012), 0.027, 0.035, bevel=0.003).moved(-0.045), metal))
    body.append(Part(cad.prism(cad.rectangle(0.08, 0.12, 0.012), 0.027, 0.035, bevel=0.003).moved(0.18), metal))
    arch = [(0.0, -0.042, 0.03), (0.0, -0.042, 0.078), (0.0, 0.042, 0.078), (0.0, 0.042, 0.03)]
    for x in (-0.165, 0.075, 0.18):
        strap = cad.bent([(x + a, b, c) for a, b, c in arch], 0.04, 5)
        body.append(Part(cad.pipe(strap, 0.013, 10), metal))
    for x, y in ((-0.12, 0.045), (-0.12, -0.045), (0.03, 0.045), (0.03, -0.045), (0.205, 0.047), (0.205, -0.047)):
        body += fixtures.screw(x, y, 0.034, float(rng.uniform(0, 3)), metal, 0.009)
    z = 0.058
    rod = [Part(cad.pipe([(-0.20, 0, z), (-0.19, 0, z), (0.12, 0, z), (0.13, 0, z)], 0.020, 14), palette.STEEL)]
    rod.append(Part(cad.pipe([(-0.045, 0, z), (-0.045, 0, z + 0.05)], 0.012, 12), palette.STEEL))
    rod.append(Part(cad.ball(0.038, 20, 10).moved(-0.045, 0, z + 0.065), pick(rng, palette.ACCENTS)))
    return switch(body, [slid(shifted(rod, (0, 0, -z)), (0, 0, z), 0.11)], SLIDE_X)
