"""A board of another world than the paper's: its mechanisms as a typed graph and in words, its causes and effects.

At the left the true graph over the board: what a mechanism reads leads to its tag, its tag to what it decides; locks
are dashed. At the right the same in words. Below, what every link and responder showed at each step: an arrow leads
from the action that moved a link to the change that goes back to it, however much later that came.

`understood_figure` draws in the same way what a model says of such a board.
"""

import textwrap
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.patches import FancyArrowPatch, Rectangle

from busybot.boards.true_causes import Change, periods
from busybot.episodes.episode import Episode
from busybot.view.annotations import Verdict, drawing_scale
from busybot.view.figures import parts
from busybot.view.label_places import Legs, label_boxes, place_beside, place_between
from busybot.view.mechanisms import Factor, Kind, MechanismView, harmless
from busybot.view.palette import (
    ACTION,
    FACTORS,
    INK,
    LOCK,
    MUTED,
    PAPER,
    ROLES,
    STATES,
    VERDICTS,
    WRONG,
    Rgb,
    mix,
    unit,
)
from busybot.view.understood import Understanding

SIDE = 5.2
"""Width and height of the board, inches."""
LANE = 0.19
"""Height of a lane, inches."""
WORDS = 58
"""Letters in a line of words."""
TYPES = {"mechanism": "mechanism", "chance": "with luck of its own", "clock": "hidden clock", "lock": "lock"}
Lane = tuple[str, str, list[int]]
"""Name, role and states at all steps of a link or a responder."""
COLORS = ("grey", "yellow", "green")
"""What the colours of `palette.STATES` are called."""
LETTERS = 0.72
"""Drawing units of a unit of `label_places`: a tag's letters are so much smaller than the viewer's."""


def mechanism_figure(path: Path, episode: Episode) -> Path:
    """The mechanisms of an episode's board, and what each change in the episode goes back to."""
    view = MechanismView(episode)
    lanes = _lanes(view)
    height = LANE * len(lanes) + 0.55 if lanes else 0.0
    figure = parts.page(parts.WIDTH, SIDE + height + 0.3)
    ratios = [SIDE, height] if lanes else [SIDE]
    grid = figure.add_gridspec(len(ratios), 2, height_ratios=ratios, width_ratios=[SIDE, parts.WIDTH - SIDE])
    board, words = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    parts.draw_picture(board, episode, episode.image(0), paleness=0.5)
    factors = _all_factors(view)
    _draw_graph(board, view, factors)
    parts.draw_title(board, f"board {view.board.index}", f"world {view.board.world}")
    _draw_words(words, view)
    if lanes:
        _draw_time(figure.add_subplot(grid[1, :]), view, lanes)
    kinds = [kind for kind in TYPES if any(factor.kind == kind for factor in factors)]
    keys = [parts.line_key(TYPES[k], FACTORS[k], linewidth=2.2, linestyle="--" if k == "lock" else "-") for k in kinds]
    if keys:
        parts.draw_legend(figure, keys)
    return parts.save_png(figure, path)


def understood_figure(path: Path, understood: Understanding) -> Path:
    """What a model claims of an episode's board, over it: a tag joins what decides a responder together."""
    view = understood.view
    figure = parts.page(6.4, 6.75)
    axes = figure.subplots()
    parts.draw_picture(axes, view.episode, view.episode.image(0), paleness=0.5)
    claims = understood.claims
    factors = [claim.factor for claim in claims]
    layout = _layout(view, [(one.causes, one.effects) for one in factors])
    for claim, middle in zip(claims, _tag_places(view, layout, factors), strict=True):
        for cause, verdict in zip(claim.factor.causes, claim.verdicts, strict=True):
            parts.draw_line(axes, layout.ends[cause], middle, VERDICTS[verdict], verdict == "missed")
        for effect in claim.factor.effects:
            parts.draw_arc(axes, middle, layout.ends[effect], VERDICTS[claim.verdict], False, 0.0, width=1.5, head=10)
        parts.draw_label(axes, middle, claim.factor.label, VERDICTS[claim.verdict], 5.5)
    _draw_nodes(axes, layout)
    told = f"inferred by {understood.inferred.name} after {len(view.episode.steps)} steps"
    parts.draw_title(axes, f"board {view.board.index}", told)
    verdicts = Counter(verdict for claim in claims for verdict in claim.verdicts)
    lines: dict[Verdict, str] = {"correct": "-", "wrong": "-", "missed": "--"}
    keys = [
        parts.line_key(f"{verdicts[name]} {name}", VERDICTS[name], linewidth=2.2, linestyle=line)
        for name, line in lines.items()
    ]
    parts.draw_legend(figure, keys)
    return parts.save_png(figure, path)


