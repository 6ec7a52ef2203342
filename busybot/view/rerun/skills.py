"""Rerun, what skills make of an episode: affordances, an agent's choices, a reasoner's expectations.

With affordances stand known links, candidates and the action chosen; with choices what an agent could choose from on
its way to the goal, what it chose, and why; with expectations what happened: errors red, hits green. At step k stands
what was believed or decided before action k, on the picture before it, and what had been expected of the picture after
it: the camera beside shows what came of it.
"""

import textwrap
from typing import NamedTuple

import cv2
import numpy as np
import rerun as rr

from busybot.episodes.codec import encode_rgb
from busybot.episodes.episode import Episode
from busybot.interact.policy.policy_trace import PolicyTrace
from busybot.plan.agent_policy import LoggedContact, offered, reason
from busybot.reason.evaluation.prediction import Explanation
from busybot.view import annotations
from busybot.view.palette import ACTION, CORRECT, INK, MUTED, STATES, TRIGGER, WRONG, Rgb, mix, text_on_dark
from busybot.view.rerun.camera import ARROW_LENGTH, VIEW_MARGIN, captions, layer, log_action, marks, outlines, picture

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
    recording.log(f"{AFFORDANCE}/map", layer(affordance_layer(thought.affordance)))
    size = 1 / annotations.drawing_scale(episode)
    known = rr.LineStrips2D(link_outlines(thought.links), colors=INK, radii=1.2 * size, draw_order=10)
    recording.log(f"{AFFORDANCE}/links", known)
    found = thought.candidates.take(thought.candidates.scores > LEAST_SCORE)
    regions = [f"known link {region}" if region > 0 else "new" for region in found.regions]
    labels = [f"success {score:.2f}, {region}" for score, region in zip(found.scores, regions, strict=True)]
    dots = Dots(found.pixels, found.positions, found.best_directions, found.scores, labels)
    log_dots(recording, f"{AFFORDANCE}/candidates", episode, dots, size)
    log_action(recording, episode, thought.step, AFFORDANCE)


def log_pale(recording: rr.RecordingStream, space: str, rgb: np.ndarray) -> None:
    """A paler picture, to draw upon."""
    paler = np.asarray(rgb + (255 - rgb.astype(np.float32)) * PALE, np.uint8)
    recording.log(f"{space}/picture", picture(encode_rgb(paler, "jpeg")))


def affordance_layer(affordance: np.ndarray) -> np.ndarray:
    """Probabilities (H, W) as colours, uint8 (H, W, 4) in the order of OpenCV: the likelier, the more opaque."""
    blue, green, red = reversed(mix(TRIGGER, (0, 0, 0), 0.15))
    colors = np.empty((*affordance.shape, 4), np.uint8)
    colors[..., :3] = blue, green, red
    colors[..., 3] = np.round(affordance * OPAQUE)
    return colors


def link_outlines(links: np.ndarray) -> list[np.ndarray]:
    """Closed outlines (n, 2) of the known links, pixels; `links` is int (H, W), 0 for none."""
    outlines = []
    for number in np.unique(links[links > 0]):
        mask = (links == number).astype(np.uint8)
        for contour in cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]:
            points = contour[:, 0].astype(np.float32) + 0.5
            outlines.append(np.concatenate([points, points[:1]]))
    return outlines


class Dots(NamedTuple):
    """K places where one may act: pixels (K, 2), positions (K, 3) in the board frame, indices into DIRECTIONS (K,),
    scores from 0 to 1 (K,), and what is said about each."""

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
    length = CANDIDATE_ARROW * ARROW_LENGTH
    vectors = annotations.seen_directions(episode, dots.positions, dots.directions, length)
    arrows = rr.Arrows2D(origins=places, vectors=vectors, colors=color, radii=0.5 * size, draw_order=20)
    recording.log(f"{place}/directions", arrows)


