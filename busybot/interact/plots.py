"""The course of a training as a picture: losses, and figures on boards that were never trained on."""

from pathlib import Path
from typing import Any

from busybot.interact.fit_metrics import read_metrics
from busybot.interact.networks import KINDS

SIZE_INCHES = (11.0, 6.5)


def plot_training(out: Path) -> Path:
    """Draw `training.png` from the metrics files of a training's folder."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=SIZE_INCHES, layout="constrained")
    panels = figure.subplots(2, len(KINDS), squeeze=False)
    for column, kind in enumerate(KINDS):
        lines = read_metrics(out / "metrics" / f"{kind}.jsonl")
        _plot_loss(panels[0][column], f"{kind} network", lines)
        _plot_validation(panels[1][column], lines)
    path = out / "training.png"
    FigureCanvasAgg(figure).print_png(str(path))
    return path


def _plot_loss(panel: Any, title: str, lines: list[dict[str, Any]]) -> None:
    points = [(line["iteration"], line["loss"]) for line in lines if "loss" in line]
    panel.set_title(title)
    panel.set_ylabel("loss of prioritised batches")
    if points:
        panel.plot(*zip(*points, strict=True), linewidth=1)
        panel.set_yscale("log")
    panel.grid(alpha=0.3)


def _plot_validation(panel: Any, lines: list[dict[str, Any]]) -> None:
    rounds = [line for line in lines if line.get("validation")]
    for name in sorted({name for line in rounds for name in line["validation"]}):
        points = [(line["iteration"], line["validation"][name]) for line in rounds]
        panel.plot(*zip(*[p for p in points if p[1] is not None], strict=True), marker="o", label=name)
    panel.set_xlabel("iteration")
    panel.set_ylabel("held-out boards, end of round")
    panel.grid(alpha=0.3)
    if rounds:
        panel.legend(fontsize="small")
