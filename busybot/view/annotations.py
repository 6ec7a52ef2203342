"""Annotations shared by all pictures of an episode: names, places, changes, right and wrong edges. No drawing here."""

import re
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from busybot.boards.directions import DIRECTIONS
from busybot.boards.spec import IMPORTED, BoardSpec
from busybot.boards.true_causes import periods, relations_at
from busybot.common.errors import BusybotError
from busybot.episodes.camera import project
from busybot.episodes.comparing import changed_squares, in_pixels
from busybot.episodes.episode import Episode, Image
from busybot.interact.policy.noisy_pictures import is_noisy, least_depth, looks_otherwise
from busybot.reason.models.base import InferredGraph

CHANGED_TOLERANCE = 12
"""A pixel differs when a channel differs by more; below it is image encoding."""
CHANGED_PIXELS, CHANGED_IN_PHOTOS = 40, 200
"""An object looks different when more of its pixels differ; in photos edges of shadows and hands leave some, too, and
what a small switch changes is no more than they do."""
DEFAULT_DELTA = 500

PICTURE_WIDTH = 640.0
"""Of the camera's image in drawing units: sizes of marks and labels are given in these, whatever the resolution."""

Verdict = Literal["correct", "wrong", "missed", "claimed"]


@dataclass(frozen=True)
class Edge:
    """A relation between two objects on a picture.

    Attributes:
        cause, effect: indices of the board's objects.
        probability: as inferred; 1 for the truth.
        verdict: inferred and true, inferred but not true, true but not inferred; inferred where nobody knows the truth.
    """

    cause: int
    effect: int
    probability: float
    verdict: Verdict


def object_names(board: BoardSpec) -> list[str]:
    """ "switch 2", "lamp 5": category and index on the board."""
    return [f"{placed.category.lower()} {index}" for index, placed in enumerate(board.objects)]


def named(board: BoardSpec, words: str) -> str:
    """An agent's words with the objects' names in place of their numbers."""
    names = object_names(board)

    def name(found: re.Match[str]) -> str:
        numbers = [int(number) for number in found[1].split(", ")]
        return ", ".join(names[number] if number < len(names) else f"object {number}" for number in numbers)

    return re.sub(r"\bobjects? (\d+(?:, \d+)*)", name, words)


def centres(episode: Episode) -> np.ndarray:
    """Visible centre of each object in the board frame, (N, 3); its place on the board where it was not seen."""
    placed = np.array([o.position for o in episode.board.objects], float).reshape(-1, 3)
    return np.where(np.isfinite(episode.positions), episode.positions, placed)


def drawing_scale(episode: Episode) -> float:
    """Drawing units per pixel."""
    return PICTURE_WIDTH / episode.camera.width


def board_bounds(episode: Episode, margin: float) -> tuple[np.ndarray, np.ndarray]:
    """Upper left and lower right corner of the board in the image with a margin, (2,) each, pixels.

    Args:
        margin: drawing units.
    """
    camera, half = episode.camera, np.array(episode.board.size) / 2
    corners = np.array([[x, y, 0] for x in (-half[0], half[0]) for y in (-half[1], half[1])])
    pixels, border = project(corners, camera)[0], margin / drawing_scale(episode)
    imported = episode.settings.get(IMPORTED)
    if isinstance(imported, dict) and imported.get("camera") == "image":  # nobody knows where the board ends there
        pixels = np.array([[0, 0], [camera.width, camera.height]], float)
    return np.maximum(pixels.min(0) - border, 0), np.minimum(pixels.max(0) + border, [camera.width, camera.height])


def anchors(episode: Episode) -> np.ndarray:
    """Where each object is in the first image: its box's centre, else its projected place, pixels (N, 2)."""
    boxes = episode.image(0).boxes.astype(float)
    middle = np.stack([boxes[:, [0, 2]].mean(1), boxes[:, [1, 3]].mean(1)], axis=1)
    projected, _ = project(centres(episode), episode.camera)
    seen = np.all(boxes[:, 2:] > boxes[:, :2], axis=1, keepdims=True)
    return np.where(seen, middle, projected)


def seen_directions(episode: Episode, positions: ArrayLike, directions: ArrayLike, length: float) -> np.ndarray:
    """Directions (K,) at positions (K, 3) as the camera sees them, pixels (K, 2); `length` in board units."""
    starts = np.reshape(positions, (-1, 3))
    tips = starts + length * DIRECTIONS[np.asarray(directions, int)]
    return project(tips, episode.camera)[0] - project(starts, episode.camera)[0]


def delta(episode: Episode) -> int:
    """The number of changed pixels beyond which an action is rewarded."""
    interaction = episode.settings.get("interaction", episode.settings)
    value = interaction.get("delta", DEFAULT_DELTA) if isinstance(interaction, dict) else DEFAULT_DELTA
    return value if isinstance(value, int) else DEFAULT_DELTA


def rewards_known(episode: Episode) -> bool:
    """Whether somebody counted changed pixels when it was recorded: not where others' recordings were imported."""
    return IMPORTED not in episode.settings


def visible(image: Image) -> np.ndarray:
    """Indices of the objects that have a box in the image."""
    return _of_boxes(image.boxes)


def _of_boxes(boxes: np.ndarray) -> np.ndarray:
    return np.flatnonzero((boxes[:, 2:] > boxes[:, :2]).all(1))


def known_boxes(episode: Episode, image: Image) -> np.ndarray:
    """Boxes of an image, (N, 4); those of the first one where they are all that is known, as in what was imported."""
    return image.boxes if len(visible(image)) else episode.image(0).boxes


