"""Training switches that are hinged at one end: lids, pedals, arms that lie flat, handles like those of drawers."""

import numpy as np

from busybot.objects.procedural import fixtures, palette
from busybot.objects.procedural.design import HINGE_X, Design, Material, MovingLink, Part, shifted, switch
from busybot.objects.procedural.fixtures import Ground, clutter, ground, lifted, row, trodden
from busybot.objects.procedural.grips import head, lying, rod
from busybot.objects.procedural.palette import in_turn, pick
from busybot.objects.procedural.solids import ball, bent, box, lathe, pipe, prism, rectangle, smooth, sweep


def lid(variant: int, rng: np.random.Generator) -> Design:
    """A lid over a shallow box, with a tab, a knob or a rail to lift it by."""
    length, width = ((0.20, 0.20), (0.14, 0.26), (0.25, 0.13), (0.17, 0.15))[variant % 4]
    wall = pick(rng, (*palette.WOODS, palette.NAVY, palette.GRAPHITE, palette.PEARL))
    color = pick(rng, (*palette.ACCENTS, palette.BIRCH, palette.WHITE), unlike=wall)
    rise = (0.06, 0.045, 0.08, 0.05)[variant % 4]
    outer = rectangle(length + 0.05, width + 0.05, 0.015)
    body = [Part(prism(outer, 0, rise, bevel=0.006), wall)]
    hollow = prism(rectangle(length - 0.03, width - 0.03, 0.01), 0, 0.003).moved(z=rise - 0.002)
    body.append(Part(hollow, pick(rng, (palette.SHADOW, palette.BLUSH, palette.WINE))))
    body.append(Part(lying(0.012, 0.8 * width).moved(-length / 2, 0, rise + 0.012), pick(rng, palette.METALS)))
    cover = _lid_outline(variant, length, width)
    parts = [Part(prism(cover, -0.004, 0.014, bevel=0.005), color)]
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
        return [Part(box(0.045, 0.08, 0.012, 0.004).moved(0.018, 0, -0.010), metal)]
    if variant % 4 == 3:
        return [Part(box(0.018, 0.8 * width, 0.022, 0.005).moved(-0.012), metal)]
    knob = lathe(smooth([(0.010, 0), (0.010, 0.012), (0.024, 0.022), (0.020, 0.036), (0.0, 0.040)], 2), 18)
    return [Part(knob.moved(-0.04), metal)]


def _pedal_link(
    size: tuple[float, float], at: tuple[float, float, float], slope: float, tread: float, material: Material, ribs: int
) -> MovingLink:
    """A plate (length, width) with ribs, its upper face at z = 0 at the hinge; with odd ribs it ends round."""
    length, width = size
    outline = rectangle(length, width, 0.45 * width if ribs % 2 else 0.012, 6)
    parts = [Part(prism(outline, -0.02, 0.0, bevel=0.006, foot=0.003).moved(length / 2), material)]
    for k in range(ribs):
        x = length * (0.95 - 0.5 * (k + 0.5) / ribs)
        parts.append(Part(box(0.014, 0.72 * width, 0.010, 0.003).moved(x, 0, -0.001), palette.BLACK))
    return trodden([part.turned("y", -slope) for part in parts], at, tread)