def _all_factors(view: MechanismView) -> list[Factor]:
    """Those of the new board, then those that take the place of others, with the step from which on they do."""
    found = {factor.key: factor for factor in view.factors(0)}
    for step in view.moments[1:]:
        for factor in view.factors(step):
            found.setdefault(factor.key, replace(factor, label=f"{factor.label}, from step {step}"))
    return list(found.values())


@dataclass(frozen=True)
class _Layout:
    """Where a graph's nodes and names stand, drawing units.

    Attributes:
        ends: (N, 2), where the lines of each node begin and end: at an object's middle, or at a link's name beside it.
        named: (M, 2), where the names stand, those of the nodes first; then those of objects with several links.
        names, roles: of these M.
    """

    ends: np.ndarray
    named: np.ndarray
    names: list[str]
    roles: list[str]


def _layout(view: MechanismView, legs: Sequence[Legs]) -> _Layout:
    """Objects are named below them; links of an object that has several beside it, in a row or a column.

    Args:
        legs: causes and effects of what stands between nodes.
    """
    below, ends = parts.name_places(view.episode), view.places.copy()
    names = [harmless(node.link or node.name) for node in view.nodes]
    several = sorted({node.object for node in view.nodes if node.link})
    objects = view.episode.image(0).boxes * drawing_scale(view.episode) / LETTERS
    taken = label_boxes(below / LETTERS, [view.object_name(index) for index in range(len(below))])
    for index in several:
        own = [n for n, node in enumerate(view.nodes) if node.object == index]
        texts = [names[n] for n in own]
        aims = [[view.places[list(effects)].mean(0) for causes, effects in legs if n in causes] for n in own]
        targets = [np.reshape(aim, (-1, 2)) / LETTERS for aim in aims]
        bounds = np.concatenate(view.bounds(0.0)) / LETTERS
        places = place_beside(objects[index], texts, targets, taken, objects, bounds)
        ends[own], taken = places * LETTERS, np.concatenate([taken, label_boxes(places, texts)])
    named = [end if node.link else below[node.object] for node, end in zip(view.nodes, ends, strict=True)]
    owners = [*(node.object for node in view.nodes), *several]
    return _Layout(
        ends,
        np.concatenate([np.reshape(named, (-1, 2)), below[several]]),
        names + [view.object_name(index) for index in several],
        [view.board.objects[index].role for index in owners],
    )


def _draw_graph(axes: Any, view: MechanismView, factors: list[Factor]) -> None:
    layout = _layout(view, [(one.causes, one.effects) for one in factors])
    colors = _shades([factor.kind for factor in factors])
    for factor, middle, color in zip(factors, _tag_places(view, layout, factors), colors, strict=True):
        dashed = factor.kind == "lock"
        for cause in factor.causes:
            parts.draw_line(axes, layout.ends[cause], middle, color, dashed)
        for effect in factor.effects:
            parts.draw_arc(axes, middle, layout.ends[effect], color, dashed, 0.0, width=1.5, head=10)
        parts.draw_label(axes, middle, factor.label, color, 5.5)
    _draw_nodes(axes, layout)


def _shades(kinds: Sequence[Kind]) -> list[Rgb]:
    """The colours of the kinds, in turns as they are, darker and paler, so that lines can be told apart that cross."""
    tones, before = ((PAPER, 0.0), (INK, 0.45), (PAPER, 0.3)), Counter[Kind]()
    shades = []
    for kind in kinds:
        shades.append(mix(FACTORS[kind], *tones[before[kind] % len(tones)]))
        before[kind] += 1
    return shades


def _draw_nodes(axes: Any, layout: _Layout) -> None:
    for name, place, role in zip(layout.names, layout.named, layout.roles, strict=True):
        parts.draw_tag(axes, place, name, ROLES[role], 6.0, zorder=9)


def _tag_places(view: MechanismView, layout: _Layout, factors: list[Factor]) -> np.ndarray:
    """Where the mechanisms' tags stand, drawing units: on the board, whatever would be the best place."""
    legs, texts = [(one.causes, one.effects) for one in factors], [one.label for one in factors]
    places = place_between(layout.ends / LETTERS, layout.named / LETTERS, layout.names, legs, texts) * LETTERS
    return places.clip(*view.bounds(30.0))


def _draw_words(axes: Any, view: MechanismView) -> None:
    axes.set_axis_off()
    axes.set(xlim=(0, 1), ylim=(1, 0))
    lines = [(who, textwrap.wrap(f"{who} {words}", WORDS)) for who, words in view.sentences]
    height = 1 / max(sum(len(wrapped) + 0.35 for _, wrapped in lines), 24)
    row = 0.5 * height
    for who, wrapped in lines:
        for number, line in enumerate(wrapped):
            style: dict[str, Any] = {"fontsize": 7.5, "va": "center", "parse_math": False}
            if number == 0 and line.startswith(who):
                told = axes.text(0, row, who, color=unit(INK), fontweight="bold", **style)
                axes.annotate(
                    line.removeprefix(who), (1, 0.5), xycoords=told, color=unit(INK), annotation_clip=False, **style
                )
            else:
                axes.text(0.03, row, line, color=unit(INK), **style)
            row += height
        row += 0.35 * height


