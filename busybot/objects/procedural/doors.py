"""Doors that lie on the board and open towards the camera, about a hinge along their long lower side.

In plan: x along the door's height (its top at +x), y across; the hinge at low y. Behind the leaf lies a dark floor.
Handles, wheels, knobs and rivets on the leaves stand still: they are there to be told from switches.
"""

import numpy as np

from busybot.objects.procedural import cad, fixtures, palette
from busybot.objects.procedural.design import DOOR_SCALE, Design, Material, MovingLink, Part, shifted
from busybot.objects.procedural.grips import lying, rod
from busybot.objects.procedural.palette import in_turn, pick

LENGTH, WIDTH = 0.76, 0.40
LEAF_LENGTH, LEAF_WIDTH = 0.66, 0.30
LEAF_BOTTOM, LEAF_TOP = 0.014, 0.044
OPEN = 1.5
FACE = LEAF_TOP - 0.001
"""Where things stand on a leaf."""
FLOORS = (palette.SHADOW, palette.NAVY, palette.WINE, palette.FOREST, palette.BLUSH, palette.SKY)


def door(
    leaf: list[Part], rim: Material, rng: np.random.Generator, outlines: tuple[np.ndarray, np.ndarray] | None = None
) -> Design:
    """Put a leaf into a frame, with hinges and floor. Outlines are those of the frame, outer and inner."""
    opening = cad.rectangle(LEAF_LENGTH + 0.003, LEAF_WIDTH + 0.003, 0.004)
    outer, inner = outlines or (cad.rectangle(LENGTH, WIDTH, 0.012), opening)
    body = [Part(cad.frame(outer, inner, 0, 0.05, bevel=0.010), rim)]
    lip = 0.55 * outer + 0.45 * inner
    body.append(Part(cad.frame(lip, 0.35 * outer + 0.65 * inner, 0.048, 0.054, bevel=0.003), rim))
    body.append(Part(cad.prism(0.5 * (outer + inner), 0, 0.006), pick(rng, FLOORS, unlike=leaf[0].material)))
    hinge_y, hinge_z = -LEAF_WIDTH / 2, LEAF_TOP + 0.002
    metal = pick(rng, palette.METALS)
    for x in (-0.24, 0.24):
        barrel = cad.pipe([(x - 0.035, hinge_y - 0.006, hinge_z), (x + 0.035, hinge_y - 0.006, hinge_z)], 0.009, 10)
        body.append(Part(barrel, metal))
    # turning about +x lifts the side at high y
    link = MovingLink(leaf, "revolute", (0.0, hinge_y, hinge_z), (1, 0, 0), 0.0, np.pi / 2, None, "door")
    return Design("Door", DOOR_SCALE, body, [link], states=((0.0,), (OPEN,)))


def stud(radius: float, height: float) -> cad.Solid:
    """The head of a rivet."""
    return cad.lathe([(radius, 0.0), (0.8 * radius, 0.6 * height), (0.0, height)], 10)


def slab(material: Material) -> Part:
    """A plain leaf."""
    return Part(cad.prism(cad.rectangle(LEAF_LENGTH, LEAF_WIDTH, 0.006), LEAF_BOTTOM, LEAF_TOP, bevel=0.003), material)


def _panel(x: float, y: float, length: float, width: float, material: Material) -> list[Part]:
    """A raised field within a moulding."""
    outer, inner = cad.rectangle(length, width, 0.006), cad.rectangle(length - 0.022, width - 0.022, 0.004)
    moulding = cad.frame(outer, inner, 0, 0.007, 0.003)
    field = cad.prism(cad.rectangle(length - 0.045, width - 0.045, 0.004), 0, 0.009, bevel=0.008)
    return [Part(solid.moved(x, y, FACE), material) for solid in (moulding, field)]


def knob(metal: Material, x: float = -0.02) -> list[Part]:
    """Rosette and round knob at the free side."""
    rose = cad.lathe([(0.026, 0), (0.024, 0.005), (0.010, 0.008), (0.009, 0.022)], 20)
    grip = cad.lathe([(0.009, 0.02), (0.024, 0.028), (0.027, 0.038), (0.020, 0.048), (0.0, 0.051)], 20)
    return [Part(solid.moved(x, 0.118, FACE), metal) for solid in (rose, grip)]


