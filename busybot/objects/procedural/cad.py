"""Surfaces for procedural objects: outlines, lofts between rings, lathes and sweeps, all with rounded edges.

An *outline* is a counter-clockwise polygon in the plane, (n, 2), star-shaped around its mean. A *ring* is a closed
curve in space, (n, 3). Everything is made of rings with equal numbers of points, joined one after the other, so no
boolean operations are needed. Lengths are in the designer's units (board units); z points up.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

Profile = Sequence[tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Solid:
    """A triangle mesh: vertices (n, 3), faces (m, 3), counter-clockwise from outside."""

    vertices: np.ndarray
    faces: np.ndarray

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Solid":
        return Solid(self.vertices + np.array([x, y, z]), self.faces)

    def turned(self, axis: str, angle: float) -> "Solid":
        """Turn about the axis `x`, `y` or `z` through the origin, radians."""
        first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
        matrix = np.eye(3)
        matrix[first, first] = matrix[second, second] = np.cos(angle)
        matrix[second, first], matrix[first, second] = np.sin(angle), -np.sin(angle)
        return Solid(self.vertices @ matrix.T, self.faces)

    def stretched(self, x: float = 1.0, y: float = 1.0, z: float = 1.0) -> "Solid":
        """Scale along the axes; factors must be positive."""
        return Solid(self.vertices * np.array([x, y, z]), self.faces)


def joined(solids: Sequence[Solid]) -> Solid:
    """Several solids as one; they may touch or overlap."""
    offsets = np.cumsum([0, *(len(solid.vertices) for solid in solids)])
    faces = [solid.faces + offset for solid, offset in zip(solids, offsets, strict=False)]
    return Solid(np.concatenate([solid.vertices for solid in solids]), np.concatenate(faces))


def circle(radius: float, points: int = 24, phase: float = 0.0) -> np.ndarray:
    angle = np.arange(points) * 2 * np.pi / points + phase
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def ellipse(width: float, height: float, points: int = 28) -> np.ndarray:
    return circle(1.0, points) * np.array([width / 2, height / 2])


def rectangle(width: float, height: float, radius: float = 0.0, corner: int = 4) -> np.ndarray:
    """A rectangle around the origin with rounded corners of `corner` segments each."""
    radius = min(radius, 0.499 * width, 0.499 * height)
    quarter = np.linspace(0, np.pi / 2, corner + 1)
    arc = radius * np.stack([np.cos(quarter), np.sin(quarter)], axis=1)
    parts = []
    for k, (sx, sy) in enumerate([(1, 1), (-1, 1), (-1, -1), (1, -1)]):
        cosine, sine = np.cos(k * np.pi / 2), np.sin(k * np.pi / 2)
        turn = np.array([[cosine, sine], [-sine, cosine]])
        parts.append(arc @ turn + np.array([sx * (width / 2 - radius), sy * (height / 2 - radius)]))
    return np.concatenate(parts)


def wavy(radius: float, depth: float, lobes: int, points_per_lobe: int = 8) -> np.ndarray:
    """A wavy circle: radius plus or minus `depth`; knurls with many lobes, petals with few."""
    angle = np.arange(lobes * points_per_lobe) * 2 * np.pi / (lobes * points_per_lobe)
    distance = radius + depth * np.cos(lobes * angle)
    return np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=1)


def inset(outline: np.ndarray, distance: float) -> np.ndarray:
    """The outline moved inwards along its normals (outwards when negative); corners are mitred."""
    if distance == 0:
        return outline
    edges = np.roll(outline, -1, axis=0) - outline
    lengths = np.linalg.norm(edges, axis=1, keepdims=True)
    normals = np.stack([-edges[:, 1], edges[:, 0]], axis=1) / np.maximum(lengths, 1e-9)
    before = np.roll(normals, 1, axis=0)
    bisector = normals + before
    cosine = np.maximum((bisector * normals).sum(axis=1, keepdims=True), 0.5)
    return outline + distance * bisector / cosine


def ring(outline: np.ndarray, z: float) -> np.ndarray:
    return np.concatenate([outline, np.full((len(outline), 1), float(z))], axis=1)


def loft(rings: Sequence[np.ndarray], tips: tuple[np.ndarray | None, np.ndarray | None] | None = None) -> Solid:
    """Join rings, counter-clockwise seen from the last one; fans to `tips`, or else to their means, close the ends."""
    count, points = len(rings), len(rings[0])
    tips = tips or (None, None)
    apexes = [rings[end].mean(axis=0) if tip is None else tip for end, tip in zip((0, -1), tips, strict=True)]
    vertices = np.concatenate([*rings, np.array(apexes)])
    here = np.arange(points)
    ahead = (here + 1) % points
    faces = _bands(count, here, ahead, points)
    first, last = count * points, count * points + 1
    faces.append(np.stack([np.full(points, first), ahead, here], axis=1))
    top = (count - 1) * points
    faces.append(np.stack([np.full(points, last), top + here, top + ahead], axis=1))
    return Solid(vertices, np.concatenate(faces))


def closed_loft(rings: Sequence[np.ndarray]) -> Solid:
    """Join rings and the last with the first: frames and tori."""
    points = len(rings[0])
    here = np.arange(points)
    faces = _bands(len(rings) + 1, here, (here + 1) % points, points)
    return Solid(np.concatenate(rings), np.concatenate(faces) % (len(rings) * points))


def _bands(count: int, here: np.ndarray, ahead: np.ndarray, points: int) -> list[np.ndarray]:
    faces = []
    for band in range(count - 1):
        low, high = band * points, (band + 1) * points
        faces.append(np.stack([low + here, low + ahead, high + ahead], axis=1))
        faces.append(np.stack([low + here, high + ahead, high + here], axis=1))
    return faces


def _edge(
    outline: np.ndarray, z: float, size: float, steps: int, inwards: float = 1.0, upwards: float = 1.0
) -> list[np.ndarray]:
    """Rings of a quarter round from the side of an outline to its flat face at `z`; a single one if `size` is 0."""
    if not size:
        return [ring(outline, z)]
    angles = np.linspace(0, np.pi / 2, steps + 1).tolist()
    rounding = [(size * (1 - float(np.cos(a))), size * (1 - float(np.sin(a)))) for a in angles]
    return [ring(inset(outline, inwards * distance), z - upwards * drop) for distance, drop in rounding]


def prism(
    outline: np.ndarray, bottom: float, top: float, bevel: float = 0.0, foot: float = 0.0, steps: int = 2
) -> Solid:
    """An upright prism with a rounded upper edge (`bevel`) and lower edge (`foot`)."""
    return loft([*_edge(outline, bottom, foot, steps, upwards=-1)[::-1], *_edge(outline, top, bevel, steps)])


def box(x: float, y: float, z: float, bevel: float = 0.0) -> Solid:
    """A box on z = 0 around the z axis."""
    return prism(rectangle(x, y, max(bevel, 1e-4), corner=2 if bevel else 1), 0.0, z, bevel, steps=2 if bevel else 1)


def frame(outer: np.ndarray, inner: np.ndarray, bottom: float, top: float, bevel: float = 0.0, steps: int = 2) -> Solid:
    """A prism with a hole; the outlines must have equally many points that match by index."""
    inside = [*_edge(inner, top, bevel, steps, inwards=-1)[::-1], ring(inner, bottom)]
    return closed_loft([ring(outer, bottom), *_edge(outer, top, bevel, steps), *inside])


def matching_circle(outline: np.ndarray, radius: float) -> np.ndarray:
    """Points of a circle in the directions of an outline's points: the round hole of a plate."""
    return radius * outline / np.linalg.norm(outline, axis=1, keepdims=True)


