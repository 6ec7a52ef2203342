"""An episode in Rerun: what is logged when, and where everything is. Every call to Rerun is in this folder.

Timelines: `step` k shows the board after k actions, with the action that led there (0 is the start); `time` is the
episode's own clock, one second a step. The layout: what the camera sees, what follows from it, the board in 3-D; below,
how it came.
"""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.error_utils import catch_and_log_exceptions

from busybot.boards.spec import PAPER
from busybot.common.atomic_io import replacing_by_path
from busybot.common.errors import BusybotError
from busybot.episodes.episode import Episode
from busybot.interact.policy.policy_trace import PolicyTrace
from busybot.reason.evaluation.prediction import Explanation
from busybot.reason.models.base import InferredGraph
from busybot.view.annotations import board_bounds, check_inferred, judged_edges, pairs_ever, true_edges
from busybot.view.mechanisms import MechanismView, mechanism_view
from busybot.view.rerun import camera, series, skills
from busybot.view.rerun.board import BoardLogger
from busybot.view.rerun.graph import (
    edge_places,
    factor_places,
    label_extents,
    log_graph,
    log_mechanisms,
    mechanism_extents,
)

APPLICATION = "busybot"
_BATCHES = rr.ChunkBatcherConfig(flush_tick=3600.0)
"""Chunks by size, not by the clock: equal episodes give equal chunks."""
BACKGROUND = (13, 16, 17)
GRAPH_MARGIN = 14.0
"""Around the outermost labels, graph units."""
COLUMNS = [1, 0.95, 1.12]
GOAL_COLUMN = 1
CHOICE_WORDS = "Choice: candidates black, repeats orange"
LEGEND_EDGE, LEGEND_LETTER, LEGEND_MOST = 0.07, 0.0155, 0.5
"""Shares of a plot's width (in a window 1600 pixels wide) that its legend takes: by itself, for a letter, at most."""

LAYERS = {
    "replayed": (camera.SIMULATOR, "Simulator, the step put back: violet differs"),
    "foreseen": (skills.EXPECTED, "Expected and seen: red is wrong"),
    "thoughts": (skills.AFFORDANCE, "Affordance before the action: candidates, known links"),
}
"""What may stand before the camera's picture, by the fields of `RecordingLayers`: space, and name of its view."""


@dataclass(frozen=True)
class RecordingLayers:
    """What is shown beyond the recording; iterators are used up by one writing.

    Attributes:
        thoughts: what a model believed, of `interact.policy.policy_trace.retrace`.
        replayed: steps and the simulator's pictures of them, of `sim.replay.pictures_again`.
        foreseen: what a reasoner expected, of `reason.evaluation.prediction.explain`.
    """

    thoughts: Iterable[PolicyTrace] | None = None
    replayed: Iterable[tuple[int, np.ndarray]] | None = None
    foreseen: Explanation | None = None


def log_episode(
    recording: rr.RecordingStream, episode: Episode, inferred: Sequence[InferredGraph], view: MechanismView | None
) -> None:
    """Log all of an episode and what was inferred about it; `view` is its `mechanism_view`."""
    board = BoardLogger(recording, episode)
    series.log_series_styles(recording)
    board.log_static()
    if view is None:
        truth = true_edges(episode.board)
        straight = edge_places(episode, [(edge.cause, edge.effect) for edge in truth])
        log_graph(recording, ["graph", "true"], episode, truth, straight, truth=True)
    else:
        series.log_mechanism_words(recording, view)
        series.log_causes(recording, view)
        middles = factor_places(view)
    moments = view.moments if view else [0]
    choices = skills.has_choices(episode)
    places = {graph.name: edge_places(episode, pairs_ever(episode.board, graph)) for graph in inferred}
    for frame in range(len(episode.frame_of)):
        _set_clock(recording, frame)
        camera.log_camera_frame(recording, episode, frame)
        camera.log_goal(recording, episode, frame)
        board.log_frame(frame)
        if view is not None:
            log_mechanisms(recording, ["graph", "true"], view, frame, middles)
            series.log_change_words(recording, view, frame)
        if frame in moments:
            # their arcs start at the objects' tops, known from the first frame
            board.log_true_relations(true_edges(episode.board, frame), static=len(moments) == 1)
        series.log_signals(recording, episode, frame)
        if view is None:
            series.log_states(recording, episode, frame)
        series.log_words(recording, episode, frame)
        if choices and frame:
            skills.log_choice(recording, episode, frame - 1)
        for graph in inferred:
            edges = judged_edges(episode.board, graph, frame)
            log_graph(recording, ["graph", graph.name], episode, edges, places[graph.name])
            board.log_inferred_relations(graph.name, edges)
            series.log_probabilities(recording, episode, graph, frame)


