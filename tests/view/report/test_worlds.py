"""Other worlds in a report: rows of models, of graphs from files, of programs and planners; names of anybody."""

import json
from pathlib import Path
from typing import Any

import pytest

from busybot.common.errors import BusybotError
from busybot.view.report.report import write_report
from busybot.view.report.results import read_results

DATASET = {"name": "hard", "split": "novel-config", "boards": 3, "board_hash": "ab" * 32}
RESULTS = Path(__file__).resolve().parents[3] / "benchmarks" / "results"


def curve(**shares: float) -> list[dict[str, Any]]:
    """Objects of F1 `grows` times the number of actions, links half of it, after 1 to 30 actions."""
    grows = shares.get("grows", 0.03)
    found = []
    for n in range(1, 31):
        f1 = min(1.0, grows * n)
        point = {"actions": n, "boards": 3, "parent_p": 1.0, "parent_r": f1, "parent_f1": f1, "parent_f1_bound": 0.99}
        found.append(point | {"link_parent_f1": f1 / 2, "link_parent_p": 0.5, "link_parent_r": 0.5})
    return found


def reasoned(**values: Any) -> dict[str, Any]:
    """As `busybot eval reason` tells it."""
    told = {"kind": "reason", "world": "gates", "model": "mechanism", "boards": 3, "images": 23, "dataset": DATASET}
    shares = {"parent_p": 1.0, "parent_r": 0.66, "parent_f1": 0.7, "parent_f1_bound": 0.99, "mechanism_bound": 0.9}
    asked = {"mechanism_accuracy": 0.6, "pred_a": 0.75, "gap": 0.15, "what_if": 0.8, "uncertain_pairs": 314}
    return {**told, **shares, **asked, "ece_uncertain": None, "discovery": curve(), "seed": 0, **values}


def played(**values: Any) -> dict[str, Any]:
    """As `busybot play` tells it."""
    told = {"kind": "play", "world": "gates", "agent": "python agent.py", "boards": 4, "dataset": DATASET}
    shares = {"parent_p": 0.9, "parent_r": 0.8, "parent_f1": 0.85, "parent_f1_bound": 0.97, "link_parent_f1": 0.75}
    return {**told, **shares, "most_actions": 22, "wrong_early_stops": 0.25, "ends": {"knows": 3, "died": 1}, **values}


def planned(**values: Any) -> dict[str, Any]:
    """As `busybot eval plan` tells it."""
    agents = {
        "mechanism": {"success": 0.9, "interval": [0.8, 1.0], "solved": 0.5, "steps_over_shortest": 1.25},
        "oracle": {"success": 1.0, "interval": [1.0, 1.0], "solved": 1.0, "steps_over_shortest": 1.0},
    }
    locks = {"1": {"tasks": 2, "mechanism": 0.95, "oracle": 1.0}, "3": {"tasks": 1, "mechanism": 0.8, "oracle": 1.0}}
    told = {"kind": "plan", "world": "gates", "dataset": DATASET, "tasks": 3, "reasoner": "mechanism", "kinds": {}}
    return {**told, "agents": agents, "by_locks": locks, **values}


def report(folder: Path, **files: Any) -> str:
    for name, value in files.items():
        folder.mkdir(exist_ok=True)
        (folder / f"{name}.json").write_text(json.dumps(value))
    return write_report([folder], folder / "report").markdown.read_text()


def row(text: str, name: str, part: str) -> list[str]:
    """The cells of a row in the part under a heading."""
    lines = text.split(f"### {part}\n")[1].split("\n### ")[0].splitlines()
    return next(line for line in lines if line.startswith(f"| {name}")).split(" | ")[1:]


def test_a_model_stands_beside_what_its_recordings_determine(tmp_path: Path) -> None:
    text = report(tmp_path, a=reasoned())
    cells = row(text, "mechanism", "Relations")
    assert cells[:6] == ["3", "30.0", "66.0", "90.0", "100.0", "66.0"] and cells[6:9] == ["15.0", "33.0", "45.0"]
    assert row(text, "exact observer", "Relations")[1:4] == ["99.0"] * 3
    assert row(text, "mechanism", "Success and understanding")[:5] == ["75.0", "60.0", "+15.0", "80.0", "- (314)"]
    assert row(text, "exact observer", "Success and understanding")[1] == "90.0"
    assert (tmp_path / "report/figures/worlds.png").stat().st_size > 10_000
    assert "### Rewired" not in text and "### Planning" not in text and "### Regret" not in text


