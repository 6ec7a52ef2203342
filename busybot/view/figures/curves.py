"""Plots of results: a table's numbers beside the paper's and the gates, scores that grow, and robustness.

Robustness is quality against strength for every disturbance: edges above, predictions below.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Any

from matplotlib.ticker import MaxNLocator, PercentFormatter

from busybot.common.errors import BusybotError
from busybot.evaluation.reference_tables import ReferenceRow, Role, Table
from busybot.view.figures import parts
from busybot.view.palette import ACTION, CORRECT, FAINT, INK, MISSED, MUTED, PAPER, RESPONDER, TRIGGER, TRUTH, Rgb, unit
from busybot.view.report.results import InteractResult, ReasonResult, RowFound, Score

ROLE_COLORS: dict[Role, Rgb] = {
    "ours": CORRECT,
    "ablation": RESPONDER,
    "competitor": RESPONDER,
    "trivial": MISSED,
    "bound": MISSED,
}
CURVES: dict[str, tuple[str, str, Rgb]] = {
    "edge_p": ("Edge-P", "-", CORRECT),
    "edge_r": ("Edge-R", "-", RESPONDER),
    "edge_r_bound": ("Edge-R bound", ":", RESPONDER),
    "pred_a": ("Pred-A", "-", ACTION),
    "pred_a_bound": ("Pred-A bound", ":", ACTION),
}
"""Key of `by_images` to name, line and colour."""
SHARES_SHOWN = (-0.02, 1.02)
ROLE_WORDS = {CORRECT: "ours", RESPONDER: "changed or another method", MISSED: "trivial, or an oracle"}
GATE: dict[str, Any] = {"linestyle": "", "marker": "|", "markersize": 10, "markeredgewidth": 1.6}
REFERENCE: dict[str, Any] = {"linestyle": "", "marker": "D", "markeredgecolor": unit(TRUTH)}
"""Marks of a gate and of the paper's numbers."""


LEAST_STRIP = 1.3
"""Height of a split's strip at least, inches: its name stands beside it."""


def table_figure(path: Path, table: Table, rows: Mapping[str, RowFound], root: Path | None = None) -> Path:
    """Every number of a table as a dot with its interval, the paper's as a diamond, the gate as a line."""
    lines = len(table.rows)
    figure = parts.page(parts.WIDTH, 0.9 + len(table.splits) * (0.35 + max(0.175 * lines, LEAST_STRIP)))
    grid = figure.subplots(len(table.splits), len(table.keys), squeeze=False, sharey=True, sharex=True)
    for strip, (split, words) in enumerate(table.splits.items()):
        for column, (key, head) in enumerate(table.keys.items()):
            axes = grid[strip, column]
            parts.plain_axes(axes)
            axes.grid(axis="y", color=unit(FAINT), linewidth=0.5)
            axes.set(xlim=(-4, 104), ylim=(lines - 0.4, -0.6), xticks=[0, 25, 50, 75, 100])
            axes.set_yticks(range(lines), [row.words.replace("**", "").replace("`", "") for row in table.rows])
            parts.draw_title(axes, head if strip == 0 else "")
            if column == 0:
                axes.set_ylabel(words, fontsize=8.5, fontweight="bold", color=unit(INK), labelpad=8)
            for place, row in enumerate(table.rows):
                score = rows[row.name].cells.get((split, key)) if row.name in rows else None
                _draw_row(axes, place, table, row, (split, key), score)
    dot = {"linestyle": "", "marker": "o", "markersize": 5}
    handles = [parts.line_key(words, color, **dot) for color, words in ROLE_WORDS.items()]
    handles += [parts.line_key("the paper", PAPER, markersize=5, **REFERENCE), parts.line_key("gate", ACTION, **GATE)]
    parts.draw_legend(figure, handles)
    return parts.save_png(figure, path, root)


def _draw_row(
    axes: Any, place: int, table: Table, row: ReferenceRow, column: tuple[str, str], score: Score | None
) -> None:
    gate = None if row.gate is None else table.at(table.gates[row.gate], *column)
    paper = None if row.paper is None else table.at(table.paper[row.paper], *column)
    if gate is not None:
        axes.plot([gate], [place], color=unit(ACTION), zorder=3, **GATE)
    if paper is not None:
        axes.plot([paper], [place], color=unit(PAPER), markersize=4.6, zorder=4, **REFERENCE)
    if score is None:
        return
    color = unit(ROLE_COLORS[row.role])
    if score.low is not None and score.high is not None:
        axes.plot([score.low, score.high], [place, place], color=color, linewidth=1.6, zorder=5, solid_capstyle="butt")
    axes.plot([score.value], [place], "o", markersize=4.6, color=color, zorder=6)


@dataclass(frozen=True)
class Course:
    """One panel of `courses_figure`."""

    title: str
    where: str
    result: InteractResult | ReasonResult