def lever_handle(metal: Material) -> list[Part]:
    """A long shield and a lever."""
    shield = cad.prism(cad.rectangle(0.10, 0.026, 0.012), 0, 0.005, bevel=0.002).moved(-0.02, 0.122, FACE)
    z = LEAF_TOP + 0.028
    path = [(0.0, 0.122, LEAF_TOP), (0.0, 0.122, z), (0.0, 0.112, z + 0.004), (0.0, 0.052, z + 0.004)]
    return [Part(shield, metal), Part(cad.pipe(path, 0.008, 10), metal)]


def panelled(variant: int, rng: np.random.Generator) -> Design:
    """Six fields in natural wood, or four in paint."""
    woods = (palette.OAK, palette.WALNUT, palette.CHERRY)
    paints = (palette.TEAL, palette.CORAL, palette.NAVY, palette.MUSTARD, palette.FOREST)
    face = pick(rng, paints if variant % 2 else woods)
    leaf = [slab(face)]
    for x, length in ((-0.175, 0.26), (0.145, 0.32)) if variant % 2 else ((-0.20, 0.20), (0.05, 0.22), (0.245, 0.12)):
        leaf += _panel(x, -0.068, length, 0.115, face) + _panel(x, 0.068, length, 0.115, face)
    if variant % 2 == 0:
        return door([*leaf, *knob(palette.BRASS, -0.085)], face, rng)
    slot = cad.prism(cad.rectangle(0.018, 0.10, 0.006), 0, 0.004, bevel=0.001).moved(-0.022, -0.02, LEAF_TOP)
    return door([*leaf, *knob(palette.BRASS, -0.02), Part(slot, palette.BRASS)], palette.WHITE, rng)


def glazed(_variant: int, rng: np.random.Generator) -> Design:
    """Two by three panes over a wooden panel."""
    paint = pick(rng, (palette.WHITE, palette.SAGE, palette.SKY, palette.BIRCH))
    leaf = [slab(paint), *_panel(-0.215, 0.0, 0.16, 0.24, paint)]
    for x in (-0.045, 0.105, 0.255):
        for y in (-0.062, 0.062):
            pane = cad.prism(cad.rectangle(0.118, 0.092, 0.006), 0, 0.003)
            bead = cad.frame(cad.rectangle(0.134, 0.108, 0.006), cad.rectangle(0.114, 0.088, 0.004), 0, 0.008, 0.003)
            leaf += [Part(pane.moved(x, y, LEAF_TOP - 0.0005), palette.GLASS), Part(bead.moved(x, y, FACE), paint)]
    return door([*leaf, *lever_handle(palette.BRASS)], pick(rng, (palette.WHITE, palette.BIRCH, palette.GRAPHITE)), rng)


def planked(_variant: int, rng: np.random.Generator) -> Design:
    """A barn door: planks, ledges, a brace, iron straps."""
    wood, ledge = pick(rng, (palette.OAK, palette.CHERRY, palette.BIRCH)), pick(rng, (palette.WALNUT, palette.CHERRY))
    outline = cad.rectangle(LEAF_LENGTH, LEAF_WIDTH / 5 - 0.003, 0.004, 2)
    plank = cad.prism(outline, LEAF_BOTTOM, LEAF_TOP, bevel=0.005)
    leaf = [Part(plank.moved(y=(k - 2) * LEAF_WIDTH / 5), wood) for k in range(5)]
    for x in (-0.24, 0.24):
        leaf.append(Part(cad.box(0.06, 0.29, 0.016, 0.004).moved(x, 0, LEAF_TOP - 0.002), ledge))
        for y in (-0.11, -0.05, 0.05):
            leaf += fixtures.screw(x, y, LEAF_TOP + 0.013, 0.4, palette.IRON, 0.009)
    brace = cad.box(0.52, 0.05, 0.015, 0.004).turned("z", 0.46).moved(0, 0, LEAF_TOP - 0.002)
    pull = cad.torus(0.030, 0.006, 20, 6).moved(0.0, 0.117, LEAF_TOP + 0.012)
    leaf += [Part(brace, ledge), Part(pull, palette.IRON)]
    return door(leaf, palette.WALNUT if ledge is not palette.WALNUT else palette.CHERRY, rng)


