"""Lamps whose shade changes colour; seen from above they differ: disc, square, bar, bell, octagon, flower, star.

The shade is a link of its own, fixed to the body, so that painting it leaves the rest alone.
"""

import numpy as np

from busybot.objects.procedural import cad, palette
from busybot.objects.procedural.design import LAMP_SCALE, Design, Part, Shade
from busybot.objects.procedural.grips import rod
from busybot.objects.procedural.palette import light_colors, pick


def lamp(body: list[Part], shade: cad.Solid, hue: int, rng: np.random.Generator) -> Design:
    return Design("Lamp", LAMP_SCALE, body, shade=Shade([Part(shade, palette.UNLIT)], light_colors(hue, rng)))


def foot(radius: float, rng: np.random.Generator) -> list[Part]:
    """A turned base disc."""
    profile = [(radius, 0.0), (radius, 0.012), (0.93 * radius, 0.022), (0.5 * radius, 0.03), (0.15 * radius, 0.045)]
    return [Part(cad.lathe([*profile, (0.0, 0.046)], 32), pick(rng, (*palette.METALS, *palette.WOODS, palette.NAVY)))]


def shell(outlines: list[tuple[np.ndarray, float]], thickness: float) -> cad.Solid:
    """An open shade: outlines with heights from below to above, and back on the inside."""
    outside = [cad.ring(outline, z) for outline, z in outlines]
    inside = [cad.ring(cad.inset(outline, thickness), z) for outline, z in outlines[::-1]]
    return cad.closed_loft([*outside, *inside])


def cone(variant: int, rng: np.random.Generator) -> Design:
    """A table lamp: turned stem, conical shade, a finial in the open top."""
    metal = pick(rng, palette.METALS)
    wide, narrow, height = ((0.215, 0.095, 0.56), (0.235, 0.125, 0.47))[variant % 2]
    profile = [(0.030, 0.04), (0.055, 0.09), (0.022, 0.16), (0.036, 0.22), (0.014, 0.28), (0.012, height - 0.03)]
    body = foot(0.13, rng)
    body.append(Part(cad.lathe(cad.smooth(profile, 3), 20), pick(rng, (*palette.WOODS, palette.TEAL, palette.CORAL))))
    for angle in np.arange(3) * 2 * np.pi / 3:
        tip = (0.98 * narrow * float(np.cos(angle)), 0.98 * narrow * float(np.sin(angle)), height - 0.03)
        body.append(Part(cad.pipe([(0, 0, height - 0.03), tip], 0.005, 6), metal))
    body.append(Part(cad.ball(0.022, 16, 8).moved(z=height - 0.015), metal))
    body.append(Part(cad.torus(narrow, 0.006, 32, 6).moved(z=height - 0.002), metal))
    shade = shell([(cad.circle(wide, 40), height - 0.24), (cad.circle(narrow, 40), height)], 0.006)
    return lamp(body, shade, 2 * variant, rng)


def globe(_variant: int, rng: np.random.Generator) -> Design:
    """A glass ball in a ring on three legs."""
    wood, metal = pick(rng, palette.WOODS), pick(rng, palette.METALS)
    body = [Part(cad.torus(0.120, 0.010, 36, 8).moved(z=0.20), metal)]
    for angle in np.arange(3) * 2 * np.pi / 3 + 0.5:
        c, s = float(np.cos(angle)), float(np.sin(angle))
        body.append(Part(cad.pipe([(0.185 * c, 0.185 * s, 0.0), (0.12 * c, 0.12 * s, 0.20)], 0.013, 10), wood))
        body.append(Part(cad.ball(0.020, 12, 8).moved(0.185 * c, 0.185 * s, 0.02), metal))
    body.append(Part(cad.lathe([(0.028, 0.435), (0.026, 0.453), (0.010, 0.461), (0, 0.463)], 18), metal))
    return lamp(body, cad.ball(0.178, 32, 14).moved(z=0.27), 1, rng)


def pyramid(_variant: int, rng: np.random.Generator) -> Design:
    """A square shade on a square wooden foot."""
    wood, metal = pick(rng, palette.WOODS), pick(rng, palette.METALS)
    body = [Part(cad.prism(cad.rectangle(0.22, 0.22, 0.02), 0, 0.035, bevel=0.012), wood)]
    body.append(Part(cad.prism(cad.rectangle(0.05, 0.05, 0.008), 0.03, 0.40, bevel=0.004), wood))
    body.append(Part(cad.prism(cad.rectangle(0.19, 0.19, 0.012), 0.445, 0.452, bevel=0.003), metal))
    body.append(Part(cad.lathe([(0.018, 0.45), (0.022, 0.465), (0.010, 0.478), (0, 0.48)], 16), metal))
    shade = shell([(cad.rectangle(0.38, 0.38, 0.03), 0.24), (cad.rectangle(0.21, 0.21, 0.018), 0.45)], 0.006)
    return lamp(body, shade, 4, rng)


