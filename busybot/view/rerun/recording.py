"""An episode in Rerun: what is logged when. Every call to Rerun is in this folder.

Timelines: `step` k shows the board after k actions, with the action that led there (0 is the start); `time` is the
episode's own clock, one second a step.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
from rerun.error_utils import catch_and_log_exceptions

from busybot.common.atomic_io import replacing_by_path
from busybot.common.errors import BusybotError
from busybot.episodes.episode import Episode
from busybot.interact.policy.policy_trace import PolicyTrace
from busybot.reason.evaluation.prediction import Explanation
from busybot.reason.models.base import InferredGraph
from busybot.view.annotations import check_inferred, judged_edges, pairs_ever, true_edges
from busybot.view.rerun.blueprint import blueprint
from busybot.view.rerun.board import BoardLogger
from busybot.view.rerun.camera import SIMULATOR, log_camera_frame, log_goal, log_remaining, log_replayed
from busybot.view.rerun.graph import edge_places, log_graph
from busybot.view.rerun.series import (
    log_probabilities,
    log_probability_styles,
    log_series_styles,
    log_signals,
    log_states,
    log_words,
)
from busybot.view.rerun.skills import (
    AFFORDANCE,
    EXPECTED,
    has_choices,
    log_choice,
    log_foreseen,
    log_lanes,
    log_thought,
)

APPLICATION = "busybot"
_BATCHES = rr.ChunkBatcherConfig(flush_tick=3600.0)
"""Chunks by size, not by the clock: equal episodes give equal chunks."""


@dataclass(frozen=True)
class RecordingLayers:
    """What is shown beyond the recording; iterators are used up by one writing.

    Attributes:
        thoughts: what a model believed, of `interact.policy.policy_trace.retrace`.
        replayed: steps and the simulator's pictures of them, of `sim.replay.pictures_again`.
        foreseen: what a reasoner expected, of `reason.evaluation.explain`.
    """

    thoughts: Iterable[PolicyTrace] | None = None
    replayed: Iterable[tuple[int, np.ndarray]] | None = None
    foreseen: Explanation | None = None


def log_episode(recording: rr.RecordingStream, episode: Episode, inferred: Sequence[InferredGraph] = ()) -> None:
    """Log all of an episode and what was inferred about it."""
    board = BoardLogger(recording, episode)
    log_series_styles(recording)
    board.log_static()
    if episode.goal is not None:
        log_goal(recording, episode)
    truth = true_edges(episode.board)
    straight = edge_places(episode, [(edge.cause, edge.effect) for edge in truth])
    log_graph(recording, ["graph", "true"], episode, truth, straight, truth=True)
    choices = has_choices(episode)
    places = {graph.name: edge_places(episode, pairs_ever(episode.board, graph)) for graph in inferred}
    for graph in inferred:
        log_probability_styles(recording, episode, graph)
    for frame in range(len(episode.frame_of)):
        _set_clock(recording, frame)
        log_camera_frame(recording, episode, frame)
        log_remaining(recording, episode, frame)
        board.log_frame(frame)
        if frame == 0:
            board.log_true_relations(truth)  # their arcs start at the objects' tops, known from the first frame
        log_signals(recording, episode, frame)
        log_states(recording, episode, frame)
        log_words(recording, episode, frame)
        if choices and frame:
            log_choice(recording, episode, frame - 1)
        for graph in inferred:
            edges = judged_edges(episode.board, graph, frame)
            log_graph(recording, ["graph", graph.name], episode, edges, places[graph.name])
            board.log_inferred_relations(graph.name, edges)
            log_probabilities(recording, episode, graph, frame)


def log_layers(recording: rr.RecordingStream, episode: Episode, layers: RecordingLayers) -> None:
    """Log what is shown beyond the recording: a model's thoughts and expectations where their outcome is shown."""
    for thought in layers.thoughts or ():
        _set_clock(recording, thought.step + 1)
        log_thought(recording, episode, thought)
    for step, picture in layers.replayed or ():
        _set_clock(recording, step)
        log_replayed(recording, episode, step, picture)
    if layers.foreseen is not None:
        log_lanes(recording, episode, layers.foreseen)
        for frame in range(len(episode.frame_of)):
            _set_clock(recording, frame)
            log_foreseen(recording, episode, layers.foreseen, frame)


def _set_clock(recording: rr.RecordingStream, frame: int) -> None:
    recording.set_time("step", sequence=frame)
    recording.set_time("time", duration=float(frame))


def save_rrd(
    path: Path,
    episode: Episode,
    inferred: Sequence[InferredGraph] = (),
    menus: bool = True,
    layers: RecordingLayers | None = None,
) -> None:
    """Write an episode and its layout as an `.rrd` file for Rerun; without `menus` for a picture."""
    layers = layers or RecordingLayers()
    for graph in inferred:
        check_inferred(episode, graph)
    name = f"{episode.board.split} board {episode.board.index}, {episode.policy}"
    try:
        # in strict mode a mistake in logging raises; otherwise it would be a warning and a hole in the picture
        with replacing_by_path(path) as temporary, catch_and_log_exceptions(strict=True):
            recording = rr.RecordingStream(
                APPLICATION, recording_id=name, send_properties=False, batcher_config=_BATCHES
            )
            recording.set_log_time_enabled(False)
            recording.set_log_tick_enabled(False)
            given = {AFFORDANCE: layers.thoughts, SIMULATOR: layers.replayed, EXPECTED: layers.foreseen}
            shown = [space for space, layer in given.items() if layer is not None]
            recording.save(temporary, default_blueprint=blueprint(episode, inferred, menus, shown))
            recording.send_recording_name(name)
            log_episode(recording, episode, inferred)
            log_layers(recording, episode, layers)
            recording.flush()
            recording.disconnect()
    except OSError as error:
        raise BusybotError(f"{path}: cannot be written: {error.strerror}", "choose another place") from None
    except RuntimeError as error:
        raise BusybotError(f"{path}: Rerun cannot write it: {error}", "choose another place") from None
