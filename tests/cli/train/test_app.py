"""`busybot train interact`, as a user runs it, on rounds that were recorded before."""

import json
import os
import re
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from busybot.cli.main import app
from busybot.datasets.dataset import Dataset
from busybot.interact.affordance.load import load_model
from busybot.interact.policy.config import STRICT_POLICY
from busybot.interact.training.paper import PaperAffordanceLearner
from busybot.interact.training.sample_cache import Samples
from busybot.training.run_folder import read_metrics
from tests.cli.killing import kill_once, kill_once_it_learns
from tests.episodes.folders import make_dataset
from tests.interact.trainings import SMALL, make_rounds, weights

pytestmark = pytest.mark.usefixtures("in_process")

SHORT = "{boards: 1, steps: 1, position: 2, direction: 2}"
SETTINGS = [word for setting in SMALL for word in ("--set", setting)]


def arguments(out: Path, rounds: list[Path], *more: str) -> list[str]:
    data = [word for path in rounds for word in ("--data", str(path))]
    return ["train", "interact", "--out", str(out), *data, *SETTINGS, "--workers", "1", *more]


def run(*words: str) -> Result:
    return CliRunner().invoke(app, words)


@pytest.fixture
def rounds(tmp_path: Path) -> list[Path]:
    return make_rounds(tmp_path / "recorded")


@pytest.mark.long
def test_a_training_leaves_models_metrics_and_a_picture(tmp_path: Path, rounds: list[Path]) -> None:
    out = tmp_path / "run"
    result = run(*arguments(out, rounds, "--json"))
    assert result.exit_code == 0, result.stderr
    values = json.loads(result.stdout)
    assert [entry["samples"] for entry in values["training"]["rounds"]] == [24, 12]
    assert load_model(out).info.training == values["training"]
    assert (out / "training.png").read_bytes().startswith(b"\x89PNG")
    lines = read_metrics(out / "metrics" / "position.jsonl")
    assert [line["iteration"] for line in lines if "loss" in line] == [2, 4, 6, 8, 10, 12, 14, 16]
    assert len(weights(out)) == 6
    assert run(*arguments(out, rounds)).exit_code == 0  # nothing is left to do
    refused = run(*arguments(out, rounds, "--seed", "1"))
    assert refused.exit_code == 1 and "seed 0, now 1" in refused.stderr


def test_a_picture_that_a_kill_left_out_is_drawn(tmp_path: Path, rounds: list[Path]) -> None:
    """The last round's model was saved, and its picture was not drawn: there is none, or that of the round before."""
    words = arguments(tmp_path / "run", rounds, "--set", f"rounds=[{', '.join([SHORT] * 2)}]")
    assert run(*words).exit_code == 0
    picture = tmp_path / "run" / "training.png"
    drawn, when = picture.read_bytes(), picture.stat().st_mtime_ns
    assert run(*words).exit_code == 0 and picture.stat().st_mtime_ns == when, "it is not drawn again"
    picture.unlink()
    assert run(*words).exit_code == 0 and picture.read_bytes() == drawn
    picture.write_bytes(b"of the round before")
    before = (tmp_path / "run" / "models" / "00" / "model.json").stat().st_mtime_ns
    os.utime(picture, ns=(before, before))
    assert run(*words).exit_code == 0 and picture.read_bytes() == drawn


@pytest.mark.long
def test_the_veto_has_its_own_turning_of_crops_and_its_own_doubt(tmp_path: Path, rounds: list[Path]) -> None:
    turned, cards, vetoed = [], [], make_rounds(tmp_path / "vetoed", strict=True)
    short = ("--set", "rounds=[{boards: 1, steps: 1, position: 1, direction: 1}]")
    set_, otherwise = ("--set", "interaction.strict=true"), ("--set", "direction.augmentation.transposed=0.5")
    for number, more in enumerate(((), ("--strict",), set_, ("--strict", *otherwise))):
        out = tmp_path / str(number)
        result = run(*arguments(out, (vetoed if more else rounds)[1:], *short, *more))
        assert result.exit_code == 0, result.stderr
        turned.append(json.loads((out / "train.json").read_text())["config"]["direction"]["augmentation"]["transposed"])
        cards.append(json.loads((out / "model" / "model.json").read_text())["thresholds"])
    assert turned == [0.35, 0.0, 0.0, 0.5]
    assert cards == [{}, STRICT_POLICY, STRICT_POLICY, STRICT_POLICY]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("--strict",), r"interaction\.strict false, not true(.|\n)*train without --strict"),
        (("--set", "interaction.delta=7"), r"interaction\.delta 20, not 7(.|\n)*--set interaction\.delta=20"),
        (("--set", "render.fov_deg=50"), r"render\.fov_deg 69\.4, not 50(.|\n)*--set render\.fov_deg=69\.4"),
    ],
)
def test_rounds_that_were_recorded_otherwise_are_refused(
    tmp_path: Path, rounds: list[Path], more: tuple[str, ...], message: str
) -> None:
    """Their rewards would not be what the model's card says."""
    result = run(*arguments(tmp_path / "run", rounds, *more))
    assert result.exit_code == 1 and re.search(message, result.stderr) and not (tmp_path / "run").exists()


