"""One simulator per test process: shaders are compiled once, and SAPIEN keeps its shader pack globally."""

from pathlib import Path

import pytest

from busybot.boards.spec import BoardSpec, PlacedObject
from busybot.objects.library import Library, find
from busybot.objects.model import ObjectModel
from busybot.sim.render import RenderConfig
from busybot.sim.scene import Simulator


@pytest.fixture(scope="session")
def real_simulator(partnet: Path) -> Simulator:
    return Simulator(Library.load(partnet), RenderConfig())


@pytest.fixture(scope="session")
def procedural_simulator() -> Simulator:
    return Simulator(find("procedural"), RenderConfig())


def lone(model: ObjectModel, states: tuple[int, ...] | None = None) -> BoardSpec:
    """A board with one object in its middle."""
    placed = PlacedObject(
        key=model.key,
        role=model.role,
        position=(0, 0, model.offset_z),
        yaw=0,
        scale=model.scale,
        states=states if states is not None else (0,) * len(model.trigger_links),
    )
    return BoardSpec(
        index=0,
        seed=0,
        split="test",
        appearance_group=0,
        texture="felt",
        color=(0.9, 0.9, 0.9),
        objects=(placed,),
        relations=(),
    )
