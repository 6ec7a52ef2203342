"""Boards judged in workers: kept as they are finished, and none is judged twice."""

from collections.abc import Callable
from pathlib import Path

import pytest
from pydantic import BaseModel

from busybot.common.atomic_io import read_json
from busybot.common.errors import BusybotError
from busybot.evaluation import results
from busybot.evaluation.folder import (
    BOARDS,
    RESULT,
    SETTINGS,
    BoardWork,
    EvaluationRecording,
    conclude,
    judge_boards,
)
from tests.episodes.folders import COLLECT, make_dataset

BROKEN = 3


class Counted(BaseModel):
    """A judged board."""

    board: int
    value: int


def make(factor: int) -> Callable[[int], Counted]:
    """Judges boards until one breaks."""

    def work(index: int) -> Counted:
        if factor < 0 and index == BROKEN:
            raise BusybotError(f"board {index} is damaged", "restore it")
        return Counted(board=index, value=abs(factor) * index)

    return work


@pytest.mark.long
def test_boards_come_in_their_order_whatever_the_workers_and_interruptions(tmp_path: Path) -> None:
    boards, told = (4, 0, 2, BROKEN), []
    with pytest.raises(BusybotError, match="board 3 is damaged"):
        judge_boards(boards, BoardWork(Counted, make, (-10,), 1), {"scale": 10}, out=tmp_path)
    lines = (tmp_path / BOARDS).read_text()
    assert lines.count("\n") == 3
    (tmp_path / BOARDS).write_text(lines + '{"board": 3, "val')  # killed while writing a line
    work = BoardWork(Counted, make, (10,), 2)
    judged = judge_boards(boards, work, {"scale": 10}, lambda *two: told.append(two), tmp_path)
    assert [(one.board, one.value) for one in judged] == [(4, 40), (0, 0), (2, 20), (3, 30)] and told == [(4, 4)]
    assert judged == judge_boards(boards, work, {"scale": 10})
    assert (tmp_path / BOARDS).read_text().startswith(lines) and (tmp_path / BOARDS).read_text().count("\n") == 4


def test_one_that_was_killed_at_its_first_file_goes_on(tmp_path: Path) -> None:
    """And what is told of progress is of the boards that are wanted."""
    left = tmp_path / ".settings.json.999999999-0123456789abcdef.tmp"
    left.write_bytes(b"{")
    told: list[tuple[int, int]] = []
    for boards in ((0, 1, 2), (4,)):
        judge_boards(boards, BoardWork(Counted, make, (1,), 1), {}, lambda *two: told.append(two), tmp_path)
    assert not left.exists() and told[-1] == (1, 1) and sorted(told[:-1]) == [(1, 3), (2, 3), (3, 3)]


def test_boards_that_other_code_judged_are_not_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether other settings differ, too, or the folder is of a version that did not tell."""
    work, before = BoardWork(Counted, make, (1,), 1), tmp_path / "before"
    for out in (tmp_path / "out", before):
        judge_boards((0,), work, {"busybot": "1"}, out=out)
    assert read_json(before / SETTINGS)["versions"]["code"]
    (before / SETTINGS).write_text('{"busybot": "1", "versions": "1"}')
    with pytest.raises(BusybotError, match="another version of busybot"):
        judge_boards((0, 1), work, {"busybot": "1"}, out=before)
    monkeypatch.setattr(results, "code_digest", lambda: "other")
    for busybot in ("1", "2"):
        with pytest.raises(BusybotError, match="another version of busybot"):
            judge_boards((0, 1), work, {"busybot": busybot}, out=tmp_path / "out")
    assert len(judge_boards((0, 1), work, {"busybot": "2"}, out=tmp_path / "new")) == 2


def test_a_result_is_what_its_file_says(tmp_path: Path) -> None:
    assert conclude(tmp_path, {"share": 0.5, "pair": (1, 2)}) == read_json(tmp_path / RESULT)
    assert conclude(None, {"pair": (1, 2)}) == {"pair": [1, 2]}


def test_lines_that_are_no_judgements_are_named(tmp_path: Path) -> None:
    judge_boards((), BoardWork(Counted, make, (1,), 1), {}, out=tmp_path)
    (tmp_path / BOARDS).write_text('{"board": 0, "value": 1}\n{"board": "first"}\n')
    with pytest.raises(BusybotError, match="line 2"):
        judge_boards((0,), BoardWork(Counted, make, (1,), 1), {}, out=tmp_path)


def test_a_file_in_the_place_of_recordings_is_refused_by_its_name(tmp_path: Path) -> None:
    notes = tmp_path / "notes.txt"
    notes.write_text("mine")
    recording = EvaluationRecording(notes, make_dataset(tmp_path / "toys", boards=1, finished=()), COLLECT)
    with pytest.raises(BusybotError, match="notes.txt"):
        judge_boards((0,), BoardWork(Counted, make, (1,), 1), {}, recordings=[recording])
    assert notes.read_text() == "mine"
