"""Benchmark tables: what stands in a cell, and what a stopped table keeps."""

import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from benchmarks import changed_pixels, commands, interact_pages, plan_pages, table1, table2, table3
from benchmarks.commands import as_typed, told_rows, write_result
from benchmarks.pages import costs, put
from benchmarks.table2 import DETAILS, SCORES, across
from benchmarks.table2_page import page, table
from busybot.view.protocol import INTERACTION


def scores(**values: float | None) -> dict[str, Any]:
    told: dict[str, Any] = dict.fromkeys((*SCORES, *DETAILS), None)
    told["bounds"] = {"not_knowing": {"pred_a": 0.96, "pred_a_successful": 0.99}}
    return {**told, **values}


def result(*seeds: dict[str, Any]) -> dict[str, Any]:
    row = {"training": [], "splits": {"novel-config": {**across(list(seeds)), "seeds": list(seeds)}}}
    return {"machine": {"cores": 2}, "rows": {"event": row}}


def test_mean_and_extremes_over_seeds() -> None:
    told = across([scores(pred_a=0.9, edge_r=1.0), scores(pred_a=0.8, edge_r=None)])
    assert (told["mean"]["pred_a"], told["least"]["pred_a"], told["most"]["pred_a"]) == (pytest.approx(0.85), 0.8, 0.9)
    assert told["mean"]["edge_r"] is told["least"]["edge_r"] is None


def test_cells_of_table_2() -> None:
    lines = table(result(scores(pred_a=0.9, edge_p=1.0), scores(pred_a=0.8, edge_p=1.0))).splitlines()
    cells = {line.split(" | ")[0].strip("| "): line.strip("| ").split(" | ")[1:] for line in lines[2:]}
    assert cells["**`event`**"][:4] == ["missing"] * 4
    assert cells["**`event`**"][4:8] == ["100.0", "-", "85.0 (80.0 to 90.0)", "-"]
    assert cells["bound"][4:8] == ["", "", "96.0", "99.0"]
    assert cells["counting"] == ["missing"] * 12
    assert cells["*the paper: BusyBot*"][4:7] == ["95.5", "99.7", "73.8"]
    assert len({line.count("|") for line in lines}) == 1


def test_a_table_goes_into_its_place_alone() -> None:
    text = put("a\n<!-- t -->\nold\n<!-- end of t -->\nb", "t", "new")
    assert text == "a\n<!-- t -->\nnew\n<!-- end of t -->\nb" == put(text, "t", "new")
    assert page("<!-- table2 --><!-- end of table2 -->", result(scores())).count("\n") > 10


def test_only_uninterrupted_trainings_have_a_cost() -> None:
    assert costs([{"cost": None}], {"cores": 2}) == ""
    told = costs([{"cost": None}, {"cost": {"seconds": 600, "megabytes": 1500}}], {"cores": 2})
    assert "model: 10 minutes" in told and "1.5 GB" in told and "(1 of 2 trainings" in told
    told = costs([{"cost": {"seconds": seconds, "megabytes": 1500}} for seconds in (600, 1200)], {"cores": 2})
    assert "model: 10 to 20 minutes" in told and "(2 of 2 trainings" in told


def test_what_is_judged_is_not_judged_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, ...]] = []

    def answer(*arguments: str) -> dict[str, Any]:
        asked.append(arguments)
        return scores(pred_a=0.5)

    monkeypatch.setattr(table2, "busybot", answer)
    (tmp_path / "data" / "novel-object").mkdir(parents=True)
    out = tmp_path / "table2.json"
    monkeypatch.setattr(
        "sys.argv",
        ["table2", "--data", f"{tmp_path}/data", "--work", f"{tmp_path}/work", "--out", str(out), "--rows", "lookup"],
    )
    table2.main()
    table2.main()
    assert len(asked) == 1 and asked[0][:2] == ("eval", "reason")
    row = json.loads(out.read_text())["rows"]["lookup"]
    assert row["splits"]["novel-object"]["mean"]["pred_a"] == 0.5
    assert row["commands"] == ["busybot eval reason DATA/novel-object --model lookup --decoders DATA/train"]
    assert told_rows(out)["lookup"] == row and told_rows(tmp_path / "none.json") == {}


