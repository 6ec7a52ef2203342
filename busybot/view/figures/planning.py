"""The paper's planning sequences: the start, the board after each action with the action, and the goal beside them.

Responders that do not look as in the goal yet are framed; below each picture stands why the agent did what it did.
"""

import textwrap
from pathlib import Path
from typing import Any

from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from busybot.common.errors import BusybotError
from busybot.episodes.episode import Episode
from busybot.plan.decision_log import reason
from busybot.view.annotations import named, object_names, remaining_responders
from busybot.view.figures.episode import WIDTH
from busybot.view.figures.parts import (
    draw_action,
    draw_boxes,
    draw_image,
    draw_label,
    draw_picture,
    draw_title,
    name_places,
    page,
    save,
)
from busybot.view.palette import ACTION, CORRECT, INK, MUTED, WRONG, unit

PICTURES_PER_ROW = 6
FEWEST = 3
"""Pictures are not larger than with so many in a row."""
WORDS_HEIGHT = 0.52
"""Of the words below a picture, inches."""
LETTERS = 21
"""In an inch of these words."""
LINES = 4


def sequence_figure(path: Path, episode: Episode, root: Path | None = None) -> Path:
    """A rollout as a row of pictures, in several rows if there are more than `PICTURES_PER_ROW`.

    Raises:
        BusybotError: the episode has no goal.
    """
    goal, steps = episode.goal, len(episode.steps)
    if goal is None:
        what = f"board {episode.board.index}: the episode has no goal, so there is no planning sequence"
        raise BusybotError(what, "record rollouts: busybot eval plan DATASET --record DIR")
    pictures = steps + 2
    rows = -(-pictures // PICTURES_PER_ROW)
    columns = -(-pictures // rows)  # rows of about equal length
    side = WIDTH / max(columns, FEWEST)
    figure = page(side * columns, rows * (side + 0.18 + WORDS_HEIGHT) + 0.3)
    grid = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for frame, axes in enumerate(grid[: steps + 1]):
        _draw_moment(axes, episode, frame, side)
    last = grid[pictures - 1]
    draw_picture(last, episode, goal)
    draw_title(last, "goal", f"board {episode.board.index}")
    _mark(last, episode, 0, INK)
    _write(last, _outcome(episode), side)
    for axes in grid[pictures:]:
        axes.set_axis_off()
    handles = [
        Patch(facecolor="none", edgecolor=unit(WRONG), linewidth=1.8, label="differs from the goal"),
        Patch(facecolor="none", edgecolor=unit(CORRECT), linewidth=1.8, label="now as in the goal"),
        Line2D([], [], color=unit(ACTION), linewidth=1.8, marker="o", markersize=5, label="action"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=8, labelcolor=unit(INK))
    return save(figure, path, root)


def _draw_moment(axes: Any, episode: Episode, frame: int, side: float) -> None:
    """The board after so many actions, with the last one."""
    draw_image(axes, episode, frame)
    remaining = remaining_responders(episode, frame)
    _mark(axes, episode, frame, WRONG)
    if frame == 0:
        draw_title(axes, "start", _count(remaining))
        _write(axes, f"agent: {episode.policy}", side)
        return
    done = [index for index in remaining_responders(episode, frame - 1) if index not in remaining]
    draw_boxes(axes, episode, frame, done, CORRECT)
    draw_action(axes, episode, frame - 1)
    draw_title(axes, f"action {frame}", _count(remaining))
    _write(axes, named(episode.board, reason(episode, frame - 1)), side)


def _mark(axes: Any, episode: Episode, frame: int, color: tuple[int, int, int]) -> None:
    """Frames and names of the responders that differ from the goal in a frame."""
    remaining = remaining_responders(episode, frame)
    draw_boxes(axes, episode, frame, remaining, color)
    names, places = object_names(episode.board), name_places(episode)
    for index in remaining:
        draw_label(axes, places[index], names[index], color, 5.5)


def _count(remaining: list[int]) -> str:
    if not remaining:
        return "as in the goal"
    return f"{len(remaining)} differ{'s' * (len(remaining) == 1)}"


def _outcome(episode: Episode) -> str:
    """How the rollout ended."""
    ended = reason(episode, len(episode.steps))
    return named(episode.board, ended) or f"{len(episode.steps)} steps, no more"


def _write(axes: Any, words: str, side: float) -> None:
    """Words below a picture."""
    lines = textwrap.wrap(words, int(LETTERS * side), max_lines=LINES, placeholder=" ...")
    text = "\n".join(lines + [""] * (LINES - len(lines)))
    axes.set_xlabel(text, fontsize=6.3, color=unit(MUTED), loc="left", labelpad=3, linespacing=1.25)
