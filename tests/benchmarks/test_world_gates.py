"""The gates of worlds: judged on the frozen boards, and told which are missed."""

import json
from argparse import Namespace
from pathlib import Path
from typing import Any

import pytest

from benchmarks.tables import world_gates
from busybot.common.errors import BusybotError, UsageError
from busybot.datasets.dataset import Dataset
from busybot.evaluation.results import read_result
from tools import gate_tables


def row(**changes: Any) -> dict[str, Any]:
    """What reaches every gate."""
    point = {"parent_f1": 0.97, "parent_f1_bound": 0.98, "link_parent_f1": 0.95, "link_parent_f1_bound": 0.98}
    return {
        "model": {}, "policy": {},
        "boards": 2, "after": {number: point for number in ("10", "22", "30")}, "what_if": 0.95, "rewirings": 0,
        "uncertain": [{"images": 4, "ece_uncertain": 0.05}, {"images": 8, "ece_uncertain": None}],
        "pred_a": 0.7, "rewired_found": None, "mechanism_accuracy": 0.85, "mechanism_bound": 0.9,
        "mechanism_accuracy_met": 0.88, "mechanism_bound_met": 0.89,
        "parent_p": 0.96, "parent_r": 0.99, "rewired_placed": None, "rewired_false_alarms": 0.1,
    } | changes  # fmt: skip


def tables(monkeypatch: pytest.MonkeyPatch, world: str, name: str, *seeds: dict[str, Any]) -> list[list[list[str]]]:
    """The lines of both tables, without their heads, as cells."""
    rows = {world: {name: {f"seed-{number}": one for number, one in enumerate(seeds)}}}
    monkeypatch.setattr(gate_tables, "result", lambda file: {"rows": rows if file == "world-gates" else {}})
    return [_lines(table()) for table in (gate_tables.world_gates, gate_tables.gate_figures)]


def _lines(table: str) -> list[list[str]]:
    """The cells of a table's lines, without its head."""
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.strip().splitlines()[2:]]


def gates(monkeypatch: pytest.MonkeyPatch, world: str, name: str, *seeds: dict[str, Any]) -> dict[str, str]:
    """What was asked and what is there, by gate."""
    return {line[0].removeprefix(f"{world}: "): line[2] for line in tables(monkeypatch, world, name, *seeds)[0]}


def test_gates_are_told_with_what_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    late = row()["after"] | {"30": {**row()["after"]["30"], "link_parent_f1": 0.91}}
    assert gates(monkeypatch, "gates", "validation", row(after=late)) == {
        "F1 of links behind the bound, 10": "3.0 ✓", "F1 of links behind the bound, 22": "3.0 ✓",
        "F1 of links behind the bound, 30": "7.0 ✗", "mechanisms behind the bound": "5.0 ✓", "what if": "95.0 ✓",
        "calibration at its worst": "5.0 ✓",
    }  # fmt: skip
    told = gates(monkeypatch, "gates", "novel-mechanism", row(after=late, uncertain=[]))
    assert told == {
        "F1 of links behind the bound, 30, novel mechanisms": "7.0 ✓", "what if": "95.0 ✓",
        "calibration at its worst": "-",
    }  # fmt: skip
    told = gates(monkeypatch, "chance", "validation", row(parent_r=0.9))
    assert told["P of parents, 22"] == "96.0 ✓" and told["R of parents, 22"] == "90.0 ✗"
    told = gates(monkeypatch, "paper", "validation", row())
    assert [told[name] for name in ("P of parents, 22", "R of parents, 22", "Pred-A")] == ["96.0 ✗", "99.0 ✓", "70.0 ✗"]
    assert gates(monkeypatch, "chain", "validation", row())["F1 of parents, 22"] == "97.0 ✓"
    told = gates(monkeypatch, "rewired", "validation", row(rewirings=3, rewired_placed=0.5))
    assert told["rewirings found and placed"] == "50.0 ✗"
    told = gates(monkeypatch, "lock", "validation", row(uncertain=[{"images": 12, "ece_uncertain": 0.1}]))
    assert told == {"what if": "95.0 ✓", "calibration at its worst": "10.0 ✗"}


