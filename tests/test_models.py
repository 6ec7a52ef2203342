"""Trained models as files, and the commands about them."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from typer.testing import CliRunner, Result

from busybot.cli.main import app
from busybot.common.errors import BusybotError
from busybot.interact.affordance.load import load_model
from busybot.models import describe_model, find, models_below, shipped_models, verify
from busybot.plan.learning.network import PolicyInfo, PolicyNetwork, read_policy
from busybot.reason.models.event.config import EventConfig, EventNetConfig
from busybot.reason.models.event.networks import EventNet
from busybot.reason.models.registry import ReasonerInfo, load_reasoner
from busybot.training.checkpoint import save_model
from busybot.training.device import threads
from tests.reason.boards import make_boards

CONFIG = EventConfig(net=EventNetConfig(width=8, heads=2))
TRAINING = {"seed": 3, "data": [{"name": "d", "assets": "procedural", "seed": 1, "episodes": 4, "content_hash": "ab"}]}


def run(*words: str) -> Result:
    return CliRunner().invoke(app, words)


LOADED = """
import sys
import torch
from busybot.interact.affordance.load import load_model
from busybot.interact.affordance.networks import make_paper_network
from busybot.plan.learning.config import BcConfig
from busybot.plan.learning.network import PolicyNetwork
from busybot.reason.models.paper.config import PaperReasonConfig
from busybot.reason.models.paper.networks import network_of
from busybot.reason.models.registry import load_reasoner

load_model("procedural"), load_reasoner("event"), load_reasoner("mechanism")
with torch.device("meta"):
    make_paper_network("position", "depth", (120, 160)), make_paper_network("direction", "depth", (120, 160))
    network_of(PaperReasonConfig())
    PolicyNetwork(BcConfig().net), PolicyNetwork(BcConfig().net.model_copy(update={"memory": "attention"}))
