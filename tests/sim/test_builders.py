"""Loaded objects are forgotten when others were used since: the memory comes back, and nobody sees a difference."""

import psutil
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.objects.library import find
from busybot.sim import builders
from busybot.sim.builders import Builders
from busybot.sim.render import RenderConfig
from busybot.sim.scene import Simulator

SMALL = RenderConfig(width=160, height=120)


def test_the_least_recently_used_objects_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(builders, "KEPT", 2)
    models = list(find("procedural").objects.values())[:3]
    kept = Builders(looks=False)
    first, second, third = (kept.get(model, 1.0) for model in models)
    assert kept.get(models[0], 1.0) is first
    kept.forget()
    assert kept.get(models[0], 1.0) is first and kept.get(models[2], 1.0) is third
    assert kept.get(models[1], 1.0) is not second


def test_memory_is_bounded_and_pictures_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    library = find("procedural")
    boards = list(generate_boards(BoardConfig(boards=24, group_size=1), library))
    forgetful, thorough = Simulator(library, SMALL), Simulator(library, SMALL)
    resident = []
    for board in boards:
        monkeypatch.setattr(builders, "KEPT", 10)
        forgetful.board(board).observe()
        resident.append(psutil.Process().memory_info().rss / 1e6)
    assert resident[-1] - resident[5] < 120, "each object takes about 6 MB, and each board brings some that are new"
    for board in (boards[0], *boards[:4], boards[0]):
        images = []
        for simulator, kept in ((forgetful, 10), (thorough, 1000)):
            monkeypatch.setattr(builders, "KEPT", kept)
            scene = simulator.board(board)
            for number, joint in enumerate(scene.triggers):
                scene.set_trigger(number, joint.link.states - 1)
            images.append(scene.observe())
        assert (images[0].rgb == images[1].rgb).all() and (images[0].segmentation == images[1].segmentation).all()