def louvred(_variant: int, rng: np.random.Generator) -> Design:
    """Tilted slats between stiles."""
    paint = pick(rng, (palette.MINT, palette.SKY, palette.BLUSH, palette.IVORY))
    outer = cad.rectangle(LEAF_LENGTH, LEAF_WIDTH, 0.006)
    leaf = [Part(cad.frame(outer, cad.rectangle(0.56, 0.21, 0.004), LEAF_BOTTOM, LEAF_TOP, 0.003), paint)]
    leaf.append(Part(cad.prism(cad.rectangle(0.57, 0.22, 0.004), LEAF_BOTTOM, LEAF_BOTTOM + 0.008), palette.STONE))
    leaf.append(Part(cad.box(0.04, 0.22, 0.030, 0.003).moved(-0.02, 0, LEAF_BOTTOM), paint))
    for x in [*np.linspace(-0.262, -0.058, 8), *np.linspace(0.018, 0.262, 9)]:
        slat = cad.box(0.030, 0.212, 0.006, 0.002).moved(z=-0.003).turned("y", 0.5).moved(float(x), 0, LEAF_TOP - 0.011)
        leaf.append(Part(slat, paint))
    return door([*leaf, *knob(palette.CHROME)], palette.WHITE, rng)


def flush(_variant: int, rng: np.random.Generator) -> Design:
    """A plain modern leaf with a narrow window and a long bar."""
    face = pick(rng, (palette.GRAPHITE, palette.ORANGE, palette.SAGE, palette.WINE))
    leaf = [slab(face)]
    window = cad.prism(cad.rectangle(0.44, 0.05, 0.02), 0, 0.003).moved(0.03, -0.06, LEAF_TOP - 0.0005)
    bead = cad.frame(cad.rectangle(0.46, 0.07, 0.03), cad.rectangle(0.435, 0.045, 0.018), 0, 0.006, 0.002)
    leaf += [Part(window, palette.GLASS), Part(bead.moved(0.03, -0.06, FACE), palette.STEEL)]
    z = LEAF_TOP + 0.03
    bar = cad.pipe([(x, 0.115, z) for x in (-0.20, -0.19, 0.19, 0.20)], 0.009, 12)
    leaf.append(Part(bar, palette.CHROME))
    foot = cad.pipe([(0.0, 0.115, LEAF_TOP - 0.004), (0.0, 0.115, z)], 0.006, 8)
    leaf += [Part(foot.moved(x), palette.CHROME) for x in (-0.16, 0.16)]
    leaf += [Part(cad.box(0.003, 0.28, 0.0015).moved(x, 0, LEAF_TOP - 0.0005), palette.SHADOW) for x in (-0.27, 0.29)]
    return door(leaf, pick(rng, (palette.STEEL, palette.BIRCH)), rng)


def arched(_variant: int, rng: np.random.Generator) -> Design:
    """Novel: a castle's door with a round top, studs and long straps."""
    wood = pick(rng, (palette.CHERRY, palette.WALNUT, palette.FOREST))
    leaf = [Part(cad.prism(_arch(0.33, 0.15, 0.18), LEAF_BOTTOM, LEAF_TOP, bevel=0.004), wood)]
    for y in (-0.09, -0.03, 0.03, 0.09):
        reach = 0.33 + 0.18 + float(np.sqrt(0.146**2 - y**2))
        leaf.append(Part(cad.box(reach, 0.004, 0.0015).moved(reach / 2 - 0.33, y, LEAF_TOP - 0.0005), palette.SHADOW))
    for x in (-0.22, 0.10):
        leaf.append(Part(cad.box(0.04, 0.27, 0.008, 0.002).moved(x, -0.012, FACE), palette.IRON))
        for y in np.linspace(-0.12, 0.10, 5):
            leaf.append(Part(stud(0.012, 0.008).moved(x, y, LEAF_TOP + 0.007), palette.STEEL))
    leaf.append(Part(cad.torus(0.032, 0.007, 22, 8).moved(-0.06, 0.10, LEAF_TOP + 0.01), palette.IRON))
    return door(leaf, palette.STONE, rng, (_arch(0.38, 0.20, 0.18), _arch(0.334, 0.154, 0.18)))


