"""Track toys: a piece that moves along a curve to one of three places.

Two sliding joints, across and along, set the piece on its track; the connector between them shows nothing.
"""

from collections.abc import Callable

import numpy as np

from busybot.objects.procedural import cad, palette
from busybot.objects.procedural.design import TOY_SCALE, Design, Material, MovingLink, Part, shifted
from busybot.objects.procedural.palette import pick

LENGTH, WIDTH, THICKNESS = 0.84, 0.36, 0.035
REACH = 0.235
"""The piece goes to x = 0, -REACH and +REACH."""
Curve = Callable[[np.ndarray], np.ndarray]


def _toy(piece: list[Part], curve: Curve, board: list[Part], groove: Material, rails: bool) -> Design:
    """A piece (designed at the origin, standing on z = 0) on a curve y(x) over a board."""
    xs = np.linspace(-0.31, 0.31, 49)
    path = np.stack([xs, curve(xs), np.full_like(xs, THICKNESS - 0.001)], axis=1)
    flat = np.array([(-0.022, 0.0), (0.022, 0.0), (0.022, 0.004), (-0.022, 0.004)])
    body = [*board, Part(cad.sweep(path, flat), groove)]
    body += [Part(cad.prism(cad.circle(0.022, 20), 0, 0.004).moved(*path[end].tolist()), groove) for end in (0, -1)]
    if rails:
        for offset in (-0.026, 0.026):
            slope = np.gradient(curve(xs), xs)
            normal = np.stack([-slope, np.ones_like(slope)], axis=1) / np.hypot(slope, 1)[:, None]
            edge = path + offset * np.concatenate([normal, np.zeros((len(xs), 1))], axis=1) + [0, 0, 0.006]
            body.append(Part(cad.pipe(edge, 0.005, 8), palette.BRASS))
    start = float(curve(np.zeros(1))[0])
    across = MovingLink((), "prismatic", (0, 0, 0), (0, 1, 0), -0.2, 0.2, None, "connector")
    placed = shifted(piece, (0, start, THICKNESS + 0.003))
    along = MovingLink(placed, "prismatic", (0, 0, 0), (1, 0, 0), -0.32, 0.32, None, "piece", parent=0)
    steps = tuple((round(float(curve(np.array([x]))[0]) - start, 6), x) for x in (0.0, -REACH, REACH))
    return Design("Toy", TOY_SCALE, body, [across, along], steps=steps)


def _board(material: Material, rim: Material) -> list[Part]:
    base = cad.prism(cad.rectangle(LENGTH, WIDTH, 0.04), 0, THICKNESS - 0.006, bevel=0.008, steps=3)
    top = cad.prism(cad.rectangle(LENGTH - 0.04, WIDTH - 0.04, 0.025), 0.01, THICKNESS, bevel=0.004)
    return [Part(base, rim), Part(top, material)]


def bead(_variant: int, rng: np.random.Generator) -> Design:
    """A big wooden bead on a wavy groove."""
    profile = cad.smooth([(0.060, 0.0), (0.090, 0.03), (0.096, 0.06), (0.080, 0.095), (0.040, 0.112), (0.0, 0.115)], 3)
    color = pick(rng, (palette.TEAL, palette.CORAL, palette.NAVY))
    piece = [Part(cad.lathe(profile, 32), color), Part(cad.torus(0.095, 0.009, 32, 8).moved(z=0.055), palette.WHITE)]
    piece.append(Part(cad.lathe([(0.034, 0.11), (0.030, 0.119), (0.0, 0.121)], 24), palette.BRASS))
    board = _board(palette.BIRCH, palette.OAK)
    return _toy(piece, lambda x: -0.06 * np.cos(3 * np.pi * x / 0.5), board, palette.WALNUT, rails=False)