def test_commands_are_told_without_this_machines_places(tmp_path: Path) -> None:
    assert as_typed(("eval", f"{tmp_path}/x"), {str(tmp_path): "DATA"}) == "busybot eval DATA/x"
    made = ("train", "--assets", "procedural", "--config", "benchmarks/procedural.yaml")
    assert as_typed(made, {"procedural": "ASSETS"}) == "busybot " + " ".join(made)
    write_result(tmp_path / "r.json", {"rows": {}})
    assert [path.name for path in tmp_path.iterdir()] == ["r.json"]


def timing(mean: float | None, least: float = 0.0) -> dict[str, Any]:
    told = None if mean is None else 2 * mean
    return {"cpu_ms": mean, "cpu_ms_p95": told, "cpu_ms_without_model": None if mean is None else mean - least}


def test_decision_times_are_compared_with_the_gate() -> None:
    fast, slow = timing(9.0, 4.0), timing(50.1)
    agents = {
        "search": {"one-to-one": fast, "one-to-many": fast},
        "random": {"one-to-one": fast, "one-to-many": slow},
        "noop": {"one-to-one": timing(None), "one-to-many": fast},
    }
    lines = plan_pages.times({"gate_ms": 50.0, "decisions": agents}).splitlines()
    assert lines[2].endswith("| 9.0 (95 %: 18.0; model 4.0) | 9.0 (95 %: 18.0; model 4.0) | yes |")
    assert lines[3].startswith("| random") and lines[3].endswith("| no |")
    assert lines[4].startswith("| doing nothing | - | ") and len(lines) == 5


def test_planning_with_what_ships_has_its_own_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, ...]] = []

    def answer(*arguments: str) -> dict[str, Any]:
        asked.append(arguments)
        row = dict.fromkeys(table3.DETAILS) | {"success": 0.5 + len(asked) / 100}
        return {"agents": {"search": row, "bc": row}, "timing": {"search": {}, "bc": {}}}

    monkeypatch.setattr(table3, "busybot", answer)
    monkeypatch.setattr("sys.argv", ["plan", "--work", f"{tmp_path}/w", "--out", f"{tmp_path}/o", "--boards", "2"])
    *_, result = table3.measured(table3.parsed("", policy_model="procedural", reasoner=["event"]))
    assert len(asked) == 3 * 6 and "--boards 2" in result["commands"][0]
    assert "--model event --policy-model procedural" in result["commands"][2], "what ships is told by its name"
    assert "WORK/judged-novel-object-one-to-one-0" in result["commands"][2]
    lines = plan_pages.procedural({"agents": result["rows"]}).splitlines()
    assert lines[2] == "| **search over learned effects** | 65.0 | 68.0 | 59.0 | 62.0 | 53.0 | 56.0 |"
    assert lines[3].startswith("| behaviour cloning") and len(lines) == 4
    text = "<!-- plan-procedural -->\n<!-- end of plan-procedural -->"
    assert plan_pages.page(text, {"agents": result["rows"]}).splitlines()[1:-1] == lines


def test_what_the_papers_interaction_networks_cost() -> None:
    network = {
        "parameters": 2_100_000,
        "batch": 16,
        "iterations": 50,
        "seconds_median": 9.04,
        "cpu_seconds_median": 8.5,
    }
    hours = {"training": 15.2, "collecting": 3.9, "both": 19.1}
    result = {
        "machine": {"processor": "P", "threads": 1},
        "networks": {"position": network},
        "extrapolated": {"epochs": 400, "iterations": {"position": 2960}, "hours": hours, "cpu_hours": hours},
    }
    text = interact_pages.page("<!-- paper-interact --><!-- end of paper-interact -->", result)
    assert "| position | 2.1 million | 16 | 50 | 9.0 | 8.5 | 2960 |" in text
    assert (
        "(P, 1 thread) the 400 epochs take 19 hours, of CPU 19: 15 for training and at least 4 for collecting." in text
    )


