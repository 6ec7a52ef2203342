"""The graph over the board, step by step."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from busybot.boards.true_causes import relations_at
from busybot.reason.models.base import InferredGraph
from busybot.view.annotations import truth_matrix
from busybot.view.figures.episode import refinement_figure
from busybot.view.figures.sequences import _free_corner, belief_figure
from busybot.view.palette import CORRECT, RESPONDER, TRUTH, WRONG
from tests.episodes.symbolic import library_at, make_world_episode, world_boards
from tests.episodes.synthetic import make_episode, make_real_episode
from tests.view.figures.test_episode import GUESS, has

LEGEND = 70
"""Pixels at the lower edge, in which every colour is."""


def drawn(path: Path) -> np.ndarray:
    picture = cv2.imread(str(path))
    assert picture is not None
    return np.asarray(picture[:-LEGEND])


@pytest.mark.long
def test_equal_episodes_give_equal_bytes(tmp_path: Path) -> None:
    first, second = (belief_figure(tmp_path / f"{name}.png", make_episode(), GUESS) for name in "ab")
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.long
def test_true_found_and_wrong_relations_have_their_colours(tmp_path: Path) -> None:
    """Before step 3 nothing is claimed, after it a true relation, and in the end a wrong one, too."""
    early, middle, late = (drawn(belief_figure(tmp_path / f"{k}.png", make_episode(), GUESS, (k,))) for k in (1, 3, 6))
    boards = [picture[:, : picture.shape[1] // 3] for picture in (early, middle, late)]
    assert [has(board, TRUTH) for board in boards] == [True, True, True]
    assert [has(board, CORRECT) for board in boards] == [False, True, True]
    assert [has(board, WRONG) for board in boards] == [False, False, True]
    curves = late[:, late.shape[1] // 3 : 2 * late.shape[1] // 3]
    assert has(curves, CORRECT) and has(curves, RESPONDER)


@pytest.mark.long
def test_steps_that_the_episode_does_not_have_are_left_out(tmp_path: Path) -> None:
    few, many = (
        belief_figure(tmp_path / f"{n}.png", make_episode(), GUESS, s) for n, s in (("a", (1, 3)), ("b", (1, 3, 22)))
    )
    assert few.read_bytes() == many.read_bytes()


def test_a_legend_hides_no_curve() -> None:
    """What is found late has low curves where the legend usually is."""
    nothing, late = np.full(8, np.nan), np.array([0, 0, 0, 0, 0, 0, 0.1, 0.2])
    assert _free_corner(np.ones(8), np.ones(8)) == "lower right"
    assert _free_corner(np.ones(8), late) == _free_corner(nothing, late) == "center right"
    assert _free_corner(late, np.full(8, 0.5)) == "upper right"
    assert _free_corner(nothing) == "lower right"


@pytest.mark.parametrize("episode", [make_real_episode(), make_episode(steps=0)], ids=["real board", "no steps"])
def test_recordings_that_know_little_are_drawn_too(episode: object, tmp_path: Path) -> None:
    nothing = InferredGraph("nothing", np.zeros((1, 5, 5)))
    assert drawn(belief_figure(tmp_path / "f.png", episode, nothing)).size  # type: ignore[arg-type]


@pytest.mark.long
def test_the_last_step_is_always_drawn(tmp_path: Path) -> None:
    episode = make_episode()
    default, explicit = (
        belief_figure(tmp_path / f"{n}.png", episode, GUESS, s) for n, s in (("a", (1, 22)), ("b", (1, 6)))
    )
    assert len(episode.steps) == 6 and default.read_bytes() == explicit.read_bytes()


def test_what_is_true_changes_where_a_board_is_rewired(few_objects: Callable[[int], Path], tmp_path: Path) -> None:
    (board,) = world_boards(few_objects(0), "rewired", 1)
    episode = make_world_episode(board, library_at(few_objects(0)))
    assert (truth_matrix(board, 30) != truth_matrix(board)).any()
    follows = InferredGraph("follows", np.array([truth_matrix(board, step) for step in range(1, 31)], float))
    picture = drawn(belief_figure(tmp_path / "f.png", episode, follows, (12,)))
    assert has(picture, CORRECT) and not has(picture, WRONG) and not has(picture, TRUTH)
    late = refinement_figure(tmp_path / "late.png", episode, follows, (30,)).read_bytes()
    episode.board = board.model_copy(update={"relations": tuple(relations_at(board, 30)), "rewirings": ()})
    assert late == refinement_figure(tmp_path / "new.png", episode, follows, (30,)).read_bytes()
