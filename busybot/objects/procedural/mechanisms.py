"""Joints of training switches: pressed, swung, hinged at an end, slid along x, turned about z.

Parts are given around the origin, or around the hinge; `at` says where that is on the object.
"""

from collections.abc import Sequence
from typing import Literal

from busybot.objects.procedural.design import MovingLink, Part, Vector, shifted

Kind = Literal["small", "large"]
TURNING = ((0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (-1.0, 1.0, 0.0))
"""Annotated directions of what turns about z and points along x."""


def pressed(parts: Sequence[Part], at: Vector, travel: float) -> MovingLink:
    """Straight down by `travel`."""
    return MovingLink(shifted(parts, at), "prismatic", at, (0, 0, -1), 0.0, travel, "small", "button")


def swung(parts: Sequence[Part], at: Vector, swing: float, kind: Kind = "small", label: str = "lever") -> MovingLink:
    """To both sides along x, by `swing` radians each."""
    return MovingLink(shifted(parts, at), "revolute", at, (0, 1, 0), -swing, swing, kind, label)


def lifted(parts: Sequence[Part], at: Vector, angle: float) -> MovingLink:
    """Hinged at `at`: what lies at higher x comes up by `angle` radians."""
    return MovingLink(shifted(parts, at), "revolute", at, (0, -1, 0), 0.0, angle, "small", "lever")


def trodden(parts: Sequence[Part], at: Vector, angle: float) -> MovingLink:
    """Hinged at `at`: what lies at higher x goes down by `angle` radians."""
    return MovingLink(shifted(parts, at), "revolute", at, (0, 1, 0), 0.0, angle, "small", "pedal")


def slid(parts: Sequence[Part], at: Vector, travel: float, kind: Kind = "small") -> MovingLink:
    """Along x, by half of `travel` to both sides."""
    return MovingLink(shifted(parts, at), "prismatic", at, (1, 0, 0), -travel / 2, travel / 2, kind, "slider")


def turned(parts: Sequence[Part], at: Vector, swing: float, kind: Kind = "small") -> MovingLink:
    """About z, by `swing` radians to both sides."""
    return MovingLink(shifted(parts, at), "revolute", at, (0, 0, 1), -swing, swing, kind, "knob")
