"""Refuses episodes that contradict themselves, before they are written and after they are read."""

from collections.abc import Sequence
from typing import NoReturn

import numpy as np

from busybot.boards.directions import DIRECTIONS
from busybot.common.errors import BusybotError
from busybot.common.limits import MAX_IMAGE_PIXELS, MAX_PIXELS
from busybot.episodes.codec import MAX_SIDE
from busybot.episodes.episode import Camera, Episode, Image, Step
from busybot.episodes.schema import STEP_FIELDS, UNKNOWN_PIXEL

MAX_LINKS = 65535
MAX_STATE = 127
MAX_MEMORY = 65_536
MAX_LENGTH = 1e6
"""Board units or radians: beyond any reason."""
_BEFORE_AND_AFTER = [
    (one.name.removesuffix("_before"), str(one.shape[0]), MAX_STATE if one.compared == "state" else MAX_LENGTH)
    for one in STEP_FIELDS
    if one.name.endswith("_before") and one.shape
]
HINT = "record the episode again"


def check_episode(episode: Episode) -> None:
    """Everything that can be told without looking at pixels; `check_image` looks at one image.

    Raises:
        BusybotError: naming the contradiction; the caller names the file.
    """
    check_camera(episode.camera)
    board, objects = episode.board, len(episode.board.objects)
    if board.seed >= 2**63 or max(board.index, board.appearance_group) >= 2**31:
        _refuse("the board's seed, index or appearance group is too large for the tables")
    if np.shape(episode.positions) != (objects, 3) or (np.abs(episode.positions) > MAX_LENGTH).any():
        _refuse(f"positions of shape {np.shape(episode.positions)} for {objects} objects, or beyond {MAX_LENGTH:g}")
    if len(episode.links) > MAX_LINKS or any(not 0 <= link.object < objects for link in episode.links):
        _refuse(f"a link belongs to an object that the board with its {objects} objects does not have")
    check_frames(episode.frame_of, len(episode.steps), len(episode.images))
    images, camera = len(episode.images) + len(episode.goals), episode.camera
    if images * camera.width * camera.height > MAX_PIXELS:
        _refuse(f"{images} images of {camera.width} x {camera.height} pixels (at most {MAX_PIXELS} in all)")
    if len(episode.goals) > 1:
        _refuse(f"{len(episode.goals)} goal images, at most one is expected")
    triggers = sum(link.trigger for link in episode.links)
    for index, step in enumerate(episode.steps):
        fault = _fault_of_action(step, episode.camera) or _fault_of_truth(step, objects, triggers)
        if fault:
            _refuse(f"step {index}: {fault}")


def check_camera(camera: Camera) -> None:
    """Size of the images, shapes of the matrices."""
    if not (0 < camera.width <= MAX_SIDE and 0 < camera.height <= MAX_SIDE):
        _refuse(f"images of {camera.width} x {camera.height} pixels (at most {MAX_SIDE} a side)")
    if camera.width * camera.height > MAX_IMAGE_PIXELS:
        _refuse(f"images of {camera.width} x {camera.height} pixels (at most {MAX_IMAGE_PIXELS} in all)")
    for name, value, shape in (("matrix", camera.matrix, (3, 3)), ("pose", camera.pose, (4, 4))):
        if np.shape(value) != shape or not np.isfinite(value).all():
            _refuse(f"the camera's {name} is not a finite {shape[0]} x {shape[1]} matrix")
    if fault := _fault_of_matrix(camera.matrix) or _fault_of_pose(camera.pose):
        _refuse(f"the camera's {fault}")


def _fault_of_matrix(matrix: np.ndarray) -> str | None:
    """Only numbers of a pinhole camera make rays that later steps can compute with."""
    focal, centre = matrix[[0, 1], [0, 1]], matrix[:2, 2]
    if not ((focal > 1e-3) & (focal < MAX_LENGTH)).all() or not (np.abs(centre) < MAX_LENGTH).all():
        return f"focal lengths {focal.tolist()} and centre {centre.tolist()} are not those of a camera, in pixels"
    if np.abs(matrix[2] - (0, 0, 1)).max() > 1e-6 or abs(matrix[1, 0]) > 1e-6:
        return "matrix is not that of a pinhole camera"
    return None