def test_of_several_seeds_the_mean_and_the_worst_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    worse = row(mechanism_accuracy=0.75, what_if=0.85, rewirings=3, rewired_found=0.9, rewired_placed=0.7)
    better = row(rewirings=3, rewired_found=1.0, rewired_placed=0.8)
    asked, figures = tables(monkeypatch, "time", "validation", worse, better)
    assert asked[3:5] == [
        ["time: mechanisms behind the bound", "at most 8", "10.0 (15.0) 1 of 2"],
        ["time: what if", "at least 90", "90.0 (85.0) 1 of 2"],
    ]
    assert figures == [
        ["time, validation", "2", "2", "96 / 99", "95 / 95 [95-95] / 95 (98 / 98 / 98)", "80 [75-85] (90)", "88 (89)",
         "90", "70", "-10", "95 / 75", "0.10", "5 (4)"]
    ]  # fmt: skip


def test_at_a_glance_it_is_told_how_many_gates_hold_of_each_policy(monkeypatch: pytest.MonkeyPatch) -> None:
    late = row(after=row()["after"] | {"10": {**row()["after"]["10"], "link_parent_f1": 0.93}}, what_if=0.8)
    files = {
        "world-gates": {
            "gates": {"novel-object": {"a": row(), "b": late}, "novel-mechanism": {"a": late, "b": late}},
            "chain": {"novel-config": {"a": row(), "b": row()}},
        },
        "curious-gates": {"gates": {"novel-object": {"a": row(), "b": row()}}},
    }
    monkeypatch.setattr(gate_tables, "result", lambda name: {"rows": files.get(name, {})})
    assert _lines(gate_tables.gates_glance()) == [
        ["gates: new objects, learned", "5 of 6", "", "✓", "1 of 2", "", "✓"],
        ["gates: new objects, curious", "✓", "", "✓", "✓", "", "✓"],
        ["gates: new kinds, learned", "✓", "", "", "✗", "", "✓"],
    ]


def test_what_is_missed_is_told_with_how_much_and_why(monkeypatch: pytest.MonkeyPatch) -> None:
    why = {"parents": 3, "otherwise": 1}
    late = row(after=row()["after"] | {"10": {**row()["after"]["10"], "link_parent_f1": 0.93}}, what_if=0.8)
    worse = late | {"what_if": 0.7, "what_if_missed_because": why}
    files = {
        "world-gates": {
            "gates": {"novel-object": {"a": row(), "b": late}, "novel-mechanism": {"a": worse, "b": worse}},
            "chain": {"novel-config": {"a": row(), "b": row()}, "validation": {"a": worse, "b": worse}},
        },
        "curious-gates": {"gates": {"novel-object": {"a": row(), "b": worse}}},
    }
    monkeypatch.setattr(gate_tables, "result", lambda name: {"rows": files.get(name, {})})
    assert gate_tables.gates_missed().splitlines()[0].split(" | ")[1:5] == [
        "new configurations, learned", "new objects, learned", "new objects, curious", "new kinds, learned",
    ]  # fmt: skip
    assert _lines(gate_tables.gates_missed()) == [
        ["gates: parents", "", "1.0 1 of 2", "1.0 1 of 2", "", ""],
        ["gates: what if", "", "10.0 1 of 2", "20.0 1 of 2", "20.0 (20.0) ✗", ""],
    ]
    files["world-gates"]["gates"]["novel-object"]["b"] |= {"what_if_missed_because": why}
    files["world-gates"]["gates"]["novel-object"]["a"] |= {"what_if_missed_because": why}
    files["curious-gates"]["gates"]["novel-object"]["a"] |= {"what_if_missed_because": why}
    assert _lines(gate_tables.gates_missed())[1][-1] == "parents 75, else 25"


