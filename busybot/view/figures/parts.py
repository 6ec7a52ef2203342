"""Parts of figures: a page, a picture cut to the board, names, arrows, arcs. Matplotlib without pyplot."""

import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
from matplotlib.patheffects import withStroke

from busybot.boards.directions import DIRECTIONS
from busybot.common.atomic_io import write_atomically
from busybot.episodes.camera import project
from busybot.episodes.episode import Episode, Image
from busybot.view.annotations import anchors, board_bounds, drawing_scale, object_names
from busybot.view.palette import ACTION, FAINT, INK, MUTED, PAPER, ROLES, Rgb, unit

DPI = 160
MARGIN = 4.0
"""Around the board in a cut picture, drawing units."""
ENOUGH = 40.0
"""Drawing units that a name keeps from others if it can."""
ARROW_LENGTH = 0.55
"""Of an action's arrow, board units."""


def page(width: float, height: float) -> Figure:
    """An empty figure, inches."""
    layout = ConstrainedLayoutEngine(h_pad=0.07, w_pad=0.05)
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor=unit(PAPER), layout=layout)
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: Path, root: Path | None = None) -> Path:
    """Write a PNG; equal figures give equal bytes. `root` is the folder that the user named (`files`)."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    write_atomically(path, buffer.getvalue(), root)
    return path


def draw_image(axes: Any, episode: Episode, frame: int, paleness: float = 0.0) -> None:
    """A frame's RGB image, as `draw_picture` draws it."""
    draw_picture(axes, episode, episode.image(frame), paleness)


def draw_picture(axes: Any, episode: Episode, image: Image, paleness: float = 0.0) -> None:
    """An RGB image cut to the board, axes in drawing units, mixed with white by `paleness` (0..1)."""
    rgb, scale = image.rgb.astype(float), drawing_scale(episode)
    shown = (rgb + (255 - rgb) * paleness).astype(np.uint8)
    size = (episode.camera.width * scale, episode.camera.height * scale)
    axes.imshow(shown, extent=(0, size[0], size[1], 0), interpolation="lanczos")
    low, high = board_bounds(episode, MARGIN)
    axes.set_xlim(low[0] * scale, high[0] * scale)
    axes.set_ylim(high[1] * scale, low[1] * scale)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)


def draw_title(axes: Any, bold: str, plain: str = "") -> None:
    """A title at the left, its second part in grey."""
    axes.set_title(bold, loc="left", fontsize=8.5, fontweight="bold", color=unit(INK), pad=4)
    if plain:
        axes.set_title(plain, loc="right", fontsize=7.5, color=unit(MUTED), pad=4)


def draw_action(axes: Any, episode: Episode, step: int) -> None:
    """The chosen pixel and the proposed direction."""
    done = episode.steps[step]
    position = np.array(done.position)
    ends, _ = project(np.stack([position, position + ARROW_LENGTH * DIRECTIONS[done.direction]]), episode.camera)
    scale = drawing_scale(episode)
    start = (np.array(done.pixel) + 0.5) * scale
    tip = start + (ends[1] - ends[0]) * scale
    arrow = FancyArrowPatch(
        _pair(start), _pair(tip), arrowstyle="-|>", shrinkA=0, shrinkB=0, color=unit(ACTION), linewidth=1.8, zorder=6,
        mutation_scale=9,
    )  # fmt: skip
    arrow.set_path_effects([withStroke(linewidth=3.6, foreground=unit(PAPER))])
    if float(np.hypot(*(tip - start))) > 8:
        axes.add_patch(arrow)
    axes.plot(*start, "o", markersize=6, color=unit(ACTION), markeredgecolor=unit(PAPER), markeredgewidth=1.2, zorder=7)


def draw_boxes(axes: Any, episode: Episode, frame: int, objects: Iterable[int], color: Rgb) -> None:
    """Rounded boxes around objects."""
    scale = drawing_scale(episode)
    for index in objects:
        u0, v0, u1, v1 = (float(x) * scale for x in episode.image(frame).boxes[index])
        if u1 <= u0:
            continue
        box = FancyBboxPatch(
            (u0, v0), u1 - u0, v1 - v0, boxstyle="round,pad=4,rounding_size=6", fill=False, linewidth=1.8,
            edgecolor=unit(color), zorder=5,
        )  # fmt: skip
        box.set_path_effects([withStroke(linewidth=3.4, foreground=unit(PAPER))])
        axes.add_patch(box)


