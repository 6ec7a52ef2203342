"""Figures of affordances: equal bytes for equal input, also of boards without candidates."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from busybot.episodes.episode import Episode
from busybot.interact.policy.policy_trace import PolicyTrace, retrace
from busybot.view.figures.sequences import affordance_figure
from busybot.view.palette import ACTION, INK
from tests.episodes.synthetic import make_episode
from tests.interact.scenes import ButtonModel


def thoughts(episode: Episode) -> list[PolicyTrace]:
    return list(retrace(episode, ButtonModel()))


@pytest.mark.long
def test_equal_episodes_give_equal_bytes(tmp_path: Path) -> None:
    first, second = (
        affordance_figure(tmp_path / name, make_episode(), thoughts(make_episode())) for name in ("a.png", "b.png")
    )
    assert first.read_bytes() == second.read_bytes()
    picture = cv2.imread(str(first))
    assert picture is not None and picture.shape[1] >= 1000
    for color in (ACTION, INK):
        assert (picture[..., ::-1] == np.array(color)).all(-1).any()


@pytest.mark.long
def test_any_number_of_steps_can_be_drawn(tmp_path: Path) -> None:
    episode = make_episode()
    for count in (0, 1, 6):
        assert cv2.imread(str(affordance_figure(tmp_path / "f.png", episode, thoughts(episode)[:count]))) is not None
