"""Quality against strength for every disturbance, as a figure: edges above, predictions below."""

from pathlib import Path
from typing import Any

from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter

from busybot.view.figures.parts import page, plain_axes, save
from busybot.view.palette import ACTION, INK, MUTED, RESPONDER, TRIGGER, Rgb, unit

PAGE_INCHES, DISTURBANCES_PER_ROW = (9.6, 7.6), 5
"""Inches, and disturbances side by side."""
OTHERS: tuple[Rgb, ...] = ((25, 180, 120), (150, 115, 245))
"""Of trained models after the first."""
BASELINES: dict[str, tuple[Rgb, str]] = {
    "lookup": (RESPONDER, "-"),
    "lookup at best": (RESPONDER, "--"),
    "count": (TRIGGER, "-"),
    "count at best": (TRIGGER, "--"),
}
SHARES = ("of frames", "of actions", "of boards")
"""Units of strengths from 0 to 1."""
SCORES = {"edge_f1": "edges (F1)", "pred_a": "Pred-A"}


def robustness_figure(path: Path, result: dict[str, Any], root: Path | None = None) -> Path:
    """Every disturbance in two plots with a common axis of strength; 0 is the undisturbed recording.

    Args:
        result: of `benchmarks.studies.reason_robustness`.
        root: the folder that the user named, if it is not the one the picture lies in; see `files`.
    """
    names = [name for name in result["disturbances"] if name in result["rows"]]
    bands = -(-len(names) // DISTURBANCES_PER_ROW)
    figure = page(PAGE_INCHES[0], PAGE_INCHES[1] * bands / 2 + 0.3)
    grid = figure.subplots(2 * bands, DISTURBANCES_PER_ROW, squeeze=False, sharey=True)
    styles = _styles(list(result["models"]))
    for place in range(bands * DISTURBANCES_PER_ROW):
        band, column = divmod(place, DISTURBANCES_PER_ROW)
        for half, score in enumerate(SCORES):
            axes = grid[2 * band + half, column]
            if place < len(names):
                _draw(axes, names[place], result, score, styles)
                if not column:
                    axes.set_ylabel(SCORES[score], fontsize=8, color=unit(MUTED))
            else:
                axes.set_axis_off()
    handles = [Line2D([], [], color=unit(color), ls=line, label=name) for name, (color, line) in styles.items()]
    handles.append(Line2D([], [], color=unit(INK), linestyle=":", linewidth=1, label="could be known"))
    figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False, fontsize=8, labelcolor=unit(INK))
    return save(figure, path, root)


def title_of(result: dict[str, Any], name: str) -> str:
    """A disturbance in a few words."""
    return result["disturbances"].get(name, {}).get("title") or name


def strength_words(result: dict[str, Any], name: str, value: float) -> str:
    """With its unit: "20 % of frames", "5 pixels"."""
    unit_words = result["disturbances"][name]["unit"]
    return f"{100 * value:g} % {unit_words}" if unit_words in SHARES else f"{value:g} {unit_words}"


def _styles(trained: list[str]) -> dict[str, tuple[Rgb, str]]:
    colors = (ACTION, *OTHERS)
    return {**BASELINES, **{name: (colors[number % len(colors)], "-") for number, name in enumerate(trained)}}


def _draw(axes: Any, name: str, result: dict[str, Any], score: str, styles: dict[str, tuple[Rgb, str]]) -> None:
    words = result["disturbances"][name]["unit"]
    rows = [*result["rows"].get("undisturbed", []), *result["rows"][name]]
    plain_axes(axes)
    axes.set_ylim(-0.03, 1.04)
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    for model, (color, line) in styles.items():
        points = [(row["strength"], row["models"][model][score]) for row in rows if model in row["models"]]
        known = [(x, y) for x, y in points if y is not None]
        if known:
            front = model in result["models"]
            width, marker = (2.2, 4.5) if front else (1.3, 2.5)
            axes.plot(
                *zip(*known, strict=True), line, marker="o", markersize=marker, linewidth=width, color=unit(color),
                zorder=5 if front else 3, clip_on=False,
            )  # fmt: skip
    if score == "pred_a":
        bound = [(row["strength"], row["known"]) for row in rows]
        axes.plot(*zip(*bound, strict=True), ":", linewidth=1, color=unit(INK), zorder=2)
        axes.set_xlabel(words, fontsize=7.5, color=unit(MUTED))
    else:
        axes.set_title(title_of(result, name), loc="left", fontsize=8, fontweight="bold", color=unit(INK), pad=4)
        axes.tick_params(labelbottom=False)
    axes.set_xticks([row["strength"] for row in rows])
    axes.xaxis.set_major_formatter("{x:g}")
    if words in SHARES:
        axes.xaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
