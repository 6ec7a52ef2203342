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
from busybot.sim.scene import render
from busybot.sim.scene.render import new_renderer


class Told:
    """Stands in for SAPIEN's renderer: what it was asked for."""

    def __init__(self, on: Any = None) -> None:
        self.on = on


def there(monkeypatch: pytest.MonkeyPatch, gpus: int, name: str, worker: str = "0/1") -> None:
    monkeypatch.setattr(device, "gpus", lambda: gpus)
    monkeypatch.setattr(render, "gpus", lambda: gpus)
    monkeypatch.setenv(device.CHOICE, name)
    monkeypatch.setenv(device.WORKER, worker)


@pytest.mark.parametrize(
    ("gpus", "name", "worker", "expected"),
    [
        (0, "auto", "0/1", None),
        (1, "auto", "1/2", None),
        (2, "auto", "1/2", "cuda:1"),
        (2, "auto", "2/3", "cuda:0"),
        (1, "cuda", "0/1", "cuda:0"),
        (2, "cuda:1", "0/1", "cuda:1"),
        (2, "cpu", "0/1", "cpu"),
    ],
)
def test_workers_draw_where_they_are_told(
    monkeypatch: pytest.MonkeyPatch, gpus: int, name: str, worker: str, expected: str | None
) -> None:
    there(monkeypatch, gpus, name, worker)
    monkeypatch.setattr(sapien, "Device", str)
    monkeypatch.setattr(sapien.render, "RenderSystem", Told)
    assert new_renderer().on == expected, "SAPIEN itself chooses where there is one device at most"


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
    if device.gpus():
        pytest.skip("auto is a GPU here")
    pictures = []
    for name in ("auto", "cpu"):
        file = tmp_path / f"{name}.npz"
        subprocess.run([sys.executable, "-c", DRAW, str(file)], env={**os.environ, device.CHOICE: name})
        pictures.append(np.load(file, allow_pickle=False))
    first, second = pictures
    assert np.array_equal(first["rgb"], second["rgb"]) and np.array_equal(first["depth"], second["depth"])
