"""`busybot train reason --variant paper`, as a user runs it, with networks too small to learn anything."""

import json
import urllib.error
from pathlib import Path

import pytest
from typer.testing import CliRunner

from busybot.cli.main import app
from busybot.reason.models.registry import load_reasoner
from tests.episodes.folders import make_dataset

WIDTHS = ("embedding", "edge_embedding", "action", "hidden", "convolution", "recurrent")
SMALL = (*(f"network.{name}=4" for name in WIDTHS), "images=3", "epochs=2", "batch=2", "threads=1", "loop.judge=1")
SETTINGS = [word for setting in SMALL for word in ("--set", setting)]


def words_for(data: Path, out: Path, *more: str) -> list[str]:
    return ["train", "reason", "--variant", "paper", "--data", str(data), "--out", str(out), "--workers", "1", *more]


@pytest.mark.parametrize(("words", "name"), [([], "paper"), (["--set", "inference=false"], "paper without inference")])
def test_a_training_leaves_a_model_that_can_be_loaded(tmp_path: Path, words: list[str], name: str) -> None:
    data, out = make_dataset(tmp_path / "toys").path, tmp_path / "run"
    result = CliRunner().invoke(app, words_for(data, out, "--encoder", "embedded", *SETTINGS, *words, "--json"))
    assert result.exit_code == 0, result.stderr
    told = json.loads(result.stdout)["training"]
    assert (told["iterations"], told["best_iteration"], told["boards"]) == (4, 4, 3)
    assert load_reasoner(out).name == name
    assert json.loads((out / "model" / "model.json").read_text())["model"] == "paper"
    assert (out / "training.png").exists() and "loss" in (out / "metrics.csv").read_text()


def test_it_reads_the_papers_features_and_says_what_to_do_where_their_weights_cannot_be_had(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise urllib.error.URLError("no route")

    monkeypatch.setenv("BUSYBOT_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("urllib.request.urlopen", refuse)
    result = CliRunner().invoke(app, words_for(make_dataset(tmp_path / "toys").path, tmp_path / "run", *SETTINGS))
    assert result.exit_code == 1 and "resnet50-0676ba61.pth: cannot be downloaded" in result.stderr
    assert "copy it to" in result.stderr and "--encoder embedded" in result.stderr


@pytest.mark.long
def test_its_authors_frames_and_steps_are_options_and_every_features_can_be_judged(tmp_path: Path) -> None:
    data, out = make_dataset(tmp_path / "toys").path, tmp_path / "run"
    options = ("--encoder", "random-centre", "--set", "observed=[2, 3]", "--set", "steps=2")
    result = CliRunner().invoke(app, words_for(data, out, *options, *SETTINGS))
    assert result.exit_code == 0, result.stderr
    judged = CliRunner().invoke(app, ["eval", "reason", str(data), "--reasoner", str(out), "--images", "3", "--json"])
    assert judged.exit_code == 0, judged.stderr
    assert 0 <= json.loads(judged.stdout)["pred_a"] <= 1