def test_beliefs_are_told_after_each_number_of_images_with_the_pairs_that_they_are_about(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def seed(error: float | None, pairs: int) -> dict[str, Any]:
        return row(
            uncertain=[
                {"images": 4, "ece_uncertain": 0.05, "uncertain_pairs": 2000},
                {"images": 8, "ece_uncertain": error, "uncertain_pairs": pairs},
                {"images": 12, "ece_uncertain": None, "uncertain_pairs": 9},
            ]
        )

    files = {"world-gates": {"gates": {"novel-object": {"a": seed(0.04, 700), "b": seed(None, 400)}}}}
    monkeypatch.setattr(gate_tables, "result", lambda name: {"rows": files.get(name, {})})
    head, _, line = gate_tables.calibration().strip().splitlines()
    assert head == "| points: mean (worst) of pairs | 4 images | 8 images | 12 images |"
    assert line == "| gates, novel-object | 5.0 (5.0) of 2,000 | - of 400 | - of 9 |"


def test_chance_may_be_in_figures_as_far_as_the_widest_of_the_seeds_intervals(monkeypatch: pytest.MonkeyPatch) -> None:
    def seed(low: float, kinds: list[float] | None, missed: int) -> dict[str, Any]:
        ends = {"parent_f1": [low, 0.99], "mechanism_accuracy": [low - 0.1, 0.9]}
        over = {"boards": ends, "objects": ends, "mechanisms": {"parent_f1": None, "mechanism_accuracy": kinds}}
        reasons = {"not asked": 0, "parents": missed, "never met": 1, "otherwise": 0}
        return row(
            cause_intervals=over, mechanism_missed_because=reasons, shd=1.5, shd_bound=1.25, kind_accuracy=0.8,
            kind_bound=0.9, lag_accuracy=None, lag_bound=None, pred_a_successful=0.75,
        )  # fmt: skip

    def told(*seeds: dict[str, Any]) -> list[str]:
        rows = {"gates": {"novel-object": {str(number): one for number, one in enumerate(seeds)}}}
        monkeypatch.setattr(gate_tables, "result", lambda name: {"rows": rows if name == "world-gates" else {}})
        return [cell.strip() for cell in gate_tables.gate_intervals().strip().splitlines()[2].strip("|").split("|")]

    assert told(seed(0.95, [0.6, 0.8], 3), seed(0.92, [0.7, 0.9], 4)) == [
        "gates, novel-object", "97 (92-99 / 92-99)", "85 (82-90 / 82-90 / 60-90)",
        "not asked 0, parents 78, never met 22, else 0", "1.50 (1.25)", "80 (90)", "- (-)", "75",
    ]  # fmt: skip
    assert told(seed(0.95, None, 0))[2] == "85 (85-90 / 85-90 / -)", "what has no interval over kinds"


def test_of_a_hundred_that_are_missed_it_is_told_why(monkeypatch: pytest.MonkeyPatch) -> None:
    def seed(missed: int) -> dict[str, Any]:
        questions = {"luck": 1, "parents": missed, "otherwise": 0}
        changes = {"not determined": 0, "otherwise": 1}
        return row(
            what_if_bound=0.97, what_if_missed_because=questions, rewired_placed=0.5, rewired_placed_bound=1.0,
            rewired_missed_because=changes,
        )  # fmt: skip

    calm = {**seed(0), "rewired_placed": None, "rewired_placed_bound": None}
    older = {**seed(1), "what_if_missed_because": None, "rewired_missed_because": None}
    rows = {
        "rewired": {"validation": {"a": seed(3), "b": seed(5)}, "novel-object": {"a": older}},
        "gates": {"validation": {"a": calm}},
    }
    monkeypatch.setattr(gate_tables, "result", lambda name: {"rows": rows if name == "world-gates" else {}})
    told = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in gate_tables.gate_reasons().splitlines()[2:]
    ]
    assert told == [
        ["rewired, validation", "95 (97)", "luck 20, parents 80, else 0", "50 (100)", "not determined 0, else 100"],
        ["gates, validation", "95 (97)", "luck 100, parents 0, else 0", "-", "-"],
    ]


