"""The log of judgings: every evaluation on boards of a test set leaves a file, and nothing else does."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from busybot.boards.config import BoardConfig
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import CollectInfo
from busybot.evaluation import judgements
from busybot.evaluation.judgements import log_judgement
from busybot.objects.resolve import find
from busybot.reason.evaluation.play import TextGames, play_boards
from tools import judgements as page

REPOSITORY = Path(__file__).resolve().parents[2]
RESULT = {"kind": "reason", "hashes": {"models": {"m": {"weights": "ab"}}}, "seed": 3, "commit": "c", "parent_f1": 0.5}


@pytest.fixture(scope="module")
def boards(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    config = BoardConfig(world="gates", split="novel-config", boards=3, group_size=1, seed=5)
    return create_dataset(tmp_path_factory.mktemp("data") / "boards", config, find("procedural"))


@pytest.fixture
def checkout(tmp_path: Path, boards: Dataset, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository whose test set has the first two of the boards; the third is on validation."""
    digests = [board.digest()[: judgements.DIGITS] for board in boards.boards()]
    sets = {"novel-config": digests[:2], "validation": digests[2:]}
    cards = {name: {"board_digests": " ".join(told)} for name, told in sets.items()}
    (tmp_path / judgements.SETS).mkdir(parents=True)
    card = {"world": "gates", "objects": {"made": cards}}
    (tmp_path / judgements.SETS / "gates.json").write_text(json.dumps(card))
    (tmp_path / ".git").write_text("gitdir: elsewhere")
    monkeypatch.setattr(judgements, "ROOT", tmp_path)
    return tmp_path


def entries(checkout: Path) -> list[dict[str, Any]]:
    return [json.loads(file.read_text()) for file in sorted((checkout / judgements.LOG).glob("*"))]


def enter(boards: Dataset, numbers: Sequence[int] = (0, 1, 2), who: str = "m", **values: Any) -> str | None:
    return log_judgement(boards, numbers, who, RESULT | values)


def test_settings_of_another_form_hinder_no_entry(checkout: Path, boards: Dataset) -> None:
    for settings in ({"render": 1}, {"render": {"camera": "real"}}):
        collect = CollectInfo(policy="random", steps=1, settings=settings)
        assert enter(Dataset(boards.path, boards.info.model_copy(update={"collect": collect})))
    assert [one["recordings"]["camera"] for one in entries(checkout)] == [{}, {}]


def test_each_judging_of_a_test_set_is_entered(checkout: Path, boards: Dataset) -> None:
    names = {enter(boards), enter(boards), enter(boards, (1,), who="other", parent_f1=0.75)}
    assert len(names) == 3 and names == {file.name for file in (checkout / judgements.LOG).iterdir()}
    told = entries(checkout)
    assert [one["sets"] for one in told] == [{"gates/novel-config": {"made": count}} for count in (2, 2, 1)]
    assert told[0]["model"] == told[1]["model"] != told[2]["model"] and told[2]["figures"] == {"parent_f1": 0.75}
    assert (told[0]["who"], told[0]["seed"], told[0]["commit"], told[0]["kind"]) == ("m", 3, "c", "reason")


