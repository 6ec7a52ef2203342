"""An episode in Rerun: what is logged when. Every call to Rerun is in this folder.

Timelines: `step` k shows the board after k actions, with the action that led there (0 is the start); `time` is the
episode's own clock, one second a step.
"""

import os
from collections.abc import Sequence
from pathlib import Path

import rerun as rr

from busybot.episodes.episode import Episode
from busybot.reason.result import InferredGraph
from busybot.view.blueprint import blueprint
from busybot.view.rerun_board import BoardLogger
from busybot.view.rerun_camera import log_camera_frame
from busybot.view.rerun_graph import log_graph
from busybot.view.rerun_series import (
    log_probabilities,
    log_probability_styles,
    log_series_styles,
    log_signals,
    log_states,
    log_words,
)
from busybot.view.scene import check_inferred, judged_edges, true_edges

APPLICATION = "busybot"


def log_episode(recording: rr.RecordingStream, episode: Episode, inferred: Sequence[InferredGraph] = ()) -> None:
    """Log all of an episode and what was inferred about it."""
    board = BoardLogger(recording, episode)
    recording.disable_timeline("log_time")
    log_series_styles(recording)
    board.log_static()
    for graph in inferred:
        log_probability_styles(recording, episode, graph)
    for frame in range(len(episode.frame_of)):
        recording.set_time("step", sequence=frame)
        recording.set_time("time", duration=float(frame))
        log_camera_frame(recording, episode, frame)
        board.log_frame(frame)
        log_signals(recording, episode, frame)
        log_states(recording, episode, frame)
        log_words(recording, episode, frame)
        for graph in inferred:
            edges = judged_edges(episode.board, graph, frame)
            log_graph(recording, ["graph", graph.name], episode, edges)
            board.log_inferred_relations(graph.name, edges)
            log_probabilities(recording, episode, graph, frame)
    board.log_true_relations(true_edges(episode.board))
    log_graph(recording, ["graph", "true"], episode, true_edges(episode.board), truth=True)


def save_rrd(path: Path, episode: Episode, inferred: Sequence[InferredGraph] = (), menus: bool = True) -> None:
    """Write an episode and its layout as an `.rrd` file for Rerun; without `menus` for a picture."""
    for graph in inferred:
        check_inferred(episode, graph)
    name = f"{episode.board.split} board {episode.board.index}, {episode.policy}"
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        recording = rr.RecordingStream(APPLICATION, recording_id=name)
        recording.save(temporary, default_blueprint=blueprint(episode, list(inferred), menus))
        log_episode(recording, episode, inferred)
        recording.flush()
        recording.disconnect()
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