def log_layers(recording: rr.RecordingStream, episode: Episode, layers: RecordingLayers) -> None:
    """Log what is shown beyond the recording: a model's thoughts and expectations where their outcome is shown."""
    for thought in layers.thoughts or ():
        _set_clock(recording, thought.step + 1)
        skills.log_thought(recording, episode, thought)
    for step, picture in layers.replayed or ():
        _set_clock(recording, step)
        camera.log_replayed(recording, episode, step, picture)
    if layers.foreseen is not None:
        skills.log_lanes(recording, episode, layers.foreseen)
        for frame in range(len(episode.frame_of)):
            _set_clock(recording, frame)
            skills.log_foreseen(recording, episode, layers.foreseen, frame)


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
    view = mechanism_view(episode)
    try:
        # in strict mode a mistake in logging raises; otherwise it would be a warning and a hole in the picture
        with replacing_by_path(path) as temporary, catch_and_log_exceptions(strict=True):
            recording = rr.RecordingStream(
                APPLICATION, recording_id=_identity(episode), send_properties=False, batcher_config=_BATCHES
            )
            recording.set_log_time_enabled(False)
            recording.set_log_tick_enabled(False)
            recording.save(temporary, default_blueprint=blueprint(episode, inferred, layers, view, menus))
            recording.send_recording_name(name)
            log_episode(recording, episode, inferred, view)
            log_layers(recording, episode, layers)
            recording.flush()
            recording.disconnect()
    except OSError as error:
        raise BusybotError(f"{path}: cannot be written: {error.strerror}", "choose another place") from None
    except RuntimeError as error:
        raise BusybotError(f"{path}: Rerun cannot write it: {error}", "choose another place") from None


def _identity(episode: Episode) -> str:
    """The recording's id: Rerun puts what has one id into one recording, and board 0 of a split is in many datasets."""
    made = hashlib.sha256(f"{episode.board.digest()} {episode.policy} {episode.settings} {episode.renderer}".encode())
    made.update(episode.actions.tobytes())
    return made.hexdigest()[:32]


def blueprint(
    episode: Episode,
    inferred: Sequence[InferredGraph],
    layers: RecordingLayers,
    view: MechanismView | None,
    menus: bool = True,
) -> rrb.Blueprint:
    """The layout of an episode's recording; without `menus` nothing but the views and the time is shown."""
    graphs = graph_views(episode, inferred, view)
    if skills.has_choices(episode):
        graphs = rrb.Tabs(_picture_view(episode, skills.CHOICE, CHOICE_WORDS), *graphs.contents)
    upper = [camera_views(episode, layers), graphs, board_view()]
    shares = [*COLUMNS]
    if episode.goal is not None:
        upper.insert(1, _picture_view(episode, camera.GOAL, "Goal: red differs still"))
        shares.insert(1, GOAL_COLUMN)
    beliefs = [belief_views(episode, inferred)] if inferred else []
    signals, account = signal_views(episode), account_views(episode, layers.foreseen is not None)
    if view is not None:
        words = rrb.TextDocumentView(origin="mechanisms", name="Mechanisms (privileged)")
        signals = rrb.Tabs(words, *signals.contents)
    parts = [signals, *beliefs, account]
    lower = rrb.Horizontal(*parts, column_shares=COLUMNS if inferred else [1, 1])
    panel: Literal["collapsed", "hidden"] = "collapsed" if menus else "hidden"
    return rrb.Blueprint(
        rrb.Vertical(rrb.Horizontal(*upper, column_shares=shares), lower, row_shares=[1.6, 1]),
        rrb.TopPanel(state=panel),
        rrb.BlueprintPanel(state=panel),
        rrb.SelectionPanel(state=panel),
        rrb.TimePanel(state="collapsed", timeline="step", fps=2.0),
        auto_views=False,
        auto_layout=False,
    )


def camera_views(episode: Episode, layers: RecordingLayers) -> Any:
    """The image, closely around the board, and depth behind it; in front of both what else was asked for."""
    views = [view for name, view in LAYERS.items() if getattr(layers, name) is not None]
    views += [("camera", "Camera: boxes, action, change"), ("depth", "Depth")]
    return rrb.Tabs(*(_picture_view(episode, origin, name) for origin, name in views))


def _picture_view(episode: Episode, origin: str, name: str) -> Any:
    bounds = _bounds(*board_bounds(episode, camera.VIEW_MARGIN))
    return rrb.Spatial2DView(origin=origin, name=name, visual_bounds=bounds, background=BACKGROUND)


def graph_views(episode: Episode, inferred: Sequence[InferredGraph], view: MechanismView | None) -> Any:
    """Inferred scene graphs first, the true one behind them, in the camera's layout; mechanisms stand before both."""
    views = [
        rrb.GraphView(
            origin=f"graph/{graph.name}",
            name=f"Inferred scene graph: {graph.name}",
            visual_bounds=_around(label_extents(episode, pairs_ever(episode.board, graph))),
        )
        for graph in inferred
    ]
    if view is None:
        extents = label_extents(episode, [(edge.cause, edge.effect) for edge in true_edges(episode.board)])
        return rrb.Tabs(*views, _true_view("True scene graph", extents))
    name = "True mechanisms: chance teal, clocks grey, locks brown"
    return rrb.Tabs(_true_view(name, mechanism_extents(view)), *views)