def _arch(foot: float, radius: float, spring: float) -> np.ndarray:
    """Outline of a doorway with a half-round top: foot at -foot, arch of `radius` that springs at x = spring."""
    angles = np.linspace(-np.pi / 2, np.pi / 2, 17)
    top = np.stack([spring + radius * np.cos(angles), radius * np.sin(angles)], axis=1)
    return np.concatenate([top, [[-foot, radius], [-foot, -radius]]])


def porthole(_variant: int, rng: np.random.Generator) -> Design:
    """Novel: a ship's door with a round window, a wheel and rivets."""
    paint, rim = pick(rng, (palette.STEEL, palette.SKY, palette.RED)), pick(rng, (palette.GRAPHITE, palette.NAVY))
    outline = cad.rectangle(LEAF_LENGTH, LEAF_WIDTH, 0.11, 6)
    leaf = [Part(cad.prism(outline, LEAF_BOTTOM, LEAF_TOP, bevel=0.008), paint)]
    ring_plate = cad.frame(cad.circle(0.095, 36), cad.circle(0.068, 36), 0, 0.012, 0.005).moved(0.17, 0, FACE)
    glass = cad.prism(cad.circle(0.07, 36), 0, 0.003).moved(0.17, 0, LEAF_TOP)
    leaf += [Part(ring_plate, palette.BRASS), Part(glass, palette.GLASS)]
    for angle in np.arange(8) * np.pi / 4:
        x, y = 0.17 + 0.082 * float(np.cos(angle)), 0.082 * float(np.sin(angle))
        leaf.append(Part(stud(0.008, 0.005).moved(x, y, LEAF_TOP + 0.011), palette.COPPER))
    z = LEAF_TOP + 0.035
    wheel = cad.torus(0.068, 0.009, 30, 8).moved(-0.12, 0, z)
    leaf.append(Part(wheel, palette.RED if paint is not palette.RED else palette.BRASS))
    for angle in np.arange(3) * np.pi / 3:
        dx, dy = 0.066 * float(np.cos(angle)), 0.066 * float(np.sin(angle))
        leaf.append(Part(cad.pipe([(-0.12 - dx, -dy, z), (-0.12 + dx, dy, z)], 0.006, 8), palette.STEEL))
    hub = cad.lathe([(0.018, LEAF_TOP - 0.002), (0.018, z + 0.008), (0, z + 0.010)], 18).moved(-0.12)
    leaf.append(Part(hub, palette.STEEL))
    inner = cad.rectangle(LEAF_LENGTH + 0.003, LEAF_WIDTH + 0.003, 0.114, 6)
    return door(leaf, rim, rng, (cad.rectangle(LENGTH, WIDTH, 0.15, 6), inner))


def lattice(_variant: int, rng: np.random.Generator) -> Design:
    """Novel: a garden gate, diagonal laths over a coloured ground."""
    wood, ground = pick(rng, (palette.BIRCH, palette.WHITE)), pick(rng, (palette.SAGE, palette.TEAL, palette.PLUM))
    outer = cad.rectangle(LEAF_LENGTH, LEAF_WIDTH, 0.006)
    leaf = [Part(cad.frame(outer, cad.rectangle(0.58, 0.22, 0.004), LEAF_BOTTOM, LEAF_TOP, 0.004), wood)]
    leaf.append(Part(cad.prism(cad.rectangle(0.59, 0.23, 0.004), LEAF_BOTTOM, LEAF_BOTTOM + 0.008), ground))
    for sign, z in ((1, LEAF_BOTTOM + 0.006), (-1, LEAF_BOTTOM + 0.013)):
        for x in np.linspace(-0.225, 0.225, 7):
            path = np.array([(end, sign * (end - x), z) for end in np.clip([x - 0.105, x + 0.105], -0.285, 0.285)])
            lath = cad.sweep(path, np.array([(-0.009, 0.0), (0.009, 0.0), (0.009, 0.007), (-0.009, 0.007)]))
            leaf.append(Part(lath, wood))
    return door([*leaf, *knob(palette.IRON)], wood, rng)