CHOICE = "choice"
DOTS = 2.0
"""Dots are so much larger than among affordances: they are fewer, and the picture is one of four."""
LETTERS, LINES = 44, 3
"""Of the reason that the picture has room for."""
REASON_LINE = 24.0
"""Height of a line of it, drawing units, in a picture of the usual size."""


def has_choices(episode: Episode) -> bool:
    """Whether the episode tells what its agent could choose from."""
    return any(offered(episode, step) for step in range(len(episode.steps)))


def log_choice(recording: rr.RecordingStream, episode: Episode, step: int) -> None:
    """Everything of the decision for one action; the recording's clock is the caller's."""
    image, size = episode.image(step), 1 / annotations.drawing_scale(episode)
    log_pale(recording, CHOICE, image.rgb)
    boxes = annotations.known_boxes(episode, image)[annotations.remaining_responders(episode, step)]
    recording.log(f"{CHOICE}/remaining", marks(episode, boxes, WRONG))
    told = offered(episode, step)
    for name, color in (("proposed", INK), ("repeats", TRIGGER)):
        dots = _dots([one for one in told if (one.step >= 0) == (name == "repeats")])
        log_dots(recording, f"{CHOICE}/{name}", episode, dots, DOTS * size, color)
    log_action(recording, episode, step, CHOICE)
    _log_reason(recording, episode, step)


def _log_reason(recording: rr.RecordingStream, episode: Episode, step: int) -> None:
    """The agent's words at the board's lower edge."""
    words = annotations.named(episode.board, reason(episode, step))
    lines = textwrap.wrap(words, LETTERS, max_lines=LINES, placeholder=" ...")
    low, high = annotations.board_bounds(episode, 0)
    place = [(low[0] + high[0]) / 2, high[1] - (len(lines) + 1) * REASON_LINE / annotations.drawing_scale(episode)]
    label = rr.Points2D(
        [place], labels=["\n".join(lines)], colors=text_on_dark(ACTION), radii=0.0, show_labels=bool(lines)
    )
    recording.log(f"{CHOICE}/reason", label)


def _dots(told: list[LoggedContact]) -> Dots:
    return Dots(
        pixels=np.array([one.pixel for one in told], int),
        positions=np.array([one.position for one in told], float),
        directions=np.array([one.direction for one in told], int),
        scores=np.array([one.score for one in told], float),
        labels=[f"success {one.score:.2f}, {_origin(one)}" for one in told],
    )


def _origin(one: LoggedContact) -> str:
    return f"worked in step {one.step + 1} of the history" if one.step >= 0 else "proposed by the interaction model"


EXPECTED = "expected"
LANES = "expectations"
LETTER, LINE = 6.4, 26.0
"""Width of a label's letter and height of a label with its distance, drawing units, in a picture of the usual size."""
MISTAKE = "not "
"""Before an expected state that did not come."""


def log_lanes(recording: rr.RecordingStream, episode: Episode, foreseen: Explanation) -> None:
    """Names and colours of the lanes: what a responder shows, and below it what was expected."""
    values = [str(state) for state in np.unique(foreseen.states[:, foreseen.judged])]
    colors = [STATES[int(value) % len(STATES)] for value in values]
    shown = rr.StateConfiguration(values=values, labels=values, colors=colors)
    told = values + [MISTAKE + value for value in values]
    tinted = [*colors, *([WRONG] * len(values))]
    expected = rr.StateConfiguration(values=told, labels=told, colors=tinted)
    for index in eventful(foreseen):
        recording.log(_lane(episode, index, "is"), shown, static=True)
        recording.log(_lane(episode, index, "expected"), expected, static=True)


def eventful(foreseen: Explanation) -> np.ndarray:
    """Indices of the objects that ever changed, or were expected to."""
    steps = len(foreseen.expected)
    return np.unique(np.concatenate([np.zeros(0, int), *(foreseen.changed(step) for step in range(steps))]))


def _lane(episode: Episode, index: int, what: str) -> str:
    return f"{LANES}/{annotations.object_names(episode.board)[index].replace(' ', '_')}_{what}"


