"""The report: what is missed is named, what is missing is shown, and nothing from a file becomes markup."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from busybot.cli.main import app
from busybot.common.errors import BusybotError
from busybot.evaluation.reference_tables import INTERACTION, PLANNING, REASONING, TABLES
from busybot.view.report.gates import judge
from busybot.view.report.report import Report, Shown, write_report
from busybot.view.report.results import Score, read_results

RESULTS = Path(__file__).resolve().parents[3] / "benchmarks" / "results"
TABLE1 = RESULTS / "table1.json"
GATES = 4 * sum(row.gate is not None for row in INTERACTION.rows) + 12 + 6
"""Of all three tables."""
DATASET = {"name": "d", "split": "novel-config", "boards": 3, "board_hash": "ab" * 32}


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Report:
    """The report of the committed Table 1."""
    return write_report([TABLE1], tmp_path_factory.mktemp("report"))


def below_a_gate(folder: Path) -> Path:
    """The committed Table 1 with one number below its gate, whatever its own numbers reach."""
    table = json.loads(TABLE1.read_text())
    table["rows"]["free-1"]["novel-object"]["precision"] = 0.5
    return write(folder / "table1.json", table)


def reasoned(**values: Any) -> dict[str, Any]:
    """As `busybot eval reason` tells it."""
    scores = {"edge_p": 1.0, "edge_r": 0.985, "edge_r_bound": 0.988, "pred_a": 0.9, "pred_a_bound": 0.915}
    told = {"boards": 3, "intervals": {"precision": [1.0, 1.0]}, "dataset": DATASET, "model": "event", "seed": 4}
    curve = [{"images": n, "edge_p": 1.0, "edge_r": 0.4 * n, "edge_r_bound": 0.4 * n} for n in (1, 2)]
    by_images = [one | {"pred_a": None, "pred_a_bound": None} for one in curve]
    return {
        "kind": "reason",
        **scores,
        "pred_a_successful": 0.95,
        "ece": 0.01,
        "brier": 0.02,
        "calibration": {"ece": 0.01, "ece_uncertain": 0.031, "brier": 0.02, "pairs": 900, "pairs_uncertain": 640},
        "by_images": by_images,
        **told,
        **values,
    }


def table2(*seeds: dict[str, Any]) -> dict[str, Any]:
    keys = tuple(REASONING.keys)
    values = {key: [seed[key] for seed in seeds] for key in keys}
    across = {
        "mean": {key: sum(several) / len(several) for key, several in values.items()},
        "least": {key: min(several) for key, several in values.items()},
        "most": {key: max(several) for key, several in values.items()},
    }
    training = [{"seed": n, "cost": {"seconds": 90, "megabytes": 500}} for n in range(len(seeds))]
    row = {
        "commands": ["busybot x"],
        "training": training,
        "splits": {"novel-config": {**across, "seeds": list(seeds)}},
    }
    return {"kind": "table2", "assets": "made", "machine": {"cores": 2}, "rows": {"event": row}}


def write(path: Path, value: Any) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value))
    return path


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.skill)
def test_every_number_of_the_protocol_has_its_column(table: Any) -> None:
    for values in (*table.paper.values(), *table.gates.values(), *table.aims.values()):
        assert len(values) == len(table.columns())
        assert all(value is None or 0 <= value <= 100 for value in values)
    assert all(row.paper is None or row.paper in table.paper for row in table.rows)
    assert all(row.gate is None or row.gate in table.gates for row in table.rows)
    assert len({row.name for row in table.rows}) == len(table.rows)
    assert any(row.gate for row in table.rows) and any(row.role == "trivial" for row in table.rows)


def test_numbers_of_the_paper_stand_in_the_right_columns() -> None:
    assert INTERACTION.at(INTERACTION.paper["BusyBot"], "novel-object", "recall") == 84.8
    assert REASONING.at(REASONING.paper["without exploration"], "novel-config", "edge_r") == 3.1
    assert REASONING.at(REASONING.paper["BusyBot"], "novel-object", "pred_a") == 31.0
    assert PLANNING.at(PLANNING.paper["Relation"], "train", "one-to-many") == 61.1
    assert PLANNING.at(PLANNING.gates["search"], "novel-object", "one-to-many") == 92


@pytest.mark.parametrize("as_committed", [True, False])
def test_table_1_with_its_missed_gates(first: Report, tmp_path: Path, as_committed: bool) -> None:
    file = TABLE1 if as_committed else below_a_gate(tmp_path)
    done = first if as_committed else write_report([file], tmp_path / "report")
    text, page = done.markdown.read_text(), done.html.read_text()
    rows = json.loads(file.read_text())["rows"]
    named = text.split("## Gates that are missed")[1].split("\n## ")[0]
    for row in (row for row in INTERACTION.rows if row.gate and row.name in rows):
        for split, words in INTERACTION.splits.items():
            for key in ("precision", "recall"):
                gate, share = INTERACTION.at(INTERACTION.gates[row.gate or ""], split, key), rows[row.name][split][key]
                place = f"| Table 1, {row.words}, {words}: {key} | {100 * share:.1f} "
                assert gate is not None
                assert (place in named) == (100 * share < gate), place
    assert as_committed or f"{INTERACTION.splits['novel-object']}: precision | 50.0 " in named
    for row in INTERACTION.rows:
        line = next(line for line in text.splitlines() if line.startswith(f"| {row.words} |"))
        assert ("missing" in line) == (row.name not in rows)
    assert done.count(True) + done.count(False) + done.count(None) == len(done.verdicts) == GATES
    for name in rows:
        for split in INTERACTION.splits if "untrained" not in rows[name] else ():
            assert rows[name][split]["dataset"]["board_hash"][:16] in page
    assert "without responders, threshold 1000 (no recorded action succeeded)" in text
    assert "**Missing**: none of its rows was given" in text


@pytest.mark.long
def test_a_trial_says_so_on_top_has_pictures_first_and_can_be_sent_around(tmp_path: Path) -> None:
    table = json.loads(TABLE1.read_text()) | {"profile": "smoke"}
    given, noise = tmp_path / "given", np.random.default_rng(0)
    write(given / "table1.json", table)
    for number in range(3):
        Image.fromarray(noise.integers(0, 256, (700, 1200, 3), np.uint8)).save(given / f"{number}.png")
    done = write_report([given], tmp_path / "report")
    for text in (done.markdown.read_text(), done.html.read_text()):
        assert 0 < text.index("These numbers mean nothing") < (12_000 if "<style>" in text else 200)
        places = [text.index(words) for words in ("mean nothing", "Pictures", "Numbers", "A gate is", "Table 1: ")]
        assert places == sorted(places) and "least value that a number must have" in text
    assert 200_000 < done.html.stat().st_size <= 2_000_000 and done.html.read_text().count("data:image/jpeg") == 3
    assert all(path.stat().st_size > 2_000_000 for path in done.figures if path.name.startswith("given"))
    del table["profile"]
    write(given / "table1.json", table)
    usual = write_report([given], tmp_path / "report")
    assert usual.html.stat().st_size > 6_000_000 and "mean nothing" not in usual.markdown.read_text()


def test_a_trial_refuses_pictures_that_are_none(tmp_path: Path) -> None:
    write(tmp_path / "given/table1.json", json.loads(TABLE1.read_text()) | {"profile": "smoke"})
    (tmp_path / "given/a.png").write_bytes(b"\x89PNG" + bytes(3_000_000))
    with pytest.raises(BusybotError, match=r"given-00\.png: not a picture that can be read"):
        write_report([tmp_path / "given"], tmp_path / "report")


def test_the_html_is_one_file_that_loads_nothing(first: Report) -> None:
    page = first.html.read_text()
    sources = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert sources and all(source.startswith(("data:image/", "#")) for source in sources)
    assert not re.search(r"url\(|@import|<script|<link", page)


def test_markdown_links_to_pictures_that_are_there(first: Report) -> None:
    text = first.markdown.read_text()
    links = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text)
    assert links and all((first.markdown.parent / link).stat().st_size > 10_000 for link in links)


def test_a_gate_is_for_the_worst_seed(tmp_path: Path) -> None:
    good = reasoned(pred_a=0.99, edge_r=1.0)
    file = write(tmp_path / "table2.json", table2(good, {**good, "pred_a": 0.5}, good))
    done = write_report([file], tmp_path / "out")
    missed = [(one.split, one.key, one.worst) for one in done.verdicts if one.reached is False]
    assert ("novel-config", "pred_a", 50.0) in missed and ("novel-config", "edge_r", 100.0) not in missed
    assert "82.7 (50.0 to 99.0) ✗" in done.markdown.read_text()


def test_what_the_recordings_do_not_determine_is_not_asked_for() -> None:
    row = next(row for row in REASONING.rows if row.gate)
    near = judge(REASONING, row, "novel-config", "edge_r", Score(98.5, bound=98.9))
    assert near is not None and near.reached and near.by_bound
    far = judge(REASONING, row, "novel-config", "edge_r", Score(98.3, bound=98.9))
    assert far is not None and far.reached is False
    other = judge(REASONING, row, "novel-config", "edge_p", Score(98.9, bound=98.9))
    assert other is not None and other.reached is False
    exact = judge(REASONING, row, "novel-config", "edge_p", Score(100 * 0.99))
    assert exact is not None and exact.reached and not exact.by_bound


def test_single_evaluations_and_pictures_of_a_folder(tmp_path: Path) -> None:
    write(tmp_path / "in" / "one.json", reasoned())
    write(tmp_path / "in" / "settings.json", {"something": "else"})
    (tmp_path / "in" / "a.png").write_bytes((RESULTS.parents[1] / "docs/images/viewer.png").read_bytes())
    done = write_report([tmp_path / "in"], tmp_path / "out")
    text = done.markdown.read_text()
    assert "### Reasoning: event on d (novel-config)" in text
    assert "| R | 98.5 |  | 98.8 | 99.7 | 99.0 |" in text
    assert len(read_results([tmp_path / "in"]).files) == 2
    assert [path.name for path in done.figures] == ["images.png", "given-00.png"]


def test_names_of_given_pictures_are_no_links(tmp_path: Path) -> None:
    write(tmp_path / "in" / "one.json", reasoned())
    (tmp_path / "in" / "`[x](#files)`.png").write_bytes((RESULTS.parents[1] / "docs/images/viewer.png").read_bytes())
    done = write_report([tmp_path / "in"], tmp_path / "out")
    assert "[x](#files)" not in done.markdown.read_text() and ">x</a>" not in done.html.read_text()


def test_evaluations_on_the_same_boards_are_compared_board_by_board(tmp_path: Path) -> None:
    def judged(model: str, part: list[int], **changes: Any) -> dict[str, Any]:
        counts = {"edge_p": {"part": part, "whole": [4] * len(part)}}
        return reasoned() | {"model": model, "dataset": DATASET | {"board_hash": "b"}, "by_board": counts} | changes

    write(tmp_path / "in" / "a.json", judged("event", [4] * 6))
    write(tmp_path / "in" / "b.json", judged("mine", [3] * 6))
    write(tmp_path / "in" / "c.json", judged("other boards", [1] * 6, dataset=DATASET | {"board_hash": "c"}))
    again = DATASET | {"board_hash": "b", "content_hash": "acted on by somebody else"}
    write(tmp_path / "in" / "e.json", judged("other recordings", [1] * 6, dataset=again))
    text = write_report([tmp_path / "in"], tmp_path / "out").markdown.read_text()
    told = text.split("### On the same boards")[1].split("##")[0]
    assert "| mine (`in/b.json`) | -25.0 (0.031) |" in told and "| against event (`in/a.json`), " in told
    assert "other boards" not in told and "other recordings" not in told
    file = write(tmp_path / "d.json", judged("mine", [3], by_board={"edge_p": {"part": [1, 2], "whole": [1]}}))
    with pytest.raises(BusybotError, match=r"d.json: by_board.edge_p.*other numbers of boards"):
        write_report([file], tmp_path / "broken")


def test_a_report_in_a_folder_of_results_does_not_show_its_own_pictures(tmp_path: Path) -> None:
    write(tmp_path / "one.json", reasoned())
    Image.new("RGB", (8, 8)).save(tmp_path / "curve.png")
    told = [write_report([tmp_path], tmp_path / "report").markdown.read_text() for _ in range(2)]
    assert told[0] == told[1] and told[0].count("given-") == 1


def planned(folder: Path, one_to_one: float, agents: tuple[str, ...] = ("search",), **about: Any) -> Path:
    """A file of Table 3 whose agents all reach as much on training objects."""
    rows = {agent: {"splits": {"train": {"one-to-one": {"success": one_to_one}}}} for agent in agents}
    return write(folder / "table3.json", {"kind": "table3", "rows": rows, **about})


def told_of(text: str, name: str) -> str:
    """The part of a page about a file of a table."""
    return text.split(f"\n### `{name}`\n")[1].split("\n### ")[0].split("\n## ")[0]


def without_files(done: Report) -> str:
    return done.markdown.read_text().split("## Files")[0]


def test_files_of_one_table_stand_apart_whatever_their_order(tmp_path: Path) -> None:
    paper = planned(tmp_path / "all", 0.995, ("search", "noop"), assets="partnet-mobility", machine={"cores": 64})
    laptop = planned(tmp_path / "all/laptop", 0.9, assets="procedural", profile="laptop", commands=["busybot x"])
    done = write_report([paper, laptop], tmp_path / "a")
    text = without_files(done)
    assert without_files(write_report([laptop, paper], tmp_path / "b")) == text
    assert without_files(write_report([tmp_path / "all"], tmp_path / "c")) == text
    first, second = told_of(text, "table3.json"), told_of(text, "laptop/table3.json")
    assert "| **search over learned effects** | 99.5 ✓ | missing" in first and "| doing nothing | 99.5 |" in first
    assert first.startswith("\nObjects: partnet-mobility.\n") and "cores 64" in first and "busybot x" not in first
    assert "| **search over learned effects** | 90.0 ✗ | missing" in second and "| doing nothing |" not in second
    assert second.startswith("\nObjects: procedural. Profile: laptop.\n") and "busybot x" in second
    assert "**Missing** in all of them: BusyBot: relations and prediction; " in text and "cores 64" not in second
    named = text.split("## Gates that are missed")[1].split("\n## ")[0]
    assert "search over learned effects**, `laptop/table3.json`, training objects: 1-1 | 90.0 ✗ | 99 " in named
    assert (
        "**Procedural objects** of `laptop/table3.json`: the gates" in named and "`table3.json`, training" not in named
    )
    assert [path.name for path in done.figures] == ["table3.png", "table3-1.png"]


def test_a_gate_that_one_file_misses_is_missed(tmp_path: Path) -> None:
    files = [planned(tmp_path / name, share) for name, share in (("a", 0.995), ("b", 0.9))]
    done = write_report(files, tmp_path / "out")
    assert (done.count(True), done.count(False), done.count(None)) == (0, 1, GATES - 1)
    assert "- **1** gates missed" in done.markdown.read_text() and "- **1 / 47** rows" in done.markdown.read_text()
    assert [one.file for one in done.verdicts if one.reached is not None] == ["a/table3.json", "b/table3.json"]


@pytest.mark.parametrize("first", ["trial", "real"])
def test_a_trial_among_other_results_warns_of_its_own_rows_alone(tmp_path: Path, first: str) -> None:
    trial = planned(tmp_path / "trial", 0.123, ("search", "bc"), assets="procedural", profile="smoke")
    real = planned(tmp_path / "real", 0.995, ("search", "noop"), assets="partnet-mobility")
    done = write_report(sorted([trial, real], key=lambda file: file.parent.name != first), tmp_path / "out")
    text = without_files(done)
    own, others = told_of(text, "trial/table3.json"), told_of(text, "real/table3.json")
    assert text.index("**Some numbers mean nothing**: those of `trial/table3.json`, ") < text.index(
        "A gate is the least"
    )
    assert "**These numbers mean nothing.**" in own and text.count("These numbers mean nothing") == 1
    assert "Objects: procedural. Profile: smoke." in own and "| **search over learned effects** | 12.3 | missing" in own
    assert "| **search over learned effects** | 99.5 ✓ | missing" in others and "12.3" not in others
    assert text.count("12.3") == 2, "with behaviour cloning in its own table and nowhere else"
    assert (done.count(True), done.count(False)) == (1, 0) and "Procedural objects" not in text
    assert "behaviour cloning" in text.split("Table 3, **missing**")[1].splitlines()[0]
    assert "mean nothing" in done.html.read_text() and [path.name for path in done.figures] == ["table3.png"]


def test_trials_beside_single_evaluations_do_not_speak_for_these(tmp_path: Path) -> None:
    trial, single = planned(tmp_path, 0.123, profile="smoke"), write(tmp_path / "one.json", reasoned())
    text = write_report([trial, single], tmp_path / "out").markdown.read_text()
    assert "**Some numbers mean nothing**: those of `table3.json`" in text and "| R | 98.5 |" in text
    assert text.split("## Table 3")[1].count("These numbers mean nothing") == 1 == text.count("These numbers mean")
    alone = write_report([trial], tmp_path / "alone").markdown.read_text()
    assert alone.index("**These numbers mean nothing.**") < 40 and "Some numbers" not in alone


def test_rows_that_a_table_does_not_know_are_named(tmp_path: Path) -> None:
    strange = planned(tmp_path / "b", 0.5, ("somebody",), assets="procedural")
    line = "Not shown, because this table has no such rows: `somebody` of `{}`."
    alone = write_report([strange], tmp_path / "alone").markdown.read_text()
    assert line.format("table3.json") in alone and "**Missing**: none of its rows was given" in alone
    text = write_report([planned(tmp_path / "a", 0.9), strange], tmp_path / "out").markdown.read_text()
    assert line.format("b/table3.json") in text and "\n### `" not in text and "Procedural objects" not in text


def test_several_files_of_anything_else_are_all_shown(tmp_path: Path) -> None:
    for name, share in (("a", 0.7), ("b", 0.2)):
        told = disturbed()
        told["rows"]["patch"][0]["models"]["event"] = {"edge_f1": share, "pred_a": share}
        write(tmp_path / name / "r.json", told)
        stages = {"data/train": {"seconds": 6000 * share, "done": True}}
        write(tmp_path / name / "stages.json", {"kind": "stages", "stages": stages})
    done = write_report([tmp_path / "a", tmp_path / "b"], tmp_path / "out")
    text = done.markdown.read_text()
    for name, share in (("a", "70.0"), ("b", "20.0")):
        assert f"| hidden, 10 % of frames | {share} | {share} | " in told_of(text, f"{name}/r.json")
        assert f"| `data` | 1 | {share} |" in told_of(text, f"{name}/stages.json")
    assert [path.name for path in done.figures] == ["robustness.png", "robustness-1.png"]


def test_a_row_of_two_files_is_told_apart_in_every_part(tmp_path: Path) -> None:
    for name, share in (("a", 0.9), ("b", 0.8)):
        write(tmp_path / name / "table2.json", table2(reasoned(pred_a=share)))
    text = write_report([tmp_path / "a", tmp_path / "b"], tmp_path / "out").markdown.read_text()
    for part in ("Calibration", "Cost"):
        told = text.split(f"## {part}\n")[1].split("\n## ")[0]
        assert "**`event`**, `a/table2.json` |" in told and "**`event`**, `b/table2.json` |" in told
    courses = read_results([tmp_path / "a", tmp_path / "b"]).rows()
    assert [run.file for run in courses if run.found] == ["a/table2.json", "b/table2.json"]


def test_the_name_of_a_file_is_no_markup(tmp_path: Path) -> None:
    evil = "`[x](#files)<b>"
    done = write_report([planned(tmp_path / evil, 0.9), planned(tmp_path / "b", 0.8)], tmp_path / "out")
    text, page = done.markdown.read_text(), done.html.read_text()
    assert "`[x] (#files)<b>/table3.json`" in text and "[x](#files)" not in text, "code ends where it is to end"
    assert ">x</a>" not in page and "<b>/table3" not in page


@pytest.mark.long
def test_planning_has_its_place(tmp_path: Path) -> None:
    kinds = {"one-to-one": {"success": 0.99, "interval": [0.98, 1.0]}, "one-to-many": {"success": 0.9}}
    file = write(tmp_path / "table3.json", {"kind": "table3", "rows": {"search": {"splits": {"train": kinds}}}})
    done = write_report([file], tmp_path / "out")
    text = done.markdown.read_text()
    assert "99.0 ± 1.0 ✓ | 90.0 ✗ | missing" in text and "- Table 3: **search over learned effects** (in part)" in text
    assert "Procedural objects" not in text
    told = json.loads(file.read_text()) | {"assets": "procedural"}
    assert "**Procedural objects**" in write_report([write(file, told)], tmp_path / "out").markdown.read_text()


def test_of_planning_too_a_gate_is_for_the_worst_seed(tmp_path: Path) -> None:
    kinds = {"one-to-one": {"success": 0.97, "seeds": [1.0, 0.99, 0.92], "interval": [0.99, 1.0]}}
    file = write(tmp_path / "table3.json", {"kind": "table3", "rows": {"search": {"splits": {"novel-config": kinds}}}})
    done = write_report([file], tmp_path / "out")
    assert "97.0 (92.0 to 100.0) ✗" in done.markdown.read_text()
    assert [one.worst for one in done.verdicts if one.reached is False] == [92.0]


def test_an_evaluation_of_planning_stands_beside_the_paper(tmp_path: Path) -> None:
    agents = {
        "search": {"success": 0.975, "interval": [0.95, 1.0], "solved": 0.9, "steps": 2.5},
        "mine": {"success": 1},
    }
    told = {"kind": "plan", "agents": agents, "kinds": {"one-to-many": 7}, "tasks": 7, "dataset": DATASET, "seed": 3}
    file = write(tmp_path / "planned" / "result.json", told)
    text = write_report([file], tmp_path / "out").markdown.read_text()
    assert "### Planning on d (novel-config)" in text
    assert "| **search over learned effects** | 97.5 | 95.0 to 100.0 | 90.0 | 2.5 | 69.4 | 95.0 |" in text
    assert "| mine | 100.0 |  | - | - |  |  |" in text


def test_calibration_is_of_what_is_doubted_and_of_enough_pairs(tmp_path: Path) -> None:
    one, few = reasoned(), reasoned()
    few["calibration"] = few["calibration"] | {"pairs_uncertain": 9}
    for told, shown in ((one, "0.0310 (640)"), (few, "- (9)")):
        done = write_report([write(tmp_path / "table2.json", table2(told))], tmp_path / shown[0])
        [line] = [row for row in done.markdown.read_text().splitlines() if shown in row]
        assert "**`event`**" in line and "0.0200" in line


def disturbed() -> dict[str, Any]:
    """As `benchmarks/reason_robustness.py` tells it."""
    models = {"event": {"edge_f1": 0.9, "pred_a": 0.7}, "count": {"edge_f1": 0.8, "pred_a": None}}
    row = {"boards": 3, "known": 0.95, "models": models}
    rows = {"undisturbed": [{"strength": 0.0, **row}], "patch": [{"strength": n / 10, **row} for n in (1, 2)]}
    what = {"patch": {"title": "hidden", "what": "a box is grey", "unit": "of frames"}}
    told = {"boards": 3, "models": {"event": {}}, "disturbances": what, "rows": rows}
    return {"kind": "reason-robustness", **told}


def test_robustness_is_drawn_and_told_or_missing(first: Report, tmp_path: Path) -> None:
    assert "## Robustness\n\n**Missing**" in first.markdown.read_text()
    done = write_report([write(tmp_path / "r.json", disturbed())], tmp_path / "out")
    text = done.markdown.read_text()
    assert "robustness.png" in [path.name for path in done.figures]
    assert "| hidden, 20 % of frames | 90.0 | 70.0 | " in text and "- hidden: a box is grey" in text
    assert "| undisturbed | 90.0 | 70.0 | " in text


def test_robustness_without_a_disturbance_has_numbers_and_no_picture(tmp_path: Path) -> None:
    """As of `reason_robustness --only png`."""
    told = disturbed()
    told["rows"] = {"undisturbed": told["rows"]["undisturbed"], "png": told["rows"]["undisturbed"]}
    done = write_report([write(tmp_path / "r.json", told)], tmp_path / "out")
    assert "robustness.png" not in [path.name for path in done.figures]
    assert "| png | 90.0 | 70.0 | " in done.markdown.read_text()


def test_a_split_that_is_no_word_is_shown_as_it_stands(tmp_path: Path) -> None:
    file = write(tmp_path / "one.json", reasoned(dataset={**DATASET, "split": ["a"]}))
    assert "on d (['a'])" in write_report([file], tmp_path / "out").markdown.read_text()


def test_what_the_stages_of_a_run_took(tmp_path: Path) -> None:
    took = {"data/train": 90, "data/train.features": 30, "data/novel-object": 60, "reason": 120}
    stages = {name: {"seconds": seconds, "done": name != "reason"} for name, seconds in took.items()}
    file = write(tmp_path / "stages.json", {"kind": "stages", "machine": {"cores": 2}, "stages": stages})
    text = write_report([file], tmp_path / "out").markdown.read_text()
    for line in ("| `data` | 2 | 2.5 |", "| `features` | 1 | 0.5 |", "| all | 4 | 5.0 |", "Not finished: reason."):
        assert line in text


def test_rows_without_a_gate_are_named_as_measured_or_missing(tmp_path: Path) -> None:
    one = {"one-to-one": {"success": 0.5}}
    full = {split: {**one, "one-to-many": {"success": 0.5}} for split in PLANNING.splits}
    rows = {"bc": {"splits": full}, "noop": {"splits": {"train": one}}}
    text = write_report(
        [write(tmp_path / "t.json", {"kind": "table3", "rows": rows})], tmp_path / "out"
    ).markdown.read_text()
    lines = {
        line.split(": ")[0]: line.split(": ", 1)[1] for line in text.splitlines() if line.startswith("- Table 3, ")
    }
    assert lines["- Table 3, measured"] == "behaviour cloning"
    assert lines["- Table 3, measured in part"] == "doing nothing"
    assert "PPO" in lines["- Table 3, **missing**"]


@pytest.mark.long
def test_figures_of_an_episode(tmp_path: Path, tiny: Path) -> None:
    done = write_report([TABLE1], tmp_path, Shown(tiny / "episodes" / "000003.mcap"))
    assert "refinement.png" in [path.name for path in done.figures]
    assert "**Missing**: what the policy believes" in done.markdown.read_text()


def test_nothing_from_a_file_becomes_markup(tmp_path: Path) -> None:
    evil = "<script>alert(1)</script> $\\frac{$"
    file = write(tmp_path / "one.json", reasoned(model=evil, dataset={**DATASET, "name": evil}, command=f"`{evil}"))
    assert "<script" not in write_report([file], tmp_path / "out").html.read_text()
    text = write_report([file], tmp_path / "out").markdown.read_text()
    assert "<script" not in re.sub(r"`[^`\n]*`", "", text), "nor in Markdown, but within code"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            {"kind": "table1", "rows": {"free-0": {"novel-config": {"dataset": {}, "precision": "high"}}}},
            r"bad\.json: novel-config\.precision: ",
        ),
        (
            {"kind": "table2", "rows": {"event": {"splits": {"train": {"mean": {}}}}}},
            r"bad\.json: splits\.train\.least: ",
        ),
        ({"rows": {"event": {}}}, r"bad\.json: it is no result, because it has no `kind`(.|\n)*busybot eval"),
        ({"kind": "table9"}, r"bad\.json: a result of the unknown kind 'table9'(.|\n)*table1"),
        ({"kind": "s3"}, r"bad\.json: a report does not show results of the kind s3(.|\n)*table1"),
        ([], r"bad\.json: it is no result"),
        (reasoned(intervals={"precision": [0.5]}), r"bad\.json: intervals\.precision\.1: "),
        (reasoned(by_images=[{"images": 2}]), r"bad\.json: by_images\.0\.edge_p: "),
        (reasoned(by_images=[{"images": 10**400}]), r"bad\.json: by_images\.0\.images: "),
        ({"kind": "table1", "machine": "mine"}, r"bad\.json: machine: "),
        (
            {"kind": "table3", "rows": {"bc": {"training": {"cost": {"seconds": "long"}}}}},
            r"bad\.json: training\.0\.cost\.seconds: ",
        ),
    ],
)
def test_files_that_are_no_results(tmp_path: Path, content: Any, message: str) -> None:
    file = write(tmp_path / "bad.json", content)
    with pytest.raises(BusybotError, match=message):
        write_report([file], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_folder_without_results(tmp_path: Path) -> None:
    with pytest.raises(BusybotError, match=r"no result lies there(.|\n)*busybot eval"):
        write_report([tmp_path], tmp_path / "out")
    write(tmp_path / "old.json", {"edge_p": 1.0, "dataset": {}})
    with pytest.raises(BusybotError, match=r"only 1 JSON files without a known `kind`"):
        write_report([tmp_path], tmp_path / "out")


@pytest.mark.long
def test_the_command(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["report", str(below_a_gate(tmp_path)), "--out", str(tmp_path / "r"), "--json"])
    told = json.loads(done.stdout)
    assert done.exit_code == 0 and Path(told["html"]).is_file()
    assert sum(told["gates"].values()) == GATES and told["gates"]["missed"] > 0
    assert CliRunner().invoke(app, ["report", str(tmp_path / "none.json"), "--out", str(tmp_path / "r")]).exit_code == 1


def folds(text: str) -> list[str]:
    return re.findall(r"<details><summary>Commands, seeds, hashes, versions</summary>(.*?)</details>", text, re.DOTALL)


@pytest.mark.long
def test_what_made_the_committed_tables_is_told(tmp_path: Path) -> None:
    files = [RESULTS / f"table{number}.json" for number in (1, 2, 3)]
    told = folds(write_report(files, tmp_path / "out").markdown.read_text())
    assert len(told) == 3
    for fold in told:
        assert "- `busybot " in fold and "- training: seed " in fold and "- made with busybot " in fold
        assert "None" not in fold and "not recorded" not in fold
    content = json.loads(files[1].read_text())["rows"]["event"]["training"][0]["training"]["data"][0]["content_hash"]
    assert content[:16] in told[1]
    for command in json.loads(files[2].read_text())["commands"]:
        assert told[2].count(f"- `{command}`\n") == 1


def test_a_training_of_the_papers_networks_tells_of_all_its_rounds_together(tmp_path: Path) -> None:
    rounds = {"epochs": 2, "content_sha256": "ab" * 32, "boards": 32, "steps": 320, "rewarded": 9}
    row = json.loads(TABLE1.read_text())["rows"]["free-0"]
    row["training"] = {"seed": 0, "rounds": rounds, "cost": {"seconds": 60}}
    file = write(tmp_path / "t.json", {"kind": "table1", "rows": {"paper": row}})
    text = write_report([file], tmp_path / "out").markdown.read_text()
    assert f"- training: seed 0, content of its data `{'ab' * 8}`\n" in text
    assert "| Table 1, the paper's networks | 1.0 | - |" in text


def test_rows_with_the_same_commands_name_them_once(tmp_path: Path) -> None:
    row = {"commands": ["busybot x"], "splits": {"train": {"one-to-one": {"success": 0.5}}}}
    file = write(tmp_path / "t.json", {"kind": "table3", "rows": {"noop": row, "bc": row}})
    (fold,) = folds(write_report([file], tmp_path / "out").markdown.read_text())
    assert fold.count("busybot x") == 1 and "- commands as for behaviour cloning" in fold


def test_without_a_table_single_evaluations_come_first(tmp_path: Path) -> None:
    text = write_report([write(tmp_path / "one.json", reasoned())], tmp_path / "out").markdown.read_text()
    assert text.index("## Single evaluations") < text.index("<details><summary>The paper") < text.index("## Table 1")
    assert text.index("## Table 3") < text.index("</details>") < text.index("## How scores grow")
    assert text.count("## Single evaluations") == 1