def test_other_recordings_of_the_same_models_stand_beside_those_of_one_policy(monkeypatch: pytest.MonkeyPatch) -> None:
    def seed(weights: str, policy: str, what_if: float) -> dict[str, Any]:
        reasons = {"what_if_bound": 1.0, "what_if_missed_because": {"luck": 1}, "rewired_placed_bound": None}
        told = {"model": {"weights.safetensors": weights}, "policy": {"weights.safetensors": policy}}
        return row(**told, **reasons, what_if=what_if)

    def rows(policies: str, *answered: float) -> dict[str, Any]:
        seeds = {
            name: seed(name, policy, what_if) for name, policy, what_if in zip("ab", policies, answered, strict=True)
        }
        return {"rows": {"mixed": {"novel-config": seeds}}}

    files = {
        "world-gates": rows("pp", 0.8, 0.9),
        "pipeline-gates": rows("pq", 0.7, 0.9),
        "curious-gates": rows("pp", 0.9, 1.0),
    }
    monkeypatch.setattr(gate_tables, "result", lambda name: files.get(name, {"rows": {}}))
    own, shared = (
        [cell.strip() for cell in line.strip("|").split("|")] for line in gate_tables.pipeline_gates().splitlines()[2:]
    )
    assert (own[0], own[1], own[5]) == ("mixed, novel-config", "2", "80 [70-90]")
    assert (shared[0], shared[1], shared[5]) == ("mixed, novel-config: one policy for all", "1", "85 [80-90]")
    assert "| mixed: what if | at least 90 | 95.0 (90.0) ✓ |" in gate_tables.curious_gates()
    files["curious-gates"]["rows"]["mixed"]["novel-config"]["b"] = seed("c", "p", 1.0)
    files["pipeline-gates"]["rows"]["mixed"]["novel-config"]["b"] = seed("c", "p", 1.0)
    for table in (gate_tables.curious_gates, gate_tables.pipeline_gates):
        with pytest.raises(BusybotError, match="the models? (is not that of all sets|are not those of world-gates)"):
            table()


def test_sets_stand_beside_each_other_if_the_same_models_were_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    def files(of_test_sets: str) -> dict[str, Any]:
        model = {"README.md": "later", "weights.safetensors": of_test_sets}
        test = {"lock": {"novel-config": {"a": row(model=model, what_if=0.8)}}}
        model = {"README.md": "earlier", "weights.safetensors": "1"}
        validation = {world: {"validation": {"a": row(model=model)}} for world in ("lock", "mixed")}
        new_kinds = {"lock": {"novel-mechanism": {"a": row(model=model, what_if=0.7)}}}
        told = {"validation-gates": validation, "world-gates": test, "new-kinds-gates": new_kinds}
        return {name: {"rows": rows} for name, rows in told.items()}

    monkeypatch.setattr(gate_tables, "result", files("1").get)
    told = [[cell.strip() for cell in line.strip("|").split("|")] for line in gate_tables.world_gates().splitlines()]
    assert told[0] == ["percent, or points", "asked", "validation", "novel-config", "novel-mechanism"]
    assert ["lock: what if", "at least 90", "95.0 ✓", "80.0 ✗", "70.0 ✗"] in told
    assert ["mixed: what if", "at least 90", "95.0 ✓", "", ""] in told
    monkeypatch.setattr(gate_tables, "result", files("2").get)
    with pytest.raises(BusybotError, match="the model is not that of all sets"):
        gate_tables.world_gates()


@pytest.mark.parametrize(
    ("own", "other", "told"),
    [
        (13, 10, "13 to 10: 1.30 ✗"),
        (12, 10, "12 to 10: 1.20 ✓"),
        (20, 41, "20 to over 40: at most 0.49 ✓"),
        (41, 20, "over 40 to 20: at least 2.05 ✗"),
        (41, 40, "over 40 to 40: -"),
        (41, 41, "over 40 to over 40: -"),
    ],
)
def test_who_did_not_come_there_needs_more_than_there_were(own: int, other: int, told: str) -> None:
    assert gate_tables._times(own, other, 40, 1.25) == told