def loco(_variant: int, rng: np.random.Generator) -> Design:
    """A locomotive on rails between hills."""
    paint, roof = pick(rng, (palette.RED, palette.TEAL, palette.NAVY)), pick(rng, (palette.MUSTARD, palette.ORANGE))
    piece = [Part(cad.box(0.25, 0.13, 0.03, 0.008).moved(z=0.022), palette.GRAPHITE)]
    cabin = cad.box(0.10, 0.12, 0.10, 0.008)
    boiler = cad.lathe([(0.046, -0.075), (0.052, -0.065), (0.052, 0.065), (0.046, 0.075)], 24).turned("y", np.pi / 2)
    piece += [Part(solid, paint) for solid in (boiler.moved(0.04, 0, 0.092), cabin.moved(-0.07, 0, 0.05))]
    piece.append(Part(cad.prism(cad.rectangle(0.125, 0.145, 0.02), 0.148, 0.164, bevel=0.008).moved(-0.07), roof))
    chimney = cad.lathe([(0.018, 0.13), (0.018, 0.165), (0.028, 0.185), (0.022, 0.187)], 18)
    piece.append(Part(chimney.moved(0.085), palette.IRON))
    band = cad.torus(0.053, 0.004, 20, 5).turned("y", np.pi / 2)
    piece += [Part(band.moved(x, 0, 0.092), palette.BRASS) for x in (0.0, 0.07)]
    wheel = cad.lathe([(0.034, -0.075), (0.034, 0.075)], 20).turned("x", np.pi / 2)
    piece += [Part(wheel.moved(x, 0, 0.034), roof) for x in (-0.085, 0.0, 0.085)]
    piece.append(Part(cad.ball(0.016, 12, 8).moved(0.125, 0, 0.092), palette.MUSTARD))
    board = _board(palette.SAGE, palette.OAK)
    for x, y, r in ((-0.30, 0.115, 0.035), (-0.24, 0.13, 0.022), (0.30, -0.12, 0.035), (0.24, -0.135, 0.022)):
        board.append(Part(cad.ball(r, 12, 6).stretched(z=0.8).moved(x, y, THICKNESS), palette.FOREST))
    return _toy(piece, lambda x: 0.02 * np.sin(2 * np.pi * x / 0.62), board, palette.STONE, rails=True)


def ladybird(_variant: int, rng: np.random.Generator) -> Design:
    """Novel: a ladybird on an arc between flowers."""
    shell = pick(rng, (palette.RED, palette.ORANGE))
    piece = [Part(cad.ball(0.098, 30, 14).stretched(y=0.86, z=0.72).moved(z=0.03), shell)]
    piece.append(Part(cad.ball(0.048, 20, 10).stretched(z=0.8).moved(0.098, 0, 0.035), palette.BLACK))
    angles = np.linspace(0.1, np.pi - 0.5, 14)
    seam = np.stack([-0.099 * np.cos(angles), np.zeros(14), 0.03 + 0.0712 * np.sin(angles)], axis=1)
    piece.append(Part(cad.pipe(seam, 0.004, 6), palette.BLACK))
    for x, y in ((0.03, 0.042), (0.03, -0.042), (-0.04, 0.045), (-0.04, -0.045)):
        z = 0.03 + 0.0706 * float(np.sqrt(1 - (x / 0.098) ** 2 - (y / 0.0843) ** 2))
        piece.append(Part(cad.ball(0.020, 14, 8).stretched(z=0.35).moved(x, y, z - 0.002), palette.BLACK))
    for y in (-0.022, 0.022):
        piece.append(Part(cad.ball(0.011, 10, 6).moved(0.125, y, 0.06), palette.WHITE))
        feeler = [(0.12, 0.5 * y, 0.06), (0.15, y, 0.09), (0.165, 1.8 * y, 0.10)]
        tip = cad.ball(0.008, 8, 6).moved(*feeler[-1])
        piece += [Part(cad.pipe(feeler, 0.004, 6), palette.BLACK), Part(tip, palette.BLACK)]
    board = _board(palette.MINT, palette.FOREST)
    for x, y, color in ((-0.34, -0.125, palette.BLUSH), (0.0, -0.11, palette.MUSTARD), (0.34, -0.125, palette.SKY)):
        petals = cad.prism(cad.wavy(0.030, 0.009, 6, 6), 0, 0.008, bevel=0.003).moved(x, y, THICKNESS - 0.001)
        heart = cad.lathe([(0.012, 0), (0.010, 0.012), (0, 0.013)], 14).moved(x, y, THICKNESS - 0.001)
        board += [Part(petals, color), Part(heart, palette.WHITE)]
    return _toy(piece, lambda x: 0.075 - 1.6 * x**2, board, palette.FOREST, rails=False)


def grown(parts: list[Part], factor: float) -> list[Part]:
    """The parts larger by a factor in all directions."""
    return [Part(part.solid.stretched(factor, factor, factor), part.material) for part in parts]