def test_the_policys_constants_are_told_beside_their_defaults() -> None:
    keys = ("precision", "recall", "precision_exploring")
    judged = {**dict.fromkeys(keys, 0.9), "intervals": {"precision": [0.88, 0.92], "recall": None, keys[2]: [0.8, 1.0]}}
    result = {
        "held_out": {},
        "default_strict": {"explore": 0.35},
        "rows": {"before": judged, "explore=0.2": judged},
        "default": {"explore": 0.25},
        "free": {"explore=0.35": {"novel-object": judged, "novel-config": {**judged, "recall": 0.8}}},
    }
    text = interact_pages.page("<!-- policy-constants --><!-- end of policy-constants -->", result)
    assert "| *before* | | | 90.0 ± 2.0 | 90.0 ± 0.0 | 90.0 ± 10.0 |" in text
    assert "| `explore` | 0.35 | 0.2 | 90.0 ± 2.0 |" in text
    held_out, known = "90.0 ± 2.0 | 90.0 ± 0.0", "90.0 ± 2.0 | 80.0 ± 0.0"
    assert f"| `explore` | 0.25 | 0.35 | {held_out} | {known} | missing | missing |" in text


def test_moves_with_and_without_responders_beside_each_other() -> None:
    both, alone = (
        changed_pixels.summary(pd.DataFrame({"trigger": ["a", "a", "b"], "changed_pixels": pixels}))
        for pixels in ([900, 1200, 700], [90, 700, 50])
    )
    assert alone["exceeding"]["500"] == {"share_of_moves": 0.3333, "ever": ["a"], "mostly": []}
    splits = {name: {"with": both, "without": alone} for name in interact_pages.SPLITS}
    text = interact_pages.page("<!-- changed-pixels --><!-- end of changed-pixels -->", {"splits": splits})
    assert "| training objects, with responders | 700 | 900 | 1200 | 100.0 % | 100.0 % | 33.3 % |" in text
    assert "| novel objects, 2 switches | 1 (1) | 1 (0) | 0 (0) |" in text
    assert "Above 500, training objects: a.\n" in text and "Above 1000" not in text


def test_rows_of_table_1_are_what_commands_tell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, ...]] = []

    def answer(*arguments: str) -> dict[str, Any]:
        asked.append(arguments)
        if "responders=false" in arguments:
            raise RuntimeError("round 0: no recorded action succeeded, so there is nothing to learn")
        if arguments[0] == "train":
            return {"training": {"seed": 1}}
        keys = dict.fromkeys((*table1.KEYS, "dataset", "versions"), 0.5)
        policy = {"explore": 0.25, "after_failure": [[0.0]]}
        return keys | {"provenance": {"policy": policy, "model": {"sha256": {"a": "b"}}}}

    for module in (table1, commands):
        monkeypatch.setattr(module, "busybot", answer)
    (tmp_path / "w").mkdir()
    out, rows = tmp_path / "table1.json", "free-1,greedy,without-responders-1000"
    monkeypatch.setattr("sys.argv", ["t", "--work", f"{tmp_path}/w", "--out", str(out), "--rows", rows])
    table1.main()
    told = json.loads(out.read_text())["rows"]
    assert list(told) == rows.split(",") and told["without-responders-1000"]["untrained"]
    assert told["free-1"]["policy"] == {"model_sha256": {"a": "b"}, "constants": {"explore": 0.25}}
    assert told["free-1"]["training"]["cost"].keys() == {"seconds", "megabytes"} and not told["greedy"]["training"]
    assert (
        told["greedy"]["commands"][1]
        == "busybot eval interact WORK/judge-303-novel-config --model WORK/free-1 --mode greedy"
    )
    trained = [command for command in asked if command[0] == "train"]
    assert len(trained) == 2 and "--seed" in trained[0] and trained[0][trained[0].index("--seed") + 1] == "1"
    assert "paper" in table1.ROWS and {row.name for row in INTERACTION.rows} == set(table1.ROWS)