def test_gates_of_acting_planning_and_a_real_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    """One world, two seeds: what is reached, what is not, and what nobody knows."""
    choice = {"until": 10, "f1": [0.5] * 40, "stops": {"boards": 4, "wrong": 1}}
    plans = {"success": 0.95, "steps_over_shortest": None}
    seeds = {"a": row(parent_p=0.98, pred_a=0.9), "b": row(parent_p=0.96, pred_a=0.9)}
    files: dict[str, Any] = {
        "curiosity": {"gates": {part: {who: choice for who in ("curious", "greedy", "random")} for part in
                                ("drawn", "greedy")}},
        "curiosity-stops": {"gates": {"stopping": {"curious": choice}}},
        "curiosity-recorded": {
            "gates": {"recorded": {"curious": {**choice, "cpu_ms": 120.0}, "learned": {**choice, "until": 41}}}
        },
        **{name: {world: {"agents": {"mechanism": plans}} for world in ("gates", "time", "chain")}
           for name in ("world-plans", "world-plans-curious")},
        **{name: {locks: {"agents": {"mechanism": plans}, **more} for locks in ("lock-1-to-4", "lock-5-to-8")}
           for name, more in (("lock-plans", {"by_unmoved": {"0": {"tasks": 3, "mechanism": 1.0}}}),
                              ("lock-plans-curious", {}), ("lock-plans-longer", {}))},
        **{name: {world: {"novel-object": seeds} for world in ("paper", "mixed")}
           for name in gate_tables.BEFORE_A_CAMERA},
    }  # fmt: skip
    recorded = {"lock-plans-curious": {"history": "curious"}, "lock-plans-longer": {"history": "curious", "steps": 60}}
    monkeypatch.setattr(gate_tables, "result", lambda name: {"rows": files[name], **recorded.get(name, {})})
    lines = [line.strip("|").split("|") for line in gate_tables.further_gates().strip().splitlines()[2:]]
    told = {line[0].strip(): line[2].strip() for line in lines}
    assert told["gates, states told: actions until 95, to those of random choice"] == "10 to 10: 1.00 ✗"
    drawn = "gates, pictures: actions until 95, to those of a draw among known links"
    assert told[drawn] == "10 to over 40: at most 0.24 ✓"
    assert told["said to know and wrong, of what was said in 1 worlds, states told"] == "2 of 8 (3-65) ✗"
    assert told["CPU-ms of a curious action, pictures, simulation and all, the dearer of `gates` and `time`"] == "120 ✓"
    assert (
        told["time, scripted histories: goals reached"] == "95.0 ✓"
        and told["time, curious histories: steps over the shortest plan"] == "-"
    )
    assert told["lock, depth 5 to 8, curious histories: goals reached"] == "95.0 ✓"
    assert told["lock, depth 5 to 8, curious histories of 60 actions: goals reached"] == "95.0 ✓"
    late = {"until": 12, "f1": [0.5] * 40, "stops": {"boards": 5, "wrong": 0}}
    files["curiosity"]["gates"] |= {
        "seeds": {
            "a": {"drawn": {"curious": choice, "random": {**choice, "until": 20}}},
            "b": {"drawn": {"curious": late, "random": choice}},
        }
    }
    others = {"a": {"success": 0.75, "steps_over_shortest": 1.5}, "b": {"success": 1.0, "steps_over_shortest": 1.25}}
    files["world-plans"]["gates"] |= {"seeds": others}
    told = {line.split("|")[1].strip(): line.split("|")[3].strip() for line in gate_tables.further_gates().splitlines()}
    assert told["gates, scripted histories: goals reached"] == "90.0 (75.0) 2 of 3"
    assert told["gates, scripted histories: steps over the shortest plan"] == "1.38 (1.50) 1 of 3"
    random = "gates, states told: actions until 95, to those of random choice"
    assert told[random] == "10 to 10: 1.00 ✗; 1 of 3 seeds"
    assert told["gates, states told: actions until 95, to those of greedy choice"] == "10 to 10: 1.00 ✓"
    said = "said to know and wrong, of what was said in 1 worlds, states told"
    assert told[said] == "2 of 8 (3-65); other seeds 1 of 9 (0-48) ✗"
    of_seen = "95.0 (100.0 of the 3 whose links had all moved) ✓"
    assert told["lock, depth 1 to 4, scripted histories: goals reached"] == of_seen
    assert told["paper, a real camera, novel-object, 2 boards: P"] == "97.0 (96.0) 1 of 2"
    assert told["mixed, a real camera, novel-object, 2 boards: F1 of links behind the bound, 30"] == "3.0 (3.0) ✓"
    assert told["paper, a real camera, curious policy, novel-object, 2 boards: Pred-A"] == "90.0 (90.0) ✓"


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