def desk(_variant: int, rng: np.random.Generator) -> Design:
    """A bell-shaped head at the end of a bent arm."""
    paint = pick(rng, (palette.WHITE, palette.STEEL, palette.BRASS, palette.TEAL))
    low = cad.lathe([(0.13, 0), (0.13, 0.016), (0.12, 0.026), (0.03, 0.034), (0.0, 0.036)], 36)
    body = [Part(low.moved(-0.13), paint)]
    arm = cad.bent([(-0.13, 0, 0.02), (-0.20, 0, 0.30), (-0.02, 0, 0.46), (0.08, 0, 0.40)], 0.05, 4)
    body.append(Part(cad.pipe(arm, 0.012, 10), pick(rng, (palette.CHROME, palette.BLACK))))
    body += [Part(cad.ball(0.024, 14, 8).moved(x, 0, z), palette.CHROME) for x, z in ((-0.195, 0.30), (-0.02, 0.455))]
    neck = cad.lathe([(0.030, 0), (0.034, 0.02), (0.02, 0.045), (0, 0.05)], 18)
    body.append(Part(neck.turned("y", -0.25).moved(0.075, 0, 0.40), paint))
    outer = [(0.190, -0.13), (0.178, -0.10), (0.138, -0.04), (0.07, 0.0), (0.03, 0.012), (0.0, 0.014)]
    bell = cad.lathe([(0.180, -0.125), *outer], 36).turned("y", -0.25).moved(0.08, 0, 0.40)
    return lamp(body, bell, 5, rng)


def tube(_variant: int, rng: np.random.Generator) -> Design:
    """A glowing bar between two caps on a stand."""
    wood, metal = pick(rng, palette.WOODS), pick(rng, palette.METALS)
    body = [Part(cad.prism(cad.rectangle(0.48, 0.24, 0.05), 0, 0.03, bevel=0.012), wood)]
    for x in (-0.255, 0.255):
        cap = cad.lathe([(0.093, -0.022), (0.102, -0.014), (0.102, 0.014), (0.093, 0.022)], 28).turned("y", np.pi / 2)
        body.append(Part(cap.moved(x, 0, 0.24), metal))
        body.append(Part(cad.pipe(cad.bent([(0.72 * x, 0, 0.02), (x, 0, 0.10), (x, 0, 0.17)], 0.05), 0.016, 10), metal))
    bar = cad.lathe([(0.092, -0.235), (0.096, -0.22), (0.096, 0.22), (0.092, 0.235)], 28).turned("y", np.pi / 2)
    return lamp(body, bar.moved(z=0.24), 3, rng)


def lantern(variant: int, rng: np.random.Generator) -> Design:
    """Novel: an octagonal lantern, glass between ribs under a cap with a ring."""
    metal = (palette.IRON, palette.COPPER)[variant % 2]
    body = [Part(cad.prism(cad.circle(0.180, 8, np.pi / 8), 0, 0.04, bevel=0.012), metal)]
    for angle in np.arange(8) * np.pi / 4 + np.pi / 8:
        c, s = float(np.cos(angle)), float(np.sin(angle))
        rib = [(0.160 * c, 0.160 * s, 0.03), (0.230 * c, 0.230 * s, 0.28), (0.085 * c, 0.085 * s, 0.38)]
        body.append(Part(cad.pipe(cad.bent(rib, 0.02), 0.008, 8), metal))
    body.append(Part(cad.prism(cad.circle(0.092, 8, np.pi / 8), 0.372, 0.395, bevel=0.010), metal))
    body.append(Part(cad.torus(0.045, 0.008, 22, 8).turned("x", np.pi / 2).moved(z=0.435), metal))
    panes = [(0.160, 0.03), (0.225, 0.28), (0.085, 0.378)]
    glass = cad.loft([cad.ring(cad.circle(radius, 8, np.pi / 8), z) for radius, z in panes])
    return lamp(body, glass, 4 + variant, rng)


def tulip(_variant: int, rng: np.random.Generator) -> Design:
    """Novel: a flower of six petals on a green stalk with leaves."""
    body = foot(0.11, rng)
    body.append(Part(cad.lathe([(0.016, 0.03), (0.013, 0.20), (0.020, 0.30), (0.05, 0.33)], 14), palette.FOREST))
    for turn in (0.4, 2.5, 4.5):
        body.append(Part(_leaf().turned("z", turn), palette.FOREST))
    rows = [(0.05, 0.31, 0.1), (0.12, 0.345, 0.13), (0.165, 0.41, 0.16), (0.175, 0.46, 0.20), (0.150, 0.48, 0.22)]
    rows += [(0.110, 0.45, 0.20), (0.055, 0.40, 0.12)]
    petals = cad.loft([cad.ring(cad.wavy(radius, depth * radius, 6, 8), z) for radius, z, depth in rows])
    body.append(Part(cad.ball(0.030, 14, 8).stretched(z=1.4).moved(z=0.425), palette.MUSTARD))
    return lamp(body, petals, 2, rng)


