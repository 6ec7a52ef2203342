"""Everything generated in the documentation is what its results, commands and schema make of it."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from benchmarks.studies import splits as split_study
from benchmarks.tables.table2 import SCORES
from busybot.common.errors import BusybotError
from busybot.training.model_cards import file_hashes
from tests.view.report.test_report import reasoned, table2
from tools import docs, gate_tables, prose, provenance, speed_tables, tables, world_tables

ROOT = Path(__file__).resolve().parents[2]


def rows_of(text: str) -> dict[str, list[str]]:
    """Cells of a table's rows by their first one."""
    lines = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    return {line[0]: line[1:] for line in lines}


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder in place of the committed results."""
    monkeypatch.setattr(tables, "RESULTS", tmp_path)
    return tmp_path


def put(folder: Path, name: str, kind: str, **figures: Any) -> None:
    (folder / f"{name}.json").write_text(json.dumps({"kind": kind, **figures}))


def test_the_documentation_is_what_would_be_generated() -> None:
    assert docs.differences() == {}, "python -m tools.docs"


def test_a_page_that_differs_is_named_and_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for page in docs.PAGES:
        (tmp_path / page).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / page).write_bytes((ROOT / page).read_bytes())
    plan = tmp_path / "docs/results/plan.md"
    plan.write_text(plan.read_text().replace("| 95.1 (94.4 to 95.4)", "| 95.2 (94.4 to 95.4)", 1))
    monkeypatch.setattr(docs, "ROOT", tmp_path)
    found = docs.differences(tmp_path)
    assert list(found) == ["docs/results/plan.md"] and "95.2 (94.4" in found["docs/results/plan.md"]
    monkeypatch.setattr(docs, "differences", lambda: found)
    monkeypatch.setattr("sys.argv", ["docs", "--check"])
    assert docs.main() == 1 and "95.2 (94.4" in plan.read_text()
    monkeypatch.setattr("sys.argv", ["docs"])
    assert docs.main() == 0 and plan.read_bytes() == (ROOT / "docs/results/plan.md").read_bytes()


@pytest.mark.long
def test_the_command_of_ci() -> None:
    done = subprocess.run([sys.executable, "-m", "tools.docs", "--check"], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert "-m tools.docs --check" in (ROOT / "Makefile").read_text(encoding="utf-8")


def test_a_part_goes_into_its_place_alone() -> None:
    text = docs.with_part("a\n<!-- t -->\nold\n<!-- end of t -->\nb", "t", "\nnew\n")
    assert text == "a\n<!-- t -->\nnew\n<!-- end of t -->\nb" == docs.with_part(text, "t", "new")
    for spoilt in ("nothing", text.replace("<!-- t -->", ""), text + text, "<!-- end of t --><!-- t -->"):
        with pytest.raises(BusybotError, match="no place for the part t"):
            docs.with_part(spoilt, "t", "new")
    with pytest.raises(BusybotError, match=r"README\.md: nobody makes other"):
        docs.written("README.md", "<!-- other --><!-- end of other -->")


def test_what_is_said_without_a_number_has_to_be_so(results: Path) -> None:
    moments = [{"boards": boards, "rss_mb": taken} for boards, taken in ((1000, 813), (2000, 746))]
    soak = {"memory": moments, "more_open_files_over_second_half": 1}
    put(results, "memory", "memory", **soak)
    cost = {"ratio_to_minimal_frame": 0.246, "ratio_to_minimal_frame_without_shadows": 0.536}
    put(results, "collection", "collection", **cost)
    with pytest.raises(BusybotError, match="the results do not say that no file stays open"):
        prose.costs()
    put(results, "memory", "memory", **{**soak, "more_open_files_over_second_half": 0})
    assert "0.25 of one frame" in prose.costs() and "between 746 and 813 MB over 2000 boards" in prose.costs()


def test_the_overview_shows_the_worst_seed_and_what_is_missed(results: Path) -> None:
    def judged(precision: float) -> dict[str, Any]:
        one = {"precision": precision, "recall": 1.0, "boards": 2, "intervals": {}, "dataset": {}}
        return {"novel-config": one, "novel-object": one}

    put(results, "table1", "table1", rows={f"free-{n}": judged(share) for n, share in enumerate((0.99, 0.95))})
    put(results, "table2", "table2", rows={})
    kinds = {"one-to-one": {"success": 0.97, "seeds": [1.0, 0.94]}, "one-to-many": {"success": 1.0, "seeds": [1.0]}}
    put(results, "table3", "table3", rows={"search": {"splits": {"novel-object": kinds}}})
    rows = rows_of(tables.overview())
    assert rows["actions that move something"] == ["**95.0**", "90.1", "97", "95.0", "82.6", "93"]
    assert rows["goals reached, one-to-one"] == ["missing", "93.7", "98", "**94.0**", "92.3", "96"]
    assert rows["relations: recall"][0] == "missing"
    (results / "table2.json").write_text(json.dumps(table2(reasoned())))
    assert rows_of(tables.overview())["relations: recall"][0] == "98.5", "reached, as in a report: that is the bound"


def test_a_seed_of_the_whole_pipeline_stands_beside_its_own_policy(results: Path) -> None:
    kinds = dict.fromkeys(tables.KINDS, {"search": planned(1.0), "busybot": planned(0.75)})

    def seed(policy: str, edge_p: float) -> dict[str, Any]:
        scored = (
            dict.fromkeys(SCORES)
            | reasoned()
            | {"edge_p": edge_p, "object_intervals": {"precision": [edge_p - 0.1, edge_p]}}
        )
        novel = ("novel-config", "novel-object")
        return {
            "policy": {"model_sha256": {"a": policy}},
            "relations": dict.fromkeys(novel, scored),
            "plans": dict.fromkeys(novel, kinds),
        }

    def acted(policy: str, precision: float) -> dict[str, Any]:
        one = {"precision": precision, "recall": 1.0, "boards": 2, "intervals": {}, "dataset": {}}
        return {"policy": {"model_sha256": {"a": policy}}, "novel-config": one, "novel-object": one}

    put(results, "table1", "table1", rows={"free-0": acted("b", 0.99), "free-1": acted("c", 0.95)})
    put(results, "whole-pipeline", "whole-pipeline", rows={"0": seed("b", 1.0), "1": seed("c", 0.98)})
    rows = rows_of(tables.whole_pipeline())
    assert rows["new configurations: actions that move something"] == ["99.0", "95.0", "97.0", "97 1 of 2"]
    assert rows["new objects: relations: precision"] == ["100.0", "98.0", "99.0 [88.0-100.0]", "99 1 of 2"]
    assert rows["new objects: goals reached, one-to-many: `search`"] == ["100.0", "100.0", "100.0 [50.0-100.0]", "92 ✓"]
    assert rows["new objects: goals reached, one-to-many: `busybot`"] == ["75.0", "75.0", "75.0 [50.0-100.0]"], (
        "no gate"
    )
    put(results, "whole-pipeline", "whole-pipeline", rows={"0": seed("c", 1.0)})
    with pytest.raises(BusybotError, match="seed 0 has another policy"):
        tables.whole_pipeline()


def test_of_all_or_nothing_bounds_are_exact() -> None:
    assert tables.exact(1.0, [1.0, 1.0], 30)[0] == pytest.approx(0.025 ** (1 / 30))
    assert tables.exact(0.0, [0.0, 0.0], 30)[1] == pytest.approx(1 - 0.025 ** (1 / 30))
    assert tables.exact(0.5, [0.4, 0.6], 30) == [0.4, 0.6]


def test_boxes_that_pictures_propose_stand_beside_given_ones(results: Path) -> None:
    def judged(f1: float | None, **found: float | None) -> dict[str, Any]:
        keys = ("parent_p", "parent_r", "parent_f1", "link_parent_f1", "mechanism_accuracy", "what_if", "pred_a")
        shares = ("proposal_r", "proposal_r_triggers", "proposal_r_responders", "proposal_p")
        return {"boards": 60} | dict.fromkeys(keys, f1) | dict.fromkeys(shares) | found

    given, found = judged(0.9), judged(0.8, proposal_r=0.96, proposal_p=0.5)
    rows = {
        "gates": {"event": {"given": given, "proposed": found}, "count": {"given": given, "proposed": judged(None)}}
    }
    put(results, "proposed-boxes", "proposed-boxes", rows=rows)
    told = rows_of(world_tables.proposed_boxes())
    assert told["gates"] == ["60", "96.0", "-", "-", "50.0"]
    assert told["gates: event"] == ["90.0 / 80.0"] * 7 and told["gates: count"] == ["90.0 / -"] * 7


def planned(success: float) -> dict[str, Any]:
    return {"success": success, "seeds": [success], "object_interval": [0.5, 1.0]}


def test_a_gate_of_worlds_is_reached_at_its_limit() -> None:
    behind = 0.99 - 0.95
    assert behind > 0.04 and gate_tables._Gate("", behind, 0.04, least=False).reached(behind)
    assert [gate_tables._Gate("", 0.9, 0.9).reached(value) for value in (0.9, 0.8999)] == [True, False]


def test_only_uninterrupted_trainings_have_a_cost(results: Path) -> None:
    put(results, "table2-gpu", "table2", rows={})

    def told(*costs: dict[str, Any] | None) -> str:
        put(
            results,
            "table2",
            "table2",
            machine={"cores": 2},
            rows={"event": {"training": [{"cost": c} for c in costs]}},
        )
        return tables.table2().splitlines()[-1]

    cost = {"seconds": 600, "megabytes": 1500}
    assert "model: 10 minutes and at most 1.5 GB of memory on 2 cores (1 of 2 trainings" in told(None, cost)
    assert "model: 10 to 20 minutes" in told(cost, cost | {"seconds": 1200})
    assert "From nothing" not in told(None)


def test_decision_times_are_compared_with_the_gate(results: Path) -> None:
    def timing(mean: float | None, least: float = 0.0) -> dict[str, Any]:
        told = None if mean is None else 2 * mean
        return {"cpu_ms": mean, "cpu_ms_p95": told, "cpu_ms_without_model": None if mean is None else mean - least}

    agents = {
        "search": {"one-to-one": timing(9.0, 4.0), "one-to-many": timing(9.0, 4.0)},
        "random": {"one-to-one": timing(9.0), "one-to-many": timing(50.1)},
        "noop": {"one-to-one": timing(None), "one-to-many": timing(9.0)},
    }
    rows = {
        name: {"splits": {"novel-object": {kind: {"timing": one} for kind, one in kinds.items()}}}
        for name, kinds in agents.items()
    }
    put(results, "table3", "table3", rows=rows)
    rows = rows_of(speed_tables.decision_time())
    assert rows["**search over learned effects**"] == ["9.0 (95 %: 18.0; model 4.0) ✓"] * 2
    assert rows["random actions"][1] == "50.1 (95 %: 100.2; model 0.0) ✗" and rows["doing nothing"][0] == "-"
    assert len(rows) == 4


def test_moves_with_and_without_responders_beside_each_other(results: Path) -> None:
    both, alone = (
        split_study.summary(pd.DataFrame({"trigger": ["a", "a", "b"], "changed_pixels": pixels}))
        for pixels in ([900, 1200, 700], [90, 700, 50])
    )
    assert alone["exceeding"]["500"] == {"share_of_moves": 0.3333, "ever": ["a"], "mostly": []}
    splits = {name: {"with": both, "without": alone} for name in ("train", "novel-object")}
    put(results, "changed_pixels", "changed-pixels", splits=splits)
    text = tables.changed_pixels()
    assert "| training objects, with responders | 700 | 900 | 1200 | 100.0 % | 100.0 % | 33.3 % |" in text
    assert "| novel objects, 2 switches | 1 (1) | 1 (0) | 0 (0) |" in text
    assert "Above 500, training objects: a.\n" in text and "Above 1000" not in text


def test_the_policys_constants_are_told_beside_their_defaults(results: Path) -> None:
    keys = ("precision", "recall", "precision_exploring")
    judged = {**dict.fromkeys(keys, 0.9), "intervals": {"precision": [0.88, 0.92], "recall": None, keys[2]: [0.8, 1.0]}}
    told = {
        "boards": {place: {"boards": 60} for place in ("novel-object", "novel-config", "other")},
        "default_strict": {"explore": 0.35},
        "rows": {"before": judged, "explore=0.2": judged},
        "default": {"explore": 0.25},
        "free": {"explore=0.35": {"novel-object": judged, "novel-config": {**judged, "recall": 0.8}}},
    }
    put(results, "policy_constants", "policy-constants", **told)
    text = tables.policy_constants()
    assert "| *before* |  |  | 90.0 ± 2.0 | 90.0 ± 0.0 | 90.0 ± 10.0 |" in text
    assert "| `explore` | 0.35 | 0.2 | 90.0 ± 2.0 |" in text
    held_out, known = "90.0 ± 2.0 | 90.0 ± 0.0", "90.0 ± 2.0 | 80.0 ± 0.0"
    assert f"| `explore` | 0.25 | 0.35 | {held_out} | {known} | missing | missing |" in text


def test_of_patches_the_least_and_the_most_of_several_models_are_told(results: Path) -> None:
    def model(links: int, believed: float) -> dict[str, Any]:
        none = {"from": 0, "to": 0.05, "candidates": 0, "links": 0, "believed": None}
        return {"by_belief": [none, {"from": 0.05, "to": 1, "candidates": 40, "links": links, "believed": believed}]}

    put(results, "patches", "patches", models={"one": model(10, 0.2), "other": model(12, 0.2)})
    lines = world_tables.patches().strip().splitlines()[2:]
    assert lines == ["| 0 to 5 | 0 | - | - |", "| 5 to 100 | 40 | 25.0 to 30.0 | 20.0 |"]


def test_what_the_papers_interaction_networks_cost(results: Path) -> None:
    network = {
        "parameters": 2_100_000,
        "batch": 16,
        "iterations": 50,
        "seconds_median": 9.04,
        "cpu_seconds_median": 8.5,
    }
    hours = {"training": 15.2, "collecting": 3.9, "both": 19.1}
    whole = {"epochs": 400, "iterations": {"position": 2960}, "hours": hours, "cpu_hours": hours}
    machine = {"processor": "P", "threads": 1}
    told = {"machine": machine, "networks": {"position": network}, "extrapolated": whole}
    put(results, "paper_interact", "paper-interact-speed", **told)
    text = speed_tables.paper_interact_speed()
    assert "| position | 2.1 million | 16 | 50 | 9.0 | 8.5 | 2960 |" in text
    assert "(P, 1 thread) the 400 epochs take 19 hours, of CPU 19: 15 for training and at least 4 for coll" in text


def test_disturbed_recordings(results: Path) -> None:
    scores = {"edge_p": 0.9, "edge_r": 0.8, "pred_a": 0.7}
    graph = {"edge_p": None, "edge_r": 0.8, "pred_a": None}
    models = {"event": scores, "lookup": scores, "count at best": graph}
    rows = {
        "undisturbed": [{"strength": 0.0, "boards": 3, "known": 0.96, "models": models}],
        "missing": [{"strength": 0.1, "boards": 3, "known": 0.9, "models": {"event": scores}}],
    }
    what = {"missing": {"what": "lost", "unit": "of frames"}}
    put(results, "reason_robustness", "reason-robustness", models={"event": {}}, rows=rows, disturbances=what)
    text = world_tables.robustness()
    assert text.splitlines()[0] == "| percent | `event` | lookup | lookup at best | count | count at best | known |"
    found = rows_of(text)
    expected = ["90.0 / 80.0, 70.0", "90.0 / 80.0, 70.0", "-", "-", "- / 80.0", "96.0"]
    assert found["undisturbed, 3 boards"] == expected
    assert found["missing frames, 10 % of frames"][-2:] == ["-", "90.0"] and "- *missing frames*: lost." in text


def test_a_claim_is_told_as_long_as_the_results_say_so(results: Path) -> None:
    def agent(success: float) -> dict[str, Any]:
        told = {"success": success, "seeds": [success], "interval": [success - 0.02, success + 0.02]}
        return {
            "splits": {split: {"one-to-one": told, "one-to-many": told} for split in ("novel-config", "novel-object")}
        }

    places = [f"{split}, {kind}" for split in ("novel-config", "novel-object") for kind in prose.GOALS]

    def told(differing: int = 0, search: float = 0.05, **agents: float) -> str:
        parts = {"predictive": {"differing": differing}, "search": {"difference": search, "p_success": 0.01}}
        rows = {name: agent(success) for name, success in agents.items()}
        put(results, "table3", "table3", tasks=50, rows=rows, compared=dict.fromkeys(places, parts))
        return prose.claim("planning")

    def network(differing: int = 0, relation: float = -0.2, p: float = 0.001) -> None:
        parts = {"predictive": {"difference": 0.0, "differing": differing, "p_success": 1.0}}
        parts["relation"] = {"difference": relation, "p_success": p}
        agents = {name: agent(0.6) for name in ("busybot", "relation", "predictive")}
        put(results, "plan-network", "plan-network", tasks=30, agents=agents, compared=dict.fromkeys(places, parts))

    network()
    ours, _, theirs = told(relation=0.6, predictive=0.95, busybot=0.953).partition("| percent, with the paper's")
    assert rows_of(theirs)["relations alone, open loop against both"] == ["-20.0 (0.001)"] * 4
    assert "With the first of our models, on none of these 200 tasks" in ours and "none of these 120 tasks" in theirs
    assert "ends at 3.0 %" in " ".join(theirs.split())
    rows = rows_of(ours)
    assert rows["BusyBot: relations and prediction"] == ["95.3 ± 2.0"] * 4
    assert rows["*the paper:* BusyBot"] == ["93.7", "69.4", "92.3", "64.9"]
    with pytest.raises(BusybotError, match="do not say that relations beside predictions change nothing"):
        told(differing=1, relation=0.6, predictive=0.95, busybot=0.95)
    with pytest.raises(BusybotError, match="do not say that searching effects is ahead"):
        told(search=-0.01, relation=0.6, predictive=0.95, busybot=0.95)
    with pytest.raises(BusybotError, match="do not say that relations alone are far behind"):
        told(relation=0.92, predictive=0.95, busybot=0.95)
    network(differing=1)  # one task more and another one less: no difference on average
    with pytest.raises(BusybotError, match="filtering by the network's relations changes nothing"):
        told(relation=0.6, predictive=0.95, busybot=0.953)
    network(p=0.2)
    with pytest.raises(BusybotError, match="its relations alone are behind"):
        told(relation=0.6, predictive=0.95, busybot=0.953)


def test_rows_that_were_compared_board_by_board_are_told_with_what_they_were_compared_with() -> None:
    def row(told: dict[str, Any] | None) -> dict[str, Any]:
        return {"splits": {split: {"compared": told} for split in prose.NOVEL}}

    claim, tested = prose.CLAIMS["inference"], {"pred_a": {"boards": 60, "difference": -0.4, "p": 0.0001}}
    rows = dict.fromkeys(claim.rows, row(None)) | {claim.rows[2]: row({"against": claim.rows[3], **tested})}
    words = {name: name for name in claim.rows}
    told = prose._apart(claim, words, rows)
    assert told == [("paper-short-without-inference against paper-short", ["-40.0 (0.0001)"] * 2)]
    before = {name: {"splits": {split: {} for split in prose.NOVEL}} for name in claim.rows}
    assert prose._apart(claim, words, before) == [], "older results have no such tests"


def test_parts_of_collecting_stand_beside_their_limits(results: Path) -> None:
    part = {"ms": 3.0, "products": 0.1, "share": 0.75}
    limited = {**part, "limit": "bare", "limit_ms": 1.5, "ratio": 2.0}
    nothing = {"ms": 0.0, "products": 0.0, "share": 0.0}
    put(
        results,
        "collection-parts",
        "collection-parts",
        interaction={"JPEG": limited, "policy": part, "other": nothing},
        board={"bodies": part},
        megabytes_a_second={"memory": 15000, "SHA-256": 1500, "disk": 300},
        machine={"processor": "one"},
        product_milliseconds=33.0,
        boards=2,
        interactions=60,
        assets="procedural",
    )
    rows = rows_of(speed_tables.collection_parts())
    assert rows["JPEG"] == ["3.00", "0.100", "75.0", "1.50", "2.0", "bare"] and "other" not in rows
    assert rows["policy"] == rows["bodies"] == ["3.00", "0.100", "75.0", "-", "-", "-"]
    assert "memory moves 15.0 GB a second" in speed_tables.collection_parts()


@pytest.mark.parametrize("history", [{"a1"}, None])
def test_a_commit_that_is_gone_is_told_also_where_nobody_can_tell(
    history: set[str] | None, results: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A shallow clone says of it what the list says, or its pages would be others."""
    monkeypatch.setattr(provenance, "KNOWN", {provenance.ABSENT: {"gone"}})
    monkeypatch.setattr(provenance, "_history", lambda: history)
    put(results, "gone", "s3", commit="b1", machine={"cores": 2})
    put(results, "there", "s3", commit="a1", machine={"cores": 2})
    told = provenance.part()
    assert "history as it is today (1): `gone`" in told and "there" not in told


