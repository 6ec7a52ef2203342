"""The twin of the paper's real board: six wirings of three switches and three LEDs."""

import numpy as np
import pytest
from pydantic import ValidationError

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardSpec
from busybot.objects.resolve import find


def drawn(**given: object) -> list[BoardSpec]:
    return list(generate_boards(BoardConfig.model_validate({"world": "real-board", **given}), find("procedural")))


def test_six_wirings_of_one_board_have_three_relations_each_and_two_of_them_share_a_switch() -> None:
    boards = drawn()
    assert len(boards) == 6 and len({board.objects for board in boards}) == 1
    matrices = np.array([board.relation_matrix() for board in boards])
    assert (matrices.sum(axis=(1, 2)) == 3).all() and (matrices[:, :3, 3:].sum(axis=1) == 1).all()
    assert len({matrix.tobytes() for matrix in matrices}) == 6
    most = matrices.sum(axis=2).max(axis=1).tolist()
    assert most == [1, 1, 1, 1, 2, 2]
    for board, matrix in zip(boards, matrices, strict=True):
        assert [link.object for link in board.idle] == np.flatnonzero(matrix[:3].sum(axis=1) == 0).tolist()
        assert [placed.role for placed in board.objects] == ["trigger"] * 3 + ["responder"] * 3


def test_further_boards_are_other_boards_with_the_same_wirings() -> None:
    boards, fewer = drawn(boards=12, seed=3), drawn(boards=7, seed=3)
    assert boards[:7] == fewer
    assert boards[0].objects != boards[6].objects != drawn(seed=4)[0].objects
    assert boards[0].relation_matrix() == boards[6].relation_matrix()
    alone = drawn(group_size=1)
    assert len({board.objects for board in alone}) == 6


@pytest.mark.parametrize("given", [{"switches": (2, 2)}, {"links": (3, 4)}, {"tasks": "reach"}, {"relations": "any"}])
def test_what_its_boards_do_not_have_is_refused(given: dict[str, object]) -> None:
    if given == {"relations": "any"}:
        assert len(drawn(**given)) == 6
        return
    with pytest.raises(ValidationError, match="boards of its own"):
        drawn(**given)
    with pytest.raises(ValidationError, match="the world 'real-board' has no split 'novel-mechanism'"):
        drawn(split="novel-mechanism")