def name_places(episode: Episode) -> np.ndarray:
    """Where the objects' names are, drawing units (N, 2): below the first box, above it at the board's lower edge."""
    scale = drawing_scale(episode)
    boxes, places = episode.image(0).boxes * scale, anchors(episode) * scale
    bottom = board_bounds(episode, MARGIN)[1][1] * scale
    seen = boxes[:, 2] > boxes[:, 0]
    below, above = np.where(seen, boxes[:, 3], places[:, 1]) + 9, np.where(seen, boxes[:, 1], places[:, 1]) - 9
    return np.stack([places[:, 0], np.where(below + 8 > bottom, above, below)], axis=1)


def draw_names(axes: Any, episode: Episode, size: float = 7.0) -> None:
    """The objects' names in the roles' colours."""
    for name, place, placed in zip(
        object_names(episode.board), name_places(episode), episode.board.objects, strict=True
    ):
        box = {"boxstyle": "round,pad=0.22", "facecolor": unit(ROLES[placed.role]), "linewidth": 0}
        axes.annotate(name, place, ha="center", va="center", fontsize=size, color=unit(PAPER), zorder=9, bbox=box)


def draw_arc(
    axes: Any,
    start: np.ndarray,
    end: np.ndarray,
    color: Rgb,
    dashed: bool,
    bend: float,
    width: float = 2.2,
    head: float = 13,
) -> None:
    """A bent arrow over the picture; width of the line and size of the head in points."""
    arrow = FancyArrowPatch(
        _pair(start), _pair(end), connectionstyle=f"arc3,rad={bend}", arrowstyle="-|>", mutation_scale=head,
        linewidth=width, linestyle=(0, (3, 2)) if dashed else "solid", color=unit(color), shrinkA=5, shrinkB=7,
        zorder=7,
    )  # fmt: skip
    arrow.set_path_effects([withStroke(linewidth=width + 2, foreground=unit(PAPER))])
    axes.add_patch(arrow)


def draw_label(axes: Any, place: np.ndarray, text: str, color: Rgb, size: float = 7.0) -> None:
    """A small bold text on a coloured ground; its size in points."""
    box = {"boxstyle": "round,pad=0.25", "facecolor": unit(color), "linewidth": 0}
    style = {"fontsize": size, "fontweight": "bold", "color": unit(PAPER), "zorder": 10}
    axes.annotate(text, _pair(place), ha="center", va="center", bbox=box, **style)


def _pair(point: np.ndarray) -> tuple[float, float]:
    return float(point[0]), float(point[1])


def bend_point(start: np.ndarray, end: np.ndarray, bend: float, share: float = 0.5) -> np.ndarray:
    """A point on matplotlib's `arc3` curve in drawing units (y down)."""
    along = end - start
    control = (start + end) / 2 + bend * np.array([-along[1], along[0]])
    return (1 - share) ** 2 * start + 2 * share * (1 - share) * control + share**2 * end


def clear_bend(start: np.ndarray, end: np.ndarray, others: list[np.ndarray]) -> float:
    """The bend whose curve stays away from other objects and labels; gentle ones win ties."""

    def merit(bend: float) -> float:
        curve = np.stack([bend_point(start, end, bend, share) for share in np.linspace(0.1, 0.9, 17)])
        return clearance(curve, others) - 12 * abs(abs(bend) - 0.2)

    return max((0.2, -0.2, 0.35, -0.35, 0.05, 0.5, -0.5), key=merit)


def clearance(points: np.ndarray, others: list[np.ndarray]) -> float:
    """Drawing units between points (P, 2) and the nearest of the others; more than `ENOUGH` is no better."""
    if not others:
        return ENOUGH
    return min(float(np.linalg.norm(points[:, None] - np.stack(others)[None], axis=-1).min()), ENOUGH)


def plain_axes(axes: Any) -> None:
    """Hairlines instead of a frame."""
    for side, spine in axes.spines.items():
        spine.set_visible(side == "bottom")
        spine.set_color(unit(FAINT))
    axes.tick_params(length=0, labelsize=7.5, labelcolor=unit(MUTED))
    axes.grid(axis="y", color=unit(FAINT), linewidth=0.7)
    axes.set_axisbelow(True)
