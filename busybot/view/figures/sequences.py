"""Figures of boards step by step: what the policy sees, how a reasoner's graph grows, how an agent reaches its goal.

`belief_figure` is the paper's figure of step-by-step refinement (section 4.2): the graph over the picture after a few
numbers of steps, beside its scores on the board. `sequence_figure` is the paper's planning sequence: the start, the
board after each action with the action, and the goal beside them; responders that do not look as in the goal yet are
framed, and below each picture stands why the agent did what it did. `affordance_figure` shows what the interaction
policy sees and does: affordance maps, known links, candidates, chosen actions.
"""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from busybot.common.errors import BusybotError
from busybot.episodes.episode import Episode
from busybot.interact.policy.policy_trace import PolicyTrace
from busybot.plan.agent_policy import reason
from busybot.reason.models.base import InferredGraph
from busybot.view import annotations
from busybot.view.figures import parts
from busybot.view.palette import (
    ACTION,
    CLAIMED,
    CORRECT,
    FAINT,
    INK,
    MUTED,
    PAPER,
    RESPONDER,
    TRIGGER,
    TRUTH,
    WRONG,
    mix,
    unit,
)

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
    annotations.check_inferred(episode, inferred)
    length = len(episode.steps)
    moments = sorted({moment for moment in steps if moment < length} | {length})
    columns = COLUMNS if len(moments) < 2 * COLUMNS else COLUMNS + 1
    side = parts.WIDTH / columns
    figure, grid = parts.picture_grid(len(moments) + 1, columns, side, side + 0.1, 0.35)
    bends = _bends(episode, inferred, moments)
    for axes, moment in zip(grid, moments, strict=False):
        _draw_board(axes, episode, inferred, moment, bends)
    last = grid[len(moments)]
    last.set_axis_off()
    if episode.board.relations_known:
        _draw_curves(last.inset_axes(CURVES), episode, inferred, moments)
    handles = [
        parts.line_key("true, not found", TRUTH, linewidth=1.4, linestyle="--"),
        parts.line_key("true, claimed", CORRECT, linewidth=WIDEST),
        parts.line_key("true, thought of", mix(CORRECT, FAINT, DOUBT), linewidth=1.2),
        parts.line_key("wrong, claimed", WRONG, linewidth=WIDEST),
        parts.line_key("wrong, thought of; width: probability", mix(INK, FAINT, DOUBT), linewidth=1.2),
    ]
    if not episode.board.relations_known:
        handles = [
            parts.line_key("claimed", CLAIMED, linewidth=WIDEST),
            parts.line_key("thought of; width: probability", mix(INK, FAINT, DOUBT), linewidth=1.2),
        ]
    parts.draw_legend(figure, handles)
    return parts.save_png(figure, path)


def _bends(episode: Episode, inferred: InferredGraph, moments: list[int]) -> dict[tuple[int, int], float]:
    """How each relation that is ever drawn bends, alike in all pictures."""
    drawn = annotations.truth_ever(episode.board)
    for moment in moments:
        drawn = drawn | (inferred.after(moment) > LEAST)
    places, names = annotations.anchors(episode) * annotations.drawing_scale(episode), parts.name_places(episode)
    bends = {}
    for i, j in np.argwhere(drawn):
        strangers = [place for number, place in enumerate(places) if number not in (i, j)]
        bends[int(i), int(j)] = parts.clear_bend(places[i], places[j], [*strangers, *names])
    return bends


def _draw_board(
    axes: Any, episode: Episode, inferred: InferredGraph, moment: int, bends: dict[tuple[int, int], float]
) -> None:
    parts.draw_picture(axes, episode, episode.image(0), paleness=0.5)
    parts.draw_names(axes, episode, 5.5)
    truth, probabilities = annotations.truth_matrix(episode.board, moment), inferred.after(moment)
    claimed = probabilities > inferred.threshold
    places = annotations.anchors(episode) * annotations.drawing_scale(episode)
    for (i, j), bend in sorted(bends.items(), key=lambda one: float(probabilities[one[0]])):
        likely = float(probabilities[i, j])
        verdict = (CORRECT if truth[i, j] else WRONG) if episode.board.relations_known else CLAIMED
        if truth[i, j] and not claimed[i, j]:
            parts.draw_arc(axes, places[i], places[j], TRUTH, True, bend, 1.4, HEAD)
        if likely > LEAST:
            color = verdict if claimed[i, j] else mix(verdict if truth[i, j] else INK, FAINT, DOUBT)
            parts.draw_arc(axes, places[i], places[j], color, False, bend, max(WIDEST * likely, 0.5), HEAD)
    right, wrong = int((claimed & truth).sum()), int((claimed & ~truth).sum())
    told = f"{right} of {int(truth.sum())} found" + (f", {wrong} wrong" if wrong else "")
    told = told if episode.board.relations_known else f"{int(claimed.sum())} claimed"
    parts.draw_title(axes, "after 1 step" if moment == 1 else f"after {moment} steps", told)