def test_what_a_real_camera_saw_is_told_apart(checkout: Path, boards: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    enter(boards)
    seen = {"render": {"camera": {"noise": 0.01, "hand": 0.0}}}
    collect = CollectInfo(policy="learned", steps=30, settings=seen)
    monkeypatch.setattr(boards, "info", boards.info.model_copy(update={"collect": collect}))
    enter(boards)
    clean, real = entries(checkout)
    assert clean["recordings"] is None
    assert (real["recordings"]["policy"], real["recordings"]["camera"]) == ("learned", {"noise": 0.01})
    acted = [line.split("|")[4].strip() for line in page.test_sets(checkout).splitlines()[2:]]
    assert acted == ["-", "learned, a real camera"]


def test_other_weights_are_another_model(checkout: Path, boards: Dataset) -> None:
    enter(boards)
    enter(boards, hashes={"models": {"m": {"weights": "cd"}}})
    first, second = entries(checkout)
    assert first["model"] != second["model"]


def test_boards_of_no_test_set_leave_nothing(checkout: Path, boards: Dataset) -> None:
    assert enter(boards, (2,)) is None and enter(boards, ()) is None and entries(checkout) == []
    (checkout / ".git").unlink()
    assert enter(boards) is None and entries(checkout) == [], "not in a checkout"


def test_a_log_that_cannot_be_written_loses_no_result(checkout: Path, boards: Dataset) -> None:
    (checkout / judgements.LOG).write_text("a file")
    assert enter(boards) is None


def test_a_program_that_plays_is_entered_with_the_files_of_its_command(checkout: Path, boards: Dataset) -> None:
    program = checkout / "agent.py"
    program.write_text("import sys\nsys.stdin.readline()\nprint('{\"know\": []}')\n")
    models = []
    for _ in range(2):
        played = play_boards(TextGames(boards, find("procedural"), ("python", str(program)), actions=1, boards=2))
        assert played["parent_r"] == 0 and played["logged"] is not None
        models.append(entries(checkout)[-1])
        program.write_text(program.read_text() + "# another one\n")
    assert [one["kind"] for one in models] == ["play", "play"] and models[0]["model"] != models[1]["model"]
    assert list(models[0]["models"]) == [f"python {program}"]


def test_the_sets_of_the_repository_are_known(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The first boards of a frozen set, drawn anew, are recognised."""
    from datasets.worlds import config_of

    drawn = create_dataset(tmp_path / "set", config_of("gates", "novel-config", 2), find("procedural"))
    assert judgements.judged_sets(drawn, range(2)) == {"gates/novel-config": {"procedural": 2}}
    validation = create_dataset(tmp_path / "validation", config_of("gates", "validation", 2), find("procedural"))
    assert judgements.judged_sets(validation, range(2)) == {}


def test_the_page_counts_judgings(checkout: Path, boards: Dataset) -> None:
    assert page.test_sets(checkout) == page.NONE
    enter(boards)
    enter(boards, parent_f1=0.25)
    enter(boards, (1,), who="other")
    lines = [line.split(" | ") for line in page.test_sets(checkout).splitlines()[2:]]
    assert [line[:3] + line[5:7] for line in lines] == [
        ["| `gates/novel-config`", "made", "reason: m", "2", "2"],
        ["| `gates/novel-config`", "made", "reason: other", "1", "1"],
    ]
    assert lines[0][-1] == "F1 of parents 25.0 |", "the last time"


def test_the_page_has_a_line_for_models_that_were_judged_together(checkout: Path, boards: Dataset) -> None:
    for seed, parent_f1 in enumerate((0.5, 0.75, 0.25)):
        enter(boards, hashes={"models": {"m": {"weights": f"seed {seed}"}}}, parent_f1=parent_f1)
    enter(boards, (1,), hashes={"models": {"m": {"weights": "alone"}}})
    alone, together = (line.split(" | ") for line in page.test_sets(checkout).splitlines()[2:])
    assert (alone[4].count("`"), together[4].count("`")) == (2, 6), "hashes"
    assert alone[6] == "1" and together[6] == "2", "on as many boards"
    assert alone[-1] == "F1 of parents 50.0 |" and together[-1] == "F1 of parents 25.0-75.0 |"


def test_models_that_were_judged_at_another_hour_have_a_line_of_their_own(checkout: Path, boards: Dataset) -> None:
    for seed, when in enumerate(("07:13:00", "07:13:02", "15:17:00")):
        logged = enter(boards, hashes={"models": {"m": {"weights": f"seed {seed}"}}})
        file = checkout / judgements.LOG / str(logged)
        file.write_text(json.dumps(json.loads(file.read_text()) | {"when": f"2026-11-30T{when}Z"}))
    lines = [line.split(" | ") for line in page.test_sets(checkout).splitlines()[2:]]
    assert [line[4].count("`") for line in lines] == [4, 2], "hashes"
