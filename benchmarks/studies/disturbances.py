"""Disturbances of a recorded episode, made on purpose for `reason_robustness.py`, each with a strength.

Every disturbance takes a recording, a strength and a generator. It changes what a reasoner is given (`ObservedEpisode`)
and leaves the truth alone. Only additional failing actions have steps of their own in the truth: what would have been
recorded if they had happened, because an action that fails restores the board exactly.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from busybot.episodes.camera import Rays
from busybot.episodes.episode import Episode, Image
from busybot.reason.evaluation.ground_truth import NOTHING_HELD, StateTruth, states_of
from busybot.reason.inputs.observation import NO_BOXES, ObservedAction, ObservedEpisode, observe_episode

HAND: tuple[int, int, int] = (205, 160, 130)
HAND_WIDTH = 70
"""Pixels; a box is 40 to 130 pixels wide."""
RECORDED = 90
"""JPEG quality of recordings."""
HAND_NEAR = 0.8
"""The hand is nearer than everything on the board: its depth as a share of the smallest depth."""


@dataclass(frozen=True)
class DisturbedBoard:
    """An episode as reasoners and as evaluators have it."""

    episode: Episode
    observed: ObservedEpisode
    truth: StateTruth


Disturb = Callable[[DisturbedBoard, float, np.random.Generator], DisturbedBoard]


def recording_of(episode: Episode) -> DisturbedBoard:
    """With all pictures decoded once.

    Raises:
        ValueError: the recording does not know states.
    """
    observed, truth = observe_episode(episode), states_of(episode)
    if truth is None:
        raise ValueError(f"episode {episode.board.index} does not know states: nothing to judge by")
    return DisturbedBoard(episode, replace(observed, images=list(observed.images)), truth)


def noisy(features: np.ndarray, strength: float, rng: np.random.Generator) -> np.ndarray:
    """Features (T + 1, N, C) with Gaussian noise of expected length `strength` on every object in every frame."""
    spread = strength / np.sqrt(features.shape[-1])
    noise = rng.normal(0, spread, features.shape)
    return np.asarray(np.where(features.any(axis=-1, keepdims=True), features + noise, 0), np.float32)


def camera_noise(recording: DisturbedBoard, strength: float, rng: np.random.Generator) -> DisturbedBoard:
    frames = [recording.observed.frame(number) for number in range(len(recording.observed.image_of))]
    field = rng.normal(0, strength, frames[0].rgb.shape).round().astype(np.int16)
    images = []
    for frame in frames:
        shift = (int(rng.integers(field.shape[0])), int(rng.integers(field.shape[1])))
        rgb = cv2.add(frame.rgb.astype(np.int16), np.roll(field, shift, axis=(0, 1)), dtype=cv2.CV_8U)
        images.append(Image(rgb, frame.depth, None, NO_BOXES))
    return _observed(recording, images=images, image_of=tuple(range(len(images))))


def patch(recording: DisturbedBoard, strength: float, rng: np.random.Generator) -> DisturbedBoard:
    observed = recording.observed
    seen = [int(index) for index in observed.responders if observed.boxes[index][2] > observed.boxes[index][0]]

    def cover(rgb: np.ndarray, depth: np.ndarray | None) -> None:
        u0, v0, u1, v1 = observed.boxes[seen[rng.integers(len(seen))]]
        rgb[v0:v1, u0:u1] = 128
        if depth is not None:
            depth[v0:v1, u0:u1] = 0

    return _covered(recording, strength if seen else 0, rng, cover)


def hand(recording: DisturbedBoard, strength: float, rng: np.random.Generator) -> DisturbedBoard:
    observed = recording.observed
    seen = np.flatnonzero(observed.boxes[:, 2] > observed.boxes[:, 0])

    def cover(rgb: np.ndarray, depth: np.ndarray | None) -> None:
        box = observed.boxes[seen[rng.integers(len(seen))]].astype(int)
        tip = (int(box[0] + box[2]) // 2, int(box[1] + box[3]) // 2)
        height, width = rgb.shape[:2]
        along = float(rng.random())
        edges = ((0, along * height), (width, along * height), (along * width, height), (along * width, 0))
        wrist = tuple(int(value) for value in edges[rng.integers(4)])
        arm = np.zeros((height, width), np.uint8)
        cv2.line(arm, tip, (wrist[0], wrist[1]), 1, HAND_WIDTH)
        rgb[arm > 0] = HAND
        if depth is not None:
            depth[arm > 0] = HAND_NEAR * depth[depth > 0].min()

    return _covered(recording, strength if len(seen) else 0, rng, cover)


def _covered(
    recording: DisturbedBoard,
    share: float,
    rng: np.random.Generator,
    cover: Callable[[np.ndarray, np.ndarray | None], None],
) -> DisturbedBoard:
    """A share of all frames, drawn one by one, gets a picture of its own in which something is covered."""
    images, image_of = list(recording.observed.images), list(recording.observed.image_of)
    for number in range(1, len(image_of)):
        if rng.random() < share:
            frame = recording.observed.frame(number)
            rgb, depth = frame.rgb.copy(), None if frame.depth is None else frame.depth.copy()
            cover(rgb, depth)
            image_of[number] = len(images)
            images.append(Image(rgb, depth, None, NO_BOXES))
    return _observed(recording, images=images, image_of=tuple(image_of))


def missing_frames(recording: DisturbedBoard, strength: float, rng: np.random.Generator) -> DisturbedBoard:
    image_of = list(recording.observed.image_of)
    for number in range(1, len(image_of)):
        if rng.random() < strength:
            image_of[number] = image_of[number - 1]
    return _observed(recording, image_of=tuple(image_of))


def slips(recording: DisturbedBoard, strength: float, rng: np.random.Generator) -> DisturbedBoard:
    return _with_failures(recording, strength, rng, lambda step: (recording.observed.actions[step], True))


def misses(recording: DisturbedBoard, strength: float, rng: np.random.Generator) -> DisturbedBoard:
    episode, rays = recording.episode, Rays(recording.observed.camera)

    def beside(step: int) -> tuple[ObservedAction, bool] | None:
        done = episode.steps[step]
        fixed = [i + 1 for i, link in enumerate(episode.links) if link.object == done.acted_object and not link.trigger]
        image = episode.image(step)
        if image.segmentation is None or image.depth is None:
            raise ValueError("a recording without depth and segmentation does not tell where actions would fail")
        places = np.argwhere(np.isin(image.segmentation, fixed) & (image.depth > 0))
        if not len(places):
            return None
        row, column = (int(value) for value in places[rng.integers(len(places))])
        x, y, z = (float(value) for value in rays.point(image.depth, (column, row)))
        return ObservedAction((column, row), (x, y, z), recording.observed.actions[step].direction), False

    return _with_failures(recording, strength, rng, beside)


def _with_failures(
    recording: DisturbedBoard,
    share: float,
    rng: np.random.Generator,
    failing: Callable[[int], tuple[ObservedAction, bool] | None],
) -> DisturbedBoard:
    """Additional actions that change nothing, so that they are a share of all; the episode keeps its length.

    Args:
        failing: by the step before which it happens: the action, and whether it holds the same link; None for none.
    """
    observed, truth, length = recording.observed, recording.truth, len(recording.observed.actions)
    told: list[tuple[ObservedAction, int, int, bool, tuple[str, ...]]] = []  # action, link, its object, success, kinds
    frames, step = [0], 0
    while len(told) < length:
        extra = failing(step) if rng.random() < share else None
        if extra is None:
            link, on = int(truth.links[step]), int(truth.held[step])
            told.append((observed.actions[step], link, on, bool(truth.success[step]), truth.kinds[step]))
            step += 1
        else:
            action, holds = extra
            link, on = (int(truth.links[step]), int(truth.held[step])) if holds else (-1, -1)
            told.append((action, link, on, False, truth.kinds[step] if holds else (NOTHING_HELD,)))
        frames.append(step)
    actions, links, held, success, kinds = zip(*told, strict=True)
    return replace(
        recording,
        observed=replace(observed, actions=actions, image_of=tuple(observed.image_of[frame] for frame in frames)),
        truth=StateTruth(truth.states[frames], np.array(links), np.array(held), np.array(success), kinds),
    )


def wrong_boxes(recording: DisturbedBoard, strength: float, rng: np.random.Generator) -> DisturbedBoard:
    observed = recording.observed
    boxes, height, width = observed.boxes.astype(int), observed.camera.height, observed.camera.width
    for index in np.flatnonzero(boxes[:, 2] > boxes[:, 0]):
        u0, v0, u1, v1 = (boxes[index] + rng.normal(0, strength, 4).round()).astype(int)
        u0, v0 = np.clip((u0, v0), 0, (width - 2, height - 2))
        boxes[index] = u0, v0, *np.clip((u1, v1), (u0 + 2, v0 + 2), (width, height))
    return _observed(recording, boxes=boxes.astype(np.int16))


def swapped_boxes(recording: DisturbedBoard, strength: float, rng: np.random.Generator) -> DisturbedBoard:
    observed = recording.observed
    boxes = observed.boxes.copy()
    if len(observed.responders) > 1 and rng.random() < strength:
        one, other = rng.choice(observed.responders, 2, replace=False)
        boxes[[one, other]] = boxes[[other, one]]
    return _observed(recording, boxes=boxes)


def compressed(recording: DisturbedBoard, strength: float, rng: np.random.Generator) -> DisturbedBoard:
    images = []
    for image in recording.observed.images:
        quality = [cv2.IMWRITE_JPEG_QUALITY, round(RECORDED - strength)]
        _, data = cv2.imencode(".jpg", np.ascontiguousarray(image.rgb[..., ::-1]), quality)
        rgb = np.ascontiguousarray(np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))[..., ::-1], np.uint8)
        images.append(Image(rgb, image.depth, None, NO_BOXES))
    return _observed(recording, images=images)


def _observed(recording: DisturbedBoard, **changed: Any) -> DisturbedBoard:
    return replace(recording, observed=replace(recording.observed, **changed))


@dataclass(frozen=True)
class DisturbanceStudy:
    """One thing that goes wrong.

    Attributes:
        title: in a few words.
        what: exactly what is done.
        unit: of the strengths.
        strengths: growing.
        apply: None for noise on the features, which are not part of a recording (`noisy`).
    """

    title: str
    what: str
    unit: str
    strengths: tuple[float, ...]
    apply: Disturb | None


SHARES = (0.1, 0.2, 0.3)
DISTURBANCES = {
    "features": DisturbanceStudy(
        "noise on features",
        "Gaussian noise on the features of every responder in every frame, of this length",
        "smallest changes",
        (0.2, 0.4, 0.8),
        None,
    ),
    "camera": DisturbanceStudy(
        "noise of the camera",
        "Gaussian noise of this standard deviation on every channel of every picture, another one in every frame; "
        "depth stays as it is",
        "of 255",
        (2, 5, 10),
        camera_noise,
    ),
    "patch": DisturbanceStudy(
        "a responder hidden",
        "in this share of the frames a random responder's box is grey and has no depth",
        "of frames",
        SHARES,
        patch,
    ),
    "hand": DisturbanceStudy(
        "a hand in the picture",
        "in this share of the frames an arm, 70 pixels wide, reaches from a random place of the picture's border to a "
        "random object, above everything else",
        "of frames",
        SHARES,
        hand,
    ),
    "slips": DisturbanceStudy(
        "failing: the gripper slips",
        "before a step its own action is made without effect, so that this share of all actions fails in addition",
        "of actions",
        SHARES,
        slips,
    ),
    "misses": DisturbanceStudy(
        "failing: beside the link",
        "before a step its action is made at a random place of the same trigger that does not move, without effect, so "
        "that this share of all actions fails in addition",
        "of actions",
        SHARES,
        misses,
    ),
    "missing": DisturbanceStudy(
        "missing frames",
        "this share of the pictures is lost, the one before is seen once more: the next change shows both effects",
        "of frames",
        SHARES,
        missing_frames,
    ),
    "boxes": DisturbanceStudy(
        "inaccurate boxes",
        "every side of every first-frame box is displaced by Gaussian noise of this standard deviation",
        "pixels",
        (5, 10, 20),
        wrong_boxes,
    ),
    "swapped": DisturbanceStudy(
        "two boxes exchanged",
        "on this share of the boards two random responders have each other's box",
        "of boards",
        (0.5, 1.0),
        swapped_boxes,
    ),
    "jpeg": DisturbanceStudy(
        "JPEG",
        "every picture, recorded as JPEG of quality 90, is encoded again with less quality",
        "quality lost",
        (20, 50, 80),
        compressed,
    ),
}
