"""The shipped model's card says what was measured, and the model is the one that was judged."""

import json
from pathlib import Path

from busybot.interact.affordance.load import find_model, load_model
from busybot.interact.policy.policy_factory import DEFAULT_MODEL, policy_config
from busybot.training.model_cards import file_hashes

RESULT = Path(__file__).resolve().parents[2] / "benchmarks" / "results" / "interact-procedural.json"
ROW = json.loads(RESULT.read_text())["rows"]["shipped"]
KEYS = ("precision", "recall", "precision_exploring")
CARD = "README.md"


def test_the_card_has_the_results_numbers() -> None:
    card = (find_model(DEFAULT_MODEL) / CARD).read_text()
    for split in ("novel-config", "novel-object"):
        cells = " | ".join(f"{100 * ROW[split][key]:.1f}" for key in KEYS)
        assert f"| {split} | {cells} |" in card
    missed = sum(link["missed"] for link in ROW["novel-object"]["missed_links"].values())
    assert f"Of {missed} links" in card
    assert f"Of its {sum(ROW['novel-object']['failures_by_cause'].values())} failures" in card


def test_the_model_is_the_one_that_was_judged() -> None:
    hashes, judged = file_hashes(find_model(DEFAULT_MODEL)), ROW["policy"]["model_sha256"]
    assert {**judged, CARD: hashes[CARD]} == hashes, "but for the card, which has what came out"
    assert policy_config(load_model(DEFAULT_MODEL).info, {}).after_failure is not None


def test_it_is_small() -> None:
    assert sum(path.stat().st_size for path in find_model(DEFAULT_MODEL).iterdir()) < 5_000_000
