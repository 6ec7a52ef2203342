"""What `busybot eval reason` found, as a picture: how scores grow with the number of observed images."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.ticker import MaxNLocator, PercentFormatter

from busybot.view.figure_parts import draw_title, page, plain_axes, save
from busybot.view.palette import ACTION, CORRECT, INK, MUTED, RESPONDER, Rgb, unit

WIDTH, HEIGHT = 9.6, 2.9
"""Inches."""
CURVES: dict[str, tuple[str, str, Rgb]] = {
    "edge_p": ("Edge-P", "-", CORRECT),
    "edge_r": ("Edge-R", "-", RESPONDER),
    "edge_r_bound": ("Edge-R bound", ":", RESPONDER),
    "pred_a": ("Pred-A", "-", ACTION),
    "pred_a_bound": ("Pred-A bound", ":", ACTION),
}
"""Key of `by_images` to name, line and colour."""


def images_figure(path: Path, result: dict[str, Any]) -> Path:
    """Draw the curves of `by_images` of an evaluation's result."""
    figure = page(WIDTH, HEIGHT)
    axes = figure.subplots()
    plain_axes(axes)
    draw_curves(axes, result["by_images"])
    axes.set_ylim(-0.02, 1.02)
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("observed images", fontsize=8, color=unit(MUTED))
    origin = result["dataset"]
    draw_title(axes, result["model"], f"{origin['name']} ({origin['split']}), {result['boards']} boards")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=8, labelcolor=unit(INK))
    return save(figure, path)


def draw_curves(axes: Any, by_images: Sequence[Mapping[str, float | None]]) -> None:
    """The curves of a result's `by_images`; what is undefined is left out."""
    for key, (name, line, color) in CURVES.items():
        points = [(one["images"], one[key]) for one in by_images if one[key] is not None]
        if points:
            marker = "o" if len(points) < len(by_images) else None
            axes.plot(*zip(*points, strict=True), line, marker=marker, markersize=3, color=unit(color), label=name)
