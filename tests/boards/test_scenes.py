"""Scenes: what stands where, who is wired to whom, and that other boards are not touched by them."""

from pathlib import Path

import numpy as np
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.layout import footprint
from busybot.boards.scenes import SCENES
from busybot.boards.spec import BoardCamera, BoardSpec
from busybot.common.errors import BusybotError
from busybot.objects.library import OTHER, Library
from busybot.objects.resolve import find
from busybot.sim.scene.render import RenderConfig, camera_model
from tests.cli.commands import busybot


@pytest.fixture(scope="module")
def library() -> Library:
    return find("procedural")


def drawn(library: Library, world: str, **options: object) -> list[BoardSpec]:
    return list(generate_boards(BoardConfig.model_validate({"world": world, "boards": 12, **options}), library))


@pytest.mark.parametrize("world", SCENES)
def test_every_control_sets_a_target_and_the_rest_does_nothing(library: Library, world: str) -> None:
    for board in drawn(library, world, split="novel-object"):
        assert 12 <= len(board.objects) <= 25 and board.schema_version == "1.2" and board.world == world
        links = {
            (n, one.name) for n, placed in enumerate(board.objects) for one in library.get(placed.key).trigger_links
        }
        used = {(ref.object, ref.link) for relation in board.relations for ref in relation.triggers}
        assert used | {(ref.object, ref.link) for ref in board.idle} == links and len(used) == len(board.relations)
        responders = {relation.responder for relation in board.relations}
        assert len(responders) == len(board.relations) == (4 if world == "kitchen" else 5)
        assert board.idle and sum(placed.role == "responder" for placed in board.objects) > len(responders)


def test_a_stove_has_four_knobs_and_burners_wired_in_order_and_then_otherwise(library: Library) -> None:
    first, second, *_ = boards = drawn(library, "kitchen")
    assert first.objects == second.objects and first.camera == second.camera and first.relations != second.relations
    wired = [[(r.triggers[0].object, r.responder) for r in board.relations] for board in boards]
    assert wired[0] == [(0, 4), (1, 5), (2, 6), (3, 7)] and sorted(wired[1])[0][0] == 0
    names = [placed.key for placed in first.objects[:8]]
    assert {name.rsplit("-", 1)[0] for name in names[:4]} == {"Switch/stoveknob"} and len(set(names[:4])) == 1
    assert {name.rsplit("-", 1)[0] for name in names[4:]} == {"Lamp/burner"}
    many = drawn(library, "kitchen", boards=24, group_size=24)
    assert len({tuple(r.responder for r in board.relations) for board in many}) == 24, "all wirings there are"


@pytest.mark.parametrize("world", SCENES)
def test_objects_stand_apart_and_in_the_picture_of_their_camera(library: Library, world: str) -> None:
    for board in drawn(library, world, boards=30, group_size=1):
        boxes = []
        for placed in board.objects:
            model = library.get(placed.key)
            low, high = (np.array(side) * placed.scale / model.scale for side in footprint(model, placed.yaw, 0))
            boxes.append((low + placed.position[:2], high + placed.position[:2]))
        for n, (low, high) in enumerate(boxes):
            assert (np.abs([low, high]) <= np.array(board.size) / 2).all()
            assert not any((low < b).all() and (high > a).all() for a, b in boxes[:n])
        camera = camera_model(RenderConfig().of_board(board))
        assert board.camera is not None and camera.pose[:3, 3] == pytest.approx(board.camera.position)
        points = np.linalg.inv(camera.pose) @ np.array([[*placed.position, 1] for placed in board.objects]).T
        pixels = (camera.matrix @ points[:3] / points[2])[:2].T
        inside = ((pixels > 4) & (pixels < [636, 476])).all(1)
        wired = {n for r in board.relations for n in (r.responder, r.triggers[0].object)}
        assert inside[sorted(wired)].all() and inside.sum() >= len(inside) - 2, "bystanders may stand at the edge"


def test_boards_of_other_worlds_have_neither_cameras_nor_objects_of_scenes(library: Library) -> None:
    strange = set(library.splits[OTHER])
    assert len(strange) == 15
    for split in ("train", "novel-object"):
        for board in generate_boards(BoardConfig(split=split, boards=40, uniform=True), library):
            assert board.camera is None and '"camera"' not in board.model_dump_json()
            assert not strange & {placed.key for placed in board.objects}


def test_a_camera_is_read_written_and_hashed(library: Library) -> None:
    board = drawn(library, "room", boards=1)[0]
    assert BoardSpec.model_validate_json(board.model_dump_json()) == board
    other = board.model_copy(update={"camera": BoardCamera(position=(0, 0, 5), target=(0, 0, 0), fov_deg=60)})
    assert other.digest() != board.digest()


def test_a_camera_at_its_target_is_refused() -> None:
    near = {"position": (0, 0, 1e-4), "target": (0, 0, 0), "fov_deg": 60}
    with pytest.raises(ValueError, match="position and target are the same point"):
        BoardCamera.model_validate(near)


def test_a_longer_dataset_begins_with_a_shorter_one(library: Library) -> None:
    assert drawn(library, "room", boards=3) == drawn(library, "room", boards=8)[:3]


def test_real_objects_play_the_parts_too(partnet: Path) -> None:
    library = Library.load(partnet)
    for world in SCENES:
        for board in drawn(library, world, boards=4):
            assert len(board.relations) == (4 if world == "kitchen" else 5)


def test_what_a_scene_does_not_take_is_said(tmp_path: Path, library: Library) -> None:
    done = busybot("generate", str(tmp_path / "set"), "--world", "kitchen", "--links", "3-6")
    assert done.returncode == 2 or done.returncode == 1
    assert "links" in done.stderr and "has boards of its own" in done.stderr
    for options in ({"split": "novel-mechanism"}, {"tasks": "one-to-one"}, {"relations": "one-to-many"}):
        with pytest.raises(ValueError, match="world"):
            BoardConfig.model_validate({"world": "kitchen", **options})
    empty = Library("few", tmp_path, {}, {"train": {}, "novel": {}})
    with pytest.raises(BusybotError, match="no Switch for a control"):
        drawn(empty, "kitchen")


def test_a_scene_may_have_tasks(library: Library) -> None:
    board = drawn(library, "kitchen", boards=1, tasks="reach")[0]
    assert board.task is not None and board.camera is not None
