"""More doors: carved and grooved leaves, a safe, a barred gate, round lights, a refrigerator; novel: paper, saloon.

Handles, wheels, knobs and rivets on them stand still: they are there to be told from switches.
"""

import numpy as np

from busybot.objects.procedural import palette
from busybot.objects.procedural.design import Design, Material, Part, shifted
from busybot.objects.procedural.doors import (
    LEAF_BOTTOM,
    LEAF_LENGTH,
    LEAF_TOP,
    LEAF_WIDTH,
    door,
    knob,
    lever_handle,
    slab,
    stud,
)
from busybot.objects.procedural.grips import lying, rod
from busybot.objects.procedural.palette import in_turn, pick
from busybot.objects.procedural.solids import (
    box,
    circle,
    frame,
    inset,
    lathe,
    prism,
    rectangle,
    star,
    torus,
)

TOP = LEAF_TOP - 0.001


def carved(variant: int, rng: np.random.Generator) -> Design:
    """Diamonds, discs or flowers in relief."""
    wood = in_turn((palette.TEAL, palette.CHERRY, palette.PLUM), variant)
    relief = pick(rng, (palette.BIRCH, palette.MUSTARD, palette.BLUSH, palette.MINT), unlike=wood)
    motif = (circle(0.062, 4), circle(0.055, 32), star(0.055, 0.014, 6, 6))[variant % 3]
    leaf = [slab(wood)]
    for x in (-0.22, -0.07, 0.08, 0.23):
        for y in (-0.072, 0.072):
            if y > 0 and abs(x + 0.07) < 0.01:
                continue
            leaf.append(Part(prism(motif, 0, 0.012, bevel=0.005).moved(x, y, TOP), relief))
            leaf.append(Part(stud(0.016, 0.008).moved(x, y, TOP + 0.011), wood))
    return door([*leaf, *knob(palette.BRASS, -0.07)], pick(rng, (palette.WALNUT, palette.IVORY)), rng)


def safe(variant: int, rng: np.random.Generator) -> Design:
    """A strongroom's door: a dial, a spoked handle, bolts."""
    del variant
    steel = pick(rng, (palette.GRAPHITE, palette.FOREST, palette.NAVY))
    leaf = [slab(steel)]
    plate = prism(rectangle(0.54, 0.20, 0.02), 0, 0.012, bevel=0.005)
    leaf.append(Part(plate.moved(0, 0, TOP), palette.STEEL))
    dial = [(0.062, 0), (0.058, 0.02), (0.03, 0.022), (0.028, 0.04), (0, 0.042)]
    leaf.append(Part(lathe(dial, 28).moved(0.13, 0, TOP + 0.01), palette.IVORY))
    for angle in np.arange(3) * 2 * np.pi / 3:
        x, y, z = -0.12 + 0.075 * float(np.cos(angle)), 0.075 * float(np.sin(angle)), TOP + 0.04
        leaf.append(Part(rod((-0.12, 0, z), (x, y, z), 0.009), palette.BRASS))
        leaf.append(Part(lathe([(0.014, -0.01), (0.014, 0.012), (0, 0.014)], 14).moved(x, y, z), palette.BRASS))
    leaf.append(Part(lathe([(0.022, 0), (0.018, 0.05), (0, 0.052)], 18).moved(-0.12, 0, TOP + 0.005), palette.BRASS))
    return door(leaf, pick(rng, (palette.IRON, palette.STONE)), rng)


def barred(variant: int, rng: np.random.Generator) -> Design:
    """A gate of round bars: along the door, or across it."""
    iron = in_turn((palette.IRON, palette.WHITE), variant)
    outer = rectangle(LEAF_LENGTH, LEAF_WIDTH, 0.006)
    leaf = [Part(frame(outer, inset(outer, 0.034), LEAF_BOTTOM, LEAF_TOP, 0.006), iron)]
    z = LEAF_BOTTOM + 0.014
    if variant % 2 == 0:
        for x in np.linspace(-0.26, 0.26, 9):
            leaf.append(Part(rod((float(x), -0.13, z), (float(x), 0.13, z), 0.009, 10), iron))
        leaf.append(Part(box(0.60, 0.022, 0.014, 0.004).moved(0, 0.0, z), iron))
    else:
        for y in np.linspace(-0.09, 0.09, 4):
            leaf.append(Part(rod((-0.31, float(y), z), (0.31, float(y), z), 0.011, 10), iron))
        leaf += [Part(box(0.05, 0.25, 0.016, 0.005).moved(x, 0, z), iron) for x in (-0.15, 0.15)]
    leaf.append(Part(box(0.09, 0.05, 0.022, 0.006).moved(0, 0.12, LEAF_TOP - 0.006), palette.BRASS))
    return door(leaf, pick(rng, (palette.STONE, palette.CHERRY, palette.SAGE)), rng)