def test_what_no_network_reads_is_refused(tmp_path: Path, rounds: list[Path]) -> None:
    for wrong, message in (
        ("direction.jitter=5", "direction.jitter: the direction network looks at the middle"),
        ("position.dropout=0.2", "position.dropout: only the direction network has it"),
        ("position.direction_weight=1", "position.direction_weight: only the direction network has it"),
        ("direction.augmentation.colour=0.1", "direction.augmentation.colour: with inputs=depth the networks see no"),
    ):
        result = run(*arguments(tmp_path / "run", rounds, "--set", wrong))
        assert result.exit_code == 2 and message in " ".join(result.stderr.split())
        assert not (tmp_path / "run").exists()


def test_boards_for_judging_are_named_and_told_on_the_card(tmp_path: Path) -> None:
    data = make_dataset(tmp_path / "data", finished=range(4), split="novel-object").path
    result = run(*arguments(tmp_path / "run", [data]))
    assert result.exit_code == 0 and "its boards are of the split novel-object" in " ".join(result.stderr.split())
    assert [told["split"] for told in load_model(tmp_path / "run").info.training["rounds"]] == ["novel-object"]


@pytest.mark.long
def test_a_training_goes_on_with_its_own_data_alone(tmp_path: Path, rounds: list[Path]) -> None:
    assert run(*arguments(tmp_path / "run", rounds)).exit_code == 0
    copied = [Path(shutil.copytree(path, tmp_path / "copy" / path.name)) for path in rounds]
    assert run(*arguments(tmp_path / "run", copied)).exit_code == 0
    refused = run(*arguments(tmp_path / "run", rounds[::-1]))
    assert refused.exit_code == 1 and "a training with other parameters was begun there: data " in refused.stderr


@pytest.mark.long
def test_killed_and_continued_it_ends_in_the_same_weights(tmp_path: Path, rounds: list[Path]) -> None:
    straight, killed = tmp_path / "straight", tmp_path / "killed"
    assert run(*arguments(straight, rounds)).exit_code == 0
    kill_once_it_learns(arguments(killed, rounds), killed / "metrics" / "position.jsonl")
    assert not (killed / "model").exists()
    assert run(*arguments(killed, rounds)).exit_code == 0
    assert weights(killed) == weights(straight)


@pytest.mark.long
def test_killed_while_it_collects_by_its_model_it_ends_in_the_same_weights(tmp_path: Path) -> None:
    """Both rounds are recorded by the training itself, the second one by the model of the first."""
    rounds = (
        "rounds=[{boards: 2, steps: 4, position: 4, direction: 4}, {boards: 4, steps: 2, position: 4, direction: 4}]"
    )
    settings = ("--set", rounds, *SETTINGS[2:], "--assets", "procedural", "--workers", "1")
    straight, killed = tmp_path / "straight", tmp_path / "killed"
    commands = {out: ["train", "interact", "--out", str(out), *settings] for out in (straight, killed)}
    assert run(*commands[straight]).exit_code == 0
    kill_once(commands[killed], lambda: any((killed / "rounds" / "01" / "episodes").glob("*.mcap")))
    assert not (killed / "model").exists()
    result = run(*commands[killed])
    assert result.exit_code == 0, result.stderr
    assert weights(killed) == weights(straight)
    for index in ("00", "01"):
        hashes = [Dataset.open(out / "rounds" / index).hashes().content for out in (straight, killed)]
        assert hashes[0] == hashes[1]


@pytest.mark.long
def test_offline_it_repeats_the_training_from_the_recorded_rounds(tmp_path: Path, rounds: list[Path]) -> None:
    """Wherever the rounds lie, and whatever the number of workers."""
    first, copy = tmp_path / "first", tmp_path / "copy"
    assert run(*arguments(first, rounds)).exit_code == 0
    shutil.copytree(rounds[0].parent, copy / "rounds")
    again = run("train", "interact", "--out", str(copy), "--offline", *SETTINGS, "--workers", "2")
    assert again.exit_code == 0, again.stderr
    assert weights(copy) == weights(first)


