"""Figures of boards, episodes and inferred relations for reports, as PNG files; equal input gives equal bytes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MaxNLocator

from busybot.episodes.episode import Episode
from busybot.reason.models.base import InferredGraph
from busybot.view import annotations
from busybot.view.figures import parts
from busybot.view.mechanisms import MechanismView, harmless, mechanism_view
from busybot.view.palette import ACTION, CORRECT, FAINT, INK, MISSED, MUTED, PAPER, TRUTH, VERDICTS, mix, unit

COLUMNS = 4
"""Pictures of boards in a row at most."""
LONGEST_TITLE = 60
"""Letters of what is said about a step."""


def boards_figure(path: Path, episodes: Sequence[Episode], named: int | None = None) -> Path:
    """A contact sheet: the first image of every episode.

    Args:
        named: place in `episodes` of the board whose objects have their names.
    """
    figure, grid = _board_grid(len(episodes))
    for place, (axes, episode) in enumerate(zip(grid, episodes, strict=False)):
        board = episode.board
        parts.draw_picture(axes, episode, episode.image(0))
        if place == named:
            parts.draw_names(axes, episode, 4.5)
        told = f"{len(board.objects)} objects, {len(board.relations)} relations"
        parts.draw_title(axes, f"board {board.index}", told)
    return parts.save_png(figure, path)


def episode_figure(path: Path, episode: Episode) -> Path:
    """A strip: the initial image, then seven steps with the action marked and what changed in a box."""
    chosen = telling_steps(episode, 2 * COLUMNS - 1)
    figure, grid = _board_grid(len(chosen) + 1)
    parts.draw_picture(grid[0], episode, episode.image(0))
    view, names = mechanism_view(episode), annotations.object_names(episode.board)
    unknown = ", causes are not known here" if view and view.unexplained else ""
    parts.draw_title(grid[0], "start", f"board {episode.board.index}{unknown}")
    why = _otherwise(view)
    for axes, step in zip(grid[1:], chosen, strict=False):
        parts.draw_picture(axes, episode, episode.image(step + 1))
        acted = annotations.acted_object(episode, step)
        effects = [index for index in annotations.changed_objects(episode, step) if index != acted]
        parts.draw_boxes(axes, episode, step + 1, effects, ACTION)
        parts.draw_action(axes, episode, step)
        told = [names[index] + why.get((step + 1, index), "") for index in effects]
        said = harmless(
            f"{names[acted] if acted >= 0 else 'the board'} → {', '.join(told) or 'nothing'}", LONGEST_TITLE
        )
        parts.draw_title(axes, f"step {step + 1}", said if len(annotations.visible(episode.image(0))) else "")
    return parts.save_png(figure, path)


def _otherwise(view: MechanismView | None) -> dict[tuple[int, int], str]:
    """By step and responder what a change goes back to, where it is not the step's own action; other worlds only."""
    found = {(one.step, one.responder): one for one in view.changes} if view else {}
    late = {key: f" (step {one.cause})" for key, one in found.items() if one.cause is not None and one.late}
    alone = {key: " (rewired)" if one.rewired else " (by itself)" for key, one in found.items() if one.cause is None}
    return late | alone


def _board_grid(pictures: int) -> tuple[Any, list[Any]]:
    """A page with axes for so many pictures of boards."""
    side = parts.WIDTH / COLUMNS
    return parts.picture_grid(pictures, max(min(COLUMNS, pictures), 1), side, side + 0.18)


def telling_steps(episode: Episode, count: int) -> list[int]:
    """At most `count` steps, evenly over those in which something changed, or over all if nothing ever did."""
    changing = [k for k in range(len(episode.steps)) if annotations.looks_new(episode, k + 1)]
    steps = changing or list(range(len(episode.steps)))
    places = np.unique(np.linspace(0, len(steps) - 1, min(count, len(steps))).round().astype(int))
    return [steps[place] for place in places]