def lights(variant: int, rng: np.random.Generator) -> Design:
    """Three round windows in a row, or one large half-round."""
    paint = pick(rng, (palette.CORAL, palette.MUSTARD, palette.SKY, palette.PLUM))
    leaf = [slab(paint)]
    for x, radius in (
        ((-0.20, 0.062), (0.0, 0.075), (0.20, 0.062)) if variant % 2 == 0 else ((0.12, 0.11), (-0.18, 0.05))
    ):
        rim = frame(circle(radius + 0.014, 36), circle(radius, 36), 0, 0.010, 0.004)
        leaf += [Part(rim.moved(x, -0.01, TOP), palette.WHITE)]
        leaf += [Part(prism(circle(radius + 0.004, 32), 0, 0.004).moved(x, -0.01, TOP), palette.GLASS)]
        cross = box(2 * radius, 0.010, 0.007, 0.002)
        leaf += [Part(cross.turned("z", turn).moved(x, -0.01, TOP), palette.WHITE) for turn in (0.0, np.pi / 2)]
    return door([*leaf, *lever_handle(palette.CHROME)], pick(rng, (palette.WHITE, palette.WALNUT)), rng)


def fridge(variant: int, rng: np.random.Generator) -> Design:
    """A refrigerator: two soft fields with a gap, a bar each, magnets."""
    del variant
    paint = pick(rng, (palette.MINT, palette.RED, palette.SKY, palette.IVORY))
    leaf = [slab(paint)]
    for x, length in ((-0.12, 0.40), (0.215, 0.20)):
        field = prism(rectangle(length, 0.27, 0.05, 6), 0, 0.020, bevel=0.014, steps=4)
        leaf.append(Part(field.moved(x, 0, TOP), paint))
        leaf.append(Part(lying(0.011, 0.6 * length).turned("z", np.pi / 2).moved(x, 0.10, TOP + 0.034), palette.CHROME))
        feet = [box(0.018, 0.018, 0.034, 0.004).moved(x + s * 0.25 * length, 0.10, TOP + 0.002) for s in (-1, 1)]
        leaf += [Part(foot, palette.CHROME) for foot in feet]
    for k in range(4):
        x, y = float(rng.uniform(-0.27, 0.02)), float(rng.uniform(-0.09, 0.03))
        leaf.append(Part(stud(0.014, 0.008).moved(x, y, TOP + 0.018), palette.ACCENTS[(k + 3) % 8]))
    return door(leaf, pick(rng, (palette.STEEL, palette.GRAPHITE)), rng)


def grooved(variant: int, rng: np.random.Generator) -> Design:
    """Steps towards the middle, like a frame in a frame."""
    paint = in_turn((palette.SAGE, palette.WINE), variant)
    leaf = [slab(paint)]
    for k in range(3):
        outer = rectangle(LEAF_LENGTH - 0.07 - 0.16 * k, LEAF_WIDTH - 0.06 - 0.075 * k, 0.012)
        leaf.append(
            Part(
                frame(outer, inset(outer, 0.018), 0, 0.014, 0.005).moved(0, -0.008, TOP),
                palette.BRASS if k == 1 else paint,
            )
        )
    handle = knob(palette.BRASS, 0.0) if variant % 2 else lever_handle(palette.STEEL)
    return door(
        [*leaf, *shifted(handle, (0, 0.012, 0))],
        pick(rng, (palette.BIRCH, palette.WHITE, palette.IRON), unlike=paint),
        rng,
    )


def paper(variant: int, rng: np.random.Generator) -> Design:
    """Novel: a Japanese paper door, fine laths over bright panes, with a round sunk pull."""
    del variant
    wood = pick(rng, (palette.BLACK, palette.CHERRY, palette.WALNUT))
    outer = rectangle(LEAF_LENGTH, LEAF_WIDTH, 0.004)
    leaf = [Part(frame(outer, inset(outer, 0.022), LEAF_BOTTOM, LEAF_TOP, 0.003), wood)]
    leaf.append(Part(prism(inset(outer, 0.012), LEAF_BOTTOM, LEAF_TOP - 0.012), palette.IVORY))
    leaf += [
        Part(box(0.008, 0.27, 0.010, 0.002).moved(float(x), 0, LEAF_TOP - 0.014), wood)
        for x in np.linspace(-0.22, 0.22, 6)
    ]
    leaf += [Part(box(0.63, 0.008, 0.009, 0.002).moved(0, y, LEAF_TOP - 0.014), wood) for y in (-0.05, 0.05)]
    leaf.append(Part(torus(0.024, 0.005, 22, 6).moved(0.0, 0.10, LEAF_TOP - 0.008), palette.BRASS))
    return door(leaf, wood, rng)


def saloon(variant: int, rng: np.random.Generator) -> Design:
    """Novel: a swing door with a waved crown, slanted boards and a star."""
    del variant
    wood: Material = pick(rng, (palette.CHERRY, palette.OAK))
    dark = pick(rng, (palette.WALNUT, palette.IRON))
    leaf = [slab(wood)]
    for x in np.linspace(-0.27, 0.27, 10):
        board = box(0.012, 0.20, 0.010, 0.003).turned("z", 0.5)
        leaf.append(Part(board.moved(float(x) * 0.82, 0, TOP), dark))
    for y in (-0.132, 0.132):
        leaf.append(Part(box(0.64, 0.022, 0.016, 0.005).moved(0, y, TOP), dark))
    badge = [Part(lathe([(0.062, 0), (0.058, 0.016), (0, 0.018)], 28), wood)]
    badge.append(Part(prism(star(0.036, 0.012, 5, 4), 0.014, 0.024, bevel=0.003), palette.BRASS))
    return door([*leaf, *shifted(badge, (0.05, 0, TOP))], dark, rng)
