"""Rerun, what a reasoner expected of every step beside what happened: errors red, hits green.

At step k stands what had been expected before action k of the picture after it.
"""

import numpy as np
import rerun as rr

from busybot.episodes.episode import Episode
from busybot.reason.evaluation.explain import Explanation
from busybot.view.annotations import board_bounds, drawing_scale, object_names, visible
from busybot.view.palette import CORRECT, MUTED, STATES, WRONG, Rgb, text_on_dark
from busybot.view.rerun.affordance import log_pale
from busybot.view.rerun.camera import VIEW_MARGIN, log_action

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
    wrong = [MISTAKE + value for value in values]
    expected = rr.StateConfiguration(
        values=values + wrong, labels=values + wrong, colors=[*colors, *([WRONG] * len(wrong))]
    )
    for index in eventful(foreseen):
        recording.log(_lane(episode, int(index), "is"), shown, static=True)
        recording.log(_lane(episode, int(index), "expected"), expected, static=True)


def eventful(foreseen: Explanation) -> np.ndarray:
    """Indices of the objects that ever changed, or were expected to."""
    steps = len(foreseen.expected)
    return np.unique(np.concatenate([np.zeros(0, int), *(foreseen.changed(step) for step in range(steps))]))


def _lane(episode: Episode, index: int, what: str) -> str:
    return f"{LANES}/{object_names(episode.board)[index].replace(' ', '_')}_{what}"


def log_foreseen(recording: rr.RecordingStream, episode: Episode, foreseen: Explanation, frame: int) -> None:
    """Everything at one frame; the recording's clock is the caller's."""
    for index in eventful(foreseen):
        state = foreseen.states[frame, index]
        recording.log(_lane(episode, int(index), "is"), rr.StateChange(state=str(state)))
        if frame > 0:
            expected = foreseen.expected[frame - 1, index]
            word = str(expected) if expected == state else f"{MISTAKE}{expected}"
            recording.log(_lane(episode, int(index), "expected"), rr.StateChange(state=word))
    _log_picture(recording, episode, foreseen, frame)
    if frame > 0:
        right = not len(foreseen.wrong(frame - 1))
        text = rr.TextLog(words(episode, foreseen, frame - 1), level="INFO", color=CORRECT if right else WRONG)
        recording.log(f"log/{EXPECTED}", text)


def _log_picture(recording: rr.RecordingStream, episode: Episode, foreseen: Explanation, frame: int) -> None:
    """The picture, paler, with a box and a word on every responder that changed or should have."""
    image = episode.image(frame)
    log_pale(recording, EXPECTED, image.rgb)
    seen = [int(index) for index in visible(image) if foreseen.judged[index]]
    marks = [_mark(foreseen, frame, index) for index in seen]
    boxes, size = image.boxes[seen].astype(float).reshape(-1, 4), 1 / drawing_scale(episode)
    radii = [(2.2 if text else 0.8) * size for _, text in marks]
    outlines = rr.Boxes2D(
        mins=boxes[:, :2], sizes=boxes[:, 2:] - boxes[:, :2], colors=[color for color, _ in marks], radii=radii
    )
    recording.log(f"{EXPECTED}/objects", outlines)
    names, told = object_names(episode.board), [number for number, (_, text) in enumerate(marks) if text]
    labels = [f"{names[seen[number]]}: {marks[number][1]}" for number in told]
    below = label_places(episode, boxes[told], labels)
    tinted = [text_on_dark(marks[number][0]) for number in told]
    recording.log(f"{EXPECTED}/words", rr.Points2D(below, labels=labels, colors=tinted, radii=0.0, show_labels=True))
    if frame > 0:
        log_action(recording, episode, frame - 1, EXPECTED)


def label_places(episode: Episode, boxes: np.ndarray, labels: list[str]) -> np.ndarray:
    """Below the middle of each box (L, 4), moved inwards where the text would leave the view; pixels (L, 2)."""
    low, high = board_bounds(episode, VIEW_MARGIN)
    unit = 1 / drawing_scale(episode)
    half = np.array([len(label) for label in labels]) * LETTER * unit / 2
    middle = boxes[:, [0, 2]].mean(axis=1)
    across = np.clip(middle, np.minimum(low[0] + half, high[0] - half), np.maximum(low[0] + half, high[0] - half))
    return np.stack([across, np.minimum(boxes[:, 3], high[1] - LINE * unit)], axis=1)


def _mark(foreseen: Explanation, frame: int, index: int) -> tuple[Rgb, str]:
    """Colour and word of a responder; no word where nothing happened, as expected."""
    if frame == 0 or index not in foreseen.changed(frame - 1):
        return MUTED, ""
    before, after = foreseen.states[frame - 1, index], foreseen.states[frame, index]
    expected = foreseen.expected[frame - 1, index]
    if expected == after:
        return CORRECT, f"{before} to {after}, as expected"
    return (
        WRONG,
        f"{before} to {after}, expected {expected}" if after != before else f"still {after}, expected {expected}",
    )


def words(episode: Episode, foreseen: Explanation, step: int) -> str:
    """ "expected: lamp 5 to become 1; so it did" in one line."""
    names = object_names(episode.board)
    changes = [
        f"{names[index]} to become {foreseen.expected[step, index]}"
        for index in np.flatnonzero(foreseen.judged & (foreseen.expected[step] != foreseen.states[step]))
    ]
    wrong = [f"{names[index]} is {foreseen.states[step + 1, index]}" for index in foreseen.wrong(step)]
    return f"expected {' and '.join(changes) or 'no change'}: {'but ' + ' and '.join(wrong) if wrong else 'right'}"
