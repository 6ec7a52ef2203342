"""Rerun, what runs over time: changed pixels, reward, edge probabilities, discrete states, a log in words."""

import numpy as np
import rerun as rr

from busybot.boards.directions import DIRECTIONS
from busybot.episodes.episode import Episode
from busybot.plan.agent_policy import reason
from busybot.reason.models.base import InferredGraph
from busybot.view.annotations import acted_object, changed_objects, delta, named, object_names, truth_matrix, visible
from busybot.view.palette import ACTION, CORRECT, MISSED, MUTED, STATES, Rgb, curve_colors

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


def log_probabilities(recording: rr.RecordingStream, episode: Episode, inferred: InferredGraph, frame: int) -> None:
    """The whole matrix as a heat map, rows are causes, columns effects; and the curves of some pairs.

    Pairs with a curve are the true ones, in cool colours, and in warm ones those that ever seemed possible.
    """
    path, names, truth = ["inference", inferred.name], object_names(episode.board), truth_matrix(episode.board)
    pairs = [(int(i), int(j)) for i, j in np.argwhere(truth | (inferred.probabilities.max(0) >= SHOWN_PROBABILITY))]
    matrix = inferred.after(frame)
    tensor = rr.Tensor(matrix.astype(np.float32), dim_names=("cause", "effect"), value_range=[0, 1])
    recording.log([*path, "probabilities"], tensor)
    for (i, j), color in zip(pairs, curve_colors([bool(truth[pair]) for pair in pairs]), strict=True):
        if frame == 0:
            style = rr.SeriesLines(colors=[color], names=[f"{names[i]} → {names[j]}"], widths=[2.0])
            recording.log([*path, "edges", f"{i}-{j}"], style, static=True)
        recording.log([*path, "edges", f"{i}-{j}"], rr.Scalars(float(matrix[i, j])))


def log_states(recording: rr.RecordingStream, episode: Episode, frame: int) -> None:
    """Privileged: the discrete states of every relation's trigger links and of its responder, one below the other."""
    for name, value in relation_states(episode, frame).items():
        if frame == 0:
            values = [str(k) for k in range(len(STATES))]
            style = rr.StateConfiguration(values=values, labels=values, colors=list(STATES))
            recording.log(f"states/{name}", style, static=True)
        recording.log(f"states/{name}", rr.StateChange(state=str(value)))


def relation_states(episode: Episode, frame: int) -> dict[str, int]:
    """State by lane at a frame; lanes sort by relation, the cause before the effect. Empty if states are unknown."""
    if not episode.steps:
        return {}
    step = episode.steps[max(frame - 1, 0)]
    triggers = step.trigger_states_after if frame else step.trigger_states_before
    responders = step.responder_states_after if frame else step.responder_states_before
    number = {(k.object, k.name): n for n, k in enumerate(link for link in episode.links if link.trigger)}
    names = [name.replace(" ", "_") for name in object_names(episode.board)]
    states = {}
    for index, relation in enumerate(episode.board.relations):
        for trigger in relation.triggers:
            place = number.get((trigger.object, trigger.link), len(triggers))
            if place < len(triggers):
                states[f"relation_{index:02d}/cause_{names[trigger.object]}_{trigger.link}"] = triggers[place]
        if relation.responder < len(responders):
            states[f"relation_{index:02d}/effect_{names[relation.responder]}"] = responders[relation.responder]
    return states


def log_words(recording: rr.RecordingStream, episode: Episode, frame: int) -> None:
    """What an onlooker would say about the step that led to the frame, after what the agent says who chose it."""
    told: list[tuple[str, Rgb | None]] = []
    if frame:
        step = episode.steps[frame - 1]
        seen = f"{sentence(episode, frame - 1)}, {step.changed_pixels} pixels changed, reward {step.reward}"
        told += [(said(episode, frame - 1), None), (seen, CORRECT if step.reward else MISSED)]
    if frame == len(episode.steps):
        told.append((said(episode, frame), None))
    for words, color in told:
        if words:
            recording.log("log", rr.TextLog(words, level="INFO", color=color))


def said(episode: Episode, step: int) -> str:
    """What an agent said about a step, or why it stopped before it; empty if nothing was recorded."""
    words = named(episode.board, reason(episode, step))
    return f"{episode.policy}: {words}" if words else ""


def sentence(episode: Episode, step: int) -> str:
    """ "pull switch 2 along (+0.0, +1.0, +0.0): lamp 5 changed"; only the action where no boxes are known."""
    done, names = episode.steps[step], object_names(episode.board)
    along = ", ".join(f"{x:+.1f}" for x in DIRECTIONS[done.direction])
    if not len(visible(episode.image(step))):
        return f"pull at pixel ({done.pixel[0]}, {done.pixel[1]}) along ({along})"
    acted = acted_object(episode, step)
    changed = " and ".join(names[i] for i in changed_objects(episode, step)) or "nothing"
    return f"pull {names[acted] if acted >= 0 else 'the board'} along ({along}): {changed} changed"