print("loaded", *(name for name in ("torch._dynamo", "sympy") if name in sys.modules))
"""


def test_loading_models_does_not_load_a_compiler() -> None:
    """It would take two seconds in every process."""
    done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["loaded"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    info = ReasonerInfo(model="event", encoder="random", config=CONFIG.model_dump(mode="json"), training=TRAINING)
    save_model(tmp_path / "out" / "model", info, EventNet(CONFIG.net, 2.5).state_dict())
    return tmp_path / "out" / "model"


@pytest.mark.parametrize("skill", ["interact", "reason", "plan"])
def test_loading_and_asking_a_model_changes_nothing_in_the_process(
    skill: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("BUSYBOT_CACHE", str(tmp_path / "cache"))

    def state() -> list[object]:
        handlers = [signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)]
        flags = (torch.get_default_dtype(), torch.are_deterministic_algorithms_enabled(), torch.is_grad_enabled())
        return [torch.get_num_threads(), dict(os.environ), torch.get_rng_state().tolist(), handlers, flags]

    info = PolicyInfo(agent="bc", encoder="embedded")
    save_model(tmp_path / "bc", info, PolicyNetwork(info.net).state_dict())
    with threads(2):
        before = state()
        if skill == "interact":
            load_model("procedural")
        elif skill == "plan":
            read_policy(tmp_path / "bc", "bc")
        else:
            reasoner, seen = load_reasoner("event"), make_boards(1)[0].seen
            reasoner.graph(seen)
            reasoner.predict(seen, seen.features[:1], seen.actions[:1], seen.acted[:1])
        assert state() == before
    assert not (tmp_path / "cache").exists()


def test_policies_that_plan_are_models_like_others(tmp_path: Path) -> None:
    folder = tmp_path / "bc" / "model"
    info = PolicyInfo(agent="bc", encoder="embedded", training={"seed": 5})
    save_model(folder, info, PolicyNetwork(info.net).state_dict())
    told = describe_model(find(str(folder.parent)))
    assert (told.skill, told.kind, told.seed, list(told.hashes)) == ("plan", "bc", 5, ["weights.safetensors"])
    assert verify(folder).ok
    with (folder / "weights.safetensors").open("r+b") as file:
        file.seek(-4, 2)
        file.write(b"\1\2\3\4")
    assert ["its SHA-256 is" in problem for problem in verify(folder).problems] == [True]


def test_all_shipped_models_are_whole() -> None:
    done = run("models", "verify", "--json")
    told = json.loads(done.stdout)
    assert done.exit_code == 0 and told["ok"]
    assert [model["name"] for model in told["models"]] == [path.name for path in shipped_models()]
    assert all(model["hashes"] for model in told["models"])


def test_every_shipped_model_has_a_card_a_licence_and_its_data() -> None:
    models = json.loads(run("models", "list", "--json").stdout)["models"]
    assert "procedural" in [model["name"] for model in models]
    for model in models:
        assert model["card"] and model["licence"] == "MIT" and model["seed"] is not None
        assert all(len(entry["content_hash"]) == 64 for entry in model["data"]) and model["data"]


def test_what_is_told_of_a_model_of_ones_own(folder: Path) -> None:
    told = describe_model(find(str(folder.parent)))
    assert (told.skill, told.kind, told.seed, told.licence, told.shipped) == ("reason", "event", 3, None, False)
    assert told.parameters == sum(value.numel() for value in EventNet(CONFIG.net).state_dict().values())
    assert told.bytes == sum(path.stat().st_size for path in folder.iterdir())
    printed = run("models", "info", str(folder)).stdout
    assert "licence: not recorded" in printed
    assert "4 boards of procedural objects, seed 1, content hash ab" in printed
    assert models_below(folder.parent) == [folder]


def test_rounds_that_are_told_together_are_one_line(folder: Path) -> None:
    card = json.loads((folder / "model.json").read_text())
    card["training"] |= {"data": [], "rounds": {"epochs": 3, "boards": 12, "content_sha256": "cd" * 32}}
    (folder / "model.json").write_text(json.dumps(card))
    assert f"trained on: 12 boards, content hash {'cd' * 32}" in run("models", "info", str(folder)).stdout


def test_saving_records_hashes_for_both_skills(folder: Path, tmp_path: Path) -> None:
    load_model("procedural").save(tmp_path / "copy")
    for model in (folder, tmp_path / "copy"):
        assert verify(model).ok and verify(model).hashes


def test_other_weights_of_the_same_network_are_found_out(folder: Path) -> None:
    other = folder.parent / "other"
    info = ReasonerInfo(model="event", encoder="random", config=CONFIG.model_dump(mode="json"))
    save_model(other, info, EventNet(CONFIG.net, 3.5).state_dict())
    shutil.copy(other / "weights.safetensors", folder / "weights.safetensors")
    done = run("models", "verify", str(folder))
    assert done.exit_code == 1
    assert "weights.safetensors: its SHA-256 is" in done.stderr and "hint: " in done.stderr


def test_an_older_folder_without_hashes_is_loaded_all_the_same(folder: Path) -> None:
    card = json.loads((folder / "model.json").read_text())
    del card["files"]
    (folder / "model.json").write_text(json.dumps(card))
    done = run("models", "verify", str(folder))
    assert done.exit_code == 0 and "no hashes recorded" in done.stdout
    assert "no hashes recorded" in run("models", "info", str(folder)).stdout


@pytest.mark.parametrize("damage", ["truncated", "missing", "stranger"])
def test_files_that_are_not_those_that_were_saved(folder: Path, damage: str) -> None:
    weights = folder / "weights.safetensors"
    if damage == "truncated":
        weights.write_bytes(weights.read_bytes()[:100])
    elif damage == "missing":
        weights.unlink()
    else:
        shutil.copy(weights, folder / "more.safetensors")
    verdict = verify(folder)
    assert len(verdict.problems) == 1 and ".safetensors: " in verdict.problems[0]
    assert verdict.loads == (damage == "stranger")


def test_weights_of_another_network_are_refused(folder: Path) -> None:
    info = ReasonerInfo(model="event", encoder="random", config=CONFIG.model_dump(mode="json"))
    save_model(folder, info, EventNet(EventNetConfig(width=16, heads=2)).state_dict())
    assert "not the weights of this network" in verify(folder).problems[0]


def test_a_card_cannot_lead_out_of_its_folder(folder: Path) -> None:
    card = json.loads((folder / "model.json").read_text())
    card["files"]["../../secret"] = "0" * 64
    (folder / "model.json").write_text(json.dumps(card))
    with pytest.raises(BusybotError, match=r"model\.json: files\.\.\./\.\./secret"):
        verify(folder)


def test_what_is_no_model_is_told_by_name(tmp_path: Path) -> None:
    (tmp_path / "model.json").write_text('{"surprise": 1}')
    with pytest.raises(BusybotError, match="not a model's card"):
        describe_model(tmp_path)
    (tmp_path / "empty").mkdir()
    assert run("models", "list", str(tmp_path / "empty")).exit_code == 1
    done = run("models", "info", "nonesuch", "--json")
    assert done.exit_code == 1 and "nonesuch: no model of that name" in json.loads(done.stdout)["error"]
    assert all(name in json.loads(done.stdout)["hint"] for name in ("event", "procedural"))