def hatch(_variant: int, rng: np.random.Generator) -> Design:
    """Novel: a cellar hatch of checkered steel with a sunk ring and a warning stripe."""
    metal, stripe = pick(rng, (palette.STEEL, palette.STONE)), pick(rng, (palette.MUSTARD, palette.ORANGE))
    leaf = [slab(metal)]
    rhomb = np.array([(-0.016, 0), (0, -0.005), (0.016, 0), (0, 0.005)])
    stud = cad.prism(rhomb, 0, 0.004, bevel=0.001, steps=1)
    for i, x in enumerate(np.linspace(-0.24, 0.24, 9)):
        for j, y in enumerate(np.linspace(-0.105, 0.105, 5)):
            if abs(x) < 0.09 and y > 0.02:
                continue
            turn = 0.785 if (i + j) % 2 else -0.785
            leaf.append(Part(stud.turned("z", turn).moved(float(x), float(y), LEAF_TOP - 0.0005), palette.CHROME))
    for x in (-0.30, 0.30):
        leaf.append(Part(cad.box(0.035, 0.29, 0.006, 0.002).moved(x, 0, FACE), stripe))
    outline = cad.rectangle(0.13, 0.08, 0.02, 5)
    pull = cad.frame(outline, cad.matching_circle(outline, 0.034), 0, 0.008, 0.003)
    leaf.append(Part(pull.moved(0, 0.09, FACE), palette.IRON))
    leaf.append(Part(cad.torus(0.026, 0.006, 20, 6).moved(0, 0.09, LEAF_TOP + 0.004), stripe))
    return door(leaf, palette.GRAPHITE, rng)


def carved(variant: int, rng: np.random.Generator) -> Design:
    """Diamonds, discs or flowers in relief."""
    wood = in_turn((palette.TEAL, palette.CHERRY, palette.PLUM), variant)
    relief = pick(rng, (palette.BIRCH, palette.MUSTARD, palette.BLUSH, palette.MINT), unlike=wood)
    motif = (cad.circle(0.062, 4), cad.circle(0.055, 32), cad.wavy(0.055, 0.014, 6, 6))[variant % 3]
    leaf = [slab(wood)]
    for x in (-0.22, -0.07, 0.08, 0.23):
        for y in (-0.072, 0.072):
            if y > 0 and abs(x + 0.07) < 0.01:
                continue
            leaf.append(Part(cad.prism(motif, 0, 0.012, bevel=0.005).moved(x, y, FACE), relief))
            leaf.append(Part(stud(0.016, 0.008).moved(x, y, FACE + 0.011), wood))
    return door([*leaf, *knob(palette.BRASS, -0.07)], pick(rng, (palette.WALNUT, palette.IVORY)), rng)


def safe(_variant: int, rng: np.random.Generator) -> Design:
    """A strongroom's door: a dial, a spoked handle, bolts."""
    plate = cad.prism(cad.rectangle(0.54, 0.20, 0.02), 0, 0.012, bevel=0.005).moved(z=FACE)
    leaf = [slab(pick(rng, (palette.GRAPHITE, palette.FOREST, palette.NAVY))), Part(plate, palette.STEEL)]
    dial = [(0.062, 0), (0.058, 0.02), (0.03, 0.022), (0.028, 0.04), (0, 0.042)]
    leaf.append(Part(cad.lathe(dial, 28).moved(0.13, 0, FACE + 0.01), palette.IVORY))
    for angle in np.arange(3) * 2 * np.pi / 3:
        x, y, z = -0.12 + 0.075 * float(np.cos(angle)), 0.075 * float(np.sin(angle)), FACE + 0.04
        leaf.append(Part(rod((-0.12, 0, z), (x, y, z), 0.009), palette.BRASS))
        leaf.append(Part(cad.lathe([(0.014, -0.01), (0.014, 0.012), (0, 0.014)], 14).moved(x, y, z), palette.BRASS))
    hub = cad.lathe([(0.022, 0), (0.018, 0.05), (0, 0.052)], 18)
    leaf.append(Part(hub.moved(-0.12, 0, FACE + 0.005), palette.BRASS))
    return door(leaf, pick(rng, (palette.IRON, palette.STONE)), rng)


