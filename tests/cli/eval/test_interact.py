"""`busybot eval interact` and `busybot collect --policy learned`, as a user runs them."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from busybot.cli.main import app
from busybot.datasets.dataset import Dataset
from busybot.interact.affordance.fast import AffordanceModel
from busybot.interact.affordance.networks import KINDS, make_network
from busybot.interact.policy.config import AffordanceInfo

pytestmark = pytest.mark.usefixtures("in_process")

KEYS = {"precision", "recall", "recall_objects", "precision_exploring", "off_axis_share", "boards", "command"}


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, [*map(str, arguments)])


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    path = tmp_path / "data"
    assert run("generate", path, "--boards", 2, "--split", "novel-config", "--group-size", 1).exit_code == 0
    return path


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models") / "untrained"
    AffordanceModel(AffordanceInfo(), {kind: make_network(kind, "depth") for kind in KINDS}).save(folder)
    return folder


def evaluated(dataset: Path, *arguments: object) -> dict[str, object]:
    result = run("eval", "interact", dataset, "--set", "actions=2", "--workers", 1, "--json", *arguments)
    assert result.exit_code == 0, result.output
    return dict(json.loads(result.stdout))


def test_built_in_policies_are_measured(dataset: Path) -> None:
    values = evaluated(dataset, "--model", "scripted", "--strict")
    assert set(values) >= KEYS
    assert (values["boards"], values["precision"], values["policy"]) == (2, 1.0, "scripted")
    assert (values["off_axis_share"], values["strict"]) == (0.0, True)
    assert str(values["command"]).startswith("busybot eval interact")


@pytest.mark.long
def test_a_model_is_measured_recorded_and_drawn(dataset: Path, model: Path, tmp_path: Path) -> None:
    out, record = tmp_path / "out", tmp_path / "episodes"
    values = evaluated(dataset, "--model", model, "--out", out, "--record", record, "--figures", 1)
    assert values["provenance"]["model"]["name"] == "untrained"  # type: ignore[index]
    assert json.loads((out / "result.json").read_text())["precision"] == values["precision"]
    assert Dataset.open(record).finished() == {0, 1}
    assert [file.name for file in (out / "figures").iterdir()] == ["board-000000.png"]


@pytest.mark.parametrize("mode", ["greedy", "ucb", "collect"])
def test_every_mode_runs(dataset: Path, model: Path, mode: str) -> None:
    values = evaluated(dataset, "--model", model, "--mode", mode, "--boards", 1)
    assert values["boards"] == 1 and values["provenance"]["mode"] == mode  # type: ignore[index]


def test_the_table_names_policy_and_causes(dataset: Path) -> None:
    result = run("eval", "interact", dataset, "--model", "random", "--boards", 1, "--workers", 1)
    assert result.exit_code == 0
    for word in ("random", "precision", "recall", "failed because of", "missed most"):
        assert word in result.stdout


def test_mistakes_are_told(dataset: Path, model: Path) -> None:
    for arguments, words in (
        (("--model", model, "--mode", "clever"), "'clever' is not one of"),
        (("--model", model, "--figures", "1"), "give --out and --record"),
        (("--model", model, "--set", "learned.explor=1"), "parameter explor of the learned policy"),
        (
            ("--model", model, "--mode", "greedy", "--set", "learned.explore=0.5"),
            "learned.explore changes nothing in mode",
        ),
        (("--model", model, "--mode", "ucb", "--set", "learned.ucb_window=5"), "parameter ucb_window"),
        (("--model", "random", "--mode", "ucb"), "--mode ucb is about a trained model's policy, random has none"),
        (("--model", "scripted", "--set", "learned.explore=1"), "--set learned.explore is about a trained"),
    ):
        result = run("eval", "interact", dataset, *arguments, "--workers", "1")
        assert result.exit_code == 2 and words in result.output
    result = run("eval", "interact", dataset, "--model", "nonsense", "--workers", "1")
    assert result.exit_code == 1 and "no model of that name" in result.output


def test_a_model_collects_and_another_is_refused(dataset: Path, model: Path, tmp_path: Path) -> None:
    command = ("collect", dataset, "--policy", "learned", "--steps", 2, "--workers", 1)
    assert run(*command, "--model", model).exit_code == 0
    data = Dataset.open(dataset)
    assert data.info.collect is not None and data.info.collect.policy == "learned"
    assert data.info.collect.settings["chooser"]["model"]["name"] == "untrained"
    assert run("dataset", "verify", dataset).exit_code == 0
    other = tmp_path / "other"
    AffordanceModel(AffordanceInfo(), {kind: make_network(kind, "depth") for kind in KINDS}).save(other)
    result = run(*command, "--model", other)
    assert result.exit_code == 1 and "begun with other settings" in result.output
    for unused in (("--model", model), ("--set", "learned.explore=1")):
        result = run("collect", dataset, "--policy", "random", *unused)
        assert result.exit_code == 2 and "goes with --policy learned" in result.output
