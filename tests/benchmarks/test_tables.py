"""Benchmarks: how their commands are told, and what a stopped table keeps."""

import argparse
import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks import runner
from benchmarks.runner import as_typed, finish, hashes_beside, one_of, parser, told_rows, typed
from benchmarks.speed import interact as interact_speed
from benchmarks.studies import features, proposed_boxes, reason_robustness
from benchmarks.tables import real_board, table1, table2, table3, whole_pipeline
from benchmarks.tables.table2 import DETAILS, SCORES, across
from busybot.common.errors import BusybotError, UsageError
from busybot.episodes.mcap.writer import write_episode
from busybot.evaluation.folder import RESULT
from busybot.evaluation.reference_tables import INTERACTION
from busybot.evaluation.results import code_digest, read_result, stamp, write_result
from busybot.interact.policy.config import AffordanceInfo
from busybot.interact.training.config import PaperConfig
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode


def scores(**values: float | None) -> dict[str, Any]:
    told: dict[str, Any] = dict.fromkeys((*SCORES, *DETAILS), None) | {"versions": {"code": code_digest()}}
    told["bounds"] = {"not_knowing": {"pred_a": 0.96, "pred_a_successful": 0.99}}
    return {**told, "by_board": {"pred_a": {"part": [2, 3], "whole": [4, 4]}}, **values}


def test_mean_and_extremes_over_seeds() -> None:
    told = across([scores(pred_a=0.9, edge_r=1.0), scores(pred_a=0.8, edge_r=None)])
    assert (told["mean"]["pred_a"], told["least"]["pred_a"], told["most"]["pred_a"]) == (pytest.approx(0.85), 0.8, 0.9)
    assert told["mean"]["edge_r"] is told["least"]["edge_r"] is None


@pytest.mark.parametrize("versions", [{"code": "a" * 64}, {"busybot": "0.1.0"}])
def test_what_another_version_judged_is_refused(tmp_path: Path, versions: dict[str, str]) -> None:
    file = tmp_path / "judged.json"
    assert runner.earlier(file) is None
    file.write_text(json.dumps({"versions": versions, "success": 1.0}))
    with pytest.raises(BusybotError, match=r"judged\.json: what is there was judged by another version"):
        runner.earlier(file)
    file.write_text(json.dumps(stamp("reason") | {"success": 1.0}))
    assert (runner.earlier(file) or {})["success"] == 1.0


def test_what_is_judged_is_not_judged_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, ...]] = []

    def answer(*arguments: str) -> dict[str, Any]:
        asked.append(arguments)
        return scores(pred_a=0.5)

    monkeypatch.setattr(runner, "busybot", answer)
    split = make_dataset(tmp_path / "data" / "novel-object")
    out = tmp_path / "table2.json"
    words = ["--data", f"{tmp_path}/data", "--work", f"{tmp_path}/work", "--out", str(out), "--rows", "lookup"]
    table2.main(words)
    table2.main(words)
    assert len(asked) == 1 and asked[0][:2] == ("eval", "reason")
    write_episode(split.episode_path(2), make_episode(2))
    table2.main(words)
    assert len(asked) == 2, "there is one more recording"
    row = json.loads(out.read_text())["rows"]["lookup"]
    assert row["splits"]["novel-object"]["mean"]["pred_a"] == 0.5
    assert row["commands"] == ["busybot eval reason DATA/novel-object --reasoner lookup --decoders DATA/train"]
    assert told_rows(out, "table2")["lookup"] == row and told_rows(tmp_path / "none.json", "table2") == {}


