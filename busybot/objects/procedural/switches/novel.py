"""More switches of the novel split: a seesaw, a clam, a crank, a honeycomb, a boat: shapes that training lacks."""

import numpy as np

from busybot.objects.procedural import palette
from busybot.objects.procedural.design import HINGE_X, SLIDE_X, TURN_Z, Design, Part, switch
from busybot.objects.procedural.fixtures import lifted, pressed, slid, swung, turned
from busybot.objects.procedural.grips import lying
from busybot.objects.procedural.palette import in_turn, pick
from busybot.objects.procedural.solids import (
    ball,
    box,
    circle,
    frame,
    inset,
    lathe,
    loft,
    pipe,
    prism,
    rectangle,
    ring,
    smooth,
    torus,
)


def seesaw(variant: int, rng: np.random.Generator) -> Design:
    """A playground's plank over a trestle, with a seat and a handle at both ends."""
    grass = in_turn((palette.SAGE, palette.SKY), variant)
    plank, seat = pick(rng, palette.WOODS), in_turn((palette.RED, palette.MUSTARD), variant)
    reach = (0.20, 0.17)[variant % 2]
    body = [Part(prism(rectangle(2 * reach + 0.10, 0.20, 0.08, 6), 0, 0.028, bevel=0.010), grass)]
    for y in (-0.05, 0.05):
        leg = np.array([(-0.045, 0.0), (0.045, 0.0), (0.0, 0.085)])
        body.append(Part(prism(leg, -0.006, 0.006).turned("x", np.pi / 2).moved(0, y, 0.026), palette.NAVY))
    parts = [Part(box(2 * reach, 0.06, 0.018, 0.006).moved(z=-0.004), plank), Part(lying(0.010, 0.12), palette.STEEL)]
    for side in (-1, 1):
        pad = prism(rectangle(0.07, 0.08, 0.03), 0.010, 0.024, bevel=0.006)
        parts.append(Part(pad.moved(side * (reach - 0.045)), seat))
        x = side * (reach - 0.105)
        hoop = [(x, -0.025, 0.01), (x, -0.025, 0.05), (x, 0.025, 0.05), (x, 0.025, 0.01)]
        parts.append(Part(pipe(np.array(hoop), 0.006, 8), palette.CHROME))
    return switch(body, [swung(parts, (0, 0, 0.105), 0.26, label="plank")], HINGE_X, variant)


def clam(variant: int, rng: np.random.Generator) -> Design:
    """A shell whose ribbed upper half opens, with a pearl inside."""
    shell = in_turn((palette.BLUSH, palette.PLUM), variant)
    angles = np.linspace(-1.15, 1.15, 33)
    ribs = np.cos(angles * 10 * np.pi / 1.15)
    fan = 0.27 * np.stack([np.cos(angles), np.sin(angles)], axis=1) * (1.0 + 0.03 * ribs)[:, None]
    outline = np.concatenate([[[0.0, 0.045], [0.0, -0.045]], fan])
    low = prism(rectangle(0.38, 0.42, 0.10, 6), 0, 0.025, bevel=0.010)
    lower = loft([ring(0.8 * outline, 0.02), ring(outline, 0.055), ring(inset(outline, 0.012), 0.058)])
    body = [Part(low, palette.BIRCH), Part(lower.moved(-0.135), shell)]
    body.append(Part(ball(0.035, 18, 10).moved(0.03, 0, 0.075), palette.PEARL))
    relief = np.concatenate([[0.0, 0.0], ribs])
    rings = []
    for share, z in ((1.0, 0.0), (0.99, 0.012), (0.88, 0.040), (0.66, 0.062), (0.42, 0.064), (0.22, 0.05)):
        level = ring(share * outline, z)
        level[:, 2] += 0.10 * z * relief
        rings.append(level)
    upper = loft(rings, (None, np.array([0.03, 0.0, 0.045])))
    link = lifted([Part(upper, pick(rng, (shell, palette.CORAL)))], (-0.135, 0, 0.060), 0.7)
    return switch(body, [link], HINGE_X, 3)


