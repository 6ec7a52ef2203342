"""The course of a training as a picture: losses, and figures on boards that were never trained on."""

from pathlib import Path
from typing import Any

from busybot.interact.networks import KINDS
from busybot.training.metrics_file import read_metrics
from busybot.training.plots import new_figure, save_png


def plot_training(out: Path) -> Path:
    """Draw `training.png` from the metrics files of a training's folder."""
    figure, panels = new_figure(2, len(KINDS))
    for column, kind in enumerate(KINDS):
        lines = read_metrics(out / "metrics" / f"{kind}.jsonl")
        _plot_loss(panels[0][column], f"{kind} network", lines, "loss of prioritised batches")
        _plot_validation(panels[1][column], lines)
    return save_png(figure, out / "training.png")


def plot_paper_training(out: Path) -> Path:
    """The same for the `paper` variant: losses, and what each epoch's actions earned."""
    figure, panels = new_figure(2, len(KINDS))
    for column, kind in enumerate(KINDS):
        lines = read_metrics(out / "metrics" / f"{kind}.jsonl")
        _plot_loss(panels[0][column], f"{kind} network", lines, "loss of half-positive batches")
        panels[0][column].set_xlabel("iteration")
        _plot_epochs(panels[1][column], kind, read_metrics(out / "metrics" / "epochs.jsonl"))
    return save_png(figure, out / "training.png")


def _plot_loss(panel: Any, title: str, lines: list[dict[str, Any]], label: str) -> None:
    points = [(line["iteration"], line["loss"]) for line in lines if "loss" in line]
    panel.set_title(title)
    panel.set_ylabel(label)
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


def _plot_epochs(panel: Any, kind: str, lines: list[dict[str, Any]]) -> None:
    epochs = [line["epoch"] for line in lines]
    panel.plot(epochs, [line["rewarded"] / max(line["steps"], 1) for line in lines], label="actions with reward")
    panel.plot(epochs, [line[f"epsilon_{kind}"] for line in lines], "--", label=f"random {kind}s")
    panel.set_xlabel("epoch")
    panel.set_ylabel("share of an epoch's actions")
    panel.set_ylim(-0.02, 1.02)
    panel.grid(alpha=0.3)
    panel.legend(fontsize="small")
