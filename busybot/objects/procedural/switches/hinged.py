"""Switches that are hinged at one end (lids, pedals, arms that lie flat, handles), and novel ones of many kinds.

Novel: a seesaw, a clam, a crank, a honeycomb, a boat: shapes that training lacks.
"""

import numpy as np

from busybot.objects.procedural import cad, fixtures, palette
from busybot.objects.procedural.design import (
    HINGE_X,
    SLIDE_X,
    TURN_Z,
    Design,
    Material,
    MovingLink,
    Part,
    shifted,
    switch,
)
from busybot.objects.procedural.fixtures import (
    Ground,
    clutter,
    ground,
    lifted,
    pressed,
    row,
    slid,
    swung,
    trodden,
    turned,
)
from busybot.objects.procedural.grips import head, lying, rod
from busybot.objects.procedural.palette import in_turn, pick


def lid(variant: int, rng: np.random.Generator) -> Design:
    """A lid over a shallow box, with a tab, a knob or a rail to lift it by."""
    length, width = ((0.20, 0.20), (0.14, 0.26), (0.25, 0.13), (0.17, 0.15))[variant % 4]
    wall = pick(rng, (*palette.WOODS, palette.NAVY, palette.GRAPHITE, palette.PEARL))
    color = pick(rng, (*palette.ACCENTS, palette.BIRCH, palette.WHITE), unlike=wall)
    rise = (0.06, 0.045, 0.08, 0.05)[variant % 4]
    outer = cad.rectangle(length + 0.05, width + 0.05, 0.015)
    body = [Part(cad.prism(outer, 0, rise, bevel=0.006), wall)]
    hollow = cad.prism(cad.rectangle(length - 0.03, width - 0.03, 0.01), 0, 0.003).moved(z=rise - 0.002)
    body.append(Part(hollow, pick(rng, (palette.SHADOW, palette.BLUSH, palette.WINE))))
    body.append(Part(lying(0.012, 0.8 * width).moved(-length / 2, 0, rise + 0.012), pick(rng, palette.METALS)))
    cover = _lid_outline(variant, length, width)
    parts = [Part(cad.prism(cover, -0.004, 0.014, bevel=0.005), color)]
    parts += shifted(_lid_grip(variant, width, pick(rng, palette.METALS)), (0.94 * length, 0, 0.012))
    link = lifted(parts, (-length / 2, 0, rise + 0.006), (0.7, 0.9, 0.55, 0.8)[variant % 4])
    return switch(body, [link], HINGE_X, variant + variant // 4)


def _lid_outline(variant: int, length: float, width: float) -> np.ndarray:
    """From the hinge at x = 0 towards +x: straight, round at the end, or narrowing."""
    if variant % 4 == 1:
        angles = np.linspace(-np.pi / 2, np.pi / 2, 17)
        arc = np.stack([0.4 * length + 0.6 * length * np.cos(angles), width / 2 * np.sin(angles)], axis=1)
        return np.concatenate([[[0.0, width / 2], [0.0, -width / 2]], arc])
    narrow = 0.36 * width if variant % 4 == 2 else 0.5 * width
    return np.array([[0, -width / 2], [length, -narrow], [length, narrow], [0, width / 2]])


def _lid_grip(variant: int, width: float, metal: Material) -> list[Part]:
    if variant % 4 == 0:
        return [Part(cad.box(0.045, 0.08, 0.012, 0.004).moved(0.018, 0, -0.010), metal)]
    if variant % 4 == 3:
        return [Part(cad.box(0.018, 0.8 * width, 0.022, 0.005).moved(-0.012), metal)]
    knob = cad.lathe(cad.smooth([(0.010, 0), (0.010, 0.012), (0.024, 0.022), (0.020, 0.036), (0.0, 0.040)], 2), 18)
    return [Part(knob.moved(-0.04), metal)]


def _pedal_link(
    size: tuple[float, float], at: tuple[float, float, float], slope: float, tread: float, material: Material, ribs: int
) -> MovingLink:
    """A plate (length, width) with ribs, its upper face at z = 0 at the hinge; with odd ribs it ends round."""
    length, width = size
    outline = cad.rectangle(length, width, 0.45 * width if ribs % 2 else 0.012, 6)
    parts = [Part(cad.prism(outline, -0.02, 0.0, bevel=0.006, foot=0.003).moved(length / 2), material)]
    for k in range(ribs):
        x = length * (0.95 - 0.5 * (k + 0.5) / ribs)
        parts.append(Part(cad.box(0.014, 0.72 * width, 0.010, 0.003).moved(x, 0, -0.001), palette.BLACK))
    return trodden([part.turned("y", -slope) for part in parts], at, tread)


def pedal(variant: int, rng: np.random.Generator) -> Design:
    """A pedal that rises from its hinge; it is pressed by a little or by much, in all four directions."""
    length, width = ((0.24, 0.13), (0.17, 0.20), (0.28, 0.09), (0.20, 0.11))[variant % 4]
    tread = (0.16, 0.10, 0.14, 0.20)[variant % 4]
    base = ground(length + 0.08, width + 0.08, (0, 3, 2, 1)[variant % 4], rng)
    body = [*base.parts, Part(lying(0.018, width + 0.03).moved(-length / 2, 0, base.top + 0.012), palette.STEEL)]
    spring = cad.lathe([(0.022, 0), (0.022, 0.012), (0.018, 0.014), (0, 0.014)], 18)
    body.append(Part(spring.moved(0.25 * length, 0, base.top - 0.001), palette.SHADOW))
    color = pick(rng, (*palette.ACCENTS, palette.GRAPHITE, palette.STEEL), unlike=base.cover)
    at = (-length / 2, 0.0, base.top + 0.026)
    link = _pedal_link((length, width), at, tread + 0.02, tread, color, (4, 3, 5, 2)[variant % 4])
    return switch(body, [link], HINGE_X, variant + 3)


def pedals(variant: int, rng: np.random.Generator) -> Design:
    """2 or 3 pedals on one board, with gaps between them and a rest behind."""
    count, pitch = ((2, 0.17), (3, 0.12), (3, 0.14))[variant % 3]
    length, width, tread = ((0.20, 0.11, 0.15), (0.16, 0.065, 0.13), (0.25, 0.08, 0.11))[variant % 3]
    base = ground(length + 0.12, pitch * count + 0.06, (0, 1, 2)[variant % 3], rng)
    rest = cad.box(0.06, pitch * count, 0.032, 0.01).moved(-length / 2 - 0.01, 0, base.top - 0.001)
    body, links = [*base.parts, Part(rest, palette.IRON)], []
    for k, y in enumerate(row(count, pitch)):
        at = (-length / 2 + 0.01, y, base.top + 0.026)
        accent = palette.ACCENTS[(2 * k + variant) % len(palette.ACCENTS)]
        color = accent if variant % 2 else pick(rng, (palette.CHROME, palette.ORANGE), unlike=base.cover)
        links.append(_pedal_link((length, width), at, tread + 0.01, tread, color, (2, 3, 1)[variant % 3]))
    return switch(body, links, HINGE_X, (1, 0, 3)[variant % 3])


def arm(variant: int, rng: np.random.Generator) -> Design:
    """An arm that lies flat in a bracket and is lifted at its free end: bar, rod, tapered handle, crank."""
    length = (0.26, 0.21, 0.30, 0.24, 0.18, 0.16, 0.28)[variant % 7]
    base = ground(length + 0.14, (0.16, 0.20, 0.17, 0.19, 0.22)[variant % 5], (1, 0, 2, 3, 4)[variant % 5], rng)
    metal, color = pick(rng, palette.METALS, unlike=base.cover), pick(rng, palette.ACCENTS, unlike=base.cover)
    start, z = -length / 2 - 0.015, base.top + 0.042
    body = [*base.parts, *_bracket(start, z, base, in_turn((palette.IRON, metal), variant))]
    rest = cad.box(0.03, 0.06, 0.7 * (z - base.top), 0.005).moved(start + 0.72 * length, 0, base.top - 0.001)
    body.append(Part(rest, palette.BLACK))
    body += clutter(base, [(start + 0.35 * length, s * 0.06) for s in (-1, 1)], rng)
    link = lifted(_arm_parts(variant, length, metal, color), (start, 0, z), (0.8, 0.95, 0.6, 0.75, 1.05)[variant % 5])
    return switch(body, [link], HINGE_X, variant + variant // 4)


def _bracket(x: float, z: float, base: Ground, metal: Material) -> list[Part]:
    """Two cheeks with a pin."""
    cheeks = [cad.box(0.05, 0.012, z - base.top + 0.02, 0.004).moved(x, y, base.top - 0.001) for y in (-0.034, 0.034)]
    return [*(Part(cheek, metal) for cheek in cheeks), Part(lying(0.009, 0.09).moved(x, 0, z), palette.CHROME)]


def _arm_parts(variant: int, length: float, metal: Material, color: Material) -> list[Part]:
    """The arm along +x from its hinge at the origin."""
    if variant % 5 == 0:  # a flat bar with a crosswise grip
        bar = cad.box(length, 0.034, 0.014, 0.004).moved(length / 2, 0, -0.007)
        return [Part(bar, metal), Part(lying(0.022, 0.14).moved(length, 0, 0.004), color)]
    if variant % 5 == 1:  # a rod with a ball
        return [Part(rod((0, 0, 0), (length, 0, 0), 0.014), metal), Part(cad.ball(0.042, 22, 12).moved(length), color)]
    if variant % 5 == 2:  # a tapered handle
        profile = [(0.012, 0), (0.018, 0.2), (0.032, 0.62), (0.034, 0.85), (0.02, 0.98), (0.0, 1.0)]
        handle = cad.lathe(cad.smooth([(r, length * x) for r, x in profile], 3), 20).turned("y", np.pi / 2)
        return [Part(handle, color), Part(lying(0.02, 0.05), metal)]
    if variant % 5 == 3:  # a rod that ends in an upright peg
        peg = shifted(head("egg", 0.03, color), (length, 0, 0.012))
        return [Part(cad.box(length + 0.03, 0.04, 0.018, 0.006).moved(length / 2, 0, -0.009), metal), *peg]
    # a paddle on a short stem
    blade = cad.prism(cad.rectangle(0.62 * length, 0.12, 0.05, 6), -0.010, 0.012, bevel=0.006, foot=0.004)
    return [Part(rod((0, 0, 0), (0.5 * length, 0, 0), 0.013), metal), Part(blade.moved(0.69 * length), color)]


def bail(variant: int, rng: np.random.Generator) -> Design:
    """A D-shaped handle that lies on its plate and stands up, held at both feet."""
    reach, width = ((0.12, 0.17), (0.09, 0.24), (0.16, 0.13))[variant % 3]
    base = ground(reach + 0.17, width + 0.10, (0, 2, 4)[variant % 3], rng)
    metal = pick(rng, (*palette.METALS, palette.IRON), unlike=base.cover)
    start, z, wire = -reach / 2 - 0.01, base.top + 0.026, (0.014, 0.011, 0.017)[variant % 3]
    body = list(base.parts)
    for side in (-1, 1):
        foot = cad.box(0.05, 0.034, z - base.top + wire + 0.006, 0.008)
        foot = foot.moved(start, side * (width / 2 + 0.008), base.top - 0.001)
        body.append(Part(foot, pick(rng, (metal, palette.BLACK))))
        body += fixtures.screw(start - 0.032, side * (width / 2 - 0.03), base.top - 0.001, float(rng.uniform(0, 3)))
    path = [(0, -width / 2, 0), (reach, -width / 2, 0), (reach, width / 2, 0), (0, width / 2, 0)]
    parts = [Part(cad.pipe(cad.bent(path, (0.06, 0.03, 0.065)[variant % 3], 5), wire, 12), metal)]
    if variant % 3 != 1:
        sleeve = lying(1.7 * wire, 0.45 * width, 16).moved(reach)
        parts.append(Part(sleeve, pick(rng, palette.ACCENTS, unlike=base.cover)))
    link = lifted(parts, (start, 0, z), (1.1, 0.9, 1.2)[variant % 3])
    return switch(body, [link], HINGE_X, variant + variant // 3)


def hood(variant: int, rng: np.random.Generator) -> Design:
    """A curved cover over a dummy button that does not move: only the cover does."""
    base = ground(0.28, 0.22, (1, 0)[variant % 2], rng)
    color = pick(rng, (palette.RED, palette.MUSTARD, palette.SKY), unlike=base.cover)
    dummy = cad.prism(cad.rectangle(0.06, 0.06, 0.012), 0, 0.03, bevel=0.008).moved(0.02, 0, base.top - 0.001)
    body = [*base.parts, Part(dummy, palette.BLACK)]
    body.append(Part(lying(0.014, 0.15).moved(-0.09, 0, base.top + 0.014), palette.STEEL))
    angles = np.linspace(0.35, np.pi - 0.6, 14)
    spine = np.stack([0.09 - 0.09 * np.cos(angles), np.zeros(14), 0.08 * np.sin(angles) - 0.02], axis=1)
    shell = cad.sweep(spine, np.array([(-0.065, -0.005), (0.065, -0.005), (0.065, 0.005), (-0.065, 0.005)]))
    tab = Part(cad.box(0.035, 0.05, 0.012, 0.004).moved(0.18, 0, 0.022), palette.BLACK)
    link = lifted([Part(shell, color), tab], (-0.09, 0, base.top + 0.012), 0.75)
    return switch(body, [link], HINGE_X, 2 * variant + 1)


def seesaw(variant: int, rng: np.random.Generator) -> Design:
    """A playground's plank over a trestle, with a seat and a handle at both ends."""
    grass = in_turn((palette.SAGE, palette.SKY), variant)
    plank, seat = pick(rng, palette.WOODS), in_turn((palette.RED, palette.MUSTARD), variant)
    reach = (0.20, 0.17)[variant % 2]
    body = [Part(cad.prism(cad.rectangle(2 * reach + 0.10, 0.20, 0.08, 6), 0, 0.028, bevel=0.010), grass)]
    for y in (-0.05, 0.05):
        leg = np.array([(-0.045, 0.0), (0.045, 0.0), (0.0, 0.085)])
        body.append(Part(cad.prism(leg, -0.006, 0.006).turned("x", np.pi / 2).moved(0, y, 0.026), palette.NAVY))
    board = cad.box(2 * reach, 0.06, 0.018, 0.006).moved(z=-0.004)
    parts = [Part(board, plank), Part(lying(0.010, 0.12), palette.STEEL)]
    for side in (-1, 1):
        pad = cad.prism(cad.rectangle(0.07, 0.08, 0.03), 0.010, 0.024, bevel=0.006)
        parts.append(Part(pad.moved(side * (reach - 0.045)), seat))
        x = side * (reach - 0.105)
        hoop = [(x, -0.025, 0.01), (x, -0.025, 0.05), (x, 0.025, 0.05), (x, 0.025, 0.01)]
        parts.append(Part(cad.pipe(np.array(hoop), 0.006, 8), palette.CHROME))
    return switch(body, [swung(parts, (0, 0, 0.105), 0.26, label="plank")], HINGE_X, variant)


def clam(variant: int, rng: np.random.Generator) -> Design:
    """A shell whose ribbed upper half opens, with a pearl inside."""
    shell = in_turn((palette.BLUSH, palette.PLUM), variant)
    angles = np.linspace(-1.15, 1.15, 33)
    ribs = np.cos(angles * 10 * np.pi / 1.15)
    fan = 0.27 * np.stack([np.cos(angles), np.sin(angles)], axis=1) * (1.0 + 0.03 * ribs)[:, None]
    outline = np.concatenate([[[0.0, 0.045], [0.0, -0.045]], fan])
    low = cad.prism(cad.rectangle(0.38, 0.42, 0.10, 6), 0, 0.025, bevel=0.010)
    rows = ((0.8 * outline, 0.02), (outline, 0.055), (cad.inset(outline, 0.012), 0.058))
    lower = cad.loft([cad.ring(level, z) for level, z in rows])
    body = [Part(low, palette.BIRCH), Part(lower.moved(-0.135), shell)]
    body.append(Part(cad.ball(0.035, 18, 10).moved(0.03, 0, 0.075), palette.PEARL))
    relief = np.concatenate([[0.0, 0.0], ribs])
    rings = []
    for share, z in ((1.0, 0.0), (0.99, 0.012), (0.88, 0.040), (0.66, 0.062), (0.42, 0.064), (0.22, 0.05)):
        level = cad.ring(share * outline, z)
        level[:, 2] += 0.10 * z * relief
        rings.append(level)
    upper = cad.loft(rings, (None, np.array([0.03, 0.0, 0.045])))
    link = lifted([Part(upper, pick(rng, (shell, palette.CORAL)))], (-0.135, 0, 0.060), 0.7)
    return switch(body, [link], HINGE_X, 3)


def crank(variant: int, rng: np.random.Generator) -> Design:
    """A round table with an upright handle near its rim, turned like a coffee mill's."""
    wood = in_turn((palette.WALNUT, palette.BIRCH), variant)
    metal = in_turn((palette.BRASS, palette.STEEL), variant)
    body = [Part(cad.prism(cad.circle(0.18, 8, np.pi / 8), 0, 0.07, bevel=0.012), wood)]
    body.append(Part(cad.lathe([(0.13, 0.068), (0.125, 0.078), (0, 0.078)], 36), palette.BLACK))
    plate = cad.prism(cad.circle(0.115, 36), 0, 0.016, bevel=0.006)
    hole = cad.prism(cad.circle(0.018, 18), 0.014, 0.0168)
    holes = [hole.moved(0.07 * np.cos(angle), 0.07 * np.sin(angle)) for angle in (1.57, 3.14, 4.71)]
    profile = [(0.012, 0.0), (0.014, 0.03), (0.026, 0.06), (0.028, 0.09), (0.016, 0.108), (0, 0.11)]
    post = cad.lathe(cad.smooth(profile, 2), 20)
    parts = [Part(plate, metal), *(Part(hole, palette.SHADOW) for hole in holes)]
    parts.append(Part(post.moved(0.082, 0, 0.014), pick(rng, (palette.RED, palette.NAVY, palette.FOREST))))
    return switch(body, [turned(parts, (0, 0, 0.080), 0.7)], TURN_Z, variant)


def honeycomb(variant: int, rng: np.random.Generator) -> Design:
    """Three hexagonal cells of honey that go down, among closed ones that do not."""
    wax = in_turn((palette.MUSTARD, palette.OAK), variant)
    body = [Part(cad.prism(cad.circle(0.215, 6), 0, 0.034, bevel=0.012), wax)]
    links = []
    for k in range(7):
        angle = k * np.pi / 3 + np.pi / 6
        x, y = (0.118 * float(np.cos(angle)), 0.118 * float(np.sin(angle))) if k < 6 else (0.0, 0.0)
        if k % 2 == 0 and k < 6:
            wall = cad.frame(cad.circle(0.068, 6), cad.circle(0.060, 6), 0, 0.014, 0.003).moved(x, y, 0.033)
            floor = cad.prism(cad.circle(0.060, 6), 0, 0.002).moved(x, y, 0.033)
            body += [Part(wall, wax), Part(floor, palette.SHADOW)]
            top = cad.prism(cad.circle(0.055, 6), -0.02, 0.0, bevel=0.012, steps=3)
            links.append(pressed([Part(top, palette.ORANGE)], (x, y, 0.070), 0.018))
        else:
            body.append(Part(cad.prism(cad.circle(0.056, 6), 0, 0.008, bevel=0.004).moved(x, y, 0.033), palette.BIRCH))
    bee = Part(cad.ball(0.014, 12, 6).stretched(x=1.6).moved(0, 0, 0.05), pick(rng, (palette.BLACK, palette.IRON)))
    body += [bee, Part(cad.torus(0.0125, 0.003, 12, 5).turned("y", 1.57).moved(z=0.05), palette.MUSTARD)]
    return switch(body, links, HINGE_X)


def boat(variant: int, rng: np.random.Generator) -> Design:
    """A little ship in a basin, between two jetties."""
    outer = cad.rectangle(0.48, 0.24, 0.05, 5)
    body = [Part(cad.frame(outer, cad.inset(outer, 0.022), 0, 0.048, 0.008), pick(rng, palette.WOODS))]
    body.append(Part(cad.prism(cad.inset(outer, 0.012), 0, 0.026), palette.SKY))
    for x in (-0.19, 0.19):
        body.append(Part(cad.box(0.05, 0.07, 0.036, 0.005).moved(x, 0.075, 0.0), palette.BIRCH))
    side = np.array([(0.06, 0.036), (-0.02, 0.045), (-0.085, 0.038)])
    hull = np.concatenate([[(0.10, 0.0)], side, side[::-1] * [1, -1]])
    rings = [cad.ring(share * hull, z) for share, z in ((0.8, 0.0), (1.0, 0.035), (0.92, 0.038), (0.85, 0.028))]
    parts = [Part(cad.loft(rings), in_turn((palette.RED, palette.NAVY), variant))]
    parts.append(Part(cad.box(0.07, 0.05, 0.045, 0.006).moved(-0.03, 0, 0.026), palette.WHITE))
    funnel = cad.lathe([(0.018, 0.06), (0.016, 0.105), (0.0, 0.105)], 16)
    band = cad.torus(0.017, 0.004, 16, 6).moved(-0.03, 0, 0.092)
    parts += [Part(funnel.moved(-0.03), palette.MUSTARD), Part(band, palette.BLACK)]
    return switch(body, [slid(parts, (0, -0.02, 0.027), 0.19, "large")], SLIDE_X, variant)
