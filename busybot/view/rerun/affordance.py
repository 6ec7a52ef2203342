"""Rerun, what an interaction model makes of an episode: affordance, known links, candidates, the action chosen.

At step k stands what was believed before action k, on the picture before it: the camera beside shows what came of it.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import rerun as rr

from busybot.boards.directions import DIRECTIONS
from busybot.episodes.camera import project
from busybot.episodes.codec import encode_plain, encode_rgb
from busybot.episodes.episode import Episode
from busybot.interact.policy.policy_trace import PolicyTrace
from busybot.view.annotations import drawing_scale
from busybot.view.palette import INK, TRIGGER, Rgb, mix
from busybot.view.rerun.camera import ARROW_LENGTH, log_action

AFFORDANCE = "affordance"
PALE = 0.5
"""How much of the picture under the affordance is white."""
OPAQUE = 230
"""Opacity of certain affordance, of 255."""
LEAST_SCORE = 0.05
"""Candidates of less promise are not drawn."""
CANDIDATE_ARROW = 0.4
"""Length of a candidate's arrow, of the action's."""


def log_thought(recording: rr.RecordingStream, episode: Episode, thought: PolicyTrace) -> None:
    """Everything of one action; the step of the recording's clock is the caller's."""
    log_pale(recording, AFFORDANCE, episode.image(thought.step).rgb)
    layer = encode_plain(affordance_layer(thought.affordance))
    recording.log(f"{AFFORDANCE}/map", rr.EncodedImage(contents=layer, media_type="image/png", draw_order=0))
    size = 1 / drawing_scale(episode)
    outlines = rr.LineStrips2D(link_outlines(thought.links), colors=INK, radii=1.2 * size, draw_order=10)
    recording.log(f"{AFFORDANCE}/links", outlines)
    _log_candidates(recording, episode, thought, size)
    log_action(recording, episode, thought.step, AFFORDANCE)


def log_pale(recording: rr.RecordingStream, space: str, rgb: np.ndarray) -> None:
    """A paler picture, to draw upon."""
    picture = rr.EncodedImage(contents=encode_rgb(paler(rgb), "jpeg"), media_type="image/jpeg", draw_order=-10)
    recording.log(f"{space}/picture", picture)


def paler(rgb: np.ndarray) -> np.ndarray:
    """A paler picture, uint8 (H, W, 3)."""
    return np.asarray(rgb + (255 - rgb.astype(np.float32)) * PALE, np.uint8)


def affordance_layer(affordance: np.ndarray) -> np.ndarray:
    """Probabilities (H, W) as colours, uint8 (H, W, 4) in the order of OpenCV: the likelier, the more opaque."""
    blue, green, red = reversed(mix(TRIGGER, (0, 0, 0), 0.15))
    layer = np.empty((*affordance.shape, 4), np.uint8)
    layer[..., :3] = blue, green, red
    layer[..., 3] = np.round(affordance * OPAQUE)
    return layer


def link_outlines(links: np.ndarray) -> list[np.ndarray]:
    """Closed outlines (n, 2) of the known links, pixels; `links` is int (H, W), 0 for none."""
    outlines = []
    for number in np.unique(links[links > 0]):
        mask = (links == number).astype(np.uint8)
        for contour in cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]:
            points = contour[:, 0].astype(np.float32) + 0.5
            outlines.append(np.concatenate([points, points[:1]]))
    return outlines


def _log_candidates(recording: rr.RecordingStream, episode: Episode, thought: PolicyTrace, size: float) -> None:
    found = thought.candidates.take(thought.candidates.scores > LEAST_SCORE)
    labels = [
        f"success {score:.2f}, {f'known link {region}' if region > 0 else 'new'}"
        for score, region in zip(found.scores, found.regions, strict=True)
    ]
    dots = Dots(found.pixels, found.positions, found.best_directions, found.scores, labels)
    log_dots(recording, f"{AFFORDANCE}/candidates", episode, dots, size)


@dataclass(frozen=True)
class Dots:
    """Places where one may act, K of them.

    Attributes:
        pixels: int (K, 2), u and v.
        positions: (K, 3), board frame.
        directions: int (K,), indices into DIRECTIONS.
        scores: (K,), 0 to 1.
        labels: what is said about each.
    """

    pixels: np.ndarray
    positions: np.ndarray
    directions: np.ndarray
    scores: np.ndarray
    labels: list[str]


def log_dots(
    recording: rr.RecordingStream, place: str, episode: Episode, dots: Dots, size: float, color: Rgb = INK
) -> None:
    """Dots, the larger the more success is expected, with the best direction of each; a label tells more.

    Args:
        place: entity above the dots and the arrows.
        size: pixels in a drawing unit.
    """
    places = dots.pixels.reshape(-1, 2) + 0.5
    radii = (0.8 + 1.2 * dots.scores) * size
    points = rr.Points2D(places, radii=radii, colors=color, labels=dots.labels, show_labels=False, draw_order=20)
    recording.log(f"{place}/positions", points)
    ends = _arrows(episode, dots.positions.reshape(-1, 3), dots.directions, CANDIDATE_ARROW * ARROW_LENGTH)
    arrows = rr.Arrows2D(origins=places, vectors=ends, colors=color, radii=0.5 * size, draw_order=20)
    recording.log(f"{place}/directions", arrows)


def _arrows(episode: Episode, positions: np.ndarray, directions: np.ndarray, length: float) -> np.ndarray:
    """Directions at positions (K, 3) as the camera sees them, pixels (K, 2)."""
    if not len(positions):
        return np.zeros((0, 2))
    starts, _ = project(positions, episode.camera)
    tips, _ = project(positions + length * DIRECTIONS[directions], episode.camera)
    return np.asarray(tips - starts)
