"""Rerun, what runs over time: changed pixels, reward, edge probabilities, discrete states, a log in words."""

import numpy as np
import rerun as rr

from busybot.boards.directions import DIRECTIONS
from busybot.episodes.episode import Episode
from busybot.reason.result import InferredGraph
from busybot.view.palette import ACTION, CORRECT, MISSED, MUTED, STATES, curve_colors
from busybot.view.scene import acted_object, changed_objects, delta, object_names

REWARDS = {"reward 1": CORRECT, "reward 0": MISSED}
SHOWN_PROBABILITY = 0.3
"""An edge that never gets more probable has no curve."""


def log_series_styles(recording: rr.RecordingStream) -> None:
    """Names and colours of the curves."""
    changed = rr.SeriesLines(colors=[ACTION], names=["changed pixels"], widths=[2.0])
    recording.log("signals/changed", changed, static=True)
    recording.log("signals/delta", rr.SeriesLines(colors=[MUTED], names=["delta"], widths=[1.5]), static=True)
    for name, color in REWARDS.items():
        points = rr.SeriesPoints(colors=[color], names=[name], markers=["circle"], marker_sizes=[4.0])
        recording.log(["signals", name], points, static=True)
    reward = rr.SeriesLines(colors=[CORRECT], names=["reward"], widths=[2.0], interpolation_mode="StepAfter")
    recording.log("reward", reward, static=True)


def log_signals(recording: rr.RecordingStream, episode: Episode, frame: int) -> None:
    """Changed pixels against the threshold, and the reward, of the step that led to the frame."""
    recording.log("signals/delta", rr.Scalars(delta(episode)))
    if frame > 0:
        step = episode.steps[frame - 1]
        recording.log("signals/changed", rr.Scalars(step.changed_pixels))
        rewarded, unrewarded = REWARDS
        recording.log(["signals", rewarded if step.reward else unrewarded], rr.Scalars(step.changed_pixels))
        recording.log("reward", rr.Scalars(step.reward))


def shown_pairs(inferred: InferredGraph, truth: np.ndarray) -> list[tuple[int, int]]:
    """Pairs with a curve: true ones, and those that ever seemed possible."""
    ever = inferred.probabilities.max(0) >= SHOWN_PROBABILITY
    return [(int(i), int(j)) for i, j in np.argwhere(ever | truth)]


def log_probability_styles(recording: rr.RecordingStream, episode: Episode, inferred: InferredGraph) -> None:
    """One curve per pair: cool colours are true relations, warm ones are not."""
    names, truth = object_names(episode.board), np.array(episode.board.relation_matrix(), bool)
    pairs = shown_pairs(inferred, truth)
    for (i, j), color in zip(pairs, curve_colors([bool(truth[pair]) for pair in pairs]), strict=True):
        style = rr.SeriesLines(colors=[color], names=[f"{names[i]} → {names[j]}"], widths=[2.0])
        recording.log(["inference", inferred.name, "edges", f"{i}-{j}"], style, static=True)


def log_probabilities(recording: rr.RecordingStream, episode: Episode, inferred: InferredGraph, frame: int) -> None:
    """The whole matrix as a heat map, rows are causes, columns effects; and the curves."""
    matrix = inferred.after(frame)
    tensor = rr.Tensor(matrix.astype(np.float32), dim_names=("cause", "effect"), value_range=[0, 1])
    recording.log(["inference", inferred.name, "probabilities"], tensor)
    for i, j in shown_pairs(inferred, np.array(episode.board.relation_matrix(), bool)):
        recording.log(["inference", inferred.name, "edges", f"{i}-{j}"], rr.Scalars(float(matrix[i, j])))


def log_states(recording: rr.RecordingStream, episode: Episode, frame: int) -> None:
    """Privileged: discrete states of trigger links and of the responders that ever change."""
    names = object_names(episode.board)
    links = [link for link in episode.links if link.trigger]
    for name, value in _states(episode, frame, names, [f"{names[k.object]} {k.name}" for k in links]).items():
        if frame == 0:
            style = rr.StateConfiguration(values=["0", "1", "2"], labels=["0", "1", "2"], colors=list(STATES))
            recording.log(["states", name], style, static=True)
        recording.log(["states", name], rr.StateChange(state=str(value)))


def _states(episode: Episode, frame: int, names: list[str], links: list[str]) -> dict[str, int]:
    """State by name of what ever changes, at a frame."""
    rows = []
    for index in [None, *range(len(episode.steps))]:
        step = episode.steps[index or 0]
        when = "before" if index is None else "after"
        triggers = getattr(step, f"trigger_states_{when}")
        responders = getattr(step, f"responder_states_{when}")
        rows.append(dict(zip(links, triggers, strict=False)) | dict(zip(names, responders, strict=False)))
    varying = [name for name in rows[0] if len({row[name] for row in rows}) > 1]
    return {name: rows[frame][name] for name in varying}


def log_words(recording: rr.RecordingStream, episode: Episode, frame: int) -> None:
    """What an onlooker would say about the step that led to the frame."""
    if frame == 0:
        return
    step, names = episode.steps[frame - 1], object_names(episode.board)
    acted = acted_object(episode, frame - 1)
    along = ", ".join(f"{x:+.1f}" for x in DIRECTIONS[step.direction])
    target = names[acted] if acted >= 0 else "the board"
    changed = " and ".join(names[i] for i in changed_objects(episode, frame - 1)) or "nothing"
    text = f"pull {target} along ({along}): {changed} changed, {step.changed_pixels} pixels, reward {step.reward}"
    recording.log("log", rr.TextLog(text, level="INFO", color=CORRECT if step.reward else MISSED))