def test_offline_without_recorded_rounds_says_so(tmp_path: Path) -> None:
    result = run("train", "interact", "--out", str(tmp_path / "run"), "--offline", *SETTINGS)
    assert result.exit_code == 1
    assert "no folder `rounds`" in result.stderr and not (tmp_path / "run").exists()


@pytest.mark.parametrize("model", ["fast", "paper"])
def test_a_dataset_without_episodes_is_refused_before_anything_is_written(tmp_path: Path, model: str) -> None:
    made = run("generate", str(tmp_path / "empty"), "--boards", "2", "--assets", "procedural")
    assert made.exit_code == 0, made.stderr
    epochs = ("--set", "epochs=1") if model == "paper" else ()
    words = ("--variant", model, "--out", str(tmp_path / "run"), "--data", str(tmp_path / "empty"), *epochs)
    result = run("train", "interact", *words)
    assert result.exit_code == 1 and "0 of 2 episodes" in result.stderr
    assert not (tmp_path / "run").exists()


def test_objects_are_refused_where_nothing_is_collected(tmp_path: Path, rounds: list[Path]) -> None:
    result = run(*arguments(tmp_path / "run", rounds, "--assets", "procedural"))
    assert result.exit_code == 2 and "--assets procedural: nothing is collected" in result.stderr


def test_more_datasets_than_rounds_are_refused(tmp_path: Path, rounds: list[Path]) -> None:
    result = run(*arguments(tmp_path / "run", [*rounds, rounds[0]]))
    assert result.exit_code == 1
    assert "3 datasets for 2 rounds" in result.stderr


def test_a_folder_with_other_things_is_left_alone(tmp_path: Path, rounds: list[Path]) -> None:
    (tmp_path / "thesis.txt").write_text("precious")
    result = run(*arguments(tmp_path, rounds))
    assert result.exit_code == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["recorded", "thesis.txt"]


def test_a_file_in_place_of_the_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    result = run("train", "interact", "--out", str(tmp_path / "file"), *SETTINGS)
    assert result.exit_code == 1 and "it is a file" in result.stderr and "hint:" in result.stderr


def test_variants_are_known_by_name(tmp_path: Path) -> None:
    result = run("train", "interact", "--out", str(tmp_path / "run"), "--variant", "slow")
    assert result.exit_code == 2 and "'slow' is not one of" in result.stderr
    assert not (tmp_path / "run").exists()


TINY = """
epochs: 3
boards: 3
steps: 16
random_epochs: 0
all_directions_epochs: 1
joint_epochs: 1
threads: 1
position: {batch: 2, iterations: 1, epsilon_epochs: 1}
direction: {batch: 2, iterations: 1, epsilon_epochs: 1}
render: {width: 160, height: 120}
interaction: {reward: joints}
"""


train_learner = PaperAffordanceLearner.train


def dies_in_epoch_two(self: PaperAffordanceLearner, samples: Samples, epoch: int) -> None:
    if epoch == 2:
        raise KeyboardInterrupt
    train_learner(self, samples, epoch)


@pytest.mark.long
def test_the_paper_variant_collects_trains_is_judged_and_collects_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, file = tmp_path / "run", tmp_path / "tiny.yaml"
    file.write_text(TINY)

    def train(folder: Path) -> Result:
        return run("train", "interact", "--variant", "paper", "--out", str(folder), "--config", str(file))

    assert train(out).exit_code == 0
    assert len(read_metrics(out / "metrics" / "direction.jsonl")) == 2
    last = Dataset.open(out / "rounds" / "002").info.collect
    assert last is not None and last.policy == "explore-paper"
    assert last.settings["chooser"]["explore"]["epsilon_direction"] == pytest.approx(0.1)
    assert last.settings["chooser"]["model"]["card"]["training"]["epochs"] == 2
    killed = tmp_path / "killed"
    with monkeypatch.context() as patched:  # killed when the last epoch was half collected
        patched.setattr(PaperAffordanceLearner, "train", dies_in_epoch_two)
        assert train(killed).exit_code != 0
    (killed / "rounds" / "002" / "episodes" / "000001.mcap").unlink()
    assert train(killed).exit_code == 0 and weights(killed) == weights(out)
    data, small = str(tmp_path / "data"), ("--set", "render.width=160", "--set", "render.height=120")
    assert run("generate", data, "--boards", "1", "--split", "novel-config").exit_code == 0
    model = ("--model", str(out), "--workers", "1", *small)
    judged = run("eval", "interact", data, *model, "--set", "actions=3", "--json")
    assert judged.exit_code == 0, judged.stderr
    assert json.loads(judged.stdout)["provenance"]["mode"] == "ucb"
    assert run("collect", data, "--policy", "learned", "--steps", "2", *model).exit_code == 0
    assert Dataset.open(Path(data)).finished() == {0}
