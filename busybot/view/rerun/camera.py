"""Rerun, the goal of the board's task: its image, and which responders do not look like it yet.

Rerun, the camera's side: image, boxes in the roles' colours, the action, what changed, depth.

Rerun, the recorded steps put back into the simulator: its picture, and where that differs from the recorded one.
"""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from busybot.boards.directions import DIRECTIONS
from busybot.episodes.camera import project
from busybot.episodes.codec import DepthScale, LazyImages, encode_plain, encode_rgb
from busybot.episodes.episode import Episode, Image
from busybot.episodes.episode_diff import COLOUR_TOLERANCE
from busybot.view.annotations import changed_objects, drawing_scale, object_names, remaining_responders, visible
from busybot.view.palette import ACTION, ROLES, WRONG, Rgb, text_on_dark

VIEW_MARGIN = 14.0
"""Around the board in the camera's view, drawing units."""
ARROW_LENGTH = 0.6
"""Of the direction arrow, board units."""


def log_camera_frame(recording: rr.RecordingStream, episode: Episode, frame: int) -> None:
    """Image and boxes at frame `frame`, with the action that led there."""
    if frame == 0 or episode.frame_of[frame] != episode.frame_of[frame - 1]:
        log_image(recording, episode, frame)
        log_depth(recording, episode, frame)
        log_boxes(recording, episode, episode.image(frame))
    if frame > 0:
        log_changes(recording, episode, frame - 1)
        log_action(recording, episode, frame - 1)


def log_image(recording: rr.RecordingStream, episode: Episode, frame: int) -> None:
    """The RGB image."""
    recording.log("camera/image", stored_picture(episode.images, episode.frame_of[frame]))


def stored_picture(images: Sequence[Image], index: int) -> rr.EncodedImage:
    """The RGB of an image, as it lies in the file where it comes from one."""
    data = images.encoded[index].rgb if isinstance(images, LazyImages) else encode_rgb(images[index].rgb, "jpeg")
    media_type = "image/png" if data[:4] == b"\x89PNG" else "image/jpeg"
    return rr.EncodedImage(contents=data, media_type=media_type, draw_order=-10)


def log_depth(recording: rr.RecordingStream, episode: Episode, frame: int) -> None:
    """Depth in its own space: it would tint the RGB image."""
    depth = episode.image(frame).depth
    if depth is None or not (depth > 0).any():
        return
    scale = 2e-4  # board units per stored step; enough for the eye and much smaller than the recording's
    stored = DepthScale(offset=0.0, scale=scale).quantise(depth)
    first = episode.image(0).depth
    seen = first[first > 0] if first is not None else depth[depth > 0]
    low, high = (float(x) / scale for x in np.percentile(seen, [0.2, 99.8]))
    image = rr.EncodedDepthImage(
        blob=encode_plain(stored), media_type="image/png", meter=1 / scale, colormap="viridis", depth_range=[low, high]
    )
    recording.log("depth/image", image)


def log_boxes(recording: rr.RecordingStream, episode: Episode, image: Image) -> None:
    """Boxes of the visible objects in the roles' colours, and their names below."""
    names, seen = object_names(episode.board), visible(image)
    boxes = image.boxes[seen].astype(float)
    colors = [ROLES[episode.board.objects[i].role] for i in seen]
    outlines = rr.Boxes2D(
        mins=boxes[:, :2], sizes=boxes[:, 2:] - boxes[:, :2], colors=colors, radii=1 / drawing_scale(episode)
    )
    recording.log("camera/objects", outlines)
    below = np.stack([boxes[:, [0, 2]].mean(1), boxes[:, 3]], axis=1)
    tinted = [text_on_dark(color) for color in colors]
    labels = rr.Points2D(below, labels=[names[i] for i in seen], colors=tinted, radii=0.0, show_labels=True)
    recording.log("camera/names", labels)


def log_changes(recording: rr.RecordingStream, episode: Episode, step: int) -> None:
    """A second, wider box around every object that looks different after the step."""
    boxes = episode.image(step + 1).boxes[changed_objects(episode, step)]
    recording.log("camera/changed", marks(episode, boxes, ACTION))


def marks(episode: Episode, boxes: np.ndarray, color: Rgb) -> rr.Boxes2D:
    """Frames around boxes (K, 4), a little wider than these."""
    pixel, corners = 1 / drawing_scale(episode), boxes.astype(float).reshape(-1, 4)
    mins, sizes = corners[:, :2] - 4 * pixel, corners[:, 2:] - corners[:, :2] + 8 * pixel
    return rr.Boxes2D(mins=mins, sizes=sizes, colors=color, radii=1.6 * pixel, draw_order=20)


def log_action(recording: rr.RecordingStream, episode: Episode, step: int, space: str = "camera") -> None:
    """The chosen pixel and the proposed direction as the camera sees it."""
    done = episode.steps[step]
    position = np.array(done.position)
    tip = position + ARROW_LENGTH * DIRECTIONS[done.direction]
    ends, _ = project(np.stack([position, tip]), episode.camera)
    start, size = np.array(done.pixel, float) + 0.5, 1 / drawing_scale(episode)
    recording.log(f"{space}/action/pixel", rr.Points2D([start], colors=ACTION, radii=4.5 * size, draw_order=40))
    arrow = rr.Arrows2D(origins=[start], vectors=[ends[1] - ends[0]], colors=ACTION, radii=1.6 * size, draw_order=30)
    recording.log(f"{space}/action/direction", arrow)


GOAL = "goal"


def log_goal(recording: rr.RecordingStream, episode: Episode) -> None:
    """The goal image, for the whole episode."""
    recording.log(f"{GOAL}/image", stored_picture(episode.goals, 0), static=True)


def log_remaining(recording: rr.RecordingStream, episode: Episode, frame: int) -> None:
    """A box around every responder that looks different in the frame."""
    if episode.goal is not None and (frame == 0 or episode.frame_of[frame] != episode.frame_of[frame - 1]):
        boxes = episode.goal.boxes[remaining_responders(episode, frame)]
        recording.log(f"{GOAL}/remaining", marks(episode, boxes, WRONG))


SIMULATOR = "simulator"
MARK = (140, 30, 240)
"""Of pixels that differ, in the order of OpenCV."""


def log_replayed(recording: rr.RecordingStream, episode: Episode, step: int, picture: np.ndarray) -> None:
    """One step; the recording's clock is the caller's. `picture` is uint8 (H, W, 3)."""
    encoded = rr.EncodedImage(contents=encode_rgb(picture, "jpeg"), media_type="image/jpeg", draw_order=-10)
    recording.log(f"{SIMULATOR}/picture", encoded)
    layer = encode_plain(difference_layer(episode.image(step).rgb, picture))
    recording.log(f"{SIMULATOR}/differences", rr.EncodedImage(contents=layer, media_type="image/png", draw_order=0))


def difference_layer(recorded: np.ndarray, picture: np.ndarray) -> np.ndarray:
    """Pixels that differ by more than 2/255 in a channel, coloured; uint8 (H, W, 4) in the order of OpenCV."""
    apart = np.abs(recorded.astype(int) - picture).max(axis=-1) > COLOUR_TOLERANCE
    return np.where(apart[..., None], np.array([*MARK, 255], np.uint8), np.uint8(0))
