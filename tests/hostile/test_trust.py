"""One small case of each class of attacks, and that nobody goes round the one place that closes it."""

import ast
import errno
import io
import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from busybot.cli.common import console, print_json, say, tell
from busybot.common import limits
from busybot.common.atomic_io import parse_json, read_regular
from busybot.common.errors import BusybotError, explained
from busybot.common.text import plain, unlinked
from busybot.datasets.dataset import Dataset
from busybot.datasets.freeze import freeze
from busybot.datasets.summary import summarise
from busybot.episodes.episode import Camera
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.episodes.validation import check_camera
from busybot.reason.inputs.feature_store import features_of
from busybot.training.checkpoint import network_with
from busybot.training.model_cards import ModelCard, read_info
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_camera, make_episode
from tests.hostile.damage import TEXTS
from tests.hostile.recordings import record_bomb
from tests.hostile.targets import TARGETS, _answers, _exchangeable, exchange

PACKAGE = Path(__file__).resolve().parents[2] / "busybot"
PRINTS = {"cli/common.py", "datasets/importing/sealed_reader.py", "sim/vulkan_check.py", "training/run_folder.py"}
"""What prints: the command line's own functions, child processes that answer in JSON, the progress of a training."""


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    return make_dataset(tmp_path / "d", boards=2, finished=(0, 1))


def test_a_recording_of_the_same_size_is_told_from_the_one_before(dataset: Dataset) -> None:
    """Only the checksum at its end differs."""
    file, distances = dataset.episode_path(0), np.random.default_rng(0).random(100)

    def record(distance: float) -> int:
        episode = make_episode(0)
        episode.steps[0] = replace(episode.steps[0], distance=float(distance))
        return write_episode(file, episode)

    record(distances[0])
    dataset.write_tables()
    facts, before = file.stat(), dataset.hashes()
    assert any(record(distance) == facts.st_size for distance in distances[1:])
    os.utime(file, ns=(facts.st_atime_ns, facts.st_mtime_ns))
    assert file.stat().st_size == facts.st_size
    again = Dataset.open(dataset.path)
    assert again.hashes().content != before.content and again.hashes().board == before.board
    with pytest.raises(BusybotError, match="not made of the episodes"):
        again.table("steps")


@pytest.mark.long
def test_a_frozen_dataset_with_another_recording_is_no_frozen_dataset(dataset: Dataset) -> None:
    freeze(dataset.path, None)
    for path in (dataset.path, dataset.path / "episodes", dataset.episode_path(0)):
        path.chmod(0o755)
    write_episode(dataset.episode_path(0), make_episode(0, steps=5))
    with pytest.raises(BusybotError, match=r"000000.mcap: the dataset is frozen, but"):
        summarise(dataset.path)


def test_the_recording_of_another_board_is_refused(dataset: Dataset) -> None:
    write_episode(dataset.episode_path(0), make_episode(1))
    with pytest.raises(BusybotError, match="000000.mcap: its board is not board 0"):
        dataset.hashes()


def test_features_of_other_pictures_are_computed_again(dataset: Dataset, tmp_path: Path) -> None:
    store = features_of(dataset, workers=1)
    first, second = (store.folder / name for name in sorted(os.listdir(store.folder)))
    expected = np.array(store[0])
    first.write_bytes(second.read_bytes())
    again = features_of(dataset, workers=1)
    assert again.new == 1 and np.array_equal(again[0], expected)
    damaged = bytearray(first.read_bytes())
    damaged[-3000] ^= 1
    first.write_bytes(damaged)
    with pytest.raises(BusybotError, match="changed since it was written"):
        again[0]
    again = features_of(dataset, workers=1)
    assert again.new == 1 and np.array_equal(again[0], expected)


@pytest.mark.long
@pytest.mark.parametrize("number", range(6))
def test_exchanged_and_edited_files_lead_to_no_wrong_answer(tmp_path: Path, number: int) -> None:
    _exchangeable(tmp_path)
    exchange(tmp_path, np.random.default_rng(number))
    assert _answers(tmp_path) in (True, "noticed")


