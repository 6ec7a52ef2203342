"""The course of a training as a picture, drawn without a display from its lines of metrics (`metrics_file`)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

from busybot.common.atomic_io import write_atomically

WIDTH_INCHES, ROW_INCHES = 11.0, 3.25
MARKED = 60
"""Curves of fewer points show each of them."""

Lines = Sequence[Mapping[str, Any]]
Points = Sequence[tuple[float, float | None]]
"""A value of None is left out."""


@dataclass(frozen=True)
class Panel:
    """One of a picture's panels.

    Attributes:
        curves: points by label; labels of no points are left out.
        along: what the x axis counts.
        logarithmic: the y axis, where there is a curve.
        shares: the y axis goes from 0 to 1.
    """

    title: str
    curves: Mapping[str, Points]
    along: str = "iteration"
    logarithmic: bool = False
    shares: bool = False


def losses(lines: Lines) -> Points:
    """Mean losses of what was trained on."""
    return [(line["iteration"], line["loss"]) for line in lines if "loss" in line]


def judgements(lines: Lines, labels: Mapping[str, str] | None = None) -> dict[str, Points]:
    """Figures on held-out boards by label.

    Args:
        labels: of the figures that are wanted, by name; by default all by their names, in alphabetical order.
    """
    judged = [line for line in lines if line.get("validation")]
    if labels is None:
        labels = {name: name for name in sorted({name for line in judged for name in line["validation"]})}
    return {
        label: [(line["iteration"], line["validation"].get(name)) for line in judged] for name, label in labels.items()
    }


def draw(path: Path, panels: Sequence[Sequence[Panel]]) -> Path:
    """Write the picture with panels [row][column]."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH_INCHES, ROW_INCHES * len(panels)), layout="constrained")
    grid = figure.subplots(len(panels), len(panels[0]), squeeze=False)
    for row, of_row in zip(grid, panels, strict=True):
        for axes, panel in zip(row, of_row, strict=True):
            _draw_panel(axes, panel)
    buffer = BytesIO()
    FigureCanvasAgg(figure).print_png(buffer)
    write_atomically(path, buffer.getvalue())
    return path


def _draw_panel(axes: Any, panel: Panel) -> None:
    for label, points in panel.curves.items():
        known = [(x, y) for x, y in points if y is not None]
        if known:
            axes.plot(*zip(*known, strict=True), marker="." if len(known) < MARKED else None, linewidth=1, label=label)
    axes.set_title(panel.title)
    axes.set_xlabel(panel.along)
    axes.grid(alpha=0.3)
    if axes.get_lines():
        axes.legend(fontsize="small")
        if panel.logarithmic:
            axes.set_yscale("log")
    if panel.shares:
        axes.set_ylim(-0.02, 1.02)
