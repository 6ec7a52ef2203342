"""Models that results are made with, `benchmarks/models`."""

import re
from pathlib import Path

import pytest

from busybot.interact.affordance.load import load_model
from busybot.reason.models.registry import load_reasoner
from busybot.training.model_cards import INFO_FILE

FOLDER = Path(__file__).parents[2] / "benchmarks" / "models"
MODELS = sorted(file.parent for file in FOLDER.glob(f"*/{INFO_FILE}"))


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_each_loads_by_its_folder(model: Path) -> None:
    acts = (model / "position.safetensors").exists()
    loaded = load_model(model) if acts else load_reasoner(str(model))
    assert loaded is not None


def test_the_page_lists_all_that_are_there_and_no_other() -> None:
    listed = re.findall(r"^\| `([\w-]+)` \|", (FOLDER / "README.md").read_text(), re.MULTILINE)
    assert listed == [model.name for model in MODELS]
