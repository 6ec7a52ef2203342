"""One simulator per test process: shaders are compiled once, and SAPIEN keeps its shader pack globally."""

from pathlib import Path

import pytest

from busybot.objects.library import Library, find
from busybot.sim.render import RenderConfig
from busybot.sim.scene import Simulator


@pytest.fixture(scope="session")
def real_simulator(partnet: Path) -> Simulator:
    return Simulator(Library.load(partnet), RenderConfig())


@pytest.fixture(scope="session")
def procedural_simulator() -> Simulator:
    return Simulator(find("procedural"), RenderConfig())