def _true_view(name: str, extents: np.ndarray) -> Any:
    return rrb.GraphView(origin="graph/true", name=name, visual_bounds=_around(extents))


def _around(extents: np.ndarray) -> rrb.VisualBounds2D:
    """A square, as the graph keeps its aspect, around boxes (B, 4); a small one without any."""
    extents = extents if len(extents) else np.zeros((1, 4))
    low, high = extents[:, :2].min(0), extents[:, 2:].max(0)
    half = np.max(high - low) / 2 + GRAPH_MARGIN
    return _bounds((low + high) / 2 - half, (low + high) / 2 + half)


def _bounds(low: np.ndarray, high: np.ndarray) -> rrb.VisualBounds2D:
    return rrb.VisualBounds2D(x_range=[low[0], high[0]], y_range=[low[1], high[1]])


def board_view() -> Any:
    """The board from the front and above."""
    eye = rrb.EyeControls3D(position=(0.0, -3.45, 4.15), look_target=(0.0, -0.1, 0.15), eye_up=(0.0, 0.0, 1.0))
    return rrb.Spatial3DView(
        origin="world",
        name="Board: true relations violet, inferred green, wrong red",
        eye_controls=eye,
        background=BACKGROUND,
        line_grid=False,
    )


def signal_views(episode: Episode) -> Any:
    """Changed pixels against the reward's threshold; the reward itself."""
    highest = max([step.changed_pixels for step in episode.steps], default=0)
    axis = rrb.ScalarAxis(range=(0.0, max(1.1 * highest, 100.0)))
    signals = rrb.TimeSeriesView(
        origin="signals",
        name="Changed pixels (line: threshold, dots: reward)",
        axis_x=_steps_axis(len(episode.steps) + 1),
        axis_y=axis,
        plot_legend=rrb.PlotLegend(visible=False),
    )
    reward = rrb.TimeSeriesView(origin="reward", name="Reward", axis_y=rrb.ScalarAxis(range=(-0.1, 1.1)))
    return rrb.Tabs(signals, reward)


def _steps_axis(last: int) -> Any:
    """All steps from the start to `last`."""
    start, end = rrb.TimeRangeBoundary.absolute(seq=0), rrb.TimeRangeBoundary.absolute(seq=max(last, 1))
    return rrb.TimeAxis(view_range=rrb.TimeRange(start=start, end=end))


def belief_views(episode: Episode, inferred: Sequence[InferredGraph]) -> Any:
    """Probabilities of the edges worth a curve, and of all pairs as a heat map, for each reasoner."""
    views: list[Any] = []
    for graph in inferred:
        name, last = graph.name, round(len(episode.steps) / (1 - _legend_share(episode, graph)))
        curves = rrb.TimeSeriesView(
            origin=f"inference/{name}/edges",
            name=f"Edge probabilities: {name}",
            axis_x=_steps_axis(last),  # room for the legend at the right
            axis_y=rrb.ScalarAxis(range=(0.0, 1.05)),
            plot_legend=rrb.PlotLegend(corner="rightbottom"),
        )
        heat = rrb.TensorView(
            origin=f"inference/{name}/probabilities",
            name="Matrix",
            scalar_mapping=rrb.TensorScalarMapping(colormap="inferno", mag_filter="nearest"),
            view_fit="fill",
        )
        views += [curves, heat]
    return rrb.Tabs(*views)


def _legend_share(episode: Episode, inferred: InferredGraph) -> float:
    """Of a plot's width, kept free for its legend at the right."""
    longest = max(map(len, series.curve_names(episode, inferred).values()), default=0)
    return min(LEGEND_EDGE + LEGEND_LETTER * longest, LEGEND_MOST)


def account_views(episode: Episode, foreseen: bool) -> Any:
    """What was expected, the simulator's discrete states (in other worlds than the paper's with what each change goes
    back to), which no learner sees, and the steps in words.

    The words come first where an agent said why.
    """
    expected = rrb.StateTimelineView(origin=skills.LANES, name="What responders show, and what was expected")
    states = rrb.StateTimelineView(origin="states", name="States (privileged: no learner sees them)")
    columns = rrb.TextLogColumns(timeline_columns=["step"], text_log_columns=["body"])
    words = rrb.TextLogView(origin="log", name="In words", columns=columns)
    if episode.board.world != PAPER:
        states = rrb.StateTimelineView(origin="causes", name="Cause and effect (privileged)")
    views = ([expected] if foreseen else []) + ([states] if series.relation_states(episode, 0) else [])
    return rrb.Tabs(words, *views) if skills.has_choices(episode) else rrb.Tabs(*views, words)
