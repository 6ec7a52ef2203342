"""The course of a training of a model of relations as a picture."""

from pathlib import Path
from typing import Any

from busybot.training.metrics_file import read_metrics
from busybot.training.plots import label_panels, new_figure, plot_points, save_png

_NAMES = {
    "loss": "held out",
    "loss_of_no_change": "held out, if nothing changed",
    "right": "all steps",
    "right_changes": "steps that changed something",
}


def plot_fit(out: Path, name: str) -> Path:
    """Draw `training.png` from the metrics of a training's folder: losses, and shares on held-out boards if known."""
    lines = read_metrics(out / "metrics" / f"{name}.jsonl")
    judged: list[dict[str, Any]] = [line for line in lines if line.get("validation")]
    labels = sorted({label for line in judged for label in line["validation"]})
    with_shares = any(not label.startswith("loss") for label in labels)
    figure, panels = new_figure(1, 2 if with_shares else 1)
    losses, shares = panels[0][0], panels[0][-1]
    plot_points(losses, [(line["iteration"], line["loss"]) for line in lines if "loss" in line], "trained on")
    for label in labels:
        points = [(line["iteration"], line["validation"].get(label)) for line in judged]
        plot_points(losses if label.startswith("loss") else shares, points, _NAMES.get(label, label))
    titles = {losses: f"loss of the {name} model"}
    label_panels(titles | {shares: "held-out steps predicted rightly"} if with_shares else titles)
    if losses.get_lines():
        losses.set_yscale("log")
    if with_shares:
        shares.set_ylim(0, 1.02)
    return save_png(figure, out / "training.png")
