"""The shipped model's card says what was measured, and the model is the one that was judged."""

import json
from pathlib import Path

from busybot.interact.chooser import DEFAULT_MODEL
from busybot.interact.model import Model, find_model

RESULT = Path(__file__).resolve().parents[2] / "benchmarks" / "results" / "interact-procedural.json"
KEYS = ("precision", "recall", "precision_exploring")


def test_the_card_has_the_results_numbers() -> None:
    folder = find_model(DEFAULT_MODEL)
    card, row = (folder / "README.md").read_text(), json.loads(RESULT.read_text())["rows"]["free-0"]
    for split in ("novel-config", "novel-object"):
        cells = " | ".join(f"{100 * row[split][key]:.1f}" for key in KEYS)
        assert f"| {split} | {cells} |" in card
    assert row["training"]["rounds"] == Model.load(DEFAULT_MODEL).info.training["rounds"]


def test_it_is_small() -> None:
    assert sum(path.stat().st_size for path in find_model(DEFAULT_MODEL).iterdir()) < 5_000_000