def car(_variant: int, rng: np.random.Generator) -> Design:
    """A little car on a winding road."""
    paint = pick(rng, (palette.MUSTARD, palette.CORAL, palette.RED))
    piece = [Part(cad.box(0.21, 0.11, 0.045, 0.016).moved(z=0.02), paint)]
    rows = ((0.13, 0.10, 0.06), (0.09, 0.085, 0.105), (0.07, 0.07, 0.11))
    cabin = cad.loft([cad.ring(cad.rectangle(length, width, 0.02), z) for length, width, z in rows])
    piece.append(Part(cabin.moved(-0.015), palette.GLASS))
    piece.append(Part(cad.prism(cad.rectangle(0.08, 0.075, 0.02), 0.104, 0.114, bevel=0.004).moved(-0.015), paint))
    wheel = cad.lathe([(0.026, -0.062), (0.030, -0.056), (0.030, 0.056), (0.026, 0.062)], 18).turned("x", np.pi / 2)
    piece += [Part(wheel.moved(x, 0, 0.03), palette.BLACK) for x in (-0.065, 0.065)]
    piece += [Part(cad.ball(0.012, 10, 6).moved(0.104, y, 0.045), palette.IVORY) for y in (-0.035, 0.035)]
    piece = grown(piece, 1.3)
    board = _board(palette.MINT, palette.BIRCH)
    for x, y in ((-0.33, -0.12), (0.05, 0.13), (0.34, 0.11)):
        trunk = cad.lathe([(0.008, 0), (0.008, 0.03), (0, 0.03)], 8).moved(x, y, THICKNESS)
        crown = cad.lathe([(0.034, 0.02), (0.0, 0.085)], 14).moved(x, y, THICKNESS)
        board += [Part(trunk, palette.WALNUT), Part(crown, palette.FOREST)]
    return _toy(piece, lambda x: 0.055 * np.sin(2 * np.pi * x / 0.5), board, palette.GRAPHITE, rails=False)


def duck(_variant: int, _rng: np.random.Generator) -> Design:
    """A duck on a pond."""
    piece = [Part(cad.ball(0.092, 26, 12).stretched(y=0.74, z=0.55).moved(z=0.035), palette.MUSTARD)]
    piece.append(Part(cad.ball(0.046, 20, 10).moved(0.06, 0, 0.098), palette.MUSTARD))
    bill = cad.lathe([(0.022, 0.0), (0.016, 0.022), (0.0, 0.032)], 14).stretched(x=0.5).turned("y", np.pi / 2)
    piece.append(Part(bill.moved(0.098, 0, 0.092), palette.ORANGE))
    piece += [Part(cad.ball(0.008, 10, 6).moved(0.092, y, 0.115), palette.BLACK) for y in (-0.024, 0.024)]
    tail = cad.lathe([(0.030, 0.0), (0.0, 0.05)], 12).turned("y", -1.0).moved(-0.07, 0, 0.05)
    piece.append(Part(tail, palette.MUSTARD))
    piece = grown(piece, 1.35)
    board = _board(palette.SKY, palette.OAK)
    for x, y, r in ((-0.33, 0.12, 0.030), (0.30, -0.13, 0.034), (0.36, 0.10, 0.022)):
        pad = cad.prism(cad.wavy(r, 0.1 * r, 1, 24), 0, 0.005, bevel=0.002).moved(x, y, THICKNESS - 0.001)
        board.append(Part(pad, palette.FOREST))
        board.append(Part(cad.ball(0.010, 10, 6).moved(x, y, THICKNESS + 0.008), palette.BLUSH))
    return _toy(piece, lambda x: -0.05 + 0.9 * x**2, board, palette.WHITE, rails=False)


def rocket(_variant: int, rng: np.random.Generator) -> Design:
    """Novel: a rocket between stars."""
    paint = pick(rng, (palette.RED, palette.ORANGE))
    rows = [(0.030, -0.11), (0.050, -0.08), (0.056, 0.0), (0.045, 0.07), (0.022, 0.12), (0.0, 0.14)]
    piece = [Part(cad.lathe(cad.smooth(rows, 3), 24).turned("y", np.pi / 2).moved(z=0.062), palette.PEARL)]
    nose = cad.lathe(cad.smooth([(0.0462, 0.068), (0.024, 0.12), (0.0, 0.143)], 3), 24).turned("y", np.pi / 2)
    piece.append(Part(nose.moved(z=0.062), paint))
    fin = np.array([(-0.125, 0.0), (-0.03, 0.0), (-0.06, 0.045), (-0.12, 0.062)])
    for turn in (0.0, np.pi):
        piece.append(Part(cad.prism(fin + [0, 0.045], -0.006, 0.006).turned("x", turn).moved(z=0.062), paint))
    window = cad.lathe([(0.024, 0), (0.022, 0.008), (0, 0.009)], 18).moved(0.02, 0, 0.112)
    piece += [Part(window, palette.GLASS), Part(cad.torus(0.025, 0.006, 18, 6).moved(0.02, 0, 0.114), palette.NAVY)]
    board = _board(palette.NAVY, palette.STEEL)
    spark = cad.prism(cad.wavy(0.018, 0.007, 5, 4), 0, 0.006, bevel=0.002)
    places = ((-0.33, -0.12), (-0.12, 0.13), (0.16, -0.13), (0.35, 0.12))
    board += [Part(spark.moved(x, y, THICKNESS - 0.001), palette.MUSTARD) for x, y in places]
    return _toy(piece, lambda x: 0.30 * x, board, palette.SKY, rails=False)
