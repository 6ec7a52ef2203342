"""`busybot train reason --variant paper`, as a user runs it, with networks too small to learn anything."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from busybot.cli.main import app
from busybot.reason.models.registry import load_reasoner
from tests.episodes.folders import make_dataset

WIDTHS = ("embedding", "edge_embedding", "action", "hidden", "convolution", "recurrent")
SMALL = (*(f"network.{name}=4" for name in WIDTHS), "images=3", "epochs=2", "batch=2", "threads=1", "loop.judge=1")
SETTINGS = [word for setting in SMALL for word in ("--set", setting)]


@pytest.mark.parametrize(("words", "name"), [([], "paper"), (["--set", "inference=false"], "paper without inference")])
def test_a_training_leaves_a_model_that_can_be_loaded(tmp_path: Path, words: list[str], name: str) -> None:
    data, out = make_dataset(tmp_path / "toys").path, tmp_path / "run"
    command = ["train", "reason", "--variant", "paper", "--data", str(data), "--out", str(out), "--workers", "1"]
    result = CliRunner().invoke(app, [*command, *SETTINGS, *words, "--json"])
    assert result.exit_code == 0, result.stderr
    told = json.loads(result.stdout)["training"]
    assert (told["iterations"], told["best_iteration"], told["boards"]) == (4, 4, 3)
    assert load_reasoner(out).name == name
    assert json.loads((out / "model" / "model.json").read_text())["model"] == "paper"
    assert (out / "training.png").exists() and "loss" in (out / "metrics.csv").read_text()
