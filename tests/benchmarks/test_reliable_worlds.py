"""Boards of every world go through all that is done with a dataset; what differs is found."""

from argparse import Namespace
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from benchmarks.reliability import worlds
from benchmarks.reliability.worlds import Case, cases, checked
from busybot.boards.config import SPLITS
from busybot.boards.spec import PAPER
from busybot.boards.worlds import NOVEL, REWIRED_AT, WORLDS
from busybot.datasets.dataset import Dataset
from busybot.episodes.mcap.reader import read_episode
from busybot.sim.replay import EpisodeReplay, simulator_of
from tests.episodes.symbolic import library_at


def test_every_world_and_split_is_a_case() -> None:
    found = cases([PAPER, *WORLDS])
    assert len({case.name for case in found}) == len(found) == len(SPLITS) * (len(WORLDS) + 1) - 1
    assert Case(PAPER, NOVEL) not in found
    assert all((case.steps > REWIRED_AT[0]) == (case.world in ("rewired", "mixed")) for case in found)


@pytest.mark.long
def test_boards_go_through_everything_and_what_differs_is_seen(
    few_objects: Callable[[int], Path],
    tmp_path: Path,
    work_here: Callable[[], AbstractContextManager[None]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(worlds, "KILLS", 1)
    folder = few_objects(0)
    library, arguments = library_at(folder), Namespace(boards=2, seed=1, assets=str(folder))
    with work_here():
        row = checked(Case("time", "train"), library, tmp_path, arguments)
    assert row["faults"] == [] and row["boards"] == 2 and row["steps_put_back"] == row["actions"] == 16
    assert len(row["killed_with_episodes"]) == 1 and sum(row["mechanisms"].values()) > 4
    episode = read_episode(Dataset.open(tmp_path / "straight").episode_path(0), images="lazy")
    scene = EpisodeReplay(simulator_of(episode, library), episode).put_back(3)
    there = [worlds._there_again(scene, step) for step in episode.steps]
    links = [step.trigger_states_after for step in episode.steps]
    assert there[2] and not any(one for one, states in zip(there, links, strict=True) if states != links[2])
    assert len(set(links)) > 1
