"""Model folders of reasoning: what was saved is what is loaded, and whatever is wrong with one is told by name."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.reason.models.event.config import EventConfig, EventNetConfig
from busybot.reason.models.event.networks import EventNet, EventReasoner
from busybot.reason.models.registry import ReasonerInfo, load_reasoner, usual_reasoner
from busybot.training.checkpoint import save_model
from tests.reason.boards import make_boards

CONFIG = EventConfig(net=EventNetConfig(width=8, heads=2))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    network = EventNet(CONFIG.net, 2.5)
    info = ReasonerInfo(model="event", encoder="random", config=CONFIG.model_dump(mode="json"), training={"seed": 3})
    save_model(tmp_path / "model", info, network.state_dict())
    return tmp_path


def test_a_loaded_model_is_the_saved_one(folder: Path) -> None:
    reasoner = load_reasoner(folder)
    assert isinstance(reasoner, EventReasoner)
    assert (reasoner.name, reasoner.encoder, float(reasoner.network.scale)) == ("event", "random", 2.5)
    again = load_reasoner(folder / "model")
    seen = make_boards(1)[0].seen
    np.testing.assert_array_equal(reasoner.graph(seen).probabilities, again.graph(seen).probabilities)


def test_a_model_that_does_not_exist() -> None:
    with pytest.raises(BusybotError, match="nowhere: no model of that name(.|\n)*busybot train reason"):
        load_reasoner("nowhere")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model": "clever"}, r"model\.json: model: "),
        ({"format": "2"}, r"model\.json: format: "),
        ({"config": {"net": {"width": 0}}}, r"model\.json: config\.net\.width: "),
        ({"config": {"net": {"width": 16}}}, r"weights\.safetensors: not the weights of this network"),
        ({"surprise": 1}, r"model\.json: surprise: "),
    ],
)
def test_descriptions_that_cannot_be(folder: Path, change: dict[str, object], message: str) -> None:
    file = folder / "model" / "model.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **change}))
    with pytest.raises(BusybotError, match=message):
        load_reasoner(folder)


@pytest.mark.parametrize("damage", [b"", b"no tensors", None])
def test_weights_that_are_damaged_or_absent(folder: Path, damage: bytes | None) -> None:
    file = folder / "model" / "weights.safetensors"
    file.unlink() if damage is None else file.write_bytes(damage)
    with pytest.raises(BusybotError, match=r"weights\.safetensors"):
        load_reasoner(folder)


def test_a_description_that_is_no_json(folder: Path) -> None:
    (folder / "model" / "model.json").write_text("{")
    with pytest.raises(BusybotError, match="not valid JSON"):
        load_reasoner(folder)


@pytest.mark.parametrize(
    ("config", "expected"),
    [
        ({"world": "gates"}, "mechanism"),
        ({"world": "toggle"}, "mechanism"),
        ({"world": "paper"}, "event"),
        ({"world": "kitchen"}, "event"),
        ({}, "event"),
    ],
)
def test_the_usual_reasoner_knows_the_mechanisms_of_the_boards(config: dict[str, str], expected: str) -> None:
    info = SimpleNamespace(generator=SimpleNamespace(config=config))
    assert usual_reasoner(cast(Dataset, SimpleNamespace(info=info))) == expected
    assert load_reasoner(expected).name == expected
