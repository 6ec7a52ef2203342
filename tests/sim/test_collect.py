"""Collecting: the same data whatever the workers and interruptions, settings are kept, faults are told."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import psutil
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.spec import BoardCamera
from busybot.common.errors import BusybotError
from busybot.common.process_pool import TASK_SECONDS
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.datasets.verify import verify
from busybot.episodes.digests import Digests
from busybot.episodes.mcap.reader import read_episode
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.sim.collect import CollectConfig, collect, episode_seconds
from busybot.sim.scene.render import RenderConfig

WorkHere = Callable[[], AbstractContextManager[None]]
SMALL = CollectConfig(policy="scripted", steps=4, render=RenderConfig(width=160, height=120))


def make(path: Path, boards: int = 6, library: Library | None = None) -> Dataset:
    return create_dataset(path, BoardConfig(boards=boards, group_size=2), library or find("procedural"))


@pytest.mark.long
def test_hashes_do_not_depend_on_the_number_of_workers(tmp_path: Path, work_here: WorkHere) -> None:
    hashes: dict[int, Digests] = {}
    for workers in (0, 1, 2):  # 0: in this process
        dataset = make(tmp_path / str(workers))
        with nullcontext() if workers else work_here():
            done = collect(dataset, find("procedural"), SMALL, workers)
        assert (done.boards, done.done, done.new) == (6, 6, 6)
        assert verify(dataset.path).ok
        hashes[workers] = dataset.hashes()
    assert hashes[0] == hashes[1] == hashes[2]
    other = make(tmp_path / "other")
    with work_here():
        collect(other, find("procedural"), SMALL.model_copy(update={"seed": 1}), 1)
    assert other.hashes().board == hashes[1].board and other.hashes().trace != hashes[1].trace


@pytest.mark.usefixtures("in_process")
def test_collecting_again_continues_and_other_settings_are_refused(tmp_path: Path) -> None:
    library, dataset = find("procedural"), make(tmp_path / "data")
    collect(dataset, library, SMALL, 1)
    whole = dataset.hashes()
    assert collect(dataset, library, SMALL, 1).new == 0
    for index in (1, 4):
        dataset.episode_path(index).unlink()
    kept = dataset.episode_path(0).stat().st_mtime_ns
    assert collect(Dataset.open(dataset.path), library, SMALL, 2).new == 2
    assert dataset.episode_path(0).stat().st_mtime_ns == kept
    assert dataset.hashes() == whole
    with pytest.raises(BusybotError, match="steps 4, now 5"):
        collect(dataset, library, SMALL.model_copy(update={"steps": 5}), 1)


def test_the_time_that_an_episode_may_take_grows_with_its_steps(tmp_path: Path) -> None:
    given: list[float] = []

    def engine(tasks: object, make_work: object, arguments: object, workers: int, task_seconds: float) -> Iterator[Any]:
        given.append(task_seconds)
        return iter(())

    for steps in (4, 5000):
        config = SMALL.model_copy(update={"steps": steps})
        collect(make(tmp_path / str(steps), boards=2), find("procedural"), config, 1, engine=engine)
    assert given == [TASK_SECONDS, episode_seconds(5000)] and given[1] >= 5000


@pytest.mark.usefixtures("in_process")
def test_a_board_that_its_camera_does_not_see_is_named(tmp_path: Path) -> None:
    dataset = make(tmp_path / "data", boards=2)
    camera = BoardCamera(position=(0, 0, 0.5), target=(0, 0, 0), fov_deg=60)
    dataset.replace_board(dataset.board(1).model_copy(update={"camera": camera}))
    with pytest.raises(BusybotError, match=r"boards-00000.jsonl: line 2: .*its camera: the target is 0.5 away"):
        collect(dataset, find("procedural"), SMALL, 1)


@pytest.mark.usefixtures("in_process")
def test_images_of_unchanged_steps_are_stored_once(tmp_path: Path) -> None:
    dataset = make(tmp_path / "data", boards=2)
    collect(dataset, find("procedural"), SMALL.model_copy(update={"policy": "random", "steps": 8}), 1)
    for index in range(2):
        episode = read_episode(dataset.episode_path(index))
        changes = sum(step.success for step in episode.steps)
        assert len(episode.images) == 1 + changes < 9
        assert len(episode.frame_of) == 9 and episode.policy == "random" and not episode.oracle


def test_a_dataset_refuses_other_objects(tmp_path: Path, partnet: Path) -> None:
    dataset = make(tmp_path / "data", library=find(str(partnet)))
    with pytest.raises(BusybotError, match="--assets"):
        find("procedural", dataset.info.assets.sha256)
    assert find(None, dataset.info.assets.sha256).name == partnet.name


@pytest.mark.long
def test_killed_at_random_moments_and_continued(tmp_path: Path) -> None:
    """SIGKILL five times; nothing finished is lost, and the end equals an undisturbed run."""
    boards, chooser = 24, random.Random(4)
    undisturbed = make(tmp_path / "undisturbed", boards)
    collect(undisturbed, find("procedural"), SMALL, 2)
    dataset = make(tmp_path / "data", boards)
    (tmp_path / "config.yaml").write_text(json.dumps(SMALL.model_dump(mode="json")))
    command = [sys.executable, "-m", "busybot", "collect", str(dataset.path), "--config", str(tmp_path / "config.yaml")]
    for kill in range(5):
        finished = {index: dataset.episode_path(index).stat().st_mtime_ns for index in dataset.finished()}
        process = subprocess.Popen([*command, "--workers", "2"], stderr=subprocess.DEVNULL, env=dict(os.environ))
        deadline = time.monotonic() + 60
        while len(dataset.finished()) < min(boards - 1, 4 * kill + 1) and time.monotonic() < deadline:
            time.sleep(0.01)
        time.sleep(chooser.random() * 0.4)
        workers = psutil.Process(process.pid).children(recursive=True) if process.poll() is None else []
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert not psutil.wait_procs(workers, timeout=10)[1], "workers outlive their parent"
        for index, changed in finished.items():
            assert dataset.episode_path(index).stat().st_mtime_ns == changed, "a finished episode was lost or rewritten"
    assert dataset.finished()
    subprocess.run([*command, "--workers", "2"], check=True, stderr=subprocess.DEVNULL, env=dict(os.environ))
    assert verify(dataset.path).ok
    assert dataset.hashes() == undisturbed.hashes()
    assert not [path for path in dataset.path.rglob("*") if path.name.endswith(".tmp")]