def test_what_is_judged_with_another_model_or_other_decoders_is_judged_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both have the names in the command that those had which a training, or a recording, replaced."""
    asked: list[tuple[str, ...]] = []

    def answer(*words: str) -> dict[str, Any]:
        asked.append(words)
        return scores(pred_a=0.5)

    monkeypatch.setattr(runner, "busybot", answer)
    model, out = tmp_path / "event-0" / "model", tmp_path / "judged.json"
    model.mkdir(parents=True)
    (model / "model.json").write_text("{}")
    judged, decoders = (make_dataset(tmp_path / name) for name in ("novel-object", "train"))
    command = ("eval", "reason", str(judged.path), "--reasoner", str(model.parent), "--decoders", str(decoders.path))
    for changes in (lambda: None, lambda: (model / "weights.safetensors").write_bytes(b"others"), None):
        for _ in range(2):
            table2.answered(command, out, judged.path)
        if changes is None:
            write_episode(decoders.episode_path(2), make_episode(2))
        else:
            changes()
    table2.answered(command, out, judged.path)
    assert len(asked) == 3


@pytest.mark.parametrize("words", [["event"], ["event="], ["=folder"], ["event=a", "event=b"]])
def test_words_that_name_nothing_are_refused(words: list[str], tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--model"):
        runner.named(words, "--model")
    with pytest.raises(UsageError, match="--learned"):
        table3.folders_of(words)
    data = make_dataset(tmp_path / "data").path
    asked = [word for one in words for word in ("--model", one)]
    with pytest.raises(UsageError, match="--model"):
        reason_robustness.main(["--data", str(data), *asked, "--out", str(tmp_path / "out.json")])
    assert runner.named(["event=a=b", "lookup=c"], "--model") == {"event": "a=b", "lookup": "c"}


def test_what_a_training_cost_is_whole_or_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "busybot", lambda *words: {})
    assert runner.train(tmp_path / "event-0")["cost"].keys() == {"seconds", "megabytes"}
    assert [path.name for path in tmp_path.iterdir()] == ["event-0.cost.json"]
    (tmp_path / "event-0").mkdir()
    (tmp_path / "event-0.cost.json").write_text('{"seconds": 3')
    with pytest.raises(BusybotError, match=r"event-0\.cost\.json: not valid JSON"):
        runner.train(tmp_path / "event-0")


def test_too_few_boards_to_leave_any_out_are_refused(tmp_path: Path) -> None:
    data = make_dataset(tmp_path / "data", finished=(0,)).path
    with pytest.raises(UsageError, match="data: fewer than 2 recordings"):
        features.main(["--train", str(data), "--out", str(tmp_path / "f.json")])
    with pytest.raises(UsageError, match="--boards: the first board(.|\n)*two at least"):
        interact_speed.main(["--boards", "1"])


def test_rows_of_one_file_are_about_the_same(tmp_path: Path) -> None:
    out = tmp_path / "r.json"
    hashes = {"models": {"event": {"weights.safetensors": "a"}}}
    write_result(out, stamp("bounds", seed=0, hashes=hashes) | {"assets": "procedural", "rows": {"gates": {}}})
    assert told_rows(out, "bounds", assets="procedural", seed=0, boards=3) == {"gates": {}}, "older files tell less"
    for about in ({"assets": "partnet-mobility"}, {"seed": 1}):
        with pytest.raises(UsageError, match=f"r.json: its rows are about other {next(iter(about))}"):
            told_rows(out, "bounds", **about)
    assert told_rows(tmp_path / "none.json", "bounds", assets="x") == {}
    more = {"mechanism": {"weights.safetensors": "b"}}
    assert hashes_beside(out, "bounds", "models", more) == {**hashes["models"], **more}
    with pytest.raises(UsageError, match="r.json: it has rows about another event"):
        hashes_beside(out, "bounds", "models", {"event": {"weights.safetensors": "c"}})
    assert hashes_beside(tmp_path / "none.json", "bounds", "models", more) == more


def test_judgements_of_the_real_board_by_other_code_are_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, chosen = make_dataset(tmp_path / "twin").path, dict[str, list[str]]()
    assert real_board.judged(data, "", chosen, tmp_path) == {}
    [note] = (tmp_path / "judged").glob("*.json")
    note.write_text(json.dumps(json.loads(note.read_text()) | {"counted": {"kept": []}}))
    assert real_board.judged(data, "", chosen, tmp_path) == {"kept": []}
    monkeypatch.setattr(real_board, "code_digest", lambda: "another version")
    assert real_board.judged(data, "", chosen, tmp_path) == {}


def test_rows_of_table_2_are_compared_on_the_boards_that_both_have(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = {"paper-short-0": [1, 1], "paper-short-without-inference-0": [0, 1, 9]}

    def answer(*arguments: str) -> dict[str, Any]:
        if arguments[0] == "train":
            return {"training": {}, "out": "", "model": ""}
        part = right[Path(arguments[arguments.index("--reasoner") + 1]).name]
        return scores(by_board={"pred_a": {"part": part, "whole": [10] * len(part)}})

    monkeypatch.setattr(runner, "busybot", answer)
    make_dataset(tmp_path / "data" / "few" / "novel-config")
    words = ["--data", f"{tmp_path}/data", "--work", f"{tmp_path}/work", "--out", str(tmp_path / "told.json")]
    table2.main([*words, "--rows", "paper-short-without-inference"])
    alone = told_rows(tmp_path / "told.json", "table2")["paper-short-without-inference"]
    assert alone["splits"]["novel-config"]["compared"] is None, "nobody was judged that it is compared with"
    table2.main([*words, "--rows", "paper-short,paper-short-without-inference"])
    both = told_rows(tmp_path / "told.json", "table2")
    assert both["paper-short-without-inference"]["splits"]["novel-config"]["compared"] == {
        "against": "paper-short", "pred_a": {"boards": 2, "difference": pytest.approx(-0.05), "p": 1.0},
    }  # fmt: skip


def test_commands_are_told_without_this_machines_places(tmp_path: Path) -> None:
    assert as_typed(("eval", f"{tmp_path}/x"), {str(tmp_path): "DATA"}) == "busybot eval DATA/x"
    made = ("train", "--assets", "procedural", "--config", "benchmarks/procedural.yaml")
    assert as_typed(made, {"procedural": "ASSETS"}) == "busybot " + " ".join(made)
    played = ("eval", "plan", "w/x-1", "--agents", "bc=bc,ppo=p/q", "--out", "w")
    told = as_typed(played, {"w": "WORK", "bc": "BC", "p/q": "PPO"})
    assert told == "busybot eval plan WORK/x-1 --agents bc=BC,ppo=PPO --out WORK"


def test_a_result_tells_its_command_without_places(tmp_path: Path) -> None:
    options = parser("text")
    options.add_argument("--model", action="append")
    options.add_argument("--boards", type=int, default=5)
    options.add_argument("--dense-boards", type=int)
    arguments = options.parse_args(
        ["--assets", "/a/b", "--out", f"{tmp_path}/r.json", "--model", "event=/c/d", "--model", "x"]
    )
    command = "python -m benchmarks.speed.collection --assets ASSETS --out OUT --model event=FOLDER x --boards 5"
    assert typed("collection", arguments) == typed("memory", arguments) == command
    finish("collection", arguments, {"rows": {}}, machine={"threads": 1})
    told = read_result(tmp_path / "r.json", "collection")
    assert told["command"] == command and told["machine"]["threads"] == 1 and told["rows"] == {}
    assert [path.name for path in tmp_path.iterdir()] == ["r.json"]
    with pytest.raises(BusybotError, match="a result of the kind collection, not table1"):
        told_rows(tmp_path / "r.json", "table1")
    assert finish("memory", argparse.Namespace(out=None, seed=3), {})["seed"] == 3


def test_the_first_word_may_name_another_benchmark_of_a_module(monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[tuple[str, list[str]]] = []
    for words in (["--out", "x"], ["other-part", "--out", "x"], []):
        monkeypatch.setattr("sys.argv", ["table3", *words])
        one_of(lambda words: ran.append(("usual", words)), other_part=lambda words: ran.append(("other", words)))
    assert ran == [("usual", ["--out", "x"]), ("other", ["--out", "x"]), ("usual", [])]
    told = typed("plan-network", argparse.Namespace(boards=2))
    assert told == "python -m benchmarks.tables.table3 network --boards 2"


@pytest.mark.parametrize(("raised", "code"), [(BusybotError, 1), (UsageError, 2)])
def test_wrong_input_is_told_without_a_traceback(
    raised: type[BusybotError], code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(words: list[str]) -> None:
        raise raised("boards: there are none", "make some")

    monkeypatch.setattr("sys.argv", ["table3"])
    with pytest.raises(SystemExit) as stopped:
        one_of(refuse)
    assert stopped.value.code == code
    assert capsys.readouterr().err == "error: boards: there are none\n  hint: make some\n"


def test_planning_with_what_ships_has_its_own_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, ...]] = []

    def answer(*arguments: str) -> dict[str, Any]:
        asked.append(arguments)
        row = dict.fromkeys(table3.DETAILS) | {"success": 0.5 + len(asked) / 100, "object_interval": None}
        return {"agents": {"search": row, "bc": row}, "timing": {"search": {}, "bc": {}}}

    monkeypatch.setattr(table3, "busybot", answer)
    monkeypatch.setattr(table3, "origin", lambda options, split, kind: {"hashes": {"tasks": {kind: split}}})
    monkeypatch.setattr(table3, "against", lambda options, split, kind: {"predictive": {"difference": -0.1}})
    words = ["--work", f"{tmp_path}/w", "--out", f"{tmp_path}/o", "--boards", "2"]
    *_, result = table3.measured(table3.parsed(words, policy_model="procedural", reasoner=["event"]))
    assert len(asked) == 3 * 6 and "--boards 2" in result["commands"][0]
    assert "--reasoner event --policy-model procedural" in result["commands"][2], "what ships is told by its name"
    assert "WORK/judged-novel-object-one-to-one-0" in result["commands"][2]
    assert result["rows"]["search"]["splits"]["train"]["one-to-one"]["success"] == pytest.approx(0.65)
    assert result["origins"]["train, one-to-many"]["hashes"]["tasks"] == {"one-to-many": "train"}
    assert set(result["compared"]) == set(result["origins"])


def test_the_papers_agents_are_compared_with_the_papers_network(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def answer(*arguments: str) -> dict[str, Any]:
        if arguments[0] != "eval":
            return {}
        names = arguments[arguments.index("--agents") + 1].split(",")
        assert names == list(table3.THEIRS) and arguments[arguments.index("--reasoner") + 1] == "theirs"
        row = dict.fromkeys(table3.DETAILS) | {"success": 0.5, "object_interval": [0.4, 0.6]}
        out = Path(arguments[arguments.index("--out") + 1])
        compared = {name: {"difference": -0.1} for name in names[1:]}
        write_result(out / RESULT, stamp("plan") | {"compared": compared, "dataset": {}, "provenance": {}})
        return {"agents": dict.fromkeys(names, row), "timing": dict.fromkeys(names, {})}

    monkeypatch.setattr(table3, "busybot", answer)
    words = ["--policy-model", "policy", "--reasoner", "theirs", "--work", str(tmp_path / "w")]
    table3.network([*words, "--out", str(tmp_path / "told.json")])
    told = read_result(tmp_path / "told.json", "plan-network")
    assert told["agents"]["busybot"]["splits"]["train"]["one-to-one"]["object_interval"] == [0.4, 0.6]
    assert told["compared"]["novel-object, one-to-many"]["relation"] == {"difference": -0.1}
    assert len(told["compared"]) == len(told["origins"]) == 6


def test_trainings_of_a_learned_agent_are_told_apart_by_their_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def answer(*arguments: str) -> dict[str, Any]:
        if arguments[0] != "eval":
            return {}
        assert "--reasoner" not in arguments
        share = {"bc=lstm": 0.5, "bc=looks-back": 0.9}[arguments[arguments.index("--agents") + 1]]
        row = dict.fromkeys(table3.DETAILS) | {"success": share, "object_interval": [share, 1.0]}
        out = Path(arguments[arguments.index("--out") + 1])
        write_result(out / RESULT, stamp("plan") | {"dataset": {}, "provenance": {"agent": share}})
        return {"agents": {"bc": row}, "timing": {"bc": {}}}

    monkeypatch.setattr(table3, "busybot", answer)
    monkeypatch.setattr(table3, "training", lambda folder: {"minutes": len(folder.name)})
    words = ["--policy-model", "policy", "--work", str(tmp_path / "w"), "--out", str(tmp_path / "told.json")]
    table3.learned([*words, "--learned", "bc=lstm", "bc-attention=looks-back"])
    told = read_result(tmp_path / "told.json", "plan-learned")
    cells = {name: row["splits"]["novel-object"]["one-to-many"]["success"] for name, row in told["agents"].items()}
    assert cells == {"bc": 0.5, "bc-attention": 0.9} and told["compared"] == {}
    assert told["agents"]["bc-attention"]["training"] == [{"minutes": len("looks-back")}]
    assert told["origins"]["train, one-to-one, bc-attention"]["provenance"] == {"agent": 0.9}
    for wrong in (["--learned"], ["--learned", "bc=lstm", "--reasoner", "event"]):
        with pytest.raises(UsageError, match="learned baselines play, and nobody else"):
            table3.learned([*words, *wrong])


def test_several_reasoners_have_the_widest_interval(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def answer(*arguments: str) -> dict[str, Any]:
        if arguments[0] != "eval":
            return {}
        agents, reasoner = (arguments[arguments.index(name) + 1] for name in ("--agents", "--reasoner"))
        share = {"m0": 0.5, "m1": 0.6}[reasoner]
        row = dict.fromkeys(table3.DETAILS) | {"success": share, "object_interval": [share - 0.1, share + 0.1]}
        names = agents.split(",")
        return {"agents": dict.fromkeys(names, row), "timing": dict.fromkeys(names, {})}

    monkeypatch.setattr(table3, "busybot", answer)
    monkeypatch.setattr(table3, "origin", lambda options, split, kind: {})
    monkeypatch.setattr(table3, "against", lambda options, split, kind: {})
    words = ["--work", f"{tmp_path}/w", "--out", f"{tmp_path}/o", "--reasoner", "m0", "m1", "--policy-model", "policy"]
    *_, result = table3.measured(table3.parsed(words))
    cells = {name: row["splits"]["train"]["one-to-one"] for name, row in result["rows"].items()}
    assert cells["busybot"]["seeds"] == [0.5, 0.6] and cells["relation"]["seeds"] == [0.5]
    assert cells["busybot"]["object_interval"] == pytest.approx((0.4, 0.7))


def test_rows_of_table_1_are_what_commands_tell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, ...]] = []

    def answer(*arguments: str) -> dict[str, Any]:
        asked.append(arguments)
        if "responders=false" in arguments:
            raise BusybotError("round 0: no recorded action succeeded, so there is nothing to learn")
        if arguments[0] == "train":
            return {"training": {"seed": 1}}
        keys = dict.fromkeys((*table1.KEYS, "commit", "dataset"), 0.5) | {"versions": {"code": code_digest()}}
        policy = {"explore": 0.25, "after_failure": [[0.0]]}
        counts = {"recall": {"part": [0 if "greedy" in arguments else 2] * 5, "whole": [2] * 5}}
        told = keys | {"provenance": {"policy": policy, "model": {"sha256": {"a": "b"}}}, "by_board": counts}
        if arguments[1] == "interact":
            write_result(Path(arguments[arguments.index("--out") + 1]) / RESULT, stamp("interact") | told)
        return told

    monkeypatch.setattr(runner, "busybot", answer)
    (tmp_path / "w" / "paper").mkdir(parents=True)
    half = AffordanceInfo(
        variant="paper", inputs="depth", prior=0.5,
        training={"epochs": 20, "schedule": 40, "seed": 0, "config": PaperConfig().model_dump(mode="json")},
    )  # fmt: skip
    (tmp_path / "w" / "paper" / "model.json").write_text(half.model_dump_json())
    out, rows = tmp_path / "table1.json", "free-0,free-1,greedy,without-responders-1000,shipped,paper,paper-greedy"
    monkeypatch.setattr("sys.argv", ["t", "--work", f"{tmp_path}/w", "--out", str(out), "--rows", rows])
    table1.main()
    told = json.loads(out.read_text())["rows"]
    assert list(told) == rows.split(",") and told["without-responders-1000"]["untrained"]
    assert told["free-1"]["policy"] == {"model_sha256": {"a": "b"}, "constants": {"explore": 0.25}}
    assert told["free-1"]["training"]["cost"].keys() == {"seconds", "megabytes"} and not told["greedy"]["training"]
    assert (
        told["greedy"]["commands"][1]
        == "busybot eval interact WORK/judge-707-novel-config --model WORK/free-0 --mode greedy"
    )
    assert told["shipped"]["commands"][1] == "busybot eval interact WORK/judge-707-novel-config --model procedural"
    assert not told["shipped"]["training"] and told["shipped"]["novel-object"]["compared"]["against"] == "free-0"
    assert told["free-0"]["novel-object"]["compared"] is None
    assert told["greedy"]["novel-object"]["compared"] == {
        "against": "free-0", "recall": {"boards": 5, "difference": -1, "p": 2 / 32}
    }  # fmt: skip
    assert told["free-1"]["novel-config"]["compared"]["recall"]["p"] == 1
    assert {name for name, row in told.items() if "by_board" in row.get("novel-object", {})} == {"free-0", "paper"}
    trained = [command for command in asked if command[0] == "train"][1:]
    assert len(trained) == 2 and "--seed" in trained[0] and trained[0][trained[0].index("--seed") + 1] == "1"
    known = {key: value for key, value in told["paper"]["training"].items() if key != "config"}
    assert known == {"epochs": 20, "schedule": 40, "seed": 0, "cost": None}, "a model is judged as it is"
    with pytest.raises(BusybotError, match=r"trained otherwise than this row is \(inputs"):
        table1._card_of(table1.ROWS["paper-rgb"], tmp_path / "w" / "paper", None)
    with pytest.raises(BusybotError, match=r"trained otherwise than this row is \(responders\)"):
        table1._card_of(table1.ROWS["paper-without-responders"], tmp_path / "w" / "paper", None)
    (tmp_path / "all.yaml").write_text("responders: false\n")
    with pytest.raises(BusybotError, match=r"trained otherwise than this row is \(responders\)"):
        table1._card_of(table1.ROWS["paper"], tmp_path / "w" / "paper", tmp_path / "all.yaml")
    monkeypatch.setattr("sys.argv", ["t", "--work", f"{tmp_path}/w", "--out", str(out), "--judge-seed", "808"])
    with pytest.raises(BusybotError, match="its rows are of other objects, or judged on other boards"):
        table1.main()
    assert told["paper-greedy"]["commands"][1].endswith("--model WORK/paper --mode greedy")
    papers = {"paper", "paper-greedy", "paper-oracle", "paper-rgb", "paper-without-responders"}
    further = {*table1.ON_REQUEST} - papers
    assert {row.name for row in INTERACTION.rows} == table1.ROWS.keys() - further and papers < {*table1.ON_REQUEST}
    monkeypatch.setattr("sys.argv", ["t", "--work", f"{tmp_path}/elsewhere", "--out", str(out), "--rows", "free-2"])
    table1.main()
    known = json.loads(out.read_text())
    assert known["rows"]["free-2"]["novel-object"]["compared"]["recall"]["p"] == 1, "free-0 was judged elsewhere"
    known["rows"]["free-0"]["novel-config"]["versions"]["code"] = "0" * 64
    out.write_text(json.dumps(known))
    with pytest.raises(BusybotError, match="free-0, novel-config: what is there was judged by another version"):
        table1.main()


def test_a_result_tells_of_rows_that_came_one_after_the_other_who_made_which(tmp_path: Path) -> None:
    out, machine = tmp_path / "r.json", {"cores": 2}

    def written(commit: str, rows: dict[str, Any]) -> dict[str, str]:
        told = {"commit": commit, "machine": machine, "rows": rows}
        told["made"] = runner.made(json.loads(out.read_text()) if out.exists() else {}, told)
        out.write_text(json.dumps(told))
        assert all(one["machine"] == machine for one in told["made"].values())
        return {place: one["commit"] for place, one in told["made"].items()}

    assert written("a", {"x": {"one": (1,)}, "y": 1}) == {"x": "a", "y": "a"}
    assert written("b", {"x": {"one": (1,)}, "y": 1, "z": 1}) == {"x": "a", "y": "a", "z": "b"}
    assert written("c", {"x": {"one": (1,), "two": 2}, "z": 1}) == {"x": "a", "x/two": "c", "z": "b"}, (
        "what is gone is not told"
    )
    assert written("d", {"x": {"one": (2,), "two": 2}, "z": 1}) == {"x": "a", "x/two": "c", "x/one": "d", "z": "b"}
    assert written("e", {"x": {"two": 2}, "z": 1}) == {"x": "e", "z": "b"}, "a row that lost a part is new as a whole"
    out.write_text(json.dumps({"rows": {"x": 1}}))
    assert written("f", {"x": 1, "y": 1}) == {"y": "f"}, "nobody said of x who made it"
    assert written("g", {"y": 1, "gates/train": {"a": 1}}) == {"y": "f", "gates/train": "g"}
    assert written("h", {"y": 2, "gates/train": {"a": 1}}) == {"gates/train": "g", "y": "h"}


def test_proposed_boxes_are_judged_beside_given_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, ...]] = []

    def answer(*arguments: str) -> dict[str, Any]:
        asked.append(arguments)
        f1 = 0.9 if "given" in arguments else 0.8
        results = [dict.fromkeys(proposed_boxes.KEYS) | {"parent_f1": f1} for _ in proposed_boxes.REASONERS]
        return {"results": results}

    monkeypatch.setattr(runner, "busybot", answer)
    out = tmp_path / "o.json"
    proposed_boxes.main(["--data", str(tmp_path), "--out", str(out), "--only", "gates"])
    rows = read_result(out, "proposed-boxes")["rows"]
    assert rows["gates"]["mechanism"]["given"]["parent_f1"] == 0.9
    assert rows["gates"]["count"]["proposed"]["parent_f1"] == 0.8
    assert len(asked) == 2 and all(words[2] == f"{tmp_path}/gates/validation" for words in asked)
    assert [words[words.index("--boxes") + 1] for words in asked] == ["given", "proposed"]


def test_what_ships_is_judged_on_its_own_objects(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "busybot", lambda *arguments: scores(edge_p=1.0) if arguments[0] == "eval" else {})
    out = tmp_path / "o.json"
    table2.procedural(["--work", str(tmp_path / "w"), "--out", str(out), "--boards", "3"])
    told = read_result(out, "reason-procedural")
    assert told["splits"]["novel-object"]["edge_p"] == 1.0 and told["seed"] is None
    assert told["commands"][3:] == [
        "busybot generate WORK/novel-object --split novel-object --boards 3 --seed 604 --group-size 1 "
        "--assets procedural",
        "busybot collect WORK/novel-object --steps 30 --policy learned --seed 604",
        "busybot eval reason WORK/novel-object --reasoner event",
    ]


def test_each_seed_of_the_whole_pipeline_has_all_that_is_learned_to_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[str, ...]] = []

    def answer(*arguments: str) -> dict[str, Any]:
        asked.append(arguments)
        if arguments[0] == "generate" and not Path(arguments[1]).exists():
            make_dataset(Path(arguments[1]))
        row = dict.fromkeys(table3.DETAILS) | {"success": 0.5, "object_interval": None}
        agents = dict.fromkeys(table3.OURS, row)
        if arguments[0] == "train":
            return {"training": {"seed": 0}, "out": "x", "model": "y"}
        return scores(edge_p=0.9) | {"agents": agents, "timing": dict.fromkeys(table3.OURS, {})}

    for module in (runner, table3):
        monkeypatch.setattr(module, "busybot", answer)
    monkeypatch.setattr(whole_pipeline, "origin", lambda options, split, kind: {})
    policies = [tmp_path / name for name in ("p", "q")]
    for folder in policies:
        folder.mkdir()
        (folder / "model.json").write_text(folder.name)
    (tmp_path / "w").mkdir()
    out = tmp_path / "told.json"
    words = ["--work", f"{tmp_path}/w", "--out", str(out), "--boards", "2", "--judged", "1", "--tasks", "1"]
    whole_pipeline.main([*words, "--policies", *map(str, policies)])
    first, second = read_result(out, "whole-pipeline")["rows"].values()
    assert first["policy"] != second["policy"] and first["training"].keys() == {"training", "cost"}
    assert first["plans"]["novel-object"]["one-to-many"]["search"]["success"] == 0.5
    collected = [words for words in asked if words[0] == "collect"]
    for number, folder in enumerate(policies):
        own = [words for words in collected if str(folder) in words]
        assert len(own) == len(collected) / 2 and all(f"/w/{number}/" in words[1] for words in own)
    trained = [words for words in asked if words[:2] == ("train", "reason")]
    assert [words[words.index("--seed") + 1] for words in trained] == ["0", "1"]
    drawn = {words[words.index("--seed") + 1] for words in asked if words[0] == "generate" and "train" in words}
    assert drawn == {"611", "612"}, "each has training boards of its own"
    judged = [words for words in asked if words[:2] == ("eval", "reason")]
    reasoners = [words[words.index("--reasoner") + 1] for words in judged]
    assert [Path(one).relative_to(tmp_path / "w").as_posix() for one in reasoners] == ["0/event"] * 2 + ["1/event"] * 2
    asked.clear()
    whole_pipeline.main([*words, "--policies", *map(str, policies), "--seeds", "1"])
    assert read_result(out, "whole-pipeline")["rows"]["0"] == first, "another machine goes on with the next seed"
    assert asked and not any(f"{tmp_path}/w/0/" in word for words in asked for word in words)
    assert "busybot collect WORK/novel-object --steps 30 --policy learned --model POLICY" in " ".join(first["commands"])
