"""`busybot train reason`, as a user runs it."""

import hashlib
import json
from pathlib import Path
from typing import Literal

import pytest
import torch
from safetensors.torch import load_file
from typer.testing import CliRunner, Result

from busybot.boards.config import BoardConfig
from busybot.cli.main import app
from busybot.common.errors import UsageError
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.datasets.summary import _drawing, origin_of
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.objects.resolve import find
from busybot.reason.inputs.board_dataset import held_apart
from busybot.reason.inputs.feature_store import features_of
from busybot.reason.models.mechanism.config import MechanismConfig, MechanismNetConfig
from busybot.reason.models.registry import ReasonerInfo, load_reasoner
from busybot.reason.train import suited
from busybot.training.model_cards import file_hashes, read_info
from tests.cli.killing import kill_once_it_learns
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode
from tests.reason.inputs.test_observation import garbled

SMALL = ("iterations=8", "batch=2", "images=4", "net.width=8", "loop.judge=2", "loop.report=2", "loop.patience=0")
SETTINGS = [word for setting in SMALL for word in ("--set", setting)]


def run(*words: str) -> Result:
    return CliRunner().invoke(app, words)


def arguments(out: Path, *data: Path) -> list[str]:
    named = [word for path in data for word in ("--data", str(path))]
    return ["train", "reason", "--out", str(out), *named, *SETTINGS, "--workers", "1"]


def test_a_model_judged_on_the_boards_that_it_was_trained_on_is_told_of(tmp_path: Path, data: Path) -> None:
    assert run(*arguments(tmp_path / "run", data)).exit_code == 0
    fewer = make_dataset(tmp_path / "fewer", boards=2, finished=[0]).path
    other = make_dataset(tmp_path / "other", boards=2, finished=[0], split="novel-object").path
    for place, same in ((data, True), (fewer, True), (other, False)):
        judging = ("--reasoner", str(tmp_path / "run"), "--images", "4", "--no-what-if", "--workers", "1", "--json")
        done = run("eval", "reason", str(place), *judging)
        assert done.exit_code == 0 and json.loads(done.stdout)["trained_on_dataset"] is same
        assert ("was trained on these very boards" in done.stderr) is same


def test_boards_that_are_there_to_judge_are_named(tmp_path: Path, data: Path) -> None:
    assert "cannot be judged" not in run(*arguments(tmp_path / "run", data)).stderr
    done = run(*arguments(tmp_path / "other", make_dataset(tmp_path / "novel", split="novel-object").path))
    assert "novel-object; the model cannot be judged on that split honestly" in done.stderr


def test_boards_of_the_same_seed_in_another_world_are_another_drawing(data: Path) -> None:
    drawn = origin_of(Dataset.open(data))["drawing"]
    info = json.loads((data / "dataset.json").read_text())
    for changed, same in (({"boards": 9}, True), ({"world": "lock"}, False), ({"group_size": 2}, False)):
        told = info | {"generator": info["generator"] | {"config": info["generator"]["config"] | changed}}
        (data / "dataset.json").write_text(json.dumps(told))
        assert (origin_of(Dataset.open(data))["drawing"] == drawn) is same, changed


def test_a_dataset_that_grows_is_of_one_drawing(tmp_path: Path) -> None:
    """Also where its boards have more and more objects of the library."""

    def drawn(boards: int, seed: int = 3) -> Dataset:
        config = BoardConfig(boards=boards, seed=seed, group_size=1)
        return create_dataset(tmp_path / str(seed), config, find("procedural"))

    few, grown, other = drawn(2), drawn(6), drawn(2, seed=4)
    assert len(few.info.assets.sha256) < len(grown.info.assets.sha256)
    assert _drawing(few) == _drawing(grown) != _drawing(other)


def weights(out: Path) -> str:
    return hashlib.sha256((out / "model" / "weights.safetensors").read_bytes()).hexdigest()


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return make_dataset(tmp_path / "toys").path


