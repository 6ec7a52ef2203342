"""Measures which links of a raw object move, how far and which way, on the vertices at both ends of each joint."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from busybot.objects.importing.raw import IDENTITY, RawObject
from busybot.objects.partnet.kinematics import link_vertices
from busybot.objects.partnet.loader import limits
from busybot.objects.partnet.urdf import Joint

FLAT = 0.02
"""A hinge whose link leaves the plane by less than this share of its travel turns about the line of sight."""


@dataclass(frozen=True, eq=False)
class Moving:
    """A link that moves.

    Attributes:
        low, high: its vertices at the joint's lower and upper limit, (n, 3), URDF frame; the other joints rest.
        face: area of the largest face of its box.
    """

    joint: Joint
    low: np.ndarray
    high: np.ndarray
    face: float

    @property
    def link(self) -> str:
        return self.joint.child

    @property
    def slides(self) -> bool:
        return self.joint.type == "prismatic"


def rest(joint: Joint) -> float:
    """The position at rest: 0, or the limit nearest to it."""
    return float(np.clip(0.0, *limits(joint)))


def shown(raw: RawObject, positions: Mapping[str, float] = MappingProxyType({})) -> dict[str, np.ndarray]:
    """Vertices of every link that shows something, URDF frame; joints that are not named rest."""
    resting = {joint.name: rest(joint) for joint in raw.urdf.joints if joint.type != "fixed"}
    return link_vertices(raw.urdf, raw.meshes, IDENTITY, resting | dict(positions))


def moving_links(raw: RawObject) -> list[Moving]:
    """The links that move, in the joints' order."""
    found = []
    for joint in raw.urdf.joints:
        lower, upper = limits(joint)
        if joint.type == "fixed" or (joint.type == "prismatic" and joint.lower is None) or upper - lower < 1e-6:
            continue
        low, high = (shown(raw, {joint.name: end}).get(joint.child) for end in (lower, upper))
        if low is not None and high is not None:
            found.append(Moving(joint, low, high, face(np.ptp(low, axis=0))))
    return found


def face(size: np.ndarray) -> float:
    """Area of the largest face of a box."""
    return float(np.prod(np.sort(size)[1:]))


def travel(motion: np.ndarray) -> float:
    """How far a link travels along the board; 0 when it moves more toward the camera or away.

    Args:
        motion: what each vertex does from one end to the other, (n, 3), upright frame.
    """
    along = float(np.linalg.norm(motion[:, :2], axis=1).max())
    return along if along > np.abs(motion[:, 2]).max() else 0.0


def ways(moving: Moving, motion: np.ndarray) -> list[tuple[float, float, float]]:
    """Directions that move the link, upright frame, each with its opposite; the rule is in `auto_annotation`."""
    x, y = _axis(motion)
    along = travel(motion)
    if not along:
        return _both([(0.0, 0.0, 1.0), (x, y, 1.0), (x, y, -1.0)])
    if not moving.slides and np.abs(motion[:, 2]).max() < FLAT * along:
        return _both([(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
    return _both([(x, y, 0.0)])


def _both(directions: Iterable[tuple[float, float, float]]) -> list[tuple[float, float, float]]:
    return [way for x, y, z in directions for way in ((x, y, z), (0.0 - x, 0.0 - y, 0.0 - z))]


def _axis(motion: np.ndarray) -> tuple[float, float]:
    """Which way along the board the link travels or tilts: one of x, y and their diagonals; x when it does neither."""
    plane = motion[np.linalg.norm(motion[:, :2], axis=1).argmax(), :2]
    largest = plane[np.abs(plane).argmax()]
    if abs(largest) < 1e-6:
        return 1.0, 0.0
    x, y = np.round(plane / largest)
    return float(x) + 0.0, float(y) + 0.0
