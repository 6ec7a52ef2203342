"""Who plays in which world."""

import json
from argparse import Namespace
from pathlib import Path

import pytest

from benchmarks.tables.world_plans import STEPS, commands, compared, measured, models_of, parsed, seeded
from busybot.common.errors import UsageError
from busybot.evaluation.folder import BOARDS
from busybot.plan.metrics import JudgedResponder, JudgedRollout, JudgedTask

OPTIONS = {
    "work": Path("w"), "history": "scripted", "steps": STEPS, "policy": None, "assets": "procedural", "boards": 1,
    "model": "mechanism", "learned": ["bc=b", "ppo=p"], "actions": 8,
}  # fmt: skip


def players(world: str) -> list[str]:
    """The agents of each evaluation."""
    asked = commands(world, Namespace(**OPTIONS))
    return [words[words.index("--agents") + 1] for words in asked if "--agents" in words]


def test_the_papers_agents_play_everywhere_learned_ones_where_they_can_practise() -> None:
    ours, others = players("time")
    assert ours == "mechanism" and {"relation", "predictive", "busybot", "search"} < set(others.split(","))
    assert players("gates") == players("lock-1-to-4") == [ours, others, "bc=b,ppo=p"]
    assert players("lock-5-to-8") == [ours, others], "their boards have more objects than learned agents see"


def test_longer_histories_lie_in_folders_of_their_own_and_in_a_result_of_their_own(tmp_path: Path) -> None:
    collect = commands("lock", Namespace(**OPTIONS | {"steps": 60}))[1]
    assert collect[:2] == ("collect", "w/lock-scripted-60") and collect[collect.index("--steps") + 1] == "60"
    out = tmp_path / "result.json"
    out.write_text('{"kind": "world-plans", "history": "scripted", "rows": {}}')
    words = ["--model", "m", "--work", str(tmp_path), "--assets", "procedural", "--out", str(out)]
    for other in ("--steps", "--actions"):
        with pytest.raises(UsageError, match="it has other histories, other numbers of actions"):
            next(measured(parsed([*words, other, "60"])))
    out.write_text('{"kind": "world-plans", "assets": "partnet-mobility", "rows": {}}')
    with pytest.raises(UsageError, match="or other objects"):
        next(measured(parsed(words)))


def test_who_may_take_more_actions_plays_with_the_same_histories_into_folders_of_their_own() -> None:
    usual, more = (commands("lock", Namespace(**OPTIONS | {"actions": actions})) for actions in (8, 12))
    assert usual[:2] == more[:2] and "steps=8" not in usual[2]
    assert more[2][more[2].index("steps=12") - 1] == "--set"
    assert (usual[2][-1], more[2][-1]) == ("w/lock-scripted-mechanism", "w/lock-scripted-12-actions-mechanism")


def test_other_trainings_play_the_same_tasks_into_folders_of_their_own() -> None:
    playing = ("eval", "plan", "w/gates-scripted", "--reasoner", "mechanism", "--out", "w/gates-scripted-mechanism")
    assert seeded(playing, [Path("models/mechanism-1")]) == {
        "mechanism-1": (*playing[:4], "models/mechanism-1", "--out", "w/gates-scripted-mechanism-mechanism-1"),
    }  # fmt: skip
    assert seeded(playing, []) == {}


def test_a_result_is_of_one_model_and_each_training_has_a_name_of_its_own(tmp_path: Path) -> None:
    out, models = tmp_path / "result.json", Path("benchmarks/models")
    asked = ["--model", str(models / "mechanism-1"), "--work", str(tmp_path), "--out", str(out)]
    found = models_of(parsed([*asked, "--policy", str(models / "lean-free-0"), "--seeds", str(models / "mechanism-2")]))
    assert list(found) == ["mechanism", "mechanism-2", "policy"]
    out.write_text(json.dumps({"hashes": {"models": found}}))
    assert models_of(parsed(asked)) == found, "worlds that stand there already were played by the others, too"
    for words, match in (
        (["--model", str(models / "mechanism-2")], "it has worlds with another mechanism"),
        (["--seeds", "runs/1/model", "runs/2/model"], "two trainings have one name"),
        (["--seeds", "runs/mechanism"], "two trainings have one name"),
        (["--seeds", "runs/policy"], "or one is called policy"),
    ):
        with pytest.raises(UsageError, match=match):
            models_of(parsed([*asked, *words]))


def lamp(reached: bool) -> JudgedResponder:
    return JudgedResponder(object=0, key="Lamp/1", kind="gate", asked=True, reached=reached, looks_reached=reached)


def judged(folder: Path, reached: dict[str, list[bool]]) -> Path:
    """An evaluation of tasks with one responder, by agent and task."""
    folder.mkdir()
    lines = []
    for board in reversed(range(8)):  # in the order in which they were finished
        rollouts = [
            JudgedRollout(agent=agent, steps=1, succeeded=1, stopped="", responders=(lamp(own[board]),))
            for agent, own in reached.items()
        ]
        lines.append(JudgedTask(board=board, kind="reach", least_steps=1, rollouts=tuple(rollouts)).model_dump_json())
    (folder / BOARDS).write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    return folder


def test_agents_of_several_evaluations_are_compared_task_by_task(tmp_path: Path) -> None:
    first = judged(tmp_path / "first", {"mechanism": [True] * 8})
    others = judged(tmp_path / "others", {"search": [True] * 8, "noop": [False] * 7 + [True]})
    told = compared([first, others], ["mechanism", "search", "noop"], "gates")
    assert told.keys() == {"search", "noop"} and told["search"]["differing"] == 0 and told["search"]["p_success"] == 1
    assert told["noop"]["difference"] == pytest.approx(-7 / 8) and told["noop"]["differing"] == 7
    assert told["noop"]["p_solved"] == told["noop"]["p_success"] == pytest.approx(2 / 2**7), "all signs but two"