def log_foreseen(recording: rr.RecordingStream, episode: Episode, foreseen: Explanation, frame: int) -> None:
    """Everything at one frame; the recording's clock is the caller's."""
    for index in eventful(foreseen):
        state = foreseen.states[frame, index]
        recording.log(_lane(episode, index, "is"), rr.StateChange(state=str(state)))
        if frame > 0:
            expected = foreseen.expected[frame - 1, index]
            word = str(expected) if expected == state else f"{MISTAKE}{expected}"
            recording.log(_lane(episode, index, "expected"), rr.StateChange(state=word))
    _log_picture(recording, episode, foreseen, frame)
    if frame > 0:
        right = not len(foreseen.wrong(frame - 1))
        text = rr.TextLog(words(episode, foreseen, frame - 1), level="INFO", color=CORRECT if right else WRONG)
        recording.log(f"log/{EXPECTED}", text)


def _log_picture(recording: rr.RecordingStream, episode: Episode, foreseen: Explanation, frame: int) -> None:
    """The picture, paler, with a box and a word on every responder that changed or should have."""
    image = episode.image(frame)
    log_pale(recording, EXPECTED, image.rgb)
    names, size = annotations.object_names(episode.board), 1 / annotations.drawing_scale(episode)
    seen = [int(index) for index in annotations.visible(image) if foreseen.judged[index]]
    boxes, verdicts = image.boxes[seen].astype(float).reshape(-1, 4), [_verdict(foreseen, frame, i) for i in seen]
    colors, radii = [color for color, _ in verdicts], [(2.2 if word else 0.8) * size for _, word in verdicts]
    recording.log(f"{EXPECTED}/objects", outlines(boxes, colors=colors, radii=radii))
    told = [place for place, (_, word) in enumerate(verdicts) if word]
    labels = [f"{names[seen[place]]}: {verdicts[place][1]}" for place in told]
    below = label_places(episode, boxes[told], labels)
    recording.log(f"{EXPECTED}/words", captions(below, labels, [colors[place] for place in told]))
    if frame > 0:
        log_action(recording, episode, frame - 1, EXPECTED)


def label_places(episode: Episode, boxes: np.ndarray, labels: list[str]) -> np.ndarray:
    """Below the middle of each box (L, 4), moved inwards where the text would leave the view; pixels (L, 2)."""
    low, high = annotations.board_bounds(episode, VIEW_MARGIN)
    unit = 1 / annotations.drawing_scale(episode)
    half = np.array([len(label) for label in labels]) * LETTER * unit / 2
    middle = boxes[:, [0, 2]].mean(axis=1)
    across = np.clip(middle, np.minimum(low[0] + half, high[0] - half), np.maximum(low[0] + half, high[0] - half))
    return np.stack([across, np.minimum(boxes[:, 3], high[1] - LINE * unit)], axis=1)


def _verdict(foreseen: Explanation, frame: int, index: int) -> tuple[Rgb, str]:
    """Colour and word of a responder; no word where nothing happened, as expected."""
    if frame == 0 or index not in foreseen.changed(frame - 1):
        return MUTED, ""
    before, after = foreseen.states[frame - 1, index], foreseen.states[frame, index]
    expected = foreseen.expected[frame - 1, index]
    if expected == after:
        return CORRECT, f"{before} to {after}, as expected"
    return WRONG, f"{f'still {after}' if after == before else f'{before} to {after}'}, expected {expected}"


def words(episode: Episode, foreseen: Explanation, step: int) -> str:
    """ "expected: lamp 5 to become 1; so it did" in one line."""
    names, expected = annotations.object_names(episode.board), foreseen.expected[step]
    changing = np.flatnonzero(foreseen.judged & (expected != foreseen.states[step]))
    changes = [f"{names[index]} to become {expected[index]}" for index in changing]
    wrong = [f"{names[index]} is {foreseen.states[step + 1, index]}" for index in foreseen.wrong(step)]
    return f"expected {' and '.join(changes) or 'no change'}: {'but ' + ' and '.join(wrong) if wrong else 'right'}"