@pytest.mark.parametrize("row", ["real-camera", "real-camera-oracle"])
def test_what_is_said_of_intervals_takes_intervals(row: str, results: Path) -> None:
    told = json.loads((ROOT / "benchmarks" / "results" / "image-reward.json").read_text())
    del told["rows"][row]["novel-config"]["object_intervals"]
    (results / "image-reward.json").write_text(json.dumps(told))
    with pytest.raises(BusybotError, match="the true reward is ahead over objects"):
        prose._rewards_of_a_real_camera()


def test_results_about_weights_that_were_replaced_are_told(results: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(provenance, "KNOWN", {})
    monkeypatch.setattr(provenance, "_history", lambda: {"a1"})
    kept = file_hashes(ROOT / "busybot" / "pretrained" / "reason" / "mechanism")
    other = dict.fromkeys(kept, "ab" * 32)
    page = {**kept, "README.md": "cd" * 32}
    for name, model, of in (("now", "mechanism", page), ("before", "mechanism", other), ("own", "tried", other)):
        put(results, name, "curiosity", commit="a1", machine={"cores": 2}, rows=[{"models": {model: of}}])
    [line] = [line for line in provenance.part().splitlines() if "weights" in line]
    assert "`mechanism`" in line and line.endswith("(1): `before`")
    judged = {"gates": {"novel-object": {name: {"model": other, "boards": 2} for name in ("event", "mechanism")}}}
    put(results, "judged", "world-gates", commit="a1", machine={"cores": 2}, rows=judged)
    first, second = (line for line in provenance.part().splitlines() if "weights" in line)
    assert "of `event` before" in first and first.endswith("(1): `judged`")
    assert "of `mechanism` before" in second and second.endswith("(2): `before`, `judged`")
    (results / "before.json").unlink()
    [both] = [line for line in provenance.part().splitlines() if "weights" in line]
    assert "of `event`, `mechanism` before" in both and both.endswith("(1): `judged`")


def test_a_result_whose_making_is_not_known_is_refused(results: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known = {provenance.NO_COMMIT: {"old"}, provenance.SOME_ROWS: {"some"}, provenance.NO_HASHES: {"bare"}}
    monkeypatch.setattr(provenance, "KNOWN", known)
    monkeypatch.setattr(provenance, "_history", lambda: {"a0", "a1", "a2"})
    data: dict[str, Any] = {"machine": {"cores": 2}, "hashes": {"data": {"a": "ab" * 32}}}
    machine = {"machine": data["machine"]}
    put(results, "old", "table1", commit=None)
    some = {"first": {"config": {"commit": "a0"}}, "other": {}}
    put(results, "some", "table1", commit="a1", rows=some, **machine)
    put(results, "new", "table1", commit="a1", rows={"first": {"config": [{"commit": "a0"}]}}, **data)
    put(results, "bare", "table1", commit="a1", rows={}, **machine)
    put(results, "timed", "scale", commit="a1", **machine)
    told = provenance.part()
    assert "results named their commit (1): `old`" in told and "name no commit (1): `some`" in told
    assert "from their seeds (1): `bare`" in told and "new" not in told and "timed" not in told
    put(results, "changed", "s3", commit="a1-dirty", **machine)
    with pytest.raises(BusybotError, match="changed: changes were not committed"):
        provenance.part()
    put(results, "changed", "s3", commit="b1", **machine)
    with pytest.raises(BusybotError, match="changed: its commit is not in this history"):
        provenance.part()
    put(results, "changed", "s3", commit="a1", machine=None)
    with pytest.raises(BusybotError, match="changed: names no machine"):
        provenance.part()
    put(results, "changed", "s3", commit="a1", **machine)
    hashed = {"first": {"model": "ab" * 32}}
    for name, rows in (("added", {**hashed, "other": {}}), ("listed", [*hashed.values(), {}])):
        put(results, name, "table1", commit="a1", rows=rows, **machine)
        with pytest.raises(BusybotError, match=f"{name}: has no hashes of what it is about"):
            provenance.part()
        put(results, name, "table1", commit="a1", rows=hashed, **machine)
    code = {"versions": {"code": "ab" * 32}}
    for more in ({**code, "rows": {}}, {"rows": {"first": code, "other": code}}):
        put(results, "coded", "table1", commit="a1", **more, **machine)
        with pytest.raises(BusybotError, match="coded: has no hashes of what it is about"):
            provenance.part()
    (results / "coded.json").unlink()
    put(results, "kinds", "s3", commit="a1", kinds={"first": {"commit": "a1"}, "other": {"commit": "a2"}}, **machine)
    with pytest.raises(BusybotError, match="kinds: rows of several commits"):
        provenance.part()
    (results / "kinds.json").unlink()
    made = {"first": {"commit": "a1"}, "other/part": {"commit": "a2"}}
    put(results, "grown", "table1", commit="a2", rows={"first": {}, "other": {}}, made=made, **data)
    with pytest.raises(BusybotError, match="grown: rows of several commits"):
        provenance.part()
    put(results, "grown", "table1", commit="a1", rows={"first": {}, "other": {}}, made={"first": made["first"]}, **data)
    with pytest.raises(BusybotError, match="grown: some rows name no commit"):
        provenance.part()
    made = {"first": {"commit": "a1-dirty"}, "other": {"commit": "a1-dirty"}}
    put(results, "grown", "table1", commit="a1", rows={"first": {}, "other": {}}, made=made, **data)
    with pytest.raises(BusybotError, match="grown: changes were not committed"):
        provenance.part()
    made = {"first/train": {"commit": "a1"}}
    put(results, "grown", "table1", commit="a1", rows={"first/train": {}}, made=made, **data)
    assert "grown" not in provenance.part()
    elsewhere = {"training": [{"training": {"commit": "a0"}}], "splits": [{"commit": "a1"}]}
    put(results, "grown", "table1", commit="a1", rows={"first": elsewhere, "other": elsewhere}, **data)
    assert "grown" not in provenance.part(), "trained by one commit, judged by another"
    for commit, words in (("a2", "rows of several commits"), (None, "some rows name no commit")):
        other = {**elsewhere, "training": [{"training": {"commit": commit}}]}
        put(results, "grown", "table1", commit="a1", rows={"first": elsewhere, "other": other}, **data)
        with pytest.raises(BusybotError, match=f"grown: {words}"):
            provenance.part()
    (results / "grown.json").unlink()
    put(results, "old", "table1", commit="a2", **data)
    with pytest.raises(BusybotError, match="old: its making is known now"):
        provenance.part()
