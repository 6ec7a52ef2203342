"""The paper's planning sequences: the start, the board after each action with the action, and the goal beside them.

Responders that do not look as in the goal yet are framed; below each picture stands why the agent did what it did.

Draws how a reasoner's graph grows over a board, step by step, beside its scores on the board.

The paper's figures of step-by-step refinement (section 4.2): the graph over the picture after a few numbers of steps.
"""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, PercentFormatter

from busybot.common.errors import BusybotError
from busybot.episodes.episode import Episode
from busybot.plan.agent_policy import reason
from busybot.reason.models.base import InferredGraph
from busybot.view.annotations import anchors, check_inferred, drawing_scale, named, object_names, remaining_responders
from busybot.view.figures.episode import WIDTH
from busybot.view.figures.parts import (
    clear_bend,
    draw_action,
    draw_arc,
    draw_boxes,
    draw_image,
    draw_label,
    draw_names,
    draw_picture,
    draw_title,
    name_places,
    page,
    plain_axes,
    save,
)
from busybot.view.palette import ACTION, CORRECT, FAINT, INK, MUTED, PAPER, RESPONDER, TRUTH, WRONG, mix, unit

MOMENTS = (1, 3, 6, 12, 22)
"""Numbers of steps; the last one is what the paper infers the graph from."""
COLUMNS = 3
"""One more if two rows of so many do not suffice."""
LEAST = 0.05
"""Less probable relations are not drawn."""
WIDEST, HEAD = 3.4, 9.0
"""A certain relation's line, and an arrow's head, points."""
CURVES = (0.13, 0.13, 0.85, 0.84)
"""Left, bottom, width and height of the curves as shares of a board's picture."""
DOUBT = 0.55
"""How much of the paper's colour is in a relation that is thought of and not claimed."""


def belief_figure(path: Path, episode: Episode, inferred: InferredGraph, steps: Sequence[int] = MOMENTS) -> Path:
    """The board after each number of steps with all that is believed, and the curves of Edge-P and Edge-R.

    Args:
        steps: more than the episode has are left out; its last step is always drawn.
    """
    check_inferred(episode, inferred)
    length = len(episode.steps)
    moments = sorted({moment for moment in steps if moment < length} | {length})
    columns = COLUMNS if len(moments) < 2 * COLUMNS else COLUMNS + 1
    rows = -(-(len(moments) + 1) // columns)
    side = WIDTH / columns
    figure = page(WIDTH, rows * (side + 0.1) + 0.35)
    grid = list(figure.subplots(rows, columns, squeeze=False).ravel())
    bends = _bends(episode, inferred, moments)
    for axes, moment in zip(grid, moments, strict=False):
        _draw_board(axes, episode, inferred, moment, bends)
    for axes in grid[len(moments) :]:
        axes.set_axis_off()
    _draw_curves(grid[len(moments)].inset_axes(CURVES), episode, inferred, moments)
    handles = [
        Line2D([], [], color=unit(TRUTH), linewidth=1.4, linestyle="--", label="true, not found"),
        Line2D([], [], color=unit(CORRECT), linewidth=WIDEST, label="true, claimed"),
        Line2D([], [], color=unit(mix(CORRECT, FAINT, DOUBT)), linewidth=1.2, label="true, thought of"),
        Line2D([], [], color=unit(WRONG), linewidth=WIDEST, label="wrong, claimed"),
        Line2D(
            [], [], color=unit(mix(INK, FAINT, DOUBT)), linewidth=1.2, label="wrong, thought of; width: probability"
        ),
    ]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, fontsize=8, labelcolor=unit(INK)
    )
    return save(figure, path)


def _truth(episode: Episode) -> np.ndarray:
    return np.array(episode.board.relation_matrix(), bool).reshape(len(episode.board.objects), -1)


def _bends(episode: Episode, inferred: InferredGraph, moments: list[int]) -> dict[tuple[int, int], float]:
    """How each relation that is ever drawn bends, alike in all pictures."""
    drawn = _truth(episode)
    for moment in moments:
        drawn = drawn | (inferred.after(moment) > LEAST)
    places, names = anchors(episode) * drawing_scale(episode), name_places(episode)
    bends = {}
    for i, j in np.argwhere(drawn):
        strangers = [place for number, place in enumerate(places) if number not in (i, j)]
        bends[int(i), int(j)] = clear_bend(places[i], places[j], [*strangers, *names])
    return bends


def _draw_board(
    axes: Any, episode: Episode, inferred: InferredGraph, moment: int, bends: dict[tuple[int, int], float]
) -> None:
    draw_image(axes, episode, 0, paleness=0.5)
    draw_names(axes, episode, 5.5)
    truth, probabilities = _truth(episode), inferred.after(moment)
    claimed = probabilities > inferred.threshold
    places = anchors(episode) * drawing_scale(episode)
    for (i, j), bend in sorted(bends.items(), key=lambda one: float(probabilities[one[0]])):
        likely = float(probabilities[i, j])
        verdict = CORRECT if truth[i, j] else WRONG
        if truth[i, j] and not claimed[i, j]:
            draw_arc(axes, places[i], places[j], TRUTH, True, bend, 1.4, HEAD)
        if likely > LEAST:
            color = verdict if claimed[i, j] else mix(verdict if truth[i, j] else INK, FAINT, DOUBT)
            draw_arc(axes, places[i], places[j], color, False, bend, max(WIDEST * likely, 0.5), HEAD)
    right, wrong = int((claimed & truth).sum()), int((claimed & ~truth).sum())
    told = f"{right} of {int(truth.sum())} found" + (f", {wrong} wrong" if wrong else "")
    draw_title(axes, "after 1 step" if moment == 1 else f"after {moment} steps", told)


def _draw_curves(axes: Any, episode: Episode, inferred: InferredGraph, moments: list[int]) -> None:
    """Edge-P and Edge-R of this board after every number of steps; nothing claimed has no precision."""
    plain_axes(axes)
    truth, steps = _truth(episode), range(1, max(moments) + 1)
    claims = [inferred.claimed(step) for step in steps]
    hits = np.array([(claimed & truth).sum() for claimed in claims], float)
    numbers = np.array([claimed.sum() for claimed in claims], float)
    precision = np.divide(hits, numbers, out=np.full(len(hits), np.nan), where=numbers > 0)
    axes.plot(steps, precision, color=unit(CORRECT), linewidth=2, marker="o", markersize=3, label="Edge-P")
    if truth.any():
        axes.plot(steps, hits / truth.sum(), color=unit(RESPONDER), linewidth=2, drawstyle="steps-post", label="Edge-R")
    for moment in moments:
        axes.axvline(moment, color=unit(MUTED), linewidth=0.7, linestyle=":", zorder=1)
    axes.set_ylim(-0.03, 1.06)
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    axes.set_xlabel("steps", fontsize=8, color=unit(MUTED))
    axes.legend(
        loc="lower right", facecolor=unit(PAPER), framealpha=1, edgecolor="none", fontsize=8, labelcolor=unit(INK)
    )
    draw_title(axes, inferred.name, f"board {episode.board.index} of {episode.board.split}")


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