def _lanes(view: MechanismView) -> list[Lane]:
    """Of every link, and of every responder that something decides."""
    steps = view.episode.steps
    if not steps or not steps[0].trigger_states_before:
        return []
    triggers = [steps[0].trigger_states_before, *(step.trigger_states_after for step in steps)]
    shown = [steps[0].responder_states_before, *(step.responder_states_after for step in steps)]
    lanes = [(name, "trigger", [states[number] for states in triggers]) for number, name in enumerate(view.link_names)]
    for index in sorted({period.relation.responder for period in periods(view.board)}):
        lanes.append((view.object_name(index), "responder", [states[index] for states in shown]))
    return lanes


def _explained(view: MechanismView, lanes: list[Lane]) -> str:
    """What the marks among the lanes mean, of those that are there; and what is not known, so that it has none."""
    states = sorted({state for _, _, own in lanes for state in own})
    by_color = {color: [s for s in states if s % len(STATES) == place] for place, color in enumerate(COLORS)}
    told = [f"{color}: {' or '.join(map(str, own))}" for color, own in by_color.items() if own]
    marks = ["step", ", ".join(told).replace(": ", ": state ", 1)]
    if caused := [change for change in view.changes if change.cause is not None]:
        late = " (pink: later)" * any(change.late for change in caused)
        marks.append(f"arrows: from the action to the change that goes back to it{late}")
    alone = [change.rewired for change in view.changes if change.cause is None]
    if alone:
        marks.append("red diamonds: rewired" if all(alone) else f"diamonds: by itself{' (red: rewired)' * any(alone)}")
    if view.held:
        marks.append("crosses: a lock holds the link")
    return "; ".join(filter(None, [*marks, view.unexplained]))


def _draw_time(axes: Any, view: MechanismView, lanes: list[Lane]) -> None:
    for row, (_, _, states) in enumerate(lanes):
        for frame, state in enumerate(states):
            color = unit(mix(STATES[state % len(STATES)], PAPER, 0.25))
            axes.add_patch(Rectangle((frame - 0.5, row - 0.36), 1.0, 0.72, facecolor=color, linewidth=0))
    frames, rows = len(lanes[0][2]), {name: row for row, (name, _, _) in enumerate(lanes)}
    for step in view.moments[1:]:
        axes.axvline(step - 0.5, color=unit(WRONG), linewidth=1.2, linestyle=(0, (3, 2)))
        axes.annotate(
            "rewired", (step - 0.5, -0.75), fontsize=6.5, color=unit(WRONG), ha="center", annotation_clip=False
        )
    for frame, link in view.held:
        axes.plot(frame, link, "x", markersize=4.5, color=unit(LOCK), markeredgewidth=1.4)
    for change in view.changes:
        _draw_change(axes, change, rows[view.object_name(change.responder)])
    axes.set_yticks(range(len(lanes)), [name for name, _, _ in lanes], parse_math=False)
    for tick, (_, role, _) in zip(axes.get_yticklabels(), lanes, strict=True):
        tick.set_color(unit(ROLES[role]))
    axes.set(xlim=(-0.5, frames - 0.5), ylim=(len(lanes) - 0.5, -0.5))
    axes.set_xticks(range(0, frames, 5 if frames > 10 else 1))
    axes.tick_params(length=0, labelsize=6.5)
    axes.tick_params(axis="x", labelcolor=unit(MUTED))
    axes.spines[:].set_visible(False)
    axes.set_xlabel(_explained(view, lanes), fontsize=7, color=unit(MUTED))


def _draw_change(axes: Any, change: Change, row: int) -> None:
    """An arrow from cause to effect, bold where it is late; a mark where a responder changed by itself."""
    if change.cause is None or change.link is None:
        color = WRONG if change.rewired else INK
        axes.plot(change.step, row, "D", markersize=3, color=unit(color), markeredgewidth=0)
        return
    color, width = (ACTION, 1.3) if change.late else (INK, 0.6)
    ends = (change.cause, change.link), (change.step, row)
    style: dict[str, Any] = {"arrowstyle": "-|>", "mutation_scale": 5, "shrinkA": 0, "shrinkB": 0, "linewidth": width}
    axes.add_patch(FancyArrowPatch(*ends, color=unit(color), zorder=4, **style))
