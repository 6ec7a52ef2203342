"""More lamps: a drum, a glowing ring, a bulb, three balls, a crystal, a book; novel: a cactus, a cloud."""

import numpy as np

from busybot.objects.procedural import palette
from busybot.objects.procedural.design import Design, Part
from busybot.objects.procedural.lamps import foot, lamp
from busybot.objects.procedural.palette import pick
from busybot.objects.procedural.shapes import rod
from busybot.objects.procedural.solids import (
    ball,
    bent,
    box,
    circle,
    joined,
    lathe,
    loft,
    prism,
    rectangle,
    ring,
    smooth,
    star,
    torus,
    tube,
)


def drum(variant: int, rng: np.random.Generator) -> Design:
    """A wide drum over a ball of wood."""
    del variant
    metal = pick(rng, palette.METALS)
    body = [
        *foot(0.12, rng),
        Part(ball(0.075, 24, 12).moved(z=0.11), pick(rng, (*palette.WOODS, palette.CORAL, palette.NAVY))),
    ]
    body.append(Part(rod((0, 0, 0.17), (0, 0, 0.40), 0.012), metal))
    body.append(Part(lathe([(0.03, 0.38), (0.026, 0.40), (0.0, 0.412)], 18), metal))
    shade = lathe([(0.235, 0.20), (0.235, 0.395), (0.228, 0.402), (0.216, 0.40), (0.206, 0.384), (0.0, 0.384)], 40)
    return lamp(body, shade, 3, rng)


def halo(variant: int, rng: np.random.Generator) -> Design:
    """A glowing ring that leans on a slim stand."""
    del variant
    wood = pick(rng, palette.WOODS)
    body = [Part(prism(rectangle(0.30, 0.16, 0.05, 6), 0, 0.034, bevel=0.012), wood)]
    body += [Part(rod((x, 0.02, 0.02), (x * 1.5, 0.05, 0.17), 0.012), pick(rng, palette.METALS)) for x in (-0.07, 0.07)]
    glow = torus(0.20, 0.042, 40, 12).turned("x", 0.35).moved(0, 0, 0.22)
    return lamp(body, glow, 0, rng)


def bulb(variant: int, rng: np.random.Generator) -> Design:
    """A big bare bulb in a brass socket on a cube."""
    del variant
    body = [Part(box(0.24, 0.24, 0.12, 0.02), pick(rng, (*palette.WOODS, palette.STONE, palette.NAVY)))]
    thread = [(0.075 - 0.006 * (k % 2), 0.12 + 0.012 * k) for k in range(6)]
    body.append(Part(lathe([(0.085, 0.115), (0.085, 0.125), *thread[1:]], 28), palette.BRASS))
    rows = [(0.055, 0.17), (0.075, 0.21), (0.14, 0.29), (0.165, 0.36), (0.145, 0.44), (0.08, 0.495), (0.0, 0.51)]
    return lamp(body, lathe(smooth(rows, 3), 32), 2, rng)


def trio(variant: int, rng: np.random.Generator) -> Design:
    """Three small balls on bent arms."""
    del variant
    metal = pick(rng, (palette.BRASS, palette.COPPER, palette.IRON))
    body, balls = foot(0.12, rng), []
    for k, turn in enumerate((0.5, 2.6, 4.7)):
        x, y, z = 0.15 * float(np.cos(turn)), 0.15 * float(np.sin(turn)), 0.27 + 0.05 * k
        arm = bent([(0, 0, 0.03), (0, 0, 0.16), (x, y, 0.16), (x, y, z - 0.06)], 0.06, 4)
        body.append(Part(tube(arm, 0.012, 10), metal))
        body.append(Part(lathe([(0.028, -0.085), (0.04, -0.06), (0, -0.06)], 18).moved(x, y, z), metal))
        balls.append(ball(0.082, 24, 12).moved(x, y, z))
    return lamp(body, joined(balls), 4, rng)


