"""Parts of figures: a page, a picture cut to the board, names, arrows, arcs, legends. Matplotlib without pyplot."""

import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch, Patch
from matplotlib.patheffects import withStroke
from matplotlib.ticker import PercentFormatter

from busybot.common.atomic_io import write_atomically
from busybot.episodes.episode import Episode, Image
from busybot.view.annotations import anchors, board_bounds, drawing_scale, known_boxes, object_names, seen_directions
from busybot.view.palette import ACTION, FAINT, INK, MUTED, PAPER, ROLES, Rgb, unit

WIDTH = 9.6
"""Of a figure, inches; 1536 pixels."""
DPI = 160
MARGIN = 4.0
"""Around the board in a cut picture, drawing units."""
ENOUGH = 40.0
"""Drawing units that a name keeps from others if it can."""
MOST_NAMED = 20
"""On boards with more objects their numbers alone have room."""
ARROW_LENGTH = 0.55
"""Of an action's arrow, board units."""


def page(width: float, height: float) -> Figure:
    """An empty figure, inches."""
    layout = ConstrainedLayoutEngine(h_pad=0.07, w_pad=0.05)
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor=unit(PAPER), layout=layout)
    FigureCanvasAgg(figure)
    return figure


def picture_grid(pictures: int, columns: int, side: float, row: float, extra: float = 0) -> tuple[Figure, list[Any]]:
    """A page with axes for pictures: their width, the height of a row, extra room at the lower edge; inches."""
    rows = max(-(-pictures // columns), 1)
    figure = page(side * columns, rows * row + extra)
    grid = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for axes in grid[pictures:]:
        axes.set_axis_off()
    return figure, grid


def save_png(figure: Figure, path: Path, root: Path | None = None) -> Path:
    """Write a PNG; equal figures give equal bytes.

    Args:
        root: the folder that the user named, if it is not the one the picture lies in (`common.atomic_io`).
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    write_atomically(path, buffer.getvalue(), root)
    return path


def draw_picture(axes: Any, episode: Episode, image: Image, paleness: float = 0.0) -> None:
    """An RGB image cut to the board, axes in drawing units, mixed with white by `paleness` (0..1)."""
    rgb, scale = image.rgb.astype(float), drawing_scale(episode)
    shown = (rgb + (255 - rgb) * paleness).astype(np.uint8)
    size = (episode.camera.width * scale, episode.camera.height * scale)
    axes.imshow(shown, extent=(0, size[0], size[1], 0), interpolation="lanczos")
    low, high = (corner * scale for corner in board_bounds(episode, MARGIN))
    axes.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]), xticks=[], yticks=[])
    axes.spines[:].set_visible(False)


def draw_title(axes: Any, bold: str, plain: str = "") -> None:
    """A title at the left, its second part in grey; a dollar sign in it begins no formula."""
    style: dict[str, Any] = {"pad": 4, "parse_math": False}
    axes.set_title(bold, loc="left", fontsize=8.5, fontweight="bold", color=unit(INK), **style)
    if plain:
        axes.set_title(plain, loc="right", fontsize=7.5, color=unit(MUTED), **style)


def draw_action(axes: Any, episode: Episode, step: int) -> None:
    """The chosen pixel and the proposed direction."""
    done, scale = episode.steps[step], drawing_scale(episode)
    start = (np.array(done.pixel) + 0.5) * scale
    tip = start + seen_directions(episode, done.position, [done.direction], ARROW_LENGTH)[0] * scale
    if float(np.hypot(*(tip - start))) > 8:
        _add(axes, _arrow(start, tip, ACTION, linewidth=1.8, mutation_scale=9, shrinkA=0, shrinkB=0, zorder=6), 3.6)
    axes.plot(*start, "o", markersize=6, color=unit(ACTION), markeredgecolor=unit(PAPER), markeredgewidth=1.2, zorder=7)


def _add(axes: Any, patch: Patch, halo: float) -> None:
    """Add a patch with a halo of the paper's colour, points."""
    patch.set_path_effects([withStroke(linewidth=halo, foreground=unit(PAPER))])
    axes.add_patch(patch)


def draw_boxes(axes: Any, episode: Episode, frame: int, objects: Iterable[int], color: Rgb) -> None:
    """Rounded boxes around objects."""
    for index in objects:
        boxes = known_boxes(episode, episode.image(frame))
        u0, v0, u1, v1 = boxes[index].astype(float) * drawing_scale(episode)
        if u1 <= u0:
            continue
        style: dict[str, Any] = {"linewidth": 1.8, "edgecolor": unit(color), "fill": False, "zorder": 5}
        _add(axes, FancyBboxPatch((u0, v0), u1 - u0, v1 - v0, "round,pad=4,rounding_size=6", **style), 3.4)


def name_places(episode: Episode) -> np.ndarray:
    """Where the objects' names are, drawing units (N, 2): below the first box, above it at the board's lower edge."""
    scale = drawing_scale(episode)
    boxes, places = episode.image(0).boxes * scale, anchors(episode) * scale
    bottom = board_bounds(episode, MARGIN)[1][1] * scale
    seen = boxes[:, 2] > boxes[:, 0]
    below, above = np.where(seen, boxes[:, 3], places[:, 1]) + 9, np.where(seen, boxes[:, 1], places[:, 1]) - 9
    return np.stack([places[:, 0], np.where(below + 8 > bottom, above, below)], axis=1)


def draw_names(axes: Any, episode: Episode, size: float = 7.0) -> None:
    """The objects' names in the roles' colours, or their numbers on boards that have many."""
    names = object_names(episode.board)
    if len(names) > MOST_NAMED:
        names = [str(index) for index in range(len(names))]
    told = zip(names, name_places(episode), episode.board.objects, strict=True)
    for name, place, placed in told:
        draw_tag(axes, place, name, ROLES[placed.role], size, 0.22, zorder=9)


def draw_label(axes: Any, place: np.ndarray, text: str, color: Rgb, size: float = 7.0) -> None:
    """A small bold text on a coloured ground; its size in points."""
    draw_tag(axes, place, text, color, size, 0.25, zorder=10, fontweight="bold")


def draw_tag(axes: Any, place: np.ndarray, text: str, color: Rgb, size: float, pad: float = 0.22, **style: Any) -> None:
    """A text on a coloured ground, as it stands: a dollar sign in it begins no formula."""
    style = {"parse_math": False, **style}
    box = {"boxstyle": f"round,pad={pad}", "facecolor": unit(color), "linewidth": 0}
    axes.annotate(text, _pair(place), ha="center", va="center", fontsize=size, color=unit(PAPER), bbox=box, **style)


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
    style = {"linewidth": width, "linestyle": (0, (3, 2)) if dashed else "solid", "mutation_scale": head}
    arrow = _arrow(start, end, color, connectionstyle=f"arc3,rad={bend}", shrinkA=5, shrinkB=7, zorder=7, **style)
    _add(axes, arrow, width + 2)


def draw_line(axes: Any, start: np.ndarray, end: np.ndarray, color: Rgb, dashed: bool) -> None:
    """A straight line over the picture."""
    style = (0, (3, 2)) if dashed else "solid"
    halo = [withStroke(linewidth=3.5, foreground=unit(PAPER))]
    ends = (float(start[0]), float(end[0])), (float(start[1]), float(end[1]))
    axes.plot(*ends, color=unit(color), linewidth=1.5, linestyle=style, zorder=7, path_effects=halo)


def _arrow(start: np.ndarray, end: np.ndarray, color: Rgb, **style: Any) -> FancyArrowPatch:
    return FancyArrowPatch(_pair(start), _pair(end), arrowstyle="-|>", color=unit(color), **style)


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


def plain_axes(axes: Any, shares: tuple[float, float] | None = None) -> None:
    """Hairlines instead of a frame; `shares` are the ends of an upright axis that is in percent."""
    axes.spines[:].set_color(unit(FAINT))
    axes.spines[["left", "right", "top"]].set_visible(False)
    axes.tick_params(length=0, labelsize=7.5, labelcolor=unit(MUTED))
    axes.grid(axis="y", color=unit(FAINT), linewidth=0.7)
    axes.set_axisbelow(True)
    if shares is not None:
        axes.set_ylim(*shares)
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))


def draw_legend(figure: Figure, handles: Sequence[Artist], columns: int | None = None) -> None:
    """A legend below all axes, by default in one line; a dollar sign in it begins no formula."""
    style: dict[str, Any] = {"frameon": False, "fontsize": 8, "labelcolor": unit(INK)}
    legend = figure.legend(handles=handles, loc="outside lower center", ncols=columns or len(handles), **style)
    for text in legend.get_texts():
        text.set_parse_math(False)


def line_key(label: str, color: Rgb, **style: Any) -> Line2D:
    """A line or mark of a legend."""
    return Line2D([], [], color=unit(color), label=label, **style)


def frame_key(label: str, color: Rgb, width: float = 1.8) -> Patch:
    """A frame of a legend; width of its line in points."""
    return Patch(facecolor="none", edgecolor=unit(color), linewidth=width, label=label)
