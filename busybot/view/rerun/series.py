"""Rerun, what runs over time: changed pixels, reward, edge probabilities, discrete states, a log in words."""

import numpy as np
import rerun as rr

from busybot.boards.directions import DIRECTIONS
from busybot.boards.true_causes import periods
from busybot.common.text import markdown_text
from busybot.episodes.episode import Episode
from busybot.plan.agent_policy import reason
from busybot.reason.models.base import InferredGraph
from busybot.view.annotations import (
    acted_object,
    changed_objects,
    delta,
    named,
    object_names,
    rewards_known,
    truth_ever,
    visible,
)
from busybot.view.mechanisms import MechanismView
from busybot.view.palette import ACTION, CORRECT, LOCK, MISSED, MUTED, STATES, TRUTH, WRONG, Rgb, curve_colors

REWARDS = {"reward 1": CORRECT, "reward 0": MISSED}
HELD = "held"
"""Of a link that did not yield, because a lock held it."""
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
    """Changed pixels against the threshold, and the reward, of the step that led to the frame, if they are known."""
    if not rewards_known(episode):
        return
    recording.log("signals/delta", rr.Scalars(delta(episode)))
    if frame > 0:
        step = episode.steps[frame - 1]
        recording.log("signals/changed", rr.Scalars(step.changed_pixels))
        rewarded, unrewarded = REWARDS
        recording.log(["signals", rewarded if step.reward else unrewarded], rr.Scalars(step.changed_pixels))
        recording.log("reward", rr.Scalars(step.reward))


def log_probabilities(recording: rr.RecordingStream, episode: Episode, inferred: InferredGraph, frame: int) -> None:
    """The whole matrix as a heat map, rows are causes, columns effects; and the curves of some pairs.

    Pairs with a curve are those that are ever true, in cool colours, and in warm ones those that ever seemed possible.
    """
    path, truth, names = ["inference", inferred.name], truth_ever(episode.board), curve_names(episode, inferred)
    matrix = inferred.after(frame)
    tensor = rr.Tensor(matrix.astype(np.float32), dim_names=("cause", "effect"), value_range=[0, 1])
    recording.log([*path, "probabilities"], tensor)
    for (i, j), color in zip(names, curve_colors([bool(truth[pair]) for pair in names]), strict=True):
        if frame == 0:
            style = rr.SeriesLines(colors=[color], names=[names[i, j]], widths=[2.0])
            recording.log([*path, "edges", f"{i}-{j}"], style, static=True)
        recording.log([*path, "edges", f"{i}-{j}"], rr.Scalars(float(matrix[i, j])))


def curve_names(episode: Episode, inferred: InferredGraph) -> dict[tuple[int, int], str]:
    """The pairs that have a curve, and what it is called: "switch 2 → lamp 5"."""
    names, truth = object_names(episode.board), truth_ever(episode.board)
    shown = truth | (inferred.probabilities.max(0) >= SHOWN_PROBABILITY)
    return {(int(i), int(j)): f"{names[i]} → {names[j]}" for i, j in np.argwhere(shown)}


def log_states(recording: rr.RecordingStream, episode: Episode, frame: int) -> None:
    """Privileged: the discrete states of every relation's trigger links and of its responder, one below the other."""
    for name, value in relation_states(episode, frame).items():
        if frame == 0:
            values = [str(k) for k in range(len(STATES))]
            style = rr.StateConfiguration(values=values, labels=values, colors=list(STATES))
            recording.log(["states", *name.split("/", 1)], style, static=True)
        recording.log(["states", *name.split("/", 1)], rr.StateChange(state=str(value)))


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


def log_mechanism_words(recording: rr.RecordingStream, view: MechanismView) -> None:
    """The board's mechanisms in words, for the whole episode. Privileged."""
    lines = [f"- **{markdown_text(who)}** {markdown_text(words)}" for who, words in view.sentences]
    left = ["", f"{view.unexplained.capitalize()}."] if view.unexplained else []
    text = "\n".join([f"World **{markdown_text(view.board.world)}**", "", *lines, *left])
    recording.log("mechanisms", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)


