"""Files are whole or absent, never written through a planted link; what killed processes left is removed, no more."""

import errno
import os
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from busybot.common.atomic_io import (
    append_line,
    copy_file,
    forbid_writing,
    make_folder,
    names_in,
    new_file,
    one_writer,
    refuse_taken,
    remove,
    remove_abandoned,
    remove_leftovers,
    rename,
    replacing,
    replacing_by_path,
    unfinished,
    write_atomically,
    write_json,
)
from busybot.common.errors import BusybotError


def replace_by_path(path: Path, root: Path | None) -> None:
    with replacing_by_path(path, root) as place:
        place.write_bytes(b"new")


def make_unfinished(path: Path, root: Path | None) -> None:
    with unfinished(path.parent, path.name, root):
        pass


def move(path: Path, root: Path | None) -> None:
    made = (root or path.parent) / "made"
    made.write_bytes(b"new")
    rename(made, path, root)


WAYS: dict[str, Callable[[Path, Path | None], object]] = {
    "write": lambda path, root: write_atomically(path, b"new", root),
    "json": lambda path, root: write_json(path, {}, root),
    "path": replace_by_path,
    "new": lambda path, root: new_file(path, root).close(),
    "copy": lambda path, root: copy_file(Path(__file__), path, root),
    "append": lambda path, root: append_line(path, "new", root),
    "folder": make_folder,
    "unfinished": make_unfinished,
    "move": move,
    "move away": lambda path, root: rename(path, (root or path.parent) / "moved", root),
    "remove": remove,
    "forbid": lambda path, root: forbid_writing(path, root or path.parent),
}


def everything(folder: Path) -> dict[str, tuple[int, bytes]]:
    """Kind, permissions and content of all that is in it."""
    return {
        str(path.relative_to(folder)): (path.lstat().st_mode, path.read_bytes() if path.is_file() else b"")
        for path in sorted([folder, *folder.rglob("*")])
    }


@pytest.fixture
def outside(tmp_path: Path) -> Path:
    """A folder that nothing may touch."""
    folder = tmp_path / "outside"
    (folder / "folder").mkdir(parents=True)
    for name in ("precious", "folder/precious"):
        (folder / name).write_bytes(b"precious")
    return folder


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("place", ["linked/precious", "linked/folder/precious", "a/linked/precious"])
def test_no_folder_below_the_root_may_be_a_link(tmp_path: Path, outside: Path, way: str, place: str) -> None:
    root, before = tmp_path / "root", everything(outside)
    path = root / place
    link = root / place[: place.index("linked") + len("linked")]
    link.parent.mkdir(parents=True)
    link.symlink_to(outside)
    with pytest.raises(BusybotError, match="link") as error:
        WAYS[way](path, root)
    assert str(link) in error.value.what and error.value.hint
    assert everything(outside) == before


@pytest.mark.parametrize("way", sorted(set(WAYS) - {"forbid", "move away", "unfinished"}))
def test_links_on_the_way_to_what_the_user_named_are_followed(tmp_path: Path, outside: Path, way: str) -> None:
    (tmp_path / "data").symlink_to(outside)
    WAYS[way](tmp_path / "data" / "named", None)
    assert (outside / "named").exists() == (way != "remove")
    WAYS[way](tmp_path / "data" / "more" / "named", tmp_path / "data")
    assert (outside / "more" / "named").exists() == (way != "remove")


@pytest.mark.parametrize("way", ["write", "json", "path", "copy", "move"])
def test_a_link_at_the_final_name_is_replaced(tmp_path: Path, outside: Path, way: str) -> None:
    before = everything(outside)
    (tmp_path / "named").symlink_to(outside / "precious")
    WAYS[way](tmp_path / "named", None)
    assert not (tmp_path / "named").is_symlink() and everything(outside) == before


@pytest.mark.parametrize("plant", [os.symlink, os.link])
def test_nothing_is_appended_to_what_has_another_name(
    tmp_path: Path, outside: Path, plant: Callable[[Path, Path], None]
) -> None:
    before = everything(outside)
    plant(outside / "precious", tmp_path / "lines")
    with pytest.raises(BusybotError, match="lines"):
        append_line(tmp_path / "lines", "new")
    assert everything(outside) == before
    (tmp_path / "lines").unlink()
    for line in ("one", "two"):
        append_line(tmp_path / "lines", line)
    assert (tmp_path / "lines").read_text() == "one\ntwo\n"


def test_new_files_are_new(tmp_path: Path, outside: Path) -> None:
    before = everything(outside)
    (tmp_path / "named").symlink_to(outside / "precious")
    with pytest.raises(FileExistsError):
        new_file(tmp_path / "named")
    assert everything(outside) == before