def _fault_of_pose(pose: np.ndarray) -> str | None:
    if np.abs(pose[3] - (0, 0, 0, 1)).max() > 1e-6 or np.abs(pose[:3, 3]).max() > MAX_LENGTH:
        return "pose does not end in 0, 0, 0, 1, or lies beyond any reason"
    turn = pose[:3, :3]
    if np.abs(turn).max() > 1.1 or np.abs(turn @ turn.T - np.eye(3)).max() > 1e-2 or np.linalg.det(turn) < 0:
        return "pose is not a rotation with a position"
    return None


def check_frames(frame_of: Sequence[int], steps: int, images: int) -> None:
    """Every frame has an image, every image a frame, in order."""
    expected = len(frame_of) == steps + 1 and frame_of[0] == 0 and frame_of[-1] == images - 1
    if not expected or any(after - before not in (0, 1) for before, after in zip(frame_of, frame_of[1:], strict=False)):
        _refuse(f"the frames of {steps} steps do not go through {images} images in order")


def check_image(image: Image, camera: Camera, objects: int, links: int) -> None:
    """Shapes, types and ranges of one image."""
    size = (camera.height, camera.width)
    wanted: list[tuple[str, np.ndarray, tuple[int, ...], type]] = [
        ("rgb", image.rgb, (*size, 3), np.uint8),
        ("boxes", image.boxes, (objects, 4), np.int16),
    ]
    if image.depth is not None:
        wanted.append(("depth", image.depth, size, np.float32))
    if image.segmentation is not None:
        wanted.append(("segmentation", image.segmentation, size, np.uint16))
    for name, value, shape, kind in wanted:
        if value.shape != shape or value.dtype != kind:
            _refuse(f"{name} is {value.dtype} {value.shape}, not {np.dtype(kind)} {shape}")
    if image.segmentation is not None and int(image.segmentation.max()) > links:
        _refuse(f"the segmentation names link {int(image.segmentation.max())} of {links}")


def _fault_of_action(step: Step, camera: Camera) -> str | None:
    if any(not 0 <= direction < len(DIRECTIONS) for direction in (step.direction, *step.executed)):
        return f"there are {len(DIRECTIONS)} directions, not {(step.direction, *step.executed)}"
    u, v = step.pixel
    if step.pixel != UNKNOWN_PIXEL and not (0 <= u < camera.width and 0 <= v < camera.height):
        return f"pixel {step.pixel} is outside of the image"
    if step.reward not in (0, 1) or not 0 <= step.changed_pixels <= camera.width * camera.height:
        return f"reward {step.reward}, {step.changed_pixels} changed pixels"
    if len(step.position) != 3 or not (np.abs((*step.position, step.distance)) <= MAX_LENGTH).all():
        return f"position {step.position} and distance {step.distance} are not finite"
    return None


def _fault_of_truth(step: Step, objects: int, triggers: int) -> str | None:
    if not -1 <= step.acted_object < objects:
        return f"it acts on object {step.acted_object} of {objects}"
    expected = {"triggers": triggers, "objects": objects}
    if len(step.memory_after) > MAX_MEMORY or any(abs(number) >= 2**31 for number in step.memory_after):
        return f"a memory of {len(step.memory_after)} numbers"
    for name, each, limit in _BEFORE_AND_AFTER:
        before, after = (getattr(step, f"{name}_{when}") for when in ("before", "after"))
        what, count = name.replace("_", " "), expected[each]
        if len(before) not in (0, count) or len(after) != len(before):
            return f"{len(before)} {what} before and {len(after)} after, {count} or none are expected"
        if not (np.abs((*before, *after)) <= limit).all():
            return f"{what} {before} before and {after} after are out of range"
    return None


def _refuse(what: str) -> NoReturn:
    raise BusybotError(what, HINT)
