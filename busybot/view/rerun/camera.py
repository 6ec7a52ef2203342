"""Rerun, pictures: what the camera sees with boxes, action and changes, the goal, and the simulator's own picture.

The goal stands with the responders that do not look like it yet; the simulator's picture of the recorded steps, put
back into it, with what differs from the recorded one. `picture`, `layer`, `outlines`, `captions` and `marks` are what
all pictures are made of.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr

from busybot.episodes.codec import DepthScale, LazyImages, encode_plain, encode_rgb
from busybot.episodes.episode import Episode, Image
from busybot.episodes.episode_diff import COLOUR_TOLERANCE
from busybot.view import annotations
from busybot.view.palette import ACTION, ROLES, WRONG, Rgb, text_on_dark

GOAL, SIMULATOR = "goal", "simulator"
VIEW_MARGIN = 14.0
"""Around the board in the camera's view, drawing units."""
ARROW_LENGTH = 0.6
"""Of the direction arrow, board units."""
DIFFERENCE = (140, 30, 240)
"""Of pixels that differ, in the order of OpenCV."""


def picture(data: bytes) -> rr.EncodedImage:
    """An encoded RGB image, beneath everything else."""
    media_type = "image/png" if data[:4] == b"\x89PNG" else "image/jpeg"
    return rr.EncodedImage(contents=data, media_type=media_type, draw_order=-10)


def stored_picture(images: Sequence[Image], index: int) -> rr.EncodedImage:
    """The RGB of an image, as it lies in the file where it comes from one."""
    data = images.encoded[index].rgb if isinstance(images, LazyImages) else encode_rgb(images[index].rgb, "jpeg")
    return picture(data)


def layer(colors: np.ndarray) -> rr.EncodedImage:
    """What lies upon a picture: uint8 (H, W, 4) in the order of OpenCV."""
    return rr.EncodedImage(contents=encode_plain(colors), media_type="image/png", draw_order=0)


def outlines(boxes: np.ndarray, wider: float = 0.0, **style: Any) -> rr.Boxes2D:
    """Frames of boxes (K, 4), wider by so many pixels on each side."""
    corners = boxes.astype(float).reshape(-1, 4)
    sizes = corners[:, 2:] - corners[:, :2] + 2 * wider
    return rr.Boxes2D(mins=corners[:, :2] - wider, sizes=sizes, **style)


def marks(episode: Episode, boxes: np.ndarray, color: Rgb) -> rr.Boxes2D:
    """Frames around boxes (K, 4), a little wider than these."""
    pixel = 1 / annotations.drawing_scale(episode)
    return outlines(boxes, 4 * pixel, colors=color, radii=1.6 * pixel, draw_order=20)


def captions(places: np.ndarray, labels: list[str], colors: list[Rgb]) -> rr.Points2D:
    """Words at places (K, 2), nearly white with a tinge of their colours."""
    tinted = [text_on_dark(color) for color in colors]
    return rr.Points2D(places, labels=labels, colors=tinted, radii=0.0, show_labels=True)


def log_camera_frame(recording: rr.RecordingStream, episode: Episode, frame: int) -> None:
    """Image, depth and boxes at frame `frame`, the action that led there, and a wider box around what it changed."""
    if annotations.looks_new(episode, frame):
        recording.log("camera/image", stored_picture(episode.images, episode.frame_of[frame]))
        log_depth(recording, episode, frame)
        log_boxes(recording, episode, episode.image(frame))
    if frame > 0:
        boxes = annotations.known_boxes(episode, episode.image(frame))[annotations.changed_objects(episode, frame - 1)]
        recording.log("camera/changed", marks(episode, boxes, ACTION))
        log_action(recording, episode, frame - 1)


def log_depth(recording: rr.RecordingStream, episode: Episode, frame: int) -> None:
    """Depth in its own space: it would tint the RGB image."""
    depth = episode.image(frame).depth
    if depth is None or not (depth > 0).any():
        return
    scale = 2e-4  # board units per stored step; enough for the eye and much smaller than the recording's
    stored = DepthScale(offset=0.0, scale=scale).quantise(depth)
    first = episode.image(0).depth
    compared = first if first is not None and (first > 0).any() else depth
    seen = compared[compared > 0]
    low, high = (float(x) / scale for x in np.percentile(seen, [0.2, 99.8]))
    image = rr.EncodedDepthImage(
        blob=encode_plain(stored), media_type="image/png", meter=1 / scale, colormap="viridis", depth_range=[low, high]
    )
    recording.log("depth/image", image)


def log_boxes(recording: rr.RecordingStream, episode: Episode, image: Image) -> None:
    """Boxes of the visible objects in the roles' colours, and their names below."""
    names, seen = annotations.object_names(episode.board), annotations.visible(image)
    boxes = image.boxes[seen].astype(float)
    colors = [ROLES[episode.board.objects[i].role] for i in seen]
    recording.log("camera/objects", outlines(boxes, colors=colors, radii=1 / annotations.drawing_scale(episode)))
    below = np.stack([boxes[:, [0, 2]].mean(1), boxes[:, 3]], axis=1)
    recording.log("camera/names", captions(below, [names[i] for i in seen], colors))


def log_action(recording: rr.RecordingStream, episode: Episode, step: int, space: str = "camera") -> None:
    """The chosen pixel and the proposed direction as the camera sees it."""
    done, size = episode.steps[step], 1 / annotations.drawing_scale(episode)
    start = np.array(done.pixel, float) + 0.5
    vectors = annotations.seen_directions(episode, done.position, [done.direction], ARROW_LENGTH)
    recording.log(f"{space}/action/pixel", rr.Points2D([start], colors=ACTION, radii=4.5 * size, draw_order=40))
    arrow = rr.Arrows2D(origins=[start], vectors=vectors, colors=ACTION, radii=1.6 * size, draw_order=30)
    recording.log(f"{space}/action/direction", arrow)


def log_goal(recording: rr.RecordingStream, episode: Episode, frame: int) -> None:
    """The goal image, and a box around every responder that looks different in the frame; nothing without a goal."""
    if episode.goal is None:
        return
    if frame == 0:
        recording.log(f"{GOAL}/image", stored_picture(episode.goals, 0), static=True)
    if annotations.looks_new(episode, frame):
        boxes = annotations.known_boxes(episode, episode.goal)[annotations.remaining_responders(episode, frame)]
        recording.log(f"{GOAL}/remaining", marks(episode, boxes, WRONG))


def log_replayed(recording: rr.RecordingStream, episode: Episode, step: int, shown: np.ndarray) -> None:
    """One step as the simulator shows it, uint8 (H, W, 3); the recording's clock is the caller's."""
    recording.log(f"{SIMULATOR}/picture", picture(encode_rgb(shown, "jpeg")))
    recording.log(f"{SIMULATOR}/differences", layer(difference_layer(episode.image(step).rgb, shown)))


def difference_layer(recorded: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """Pixels that differ by more than 2/255 in a channel, coloured; uint8 (H, W, 4) in the order of OpenCV."""
    apart = np.abs(recorded.astype(int) - shown).max(axis=-1) > COLOUR_TOLERANCE
    return np.where(apart[..., None], np.array([*DIFFERENCE, 255], np.uint8), np.uint8(0))
