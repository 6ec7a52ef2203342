"""The design of a procedural object before it is written: materials, parts, links, annotation.

Designs are in board units, upright: x right, y up in the picture, z to the camera, the board's surface at z = 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from busybot.objects.procedural.cad import Solid, joined

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Material:
    """A named colour; `shine` between 0 (chalk) and 1 (polished)."""

    name: str
    color: Vector
    shine: float = 0.3


@dataclass(frozen=True, eq=False)
class Part:
    solid: Solid
    material: Material

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Part":
        return Part(self.solid.moved(x, y, z), self.material)

    def turned(self, axis: str, angle: float) -> "Part":
        return Part(self.solid.turned(axis, angle), self.material)


@dataclass(frozen=True, eq=False)
class MovingLink:
    """A link that moves against the body (or against `parent`, the index of another moving link).

    Attributes:
        parts: where they are in the design at joint position 0; none for a bare connector.
        origin: a point on the axis.
        axis: unit vector.
        lower, upper: radians, or board units for `prismatic`.
        kind: of a trigger, `small` (two states) or `large` (three); None for links that only responders move.
    """

    parts: Sequence[Part]
    joint_type: Literal["revolute", "prismatic"]
    origin: Vector
    axis: Vector
    lower: float
    upper: float
    kind: Literal["small", "large"] | None = None
    label: str = "part"
    parent: int | None = None


@dataclass(frozen=True, eq=False)
class Shade:
    """The painted link of a lamp: fixed to the body.

    Attributes:
        colors: RGB of the single-stage on state, and of the steps 1 and 2.
    """

    parts: Sequence[Part]
    colors: tuple[Vector, Vector, Vector]


@dataclass(frozen=True, eq=False)
class Design:
    """A whole object.

    Attributes:
        scale: the annotation's Scale; meshes are written in board units divided by it.
        directions: annotated effective directions of a trigger.
        states: of a `joint` responder with two states, one position per moving link.
        steps: of a `joint` responder with three.
    """

    category: str
    scale: float
    body: Sequence[Part]
    links: Sequence[MovingLink] = ()
    shade: Shade | None = None
    directions: tuple[Vector, ...] = ()
    states: tuple[tuple[float, ...], ...] | None = None
    steps: tuple[tuple[float, ...], ...] | None = None
    name: str = "object"


SWITCH_SCALE, LAMP_SCALE, DOOR_SCALE, TOY_SCALE = 0.25, 0.5, 0.4, 0.4
"""Like the annotated objects': with mass 10 and unit inertia before scaling, the links weigh as much as theirs."""


# Annotated directions of triggers: of what tilts or is pressed, in the plane of x or y and z; of what slides or is
# thrown along x or y; of what turns about z and points along x.
_TILTS = ((-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (1.0, 1.0), (0.0, 1.0), (0.0, -1.0))
HINGE_X: tuple[Vector, ...] = tuple((across, 0.0, z) for across, z in _TILTS)
HINGE_Y: tuple[Vector, ...] = tuple((0.0, across, z) for across, z in _TILTS)
SLIDE_X: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
SLIDE_Y: tuple[Vector, ...] = ((0.0, 1.0, 0.0), (0.0, -1.0, 0.0))
TURN_Z: tuple[Vector, ...] = (*SLIDE_Y, (1.0, 1.0, 0.0), (-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (-1.0, 1.0, 0.0))


def switch(
    body: Sequence[Part], links: Sequence[MovingLink], directions: tuple[Vector, ...], quarters: int = 0
) -> Design:
    """A trigger, turned by quarter turns about z: on the board, switches are never turned."""
    return facing(Design("Switch", SWITCH_SCALE, body, links, directions=directions), quarters)


def facing(design: Design, quarters: int) -> Design:
    """The design turned by quarter turns about z."""
    cosine, sine = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[quarters % 4]

    def turned(vector: Vector) -> Vector:
        x, y, z = vector
        return (cosine * x - sine * y + 0.0, sine * x + cosine * y + 0.0, z)

    angle = (quarters % 4) * np.pi / 2
    links = [
        replace(
            link,
            parts=[part.turned("z", angle) for part in link.parts],
            origin=turned(link.origin),
            axis=turned(link.axis),
        )
        for link in design.links
    ]
    body = [part.turned("z", angle) for part in design.body]
    return replace(design, body=body, links=links, directions=tuple(turned(d) for d in design.directions))


def by_material(parts: Sequence[Part]) -> list[tuple[Material, Solid]]:
    """The parts of each material as one solid, in order of first use."""
    groups: dict[Material, list[Solid]] = {}
    for part in parts:
        groups.setdefault(part.material, []).append(part.solid)
    return [(material, joined(solids)) for material, solids in groups.items()]


def shifted(parts: Sequence[Part], offset: Sequence[float]) -> list[Part]:
    """The parts moved by a vector."""
    x, y, z = np.asarray(offset, dtype=np.float64).tolist()
    return [part.moved(x, y, z) for part in parts]
