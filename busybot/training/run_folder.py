"""A training's folder: what was asked for, its metrics, and its course as a picture.

What was asked for is noted, so that the same command continues and another one is refused (`begin_folder`). Metrics of
a running training are lines of JSON in a file and lines of text on standard error (`Metrics`); the picture is drawn
from those lines, without a display (`draw`).
"""

import json
import math
import sys
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from busybot import __version__
from busybot.common.atomic_io import (
    names_in,
    read_json,
    read_text,
    remove_leftovers,
    scan,
    write_atomically,
    write_json,
)
from busybot.common.errors import BusybotError
from busybot.common.limits import MAX_LINES_BYTES
from busybot.common.quiet import is_quiet

TRAIN_FILE = "train.json"


def begin_folder(out: Path, config: BaseModel, seed: int, before: Collection[str] = (), **more: Any) -> None:
    """Note what is asked for, or refuse to continue a training that was asked for otherwise.

    Args:
        before: names that may lie in a folder in which a training begins.
        more: what else decides the outcome, JSON values.
    """
    wanted = {"seed": seed, "config": config.model_dump(mode="json"), **more}
    if out.exists() and not out.is_dir():
        raise BusybotError(f"{out}: it is a file", "name a folder")
    if others := scan(out).others if out.is_dir() else []:
        what = f"{out / others[0]}: a link or device; a training writes through none"
        raise BusybotError(what, "put a copy of what it leads to in its place, or remove it")
    if not (out / TRAIN_FILE).exists():
        strangers = sorted(names_in(out) - set(before)) if out.is_dir() else []
        if strangers:
            raise BusybotError(f"{out}: it holds {strangers[0]!r} and no {TRAIN_FILE}", "name another folder")
        write_json(out / TRAIN_FILE, wanted)
        return
    if differing := _differences(read_json(out / TRAIN_FILE), wanted, ""):
        raise BusybotError(
            f"{out}: a training with other parameters was begun there: {'; '.join(differing[:5])}",
            "continue it with the same parameters, or name another folder",
        )
    remove_leftovers(out)


def _differences(recorded: Any, wanted: Any, place: str) -> list[str]:
    if isinstance(recorded, dict) and isinstance(wanted, dict):
        names = sorted(recorded.keys() | wanted.keys())
        return [d for n in names for d in _differences(recorded.get(n), wanted.get(n), f"{place}.{n}".lstrip("."))]
    return [] if recorded == wanted else [f"{place} {recorded!r}, now {wanted!r}"]


def learner_versions() -> dict[str, str]:
    """Versions of what decides the weights."""
    return {"busybot": __version__, **{name: version(name) for name in ("torch", "numpy")}}


PROGRESS_SECONDS = 15.0


class Metrics:
    """The metrics file of one network: one JSON object per line, in the order of iterations.

    Lines with `loss` hold its mean since the line before, None if none was a number, lines with `validation` the
    figures at a round's end.

    Args:
        resumed: lines after this iteration are dropped: the training repeats them.
        losses: since the last line, those of before an interruption; new ones are put there.
    """

    def __init__(
        self, path: Path, name: str, resumed: int, start: int, until: int, every: int, losses: list[float] | None = None
    ):
        self._path, self._name, self._start, self._until, self._every = path, name, start, until, every
        kept = [line for line in read_metrics(path) if line["iteration"] <= resumed]
        # figures at the end are this round's own, which it repeats; where it has no iterations, the first of them are
        # those of the round before
        ends = [k for k, line in enumerate(kept) if "loss" not in line and line["iteration"] >= until]
        own = ends[1:] if until == start > 0 else ends
        self._lines: list[dict[str, Any]] = [line for k, line in enumerate(kept) if k not in own]
        self._losses = [] if losses is None else losses
        self._began, self._first, self._told = time.monotonic(), resumed, time.monotonic()

    def add(self, iteration: int, loss: float, rate: float) -> None:
        """Enter an iteration's loss and learning rate."""
        self._losses.append(loss)
        if iteration % self._every == 0 or iteration == self._until:
            known = [one for one in self._losses if math.isfinite(one)]
            mean = sum(known) / len(known) if known else None
            self._lines.append({"iteration": iteration, "loss": mean, "learning_rate": rate})
            self._losses.clear()
            now = time.monotonic()
            if now - self._told >= PROGRESS_SECONDS or iteration == self._until:
                self._told, seconds = now, (now - self._began) / (iteration - self._first)
                shown = "no number" if mean is None else f"{mean:.3f}"
                done = f"{iteration - self._start} of {self._until - self._start}, loss {shown}"
                left = f"{1e3 * seconds:.0f} ms each, {seconds * (self._until - iteration):.0f} s left"
                self._tell(f"{done}, {left}")

    def end(self, iteration: int, figures: Mapping[str, float | None]) -> None:
        """Enter the figures of a round's end."""
        self._lines.append({"iteration": iteration, "validation": told(figures)})
        self.write()
        shown = ", ".join(f"{name} {value:.4f}" for name, value in figures.items() if value is not None)
        if shown:  # without held-out boards there is nothing to tell
            self._tell(shown)

    def _tell(self, what: str) -> None:
        if not is_quiet():
            print(f"{self._name}: {what}", file=sys.stderr, flush=True)

    def write(self) -> None:
        """Bring the file up to date."""
        text = "".join(json.dumps(line, sort_keys=True) + "\n" for line in self._lines)
        write_atomically(self._path, text.encode(), self._path.parent.parent)