def _draw_curves(axes: Any, episode: Episode, inferred: InferredGraph, moments: list[int]) -> None:
    """Edge-P and Edge-R of this board after every number of steps; nothing claimed has no precision."""
    parts.plain_axes(axes, (-0.03, 1.06))
    steps = range(1, max(moments) + 1)
    edges = [(inferred.claimed(step), annotations.truth_matrix(episode.board, step)) for step in steps]
    counts = [((claimed & truth).sum(), claimed.sum(), truth.sum()) for claimed, truth in edges]
    hits, numbers, true = np.reshape(counts, (-1, 3)).T.astype(float)
    precision, recall = (np.divide(hits, of, out=np.full_like(hits, np.nan), where=of > 0) for of in (numbers, true))
    axes.plot(steps, precision, color=unit(CORRECT), linewidth=2, marker="o", markersize=3, label="Edge-P")
    if true.any():
        axes.plot(steps, recall, color=unit(RESPONDER), linewidth=2, drawstyle="steps-post", label="Edge-R")
    for moment in moments:
        axes.axvline(moment, color=unit(MUTED), linewidth=0.7, linestyle=":", zorder=1)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    axes.set_xlabel("steps", fontsize=8, color=unit(MUTED))
    axes.legend(
        loc=_free_corner(precision, recall),
        facecolor=unit(PAPER),
        framealpha=1,
        edgecolor="none",
        fontsize=8,
        labelcolor=unit(INK),
    )
    parts.draw_title(axes, inferred.name, f"board {episode.board.index} of {episode.board.split}")


