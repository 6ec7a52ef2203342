"""On which device pictures are drawn."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sapien

from busybot.common import device
from busybot.common.errors import BusybotError
from busybot.sim import vulkan_check
from busybot.sim.scene.render import new_renderer


class Told:
    """Stands in for SAPIEN's renderer: what it was asked for."""

    def __init__(self, on: Any = None) -> None:
        self.on = on


def there(monkeypatch: pytest.MonkeyPatch, gpus: int, name: str, worker: str = "0/1", cores: bool = True) -> None:
    monkeypatch.setattr(device, "gpus", lambda: gpus)
    monkeypatch.setattr(vulkan_check, "draws_on_cores", lambda: cores)
    monkeypatch.setenv(device.CHOICE, name)
    monkeypatch.setenv(device.WORKER, worker)


@pytest.mark.parametrize(
    ("gpus", "name", "worker", "cores", "expected"),
    [
        (0, "auto", "0/1", True, None),
        (0, "auto", "0/1", False, None),
        (1, "auto", "1/2", True, "cpu"),
        (1, "auto", "1/2", False, "cuda:0"),
        (2, "auto", "1/2", False, "cuda:1"),
        (2, "auto", "2/3", False, "cuda:0"),
        (1, "cuda", "0/1", True, "cuda:0"),
        (2, "cuda:1", "0/1", True, "cuda:1"),
        (2, "cpu", "0/1", True, "cpu"),
    ],
)
def test_workers_draw_where_they_are_told(
    monkeypatch: pytest.MonkeyPatch, gpus: int, name: str, worker: str, cores: bool, expected: str | None
) -> None:
    there(monkeypatch, gpus, name, worker, cores)
    monkeypatch.setattr(sapien, "Device", str)
    monkeypatch.setattr(sapien.render, "RenderSystem", Told)
    assert new_renderer().on == expected, "beside a GPU the cores draw where they can, and SAPIEN chooses without one"


def test_vulkan_tells_which_devices_are_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    names = [name for name, *_ in vulkan_check.vulkan_devices()]
    assert names, "tests draw, so there is a device"
    software = any("llvmpipe" in name or "lavapipe" in name for name in names)
    assert vulkan_check.draws_on_cores() == software
    monkeypatch.setattr(vulkan_check, "vulkan_devices", lambda: (("a GPU", "its driver", 2),))
    assert not vulkan_check.draws_on_cores() and vulkan_check.driver_of("a GPU") == "its driver"
    assert vulkan_check.driver_of("another") is None


def test_a_gpu_that_sapien_cannot_draw_on(monkeypatch: pytest.MonkeyPatch) -> None:
    there(monkeypatch, 1, "cuda:0")
    with pytest.raises(BusybotError, match=r"SAPIEN cannot draw on cuda:0(.|\n)*--device auto"):
        new_renderer()


DRAW = """
import sys
import numpy as np
from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.objects.resolve import find
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.render import RenderConfig

library = find("procedural")
[board] = generate_boards(BoardConfig(boards=1), library)
image = Simulator(library, RenderConfig(width=160, height=120)).board(board).observe()
np.savez(sys.argv[1], rgb=image.rgb, depth=image.depth)
"""


@pytest.mark.long
def test_the_cpu_draws_the_same_whether_it_is_named(tmp_path: Path) -> None:
    """In a process each: SAPIEN draws on one device a process."""
    if vulkan_check.render_device() not in (None, "cpu"):
        pytest.skip("pictures are drawn on a GPU here")
    pictures = []
    for name in ("auto", "cpu"):
        file = tmp_path / f"{name}.npz"
        subprocess.run([sys.executable, "-c", DRAW, str(file)], env={**os.environ, device.CHOICE: name})
        pictures.append(np.load(file, allow_pickle=False))
    first, second = pictures
    assert np.array_equal(first["rgb"], second["rgb"]) and np.array_equal(first["depth"], second["depth"])
