"""One simulator per test process: shaders are compiled once, and SAPIEN keeps its shader pack globally."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from busybot.boards.config import BoardConfig
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.sim.collect import CollectConfig, collect
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.render import RenderConfig

Once = Callable[[str, Callable[[Path], object]], Path]


@pytest.fixture(scope="session")
def real_simulator(partnet: Path) -> Simulator:
    return Simulator(Library.load(partnet), RenderConfig())


@pytest.fixture(scope="session")
def procedural_simulator() -> Simulator:
    return Simulator(find("procedural"), RenderConfig())


SMALL = RenderConfig(width=160, height=120)


@pytest.fixture(scope="session")
def small_simulator() -> Simulator:
    """Quick pictures for what does not depend on their size."""
    return Simulator(find("procedural"), SMALL)


@pytest.fixture(scope="session")
def recorded(once: Once, work_here: Callable[[], AbstractContextManager[None]]) -> Iterator[Dataset]:
    """Three boards with relations of all kinds and what the scripted policy did on them; not to be changed."""

    def record(path: Path) -> None:
        dataset = create_dataset(path, BoardConfig(boards=3, group_size=1, relations="one-to-many"), find("procedural"))
        with work_here():
            collect(dataset, find("procedural"), CollectConfig(policy="scripted", steps=5, render=SMALL), 1)

    dataset = Dataset.open(once("recorded", record))
    before = dataset.hashes()
    yield dataset
    assert dataset.hashes() == before