def log_causes(recording: rr.RecordingStream, view: MechanismView) -> None:
    """Privileged: lanes of all links and responders; with a responder's state stands what it goes back to.

    A link that was taken hold of while a lock held it is marked. All steps are logged at once.
    """
    for number, (name, lane) in enumerate(cause_lanes(view).items()):
        path: list[object] = ["causes", f"{number:02d}_{name.replace(' ', '_')}"]
        values = list(dict.fromkeys(lane))
        colors = [LOCK if value.endswith(HELD) else STATES[int(value.split()[0]) % len(STATES)] for value in values]
        style = rr.StateConfiguration(values=values, labels=values, colors=colors)
        recording.log(path, style, static=True)
        for frame, value in enumerate(lane):
            if frame == 0 or value != lane[frame - 1]:
                recording.set_time("step", sequence=frame)
                recording.set_time("time", duration=float(frame))
                recording.log(path, rr.StateChange(state=value))


def cause_lanes(view: MechanismView) -> dict[str, list[str]]:
    """What stands in each lane at each frame, links first: "1", "0 held", "1 ← switch 2 at step 5".

    What never changed and was never held has none.
    """
    steps = view.episode.steps
    if not steps or not steps[0].trigger_states_before:
        return {}
    lanes: dict[str, list[str]] = {}
    held = set(view.held)
    for number, name in enumerate(view.link_names):
        states = [steps[0].trigger_states_before[number], *(step.trigger_states_after[number] for step in steps)]
        lanes[name] = [f"{state} {HELD}" if (k, number) in held else str(state) for k, state in enumerate(states)]
    because = {(change.responder, change.step): view.because(change) for change in view.changes}
    for index, placed in enumerate(view.board.objects):
        if placed.role != "responder" or all(index != one.responder for one in view.board.relations):
            continue
        lane = [str(steps[0].responder_states_before[index])]
        for frame, step in enumerate(steps, start=1):
            state, cause = step.responder_states_after[index], because.get((index, frame))
            same = str(state) == lane[-1].split()[0]
            lane.append(f"{state} ← {cause}" if cause else lane[-1] if same else str(state))
        lanes[object_names(view.board)[index]] = lane
    return {name: lane for name, lane in lanes.items() if len(set(lane)) > 1}


def log_change_words(recording: rr.RecordingStream, view: MechanismView, frame: int) -> None:
    """What each change at a frame goes back to, in words. Privileged."""
    names = object_names(view.board)
    for change in view.changes:
        if change.step == frame:
            late = f", {change.late} earlier" if change.late else ""
            words = f"{names[change.responder]} changed: {view.because(change)}{late}"
            recording.log("log/causes", rr.TextLog(words, level="INFO", color=TRUTH))
    for period in periods(view.board):
        if period.since == frame and frame:
            words = f"{names[period.relation.responder]} was rewired"
            recording.log("log/causes", rr.TextLog(words, level="WARN", color=WRONG))


def log_words(recording: rr.RecordingStream, episode: Episode, frame: int) -> None:
    """What an onlooker would say about the step that led to the frame, after what the agent says who chose it."""
    told: list[tuple[str, Rgb | None]] = []
    if frame:
        step = episode.steps[frame - 1]
        counted = f", {step.changed_pixels} pixels changed, reward {step.reward}" if rewards_known(episode) else ""
        color = (CORRECT if step.reward else MISSED) if counted else None
        told += [(said(episode, frame - 1), None), (sentence(episode, frame - 1) + counted, color)]
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
    if not len(visible(episode.image(0))):
        return f"pull at pixel ({done.pixel[0]}, {done.pixel[1]}) along ({along})"
    acted = acted_object(episode, step)
    changed = " and ".join(names[i] for i in changed_objects(episode, step)) or "nothing"
    return f"pull {names[acted] if acted >= 0 else 'the board'} along ({along}): {changed} changed"
