"""Forward kinematics over mesh vertices: an object's parts for given joint positions. No simulator.

The annotation's boxes cannot be trusted for placing: on most of the 58 objects y is mirrored (on lamps x too), the
toys' boxes are too small. The layout of a board needs what the object really occupies.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from busybot.objects.partnet.urdf import Joint, Urdf


def rotation(quaternion: Sequence[float]) -> np.ndarray:
    """Rotation matrix (3, 3) of a quaternion (w, x, y, z), normalised here."""
    w, x, y, z = np.asarray(quaternion, dtype=np.float64) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def joint_motion(joint: Joint, position: float) -> np.ndarray:
    """What the joint's position adds to its origin, homogeneous, (4, 4)."""
    result = np.eye(4)
    if joint.type == "prismatic":
        result[:3, 3] = joint.axis * position
    elif joint.type != "fixed":
        half = position / 2
        result[:3, :3] = rotation([np.cos(half), *(np.sin(half) * joint.axis)])
    return result


def link_vertices(
    urdf: Urdf, meshes: Mapping[str, np.ndarray], upright: Sequence[float], positions: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Vertices of every link that shows something.

    Args:
        meshes: vertices by mesh file.
        upright: the annotated orientation (w, x, y, z).
        positions: by joint name, radians or object units; absent joints are at 0.

    Returns:
        By link, (n, 3), upright frame before scaling.
    """
    frames = {urdf.root: np.eye(4)}
    frames[urdf.root][:3, :3] = rotation(upright)
    for joint in urdf.joints:
        motion = joint_motion(joint, positions.get(joint.name, 0.0))
        frames[joint.child] = frames[joint.parent] @ joint.origin @ motion
    result = {}
    for link, shapes in urdf.visuals.items():
        parts = []
        for shape in shapes:
            points = shape.corners if shape.mesh is None else meshes[shape.mesh]
            matrix = frames[link] @ shape.transform
            parts.append(points @ matrix[:3, :3].T + matrix[:3, 3])
        if sum(map(len, parts)):
            result[link] = np.concatenate(parts)
    return result


def bounds(vertices: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner, (3,) each, over all links."""
    lows = [points.min(axis=0) for points in vertices.values()]
    highs = [points.max(axis=0) for points in vertices.values()]
    return np.min(lows, axis=0), np.max(highs, axis=0)


def flatter_first(
    urdf: Urdf, meshes: Mapping[str, np.ndarray], upright: Sequence[float], joint: Joint, ends: tuple[float, float]
) -> tuple[float, float]:
    """The joint's two ends, first the one at which the object is flatter (upright frame): a door is closed there."""

    def height(position: float) -> float:
        low, high = bounds(link_vertices(urdf, meshes, upright, {joint.name: position}))
        return float(high[2] - low[2])

    first, second = sorted(ends, key=height)
    return first, second