def crystal(variant: int, rng: np.random.Generator) -> Design:
    """A six-sided crystal in a dark rock."""
    del variant
    rock = prism(star(0.16, 0.025, 7, 3), 0, 0.09, bevel=0.045, steps=3)
    body = [Part(rock, pick(rng, (palette.GRAPHITE, palette.STONE, palette.IRON)))]
    body.append(Part(torus(0.115, 0.014, 24, 6).moved(z=0.085), pick(rng, palette.METALS)))
    rings = [ring(circle(r, 6, 0.2), z) for r, z in ((0.10, 0.07), (0.17, 0.24), (0.165, 0.32))]
    tips = (np.array([0, 0, 0.06]), np.array([0.02, 0.01, 0.46]))
    return lamp(body, loft(rings, tips), 5, rng)


def lamppost(variant: int, rng: np.random.Generator) -> Design:
    """A box of light under a wide flat hat."""
    metal = pick(rng, (palette.IRON, palette.FOREST, palette.NAVY))
    del variant
    body = [*foot(0.14, rng), Part(rod((0, 0, 0.03), (0, 0, 0.22), 0.02), metal)]
    body.append(Part(prism(rectangle(0.22, 0.22, 0.02), 0.20, 0.22, bevel=0.006), metal))
    body.append(
        Part(
            loft([ring(rectangle(s, s, 0.01), z) for s, z in ((0.30, 0.43), (0.30, 0.44), (0.08, 0.48), (0.04, 0.52))]),
            metal,
        )
    )
    glow = loft([ring(rectangle(s, s, 0.02), z) for s, z in ((0.20, 0.22), (0.40, 0.40), (0.36, 0.432))])
    return lamp(body, glow, 1, rng)


def cactus(variant: int, rng: np.random.Generator) -> Design:
    """Novel: a ribbed cactus with two arms in a clay pot."""
    del variant
    pot = [(0.10, 0), (0.125, 0.10), (0.145, 0.10), (0.15, 0.135), (0.125, 0.135), (0.12, 0.12), (0, 0.12)]
    body = [Part(lathe(pot, 32), pick(rng, (palette.COPPER, palette.TEAL, palette.BLUSH)))]
    rows = ((0.08, 0.11), (0.105, 0.18), (0.108, 0.33), (0.09, 0.43), (0.04, 0.475))
    trunk = loft([ring(star(r, 0.10 * r, 9, 4), z) for r, z in rows])
    arms = [
        tube(bent([(s * 0.05, 0, z), (s * 0.20, 0, z), (s * 0.20, 0, z + 0.13)], 0.08, 5), 0.058, 14)
        for s, z in ((1, 0.22), (-1, 0.29))
    ]
    tops = [ball(0.058, 14, 8).moved(s * 0.20, 0, z + 0.13) for s, z in ((1, 0.22), (-1, 0.29))]
    body.append(
        Part(lathe([(0.014, 0.47), (0.034, 0.492), (0.0, 0.497)], 12), pick(rng, (palette.CORAL, palette.MUSTARD)))
    )
    return lamp(body, joined([trunk, *arms, *tops]), 4, rng)


def cloud(variant: int, rng: np.random.Generator) -> Design:
    """Novel: a cloud of five balls on two thin legs."""
    del variant
    metal = pick(rng, palette.METALS)
    body = [Part(prism(rectangle(0.34, 0.20, 0.09, 7), 0, 0.03, bevel=0.012), pick(rng, palette.WOODS))]
    body += [Part(rod((x, 0, 0.02), (x, 0, 0.22), 0.010), metal) for x in (-0.08, 0.08)]
    puffs = (
        (0.0, 0.02, 0.30, 0.135),
        (0.14, 0.0, 0.27, 0.105),
        (-0.15, 0.01, 0.27, 0.11),
        (0.05, -0.09, 0.25, 0.09),
        (-0.07, -0.09, 0.25, 0.085),
    )
    glow = joined([ball(r, 24, 12).moved(x, y, z) for x, y, z, r in puffs])
    return lamp(body, glow, 5, rng)
