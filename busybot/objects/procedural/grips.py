"""Grips in many shapes: caps to press, grips to slide, heads of levers. Made of one solid or a few.

Everything stands around the z axis. Caps have their upper rim at z = 0 and a skirt below; grips and heads stand on it.
"""

from collections.abc import Sequence

import numpy as np

from busybot.objects.procedural import cad, fixtures, palette
from busybot.objects.procedural.design import Material, Part, shifted

OUTLINES = ("round", "square", "oval", "octagon", "stadium", "triangle", "flower")
PROFILES = ("flat", "domed", "dished", "stepped", "conical")
HEADS = ("ball", "bar", "cube", "coin", "egg", "drum", "fin")
GRIPS = ("ridged", "fin", "post", "barrel", "dome", "saddle", "disc")


def outline(kind: str, size: float) -> np.ndarray:
    """A convex or nearly convex outline of about `size` from the middle to the rim."""
    return {
        "round": lambda: cad.circle(size, 32),
        "square": lambda: cad.rectangle(1.8 * size, 1.8 * size, 0.25 * size),
        "oval": lambda: cad.ellipse(2.5 * size, 1.6 * size, 32),
        "octagon": lambda: cad.circle(size, 8, np.pi / 8),
        "stadium": lambda: cad.rectangle(2.7 * size, 1.3 * size, 0.65 * size, 7),
        "triangle": lambda: cad.wavy(size, 0.11 * size, 3, 12),
        "flower": lambda: cad.wavy(size, 0.09 * size, 5, 8),
    }[kind]()


def cap_on(rim: np.ndarray, profile: str, skirt: float = 0.03) -> cad.Solid:
    """A cap to press; its sides go down to -skirt."""
    size = float(np.linalg.norm(rim, axis=1).min())
    foot = cad.ring(rim, -skirt)
    if profile == "domed":
        angles = np.linspace(0, 0.9 * np.pi / 2, 6)
        dome = [cad.ring(np.cos(a) * rim, 0.45 * size * float(np.sin(a))) for a in angles]
        tip = np.array([0, 0, 0.46 * size])
        return cad.loft([foot, *dome], (None, tip))
    if profile == "dished":
        rows = ((0.0, -0.008), (0.002, -0.002), (0.008, 0.0), (0.25 * size, -0.003), (0.6 * size, -0.010))
        return cad.loft([foot, *(cad.ring(_shrunk(rim, d), z) for d, z in rows)])
    if profile == "stepped":
        rows = ((0.0, -0.012), (0.004, -0.008), (0.22 * size, -0.007), (0.24 * size, 0.006), (0.28 * size, 0.010))
        return cad.loft([foot, *(cad.ring(_shrunk(rim, d), z) for d, z in rows)])
    if profile == "conical":
        shares = ((1.0, -0.004), (0.62, 0.34 * size), (0.54, 0.36 * size))
        return cad.loft([foot, *(cad.ring(share * rim, z) for share, z in shares)])
    return cad.prism(rim, -skirt, 0.0, bevel=min(0.012, 0.2 * size), steps=3)


def _shrunk(rim: np.ndarray, distance: float) -> np.ndarray:
    """The outline shrunk towards its middle by about a distance; unlike an inset, safe for any of them."""
    return (1 - distance / float(np.linalg.norm(rim, axis=1).min())) * rim


def collar(rim: np.ndarray, width: float, rise: float, material: Material, gap: float = 0.004) -> list[Part]:
    """A frame around a cap of this outline, with a dark well."""
    outer, inner = cad.inset(rim, -(gap + width)), cad.inset(rim, -gap)
    wall = cad.frame(outer, inner, 0, rise, bevel=0.3 * min(width, rise))
    return [Part(wall, material), Part(cad.prism(cad.inset(rim, -(gap + 0.5 * width)), 0, 0.002), palette.SHADOW)]


