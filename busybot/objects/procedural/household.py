"""What stands in kitchens and rooms (`boards.scenes`) and on no board: burners and their knobs, pots, kettles, fans.

Being in neither split, they are on boards of a scene alone: no model that is trained on boards has seen one.
"""

import numpy as np

from busybot.objects.procedural import cad, palette
from busybot.objects.procedural.design import DOOR_SCALE, TURN_Z, Design, MovingLink, Part, switch
from busybot.objects.procedural.fixtures import turned
from busybot.objects.procedural.grips import rod
from busybot.objects.procedural.lamps import lamp
from busybot.objects.procedural.palette import pick


def burner(variant: int, rng: np.random.Generator) -> Design:
    """A heating plate or a coil in a ring of metal; what glows is the plate or the coil."""
    body = [Part(cad.frame(cad.circle(0.30, 40), cad.circle(0.265, 40), 0, 0.03, 0.008), pick(rng, palette.METALS))]
    body.append(Part(cad.prism(cad.circle(0.275, 40), 0, 0.008), palette.GRAPHITE))
    if variant % 2:
        glow = cad.joined([cad.torus(r, 0.022, 36, 8).moved(z=0.03) for r in (0.07, 0.14, 0.21)])
    else:
        glow = cad.lathe([(0.235, 0.006), (0.235, 0.032), (0.225, 0.04), (0.05, 0.04), (0.0, 0.036)], 36)
    return lamp(body, glow, variant // 2, rng)


def stoveknob(variant: int, rng: np.random.Generator) -> Design:
    """A round knob with a bar across, over a dial ring."""
    metal, color = pick(rng, palette.METALS), (palette.BLACK, palette.WHITE, palette.STEEL)[variant % 3]
    dial = cad.frame(cad.circle(0.155, 32), cad.circle(0.12, 32), 0, 0.012, 0.004)
    body = [Part(dial, metal), Part(cad.prism(cad.circle(0.13, 32), 0, 0.006), palette.SHADOW)]
    body.append(Part(cad.box(0.012, 0.03, 0.006, 0.002).moved(0, 0.138, 0.010), palette.RED))
    cap = cad.lathe([(0.105, 0.0), (0.10, 0.045), (0.09, 0.052), (0.0, 0.052)], 30)
    bar = cad.box(0.24, 0.045, 0.055, 0.012).moved(z=0.045)
    mark = cad.box(0.05, 0.016, 0.004, 0.001).moved(0.085, 0, 0.099)
    parts = [Part(cap, color), Part(bar, color), Part(mark, palette.RED if color is not palette.RED else palette.WHITE)]
    return switch(body, [turned(parts, (0, 0, 0.012), 0.7)], TURN_Z, 1)


def _lidded(body: list[Part], lid: list[Part], radius: float, height: float) -> Design:
    """A vessel whose lid is hinged at its back: it opens like a door."""
    link = MovingLink(lid, "revolute", (0.0, radius, height), (-1, 0, 0), 0.0, np.pi / 2, None, "lid")
    return Design("Door", DOOR_SCALE, body, [link], states=((0.0,), (1.3,)))


def pot(variant: int, rng: np.random.Generator) -> Design:
    """A pot with two handles, or a pan with a long one, and a lid."""
    radius, height = ((0.26, 0.24), (0.22, 0.30), (0.29, 0.10), (0.24, 0.09))[variant % 4]
    color = pick(rng, (palette.STEEL, palette.RED, palette.TEAL, palette.GRAPHITE, palette.COPPER))
    profile = [(0.9 * radius, 0.0), (radius, 0.03), (radius, height), (0.9 * radius, height), (0.0, height - 0.01)]
    body = [Part(cad.lathe(profile, 36), color)]
    if variant % 4 < 2:
        for side in (-1, 1):
            grip = [(side * radius, -0.07, 0.8 * height), (side * (radius + 0.08), 0, 0.8 * height)]
            grip.append((side * radius, 0.07, 0.8 * height))
            body.append(Part(cad.pipe(grip, 0.018, 10), palette.BLACK))
    else:
        body.append(Part(rod((radius - 0.02, 0, 0.7 * height), (radius + 0.34, 0, height), 0.028), palette.BLACK))
    lid = cad.lathe([(1.02 * radius, height), (radius, height + 0.015), (0.3 * radius, 0.05 + height)], 36)
    knob = cad.lathe([(0.03, 0.045), (0.025, 0.07), (0.045, 0.09), (0.0, 0.10)], 20).moved(z=height)
    return _lidded(body, [Part(lid, color), Part(knob, palette.BLACK)], radius, height)


def kettle(variant: int, rng: np.random.Generator) -> Design:
    """A round kettle with a spout, a bow over it, and a lid."""
    color = pick(rng, (palette.CHROME, palette.RED, palette.MINT, palette.NAVY))
    wide, height = ((0.24, 0.26), (0.20, 0.32))[variant % 2]
    profile = [(0.85 * wide, 0.0), (wide, 0.06), (0.9 * wide, 0.6 * height), (0.45 * wide, height), (0.0, height)]
    body = [Part(cad.lathe(cad.smooth(profile[:-1], 3), 36), color)]
    spout = cad.pipe(
        [(0.75 * wide, 0, 0.4 * height), (1.2 * wide, 0, 0.7 * height), (1.4 * wide, 0, height)], 0.035, 12
    )
    bow = [(-0.8 * wide, 0, 0.7 * height), (-0.7 * wide, 0, height + 0.12), (0.0, 0, height + 0.17)]
    bow += [(-x, y, z) for x, y, z in bow[1::-1]]
    body += [Part(spout, color), Part(cad.pipe(cad.bent(bow, 0.05), 0.016, 10), palette.BLACK)]
    lid = cad.lathe([(0.46 * wide, height - 0.005), (0.4 * wide, height + 0.02), (0.0, height + 0.04)], 28)
    return _lidded(body, [Part(lid, palette.BLACK)], 0.45 * wide, height)


def fan(variant: int, rng: np.random.Generator) -> Design:
    """A fan of three or four blades in a ring; where it has run its blades stand elsewhere."""
    metal, color = pick(rng, palette.METALS), pick(rng, (palette.WHITE, palette.SKY, palette.CORAL, palette.BIRCH))
    blades = 3 + variant % 2
    body = [Part(cad.torus(0.36, 0.018, 44, 8).moved(z=0.09), metal), Part(cad.lathe([(0.10, 0), (0.06, 0.05)]), metal)]
    for angle in np.arange(4) * np.pi / 2 + np.pi / 4:
        foot = (0.36 * float(np.cos(angle)), 0.36 * float(np.sin(angle)), 0.0)
        body.append(Part(rod(foot, (foot[0], foot[1], 0.09), 0.014), metal))
    wing = cad.prism(cad.ellipse(0.24, 0.12, 24), 0.0, 0.014, bevel=0.004).moved(0.19)
    parts = [Part(cad.lathe([(0.07, -0.01), (0.06, 0.04), (0.0, 0.05)], 24).moved(z=0.06), palette.GRAPHITE)]
    parts += [Part(wing.moved(z=0.075).turned("z", 2 * np.pi * k / blades), color) for k in range(blades)]
    link = MovingLink(parts, "revolute", (0, 0, 0.06), (0, 0, 1), 0.0, np.pi, None, "blades")
    return Design("Door", DOOR_SCALE, body, [link], states=((0.0,), (np.pi / blades,)))
