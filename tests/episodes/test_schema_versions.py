"""What was recorded once stays readable: every released schema version has a fixture, and all are read."""

from pathlib import Path

import pytest

from busybot.common.atomic_io import read_json, scan
from busybot.datasets.dataset import Dataset
from busybot.datasets.summary import summarise
from busybot.datasets.verify import verify
from busybot.episodes.digests import episode_digests
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.schema import SCHEMA_VERSION, TABLES
from busybot.episodes.tables import knows_truth
from tests.episodes.make_fixture import FIXTURES

VERSIONS = sorted(folder.name for folder in FIXTURES.iterdir() if folder.is_dir())


def test_the_present_version_has_a_fixture() -> None:
    assert SCHEMA_VERSION in VERSIONS, "python -m tests.episodes.make_fixture"


@pytest.mark.parametrize("version", VERSIONS)
def test_a_dataset_of_each_version_is_read_and_sound(version: str) -> None:
    folder = FIXTURES / version
    assert sum(scan(folder).files.values()) < 300_000
    expected = read_json(folder / "expected.json")
    assert expected["dataset"].items() <= summarise(folder / "dataset").items()
    report = verify(folder / "dataset")
    assert report.problems == () and report.frozen and report.episodes == 2
    dataset = Dataset.open(folder / "dataset")
    for name in TABLES:
        assert dataset.table(name).num_rows > 0
    for index in sorted(dataset.finished()):
        episode = read_episode(dataset.episode_path(index))
        assert len(episode.steps) == 4 and knows_truth(episode) and episode.renderer["shader"] == "busybot"
        assert episode.board == dataset.board(index)
        remembers = any(step.memory_after for step in episode.steps)
        assert (episode.board.world == "mixed" and remembers) == (version not in ("1.0", "1.1"))
        assert (episode.goal is not None) == (episode.board.task is not None) == (version != "1.0")


@pytest.mark.parametrize("version", VERSIONS)
def test_a_recording_without_simulator_of_each_version_is_read(version: str) -> None:
    episode = read_episode(Path(FIXTURES / version / "real.mcap"))
    assert vars(episode_digests(episode)) == read_json(FIXTURES / version / "expected.json")["real"]
    assert not knows_truth(episode) and episode.images[0].depth is None
