"""Figures: PNG files that come out the same every time, also of recordings that know little."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from busybot.episodes.episode import Episode
from busybot.reason.models.base import InferredGraph
from busybot.view.figures.episode import (
    boards_figure,
    changes_figure,
    episode_figure,
    graph_figure,
    refinement_figure,
    telling_moments,
    telling_steps,
)
from busybot.view.figures.parts import draw_names
from busybot.view.palette import CORRECT, MISSED, WRONG
from tests.episodes.synthetic import make_episode, make_real_episode

GUESS = InferredGraph("guess", np.zeros((6, 5, 5)))
GUESS.probabilities[2:, 0, 1] = 0.9
GUESS.probabilities[4:, 0, 4] = 0.7

FIGURES: dict[str, Callable[[Path, Episode], Path]] = {
    "boards": lambda path, episode: boards_figure(path, [episode] * 3),
    "episode": episode_figure,
    "graph": lambda path, episode: graph_figure(path, episode, GUESS),
    "refinement": lambda path, episode: refinement_figure(path, episode, GUESS),
    "changes": changes_figure,
}


def has(picture: np.ndarray, color: tuple[int, int, int]) -> bool:
    return bool((picture[..., ::-1] == color).all(-1).any())


@pytest.mark.long
@pytest.mark.parametrize("name", FIGURES)
def test_equal_episodes_give_equal_bytes(name: str, tmp_path: Path) -> None:
    first = FIGURES[name](tmp_path / "a" / "1.png", make_episode())
    second = FIGURES[name](tmp_path / "2.png", make_episode())
    assert first == tmp_path / "a" / "1.png"
    assert first.read_bytes() == second.read_bytes()
    height, width = cv2.imread(str(first)).shape[:2]
    assert width >= 1000 and height >= 300


@pytest.mark.parametrize("name", FIGURES)
@pytest.mark.parametrize("episode", [make_real_episode(), make_episode(steps=0)], ids=["real board", "no steps"])
def test_recordings_that_know_little_are_drawn_too(name: str, episode: Episode, tmp_path: Path) -> None:
    assert cv2.imread(str(FIGURES[name](tmp_path / "f.png", episode))) is not None


@pytest.mark.long
def test_the_scene_graph_shows_verdicts_in_their_colours(tmp_path: Path) -> None:
    early = cv2.imread(str(graph_figure(tmp_path / "early.png", make_episode(), GUESS, 1)))[:-60]
    late = cv2.imread(str(graph_figure(tmp_path / "late.png", make_episode(), GUESS)))[:-60]
    assert (has(early, CORRECT), has(early, WRONG), has(early, MISSED)) == (False, False, True)
    assert (has(late, CORRECT), has(late, WRONG), has(late, MISSED)) == (True, True, True)


@pytest.mark.parametrize(("times", "first"), [(1, "switch 0"), (5, "0")])
def test_on_boards_with_many_objects_numbers_stand_for_names(times: int, first: str) -> None:
    episode, told = make_episode(steps=0), list[str]()
    board = episode.board.model_copy(update={"objects": times * episode.board.objects})
    image = replace(episode.images[0], boxes=np.tile(episode.images[0].boxes, (times, 1)))
    positions = np.tile(episode.positions, (times, 1))
    axes = SimpleNamespace(annotate=lambda text, *_, **__: told.append(text))
    draw_names(axes, replace(episode, board=board, images=[image], positions=positions))
    assert len(told) == 5 * times and told[0] == first


def test_the_strip_takes_steps_in_which_something_happened() -> None:
    episode = make_episode(steps=12)
    assert telling_steps(episode, 100) == [k for k in range(12) if k % 3 != 2]
    few = telling_steps(episode, 3)
    assert len(few) == 3 and few[0] == 0 and few[-1] == 10


def test_moments_are_denser_at_the_beginning() -> None:
    assert telling_moments(30) == [1, 2, 5, 13, 30]
    assert telling_moments(1) == [1]