def test_models_of_one_name_are_refused(tmp_path: Path) -> None:
    words = ["--work", str(tmp_path), "--models", "one/model,other/model", "--out", str(tmp_path / "gates.json")]
    with pytest.raises(UsageError, match="two models have one name"):
        world_gates.main(words)
    assert not list(tmp_path.iterdir())


def test_one_policy_acts_for_all_models_or_each_for_its_own() -> None:
    told = Namespace(models="one,other", policy="p")
    assert world_gates.models_by_policy(told) == {"p": ["one", "other"]}
    assert world_gates.models_by_policy(Namespace(models="one", policy=None)) == {None: ["one"]}
    told.policy = "p,q"
    assert world_gates.models_by_policy(told) == {"p": ["one"], "q": ["other"]}
    for policies in ("p,q,r", "p,p"):
        told.policy = policies
        with pytest.raises(UsageError, match=r"[23] policies for 2 models"):
            world_gates.models_by_policy(told)


@pytest.mark.long
def test_each_model_is_judged_on_what_its_own_policy_records(tmp_path: Path) -> None:
    out, other = tmp_path / "gates.json", Path("benchmarks/models/mechanism-1")
    words = ["--work", str(tmp_path / "work"), "--only", "gates", "--boards", "1", "--no-what-if", "--out", str(out)]
    policies = ",".join(f"benchmarks/models/lean-free-{seed}" for seed in (0, 1))
    world_gates.main([*words, "--models", f"mechanism,{other}", "--policy", policies])
    first, second = read_result(out, "world-gates")["rows"]["gates"]["validation"].values()
    assert first["policy"] != second["policy"] and first["model"] != second["model"]
    assert len(list((tmp_path / "work").glob("*/gates/validation"))) == 2


@pytest.mark.long
def test_before_another_camera_boards_are_recorded_anew(tmp_path: Path) -> None:
    out = tmp_path / "gates.json"
    words = ["--work", str(tmp_path / "work"), "--only", "gates", "--boards", "1", "--out", str(out)]
    world_gates.main([*words, "--camera", "real", "--no-what-if"])
    told = read_result(out, "world-gates")
    one = told["rows"]["gates"]["validation"]["mechanism"]
    assert told["camera"] == "real" and one["boards"] == 1 and one["what_if"] is None
    [recorded] = (tmp_path / "work").glob("*-real/gates/validation")
    collect = Dataset.open(recorded).info.collect
    assert collect is not None and collect.settings["render"]["camera"]["noise"] > 0


@pytest.mark.long
def test_the_model_that_ships_chooses_where_it_is_curious(tmp_path: Path) -> None:
    out = tmp_path / "gates.json"
    words = ["--work", str(tmp_path / "work"), "--only", "gates", "--boards", "1", "--no-what-if", "--out", str(out)]
    world_gates.main([*words, "--curious"])
    told = read_result(out, "world-gates")
    [recorded] = (tmp_path / "work").glob("*/gates/validation")
    collect = Dataset.open(recorded).info.collect
    assert collect is not None and collect.policy == "curious" and told["curious"]["weights.safetensors"]
    with pytest.raises(UsageError, match="acted on by another policy"):
        world_gates.main(words)
    out.write_text(json.dumps({**json.loads(out.read_text()), "curious": None, "assets": "partnet-mobility"}))
    with pytest.raises(UsageError, match="or made of other objects"):
        world_gates.main(words)


@pytest.mark.long
def test_other_boards_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(world_gates, "SEED", 1)
    with pytest.raises(BusybotError, match="gates/validation: not the frozen boards"):
        options = Namespace(work=tmp_path, assets="procedural", boards=1, camera="clean", curious=False)
        world_gates.recorded("gates", "validation", None, options)