def _leaf() -> cad.Solid:
    """A long leaf of a tulip, along x."""
    across, thickness = np.array([-0.035, 0.0, 0.035, 0.0]), np.array([0.0, -0.004, 0.0, 0.006])
    rows = ((0.0, 0.08, 0.35), (0.09, 0.17, 1.0), (0.18, 0.16, 0.8), (0.225, 0.12, 0.1))
    return cad.loft([np.stack([np.full(4, x), width * across, z + thickness], axis=1) for x, z, width in rows])


def star(_variant: int, rng: np.random.Generator) -> Design:
    """Novel: a five-pointed star that hovers over a round foot."""
    metal = pick(rng, palette.METALS)
    body = [*foot(0.13, rng), Part(cad.lathe([(0.018, 0.03), (0.014, 0.20), (0.03, 0.26)], 14), metal)]
    angles = np.arange(10) * np.pi / 5 + np.pi / 2
    radii = np.where(np.arange(10) % 2 == 0, 0.270, 0.135)
    outline = radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    tips = (np.array([0.0, 0.0, 0.24]), np.array([0.0, 0.0, 0.38]))
    body.append(Part(cad.lathe([(0.030, 0.368), (0.024, 0.382), (0.0, 0.388)], 16), metal))
    return lamp(body, cad.loft([cad.ring(outline, 0.30), cad.ring(outline, 0.315)], tips), 0, rng)


def drum(_variant: int, rng: np.random.Generator) -> Design:
    """A wide drum over a ball of wood."""
    metal = pick(rng, palette.METALS)
    body = foot(0.12, rng)
    body.append(Part(cad.ball(0.075, 24, 12).moved(z=0.11), pick(rng, (*palette.WOODS, palette.CORAL, palette.NAVY))))
    body.append(Part(rod((0, 0, 0.17), (0, 0, 0.40), 0.012), metal))
    body.append(Part(cad.lathe([(0.03, 0.38), (0.026, 0.40), (0.0, 0.412)], 18), metal))
    shade = cad.lathe([(0.235, 0.20), (0.235, 0.395), (0.228, 0.402), (0.216, 0.40), (0.206, 0.384), (0.0, 0.384)], 40)
    return lamp(body, shade, 3, rng)


def halo(_variant: int, rng: np.random.Generator) -> Design:
    """A glowing ring that leans on a slim stand."""
    wood = pick(rng, palette.WOODS)
    body = [Part(cad.prism(cad.rectangle(0.30, 0.16, 0.05, 6), 0, 0.034, bevel=0.012), wood)]
    body += [Part(rod((x, 0.02, 0.02), (x * 1.5, 0.05, 0.17), 0.012), pick(rng, palette.METALS)) for x in (-0.07, 0.07)]
    glow = cad.torus(0.20, 0.042, 40, 12).turned("x", 0.35).moved(0, 0, 0.22)
    return lamp(body, glow, 0, rng)


def bulb(_variant: int, rng: np.random.Generator) -> Design:
    """A big bare bulb in a brass socket on a cube."""
    body = [Part(cad.box(0.24, 0.24, 0.12, 0.02), pick(rng, (*palette.WOODS, palette.STONE, palette.NAVY)))]
    thread = [(0.075 - 0.006 * (k % 2), 0.12 + 0.012 * k) for k in range(6)]
    body.append(Part(cad.lathe([(0.085, 0.115), (0.085, 0.125), *thread[1:]], 28), palette.BRASS))
    rows = [(0.055, 0.17), (0.075, 0.21), (0.14, 0.29), (0.165, 0.36), (0.145, 0.44), (0.08, 0.495), (0.0, 0.51)]
    return lamp(body, cad.lathe(cad.smooth(rows, 3), 32), 2, rng)


