"""Rerun, what an agent could choose from on its way to the goal, what it chose, and why.

At step k stands the decision for action k, on the picture before it, as with affordances: the camera shows the outcome.
"""

import textwrap

import numpy as np
import rerun as rr

from busybot.episodes.episode import Episode
from busybot.plan.decision_log import LoggedContact, offered, reason
from busybot.view.annotations import board_bounds, drawing_scale, named, remaining_responders
from busybot.view.palette import ACTION, INK, TRIGGER, WRONG, text_on_dark
from busybot.view.rerun.affordance import Dots, log_dots, log_pale
from busybot.view.rerun.camera import log_action, marks

CHOICE = "choice"
DOTS = 2.0
"""Dots are so much larger than among affordances: they are fewer, and the picture is one of four."""
LETTERS, LINES = 44, 3
"""Of the reason that the picture has room for."""
LINE = 24.0
"""Height of a line, drawing units, in a picture of the usual size."""


def has_choices(episode: Episode) -> bool:
    """Whether the episode tells what its agent could choose from."""
    return any(offered(episode, step) for step in range(len(episode.steps)))


def log_choice(recording: rr.RecordingStream, episode: Episode, step: int) -> None:
    """Everything of the decision for one action; the recording's clock is the caller's."""
    image, size = episode.image(step), 1 / drawing_scale(episode)
    log_pale(recording, CHOICE, image.rgb)
    recording.log(f"{CHOICE}/remaining", marks(episode, image.boxes[remaining_responders(episode, step)], WRONG))
    told = offered(episode, step)
    for name, color in (("proposed", INK), ("repeats", TRIGGER)):
        dots = _dots([one for one in told if (one.step >= 0) == (name == "repeats")])
        log_dots(recording, f"{CHOICE}/{name}", episode, dots, DOTS * size, color)
    log_action(recording, episode, step, CHOICE)
    _log_reason(recording, episode, step)


def _log_reason(recording: rr.RecordingStream, episode: Episode, step: int) -> None:
    """The agent's words at the board's lower edge."""
    words = named(episode.board, reason(episode, step))
    lines = textwrap.wrap(words, LETTERS, max_lines=LINES, placeholder=" ...")
    low, high = board_bounds(episode, 0)
    place = [(low[0] + high[0]) / 2, high[1] - (len(lines) + 1) * LINE / drawing_scale(episode)]
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
        labels=[_label(one) for one in told],
    )


def _label(one: LoggedContact) -> str:
    where = f"worked in step {one.step + 1} of the history" if one.step >= 0 else "proposed by the interaction model"
    return f"success {one.score:.2f}, {where}"
