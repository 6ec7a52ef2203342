"""How relations are found, action by action, in worlds whose causes are hard: a panel for the boards of each world."""

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path

from matplotlib.ticker import MaxNLocator

from busybot.view.figures import parts
from busybot.view.palette import (
    ACTION,
    CHANCE,
    CLAIMED,
    CORRECT,
    INK,
    LOCK,
    MISSED,
    MUTED,
    RESPONDER,
    TRIGGER,
    TRUTH,
    Rgb,
    unit,
)
from busybot.view.report.world_results import WorldRow

COLORS: tuple[Rgb, ...] = (ACTION, CORRECT, RESPONDER, TRIGGER, TRUTH, CHANCE, LOCK, CLAIMED, MISSED)
SHARES = (-0.02, 1.02)
MOST_LETTERS = 34
PER_LINE = 5
"""Names in a line of the legend."""


def discovery_figure(path: Path, groups: Mapping[str, Sequence[WorldRow]], root: Path | None = None) -> Path:
    """F1 of parents against the number of actions, a line for each row that was followed.

    Args:
        groups: rows by the boards that they are about.
        root: as `parts.save_png` takes it.
    """
    columns = min(3, len(groups))
    strips = -(-len(groups) // columns)
    figure = parts.page(parts.WIDTH if columns > 1 else 0.6 * parts.WIDTH, 0.6 + 2.1 * strips)
    grid = list(figure.subplots(strips, columns, squeeze=False, sharey=True, sharex=True).flat)
    names = dict.fromkeys(row.name for rows in groups.values() for row in rows if row.curve and not row.bound)
    colors = dict(zip(names, cycle(COLORS), strict=False))
    for axes in grid[len(groups) :]:
        axes.set_axis_off()
    for axes, (words, rows) in zip(grid, groups.items(), strict=False):
        parts.plain_axes(axes, SHARES)
        for row in rows:
            if row.curve:
                line, width = (":", 1.2) if row.bound else ("-", 1.6)
                color = unit(INK if row.bound else colors[row.name])
                marker = "o" if len(row.curve) < 5 else None
                axes.plot(
                    *zip(*row.curve, strict=True), line, color=color, linewidth=width, marker=marker, markersize=3
                )
        world, _, boards = words.partition(": ")
        parts.draw_title(axes, shown(world), _where(boards.replace("`", "")))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.tick_params(labelbottom=True)
        axes.set_xlabel("actions", fontsize=8, color=unit(MUTED))
    handles = [parts.line_key(shown(name), color) for name, color in colors.items()]
    if any(row.bound and row.curve for rows in groups.values() for row in rows):
        handles.append(parts.line_key("exact observer", INK, linestyle=":"))
    parts.draw_legend(figure, handles, min(PER_LINE, len(handles)))
    return parts.save_png(figure, path, root)


def _where(boards: str) -> str:
    """Which boards: in a second line what tells them from others at last, if one line has no room for it."""
    parted = [boards] if len(boards) <= MOST_LETTERS else boards.rsplit(", ", 1)
    return "\n".join(map(shown, parted))


def shown(name: str) -> str:
    """A name that is not too long; a line at its beginning does not hide it from the legend."""
    text = name if len(name) <= MOST_LETTERS else f"{name[: MOST_LETTERS - 3]}..."
    return text.removeprefix("_")