def test_rows_of_the_same_boards_stand_together_and_others_apart(tmp_path: Path) -> None:
    other = reasoned(model="count", dataset=DATASET | {"board_hash": "cd" * 32})
    text = report(tmp_path, a=reasoned(), b=reasoned(model="lookup"), c=other)
    sections = [line for line in text.split("### Success")[0].splitlines() if line.startswith("| *")]
    assert [("abababab" in line, "cdcdcdcd" in line) for line in sections] == [(True, False), (False, True)]
    names = [line.split(" | ")[0] for line in text.split("### Relations")[1].split("###")[0].splitlines()]
    assert names.index("| lookup") == names.index("| mechanism") + 1 and names.count("| exact observer") == 2


def test_a_graph_from_a_file_is_a_row_by_the_name_that_it_gives_itself(tmp_path: Path) -> None:
    """It tells nothing of earlier actions; a name is no markup, no formula, and no wider than a column."""
    name = "[x](https://x) <b>Team</b> $y$ | `z` _" + "w" * 100
    text = report(tmp_path, a=reasoned(), b=reasoned(model=name, given=True, discovery=[], pred_a=None, gap=None))
    line = next(line for line in text.splitlines() if "Team" in line)
    assert "(graphs from files)" in line and "<b>" not in line and "w" * 70 not in line and "](" not in line
    cells = [cell.strip() for cell in line.split(" | ")[-11:]]
    assert cells[:6] == ["3", "-", "70.0", "-", "100.0", "66.0"]
    page = (tmp_path / "report/report.html").read_text()
    assert "<b>Team" not in page and "&lt;b&gt;Team" in page and "https://x)" not in page.replace("] (https://x)", "")


def test_names_with_signs_of_formulas_are_drawn_as_they_stand(tmp_path: Path) -> None:
    assert report(tmp_path, a=reasoned(model="_$\\frac{"), b=reasoned(model="$$")) != ""


def test_programs_that_play_have_rows(tmp_path: Path) -> None:
    cells = row(report(tmp_path, a=played()), "python agent.py", "Played as text")
    assert cells[0] == "4" and cells[3] == "85.0 bound 97.0" and cells[9] == "25.0" and cells[-1] == "75.0 |"


def test_planning_stands_beside_what_its_reasoner_understood(tmp_path: Path) -> None:
    text = report(tmp_path, a=reasoned(), b=planned())
    assert row(text, "mechanism", "Planning in worlds") == ["90.0 ± 10.0", "50.0", "1.25", "60.0", "+30.0 |"]
    assert row(text, "oracle", "Planning in worlds")[3:] == ["-", "- |"], "it asks no reasoner"
    locks = text.split("locks that lie behind each other")[1]
    assert "| percent | 1 lock | 3 locks |" in locks and "| mechanism | 95.0 | 80.0 |" in locks
    alone = report(tmp_path / "alone", a=planned())
    assert row(alone, "mechanism", "Planning in worlds")[3:] == ["-", "- |"]


def test_understanding_is_taken_from_the_same_boards_if_it_was_measured_there(tmp_path: Path) -> None:
    elsewhere = reasoned(mechanism_accuracy=0.2, dataset=DATASET | {"board_hash": "cd" * 32})
    told = {"a": reasoned(), "b": elsewhere, "c": reasoned(world="time", mechanism_accuracy=0.9)}
    told["d"] = reasoned(boxes="proposed", mechanism_accuracy=0.1)  # agents are given boxes
    for name, value in told.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(value))
    worlds = read_results([tmp_path]).worlds
    assert worlds.understood("gates", "mechanism", "ab" * 32) == 0.6
    assert worlds.understood("gates", "mechanism", "ef" * 32) == pytest.approx(0.4), "other boards of this world"
    assert worlds.understood("lock", "mechanism", "ab" * 32) is None


