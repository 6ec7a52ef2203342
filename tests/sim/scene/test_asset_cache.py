"""Loaded objects are forgotten when others were used since: the memory comes back, and nobody sees a difference."""

import subprocess
import sys
from pathlib import Path
from statistics import median

import psutil
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.objects.importing.importer import import_objects
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.sim.scene import asset_cache as builders
from busybot.sim.scene.asset_cache import Builders
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.render import RenderConfig
from busybot.sim.thumbnails import lone_board
from tests.objects.raw_objects import BOX_LAMP, STICK, Link, library_of, make_raw

SMALL = RenderConfig(width=160, height=120)
ROOT = Path(__file__).resolve().parents[3]


def test_the_least_recently_used_objects_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(builders, "KEPT", 2)
    models = list(find("procedural").objects.values())[:3]
    kept = Builders(looks=False)
    first, second, third = (kept.get(model, 1.0) for model in models)
    assert kept.get(models[0], 1.0) is first
    kept.forget()
    assert kept.get(models[0], 1.0) is first and kept.get(models[2], 1.0) is third
    assert kept.get(models[1], 1.0) is not second


@pytest.mark.parametrize("looks", ["primitives", "meshes"])
def test_of_two_equal_lamps_one_is_lit_alone(tmp_path: Path, looks: str) -> None:
    """Of boxes, and of a mesh that the URDF paints: their materials are not made anew for each object."""
    if looks == "primitives":
        library = library_of(tmp_path, BOX_LAMP, category="Lamp")
    else:
        raw = make_raw(tmp_path / "raw" / "thing", "Lamp", Link("shade", STICK.box, "fixed", limits=None))
        urdf = (raw / "mobility.urdf").read_text()
        paint = '</geometry><material name="white"><color rgba="0.9 0.9 0.9 1"/></material>'
        (raw / "mobility.urdf").write_text(urdf.replace("</geometry>", paint))
        list(import_objects([raw], tmp_path / "library"))
        library = Library.load(tmp_path / "library")
    model = library.get("Lamp/thing")
    alone = lone_board(model)
    pair = [alone.objects[0].model_copy(update={"position": (x, 0, model.offset_z)}) for x in (-1, 1)]
    scene = Simulator(library, SMALL).board(alone.model_copy(update={"objects": tuple(pair)}))
    before = scene.observe().rgb
    scene.responders[0].show(1)
    changed = (scene.observe().rgb != before).any(axis=(0, 2))
    assert changed[: len(changed) // 2].any() and not changed[len(changed) // 2 :].any()


@pytest.mark.long
def test_memory_is_bounded() -> None:
    """In a process of its own: what other tests left behind moves the memory of this one."""
    code = "from tests.sim.scene.test_asset_cache import growth; print(growth())"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 100, "each object takes about 6 MB: without a bound, 200 MB come to it"


def growth() -> float:
    """MB that come with 40 boards more, if 10 objects are kept: medians, as single boards come with large objects."""
    library, resident = find("procedural"), []
    simulator = Simulator(library, SMALL)
    builders.KEPT = 10
    for board in generate_boards(BoardConfig(boards=60, group_size=1), library):
        simulator.board(board).observe()
        resident.append(psutil.Process().memory_info().rss / 1e6)
    return median(resident[-10:]) - median(resident[10:20])


def test_pictures_are_the_same_whatever_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    library = find("procedural")
    boards = list(generate_boards(BoardConfig(boards=12, group_size=1), library))
    assert len({item.key for board in boards for item in board.objects}) > 20
    forgetful, thorough = Simulator(library, SMALL), Simulator(library, SMALL)
    for board in boards:
        monkeypatch.setattr(builders, "KEPT", 10)
        forgetful.board(board).observe()
    for board in (boards[0], *boards[:4], boards[0]):
        images = []
        for simulator, kept in ((forgetful, 10), (thorough, 1000)):
            monkeypatch.setattr(builders, "KEPT", kept)
            scene = simulator.board(board)
            for number, joint in enumerate(scene.triggers):
                scene.set_trigger(number, joint.link.states - 1)
            images.append(scene.observe())
        assert (images[0].rgb == images[1].rgb).all() and (images[0].segmentation == images[1].segmentation).all()