def pedal(variant: int, rng: np.random.Generator) -> Design:
    """A pedal that rises from its hinge; it is pressed by a little or by much, in all four directions."""
    length, width = ((0.24, 0.13), (0.17, 0.20), (0.28, 0.09), (0.20, 0.11))[variant % 4]
    tread = (0.16, 0.10, 0.14, 0.20)[variant % 4]
    base = ground(length + 0.08, width + 0.08, (0, 3, 2, 1)[variant % 4], rng)
    body = [*base.parts, Part(lying(0.018, width + 0.03).moved(-length / 2, 0, base.top + 0.012), palette.STEEL)]
    spring = lathe([(0.022, 0), (0.022, 0.012), (0.018, 0.014), (0, 0.014)], 18)
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
    rest = box(0.06, pitch * count, 0.032, 0.01).moved(-length / 2 - 0.01, 0, base.top - 0.001)
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
    rest = box(0.03, 0.06, 0.7 * (z - base.top), 0.005).moved(start + 0.72 * length, 0, base.top - 0.001)
    body.append(Part(rest, palette.BLACK))
    body += clutter(base, [(start + 0.35 * length, s * 0.06) for s in (-1, 1)], rng)
    link = lifted(_arm_parts(variant, length, metal, color), (start, 0, z), (0.8, 0.95, 0.6, 0.75, 1.05)[variant % 5])
    return switch(body, [link], HINGE_X, variant + variant // 4)


def _bracket(x: float, z: float, base: Ground, metal: Material) -> list[Part]:
    """Two cheeks with a pin."""
    cheeks = [box(0.05, 0.012, z - base.top + 0.02, 0.004).moved(x, y, base.top - 0.001) for y in (-0.034, 0.034)]
    return [*(Part(cheek, metal) for cheek in cheeks), Part(lying(0.009, 0.09).moved(x, 0, z), palette.CHROME)]


def _arm_parts(variant: int, length: float, metal: Material, color: Material) -> list[Part]:
    """The arm along +x from its hinge at the origin."""
    if variant % 5 == 0:  # a flat bar with a crosswise grip
        bar = box(length, 0.034, 0.014, 0.004).moved(length / 2, 0, -0.007)
        return [Part(bar, metal), Part(lying(0.022, 0.14).moved(length, 0, 0.004), color)]
    if variant % 5 == 1:  # a rod with a ball
        return [Part(rod((0, 0, 0), (length, 0, 0), 0.014), metal), Part(ball(0.042, 22, 12).moved(length), color)]
    if variant % 5 == 2:  # a tapered handle
        profile = [(0.012, 0), (0.018, 0.2), (0.032, 0.62), (0.034, 0.85), (0.02, 0.98), (0.0, 1.0)]
        handle = lathe(smooth([(r, length * x) for r, x in profile], 3), 20).turned("y", np.pi / 2)
        return [Part(handle, color), Part(lying(0.02, 0.05), metal)]
    if variant % 5 == 3:  # a rod that ends in an upright peg
        peg = shifted(head("egg", 0.03, color), (length, 0, 0.012))
        return [Part(box(length + 0.03, 0.04, 0.018, 0.006).moved(length / 2, 0, -0.009), metal), *peg]
    # a paddle on a short stem
    blade = prism(rectangle(0.62 * length, 0.12, 0.05, 6), -0.010, 0.012, bevel=0.006, foot=0.004).moved(0.69 * length)
    return [Part(rod((0, 0, 0), (0.5 * length, 0, 0), 0.013), metal), Part(blade, color)]


def bail(variant: int, rng: np.random.Generator) -> Design:
    """A D-shaped handle that lies on its plate and stands up, held at both feet."""
    reach, width = ((0.12, 0.17), (0.09, 0.24), (0.16, 0.13))[variant % 3]
    base = ground(reach + 0.17, width + 0.10, (0, 2, 4)[variant % 3], rng)
    metal = pick(rng, (*palette.METALS, palette.IRON), unlike=base.cover)
    start, z, wire = -reach / 2 - 0.01, base.top + 0.026, (0.014, 0.011, 0.017)[variant % 3]
    body = list(base.parts)
    for side in (-1, 1):
        foot = box(0.05, 0.034, z - base.top + wire + 0.006, 0.008)
        foot = foot.moved(start, side * (width / 2 + 0.008), base.top - 0.001)
        body.append(Part(foot, pick(rng, (metal, palette.BLACK))))
        body += fixtures.screw(start - 0.032, side * (width / 2 - 0.03), base.top - 0.001, float(rng.uniform(0, 3)))
    path = [(0, -width / 2, 0), (reach, -width / 2, 0), (reach, width / 2, 0), (0, width / 2, 0)]
    parts = [Part(pipe(bent(path, (0.06, 0.03, 0.065)[variant % 3], 5), wire, 12), metal)]
    if variant % 3 != 1:
        sleeve = lying(1.7 * wire, 0.45 * width, 16).moved(reach)
        parts.append(Part(sleeve, pick(rng, palette.ACCENTS, unlike=base.cover)))
    link = lifted(parts, (start, 0, z), (1.1, 0.9, 1.2)[variant % 3])
    return switch(body, [link], HINGE_X, variant + variant // 3)


def hood(variant: int, rng: np.random.Generator) -> Design:
    """A curved cover over a dummy button that does not move: only the cover does."""
    base = ground(0.28, 0.22, (1, 0)[variant % 2], rng)
    color = pick(rng, (palette.RED, palette.MUSTARD, palette.SKY), unlike=base.cover)
    dummy = prism(rectangle(0.06, 0.06, 0.012), 0, 0.03, bevel=0.008).moved(0.02, 0, base.top - 0.001)
    body = [*base.parts, Part(dummy, palette.BLACK)]
    body.append(Part(lying(0.014, 0.15).moved(-0.09, 0, base.top + 0.014), palette.STEEL))
    angles = np.linspace(0.35, np.pi - 0.6, 14)
    spine = np.stack([0.09 - 0.09 * np.cos(angles), np.zeros(14), 0.08 * np.sin(angles) - 0.02], axis=1)
    shell = sweep(spine, np.array([(-0.065, -0.005), (0.065, -0.005), (0.065, 0.005), (-0.065, 0.005)]))
    tab = Part(box(0.035, 0.05, 0.012, 0.004).moved(0.18, 0, 0.022), palette.BLACK)
    return switch(
        body, [lifted([Part(shell, color), tab], (-0.09, 0, base.top + 0.012), 0.75)], HINGE_X, 2 * variant + 1
    )
