"""Whether one action of the gripper can take a trigger's link into another state.

A link rests in the detents of its states: at the ends of its way, with three states in the middle, too. An action
starts there, pulls at a point of the link along a straight line, and lets go: the link falls back unless it has come
halfway to the next detent. From every detent that is equally far.
"""

from collections.abc import Mapping

import numpy as np

from busybot.objects.partnet.loader import limits
from busybot.objects.partnet.urdf import Joint, Urdf, shape_vertices

REACH = 0.2
"""How far one action takes what it pulls at, board units. The gripper's target goes 0.21 (`InteractionConfig` of
`sim.interaction`), and what weighs little stays up to 0.01 behind; a test compares this with the simulator."""
_SIDES = 72


def pull_needed(urdf: Urdf, meshes: Mapping[str, np.ndarray], joint: Joint, states: int, scale: float) -> float:
    """How far the joint's link has to be pulled before its state changes, at least, board units.

    A sliding link has to go the whole way. A hinged one is turned with the shortest pull at what is nearest to the
    axis, straight to the line from the axis at which the state changes.

    Args:
        states: of the link, 2 or 3.
    """
    lower, upper = limits(joint)
    way = (upper - lower) / (2 * (states - 1))
    if joint.type == "prismatic":
        return way * scale
    return float(np.sin(min(way, np.pi / 2))) * _radius(urdf, meshes, joint) * scale


def _radius(urdf: Urdf, meshes: Mapping[str, np.ndarray], joint: Joint) -> float:
    """How near the joint's link comes to the axis, at least, with what it carries: the distance of the hull of their
    vertices, which may be held, too."""
    across = np.linalg.svd(joint.axis[None])[2][1:]
    frames = {joint.child: np.eye(4)}
    for other in urdf.joints:  # from the root on
        if other.parent in frames:
            frames[other.child] = frames[other.parent] @ other.origin
    held = [shape_vertices(urdf.visuals.get(link, ()), meshes, frame) for link, frame in frames.items()]
    points = np.concatenate(held) @ across.T
    angles = np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
    sides = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    # the hull is beyond a line at this distance, on one of the sides
    return max(0.0, *(float((points @ side).min()) for side in sides))


def out_of_reach(
    urdf: Urdf, meshes: Mapping[str, np.ndarray], joint: Joint, states: int, scale: float
) -> tuple[str, float] | None:
    """What is wrong with a link that no action can take into another state, and the scale at which one could.

    Returns:
        None when nothing is.
    """
    needed = pull_needed(urdf, meshes, joint, states, scale)
    if needed <= REACH + 1e-9:
        return None
    what = f"{joint.child} has to be pulled {needed:.3g} board units to change its state, one action pulls {REACH}"
    return f"{what}: nothing can move it", _rounded_down(scale * REACH / needed)


def _rounded_down(value: float) -> float:
    """Two digits of a number, not above it."""
    unit = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(f"{np.floor(value / unit) * unit:.2g}")
