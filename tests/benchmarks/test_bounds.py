"""The bounds' benchmark: how boards are summed up, and what a run writes."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.studies import bounds
from benchmarks.studies.bounds import ACTIONS, TABLE_ACTIONS, Symbolic, judged, summed
from busybot.common.rng import generator
from busybot.evaluation.results import read_result
from busybot.reason.evaluation.upper_bound import Observer


@pytest.mark.long
def test_a_board_is_judged_by_what_is_more_probable_than_not() -> None:
    board = Symbolic.draw(3, generator(0, "test", 0, "draw"))
    observer = Observer(board.space, board.triggers, board.shown)
    first = judged(board, observer.belief())
    parents = sum(len(one.inputs) for one in board.causes)
    assert first[2] == first[5] == parents, "what is true does not depend on what is known"
    rng = generator(0, "test", 0, "moves")
    for _ in range(100):
        board.act(board.moves(int(rng.integers(3)))[0])
        observer.see(board.triggers, board.shown)
    last = judged(board, observer.belief())
    assert last[0] == last[1] == parents and last[6:] == [6, 6]


def test_shares_are_over_all_boards_together() -> None:
    told = np.array([[[1, 2, 4, 1, 1, 1, 3, 2]], [[3, 4, 4, 1, 1, 1, 6, 6]]], float)
    found = summed(told, np.array([6, 6]), (10,), np.random.default_rng(0))
    link = found["link"]["10"]
    assert (link["p"]["share"], link["r"]["share"]) == (4 / 6, 0.5)
    assert link["f1"]["share"] == pytest.approx(2 * 4 / (6 + 8))
    assert found["mechanism"]["10"]["share"] == 8 / 12
    low, high = found["mechanism"]["10"]["interval"]
    assert low <= 8 / 12 <= high


@pytest.mark.long
def test_a_run_writes_what_it_is_asked_for_and_keeps_the_rest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "bounds.json"

    def run(only: str) -> None:
        words = ["bounds", "--boards", "1", "--greedy", "1", "--only", only, "--out", str(out)]
        monkeypatch.setattr("sys.argv", words)
        bounds.main()

    monkeypatch.setattr(bounds, "LINKS", (3,))
    run("table")
    run("rewired")
    rows = read_result(out, "bounds")["rows"]
    assert list(rows) == ["table", "rewired"]
    assert list(rows["table"]["3"]["random"]["parents"]) == [str(number) for number in TABLE_ACTIONS]
    told = rows["rewired"]["novel-mechanism"]["greedy"]
    assert told["boards"] == 1 and list(told["link"]) == [str(number) for number in ACTIONS]
    with pytest.raises(SystemExit, match="there is no nonsense"):
        run("nonsense")