@pytest.mark.parametrize("seed", range(3))
def test_bombs_are_refused_before_they_burst(dataset: Dataset, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    file = dataset.episode_path(0)
    file.write_bytes(record_bomb(file.read_bytes(), np.random.default_rng(seed)))
    assert file.stat().st_size < 1 << 20
    with pytest.raises(BusybotError, match="000000.mcap: more than"):
        monkeypatch.setattr(limits.Budget, "__init__", _small_budget)
        read_episode(file)


def _small_budget(self: limits.Budget) -> None:
    self.bytes, self.records, self.until = 50 << 20, 10_000, float("inf")


def _sparse(path: Path) -> None:
    path.touch()
    os.truncate(path, 1 << 40)


@pytest.mark.parametrize("make", [os.mkfifo, Path.mkdir, _sparse])
def test_only_regular_files_of_some_size_are_opened(tmp_path: Path, make: Callable[[Path], None]) -> None:
    path = tmp_path / "x"
    make(path)
    with pytest.raises(BusybotError, match="x: "):
        read_regular(path, 1000)


@pytest.mark.parametrize("value", [0.0, 1e308, np.nan, -5.0])
@pytest.mark.parametrize("place", [(0, 0), (1, 1), (2, 2)])
def test_matrices_that_are_no_camera_s_are_refused(value: float, place: tuple[int, int]) -> None:
    camera = make_camera()
    check_camera(camera)
    for name in ("matrix", "pose"):
        changed = np.array(getattr(camera, name))
        changed[place] = value
        with pytest.raises(BusybotError, match="camera's"):
            check_camera(Camera(**{**vars(camera), name: changed}))


WRONG = {"seed": "x", "rounds": "x", "data": [1], "versions": {"a": 1}, "validation": [], "licence": 3, "f": 1e999}


@pytest.mark.parametrize("training", [{name: value} for name, value in WRONG.items()], ids=list(WRONG))
def test_a_card_with_other_types_is_refused_by_place(tmp_path: Path, training: dict[str, object]) -> None:
    (tmp_path / "model.json").write_text(json.dumps({"format": "1", "training": training}))
    with pytest.raises(BusybotError, match=r"model\.json: "):
        read_info(tmp_path, ModelCard)


def test_sizes_are_compared_before_anything_is_allocated() -> None:
    with pytest.raises(BusybotError, match="weight is \\(1, 1\\), expected \\(1000000, 1000000\\)"):
        network_with(lambda: torch.nn.Linear(10**6, 10**6, bias=False), {"weight": torch.zeros(1, 1)}, Path("w"))
    wrong = {"weight": torch.full((1, 1), torch.nan), "bias": torch.zeros(1)}
    with pytest.raises(BusybotError, match="w: weight holds NaN"):
        network_with(lambda: torch.nn.Linear(1, 1), wrong, Path("w"))


@pytest.mark.parametrize("text", TEXTS)
def test_text_from_outside_is_text(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    say(text)
    tell(text)
    screen = console()
    screen.file = io.StringIO()
    screen.print(text, soft_wrap=True)
    captured = capsys.readouterr()
    for said in (captured.out, captured.err, screen.file.getvalue()):
        assert said.encode() and not any(ord(sign) < 32 and sign not in "\n\t" for sign in said)
        assert plain(text) in said
    assert "](" not in str(unlinked(text)) and BusybotError(text).what.replace("\n", "").isprintable()


def test_nobody_else_prints() -> None:
    for path in sorted(PACKAGE.rglob("*.py")):
        calls = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)]
        names = {node.func.id for node in calls if isinstance(node.func, ast.Name)}
        assert path.relative_to(PACKAGE).as_posix() in PRINTS or not names & {"print", "Console"}, path


@pytest.mark.parametrize(
    "text",
    [
        *('{"a": NaN}', "[1e999]", "-Infinity", '"\\ud800"', "9" * 5000, "{"),
        *(b'"\xed\xa0\x80"', '"\\ud800"'.encode("utf-16"), b'"\\ud800"'),
    ],
)
def test_what_is_no_json_is_refused(text: str | bytes) -> None:
    with pytest.raises(ValueError):
        parse_json(text)


def test_no_mark_turns_the_direction_of_text() -> None:
    """All that Unicode calls controls of direction."""
    marks = "\u061c\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
    assert plain(marks).isascii()


def test_pairs_of_surrogates_are_json() -> None:
    assert parse_json('"\\ud83d\\ude00"') == "\U0001f600"


def test_nan_never_reaches_json(capsys: pytest.CaptureFixture[str]) -> None:
    print_json({"a": [float("nan"), 1.5], "b": np.float64("inf"), "c": np.array([np.nan])})
    assert json.loads(capsys.readouterr().out, parse_constant=pytest.fail) == {"a": [None, 1.5], "b": None, "c": [None]}


def test_a_full_disk_is_told_with_its_place_and_room(tmp_path: Path) -> None:
    told = explained(OSError(errno.ENOSPC, "No space left on device", str(tmp_path / "a" / "b")))
    assert str(tmp_path) in told.what and "MB are free" in told.what and "make room" in str(told.hint)
    assert "memory" in explained(MemoryError()).what


def test_every_kind_of_file_has_a_class() -> None:
    assert {target.line for target in TARGETS.values()} > {"bombs", "wrong answers", "full disks", "models"}
