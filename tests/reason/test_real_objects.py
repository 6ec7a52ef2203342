"""Counting on rendered boards of real objects: the gate of protocol "Reasoning"."""

from pathlib import Path

import numpy as np
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.objects.library import Library
from busybot.reason.evaluation.evaluate import judge_episode
from busybot.reason.evaluation.summary import summarise
from busybot.reason.inputs.object_masks import changes
from busybot.reason.inputs.observation import acted_objects, observe_episode
from busybot.sim.builtin_policies import ScriptedFactory
from busybot.sim.interaction import InteractionConfig
from busybot.sim.recorder import record_episode
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.render import RenderConfig

BOARDS = 10


@pytest.fixture(scope="module")
def simulator(partnet: Path) -> Simulator:
    return Simulator(Library.load(partnet), RenderConfig())


@pytest.mark.long
@pytest.mark.parametrize("split", ["train", "novel-config", "novel-object"])
def test_counting_finds_the_relations_of_scripted_rollouts(simulator: Simulator, split: str, tmp_path: Path) -> None:
    """At least 99/99 and no responder misjudged in 22 steps, from files with JPEG images."""
    config = BoardConfig(boards=BOARDS, split=split, seed=11, group_size=1)  # type: ignore[arg-type]
    judged = []
    for board in generate_boards(config, simulator.library):
        write_episode(
            tmp_path / "e.mcap", record_episode(simulator, board, ScriptedFactory(), 22, InteractionConfig(), 11)
        )
        episode = read_episode(tmp_path / "e.mcap", "lazy")
        _assert_changes_are_seen(episode)
        judged.append(judge_episode(episode))
    result = summarise(judged, 23, 0)
    assert result["edge_p"] >= 0.99 and result["edge_r"] >= 0.99
    assert result["edge_r"] >= result["edge_r_bound"] - 0.005
    assert result["boards"] == BOARDS


def _assert_changes_are_seen(episode: Episode) -> None:
    observed = observe_episode(episode)
    before, after = (
        np.array([getattr(s, f"responder_states_{when}") for s in episode.steps]) for when in ("before", "after")
    )
    responders = observed.responders
    np.testing.assert_array_equal(changes(observed)[:, responders], (before != after)[:, responders])
    acted, truth = acted_objects(observed), np.array([step.acted_object for step in episode.steps])
    np.testing.assert_array_equal(acted[truth >= 0], truth[truth >= 0])