def looks_new(episode: Episode, frame: int) -> bool:
    """Whether a frame has an image of its own, not the one before it."""
    return frame == 0 or episode.frame_of[frame] != episode.frame_of[frame - 1]


def changed_objects(episode: Episode, step: int) -> list[int]:
    """Objects that look different after step `step` (from 0), by pixels alone."""
    if not looks_new(episode, step + 1):
        return []
    return unlike_objects(episode, episode.image(step), episode.image(step + 1))


def remaining_responders(episode: Episode, frame: int) -> list[int]:
    """Responders that look different in the frame and in the goal, by pixels alone; none without a goal."""
    if episode.goal is None:
        return []
    unlike = unlike_objects(episode, episode.image(frame), episode.goal)
    return [index for index in unlike if episode.board.objects[index].role == "responder"]


def unlike_objects(episode: Episode, before: Image, after: Image) -> list[int]:
    """Objects that look different in two images of the board, by pixels alone; not by what a camera or light adds."""
    if is_noisy(before.rgb, after.rgb):
        difference, least = _photos_differ(episode, before, after), CHANGED_IN_PHOTOS
    else:
        difference = np.abs(before.rgb.astype(np.int16) - after.rgb).max(-1) > CHANGED_TOLERANCE
        least = CHANGED_PIXELS
    found = []
    for index in _of_boxes(known_boxes(episode, after)):
        own = difference & (_pixels_of(episode, before, index) | _pixels_of(episode, after, index))
        if int(own.sum()) > least:
            found.append(int(index))
    return found


def _photos_differ(episode: Episode, before: Image, after: Image) -> np.ndarray:
    """Pixels that differ by more than camera and light explain, and that nothing hides where depth tells that, bool
    (H, W)."""
    first = episode.image(0)
    if before.depth is None or after.depth is None or first.depth is None:
        return in_pixels(changed_squares(before.rgb, after.rgb), before.rgb.shape[:2])
    one, other = (image.observation(episode.camera) for image in (before, after))
    return looks_otherwise(one, other, least_depth(first.depth))


def _pixels_of(episode: Episode, image: Image, index: int) -> np.ndarray:
    """The object's own pixels where segmentation was recorded, else its box; bool (H, W)."""
    if image.segmentation is not None:
        owner = np.array([-1, *(link.object for link in episode.links)])
        return owner[image.segmentation] == index
    inside = np.zeros(image.rgb.shape[:2], bool)
    u0, v0, u1, v1 = (max(int(x), 0) for x in known_boxes(episode, image)[index])
    inside[v0:v1, u0:u1] = True
    return inside


def acted_object(episode: Episode, step: int) -> int:
    """The object whose box holds the chosen pixel, the smallest of several; -1 if none does."""
    image, (u, v) = episode.image(step), episode.steps[step].pixel
    boxes = known_boxes(episode, image)
    u0, v0, u1, v1 = boxes.astype(int).T
    holding = [int(i) for i in _of_boxes(boxes) if u0[i] <= u < u1[i] and v0[i] <= v < v1[i]]
    return min(holding, key=lambda i: (u1[i] - u0[i]) * (v1[i] - v0[i]), default=-1)


def truth_matrix(board: BoardSpec, step: int = 0) -> np.ndarray:
    """Which object controls which at a step, bool (N, N)."""
    matrix = np.zeros((len(board.objects), len(board.objects)), bool)
    for relation in relations_at(board, step):
        for trigger in relation.triggers:
            matrix[trigger.object, relation.responder] = True
    return matrix


def truth_ever(board: BoardSpec) -> np.ndarray:
    """Which object controls which at any step, bool (N, N)."""
    return np.any([truth_matrix(board, step) for step in {0, *(period.since for period in periods(board))}], axis=0)


def true_edges(board: BoardSpec, step: int = 0) -> list[Edge]:
    """The relations between objects that the board has at a step."""
    return [Edge(int(i), int(j), 1.0, "correct") for i, j in np.argwhere(truth_matrix(board, step))]


def judged_edges(board: BoardSpec, inferred: InferredGraph, steps: int) -> list[Edge]:
    """Claimed edges after so many steps, right or wrong, and the true ones that are not claimed."""
    truth, probabilities = truth_matrix(board, steps), inferred.after(steps)
    claimed = probabilities > inferred.threshold
    edges = []
    for i, j in np.argwhere(claimed | truth):
        verdict: Verdict = "missed" if not claimed[i, j] else "correct" if truth[i, j] else "wrong"
        verdict = verdict if board.relations_known else "claimed"
        edges.append(Edge(int(i), int(j), float(probabilities[i, j]), verdict))
    return edges


def pairs_ever(board: BoardSpec, inferred: InferredGraph) -> list[tuple[int, int]]:
    """Cause and effect of every edge that `judged_edges` gives after any number of steps."""
    claimed = (np.stack([inferred.after(0), *inferred.probabilities]) > inferred.threshold).any(0)
    return [(int(i), int(j)) for i, j in np.argwhere(claimed | truth_ever(board))]


def check_inferred(episode: Episode, inferred: InferredGraph) -> None:
    """Refuse an inference that is not about this episode's board."""
    objects = len(episode.board.objects)
    shape = inferred.probabilities.shape
    if len(shape) != 3 or shape[0] < 1 or shape[1:] != (objects, objects):
        raise BusybotError(
            f"inferred graph {inferred.name!r}: shape {shape}, but the board has {objects} objects",
            f"give probabilities of shape (steps, {objects}, {objects})",
        )
    if not np.isfinite(inferred.probabilities).all():
        raise BusybotError(f"inferred graph {inferred.name!r}: probabilities are not finite")
