"""The gates of worlds: judged on the frozen boards, and told which are missed."""

import json
from argparse import Namespace
from pathlib import Path
from typing import Any

import pytest

from benchmarks.tables import world_gates
from busybot.common.errors import BusybotError
from busybot.evaluation.results import read_result
from tools import world_tables


def row(**changes: Any) -> dict[str, Any]:
    """What reaches every gate."""
    point = {"parent_f1": 0.97, "parent_f1_bound": 0.98, "link_parent_f1": 0.95, "link_parent_f1_bound": 0.98}
    return {
        "boards": 2, "after": {number: point for number in ("10", "22", "30")}, "what_if": 0.95, "rewirings": 0,
        "uncertain": [{"images": 4, "ece_uncertain": 0.05}, {"images": 8, "ece_uncertain": None}],
        "pred_a": 0.7, "rewired_found": None, "mechanism_accuracy": 0.85, "mechanism_bound": 0.9,
        "mechanism_accuracy_met": 0.88, "mechanism_bound_met": 0.89,
        "parent_p": 0.96, "parent_r": 0.99, "rewired_placed": None,
    } | changes  # fmt: skip


def told_of(monkeypatch: pytest.MonkeyPatch, world: str, name: str = "validation", **changes: Any) -> list[str]:
    """The cells of its line in the table."""
    return told_of_seeds(monkeypatch, world, name, row(**changes))


def told_of_seeds(monkeypatch: pytest.MonkeyPatch, world: str, name: str, *seeds: dict[str, Any]) -> list[str]:
    rows = {world: {name: {f"seed-{number}": one for number, one in enumerate(seeds)}}}
    monkeypatch.setattr(world_tables, "result", lambda _: {"rows": rows})
    return [cell.strip() for cell in world_tables.world_gates().splitlines()[-1].strip("|").split("|")]


def test_missed_gates_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    assert told_of(monkeypatch, "gates") == [
        "gates, validation", "2", "1", "96 / 99", "95 / 95 / 95 (98 / 98 / 98)", "85 (90)", "88 (89)", "95", "70", "-",
        "5 (4)", "none",
    ]  # fmt: skip
    assert told_of(monkeypatch, "time", mechanism_accuracy=0.8, what_if=0.8)[-1] == "mechanism, what if"
    assert told_of(monkeypatch, "chance", parent_r=0.9)[-1] == "P, R"
    late = row()["after"] | {"30": {**row()["after"]["30"], "link_parent_f1": 0.91}}
    assert told_of(monkeypatch, "gates", after=late)[-1] == "F1 after 30"
    assert told_of(monkeypatch, "gates", "novel-mechanism", after=late)[-1] == "none", "they may be .08 behind"
    assert told_of(monkeypatch, "rewired", rewirings=3, rewired_placed=0.5)[-1] == "found and placed"
    assert told_of(monkeypatch, "lock", uncertain=[{"images": 12, "ece_uncertain": 0.1}])[-1] == "calibration"


def test_several_seeds_are_one_line_with_their_mean_and_range(monkeypatch: pytest.MonkeyPatch) -> None:
    worse = row(mechanism_accuracy=0.75, what_if=0.85, rewirings=3, rewired_found=0.9, rewired_placed=0.7)
    better = row(rewirings=3, rewired_found=1.0, rewired_placed=0.8)
    told = told_of_seeds(monkeypatch, "gates", "validation", worse, better)
    assert told[2] == "2" and told[5] == "80 [75-85] (90)" and told[7] == "90" and told[9] == "95 / 75"
    assert told[-1] == "mechanism (1), what if (1)"


@pytest.mark.long
def test_two_frozen_boards_are_judged_once(tmp_path: Path) -> None:
    out = tmp_path / "gates.json"
    words = ["--work", str(tmp_path / "work"), "--only", "gates", "--boards", "2", "--out", str(out)]
    world_gates.main(words)
    told = read_result(out, "world-gates")["rows"]["gates"]["validation"]["mechanism"]
    assert told["boards"] == 2 and list(told["after"]) == ["10", "22", "30"] and told["model"]
    [evaluation] = (tmp_path / "work").glob("*/gates-validation-2-*.json")
    values = json.loads(evaluation.read_text())
    evaluation.write_text(json.dumps({**values, "what_if": 0.123}))
    world_gates.main(words)
    assert read_result(out, "world-gates")["rows"]["gates"]["validation"]["mechanism"]["what_if"] == 0.123


@pytest.mark.long
def test_other_boards_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(world_gates, "SEED", 1)
    with pytest.raises(BusybotError, match="gates/validation: not the frozen boards"):
        world_gates.recorded(
            "gates", "validation", Namespace(work=tmp_path, policy=None, assets="procedural", boards=1)
        )