def trio(_variant: int, rng: np.random.Generator) -> Design:
    """Three small balls on bent arms."""
    metal = pick(rng, (palette.BRASS, palette.COPPER, palette.IRON))
    body, balls = foot(0.12, rng), []
    for k, turn in enumerate((0.5, 2.6, 4.7)):
        x, y, z = 0.15 * float(np.cos(turn)), 0.15 * float(np.sin(turn)), 0.27 + 0.05 * k
        arm = cad.bent([(0, 0, 0.03), (0, 0, 0.16), (x, y, 0.16), (x, y, z - 0.06)], 0.06, 4)
        body.append(Part(cad.pipe(arm, 0.012, 10), metal))
        body.append(Part(cad.lathe([(0.028, -0.085), (0.04, -0.06), (0, -0.06)], 18).moved(x, y, z), metal))
        balls.append(cad.ball(0.082, 24, 12).moved(x, y, z))
    return lamp(body, cad.joined(balls), 4, rng)


def crystal(_variant: int, rng: np.random.Generator) -> Design:
    """A six-sided crystal in a dark rock."""
    rock = cad.prism(cad.wavy(0.16, 0.025, 7, 3), 0, 0.09, bevel=0.045, steps=3)
    body = [Part(rock, pick(rng, (palette.GRAPHITE, palette.STONE, palette.IRON)))]
    body.append(Part(cad.torus(0.115, 0.014, 24, 6).moved(z=0.085), pick(rng, palette.METALS)))
    rings = [cad.ring(cad.circle(r, 6, 0.2), z) for r, z in ((0.10, 0.07), (0.17, 0.24), (0.165, 0.32))]
    tips = (np.array([0, 0, 0.06]), np.array([0.02, 0.01, 0.46]))
    return lamp(body, cad.loft(rings, tips), 5, rng)


def lamppost(_variant: int, rng: np.random.Generator) -> Design:
    """A box of light under a wide flat hat."""
    metal = pick(rng, (palette.IRON, palette.FOREST, palette.NAVY))
    body = [*foot(0.14, rng), Part(rod((0, 0, 0.03), (0, 0, 0.22), 0.02), metal)]
    body.append(Part(cad.prism(cad.rectangle(0.22, 0.22, 0.02), 0.20, 0.22, bevel=0.006), metal))
    hat = ((0.30, 0.43), (0.30, 0.44), (0.08, 0.48), (0.04, 0.52))
    body.append(Part(cad.loft([cad.ring(cad.rectangle(s, s, 0.01), z) for s, z in hat]), metal))
    glow = cad.loft([cad.ring(cad.rectangle(s, s, 0.02), z) for s, z in ((0.20, 0.22), (0.40, 0.40), (0.36, 0.432))])
    return lamp(body, glow, 1, rng)


def cactus(_variant: int, rng: np.random.Generator) -> Design:
    """Novel: a ribbed cactus with two arms in a clay pot."""
    pot = [(0.10, 0), (0.125, 0.10), (0.145, 0.10), (0.15, 0.135), (0.125, 0.135), (0.12, 0.12), (0, 0.12)]
    body = [Part(cad.lathe(pot, 32), pick(rng, (palette.COPPER, palette.TEAL, palette.BLUSH)))]
    rows = ((0.08, 0.11), (0.105, 0.18), (0.108, 0.33), (0.09, 0.43), (0.04, 0.475))
    trunk = cad.loft([cad.ring(cad.wavy(r, 0.10 * r, 9, 4), z) for r, z in rows])
    bends = [[(s * 0.05, 0, z), (s * 0.20, 0, z), (s * 0.20, 0, z + 0.13)] for s, z in ((1, 0.22), (-1, 0.29))]
    arms = [cad.pipe(cad.bent(bend, 0.08, 5), 0.058, 14) for bend in bends]
    tops = [cad.ball(0.058, 14, 8).moved(*bend[-1]) for bend in bends]
    flower = cad.lathe([(0.014, 0.47), (0.034, 0.492), (0.0, 0.497)], 12)
    body.append(Part(flower, pick(rng, (palette.CORAL, palette.MUSTARD))))
    return lamp(body, cad.joined([trunk, *arms, *tops]), 4, rng)


def cloud(_variant: int, rng: np.random.Generator) -> Design:
    """Novel: a cloud of five balls on two thin legs."""
    metal = pick(rng, palette.METALS)
    body = [Part(cad.prism(cad.rectangle(0.34, 0.20, 0.09, 7), 0, 0.03, bevel=0.012), pick(rng, palette.WOODS))]
    body += [Part(rod((x, 0, 0.02), (x, 0, 0.22), 0.010), metal) for x in (-0.08, 0.08)]
    sides = (
        (0.14, 0.0, 0.27, 0.105),
        (-0.15, 0.01, 0.27, 0.11),
        (0.05, -0.09, 0.25, 0.09),
        (-0.07, -0.09, 0.25, 0.085),
    )
    glow = cad.joined([cad.ball(r, 24, 12).moved(x, y, z) for x, y, z, r in ((0.0, 0.02, 0.30, 0.135), *sides)])
    return lamp(body, glow, 5, rng)
