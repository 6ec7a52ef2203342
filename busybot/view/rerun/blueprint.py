"""Rerun, where everything is: what the camera sees, what follows from it, the board in 3-D; below, how it came."""

from collections.abc import Collection, Sequence
from typing import Any, Literal

import numpy as np
import rerun.blueprint as rrb

from busybot.episodes.episode import Episode
from busybot.reason.models.base import InferredGraph
from busybot.view.annotations import board_bounds
from busybot.view.rerun.camera import GOAL, SIMULATOR, VIEW_MARGIN
from busybot.view.rerun.graph import graph_positions
from busybot.view.rerun.series import relation_states
from busybot.view.rerun.skills import AFFORDANCE, CHOICE, EXPECTED, LANES, has_choices

BACKGROUND = (13, 16, 17)
GRAPH_MARGIN = 44.0
"""Around the outermost nodes, graph units."""
COLUMNS = [1, 0.95, 1.12]
GOAL_COLUMN = 1
CHOICE_WORDS = "Choice: candidates black, repeats orange"
LEGEND_SHARE = 0.38
"""Of a plot's width, kept free for its legend."""


LAYERS = {
    SIMULATOR: "Simulator, the step put back: violet differs",
    EXPECTED: "Expected and seen: red is wrong",
    AFFORDANCE: "Affordance before the action: candidates, known links",
}
"""What may stand before the camera's picture: spaces with the names of their views."""


def blueprint(
    episode: Episode, inferred: Sequence[InferredGraph], menus: bool = True, shown: Collection[str] = ()
) -> rrb.Blueprint:
    """The layout of an episode's recording.

    Args:
        menus: without them nothing but the views and the time is shown.
        shown: which of `LAYERS` the recording has.
    """
    names = [graph.name for graph in inferred]
    graphs = graph_views(episode, names)
    if has_choices(episode):
        graphs = rrb.Tabs(_picture_view(episode, CHOICE, CHOICE_WORDS), *graphs.contents)
    upper = [camera_views(episode, shown), graphs, board_view()]
    shares = [*COLUMNS]
    if episode.goal is not None:
        upper.insert(1, _picture_view(episode, GOAL, "Goal: red differs still"))
        shares.insert(1, GOAL_COLUMN)
    beliefs = [belief_views(episode, names)] if names else []
    parts = [signal_views(episode), *beliefs, account_views(episode, EXPECTED in shown)]
    lower = rrb.Horizontal(*parts, column_shares=COLUMNS if names else [1, 1])
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


def camera_views(episode: Episode, shown: Collection[str]) -> Any:
    """The image, closely around the board, and depth behind it; in front of both what else was asked for."""
    layers = {space: words for space, words in LAYERS.items() if space in shown}
    views = {**layers, "camera": "Camera: boxes, action, change", "depth": "Depth"}
    return rrb.Tabs(*(_picture_view(episode, origin, name) for origin, name in views.items()))


def _picture_view(episode: Episode, origin: str, name: str) -> Any:
    bounds = _bounds(*board_bounds(episode, VIEW_MARGIN))
    return rrb.Spatial2DView(origin=origin, name=name, visual_bounds=bounds, background=BACKGROUND)


def _bounds(low: np.ndarray, high: np.ndarray) -> rrb.VisualBounds2D:
    return rrb.VisualBounds2D(x_range=[low[0], high[0]], y_range=[low[1], high[1]])


def graph_views(episode: Episode, names: list[str]) -> Any:
    """Inferred scene graphs first, the true one behind them, in the camera's layout."""
    bounds = graph_bounds(episode)
    views = [rrb.GraphView(origin=f"graph/{n}", name=f"Inferred scene graph: {n}", visual_bounds=bounds) for n in names]
    true = rrb.GraphView(origin="graph/true", name="True scene graph", visual_bounds=bounds)
    return rrb.Tabs(*views, true)


def graph_bounds(episode: Episode) -> rrb.VisualBounds2D:
    """All nodes with their labels; square, as the graph keeps its aspect."""
    places = graph_positions(episode)
    middle, half = (places.min(0) + places.max(0)) / 2, np.max(places.max(0) - places.min(0)) / 2 + GRAPH_MARGIN
    return _bounds(middle - half, middle + half)


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


def belief_views(episode: Episode, names: list[str]) -> Any:
    """Probabilities of the edges worth a curve, and of all pairs as a heat map, for each reasoner."""
    last = round(len(episode.steps) * (1 + LEGEND_SHARE))
    views: list[Any] = []
    for name in names:
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


def account_views(episode: Episode, foreseen: bool) -> Any:
    """What was expected, the simulator's discrete states, which no learner sees, and the steps in words.

    The words come first where an agent said why.
    """
    expected = rrb.StateTimelineView(origin=LANES, name="What responders show, and what was expected")
    states = rrb.StateTimelineView(origin="states", name="States (privileged: no learner sees them)")
    columns = rrb.TextLogColumns(timeline_columns=["step"], text_log_columns=["body"])
    words = rrb.TextLogView(origin="log", name="In words", columns=columns)
    views = ([expected] if foreseen else []) + ([states] if relation_states(episode, 0) else [])
    return rrb.Tabs(words, *views) if has_choices(episode) else rrb.Tabs(*views, words)