def test_the_lock_is_not_followed(tmp_path: Path, outside: Path) -> None:
    before = everything(outside)
    (tmp_path / ".lock").symlink_to(outside / "precious")
    with pytest.raises(BusybotError, match=r"\.lock"), one_writer(tmp_path):
        pass
    (tmp_path / ".lock").unlink()
    os.mkfifo(tmp_path / ".lock")
    with pytest.raises(BusybotError, match=r"\.lock"), one_writer(tmp_path):
        pass
    (tmp_path / ".lock").unlink()
    os.link(outside / "precious", tmp_path / ".lock")
    with one_writer(tmp_path), pytest.raises(BusybotError, match="another process"), one_writer(tmp_path):
        pass
    assert everything(outside) == before


def test_even_a_guessed_temporary_name_is_not_followed(
    tmp_path: Path, outside: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = everything(outside)
    monkeypatch.setattr(os, "urandom", lambda count: b"\0" * count)
    (tmp_path / f".named.{os.getpid()}-{'0' * 16}.tmp").symlink_to(outside / "precious")
    with pytest.raises(FileExistsError):
        write_atomically(tmp_path / "named", b"new")
    assert everything(outside) == before and not (tmp_path / "named").exists()


def test_a_file_system_without_locks_is_not_taken_for_another_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def flock(file: object, how: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("fcntl.flock", flock)
    with pytest.raises(OSError, match="No locks available") as error, one_writer(tmp_path):
        pass
    assert error.value.filename == str(tmp_path / ".lock")


def test_temporary_names_differ(tmp_path: Path) -> None:
    names = set()
    for _ in range(3):
        with replacing(tmp_path / "named"):
            names |= {path.name for path in tmp_path.iterdir()} - {"named"}
    assert len(names) == 3 and all(name.startswith(f".named.{os.getpid()}-") for name in names)


def test_a_folder_that_is_exchanged_for_a_link_meanwhile_is_not_followed(tmp_path: Path, outside: Path) -> None:
    before = everything(outside)
    with replacing(tmp_path / "root" / "folder" / "named", tmp_path / "root") as file:
        file.write(b"new")
        (tmp_path / "root" / "folder").rename(tmp_path / "moved")
        (tmp_path / "root" / "folder").symlink_to(outside)
    assert everything(outside) == before and (tmp_path / "moved" / "named").read_bytes() == b"new"


def test_a_failure_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "named"
    path.write_bytes(b"old")
    with pytest.raises(KeyboardInterrupt), replacing(path) as file:
        file.write(b"half")
        raise KeyboardInterrupt
    with pytest.raises(KeyboardInterrupt), replacing_by_path(path) as place:
        place.write_bytes(b"half")
        raise KeyboardInterrupt
    assert path.read_bytes() == b"old" and list(tmp_path.iterdir()) == [path]


def test_faults_of_the_file_system_name_the_path(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(OSError) as error:
        write_atomically(tmp_path / "file" / "named", b"new")
    assert str(tmp_path / "file") in str(error.value)
    (tmp_path / "folder" / "named" / "more").mkdir(parents=True)
    with pytest.raises(BusybotError, match="folder/named: a folder, where a file belongs"):
        write_atomically(tmp_path / "folder" / "named", b"new")
    assert [path.name for path in (tmp_path / "folder").iterdir()] == ["named"]
    with pytest.raises(BusybotError, match="file where a folder"):
        write_atomically(tmp_path / "file" / "named", b"new", tmp_path)


def test_no_device_is_replaced(tmp_path: Path) -> None:
    """As `/dev/null` would be by root."""
    device, file = tmp_path / "null", tmp_path / "file"
    file.write_text("")
    try:
        os.mknod(device, stat.S_IFCHR | 0o600, os.makedev(1, 3))
    except PermissionError:
        pytest.skip("only root makes devices")
    for write in (lambda: write_atomically(device, b""), lambda: rename(file, device)):
        with pytest.raises(BusybotError, match="null: a device, where a file belongs"):
            write()
    assert device.is_char_device() and {entry.name for entry in tmp_path.iterdir()} == {"null", "file"}


def test_nor_is_a_link_to_one(tmp_path: Path) -> None:
    link = tmp_path / "null"
    link.symlink_to(os.devnull)
    with pytest.raises(BusybotError, match="null: a device, where a file belongs"):
        write_atomically(link, b"")
    assert link.is_symlink() and [*tmp_path.iterdir()] == [link]


def test_a_path_may_not_climb_out(tmp_path: Path) -> None:
    with pytest.raises(BusybotError, match=r"\.\."):
        write_atomically(tmp_path / "root" / ".." / "named" / "x", b"new", tmp_path / "root")
    with pytest.raises(ValueError, match="root"):
        write_atomically(tmp_path / "named", b"new", tmp_path / "root")


def test_permissions_are_the_usual_ones(tmp_path: Path) -> None:
    (tmp_path / "usual").write_bytes(b"")
    (tmp_path / "usual folder").mkdir()
    WAYS["write"](tmp_path / "new folder" / "new", tmp_path)
    replace_by_path(tmp_path / "other", None)
    usual, folder = ((tmp_path / name).stat().st_mode for name in ("usual", "usual folder"))
    assert (tmp_path / "new folder" / "new").stat().st_mode == (tmp_path / "other").stat().st_mode == usual
    assert (tmp_path / "new folder").stat().st_mode == folder
    with replacing_by_path(tmp_path / "other") as place:
        assert stat.S_IMODE(place.parent.stat().st_mode) == 0o700
        place.write_bytes(b"")
    forbid_writing(tmp_path / "usual", tmp_path)
    forbid_writing(tmp_path / "usual folder", tmp_path / "usual folder")
    assert stat.S_IMODE((tmp_path / "usual").stat().st_mode) == stat.S_IMODE(usual) & ~0o222
    assert stat.S_IMODE((tmp_path / "usual folder").stat().st_mode) == stat.S_IMODE(folder) & ~0o222


def test_only_temporary_files_of_dead_processes_go(tmp_path: Path, outside: Path) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    random = "0123456789abcdef"
    folder = tmp_path / "root" / "folder"
    folder.mkdir(parents=True)
    gone = [f".x.{dead.pid}.tmp", f".x.{dead.pid}-{random}.tmp", f"folder/.x.y.{dead.pid}-{random}.tmp"]
    kept = [
        f".x.{os.getpid()}.tmp",
        f".x.{os.getpid()}-{random}.tmp",
        f"x.{dead.pid}.tmp",
        ".x.tmp",
        f".x.{random}.tmp",
    ]
    for name in (*gone, *kept):
        (tmp_path / "root" / name).write_bytes(b"half")
    (folder / f".z.{dead.pid}.tmp").symlink_to(outside / "precious")
    assert names_in(tmp_path / "root") == {"folder", *(f"x.{dead.pid}.tmp", ".x.tmp", f".x.{random}.tmp")}
    assert remove_leftovers(tmp_path / "root") == len(gone)
    assert {path.name for path in (tmp_path / "root").iterdir()} == {*kept, "folder"}


def test_removing_takes_the_link_and_not_what_it_leads_to(tmp_path: Path, outside: Path) -> None:
    before = everything(outside)
    (tmp_path / "root" / "folder").mkdir(parents=True)
    for name in ("link", "folder/link"):
        (tmp_path / "root" / name).symlink_to(outside)
    for name in ("link", "folder", "absent", "absent/more"):
        remove(tmp_path / "root" / name, tmp_path / "root")
    assert everything(outside) == before and not list((tmp_path / "root").iterdir())


KILLED = """
import os, pathlib, sys
from busybot.common.atomic_io import unfinished
with unfinished(pathlib.Path(sys.argv[1]), "work") as folder:
    (folder / "half").write_text("done")
    os.kill(os.getpid(), 9)
"""


def killed(parent: Path) -> Path:
    """What a process leaves that is killed at its work."""
    before = set(parent.iterdir())
    assert subprocess.run([sys.executable, "-c", KILLED, str(parent)]).returncode == -9
    (left,) = set(parent.iterdir()) - before
    return left


def test_only_what_a_killed_process_left_is_removed(tmp_path: Path) -> None:
    others = [tmp_path / name for name in (".work-notes", ".work-mine.tmp", "work-01234567.tmp", ".other-01234567.tmp")]
    for folder in others:
        folder.mkdir()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "precious").write_text("")
    link = tmp_path / ".work-01234567.tmp"
    link.symlink_to(elsewhere)
    left = killed(tmp_path)
    with unfinished(tmp_path, "work") as running:
        code = (
            "import pathlib, sys; from busybot.common.atomic_io import remove_abandoned;"
            " remove_abandoned(pathlib.Path(sys.argv[1]), 'work')"
        )
        subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=True)
        assert not left.exists() and running.exists()
        assert all(folder.exists() for folder in others) and link.is_symlink() and (elsewhere / "precious").exists()
    assert not running.exists()


def test_something_can_be_saved_from_it_first(tmp_path: Path) -> None:
    killed(tmp_path)
    remove_abandoned(tmp_path, "work", rescue=lambda folder: (folder / "half").rename(tmp_path / "saved"))
    assert [path.name for path in tmp_path.iterdir()] == ["saved"]


def test_what_was_renamed_stays(tmp_path: Path) -> None:
    with unfinished(tmp_path, "work") as folder:
        (folder / "whole").write_text("")
        folder.rename(tmp_path / "place")
    assert [path.name for path in tmp_path.iterdir()] == ["place"] and (tmp_path / "place/whole").exists()


def test_only_nothing_or_an_empty_folder_can_be_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    refuse_taken(tmp_path / "absent")
    refuse_taken(empty)
    (tmp_path / "link").symlink_to(empty)
    (tmp_path / "file").write_text("")
    for path in (tmp_path, tmp_path / "link", tmp_path / "file"):
        with pytest.raises(BusybotError, match="not an empty folder"):
            refuse_taken(path)
    monkeypatch.chdir(empty)
    with pytest.raises(BusybotError, match="current folder"):
        refuse_taken(Path("."))