def test_a_training_leaves_a_model_metrics_and_a_picture(tmp_path: Path, data: Path) -> None:
    out = tmp_path / "run"
    result = run(*arguments(out, data), "--json")
    assert result.exit_code == 0, result.stderr
    told = json.loads(result.stdout)["training"]
    assert (told["iterations"], told["boards"], told["boards_held_out"], told["oracle"]) == (8, 3, 0, False)
    assert told["data"][0]["content_hash"] == Dataset.open(data).hashes().content
    assert load_reasoner(out).encoder == "embedded"
    assert (out / "training.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads((out / "metrics.json").read_text())["iterations"] == 8
    assert "nothing was held out to judge the training by" in result.stderr and "--group-size" in result.stderr
    asked = run(*arguments(tmp_path / "all", data), "--set", "loop.held_out=0")
    assert asked.exit_code == 0 and "held out" not in asked.stderr
    before = weights(out)
    assert run(*arguments(out, data)).exit_code == 0 and weights(out) == before  # nothing is left to do
    refused = run(*arguments(out, data), "--seed", "1")
    assert refused.exit_code == 1 and "seed 0, now 1" in refused.stderr


def test_the_truth_makes_no_difference_to_the_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Features and sequences of recordings with everything wrong that must not be read."""
    straight, wrong = (make_dataset(tmp_path / name).path for name in ("straight", "wrong"))
    assert run(*arguments(tmp_path / "one", straight)).exit_code == 0
    read: list[Path] = []

    def read_garbled(path: Path, decoding: Literal["lazy"]) -> Episode:
        read.append(path)
        return garbled(read_episode(path))

    monkeypatch.setattr("busybot.reason.inputs.feature_store.read_episode", read_garbled)
    assert run(*arguments(tmp_path / "other", wrong)).exit_code == 0
    assert len(read) == 6, "once for the features, once for the actions"
    assert weights(tmp_path / "one") == weights(tmp_path / "other")


def test_groups_that_look_alike_are_held_out_as_a_whole(tmp_path: Path) -> None:
    datasets = [make_dataset(tmp_path / name, boards=4, finished=range(4)) for name in ("one", "same")]
    known = [features_of(dataset, workers=1) for dataset in datasets]
    train, held = held_apart(datasets, known, 0.5, 0)
    boards = datasets[0].boards()

    def groups(places: tuple[tuple[int, int], ...]) -> set[int]:
        return {boards[episode].appearance_group for _, episode in places}

    assert len(train) + len(held) == 8
    assert not groups(train.places) & groups(held.places)
    assert len(held_apart(datasets, known, 0.0, 0)[1]) == 0
    fewer, same = held_apart(datasets, known, 0.5, 0, most=2)
    assert fewer.places == train.places[:2] and same.places == held.places
    assert next(iter(train)).steps == len(read_episode(datasets[0].episode_path(train.places[0][1])).steps)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--variant", "clever"], "'clever' is not one of"),
        (["--set", "net.depth=3"], "net.depth"),
        (["--encoder", "clever"], "clever"),
    ],
)
def test_what_cannot_be_is_told(tmp_path: Path, data: Path, words: list[str], message: str) -> None:
    result = run(*arguments(tmp_path / "run", data), *words)
    assert result.exit_code == 2 and message in result.stderr


def test_what_nothing_can_be_learned_from_is_named_and_leaves_no_training(tmp_path: Path, data: Path) -> None:
    short = make_dataset(tmp_path / "short", finished=())
    for index in range(4):
        write_episode(short.episode_path(index), make_episode(index, steps=1), "jpeg")
    short.write_tables()
    out = tmp_path / "run"
    result = run(*arguments(out, short.path))
    assert result.exit_code == 1 and f"{short.path}: no board on which two steps were recorded" in result.stderr
    assert run(*arguments(out, data)).exit_code == 0, "the folder is free for another training"


def test_a_dataset_without_episodes_is_refused(tmp_path: Path) -> None:
    empty = make_dataset(tmp_path / "empty", finished=()).path
    result = run(*arguments(tmp_path / "run", empty))
    assert result.exit_code == 1 and "busybot collect" in result.stderr


@pytest.mark.long
@pytest.mark.parametrize("variant", ["event", "mechanism"])
def test_killed_and_continued_it_ends_in_the_same_weights(tmp_path: Path, data: Path, variant: str) -> None:
    """Of the `mechanism` model all that it learns from labels: also which way round links are, and unseen links."""
    ways = {name: [*arguments(tmp_path / name, data), "--set", "iterations=60"] for name in ("whole", "killed")}
    for words in ways.values():
        if variant == "mechanism":
            words[words.index("images=4")] = "drawn=2"
            words += ["--variant", variant, "--set", "net.unsteady=false"]
    assert run(*ways["whole"]).exit_code == 0
    kill_once_it_learns(ways["killed"], tmp_path / "killed" / "metrics" / f"{variant}.jsonl")
    assert not (tmp_path / "killed" / "model").exists()
    assert run(*ways["killed"]).exit_code == 0
    assert weights(tmp_path / "killed") == weights(tmp_path / "whole")


def test_the_mechanism_model_learns_from_true_parents_and_says_so(tmp_path: Path, data: Path) -> None:
    out, small = (
        tmp_path / "run",
        ("iterations=4", "batch=2", "drawn=2", "net.width=8", "loop.judge=2", "net.unsteady=false"),
    )
    settings = [word for setting in small for word in ("--set", setting)]
    command = ["train", "reason", "--variant", "mechanism", "--out", str(out), "--data", str(data), *settings]
    result = run(*command, "--workers", "1", "--json")
    assert result.exit_code == 0, result.stderr
    told = json.loads(result.stdout)["training"]
    assert (told["iterations"], told["labels"]) == (4, "true parents, and which way round links are")
    assert load_reasoner(out).name == "mechanism"
    assert load_file(out / "model" / "weights.safetensors")["unseen.weight"].any(), "the end of the training is learned"
    judged = run("eval", "reason", str(data), "--reasoner", str(out), "--images", "4", "--workers", "1", "--json")
    assert judged.exit_code == 0, judged.stderr
    assert json.loads(judged.stdout)["model"] == "mechanism"
    listed = run("models", "info", str(out))
    assert listed.exit_code == 0 and "mechanism" in listed.stdout
    net = MechanismConfig.model_validate(read_info(out / "model", ReasonerInfo).config).net
    assert (net.unsteady, net.rising, net.unseen, net.changes, net.worlds) == (False, True, True, True, ("paper",))
    assert net.families


def test_a_training_may_begin_with_a_model(tmp_path: Path, data: Path) -> None:
    """With its sizes, whatever the defaults are. Without an iteration only what is learned beside them is new."""
    few = ("batch=2", "drawn=2", "loop.judge=2", "net.unsteady=false")

    def command(out: str, *more: str) -> list[str]:
        settings = [word for one in few for word in ("--set", one)]
        told = ["--data", str(data), "--workers", "1", "--json"]
        return ["train", "reason", "--variant", "mechanism", "--out", str(tmp_path / out), *told, *settings, *more]

    first = command("first", "--set", "iterations=4", "--set", "net.width=8", "--set", "net.apart=false")
    assert run(*first).exit_code == 0
    start = ("--from", str(tmp_path / "first"))
    same = run(*command("same", "--set", "iterations=0", *start))
    assert same.exit_code == 0, same.stderr
    card = read_info(tmp_path / "same" / "model", ReasonerInfo)
    assert card.training["start"] == file_hashes(tmp_path / "first" / "model")
    net = MechanismConfig.model_validate(card.config).net
    assert (net.width, net.apart) == (8, True), "that model's sizes; what is learned beside may differ"
    one, other = (load_file(tmp_path / name / "model" / "weights.safetensors") for name in ("first", "same"))
    kept = [name for name in one if not name.startswith(("unseen.", "rising.", "change.2.", "odds."))]
    assert len(kept) > 20 and all(torch.equal(one[name], other[name]) for name in kept)
    assert other["unseen.weight"].shape != one["unseen.weight"].shape and other["unseen.weight"].any()

    on = command("on", "--set", "iterations=4", *start)
    assert run(*on).exit_code == 0
    went = load_file(tmp_path / "on" / "model" / "weights.safetensors")
    assert not any(torch.equal(one[name], went[name]) for name in ("token.1.weight", "final.0.weight"))
    elsewhere = run(*command("on", "--set", "iterations=4"))
    assert elsewhere.exit_code != 0 and "start" in elsewhere.stderr, "another beginning is another training"

    wide = run(*command("wide", "--set", "net.width=16", *start))
    assert wide.exit_code == 2 and "weights.safetensors: " in wide.stderr and "leave its sizes" in wide.stderr
    assert not (tmp_path / "wide").exists(), "or the folder would refuse the command that is right"
    alone = run(*command("alone", "--from", "mechanism", "--set", "labels=pictures"))
    assert alone.exit_code == 2 and "was taught by true parents" in alone.stderr
    event = run(*command("event", "--from", "event"))
    assert event.exit_code == 2 and "a model `event` that reads" in event.stderr
    absent = run(*command("absent", "--from", str(tmp_path / "nowhere")))
    assert absent.exit_code != 0 and "no model of that name" in absent.stderr


def test_without_labels_nothing_is_wanted_that_they_teach(data: Path) -> None:
    plain = suited(MechanismConfig(labels="pictures"), [Dataset.open(data)]).net
    assert plain.families and not (plain.changes or plain.unseen or plain.rising or plain.unsteady)
    each = MechanismConfig(labels="pictures", net=MechanismNetConfig(families=False))
    assert not suited(each, [Dataset.open(data)]).net.families
    wanting = MechanismConfig(labels="pictures", net=MechanismNetConfig(rising=True))
    with pytest.raises(UsageError, match=r"net.rising=true: only labels teach that"):
        suited(wanting, [Dataset.open(data)])