def barred(variant: int, rng: np.random.Generator) -> Design:
    """A gate of round bars: along the door, or across it."""
    iron = in_turn((palette.IRON, palette.WHITE), variant)
    outer = cad.rectangle(LEAF_LENGTH, LEAF_WIDTH, 0.006)
    leaf = [Part(cad.frame(outer, cad.inset(outer, 0.034), LEAF_BOTTOM, LEAF_TOP, 0.006), iron)]
    z = LEAF_BOTTOM + 0.014
    if variant % 2 == 0:
        for x in np.linspace(-0.26, 0.26, 9):
            leaf.append(Part(rod((float(x), -0.13, z), (float(x), 0.13, z), 0.009, 10), iron))
        leaf.append(Part(cad.box(0.60, 0.022, 0.014, 0.004).moved(0, 0.0, z), iron))
    else:
        for y in np.linspace(-0.09, 0.09, 4):
            leaf.append(Part(rod((-0.31, float(y), z), (0.31, float(y), z), 0.011, 10), iron))
        leaf += [Part(cad.box(0.05, 0.25, 0.016, 0.005).moved(x, 0, z), iron) for x in (-0.15, 0.15)]
    leaf.append(Part(cad.box(0.09, 0.05, 0.022, 0.006).moved(0, 0.12, LEAF_TOP - 0.006), palette.BRASS))
    return door(leaf, pick(rng, (palette.STONE, palette.CHERRY, palette.SAGE)), rng)


def lights(variant: int, rng: np.random.Generator) -> Design:
    """Three round windows in a row, or one large half-round."""
    paint = pick(rng, (palette.CORAL, palette.MUSTARD, palette.SKY, palette.PLUM))
    leaf = [slab(paint)]
    three, two = ((-0.20, 0.062), (0.0, 0.075), (0.20, 0.062)), ((0.12, 0.11), (-0.18, 0.05))
    for x, radius in two if variant % 2 else three:
        rim = cad.frame(cad.circle(radius + 0.014, 36), cad.circle(radius, 36), 0, 0.010, 0.004)
        leaf += [Part(rim.moved(x, -0.01, FACE), palette.WHITE)]
        leaf += [Part(cad.prism(cad.circle(radius + 0.004, 32), 0, 0.004).moved(x, -0.01, FACE), palette.GLASS)]
        cross = cad.box(2 * radius, 0.010, 0.007, 0.002)
        leaf += [Part(cross.turned("z", turn).moved(x, -0.01, FACE), palette.WHITE) for turn in (0.0, np.pi / 2)]
    return door([*leaf, *lever_handle(palette.CHROME)], pick(rng, (palette.WHITE, palette.WALNUT)), rng)