def _free_corner(*curves: np.ndarray) -> str:
    """Where at the right a legend hides none of the curves (T,), shares; at the lower corner if it can."""
    last = np.concatenate([curve[len(curve) // 2 :] for curve in curves])
    for corner, low, high in (("lower right", -1.0, 0.3), ("center right", 0.3, 0.7), ("upper right", 0.8, 2.0)):
        if not ((last > low) & (last < high)).any():
            return corner
    return "lower right"


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
    columns = -(-pictures // -(-pictures // PICTURES_PER_ROW))  # rows of about equal length
    side = parts.WIDTH / max(columns, FEWEST)
    figure, grid = parts.picture_grid(pictures, columns, side, side + 0.18 + WORDS_HEIGHT, 0.3)
    for frame, axes in enumerate(grid[: steps + 1]):
        _draw_moment(axes, episode, frame, side)
    last = grid[pictures - 1]
    parts.draw_picture(last, episode, goal)
    parts.draw_title(last, "goal", f"board {episode.board.index}")
    _mark(last, episode, 0, INK)
    _write(last, annotations.named(episode.board, reason(episode, steps)) or f"{steps} steps, no more", side)
    frames = (("differs from the goal", WRONG), ("now as in the goal", CORRECT))
    done = parts.line_key("action", ACTION, linewidth=1.8, marker="o", markersize=5)
    parts.draw_legend(figure, [*(parts.frame_key(words, color) for words, color in frames), done])
    return parts.save_png(figure, path, root)


def _draw_moment(axes: Any, episode: Episode, frame: int, side: float) -> None:
    """The board after so many actions, with the last one."""
    parts.draw_picture(axes, episode, episode.image(frame))
    remaining = annotations.remaining_responders(episode, frame)
    _mark(axes, episode, frame, WRONG)
    if frame == 0:
        parts.draw_title(axes, "start", _count(remaining))
        _write(axes, f"agent: {episode.policy}", side)
        return
    done = [index for index in annotations.remaining_responders(episode, frame - 1) if index not in remaining]
    parts.draw_boxes(axes, episode, frame, done, CORRECT)
    parts.draw_action(axes, episode, frame - 1)
    parts.draw_title(axes, f"action {frame}", _count(remaining))
    _write(axes, annotations.named(episode.board, reason(episode, frame - 1)), side)


def _mark(axes: Any, episode: Episode, frame: int, color: tuple[int, int, int]) -> None:
    """Frames and names of the responders that differ from the goal in a frame."""
    remaining = annotations.remaining_responders(episode, frame)
    parts.draw_boxes(axes, episode, frame, remaining, color)
    names, places = annotations.object_names(episode.board), parts.name_places(episode)
    for index in remaining:
        parts.draw_label(axes, places[index], names[index], color, 5.5)


def _count(remaining: list[int]) -> str:
    if not remaining:
        return "as in the goal"
    return f"{len(remaining)} differ{'s' * (len(remaining) == 1)}"


def _write(axes: Any, words: str, side: float) -> None:
    """Words below a picture."""
    lines = textwrap.wrap(words, int(LETTERS * side), max_lines=LINES, placeholder=" ...")
    text = "\n".join(lines + [""] * (LINES - len(lines)))
    style: dict[str, Any] = {"loc": "left", "labelpad": 3, "linespacing": 1.25, "parse_math": False}
    axes.set_xlabel(text, fontsize=6.3, color=unit(MUTED), **style)


ACTIONS_PER_ROW = 5
PALE = 0.6
"""How much the picture under an affordance map is mixed with white."""
CLOSE = 44.0
"""A close-up shows so many drawing units on each side of the action."""
LEAST_SCORE = 0.05
"""Candidates of less promise are not drawn."""
DOT = 26.0
"""Area of the dot of a candidate that is certain to succeed, points squared."""


def affordance_figure(path: Path, episode: Episode, thoughts: Sequence[PolicyTrace], root: Path | None = None) -> Path:
    """Actions one after the other, each with a close-up below the board: affordance over the picture, known links
    outlined, candidates as dots, the action chosen.

    Args:
        thoughts: of `interact.policy.policy_trace.retrace`; the first ones are drawn, two rows of them.
        root: as `parts.save_png` takes it.
    """
    chosen = thoughts[: 2 * ACTIONS_PER_ROW]
    columns = max(min(ACTIONS_PER_ROW, len(chosen)), 1)
    strips, side = max(-(-len(chosen) // columns), 1), parts.WIDTH / max(columns, 3)
    figure = parts.page(side * columns, strips * (2 * side + 0.1) + 0.2)
    grid = figure.subplots(2 * strips, columns, squeeze=False)
    for place in range(strips * columns):
        strip, column = divmod(place, columns)
        whole, close = grid[2 * strip : 2 * strip + 2, column]
        if place < len(chosen):
            _draw_step(whole, close, episode, chosen[place])
        else:
            whole.set_axis_off()
            close.set_axis_off()
    handles = [
        Patch(color=unit(TRIGGER), label="affordance"),
        parts.line_key("known link", INK, linewidth=1.2),
        parts.line_key("candidate", INK, linewidth=0, marker="o", markersize=4),
        parts.line_key("action", ACTION, linewidth=1.8, marker="o", markersize=5),
    ]
    parts.draw_legend(figure, handles)
    return parts.save_png(figure, path, root)


def _draw_step(whole: Any, close: Any, episode: Episode, thought: PolicyTrace) -> None:
    """The board, and a close-up of where the action was."""
    step = episode.steps[thought.step]
    for axes in (whole, close):
        parts.draw_picture(axes, episode, episode.image(thought.step), paleness=PALE)
        _draw_affordance(axes, episode, thought.affordance)
        _draw_links(axes, episode, thought.links)
        parts.draw_action(axes, episode, thought.step)
    _draw_candidates(close, episode, thought)
    column, row = ((value + 0.5) * annotations.drawing_scale(episode) for value in step.pixel)
    close.set_xlim(column - CLOSE, column + CLOSE)
    close.set_ylim(row + CLOSE, row - CLOSE)
    place = "known link" if thought.known else "new"
    parts.draw_title(whole, f"{thought.step + 1}", f"{place}: {'works' if step.reward else 'nothing'}")


def _draw_affordance(axes: Any, episode: Episode, affordance: np.ndarray) -> None:
    """Probabilities (H, W) as colour that covers the picture the more the higher they are."""
    deep = unit(mix(TRIGGER, INK, 0.25))
    colors = LinearSegmentedColormap.from_list("affordance", [(*unit(TRIGGER), 0.0), (*unit(TRIGGER), 0.9), (*deep, 1)])
    height, width = np.array(affordance.shape) * annotations.drawing_scale(episode)
    axes.imshow(
        affordance, cmap=colors, vmin=0, vmax=1, extent=(0, width, height, 0), interpolation="nearest", zorder=2
    )


def _draw_links(axes: Any, episode: Episode, links: np.ndarray) -> None:
    """Outlines of the known links (H, W)."""
    scale = annotations.drawing_scale(episode)
    rows, columns = (np.arange(size) + 0.5 for size in links.shape)
    for number in np.unique(links[links > 0]):
        outline = axes.contour(
            columns * scale, rows * scale, links == number, levels=[0.5], colors=[unit(INK)], linewidths=1.2, zorder=4
        )
        outline.set_path_effects([withStroke(linewidth=2.4, foreground=unit(PAPER))])


def _draw_candidates(axes: Any, episode: Episode, thought: PolicyTrace) -> None:
    """Dots, the larger the more success is expected."""
    found = thought.candidates
    promising = found.scores > LEAST_SCORE
    places = (found.pixels[promising] + 0.5) * annotations.drawing_scale(episode)
    sizes = DOT * found.scores[promising]
    axes.scatter(*places.T, s=sizes, color=unit(INK), edgecolors=unit(PAPER), linewidths=0.6, zorder=5)