def head(kind: str, size: float, material: Material) -> list[Part]:
    """What sits on top of a lever, from z = 0 upwards; `size` is about half of its width."""
    coin = [(width * size, z * size) for width, z in ((0.93, -0.3), (1.0, -0.2), (1.0, 0.2), (0.93, 0.3))]
    egg = [(width * size, z * size) for width, z in ((0.4, 0), (0.85, 0.5), (0.95, 1.2), (0.55, 2), (0, 2.2))]
    solid = {
        "ball": lambda: cad.ball(size, 22, 12).moved(z=0.85 * size),
        "bar": lambda: lying(0.55 * size, 3.2 * size).moved(z=0.4 * size),
        "cube": lambda: cad.box(1.6 * size, 1.6 * size, 1.5 * size, 0.25 * size),
        "coin": lambda: cad.lathe(coin, 26).turned("y", np.pi / 2).moved(z=0.9 * size),
        "egg": lambda: cad.lathe(cad.smooth(egg, 3), 22),
        "drum": lambda: cad.prism(cad.wavy(0.85 * size, 0.04 * size, 14, 4), 0, 1.6 * size, bevel=0.15 * size),
        "fin": lambda: cad.box(0.55 * size, 2.6 * size, 1.9 * size, 0.2 * size),
    }[kind]()
    return [Part(solid, material)]


def grip(kind: str, size: float, material: Material, metal: Material) -> list[Part]:
    """What a slider that moves along x is taken by; `size` is half of its length."""
    if kind == "ridged":
        return fixtures.ridged_cap(2 * size, 2.3 * size, 1.1 * size, material)
    if kind == "fin":
        foot = cad.box(2 * size, 2.2 * size, 0.3 * size, 0.1 * size)
        blade = cad.box(0.5 * size, 2.0 * size, 1.3 * size, 0.2 * size)
        return [Part(foot, metal), Part(blade.moved(z=0.25 * size), material)]
    if kind == "post":
        foot = cad.box(2 * size, 2 * size, 0.35 * size, 0.1 * size)
        stem = cad.lathe([(0.3 * size, 0.2 * size), (0.3 * size, 1.4 * size)], 14)
        ball_on_top = shifted(head("ball", 0.75 * size, material), (0, 0, 1.3 * size))
        return [Part(foot, material), Part(stem, metal), *ball_on_top]
    if kind == "barrel":
        return [Part(lying(0.8 * size, 2.4 * size).moved(z=0.55 * size), material)]
    if kind == "dome":
        return [Part(cap_on(cad.circle(size, 28), "domed", 0.02).moved(z=0.25 * size), material)]
    if kind == "disc":
        disc = cad.lathe([(0.95 * size, 0), (size, 0.1 * size), (size, 0.5 * size), (0.9 * size, 0.6 * size)], 28)
        return [Part(disc, material), Part(cad.torus(0.6 * size, 0.1 * size, 22, 6).moved(z=0.58 * size), metal)]
    # a saddle: high at both ends, low in the middle, so that a finger lies in it
    xs = np.linspace(size, -size, 9)
    section = [(-size, 0.0), (size, 0.0), *((float(x), 0.6 * size + 0.5 * float(x) ** 2 / size) for x in xs)]
    return [Part(cad.prism(np.array(section), -1.2 * size, 1.2 * size).turned("x", np.pi / 2), material)]


def lying(radius: float, length: float, points: int = 18) -> cad.Solid:
    """A round bar along y with softened ends."""
    edge, half = 0.2 * radius, length / 2
    rows = [(radius - edge, -half), (radius, -half + edge), (radius, half - edge), (radius - edge, half)]
    return cad.lathe(rows, points).turned("x", np.pi / 2)


def rod(start: Sequence[float], end: Sequence[float], radius: float, points: int = 12) -> cad.Solid:
    """A straight round wire."""
    return cad.pipe(np.linspace(start, end, 3), radius, points)
