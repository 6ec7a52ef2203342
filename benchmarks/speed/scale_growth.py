"""What the points of `benchmarks.speed.scale` say: slopes, their words, their picture, and a million boards."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from busybot.datasets.manifest import MAX_MANIFEST_BYTES

COMMANDS = ("generate", "collect", "info", "verify", "read", "freeze", "verify frozen")
SMALL, FULL, USUAL = "boards at 64 x 48", "boards at 640 x 480", "30 actions"
"""Curves: the longest one, that of usual pictures, and that of usual episodes."""
POWERS = np.arange(0.1, 3.001, 0.05)
"""Exponents that are tried where neither a constant nor a line fits."""
NOISE = 0.15
"""Relative error within which one does: figures of one work differ by so much on a machine that does other work."""

Curves = Mapping[str, Mapping[str, Any]]
Figures = Mapping[str, float]


@dataclass(frozen=True)
class Growth:
    """How a figure grows along a curve.

    Attributes:
        power: p of `start + each x ** p`, which fits all points: 0 or 1 if these do within `NOISE`, else the one with
            the least relative errors.
        each: what one more of the variable costs, from the first point to the last.
        lately: the same between the last two points.
    """

    power: float
    each: float
    lately: float

    @property
    def words(self) -> str:
        """The slope in words."""
        if self.power in (0, 1):
            return "linear" if self.power else "hardly grows"
        return f"n^{self.power:.1f}, {'more' if self.power > 1 else 'less'} than linear"


def growth(xs: Sequence[float], values: Sequence[float]) -> Growth:
    """How values grow with x."""
    points = np.array(xs), np.array(values)
    plain = [power for power in (0.0, 1.0) if _error(*points, power) <= NOISE]
    power = plain[0] if plain else float(min(POWERS, key=lambda power: _error(*points, power)))
    lately = (values[-1] - values[-2]) / (xs[-1] - xs[-2])
    return Growth(power, (values[-1] - values[0]) / (xs[-1] - xs[0]), lately)


def _error(xs: np.ndarray, values: np.ndarray, power: float) -> float:
    """Root mean square of the relative errors of `start + each x ** power`, the best there is."""
    terms = np.stack([np.ones_like(xs), (xs / xs[-1]) ** power], axis=1)
    fitted, *_ = np.linalg.lstsq(terms / values[:, None], np.ones_like(xs), rcond=None)
    return float(np.sqrt(np.mean((terms @ fitted / values - 1) ** 2)))


def variables(curve: Mapping[str, Any]) -> list[float]:
    """What a curve is drawn against, point by point."""
    name = curve["variable"]
    return [
        float(point["size"][0] * point["size"][1] if name == "pixels" else point[name]) for point in curve["points"]
    ]


def costs(curve: Mapping[str, Any], command: str, figure: str = "cpu") -> list[float]:
    """A command's figure at every point of a curve."""
    return [point["costs"][command][figure] for point in curve["points"]]


def along(curve: Mapping[str, Any], command: str, figure: str = "cpu") -> Growth:
    """How a command's figure grows."""
    return growth(variables(curve), costs(curve, command, figure))


def on_disk(curve: Mapping[str, Any], figure: str) -> Growth:
    """How what lies on the disk grows."""
    return growth(variables(curve), [float(point["disk"][figure]) for point in curve["points"]])


BOARDS, MACHINES = 1_000_000, (1, 10, 100)
CORES, MEMORY_GB, DISK_GB = 16, 64, 2000
"""What a machine is taken to be; its cores are as fast as the one that was measured."""
BYTES_PER_INODE = 16384
"""As ext4 is made by default."""
DAY = 86400.0
UNSEEN = 1e-6
"""Seconds for a board of a command whose growth is lost among its start's."""
FILLED = 1000
"""Boards after which a command holds as much as it ever does at once: rows and boards by the shard, loaded objects."""


@dataclass(frozen=True)
class Million:
    """What a million boards take, extrapolated: 640 x 480 pixels, 30 actions, a frozen dataset on each machine.

    Attributes:
        seconds: of a processor for one board, by command.
        disk: bytes and files for one board, by kind.
        hours: by command, for each number of machines.
        memory_gb: of the first process of a command, likewise; nothing without a point beyond `FILLED` boards.
        cores_fed: processors that record as fast as one process can store what they record.
        limits: what comes to its end, and at how many boards, the first one first.
    """

    seconds: dict[str, float]
    disk: dict[str, float]
    hours: dict[str, list[float]]
    memory_gb: dict[str, list[float]]
    cores_fed: float
    limits: dict[str, float]

    def files_per_second(self, machines: int) -> float:
        """That so many machines finish together."""
        return machines * CORES / self.seconds["collect"]