def test_rewirings_are_shown_where_something_was_rewired(tmp_path: Path) -> None:
    told = {"rewirings": 12, "rewired_found": 0.5, "rewired_placed": 0.25, "rewired_false_alarms": 0.1}
    bound = {"rewired_found_bound": 1.0, "rewired_placed_bound": 0.75, "rewired_false_alarms_bound": 0.0}
    text = report(tmp_path, a=reasoned(**told, **bound))
    assert row(text, "mechanism", "Rewired") == ["12", "50.0", "25.0", "0.10 |"]
    assert row(text, "exact observer", "Rewired") == ["12", "100.0", "75.0", "0.00 |"]


def test_recordings_of_the_same_boards_are_told_apart(tmp_path: Path) -> None:
    def judged(model: str, content: str, policy: str, part: int, bound: float) -> dict[str, Any]:
        counts = {"parent_f1": {"part": [part] * 6, "whole": [4] * 6}}
        told = {"dataset": DATASET | {"content_hash": content}, "by_board": counts, "policy": policy}
        return reasoned(model=model, parent_f1_bound=bound, **told)

    files = {
        "a": judged("mechanism", "c1", "scripted", 4, 0.9),
        "b": judged("mechanism", "c2", "random", 1, 0.7),
        "c": judged("mine", "c1", "scripted", 3, 0.9),
    }
    report(tmp_path, **files)
    groups = read_results([tmp_path]).worlds.groups()
    assert [words.split("`abababab`, ")[1] for words in groups] == [
        "recorded by scripted, `c1`", "recorded by random, `c2`",
    ]  # fmt: skip
    assert [[row.name for row in rows] for rows in groups.values()] == [
        ["mechanism", "mine", "exact observer"], ["mechanism", "exact observer"],
    ]  # fmt: skip
    text = (tmp_path / "report" / "report.md").read_text()
    told = text.split("### On the same boards")[1].split("##")[0]
    assert "| mine" in told and "-25.0 (0.031)" in told and "`c2`" not in told


def test_the_papers_world_stays_in_its_tables(tmp_path: Path) -> None:
    shares = dict.fromkeys(
        ("edge_p", "edge_r", "edge_r_bound", "pred_a_successful", "pred_a_bound", "ece", "brier"), 0.9
    )
    paper = reasoned(world="paper", intervals={}, **shares)
    text = report(tmp_path, a=paper)
    assert "Worlds whose causes" not in text and "Reasoning: mechanism on hard" in text
    both = report(tmp_path / "both", a=paper, b=reasoned())
    assert both.index("Worlds whose causes") < both.index("Reasoning: mechanism on hard")


def test_committed_tables_and_regret_are_shown() -> None:
    results = read_results([RESULTS / "worlds.json", RESULTS / "curiosity.json"]).worlds
    rows = {row.name: row for row in results.groups()["gates: benchmarks.tables.worlds"]}
    table = json.loads((RESULTS / "worlds.json").read_text())["rows"]["gates"]["learned"]["mechanism"]
    assert rows["mechanism"].objects[22][2] == table["object"]["22"]["f1"]
    assert rows["exact observer, truth"].bound and not rows["count"].bound
    told = results.curiosity[str(RESULTS / "curiosity.json")].rows["gates"]["greedy"]
    assert len(told) == 4 and all(one.regret is not None for one in told.values())


def test_the_frozen_sets_and_plans_of_all_worlds_are_shown(tmp_path: Path) -> None:
    files = [RESULTS / "world-gates.json", RESULTS / "camera-gates.json", RESULTS / "world-plans.json"]
    groups = read_results(files).worlds.groups()
    told = json.loads(files[0].read_text())["rows"]["rewired"]["novel-object"]["mechanism-1"]
    rows = {one.name: one for one in groups["rewired: novel-object, frozen"]}
    assert rows["mechanism-1"].links[30][2] == told["after"]["30"]["link_parent_f1"]
    assert rows["mechanism-1"].objects[22] == (told["parent_p"], told["parent_r"], told["after"]["22"]["parent_f1"])
    assert rows["exact observer"].bound and len(rows) == 6 and "mixed: novel-config, frozen, camera real" in groups
    text = write_report(files, tmp_path / "report").markdown.read_text()
    known, worst = told["mechanism_accuracy"], max(told["uncertain"], key=lambda one: one["ece_uncertain"])
    of_set = text.split("### Success and understanding")[1].split("*rewired: novel-object, frozen*")[1]
    cells = next(line for line in of_set.splitlines() if line.startswith("| mechanism-1 |")).split(" | ")
    assert cells[2:4] == [f"{100 * known:.1f}", f"{100 * (told['pred_a'] - known):+.1f}"]
    assert cells[5] == f"{100 * worst['ece_uncertain']:.1f} ({worst['uncertain_pairs']})"
    plan = json.loads(files[2].read_text())["rows"]["time"]["agents"]["mechanism"]
    of_time = text.split("*time: 30 tasks, scripted histories*")[1]
    assert f"| mechanism | {100 * plan['success']:.1f} | {100 * plan['solved']:.1f} |" in of_time


