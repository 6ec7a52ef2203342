"""Figures of trainings, drawn without a display."""

from collections.abc import Iterable, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

from busybot.files import write_atomically

WIDTH_INCHES, ROW_INCHES = 11.0, 3.25


def new_figure(rows: int, columns: int) -> tuple[Any, Any]:
    """A figure and its panels [row][column]."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH_INCHES, ROW_INCHES * rows), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False)


def plot_points(panel: Any, points: Iterable[tuple[float, float | None]], label: str) -> None:
    """A line through the points that have a value; nothing without any."""
    known = [(x, y) for x, y in points if y is not None]
    if known:
        panel.plot(*zip(*known, strict=True), marker="." if len(known) < 60 else None, linewidth=1, label=label)


def label_panels(titles: Mapping[Any, str]) -> None:
    """Titles over panels whose x axis counts iterations, a grid, and a legend where there is a line."""
    for panel, title in titles.items():
        panel.set_title(title)
        panel.set_xlabel("iteration")
        panel.grid(alpha=0.3)
        if panel.get_lines():
            panel.legend(fontsize="small")


def save_png(figure: Any, path: Path) -> Path:
    """Write the picture."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    buffer = BytesIO()
    FigureCanvasAgg(figure).print_png(buffer)
    write_atomically(path, buffer.getvalue())
    return path
