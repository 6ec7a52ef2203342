"""A rollout, action by action: what differs still, what became right, and what the agent said."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from busybot.cli.main import app
from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.writer import write_episode
from busybot.view.annotations import named, remaining_responders
from busybot.view.figures.sequences import PICTURES_PER_ROW, sequence_figure
from busybot.view.palette import ACTION, CORRECT, WRONG
from busybot.view.report.page import Heading, Picture, Text, document, markdown
from busybot.view.report.report import NO_SEQUENCE, sequence_blocks
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_board, make_episode, make_task_episode
from tests.view.figures.test_episode import has

LEGEND = 60
"""Pixels at the lower edge, in which every colour is."""


def rollout(steps: int = 3) -> Episode:
    episode = make_task_episode(steps=steps)
    words = [f"object 1 differs, try {step}" for step in range(steps)]
    episode.settings |= {"decisions": [*words, "stop: enough"]}
    return episode


def drawn(path: Path, episode: Episode) -> np.ndarray:
    picture = cv2.imread(str(sequence_figure(path, episode)))
    assert picture is not None
    return np.asarray(picture[:-LEGEND])


def test_equal_rollouts_give_equal_bytes(tmp_path: Path) -> None:
    first, second = (sequence_figure(tmp_path / f"{name}.png", rollout()) for name in "ab")
    assert first.read_bytes() == second.read_bytes()


def test_what_differs_is_red_and_what_became_right_is_green(tmp_path: Path) -> None:
    episode = rollout()
    before, after = (remaining_responders(episode, frame) for frame in (0, 1))
    assert before and after != before, "the first action changes what differs"
    picture = drawn(tmp_path / "f.png", episode)
    start, first = (picture[:, picture.shape[1] * k // 5 : picture.shape[1] * (k + 1) // 5] for k in (0, 1))
    assert (has(start, WRONG), has(start, CORRECT), has(start, ACTION)) == (True, False, False)
    assert has(first, ACTION)
    became = set(before) - set(after)
    assert has(first, CORRECT) == bool(became) and has(first, WRONG) == bool(after)


@pytest.mark.long
def test_long_rollouts_go_on_below(tmp_path: Path) -> None:
    short, long = (drawn(tmp_path / f"{n}.png", rollout(n)) for n in (PICTURES_PER_ROW - 2, PICTURES_PER_ROW - 1))
    assert short.shape[1] == long.shape[1] and long.shape[0] > 1.7 * short.shape[0]
    assert drawn(tmp_path / "none.png", rollout(0)).size


def test_words_of_an_agent_are_no_formula(tmp_path: Path) -> None:
    episode = rollout(1)
    episode.settings |= {"decisions": ["$\\frac{$"]}
    assert drawn(tmp_path / "f.png", episode).size


def test_an_episode_without_a_goal_has_no_sequence(tmp_path: Path) -> None:
    with pytest.raises(BusybotError, match="no goal"):
        sequence_figure(tmp_path / "f.png", make_episode())


def test_words_name_objects() -> None:
    board = make_board()
    assert named(board, "objects 1, 4 differ: object 0 and object 9") == "lamp 1, toy 4 differ: switch 0 and object 9"


@pytest.fixture
def rollouts(tmp_path: Path) -> Path:
    """A dataset of three rollouts, the first of one action."""
    path = make_dataset(tmp_path / "rollouts", finished=()).path
    for index, steps in enumerate((1, 3, 3)):
        write_episode(Dataset.open(path).episode_path(index), rollout(steps))
    return path


@pytest.mark.long
def test_the_command_draws_the_sequence_of_a_rollout(rollouts: Path, tmp_path: Path) -> None:
    out = tmp_path / "f.png"
    result = CliRunner().invoke(app, ["view", str(rollouts), "--episode", "1", "--figure", str(out)])
    assert result.exit_code == 0, result.stderr
    sequence_figure(tmp_path / "same.png", rollout())
    assert cv2.imread(str(out)).shape == cv2.imread(str(tmp_path / "same.png")).shape
    result = CliRunner().invoke(app, ["view", str(rollouts), "--figure", str(out), "--reasoner", "lookup"])
    assert result.exit_code == 0 and cv2.imread(str(out)).shape != cv2.imread(str(tmp_path / "same.png")).shape


def test_a_report_shows_a_telling_rollout_of_every_folder(rollouts: Path, tmp_path: Path) -> None:
    heading, picture = sequence_blocks([rollouts.parent], tmp_path / "figures")
    assert isinstance(heading, Heading) and isinstance(picture, Picture)
    sequence_figure(tmp_path / "second.png", rollout())
    assert cv2.imread(str(picture.path)).shape == cv2.imread(str(tmp_path / "second.png")).shape
    histories = make_dataset(tmp_path / "other" / "histories", finished=(0,)).path
    assert sequence_blocks([histories.parent, tmp_path / "none"], tmp_path / "figures")[1:] == [Text(NO_SEQUENCE)]


def test_a_recordings_policy_and_split_are_no_links_in_a_report(rollouts: Path, tmp_path: Path) -> None:
    evil, file = "[the results](https://evil.example/x)", Dataset.open(rollouts).episode_path(1)
    episode = rollout()
    episode.policy, episode.board = evil, episode.board.model_copy(update={"split": evil})
    file.unlink()
    write_episode(file, episode)
    blocks = sequence_blocks([rollouts], tmp_path / "figures")
    page, text = document("t", blocks), markdown(blocks, tmp_path)
    assert "the results" in page and "](https" not in text and "<a href" not in page