def test_rows_of_one_set_in_two_files_are_told_apart(tmp_path: Path) -> None:
    for name, f1 in (("a", 0.5), ("b", 0.75)):
        gate = {"boards": 3, "after": {"22": {"parent_f1": f1, "link_parent_f1": f1}}}
        table = {"learned": {"mechanism": {"boards": 3, "object": {"22": {"f1": f1}}}}}
        (tmp_path / f"{name}-g.json").write_text(
            json.dumps({"kind": "world-gates", "rows": {"gates": {"novel-object": {"mechanism": gate}}}})
        )
        (tmp_path / f"{name}-t.json").write_text(json.dumps({"kind": "worlds", "rows": {"time": table}}))
    groups = read_results([tmp_path]).worlds.groups()
    sets = {"g": "gates: novel-object, frozen", "t": "time: benchmarks.tables.worlds"}
    for kind, words in sets.items():
        for name, f1 in (("a", 0.5), ("b", 0.75)):
            own = groups[f"{words}, `{name}-{kind}.json`"]
            assert [row.objects[22][2] for row in own if row.name == "mechanism"] == [f1]
    assert len(groups) == 4
    (tmp_path / "b-g.json").unlink()
    assert sets["g"] in read_results([tmp_path]).worlds.groups(), "one file needs no name"
    assert "mechanism" in report(tmp_path)


def test_regret_stands_with_the_actions_that_it_took(tmp_path: Path) -> None:
    done = write_report([RESULTS / "curiosity.json"], tmp_path / "report").markdown.read_text()
    told = json.loads((RESULTS / "curiosity.json").read_text())["rows"]["gates"]["greedy"]["curious"]
    assert f"{100 * told['regret']:.1f} ({told['until']:.0f})" in done.split("### Regret")[1]


@pytest.mark.parametrize(
    ("value", "place"),
    [
        ({"discovery": "none"}, "discovery"),
        ({"discovery": [{"actions": 10**400, "parent_f1": 0.5}]}, r"discovery\.0\.actions"),
        ({"rewirings": 1, "rewired_found_bound": "all"}, "rewired_found_bound"),
        ({"actions_until_found_bound": [1]}, "actions_until_found_bound"),
    ],
)
def test_a_damaged_result_is_named(value: dict[str, Any], place: str, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(json.dumps(reasoned(**value)))
    with pytest.raises(BusybotError, match=rf"a\.json: {place}: "):
        write_report([tmp_path], tmp_path / "out")


@pytest.mark.parametrize(
    ("value", "place"),
    [
        ({"kind": "worlds", "rows": {"x": []}}, "rows.x"),
        ({"kind": "worlds", "rows": [1]}, "rows"),
        ({"kind": "world-gates", "rows": {"x": [1]}}, "rows.x"),
    ],
)
def test_rows_of_another_shape_are_named(tmp_path: Path, value: dict[str, Any], place: str) -> None:
    (tmp_path / "a.json").write_text(json.dumps(value))
    with pytest.raises(BusybotError, match=rf"a\.json: {place}: "):
        read_results([tmp_path])


def test_numbers_of_actions_are_decimals_and_kinds_are_words(tmp_path: Path) -> None:
    point = {"parent_f1": 0.5, "link_parent_f1": 0.5}
    gate = {"boards": 3, "after": {"22": point, "\u00b2": point, "9" * 5000: point}}
    gates = {"kind": "world-gates", "rows": {"gates": {"novel-object": {"mechanism": gate}}}}
    told = report(tmp_path / "r", gates=gates, strange={"kind": ["worlds"]})
    assert "mechanism" in told
