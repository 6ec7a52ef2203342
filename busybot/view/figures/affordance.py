"""Figures of what the interaction policy sees and does: affordance maps, known links, candidates, chosen actions."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from busybot.episodes.episode import Episode
from busybot.interact.policy.policy_trace import PolicyTrace
from busybot.view.annotations import drawing_scale
from busybot.view.figures.episode import WIDTH
from busybot.view.figures.parts import draw_action, draw_image, draw_title, page, save
from busybot.view.palette import ACTION, INK, PAPER, TRIGGER, mix, unit

PALE = 0.6
"""How much the picture under an affordance map is mixed with white."""
CLOSE = 44.0
"""A close-up shows so many drawing units on each side of the action."""
LEAST_SCORE = 0.05
"""Candidates of less promise are not drawn."""
DOT = 26.0
"""Area of the dot of a candidate that is certain to succeed, points squared."""


def affordance_figure(
    path: Path,
    episode: Episode,
    thoughts: Sequence[PolicyTrace],
    steps: Sequence[int] | None = None,
    columns: int = 5,
    root: Path | None = None,
) -> Path:
    """Actions one after the other, each with a close-up below the board: affordance over the picture, known links
    outlined, candidates as dots, the action chosen.

    Args:
        thoughts: of `interact.policy.policy_trace.retrace`, one for each step to be drawn at the least.
        steps: indices from 0; by default the first ones, two rows of them.
        root: the folder that the user named, if it is not the one the picture lies in; see `files`.
    """
    known = {thought.step: thought for thought in thoughts}
    chosen = [step for step in (steps if steps is not None else sorted(known)[: 2 * columns]) if step in known]
    columns = max(min(columns, len(chosen)), 1)
    strips, side = max(-(-len(chosen) // columns), 1), WIDTH / max(columns, 3)
    figure = page(side * columns, strips * (2 * side + 0.1) + 0.2)
    grid = figure.subplots(2 * strips, columns, squeeze=False)
    for place in range(strips * columns):
        strip, column = divmod(place, columns)
        whole, close = grid[2 * strip, column], grid[2 * strip + 1, column]
        if place < len(chosen):
            _draw_step(whole, close, episode, known[chosen[place]])
        else:
            whole.set_axis_off()
            close.set_axis_off()
    handles = [
        Patch(color=unit(TRIGGER), label="affordance"),
        Line2D([], [], color=unit(INK), linewidth=1.2, label="known link"),
        Line2D([], [], color=unit(INK), linewidth=0, marker="o", markersize=4, label="candidate"),
        Line2D([], [], color=unit(ACTION), linewidth=1.8, marker="o", markersize=5, label="action"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize=8, labelcolor=unit(INK))
    return save(figure, path, root)


def _draw_step(whole: Any, close: Any, episode: Episode, thought: PolicyTrace) -> None:
    """The board, and a close-up of where the action was."""
    step = episode.steps[thought.step]
    for axes in (whole, close):
        draw_image(axes, episode, thought.step, paleness=PALE)
        _draw_affordance(axes, episode, thought.affordance)
        _draw_links(axes, episode, thought.links)
        draw_action(axes, episode, thought.step)
    _draw_candidates(close, episode, thought)
    column, row = ((value + 0.5) * drawing_scale(episode) for value in step.pixel)
    close.set_xlim(column - CLOSE, column + CLOSE)
    close.set_ylim(row + CLOSE, row - CLOSE)
    place = "known link" if thought.known else "new"
    draw_title(whole, f"{thought.step + 1}", f"{place}: {'works' if step.reward else 'nothing'}")


def _draw_affordance(axes: Any, episode: Episode, affordance: np.ndarray) -> None:
    """Probabilities (H, W) as colour that covers the picture the more the higher they are."""
    deep = unit(mix(TRIGGER, INK, 0.25))
    colors = LinearSegmentedColormap.from_list("affordance", [(*unit(TRIGGER), 0.0), (*unit(TRIGGER), 0.9), (*deep, 1)])
    height, width = np.array(affordance.shape) * drawing_scale(episode)
    axes.imshow(
        affordance, cmap=colors, vmin=0, vmax=1, extent=(0, width, height, 0), interpolation="nearest", zorder=2
    )


def _draw_links(axes: Any, episode: Episode, links: np.ndarray) -> None:
    """Outlines of the known links (H, W)."""
    scale = drawing_scale(episode)
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
    places = (found.pixels[promising] + 0.5) * drawing_scale(episode)
    sizes = DOT * found.scores[promising]
    axes.scatter(*places.T, s=sizes, color=unit(INK), edgecolors=unit(PAPER), linewidths=0.6, zorder=5)