def lathe(profile: Profile, points: int = 28) -> Solid:
    """Turn (radius, z) pairs, from bottom to top on the outside, about z. A radius of 0 at an end makes a tip."""
    kept = list(profile)
    low, high = (np.array([0.0, 0.0, kept.pop(end)[1]]) if kept[end][0] == 0 else None for end in (0, -1))
    return loft([ring(circle(radius, points), z) for radius, z in kept], (low, high))


def smooth(profile: Profile, samples: int = 4) -> list[tuple[float, float]]:
    """A Catmull-Rom curve through the profile's points: turned wood, blown glass."""
    given = np.array(profile, dtype=np.float64)
    padded = np.concatenate([2 * given[:1] - given[1:2], given, 2 * given[-1:] - given[-2:-1]])
    curve = []
    for k in range(len(given) - 1):
        a, b, c, d = padded[k : k + 4]
        for t in np.arange(samples) / samples:
            point = 0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3)
            curve.append((max(float(point[0]), 0.0), float(point[1])))
    return [*curve, (float(given[-1, 0]), float(given[-1, 1]))]


def ball(radius: float, points: int = 24, rows: int = 10) -> Solid:
    """A sphere around the origin."""
    angles = np.linspace(-np.pi / 2, np.pi / 2, rows + 1)
    profile = [(radius * float(np.cos(a)), radius * float(np.sin(a))) for a in angles]
    profile[0], profile[-1] = (0.0, -radius), (0.0, radius)
    return lathe(profile, points)


def torus(radius: float, thickness: float, points: int = 28, section: int = 8) -> Solid:
    """A ring around the z axis; `thickness` is the radius of its wire."""
    angles = np.arange(section) * 2 * np.pi / section
    return closed_loft([ring(circle(radius + thickness * np.cos(a), points), thickness * np.sin(a)) for a in angles])


def sweep(path: np.ndarray, section: np.ndarray) -> Solid:
    """Draw a section, (k, 2) counter-clockwise, along a path, (n, 3). The section's y stays as upright as possible."""
    path = np.asarray(path, dtype=np.float64)
    tangents = np.gradient(path, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    up = np.array([0.0, 0.0, 1.0]) if np.abs(tangents[:, 2]).max() < 0.95 else np.array([0.0, 1.0, 0.0])
    if np.abs(tangents @ up).max() > 0.95:
        up = np.array([1.0, 0.0, 0.0])
    rings = []
    for point, tangent in zip(path, tangents, strict=True):
        side = np.cross(up, tangent)
        side /= np.linalg.norm(side)
        rings.append(point + section[:, :1] * side + section[:, 1:] * np.cross(tangent, side))
    return loft(rings)


def pipe(path: Sequence[tuple[float, float, float]] | np.ndarray, radius: float, points: int = 10) -> Solid:
    """A round wire along a path."""
    return sweep(np.asarray(path, dtype=np.float64), circle(radius, points))


def bent(path: Sequence[tuple[float, float, float]], radius: float, steps: int = 4) -> np.ndarray:
    """A polyline with rounded corners."""
    points = [np.array(point, dtype=np.float64) for point in path]
    result = [points[0]]
    for before, corner, after in zip(points, points[1:], points[2:], strict=False):
        reach = min(radius, 0.49 * float(np.linalg.norm(before - corner)), 0.49 * float(np.linalg.norm(after - corner)))
        start = corner + (before - corner) / np.linalg.norm(before - corner) * reach
        end = corner + (after - corner) / np.linalg.norm(after - corner) * reach
        for t in np.linspace(0, 1, steps + 1):
            result.append((1 - t) ** 2 * start + 2 * t * (1 - t) * corner + t**2 * end)
    return np.array([*result, points[-1]])