def graph_figure(path: Path, episode: Episode, inferred: InferredGraph, steps: int | None = None) -> Path:
    """The scene graph over the board: right, wrong and missed relations.

    Args:
        steps: use what is believed after so many steps; all by default.
    """
    annotations.check_inferred(episode, inferred)
    after = len(episode.steps) if steps is None else steps
    figure = parts.page(6.4, 6.75)
    axes = figure.subplots()
    parts.draw_picture(axes, episode, episode.image(0), paleness=0.45)
    parts.draw_names(axes, episode)
    edges = annotations.judged_edges(episode.board, inferred, after)
    _draw_edges(axes, episode, edges)
    parts.draw_title(axes, f"board {episode.board.index}", f"relations inferred by {inferred.name} after {after} steps")
    handles = []
    for verdict, color in VERDICTS.items():
        count = sum(edge.verdict == verdict for edge in edges)
        if (verdict == "claimed") == episode.board.relations_known:
            continue
        line = "--" if verdict == "missed" else "-"
        handles.append(parts.line_key(f"{count} {verdict}", color, linewidth=2.2, linestyle=line))
    parts.draw_legend(figure, handles)
    return parts.save_png(figure, path)


def _draw_edges(axes: Any, episode: Episode, edges: list[annotations.Edge]) -> None:
    places, names = annotations.anchors(episode) * annotations.drawing_scale(episode), parts.name_places(episode)
    labels: list[np.ndarray] = []  # with points of the arcs: later ones keep away
    for edge in edges:
        start, end = places[edge.cause], places[edge.effect]
        strangers = [p for i, p in enumerate(places) if i not in (edge.cause, edge.effect)]
        bend = parts.clear_bend(start, end, [*strangers, *names, *labels])
        parts.draw_arc(axes, start, end, VERDICTS[edge.verdict], edge.verdict == "missed", bend)
        if edge.verdict != "missed":
            curve = [parts.bend_point(start, end, bend, share) for share in (0.5, 0.42, 0.58, 0.34, 0.66)]
            place = max(curve, key=lambda point: parts.clearance(np.stack([point]), [*strangers, *names, *labels]))
            parts.draw_label(axes, place, f"{edge.probability:.2f}", VERDICTS[edge.verdict])
            labels.append(place)
        labels += [parts.bend_point(start, end, bend, share) for share in np.linspace(0.1, 0.9, 9)]


def refinement_figure(
    path: Path, episode: Episode, inferred: InferredGraph, steps: Sequence[int] | None = None, root: Path | None = None
) -> Path:
    """Edge probabilities after some numbers of steps, triggers by responders; true relations are framed.

    Args:
        steps: numbers of steps; by default five, denser at the beginning, where most is learned.
        root: as `parts.save_png` takes it.
    """
    annotations.check_inferred(episode, inferred)
    chosen = telling_moments(len(inferred.probabilities)) if steps is None else list(steps)
    names, objects = annotations.object_names(episode.board), episode.board.objects
    rows, columns = ([i for i, one in enumerate(objects) if one.role == role] for role in ("trigger", "responder"))
    side = (parts.WIDTH - 1.4) / max(len(chosen), 1)
    figure = parts.page(parts.WIDTH, 1.3 + side * len(rows) / max(len(columns), 1))
    grid = figure.subplots(1, len(chosen), squeeze=False, sharey=True)[0]
    for axes, moment in zip(grid, chosen, strict=True):
        beliefs, truth = inferred.after(moment), annotations.truth_matrix(episode.board, moment)
        mesh = _draw_matrix(axes, beliefs[np.ix_(rows, columns)], truth[np.ix_(rows, columns)])
        axes.set_xticks(np.arange(len(columns)) + 0.5, [names[j] for j in columns], rotation=90)
        axes.set_yticks(np.arange(len(rows)) + 0.5, [names[i] for i in rows])
        parts.draw_title(axes, "1 step" if moment == 1 else f"{moment} steps")
    bar = figure.colorbar(mesh, ax=list(grid), aspect=14, pad=0.015, ticks=[0, 0.5, 1])
    bar.outline.set_visible(False)
    bar.ax.tick_params(length=0, labelsize=7.5, labelcolor=unit(MUTED))
    bar.set_label("probability", fontsize=7.5, color=unit(MUTED))
    parts.draw_legend(figure, [parts.frame_key("true relation", TRUTH, 2.0)])
    return parts.save_png(figure, path, root)