def told(figures: Mapping[str, float | None]) -> dict[str, float | None]:
    """As JSON has them: None in place of what is no number."""
    return {name: value if value is None or math.isfinite(value) else None for name, value in figures.items()}


def read_metrics(path: Path) -> list[dict[str, Any]]:
    """The lines of a metrics file, none if it does not exist.

    Raises:
        BusybotError: naming the line that is damaged.
    """
    lines = read_text(path, MAX_LINES_BYTES).splitlines() if path.exists() else []
    return [_metric(line, f"{path}: line {number}") for number, line in enumerate(lines, start=1)]


def _metric(text: str, place: str) -> dict[str, Any]:
    hint = "remove the line, or the file: no weights depend on it"
    try:
        line = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise BusybotError(f"{place}: not valid JSON: {error}", hint) from None
    if not isinstance(line, dict) or not isinstance(line.get("iteration", line.get("epoch")), int):
        raise BusybotError(f"{place}: it tells of no iteration or epoch", hint)
    return line


WIDTH_INCHES, ROW_INCHES = 11.0, 3.25
MARKED = 60
"""Curves of fewer points show each of them."""

Lines = Sequence[Mapping[str, Any]]
"""Of `read_metrics`."""
Points = Sequence[tuple[float, float | None]]
"""A value of None is left out."""


@dataclass(frozen=True)
class Panel:
    """One of a picture's panels.

    Attributes:
        curves: points by label; labels of no points are left out.
        along: what the x axis counts.
        logarithmic: the y axis, where there is a curve.
        shares: the y axis goes from 0 to 1.
    """

    title: str
    curves: Mapping[str, Points]
    along: str = "iteration"
    logarithmic: bool = False
    shares: bool = False


def losses(lines: Lines) -> Points:
    """Mean losses of what was trained on."""
    return [(line["iteration"], line["loss"]) for line in lines if line.get("loss") is not None]


def judgements(lines: Lines, labels: Mapping[str, str] | None = None) -> dict[str, Points]:
    """Figures on held-out boards by label.

    Args:
        labels: of the figures that are wanted, by name; by default all by their names, in alphabetical order.
    """
    judged = [line for line in lines if line.get("validation")]
    if labels is None:
        labels = {name: name for name in sorted({name for line in judged for name in line["validation"]})}
    return {
        label: [(line["iteration"], line["validation"].get(name)) for line in judged] for name, label in labels.items()
    }


def draw(path: Path, panels: Sequence[Sequence[Panel]]) -> Path:
    """Write the picture with panels [row][column], without rows in which there is nothing to draw."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    panels = [row for row in panels if any(map(_has_points, row))] or panels
    figure = Figure(figsize=(WIDTH_INCHES, ROW_INCHES * len(panels)), layout="constrained")
    grid = figure.subplots(len(panels), len(panels[0]), squeeze=False)
    for row, of_row in zip(grid, panels, strict=True):
        for axes, panel in zip(row, of_row, strict=True):
            _draw_panel(axes, panel)
    buffer = BytesIO()
    FigureCanvasAgg(figure).print_png(buffer)
    write_atomically(path, buffer.getvalue())
    return path


def _has_points(panel: Panel) -> bool:
    return any(y is not None for points in panel.curves.values() for _, y in points)


def _draw_panel(axes: Any, panel: Panel) -> None:
    for label, points in panel.curves.items():
        known = [(x, y) for x, y in points if y is not None]
        if known:
            axes.plot(*zip(*known, strict=True), marker="." if len(known) < MARKED else None, linewidth=1, label=label)
    axes.set_title(panel.title)
    axes.set_xlabel(panel.along)
    axes.grid(alpha=0.3)
    if axes.get_lines():
        axes.legend(fontsize="small")
        if panel.logarithmic:
            axes.set_yscale("log")
    if panel.shares:
        axes.set_ylim(-0.02, 1.02)