def million(curves: Curves) -> Million:
    """What a million boards take.

    Time and bytes of a board are those of the curve `USUAL`, of `generate` and `info`, which no picture changes, those
    of the longest one; so is memory. Work that workers share is divided by the processors; the boards are drawn, read
    and hashed over, and files are listed in the manifest, by one.
    """
    usual, long = curves[USUAL], curves[SMALL]
    alone = {"generate", "info"}
    seconds = {name: max(along(long if name in alone else usual, name).each, UNSEEN) for name in COMMANDS}
    disk = {name: on_disk(usual, name).each for name in ("bytes", "episode_bytes", "table_bytes", "manifest_bytes")}
    disk["files"] = on_disk(usual, "files").each
    stored = max(along(usual, "collect", "first").each, 1e-6)
    shared = {
        "generate": seconds["generate"],
        "collect": max(seconds["collect"] / CORES, stored),
        "info": seconds["info"],
        "verify": seconds["verify"] / CORES,
        "read": seconds["read"],
        "freeze": seconds["verify"] / CORES + max(seconds["freeze"] - seconds["verify"], 0.0),
        "verify frozen": seconds["verify frozen"] / CORES,
    }
    known = COMMANDS if variables(long)[-2] >= FILLED else ()
    memory = {name: max(along(long, name, "mb").lately, 0.0) for name in known}
    needed, most = {name: costs(long, name, "mb")[-1] for name in COMMANDS}, variables(long)[-1]

    def gigabytes(name: str, boards: float) -> float:
        return (needed[name] + memory[name] * max(boards - most, 0.0)) / 1e3

    limits = {
        f"the disk ({DISK_GB / 1000:g} TB) is full": DISK_GB * 1e9 / disk["bytes"],
        "the disk has no inode left": DISK_GB * 1e9 / BYTES_PER_INODE / disk["files"],
        "the manifest is larger than a reader accepts": MAX_MANIFEST_BYTES / disk["manifest_bytes"],
        "collecting takes a week": 7 * DAY / shared["collect"],
        "verifying takes a day": DAY / shared["verify"],
        "freezing takes a day": DAY / shared["freeze"],
    }
    full = {name: most + (1e3 * MEMORY_GB - needed[name]) / each for name, each in memory.items() if each > 0}
    if full:
        first = min(full, key=full.__getitem__)
        limits[f"`{first}` needs more memory than {MEMORY_GB} GB"] = full[first]
    return Million(
        seconds,
        disk,
        {name: [BOARDS / count * one / 3600 for count in MACHINES] for name, one in shared.items()},
        {name: [gigabytes(name, BOARDS / count) for count in MACHINES] for name in known},
        seconds["collect"] / stored,
        dict(sorted(limits.items(), key=lambda limit: limit[1])),
    )


def scale_figure(path: Path, result: Mapping[str, Any]) -> Path:
    """Cost against boards at two resolutions, memory against boards, cost against objects, pixels and workers.

    Each slope stands in words in the colour of its line.
    """
    from busybot.view.figures import parts
    from busybot.view.palette import ACTION

    curves, product = result["curves"], result["product_milliseconds"] / 1e3
    figure = parts.page(parts.WIDTH, 6.2)
    grid = figure.subplots(2, 3)
    for axes, name in zip(grid[0], (SMALL, FULL), strict=False):
        _draw(axes, curves[name], product)
        parts.draw_title(axes, f"time, {name.removeprefix('boards at ')}", "matrix products")
    _draw(grid[0][2], curves[SMALL], 1.0, "mb")
    parts.draw_title(grid[0][2], "memory, 64 x 48", "MB, first process")
    for axes, name in zip(grid[1], ("objects", "pixels", "workers"), strict=True):
        _draw(axes, curves[name], product)
        parts.draw_title(axes, f"{name}, {curves[name]['points'][0]['boards']} boards", "matrix products")
    keys = [parts.line_key(name, color, marker="o", markersize=3) for name, color in _colors().items()]
    keys.append(parts.line_key("a worker of collect", ACTION, linestyle=":", marker="o", markersize=3))
    parts.draw_legend(figure, keys)
    return parts.save_png(figure, path)


def _colors() -> dict[str, Any]:
    """Of commands."""
    from busybot.view.palette import ACTION, CORRECT, MUTED, RESPONDER, TRIGGER, TRUTH

    colors = (TRUTH, ACTION, TRIGGER, RESPONDER, MUTED, CORRECT)
    return dict(zip(("generate", "collect", "info", "verify", "read", "freeze"), colors, strict=True))


def _draw(axes: Any, curve: Mapping[str, Any], unit_of_values: float, what: str = "cpu") -> None:
    """A line for each command, upright logarithmic if it is time against boards."""
    from matplotlib.patheffects import withStroke
    from matplotlib.ticker import NullLocator

    from busybot.view.figures import parts
    from busybot.view.palette import ACTION, MUTED, PAPER, unit

    parts.plain_axes(axes)
    xs, boards = variables(curve), curve["variable"] == "boards"
    drawn = {name: color for name, color in _colors().items() if all(name in p["costs"] for p in curve["points"])}
    style: dict[str, Any] = {"markersize": 3, "linewidth": 1.4, "clip_on": False}
    most, halo = 0.0, withStroke(linewidth=3, foreground=unit(PAPER))
    for number, (name, color) in enumerate(drawn.items()):
        values = [value / unit_of_values for value in costs(curve, name, what)]
        axes.plot(xs, values, "o-", color=unit(color), **style)
        most = max(most, *values)
        if curve["variable"] != "workers":
            words = f"{name}: {along(curve, name, what).words}"
            place = {"transform": axes.transAxes, "va": "top", "path_effects": [halo]}
            axes.text(0.02, 0.985 - 0.062 * number, words, fontsize=6.5, color=unit(color), **place)
    if what == "mb":
        values = costs(curve, "collect", "worker_mb")
        axes.plot(xs, values, "o:", color=unit(ACTION), **style)
        most = max(most, *values)
    axes.set_xlabel(curve["variable"], fontsize=8, color=unit(MUTED))
    if boards:
        axes.set_xscale("log")
        axes.xaxis.set_minor_locator(NullLocator())
    if boards and what == "cpu":
        axes.set_yscale("log")
        axes.yaxis.set_minor_locator(NullLocator())
        axes.set_ylim(10, 20 * most)
        axes.set_yticks([value for value in (10, 100, 1000, 10000, 100000) if value < 2 * most])
    else:
        axes.set_ylim(0, 1.65 * most)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(_plain)
    if len(xs) < 4:
        axes.set_xticks(xs)


def _plain(value: float, _: object = None) -> str:
    """A number on an axis: 10,000, or 1.2 M."""
    return f"{value / 1e6:g} M" if value >= 1e5 else f"{value:,.0f}"
