"""Raw folders become a library that can be used at once; nothing leaves the object's folder, nothing is half there."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from busybot.common.atomic_io import rename, unfinished, write_json
from busybot.common.errors import BusybotError
from busybot.objects.importing import importer as importing
from busybot.objects.importing.annotation_edits import Choices, Overrides
from busybot.objects.importing.importer import ImportOutcome, import_objects, raw_folders
from busybot.objects.library import Library
from tests.objects.raw_objects import DRAWER, LEAF, LEVER, ROCKER, make_raw


def put(out: Path | None, *folders: Path, **options: Any) -> list[ImportOutcome]:
    return list(import_objects(folders, out, **options))


def given(**choices: Choices) -> Overrides:
    return Overrides(Path("review.yaml"), {name.removeprefix("id"): value for name, value in choices.items()}, {})


def everything(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def raw(tmp_path: Path) -> Path:
    for name, category, link in (("1", "Switch", ROCKER), ("2", "Switch", LEVER), ("3", "Door", LEAF)):
        make_raw(tmp_path / "raw" / name, category, link)
    return tmp_path / "raw"


def test_a_folder_of_raw_objects_becomes_a_library(raw: Path, tmp_path: Path) -> None:
    out = tmp_path / "library"
    done = put(out, *raw_folders([raw]))
    assert [(outcome.key, outcome.done, outcome.split) for outcome in done] == [
        ("Switch/1", "imported", "train"),
        ("Switch/2", "imported", "train"),
        ("Door/3", "imported", "train"),
    ]
    library = Library.load(out)
    assert list(library.objects) == ["Door/3", "Switch/1", "Switch/2"]
    assert library.weights("train", "Switch") == [("Switch/1", 1), ("Switch/2", 1)]
    before = everything(out)
    assert [outcome.done for outcome in put(out, *raw_folders([raw]))] == ["unchanged"] * 3
    assert everything(out) == before, "the same import again changes nothing"


def test_only_what_the_object_needs_is_copied(raw: Path, tmp_path: Path) -> None:
    (raw / "1" / "parts_render").mkdir()
    (raw / "1" / "parts_render" / "0.png").write_bytes(b"picture")
    (raw / "1" / "notes.html").write_text("<html>")
    (raw / "1" / "textured_objs" / "unused.obj").write_text("v 0 0 0\n")
    put(tmp_path / "library", raw / "1")
    assert sorted(everything(tmp_path / "library" / "Switch" / "1")) == [
        "meta.json",
        "mobility.urdf",
        "mobility_v2.json",
        "object_meta_info.json",
        "semantics.txt",
        "textured_objs/body.obj",
        "textured_objs/link_0.obj",
        "textured_objs/paint.mtl",
    ]


def test_one_bad_object_does_not_stop_the_others(raw: Path, tmp_path: Path) -> None:
    (raw / "2" / "mobility.urdf").write_text("<robot")
    done = put(tmp_path / "library", *raw_folders([raw]))
    assert [outcome.done for outcome in done] == ["imported", "refused", "imported"]
    assert "mobility.urdf" in (done[1].problem or "") and done[1].hint
    assert "Switch/2" not in Library.load(tmp_path / "library").objects


def test_without_a_library_nothing_is_written(raw: Path, tmp_path: Path) -> None:
    before = everything(tmp_path)
    (done,) = put(None, raw / "1")
    assert done.done == "proposed" and done.choices is not None and everything(tmp_path) == before


def test_splits(raw: Path, tmp_path: Path) -> None:
    """The paper's objects keep the paper's split and weight; a split that is asked for, or was set by hand, counts."""
    out = tmp_path / "library"
    novel, heavy = make_raw(raw / "100914", "Switch", ROCKER), make_raw(raw / "100965", "Switch", LEVER)
    assert [outcome.split for outcome in put(out, novel, heavy)] == ["novel", "train"]
    assert Library.load(out).splits == {"train": {"Switch/100965": 4}, "novel": {"Switch/100914": 1}}
    assert [outcome.split for outcome in put(out, raw / "1", split="novel")] == ["novel"]
    value = json.loads((out / "data.json").read_text())
    value["Reason"]["Switch"] = {"train": ["1", "1", "100965"], "test": ["100914"]}
    write_json(out / "data.json", value | {"Interact": {"kept": True}})
    assert [outcome.split for outcome in put(out, raw / "1")] == ["train"], "what the file says stays"
    assert Library.load(out).splits["train"]["Switch/1"] == 2
    put(out, raw / "1", split="novel")
    assert "Switch/1" not in Library.load(out).splits["train"]
    assert json.loads((out / "data.json").read_text())["Interact"] == {"kept": True}


def test_an_object_of_scenes_stays_one_unless_another_split_is_asked_for(raw: Path, tmp_path: Path) -> None:
    out = tmp_path / "library"
    put(out, raw / "1")
    write_json(out / "data.json", {"Reason": {"Switch": {"other": ["1"]}}})
    assert [outcome.split for outcome in put(out, raw / "1")] == ["other"]
    assert Library.load(out).splits["other"] == {"Switch/1": 1}
    put(out, raw / "1", split="train")
    library = Library.load(out)
    assert library.splits["train"] == {"Switch/1": 1} and not library.splits.get("other")


def test_another_object_of_the_same_name_is_replaced_only_when_asked(raw: Path, tmp_path: Path) -> None:
    out = tmp_path / "library"
    put(out, raw / "1")
    before = everything(out)
    larger = given(id1=Choices(scale=0.4))
    (done,) = put(out, raw / "1", overrides=larger)
    assert done.done == "refused" and "--replace" in (done.hint or "") and everything(out) == before
    assert put(out, raw / "1", overrides=larger, replace=True)[0].done == "imported"
    assert Library.load(out).get("Switch/1").scale == 0.4
    # with another category it moves
    put(out, raw / "1", overrides=given(id1=Choices(category="Door")), replace=True)
    library = Library.load(out)
    assert list(library.objects) == ["Door/1"] and library.splits["train"] == {"Door/1": 1}
    assert sorted(path.name for path in out.iterdir()) == ["Door", "Switch", "data.json"]


def test_objects_can_be_left_out(raw: Path, tmp_path: Path) -> None:
    (done,) = put(tmp_path / "library", raw / "1", overrides=given(id1=Choices(use=False)))
    assert done.done == "left out" and not (tmp_path / "library").exists()


@pytest.mark.parametrize("call", [1, 2])
def test_a_stop_at_the_worst_moment_leaves_a_readable_library(
    raw: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: int
) -> None:
    """Also between taking the former object away and putting the new one in its place."""
    out = tmp_path / "library"
    put(out, raw / "1", raw / "2")
    real, calls = rename, []

    def stops(source: Path, target: Path, root: Path | None = None) -> None:
        calls.append(target)
        if len(calls) == call:
            raise KeyboardInterrupt
        real(source, target, root)

    monkeypatch.setattr(importing, "rename", stops)
    with pytest.raises(KeyboardInterrupt):
        put(out, raw / "1", overrides=given(id1=Choices(scale=0.4)), replace=True)
    monkeypatch.undo()
    assert set(Library.load(out).objects) == {"Switch/1", "Switch/2"}
    assert put(out, raw / "1", overrides=given(id1=Choices(scale=0.4)), replace=True)[0].done == "imported"
    assert Library.load(out).get("Switch/1").scale == 0.4


@pytest.mark.parametrize("after", [False, True], ids=["before", "after"])
@pytest.mark.parametrize("step", [1, 2, 3, 4])
def test_a_stop_at_any_step_of_a_move_to_another_category_leaves_a_readable_library(
    raw: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: int, after: bool
) -> None:
    """The steps: the list, the old folder, the new one, the list again; in between the library can be read, too."""
    out, door = tmp_path / "library", given(id1=Choices(category="Door"))
    put(out, raw / "1", raw / "2")
    value = json.loads((out / "data.json").read_text())
    value["Reason"]["Switch"]["train"] += ["1"]  # drawn twice as often
    write_json(out / "data.json", value)
    before, done = everything(out), []

    def stopping(real: Callable[..., None]) -> Callable[..., None]:
        def call(*arguments: Any) -> None:
            done.append(arguments)
            Library.load(out)
            if len(done) == step and not after:
                raise KeyboardInterrupt
            real(*arguments)
            Library.load(out)
            if len(done) == step:
                raise KeyboardInterrupt

        return call

    for name, real in (("rename", rename), ("write_json", write_json)):
        monkeypatch.setattr(importing, name, stopping(real))
    with pytest.raises(KeyboardInterrupt):
        put(out, raw / "1", overrides=door, replace=True)
    monkeypatch.undo()
    library = Library.load(out)
    assert set(library.objects) in ({"Switch/1", "Switch/2"}, {"Door/1", "Switch/2"})
    if "Switch/1" in library.objects:
        assert everything(out) == before, "nothing is left of what was broken off"
    assert put(out, raw / "1", overrides=door, replace=True)[0].problem is None
    library = Library.load(out)
    assert library.splits["train"] == {"Door/1": 1, "Switch/2": 1} and set(library.objects) == {"Door/1", "Switch/2"}
    assert "1" not in json.loads((out / "data.json").read_text())["Reason"]["Switch"]["train"]


KILLED = """
import os, pathlib, sys
from busybot.objects.importing import importer
from busybot.objects.importing.annotation_edits import Choices, Overrides
from busybot.objects.importing.importer import import_objects
real, call, choices = importer.rename, int(sys.argv[3]), Choices.model_validate_json(sys.argv[4])
def killing(source, target, root=None):
    global call
    call -= 1
    if not call:
        os.kill(os.getpid(), 9)
    real(source, target, root)