def crank(variant: int, rng: np.random.Generator) -> Design:
    """A round table with an upright handle near its rim, turned like a coffee mill's."""
    wood = in_turn((palette.WALNUT, palette.BIRCH), variant)
    metal = in_turn((palette.BRASS, palette.STEEL), variant)
    body = [Part(prism(circle(0.18, 8, np.pi / 8), 0, 0.07, bevel=0.012), wood)]
    body.append(Part(lathe([(0.13, 0.068), (0.125, 0.078), (0, 0.078)], 36), palette.BLACK))
    plate = prism(circle(0.115, 36), 0, 0.016, bevel=0.006)
    hole = prism(circle(0.018, 18), 0.014, 0.0168)
    holes = [hole.moved(0.07 * np.cos(angle), 0.07 * np.sin(angle)) for angle in (1.57, 3.14, 4.71)]
    post = lathe(smooth([(0.012, 0.0), (0.014, 0.03), (0.026, 0.06), (0.028, 0.09), (0.016, 0.108), (0, 0.11)], 2), 20)
    parts = [Part(plate, metal), *(Part(hole, palette.SHADOW) for hole in holes)]
    parts.append(Part(post.moved(0.082, 0, 0.014), pick(rng, (palette.RED, palette.NAVY, palette.FOREST))))
    return switch(body, [turned(parts, (0, 0, 0.080), 0.7)], TURN_Z, variant)


def honeycomb(variant: int, rng: np.random.Generator) -> Design:
    """Three hexagonal cells of honey that go down, among closed ones that do not."""
    wax = in_turn((palette.MUSTARD, palette.OAK), variant)
    body = [Part(prism(circle(0.215, 6), 0, 0.034, bevel=0.012), wax)]
    links = []
    for k in range(7):
        angle = k * np.pi / 3 + np.pi / 6
        x, y = (0.118 * float(np.cos(angle)), 0.118 * float(np.sin(angle))) if k < 6 else (0.0, 0.0)
        if k % 2 == 0 and k < 6:
            wall = frame(circle(0.068, 6), circle(0.060, 6), 0, 0.014, 0.003).moved(x, y, 0.033)
            floor = prism(circle(0.060, 6), 0, 0.002).moved(x, y, 0.033)
            body += [Part(wall, wax), Part(floor, palette.SHADOW)]
            top = prism(circle(0.055, 6), -0.02, 0.0, bevel=0.012, steps=3)
            links.append(pressed([Part(top, palette.ORANGE)], (x, y, 0.070), 0.018))
        else:
            body.append(Part(prism(circle(0.056, 6), 0, 0.008, bevel=0.004).moved(x, y, 0.033), palette.BIRCH))
    bee = Part(ball(0.014, 12, 6).stretched(x=1.6).moved(0, 0, 0.05), pick(rng, (palette.BLACK, palette.IRON)))
    body += [bee, Part(torus(0.0125, 0.003, 12, 5).turned("y", 1.57).moved(z=0.05), palette.MUSTARD)]
    return switch(body, links, HINGE_X)


def boat(variant: int, rng: np.random.Generator) -> Design:
    """A little ship in a basin, between two jetties."""
    outer = rectangle(0.48, 0.24, 0.05, 5)
    body = [Part(frame(outer, inset(outer, 0.022), 0, 0.048, 0.008), pick(rng, palette.WOODS))]
    body.append(Part(prism(inset(outer, 0.012), 0, 0.026), palette.SKY))
    for x in (-0.19, 0.19):
        body.append(Part(box(0.05, 0.07, 0.036, 0.005).moved(x, 0.075, 0.0), palette.BIRCH))
    side = np.array([(0.06, 0.036), (-0.02, 0.045), (-0.085, 0.038)])
    hull = np.concatenate([[(0.10, 0.0)], side, side[::-1] * [1, -1]])
    rings = [ring(share * hull, z) for share, z in ((0.8, 0.0), (1.0, 0.035), (0.92, 0.038), (0.85, 0.028))]
    parts = [Part(loft(rings), in_turn((palette.RED, palette.NAVY), variant))]
    parts.append(Part(box(0.07, 0.05, 0.045, 0.006).moved(-0.03, 0, 0.026), palette.WHITE))
    funnel = lathe([(0.018, 0.06), (0.016, 0.105), (0.0, 0.105)], 16)
    band = torus(0.017, 0.004, 16, 6).moved(-0.03, 0, 0.092)
    parts += [Part(funnel.moved(-0.03), palette.MUSTARD), Part(band, palette.BLACK)]
    return switch(body, [slid(parts, (0, -0.02, 0.027), 0.19, "large")], SLIDE_X, variant)
