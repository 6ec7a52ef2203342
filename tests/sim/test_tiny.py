"""The dataset in `datasets/tiny` is whole, small, and carries all that is needed to replay it and make it again."""

from pathlib import Path

import pytest

from busybot.common.atomic_io import scan
from busybot.datasets.bundled_assets import library_of
from busybot.datasets.create import boards_again
from busybot.datasets.dataset import Dataset
from busybot.datasets.manifest import read_manifest
from busybot.datasets.verify import verify
from busybot.episodes.mcap.reader import read_episode
from busybot.sim.regenerate import regenerate
from busybot.sim.replay import EpisodeReplay, simulator_of


def test_it_is_small_whole_and_has_all_kinds_of_relations(tiny: Path) -> None:
    report = verify(tiny)
    assert report.problems == () and report.frozen and report.episodes == 12 and report.objects
    assert sum(scan(tiny).files.values()) <= 15_000_000
    boards = Dataset.open(tiny).boards()
    kinds = {relation.kind for board in boards for relation in board.relations}
    assert kinds == {"one-to-one", "one-to-many-effects", "one-to-many-objects"}


def test_it_carries_its_objects(tiny: Path) -> None:
    dataset = Dataset.open(tiny)
    library = library_of(dataset)
    assert library.folder == tiny / "objects"
    assert boards_again(dataset.info.generator, library, dataset.boards()) == (dataset.boards(), "configuration")
    assert {(entry.licence, entry.carried) for entry in read_manifest(tiny).assets.values()} == {("MIT", True)}


@pytest.mark.long
def test_every_step_goes_back_into_the_simulator(tiny: Path) -> None:
    dataset = Dataset.open(tiny)
    simulator = None
    for index in range(12):
        episode = read_episode(dataset.episode_path(index), images="lazy")
        simulator = simulator or simulator_of(episode, library_of(dataset))
        replay = EpisodeReplay(simulator, episode)
        for step in range(len(episode.steps) + 1):
            assert replay.compare(step).holds, (index, step)


@pytest.mark.long
def test_it_can_be_made_again(tiny: Path, tmp_path: Path) -> None:
    assert regenerate(tiny, tmp_path / "again", library_of(Dataset.open(tiny)), workers=2).ok