importer.rename = killing
raw, out = map(pathlib.Path, sys.argv[1:3])
list(import_objects([raw], out, Overrides(None, {raw.name: choices}, {}), replace=True))
"""


def kill(raw: Path, out: Path, call: int, choices: Choices) -> None:
    """Import with --replace, and die before this call of `rename`."""
    command = [sys.executable, "-c", KILLED, raw, out, str(call), choices.model_dump_json(exclude_unset=True)]
    assert subprocess.run(command).returncode == -9


@pytest.mark.parametrize("call", [1, 2])
@pytest.mark.parametrize("choices", [Choices(scale=0.4), Choices(category="Door")], ids=["same", "moved"])
def test_what_a_killed_import_left_is_put_back_and_removed(
    raw: Path, tmp_path: Path, call: int, choices: Choices
) -> None:
    """Also by an import of something else; what another running import is making stays."""
    out = tmp_path / "library"
    put(out, raw / "1", raw / "2")
    before = everything(out)
    kill(raw / "1", out, call, choices)
    assert set(Library.load(out).objects) >= {"Switch/2"}, "it can be read before anything is put back"
    assert len(list(out.glob(".import-*"))) == 1
    with unfinished(out, "import") as running:
        assert put(out, raw / "2")[0].done == "unchanged"
        assert running.exists() and list(out.glob(".import-*")) == [running]
    assert everything(out) == before
    assert put(out, raw / "1", overrides=given(id1=Choices(scale=0.4)), replace=True)[0].done == "imported"
    assert Library.load(out).get("Switch/1").scale == 0.4


def link_mesh(folder: Path) -> None:
    (folder / "textured_objs" / "body.obj").rename(folder.parent / "outside.obj")
    (folder / "textured_objs" / "body.obj").symlink_to(folder.parent / "outside.obj")


def link_folder(folder: Path) -> None:
    (folder / "textured_objs").rename(folder.parent / "elsewhere")
    (folder / "textured_objs").symlink_to(folder.parent / "elsewhere")


def write(name: str, text: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_text(text)


HOSTILE: dict[str, tuple[Callable[[Path], object], str]] = {
    "mesh is a link": (link_mesh, "is a link"),
    "meshes' folder is a link": (link_folder, "is a link"),
    "material above": (write("textured_objs/body.obj", "mtllib ../../secret.mtl\nv 0 0 0\nf 1 1 1\n"), "secret.mtl"),
    "texture above": (write("textured_objs/paint.mtl", "newmtl a\nmap_Kd ../../../etc/passwd\n"), "passwd"),
    "a pipe": (lambda folder: os.mkfifo(folder / "pipe"), "not a regular file"),
    "annotated already": (write("object_meta_info.json", "{}"), "annotated already"),
    "category with a path": (write("meta.json", '{"model_cat": "../../Switch"}'), "meta.json"),
    "category is a list": (write("meta.json", '{"model_cat": ["Switch"]}'), "meta.json"),
    "meta is a list": (write("meta.json", "[]"), "meta.json"),
    "meta nested without end": (write("meta.json", "[" * 100_000), "meta.json"),
    "names of no link": (write("semantics.txt", "link_99 hinge button\n"), "line 1"),
    "half a name": (write("semantics.txt", "link_0 hinge lever\nlink_0 hinge\n"), "line 2"),
    "names with control characters": (write("semantics.txt", "link_0 hinge \x1b[31mbutton\n"), "line 1"),
    "names without end": (write("semantics.txt", "link_0 hinge a\n" * 100_000), "bytes are more"),
    "parts are a number": (write("mobility_v2.json", '[{"id": 0, "parts": 7}]'), "mobility_v2.json"),
    "parts without id": (write("mobility_v2.json", '[{"name": "x"}]'), "mobility_v2.json"),
    "parts without end": (
        write("mobility_v2.json", json.dumps([{"id": 0, "parts": [{"name": "a"}] * 20_000}])),
        "more than 10000 parts",
    ),
    "a box of words": (write("bounding_box.json", '{"min": "abc", "max": [1, 2, 3]}'), "bounding_box.json"),
    "an endless box": (write("bounding_box.json", '{"min": [0, 0, 0], "max": [1, 2, Infinity]}'), "bounding_box.json"),
    "a joint called like an argument, without a link": (
        write("mobility.urdf", '<robot name="r"><link name="a"/><joint name="raw" type="fixed"/></robot>'),
        "mobility.urdf",
    ),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_folders_are_refused_by_name_and_leave_nothing(raw: Path, tmp_path: Path, name: str) -> None:
    damage, reason = HOSTILE[name]
    damage(raw / "1")
    (done,) = put(tmp_path / "library", raw / "1")
    assert done.done == "refused" and reason in (done.problem or ""), done.problem
    assert not (tmp_path / "library").exists()


def test_folders_that_are_no_objects(raw: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for paths in ([tmp_path / "none"], [tmp_path / "empty"], [raw / "1", raw / "1"]):
        with pytest.raises(BusybotError):
            raw_folders(paths)
    (raw / "linked").symlink_to(raw / "1")
    assert [folder.name for folder in raw_folders([raw])] == ["1", "2", "3"], "links in a folder are not followed"


@pytest.mark.long
def test_a_library_that_is_none_is_refused(raw: Path, tmp_path: Path) -> None:
    (tmp_path / "linked").symlink_to(tmp_path)
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / "data.json").write_text("[]")
    (tmp_path / "categories").mkdir()
    (tmp_path / "categories" / "Switch").symlink_to(tmp_path)
    for out in (tmp_path / "linked", tmp_path / "damaged", tmp_path / "categories", raw / "2"):
        before = everything(out)
        with pytest.raises(BusybotError):
            put(out, raw / "1")
        assert everything(out) == before


def test_a_sliding_door_without_states_opens_in_board_units(tmp_path: Path) -> None:
    """The annotation may leave the states out; the limits are object units, an effect's positions board units."""
    put(tmp_path / "library", make_raw(tmp_path / "3", "Door", DRAWER))
    path = tmp_path / "library" / "Door" / "3" / "object_meta_info.json"
    value = json.loads(path.read_text())
    value["Effect"][0]["States"] = None
    path.write_text(json.dumps(value))
    model = Library.load(tmp_path / "library").get("Door/3")
    assert model.effect is not None and model.effect.single == ((0,), (pytest.approx(0.5 * model.scale),))
    assert model.bounds_max[2] == pytest.approx(0.15 + 0.5)


def test_two_imports_into_one_library_at_once_lose_nothing(
    raw: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each reads the split file, adds its object and writes it: in between another one would be forgotten."""
    put(tmp_path / "library", raw / "1")
    code = f"""
from pathlib import Path
from busybot.objects.importing.importer import import_objects
list(import_objects([Path({str(raw / "2")!r})], Path({str(tmp_path / "library")!r})))
"""
    others: list[subprocess.Popen[bytes]] = []

    def slowly(path: Path, value: Any) -> None:
        others.append(subprocess.Popen([sys.executable, "-c", code]))
        with suppress(subprocess.TimeoutExpired):
            others[0].wait(5)
        write_json(path, value)

    monkeypatch.setattr(importing, "write_json", slowly)
    put(tmp_path / "library", raw / "3")
    assert [other.wait(60) for other in others] == [0]
    assert set(Library.load(tmp_path / "library").objects) == {"Switch/1", "Switch/2", "Door/3"}
