"""The observations of an episode that a reasoner may know, and nothing else.

The one way from an `Episode` to any model of relations: a whitelist. Segmentation, later boxes, what the gripper truly
held, joints, states, rewards, relations, object names and categories are not hidden here, they are not here.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from busybot.boards.directions import DIRECTIONS
from busybot.episodes.codec import EncodedImage, LazyImages
from busybot.episodes.episode import Camera, Episode, Image, Step
from busybot.episodes.schema import UNKNOWN_PIXEL

KEPT, DECODED = 64_000_000, 7
"""Decoded pictures of one board take so many bytes at most, and so many a pixel: three colours and a float of depth."""

NO_BOXES = np.empty((0, 4), np.int16)

REACH = 0.5
"""A pixel outside of all trigger boxes may lie so far from one, in units of the box's longer side: a lever that has
moved sticks out of its first box."""


@dataclass(frozen=True)
class Frame:
    """One picture.

    Attributes:
        rgb: uint8 (H, W, 3), as decoded.
        depth: float32 (H, W), board units, 0 where nothing was hit; None if not recorded.
    """

    rgb: np.ndarray
    depth: np.ndarray | None


@dataclass(frozen=True)
class ObservedAction:
    """One proposed action.

    Attributes:
        pixel: (u, v) chosen in the picture before; `UNKNOWN_PIXEL` where none was.
        position: board frame, board units.
        direction: unit vector of the proposed direction, board frame.
        pushed: the same of the direction that was tried last, if the picture changed then: first comes the proposed
            one, its opposite if that moved nothing. None where nobody says, or nothing changed.
    """

    pixel: tuple[int, int]
    position: tuple[float, float, float]
    direction: tuple[float, float, float]
    pushed: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class ObservedEpisode:
    """A board watched for T steps.

    Attributes:
        camera: the static camera, for positions from depth.
        roles: "trigger" or "responder" for each of N objects.
        boxes: int16 (N, 4), u0, v0, u1, v1 (exclusive) in the first frame; -1 where not visible.
        positions: float32 (N, 3), visible centre in the first frame, board frame; NaN if not visible.
        actions: T of them; action k leads from frame k to frame k + 1.
        images: stored pictures without segmentation and boxes, decoded when asked for.
        image_of: index into `images` for frames 0..T. Frames with one index are the same picture.
        boxed_in: index into `images` of the picture that boxes and positions are of; None for frame 0.
        world: in which world its dataset says that the board was drawn (docs/guides/worlds.md), "" where nobody says.
    """

    camera: Camera
    roles: tuple[str, ...]
    boxes: np.ndarray
    positions: np.ndarray
    actions: tuple[ObservedAction, ...]
    images: Sequence[Image]
    image_of: tuple[int, ...]
    boxed_in: int | None = None
    world: str = ""

    @property
    def boxed(self) -> Frame:
        """The picture that boxes and positions are of."""
        image = self.images[self.image_of[0] if self.boxed_in is None else self.boxed_in]
        return Frame(image.rgb, image.depth)

    @property
    def triggers(self) -> np.ndarray:
        """Indices of the triggers."""
        return np.flatnonzero(np.array(self.roles, str) == "trigger")

    @property
    def responders(self) -> np.ndarray:
        """Indices of the responders."""
        return np.flatnonzero(np.array(self.roles, str) == "responder")

    @property
    def candidates(self) -> np.ndarray:
        """bool (N, N), True where the row is a trigger and the column a responder."""
        roles = np.array(self.roles, str)
        return (roles == "trigger")[:, None] & (roles == "responder")[None]

    def frame(self, index: int) -> Frame:
        """Frame `index`, 0 is the initial one."""
        image = self.images[self.image_of[index]]
        return Frame(image.rgb, image.depth)

    def first(self, images: int) -> "ObservedEpisode":
        """The same board watched for at most `images` frames (so many minus one actions)."""
        steps = max(0, images - 1)
        return self.window(0, steps)

    def window(self, start: int, steps: int) -> "ObservedEpisode":
        """The same board watched from frame `start` on for at most so many steps; its boxes stay those they were."""
        boxed = self.image_of[0] if self.boxed_in is None else self.boxed_in
        actions, image_of = self.actions[start : start + steps], self.image_of[start : start + steps + 1]
        return replace(self, actions=actions, image_of=image_of, boxed_in=boxed)


def observe_episode(episode: Episode, again: bool = False) -> ObservedEpisode:
    """Everything of the episode that a reasoner may read.

    Args:
        again: its pictures will be looked at several times: as many as fit into `KEPT` are decoded once.
    """
    if isinstance(episode.images, LazyImages):
        images: Sequence[Image] = _without_truth(episode.images, again)
        first_boxes = episode.images.encoded[episode.frame_of[0]].boxes
    else:
        images = [Image(image.rgb, image.depth, None, NO_BOXES) for image in episode.images]
        first_boxes = episode.images[episode.frame_of[0]].boxes
    return ObservedEpisode(
        camera=episode.camera,
        roles=tuple(placed.role for placed in episode.board.objects),
        boxes=np.array(first_boxes, np.int16),
        positions=np.array(episode.positions, np.float32),
        actions=tuple(
            _action(step, *shown) for step, shown in zip(episode.steps, pairwise(episode.frame_of), strict=True)
        ),
        images=images,
        image_of=tuple(episode.frame_of),
        world=episode.board.told_world,
    )


def goal_of(episode: Episode) -> Frame | None:
    """What an agent may see of the goal: its picture, without segmentation and boxes; None if there is no goal."""
    goals = _without_truth(episode.goals) if isinstance(episode.goals, LazyImages) else episode.goals
    return Frame(goals[0].rgb, goals[0].depth) if len(goals) else None


def _without_truth(images: LazyImages, again: bool = False) -> LazyImages:
    """The same pictures; segmentation and boxes are left out and never decoded."""
    encoded = [EncodedImage(image.rgb, image.depth, None, NO_BOXES) for image in images.encoded]
    shown = LazyImages(images.where, images.width, images.height, 0, images.depth_scale, encoded)
    if again:
        shown.keeps = max(shown.keeps, KEPT // (DECODED * images.width * images.height))
    return shown


def _action(step: Step, before: int, after: int) -> ObservedAction:
    pushed = _vector(step.executed[-1]) if before != after and step.executed else None
    return ObservedAction(step.pixel, step.position, _vector(step.direction), pushed)


def _vector(direction: int) -> tuple[float, float, float]:
    x, y, z = DIRECTIONS[direction]
    return float(x), float(y), float(z)


def actions_of(observed: ObservedEpisode) -> np.ndarray:
    """Positions and proposed directions, as of `BoardSequence`, float32 (T, 6)."""
    actions = [(*action.position, *action.direction) for action in observed.actions]
    return np.array(actions, np.float32).reshape(-1, 6)


def pushes_of(observed: ObservedEpisode) -> np.ndarray:
    """The same with the directions that were tried last where something changed, float32 (T, 6)."""
    actions = [(*action.position, *(action.pushed or action.direction)) for action in observed.actions]
    return np.array(actions, np.float32).reshape(-1, 6)


def acted_objects(observed: ObservedEpisode) -> np.ndarray:
    """The trigger that each action took hold of as far as boxes tell, int (T,), -1 for none.

    It is the trigger whose first-frame box holds the action's pixel; of several the one with the smallest box, then the
    one whose centre is nearest. A pixel outside of all trigger boxes goes to the nearest box within `REACH`. What was
    not chosen in a picture took hold of nothing that boxes tell.
    """
    return np.array([trigger_at(observed, action.pixel) for action in observed.actions], int)


def trigger_at(observed: ObservedEpisode, pixel: tuple[int, int]) -> int:
    """The trigger at a pixel (u, v) by the rule of `acted_objects`, -1 for none."""
    if pixel == UNKNOWN_PIXEL:  # as a place it would lie beside a box in the picture's corner
        return -1
    u, v = pixel
    near = []
    for index in observed.triggers:
        u0, v0, u1, v1 = (int(side) for side in observed.boxes[index])
        if u1 <= u0 or v1 <= v0:
            continue
        outside = math.hypot(max(u0 - u, 0, u - (u1 - 1)), max(v0 - v, 0, v - (v1 - 1)))
        if outside > REACH * max(u1 - u0, v1 - v0):
            continue
        centre = math.hypot(u + 0.5 - (u0 + u1) / 2, v + 0.5 - (v0 + v1) / 2)
        near.append((outside, (u1 - u0) * (v1 - v0), centre, int(index)))
    return min(near)[-1] if near else -1
