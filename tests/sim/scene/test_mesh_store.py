"""Meshes from the cache look like those that SAPIEN reads, and a spoilt cache is seen by nobody."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sapien.wrapper.actor_builder import VisualShapeRecord
from sapien.wrapper.articulation_builder import LinkBuilder

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardSpec
from busybot.episodes.episode import Image
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.sim.scene import asset_cache, mesh_store
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.render import RenderConfig

SMALL = RenderConfig(width=160, height=120)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("BUSYBOT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def files_read(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the mesh files that were read."""
    names: list[str] = []
    original = mesh_store._read

    def reading(folder: Path, record: VisualShapeRecord) -> Any:
        names.append(record.filename)
        return original(folder, record)

    monkeypatch.setattr(mesh_store, "_read", reading)
    return names


def pictures(library: Library, board: BoardSpec) -> list[Image]:
    """Of a simulator that knows no object yet: as the board is, and with all links in other states."""
    scene = Simulator(library, SMALL).board(board)
    first = scene.observe()
    for number, joint in enumerate(scene.triggers):
        scene.set_trigger(number, joint.link.states - 1 - joint.state)
    return [first, scene.observe()]


def same(images: list[Image], others: list[Image]) -> bool:
    parts = ("rgb", "depth", "segmentation", "boxes")
    return all((getattr(a, p) == getattr(b, p)).all() for a, b in zip(images, others, strict=True) for p in parts)


def check(library: Library, files_read: list[str], monkeypatch: pytest.MonkeyPatch) -> BoardSpec:
    """Of a board: what SAPIEN reads, what is read for the cache, and what lies there afterwards look alike."""
    board = next(generate_boards(BoardConfig(boards=1, relations="one-to-many"), library))
    with monkeypatch.context() as patch:
        patch.setattr(asset_cache, "meshes_of", lambda *_: None)
        expected = pictures(library, board)
    assert (expected[0].rgb != expected[1].rgb).any() and not files_read
    assert same(expected, pictures(library, board)) and files_read
    files_read.clear()
    assert same(expected, pictures(library, board)) and not files_read
    return board


@pytest.mark.long
def test_pictures_are_those_of_the_files(cache: Path, files_read: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    check(find("procedural"), files_read, monkeypatch)


def test_real_objects_with_their_textures(
    cache: Path, files_read: list[str], partnet: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    check(Library.load(partnet), files_read, monkeypatch)


@pytest.mark.long
def test_what_is_spoilt_is_made_again(cache: Path, files_read: list[str]) -> None:
    library = find("procedural")
    board = next(generate_boards(BoardConfig(boards=1), library))
    expected = pictures(library, board)
    kept = sorted(cache.glob("meshes-*/*.npz"))
    assert len(kept) == len({placed.key for placed in board.objects})
    whole = [file.read_bytes() for file in kept]
    for spoil in (
        lambda data: b"",
        lambda data: data[: len(data) // 2],
        lambda data: data[:200] + b"?" * 50 + data[250:],
    ):
        for file, data in zip(kept, whole, strict=True):
            file.write_bytes(spoil(data))
        files_read.clear()
        assert same(expected, pictures(library, board)) and files_read
        assert [file.read_bytes() for file in kept] == whole
    np.savez(kept[0], vertices=np.zeros((3, 7), np.float32), parts=np.frombuffer(b"{}", np.uint8))
    np.savez(kept[1], vertices=np.array([None]), parts=np.frombuffer(b"{}", np.uint8))
    assert same(expected, pictures(library, board)) and [file.read_bytes() for file in kept] == whole


def test_without_a_place_for_the_cache_nothing_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    library = find("procedural")
    board = next(generate_boards(BoardConfig(boards=1), library))
    expected = pictures(library, board)
    monkeypatch.setenv("BUSYBOT_CACHE", str(tmp_path / "file" / "cache"))
    assert same(expected, pictures(library, board))


@pytest.mark.long
def test_what_arrays_cannot_tell_is_left_to_sapien(cache: Path, tmp_path: Path) -> None:
    model = next(iter(find("procedural").objects.values()))
    for record in (VisualShapeRecord("box"), VisualShapeRecord("file", str(tmp_path / "elsewhere.obj"))):
        link = LinkBuilder(0, None)
        link.visual_records.append(record)
        assert mesh_store.meshes_of(model, [link]) is None
    assert not list(cache.glob("meshes-*/*"))
