"""A dataset made again is the dataset; what is not as recorded is found."""

import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from busybot.cli.dataset import printing
from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.datasets.diff import diff
from busybot.datasets.verify import verify
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.objects.resolve import find
from busybot.sim.collect import episode_seconds
from busybot.sim.regenerate import regenerate
from tests.episodes.folders import make_dataset
from tests.episodes.tamper import rewrite

pytestmark = pytest.mark.usefixtures("in_process")


@pytest.fixture
def copy(recorded: Dataset, tmp_path: Path) -> Dataset:
    shutil.copytree(recorded.path, tmp_path / "copy")
    return Dataset.open(tmp_path / "copy")


def edit(dataset: Dataset, **values: object) -> None:
    file = dataset.path / "dataset.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | values))


def test_boards_and_recordings_come_out_equal(recorded: Dataset, tmp_path: Path) -> None:
    done = regenerate(recorded.path, tmp_path / "out", find("procedural"))
    assert done.ok and (done.boards_from, done.boards_unlike, done.replayed) == ("configuration", [], 3)
    assert done.episodes == {"equal": 3, "close": 0} and done.joints == 0 and done.image.equal
    assert verify(tmp_path / "out").ok
    assert diff(recorded.path, tmp_path / "out").equal
    assert Dataset.open(tmp_path / "out").hashes() == recorded.hashes()


def test_a_stopped_one_is_continued(recorded: Dataset, tmp_path: Path) -> None:
    regenerate(recorded.path, tmp_path / "out", find("procedural"))
    out = Dataset.open(tmp_path / "out")
    out.episode_path(1).unlink()
    kept = out.episode_path(0).stat().st_mtime_ns
    done = regenerate(recorded.path, out.path, find("procedural"))
    assert done.ok and done.replayed == 1 and sum(done.episodes.values()) == 3
    assert out.finished() == {0, 1, 2} and out.episode_path(0).stat().st_mtime_ns == kept


def test_what_was_not_replayed_is_told(
    recorded: Dataset, copy: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A copy of the recordings lies where they would be made again."""
    done = regenerate(recorded.path, copy.path, find("procedural"))
    assert done.ok and done.replayed == 0
    printing.regenerated(done)
    told = " ".join(capsys.readouterr().out.split())
    assert "replayed now: 0 episodes" in told and f"3 lay in {copy.path}, recorded by today's versions" in told
    printing.regenerated(regenerate(recorded.path, tmp_path / "out", find("procedural")))
    assert "another --out" not in capsys.readouterr().out


def test_replays_of_other_packages_or_renderers_are_made_anew(recorded: Dataset, copy: Dataset) -> None:
    kept = copy.episode_path(0).stat().st_mtime_ns
    for index, told in ((1, "versions"), (2, "renderer")):
        episode = read_episode(copy.episode_path(index))
        getattr(episode, told)["sapien"] = "2.2"
        episode.images[0].rgb[:] //= 2
        write_episode(copy.episode_path(index), episode)
    done = regenerate(recorded.path, copy.path, find("procedural"))
    assert done.ok and done.image.equal and done.replayed == 2
    assert copy.episode_path(0).stat().st_mtime_ns == kept
    assert read_episode(copy.episode_path(1)).versions == read_episode(recorded.episode_path(1)).versions
    assert verify(copy.path).ok


def test_changed_recordings_and_boards_are_found(copy: Dataset, tmp_path: Path) -> None:
    episode = read_episode(copy.episode_path(1))
    episode.images[0].rgb[:] //= 2
    write_episode(copy.episode_path(1), episode)
    episode = read_episode(copy.episode_path(2))
    episode.steps[1] = replace(episode.steps[1], success=not episode.steps[1].success)
    write_episode(copy.episode_path(2), episode)
    lines = (copy.path / "boards/boards-00000.jsonl").read_text().splitlines()
    board = json.loads(lines[0])
    board["objects"][0]["yaw"] += 0.01
    (copy.path / "boards/boards-00000.jsonl").write_text("\n".join([json.dumps(board), *lines[1:]]) + "\n")
    done = regenerate(copy.path, tmp_path / "out", find("procedural"))
    assert not done.ok and done.boards_unlike == [0]
    assert set(done.failed) == {1, 2} and done.failed[2].state == 1 and done.failed[1].frames[0] == 0
    assert done.image.colour > 0.5
    assert Dataset.open(tmp_path / "out").finished() == {1, 2}


def test_another_renderer_makes_the_looser_rule_apply(recorded: Dataset, copy: Dataset, tmp_path: Path) -> None:
    def foreign(name: str, data: bytes) -> bytes:
        return data.replace(b'"driver": ', b'"driver": "another", "was": ')

    for index in range(3):
        rewrite(copy.episode_path(index), attachment=foreign)
    done = regenerate(copy.path, tmp_path / "out", find("procedural"))
    assert done.episodes == {"equal": 0, "close": 3}
    assert done.ok and done.image.equal
    for pixels, close in ((19, True), (20, False)):  # of 160 x 120
        episode = read_episode(recorded.episode_path(0))
        episode.renderer["driver"] = "another"
        for image in episode.images:
            image.rgb.reshape(-1, 3)[:pixels] ^= 128
        write_episode(copy.episode_path(0), episode, "png")
        assert regenerate(copy.path, tmp_path / "out", find("procedural")).ok == close


def test_long_episodes_are_given_more_time(copy: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert copy.info.collect is not None
    edit(copy, collect=copy.info.collect.model_dump() | {"steps": 5000})
    given: dict[str, float] = {}

    def engine(tasks: object, make_work: object, arguments: object, workers: int, task_seconds: float) -> Iterator[Any]:
        given["seconds"] = task_seconds
        return iter(())

    monkeypatch.setattr("busybot.sim.regenerate.run_tasks", engine)
    regenerate(copy.path, tmp_path / "out", find("procedural"))
    assert given == {"seconds": episode_seconds(5000)} and episode_seconds(5000) >= 5000


def test_boards_of_another_generator_are_taken_as_they_are(copy: Dataset, tmp_path: Path) -> None:
    edit(copy, generator={**copy.info.generator.model_dump(), "version": "0.1"})
    done = regenerate(copy.path, tmp_path / "out", find("procedural"))
    assert done.boards_from == "dataset" and not done.ok and not done.failed and done.episodes["equal"] == 3


def test_what_cannot_be_made_again_is_said(copy: Dataset, tmp_path: Path) -> None:
    for within in (copy.path, copy.path / "again"):
        with pytest.raises(BusybotError, match="lies within the recorded dataset"):
            regenerate(copy.path, within, find("procedural"))
    assert not (copy.path / "again").exists()
    with pytest.raises(BusybotError, match="no episodes"):
        regenerate(make_dataset(tmp_path / "empty", finished=()).path, tmp_path / "out", find("procedural"))
    make_dataset(tmp_path / "other")
    with pytest.raises(BusybotError, match="another dataset"):
        regenerate(copy.path, tmp_path / "other", find("procedural"))
    edit(copy, generator={**copy.info.generator.model_dump(), "config": {"walls": 4}})
    with pytest.raises(BusybotError, match="walls") as error:
        regenerate(copy.path, tmp_path / "out", find("procedural"))
    assert error.value.hint
