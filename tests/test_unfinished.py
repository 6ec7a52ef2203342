"""What a killed process was making is removed by the next one; what another is making is left alone."""

import subprocess
import sys
from pathlib import Path

import pytest

from busybot.errors import BusybotError
from busybot.unfinished import refuse_taken, remove_abandoned, unfinished

KILLED = """
import os, pathlib, sys
from busybot.unfinished import unfinished
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
            "import pathlib, sys; from busybot.unfinished import remove_abandoned;"
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
