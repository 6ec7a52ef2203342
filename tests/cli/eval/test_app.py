"""`busybot eval reason`, as a user runs it."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from busybot.cli.main import app
from busybot.common.errors import BusybotError
from busybot.episodes.mcap.writer import write_episode
from busybot.interact.affordance.load import load_model
from busybot.plan.learning.network import read_policy
from busybot.training.model_cards import PACKAGE
from tests.cli.commands import busybot
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode, make_real_episode

PRETRAINED = PACKAGE / "pretrained"

KEYS = {
    "edge_p", "edge_r", "edge_acc", "edge_r_bound", "pred_a", "pred_a_responder", "pred_a_bound", "ece", "brier",
    "boards", "macro", "intervals", "baselines", "by_kind", "by_images", "policy", "dataset", "command", "seed",
    "versions",
}  # fmt: skip


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    return make_dataset(tmp_path / "toys").path


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["eval", "reason", *map(str, arguments)])


def test_json_is_one_object_with_the_metrics(dataset: Path) -> None:
    result = run(dataset, "--reasoner", "count", "--json")
    assert result.exit_code == 0
    values = json.loads(result.stdout)
    assert set(values) >= KEYS
    assert (values["boards"], values["edge_p"], values["pred_a"]) == (3, 1.0, None)
    assert values["edge_r"] == values["edge_r_bound"]
    assert len(values["dataset"]["content_hash"]) == 64
    assert values["command"].startswith("busybot eval reason")


def test_out_gets_the_same_object(dataset: Path, tmp_path: Path) -> None:
    result = run(dataset, "--json", "--out", tmp_path / "results" / "reason.json")
    assert json.loads((tmp_path / "results" / "reason.json").read_text()) == json.loads(result.stdout)


def test_several_reasoners_get_a_file_each_as_if_judged_alone(dataset: Path, tmp_path: Path) -> None:
    names = ("count", "persistence")
    files = [tmp_path / f"{name}.json" for name in names]
    asked = [word for name, file in zip(names, files, strict=True) for word in ("--reasoner", name, "--out", file)]
    result = run(dataset, *asked, "--workers", "1", "--json")
    together = [json.loads(file.read_text()) for file in files]
    assert json.loads(result.stdout)["results"] == together
    for name, told in zip(names, together, strict=True):
        assert told == json.loads(run(dataset, "--reasoner", name, "--workers", "1", "--json").stdout)
    shown = run(dataset, "--reasoner", "count", "--reasoner", "persistence", "--workers", "1").stdout
    assert shown.index("count:") < shown.index("persistence:")


def test_people_see_the_trivial_graphs_beside_it(dataset: Path) -> None:
    result = run(dataset, "--reasoner", "count")
    assert result.exit_code == 0
    for text in ("count", "empty graph", "all-ones graph", "random trigger", "Edge-P", "100.0", "one-to-one (6)"):
        assert text in result.stdout


def test_parameters_can_be_set(dataset: Path) -> None:
    values = json.loads(run(dataset, "--reasoner", "count", "--json", "--set", "change.tolerance=254").stdout)
    assert values["config"]["change"]["tolerance"] == 254
    assert (values["edge_p"], values["edge_r"]) == (None, 0.0)


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("--reasoner", "oracle"), 1, "oracle: no model of that name"),
        (("--set", "noise=3"), 2, "parameter noise"),
        (("--images", "1"), 2, "--images"),
        (("--reasoner", "count", "--reasoner", "pc", "--out", "one.json"), 2, "one --out for each --reasoner"),
        (("--reasoner", "count", "--reasoner", "pc", "--graphs", "folder"), 2, "--graphs is about one reasoner"),
        (("--reasoner", "count", "--reasoner", "pc", "--out", "a.json", "--out", "a.json"), 2, "names a file twice"),
        (("--graph", "graphs", "--reasoner", "count"), 2, "--graph judges graphs that are there"),
        (("--graph", "graphs", "--set", "claimed=0.9"), 2, "leave --reasoner, --config and --set out"),
        (("--reasoner", "count", "--out", "s3://bucket/r.json"), 2, "an address, and this is a path"),
    ],
)
def test_what_cannot_be_is_refused(dataset: Path, arguments: tuple[str, ...], code: int, message: str) -> None:
    result = run(dataset, *arguments)
    assert result.exit_code == code
    assert message in result.stderr


def test_a_folder_that_is_no_dataset_is_refused(tmp_path: Path) -> None:
    result = run(tmp_path, "--json")
    assert result.exit_code == 1
    assert "not a dataset" in json.loads(result.stdout)["error"]


def test_a_reasoner_predicts_and_its_table_shows_it(dataset: Path, tmp_path: Path) -> None:
    """Three later steps on each board, the last of which takes hold of nothing."""
    picture = tmp_path / "curve.png"
    result = run(dataset, "--reasoner", "persistence", "--images", "4", "--workers", "1", "--figure", picture)
    assert result.exit_code == 0
    for text in ("persistence", "Pred-A: 9 later steps on 3 boards", "33.3", "bound, failures known", "nothing held"):
        assert text in result.stdout
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_the_command_names_everything_that_decided_the_result(dataset: Path) -> None:
    told = json.loads(run(dataset, "--reasoner", "lookup", "--images", "7", "--set", "reach=0.3", "--json").stdout)
    assert told["command"].endswith("--reasoner lookup --images 7 --seed 0 --set reach=0.3")
    assert told["config"]["reach"] == 0.3 and told["encoder"] == "embedded"


def test_without_what_if_everything_else_is_told_alike(tiny: Path) -> None:
    given = ("--reasoner", "lookup", "--images", "4", "--workers", "1", "--json")
    whole, less = (json.loads(run(tiny, *given, *more).stdout) for more in ((), ("--no-what-if",)))
    assert less["command"] == f"{whole['command']} --no-what-if"
    assert whole["what_if"] is not None and less["what_if"] is None and less["mechanism_accuracy"] is None
    same = ("edge_p", "edge_r", "pred_a", "intervals", "ece", "by_images")
    assert {name: whole[name] for name in same} == {name: less[name] for name in same}


def test_boxes_may_be_proposed(dataset: Path) -> None:
    given = ("--reasoner", "count", "--images", "4", "--boxes", "proposed", "--workers", "1")
    told = json.loads(run(dataset, *given, "--json").stdout)
    assert told["command"].endswith("--reasoner count --images 4 --seed 0 --boxes proposed")
    assert told["boxes"] == "proposed" and 0 <= told["proposal_r"] <= 1
    assert "objects proposed: " in run(dataset, *given).stdout


def test_a_folder_for_a_file_is_refused_before_the_work(dataset: Path, tmp_path: Path) -> None:
    for option in ("--out", "--figure"):
        result = run(dataset, "--reasoner", "count", option, tmp_path)
        assert result.exit_code == 1
        assert f"{option} names a file" in result.stderr
        assert "inferring" not in result.stderr


def test_curves_that_are_none_are_not_drawn(dataset: Path, tmp_path: Path) -> None:
    (tmp_path / "g.json").write_text('{"edges": []}')
    refused = run(dataset, "--graph", tmp_path / "g.json", "--figure", tmp_path / "f.png")
    assert refused.exit_code == 2 and "tell no earlier ones" in refused.stderr
    short = make_dataset(tmp_path / "short", boards=1, finished=())
    write_episode(short.episode_path(0), make_episode(0, steps=0))
    short.write_tables()
    done = run(short.path, "--reasoner", "count", "--workers", "1", "--figure", tmp_path / "f.png")
    assert done.exit_code == 0 and "f.png was not drawn: no score" in done.stderr
    assert not (tmp_path / "f.png").exists()


def test_images_that_no_recording_has_are_told(dataset: Path, tmp_path: Path) -> None:
    file = tmp_path / "reason.json"
    shown = run(dataset, "--reasoner", "count", "--images", 500, "--out", file).stdout
    used = json.loads(file.read_text())["images_used"]
    assert 2 <= used < 500
    assert f"{used} of 500" in " ".join(shown.split())
    assert "no step is left to predict" in shown


def test_why_nothing_is_predicted_is_told_as_it_is(tmp_path: Path) -> None:
    """Steps follow what was observed; their states nobody knows."""
    real = make_dataset(tmp_path / "real", boards=1, finished=(), split="real")
    write_episode(real.episode_path(0), make_real_episode(0, steps=6))
    real.write_tables()
    shown = run(real.path, "--reasoner", "count", "--images", 4, "--workers", "1").stdout
    assert "no recording tells the states of a step after its first 4 images" in shown and "at most" not in shown


def test_a_recording_in_which_nothing_moved_is_told_of(tmp_path: Path) -> None:
    still, hint = make_dataset(tmp_path / "still", boards=1, finished=()), "collect --policy learned"
    episode = make_episode(0)
    steps = [
        replace(
            step, success=False, acted_object=-1, acted_link="", trigger_states_after=step.trigger_states_before,
            responder_states_after=step.responder_states_before,
        )
        for step in episode.steps
    ]  # fmt: skip
    write_episode(still.episode_path(0), replace(episode, steps=steps))
    still.write_tables()
    told = run(still.path, "--reasoner", "count", "--workers", "1").stderr
    assert "no recorded action moved anything" in told and hint in told
    moved = make_dataset(tmp_path / "moved", boards=1, finished=[0]).path
    assert "moved anything" not in run(moved, "--reasoner", "count", "--workers", "1").stderr


def test_boards_that_are_not_recorded_yet_are_told_of(tmp_path: Path) -> None:
    part = make_dataset(tmp_path / "part", boards=3, finished=[0, 2]).path
    told = run(part, "--reasoner", "count", "--workers", "1").stderr
    assert "2 of 3 boards are recorded" in told and f"busybot collect {part}" in told
    whole = make_dataset(tmp_path / "whole", boards=1, finished=[0]).path
    assert "boards are recorded" not in run(whole, "--reasoner", "count", "--workers", "1").stderr


def test_a_folder_of_another_skill_is_called_what_it_is(dataset: Path) -> None:
    folders = {name: PRETRAINED / skill / name for skill, name in (("reason", "event"), ("interact", "procedural"))}
    told = run(dataset, "--reasoner", folders["procedural"]).stderr
    assert "procedural is an interaction model; here a model of relations is needed" in told
    with pytest.raises(BusybotError, match="event is a model of relations; here an interaction model is needed"):
        load_model(folders["event"])
    with pytest.raises(BusybotError, match="event is a model of relations; here a policy that plans is needed"):
        read_policy(folders["event"], "bc")


@pytest.mark.parametrize(("model", "message"), [("procedural", "an interaction model"), ("nix", "no model of that")])
def test_a_model_of_another_skill_is_not_called_unknown(dataset: Path, model: str, message: str) -> None:
    assert message in run(dataset, "--reasoner", model).stderr


def test_without_a_name_boards_of_a_world_are_judged_by_the_model_that_knows_it(tmp_path: Path) -> None:
    boards = tmp_path / "boards"
    for words in (
        ("generate", boards, "--world", "gates", "--boards", 1, "--group-size", 1, "--tasks", "reach"),
        ("collect", boards, "--policy", "scripted", "--steps", 3),
    ):
        assert busybot(*words).returncode == 0
    reason = busybot("eval", "reason", boards, "--images", 3, "--no-what-if", "--json")
    assert reason.returncode == 0, reason.stderr
    told = json.loads(reason.stdout)
    assert told["model"] == "mechanism" and "--reasoner mechanism" in told["command"]
    plan = busybot("eval", "plan", boards, "--agents", "noop", "--json")
    assert plan.returncode == 0 and "--reasoner mechanism" in json.loads(plan.stdout)["command"], plan.stderr