def courses_figure(path: Path, courses: Sequence[Course], root: Path | None = None) -> Path:
    """How scores grow: with actions, or with observed images; one panel for each result."""
    columns = min(3, len(courses))
    strips = -(-len(courses) // columns)
    figure = parts.page(parts.WIDTH if columns > 1 else 0.6 * parts.WIDTH, 0.5 + 2.1 * strips)
    grid = figure.subplots(strips, columns, squeeze=False, sharey=True)
    for place, axes in enumerate(grid.flat):
        parts.plain_axes(axes, SHARES_SHOWN)
        axes.set_visible(place < len(courses))
        if place < len(courses):
            _draw_course(axes, courses[place])
    pairs = [zip(*axes.get_legend_handles_labels(), strict=True) for axes in grid.flat]
    named = {label: handle for panel in pairs for handle, label in panel}
    parts.draw_legend(figure, list(named.values()))
    return parts.save_png(figure, path, root)


def _draw_course(axes: Any, course: Course) -> None:
    result = course.result
    if isinstance(result, ReasonResult):
        _draw_images(axes, [one.model_dump() for one in result.by_images])
    else:
        shown = (("recall", "links found", RESPONDER), ("precision", "of these actions right", CORRECT))
        for key, words, color in shown:
            points = [(n, step[key]) for n, step in enumerate(result.by_step, start=1) if step.get(key) is not None]
            axes.plot(*zip(*points, strict=True), marker="o", markersize=3, color=unit(color), label=words)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_xlabel("actions on a board", fontsize=8, color=unit(MUTED))
    parts.draw_title(axes, course.title, course.where)


def images_figure(path: Path, result: dict[str, Any]) -> Path:
    """How the scores of `busybot eval reason` grow with the number of observed images."""
    figure = parts.page(parts.WIDTH, 2.9)
    axes = figure.subplots()
    parts.plain_axes(axes, SHARES_SHOWN)
    _draw_images(axes, result["by_images"])
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    origin = result["dataset"]
    boards = f"{result['boards']} board{'s' * (result['boards'] != 1)}"
    parts.draw_title(axes, result["model"], f"{origin['name']} ({origin['split']}), {boards}")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=8, labelcolor=unit(INK))
    return parts.save_png(figure, path)


def _draw_images(axes: Any, by_images: Sequence[Mapping[str, float | None]]) -> None:
    """The curves of a result's `by_images`; what is undefined is left out."""
    for key, (name, line, color) in CURVES.items():
        points = [(one["images"], one[key]) for one in by_images if one[key] is not None]
        if points:
            marker = "o" if len(points) < len(by_images) else None
            axes.plot(*zip(*points, strict=True), line, marker=marker, markersize=3, color=unit(color), label=name)
    axes.set_xlabel("observed images", fontsize=8, color=unit(MUTED))


PAGE_INCHES, DISTURBANCES_PER_ROW = (9.6, 7.6), 5
"""Inches, and disturbances side by side."""
MODELS: tuple[Rgb, ...] = (ACTION, CORRECT, TRUTH)
"""Of trained models, the first one foremost."""
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
        root: as `parts.save_png` takes it.

    Raises:
        BusybotError: no disturbance was measured.
    """
    names = [name for name in result["disturbances"] if name in result["rows"]]
    if not names:
        raise BusybotError(f"{path}: no disturbance was measured, so there is nothing to draw", "measure one")
    bands = -(-len(names) // DISTURBANCES_PER_ROW)
    figure = parts.page(PAGE_INCHES[0], PAGE_INCHES[1] * bands / 2 + 0.3)
    grid = figure.subplots(2 * bands, DISTURBANCES_PER_ROW, squeeze=False, sharey=True)
    trained = {name: (color, "-") for name, color in zip(result["models"], cycle(MODELS), strict=False)}
    styles = {**BASELINES, **trained}
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
    handles = [parts.line_key(name, color, linestyle=line) for name, (color, line) in styles.items()]
    parts.draw_legend(figure, [*handles, parts.line_key("could be known", INK, linestyle=":", linewidth=1)], 6)
    return parts.save_png(figure, path, root)


def title_of(result: dict[str, Any], name: str) -> str:
    """A disturbance in a few words."""
    return result["disturbances"].get(name, {}).get("title") or name


def strength_words(result: dict[str, Any], name: str, value: float) -> str:
    """With its unit: "20 % of frames", "5 pixels"."""
    unit_words = result["disturbances"][name]["unit"]
    return f"{100 * value:g} % {unit_words}" if unit_words in SHARES else f"{value:g} {unit_words}"


def _draw(axes: Any, name: str, result: dict[str, Any], score: str, styles: dict[str, tuple[Rgb, str]]) -> None:
    words = result["disturbances"][name]["unit"]
    rows = [*result["rows"].get("undisturbed", []), *result["rows"][name]]
    parts.plain_axes(axes, (-0.03, 1.04))
    for model, (color, line) in styles.items():
        points = [(row["strength"], row["models"][model][score]) for row in rows if model in row["models"]]
        known = [(x, y) for x, y in points if y is not None]
        if known:
            front = model in result["models"]
            sizes = {"linewidth": 2.2, "markersize": 4.5} if front else {"linewidth": 1.3, "markersize": 2.5}
            style = {"marker": "o", "color": unit(color), "zorder": 5 if front else 3, "clip_on": False}
            axes.plot(*zip(*known, strict=True), line, **style, **sizes)
    if score == "pred_a":
        bound = [(row["strength"], row["known"]) for row in rows]
        axes.plot(*zip(*bound, strict=True), ":", linewidth=1, color=unit(INK), zorder=2)
        axes.set_xlabel(words, fontsize=7.5, color=unit(MUTED), parse_math=False)
    else:
        title = axes.set_title(title_of(result, name), loc="left", fontsize=8, color=unit(INK), pad=4)
        title.set(fontweight="bold", parse_math=False)
        axes.tick_params(labelbottom=False)
    axes.set_xticks([row["strength"] for row in rows])
    axes.xaxis.set_major_formatter("{x:g}")
    if words in SHARES:
        axes.xaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