def _draw_matrix(axes: Any, values: np.ndarray, truth: np.ndarray) -> Any:
    """Probabilities (triggers, responders) as tiles, the true ones framed."""
    shades = [unit(PAPER), unit(mix(CORRECT, PAPER, 0.35)), unit(mix(CORRECT, INK, 0.3))]
    colors = LinearSegmentedColormap.from_list("belief", shades)
    mesh = axes.pcolormesh(values, cmap=colors, vmin=0, vmax=1, edgecolors=unit(FAINT), linewidth=0.8)
    for i, j in np.argwhere(truth):
        frame = Rectangle((j, i), 1, 1, fill=False, edgecolor=unit(TRUTH), linewidth=2.0, clip_on=False, zorder=4)
        axes.add_patch(frame)
    axes.set_aspect("equal")
    axes.set_ylim(len(values), 0)
    axes.tick_params(length=0, labelsize=7.5, labelcolor=unit(INK))
    axes.spines[:].set_visible(False)
    return mesh


def telling_moments(steps: int) -> list[int]:
    """At most five numbers of steps from 1 to `steps`, evenly on a logarithmic scale."""
    return sorted({int(round(x)) for x in np.geomspace(1, max(steps, 1), 5)})


def changes_figure(path: Path, episode: Episode) -> Path:
    """Changed pixels of every step against the reward's threshold."""
    figure = parts.page(parts.WIDTH, 2.5)
    axes = figure.subplots()
    parts.plain_axes(axes)
    changed = np.array([step.changed_pixels for step in episode.steps])
    rewarded = np.array([step.reward for step in episode.steps], bool)
    numbers, limit = np.arange(1, len(changed) + 1), annotations.delta(episode)
    colors = [unit(CORRECT if reward else MISSED) for reward in rewarded]
    axes.bar(numbers, changed, width=0.62, color=colors)
    if not changed.all():
        still = numbers[changed == 0]
        axes.plot(still, np.zeros(len(still)), "o", markersize=3, color=unit(MISSED), clip_on=False)
    axes.axhline(limit, color=unit(INK), linewidth=1.0, linestyle=(0, (4, 3)))
    axes.annotate(
        f"δ = {limit}", (1.0, limit), xycoords=("axes fraction", "data"), xytext=(4, 0), textcoords="offset points",
        fontsize=8, va="center", color=unit(INK), annotation_clip=False,
    )  # fmt: skip
    axes.set_xlim(0.3, max(len(changed), 1) + 0.7)
    axes.set_ylim(0, 1.12 * max(int(changed.max(initial=0)), limit))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 5, 10], min_n_ticks=0))
    axes.set_xlabel("step", fontsize=8, color=unit(MUTED))
    counted = (
        f"{rewarded.sum()} of {len(changed)} steps rewarded" if annotations.rewards_known(episode) else "not known"
    )
    told = f"board {episode.board.index}: {counted}"
    parts.draw_title(axes, "changed pixels", told)
    handles = [Patch(color=unit(CORRECT), label="reward 1"), Patch(color=unit(MISSED), label="reward 0")]
    legend = axes.legend(
        handles=handles, loc="upper right", bbox_to_anchor=(1.0, -0.09), ncols=2, frameon=False, fontsize=8,
        labelcolor=unit(INK), borderpad=0,
    )  # fmt: skip
    legend.set_in_layout(False)
    return parts.save_png(figure, path)
