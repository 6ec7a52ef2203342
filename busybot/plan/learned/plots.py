"""The course of a learned agent's training as a picture."""

from pathlib import Path
from typing import Any

from busybot.training.metrics_file import read_metrics
from busybot.training.plots import label_panels, new_figure, plot_points, save_png

_SETS = {"success_seen": "trained on", "success": "held out"}


def plot_training(out: Path, agent: str) -> Path:
    """Draw `training.png` from the metrics of a training's folder: the loss, and success on tasks."""
    lines = read_metrics(out / "metrics" / f"{agent}.jsonl")
    judged: list[dict[str, Any]] = [line for line in lines if line.get("validation")]
    figure, panels = new_figure(1, 2)
    losses, success = panels[0]
    plot_points(losses, [(line["iteration"], line["loss"]) for line in lines if "loss" in line], "trained on")
    if agent == "bc":  # what is to be least for ppo is no loss of the same kind
        plot_points(losses, [(line["iteration"], line["validation"].get("loss")) for line in judged], "held out")
    for name, label in _SETS.items():
        plot_points(success, [(line["iteration"], line["validation"].get(name)) for line in judged], label)
    label_panels({losses: f"loss of {agent}", success: "responders in their goal state at the end, share"})
    success.set_ylim(0, 1.02)
    return save_png(figure, out / "training.png")