def fridge(_variant: int, rng: np.random.Generator) -> Design:
    """A refrigerator: two soft fields with a gap, a bar each, magnets."""
    paint = pick(rng, (palette.MINT, palette.RED, palette.SKY, palette.IVORY))
    leaf = [slab(paint)]
    for x, length in ((-0.12, 0.40), (0.215, 0.20)):
        field = cad.prism(cad.rectangle(length, 0.27, 0.05, 6), 0, 0.020, bevel=0.014, steps=4)
        leaf.append(Part(field.moved(x, 0, FACE), paint))
        bar = lying(0.011, 0.6 * length).turned("z", np.pi / 2)
        leaf.append(Part(bar.moved(x, 0.10, FACE + 0.034), palette.CHROME))
        feet = [cad.box(0.018, 0.018, 0.034, 0.004).moved(x + s * 0.25 * length, 0.10, FACE + 0.002) for s in (-1, 1)]
        leaf += [Part(foot, palette.CHROME) for foot in feet]
    for k in range(4):
        x, y = float(rng.uniform(-0.27, 0.02)), float(rng.uniform(-0.09, 0.03))
        leaf.append(Part(stud(0.014, 0.008).moved(x, y, FACE + 0.018), palette.ACCENTS[(k + 3) % 8]))
    return door(leaf, pick(rng, (palette.STEEL, palette.GRAPHITE)), rng)


def grooved(variant: int, rng: np.random.Generator) -> Design:
    """Steps towards the middle, like a frame in a frame."""
    paint = in_turn((palette.SAGE, palette.WINE), variant)
    leaf = [slab(paint)]
    for k in range(3):
        outer = cad.rectangle(LEAF_LENGTH - 0.07 - 0.16 * k, LEAF_WIDTH - 0.06 - 0.075 * k, 0.012)
        step = cad.frame(outer, cad.inset(outer, 0.018), 0, 0.014, 0.005).moved(0, -0.008, FACE)
        leaf.append(Part(step, palette.BRASS if k == 1 else paint))
    leaf += shifted(knob(palette.BRASS, 0.0) if variant % 2 else lever_handle(palette.STEEL), (0, 0.012, 0))
    return door(leaf, pick(rng, (palette.BIRCH, palette.WHITE, palette.IRON), unlike=paint), rng)


def paper(_variant: int, rng: np.random.Generator) -> Design:
    """Novel: a Japanese paper door, fine laths over bright panes, with a round sunk pull."""
    wood = pick(rng, (palette.BLACK, palette.CHERRY, palette.WALNUT))
    outer = cad.rectangle(LEAF_LENGTH, LEAF_WIDTH, 0.004)
    leaf = [Part(cad.frame(outer, cad.inset(outer, 0.022), LEAF_BOTTOM, LEAF_TOP, 0.003), wood)]
    leaf.append(Part(cad.prism(cad.inset(outer, 0.012), LEAF_BOTTOM, LEAF_TOP - 0.012), palette.IVORY))
    lath = cad.box(0.008, 0.27, 0.010, 0.002)
    leaf += [Part(lath.moved(float(x), 0, LEAF_TOP - 0.014), wood) for x in np.linspace(-0.22, 0.22, 6)]
    leaf += [Part(cad.box(0.63, 0.008, 0.009, 0.002).moved(0, y, LEAF_TOP - 0.014), wood) for y in (-0.05, 0.05)]
    leaf.append(Part(cad.torus(0.024, 0.005, 22, 6).moved(0.0, 0.10, LEAF_TOP - 0.008), palette.BRASS))
    return door(leaf, wood, rng)


def saloon(_variant: int, rng: np.random.Generator) -> Design:
    """Novel: a swing door with a waved crown, slanted boards and a star."""
    wood = pick(rng, (palette.CHERRY, palette.OAK))
    dark = pick(rng, (palette.WALNUT, palette.IRON))
    leaf = [slab(wood)]
    board = cad.box(0.012, 0.20, 0.010, 0.003).turned("z", 0.5)
    leaf += [Part(board.moved(float(x) * 0.82, 0, FACE), dark) for x in np.linspace(-0.27, 0.27, 10)]
    leaf += [Part(cad.box(0.64, 0.022, 0.016, 0.005).moved(0, y, FACE), dark) for y in (-0.132, 0.132)]
    star = cad.prism(cad.wavy(0.036, 0.012, 5, 4), 0.014, 0.024, bevel=0.003)
    badge = [Part(cad.lathe([(0.062, 0), (0.058, 0.016), (0, 0.018)], 28), wood), Part(star, palette.BRASS)]
    return door([*leaf, *shifted(badge, (0.05, 0, FACE))], dark, rng)
