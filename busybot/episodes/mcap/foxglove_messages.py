"""An episode in Foxglove's schemas, for viewers that know nothing of this project: a camera, a board, arrows, a log.

Nothing is read back from these messages; what they say stands exactly in the file's own messages and attachments.
"""

from collections.abc import Sequence

import numpy as np
from foxglove import messages as fg

from busybot.boards.directions import DIRECTIONS
from busybot.boards.spec import BoardSpec
from busybot.episodes.episode import Camera, Step
from busybot.episodes.mcap.channels import BOARD_FRAME, CAMERA_FRAME

_ROLE_COLOR = {"trigger": (0.9, 0.5, 0.1), "responder": (0.1, 0.5, 0.9)}
_ARROW_LENGTH = 0.3


def _stamp(frame: int) -> fg.Timestamp:
    return fg.Timestamp(sec=frame, nsec=0)


def _vector(values: Sequence[float] | np.ndarray) -> fg.Vector3:
    return fg.Vector3(x=float(values[0]), y=float(values[1]), z=float(values[2]))


def _color(rgb: Sequence[float]) -> fg.Color:
    return fg.Color(r=rgb[0], g=rgb[1], b=rgb[2], a=1)


def _quaternion(xyzw: Sequence[float]) -> fg.Quaternion:
    return fg.Quaternion(x=xyzw[0], y=xyzw[1], z=xyzw[2], w=xyzw[3])


def _pose(position: Sequence[float] | np.ndarray, orientation: fg.Quaternion | None = None) -> fg.Pose:
    return fg.Pose(position=_vector(position), orientation=orientation or _quaternion((0, 0, 0, 1)))


def calibration(camera: Camera) -> fg.CameraCalibration:
    """Intrinsics without distortion, pixels."""
    matrix = camera.matrix.astype(float)
    projection = np.hstack([matrix, np.zeros((3, 1))])
    return fg.CameraCalibration(
        timestamp=_stamp(0),
        frame_id=CAMERA_FRAME,
        width=camera.width,
        height=camera.height,
        K=matrix.ravel().tolist(),
        R=np.eye(3).ravel().tolist(),
        P=projection.ravel().tolist(),
    )


def transforms(camera: Camera) -> fg.FrameTransforms:
    """The camera in the board's frame."""
    transform = fg.FrameTransform(
        timestamp=_stamp(0),
        parent_frame_id=BOARD_FRAME,
        child_frame_id=CAMERA_FRAME,
        translation=_vector(camera.pose[:3, 3]),
        rotation=_quaternion(quaternion(camera.pose[:3, :3])),
    )
    return fg.FrameTransforms(transforms=[transform])


def quaternion(rotation: np.ndarray) -> tuple[float, float, float, float]:
    """Rotation matrix (3, 3) to a unit quaternion x, y, z, w with w >= 0."""
    r = np.asarray(rotation, float)
    squares = 1 + np.array([[1, -1, -1], [-1, 1, -1], [-1, -1, 1], [1, 1, 1]]) @ np.diag(r)
    largest = int(np.argmax(squares))
    skew = {(0, 3): r[2, 1] - r[1, 2], (1, 3): r[0, 2] - r[2, 0], (2, 3): r[1, 0] - r[0, 1]}
    products = skew | {(i, j): r[i, j] + r[j, i] for i, j in ((0, 1), (0, 2), (1, 2))}
    products |= {(j, i): value for (i, j), value in products.items()} | {(largest, largest): squares[largest]}
    values = np.array([products[largest, i] for i in range(4)]) / (2 * np.sqrt(squares[largest]))
    x, y, z, w = (values if values[3] >= 0 else -values).tolist()
    return x, y, z, w


def board(spec: BoardSpec, positions: np.ndarray) -> fg.SceneEntity:
    """The surface, and a ball in the role's colour at each visible object's centre."""
    surface = fg.CubePrimitive(pose=_pose((0, 0, -0.02)), size=_vector((*spec.size, 0.04)), color=_color(spec.color))
    balls = [
        fg.SpherePrimitive(pose=_pose(position), size=_vector((0.1, 0.1, 0.1)), color=_color(_ROLE_COLOR[placed.role]))
        for placed, position in zip(spec.objects, positions, strict=True)
        if np.isfinite(position).all()
    ]
    return fg.SceneEntity(timestamp=_stamp(0), frame_id=BOARD_FRAME, id="board", cubes=[surface], spheres=balls)


def scene(board: fg.SceneEntity, action: fg.SceneEntity | None = None) -> fg.SceneUpdate:
    """All that shows: after a jump in time a viewer asks for the last message of a topic alone."""
    return fg.SceneUpdate(entities=[board] if action is None else [board, action])


def action(step: Step, index: int) -> fg.SceneEntity:
    """An arrow where and how the gripper was told to pull; it replaces the one before."""
    arrow = fg.ArrowPrimitive(
        pose=_pose(step.position, _quaternion(towards(DIRECTIONS[step.direction]))),
        shaft_length=0.7 * _ARROW_LENGTH,
        shaft_diameter=0.03,
        head_length=0.3 * _ARROW_LENGTH,
        head_diameter=0.07,
        color=_color((0.9, 0.1, 0.3)),
    )
    return fg.SceneEntity(timestamp=_stamp(index), frame_id=BOARD_FRAME, id="action", arrows=[arrow])


def towards(direction: np.ndarray) -> tuple[float, float, float, float]:
    """The rotation (x, y, z, w) that turns +x, along which Foxglove's arrows point, to a unit direction."""
    w = 1.0 + float(direction[0])
    if w < 1e-9:
        return 0.0, 0.0, 1.0, 0.0
    y, z = -float(direction[2]), float(direction[1])
    norm = float(np.sqrt(w * w + y * y + z * z))
    return 0.0, y / norm, z / norm, w / norm


def sentence(step: Step, index: int) -> fg.Log:
    """What an onlooker would say about the step."""
    along = "({:+.2f}, {:+.2f}, {:+.2f})".format(*DIRECTIONS[step.direction])
    seen = f"{step.changed_pixels} pixels changed, reward {step.reward}"
    message = f"step {index}: pixel {tuple(step.pixel)}, direction {along}, {seen}"
    return fg.Log(timestamp=_stamp(index), level=fg.LogLevel.Info, name="busybot", message=message)


def joints(names: Sequence[str], positions: Sequence[float], frame: int) -> fg.JointStates:
    """Positions of the trigger links' joints."""
    states = [fg.JointState(name=name, position=p) for name, p in zip(names, positions, strict=True)]
    return fg.JointStates(timestamp=_stamp(frame), joints=states)
