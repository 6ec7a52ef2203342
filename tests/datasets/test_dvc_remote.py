"""Frozen datasets through a shared folder: what is pulled is what was pushed, and nothing leaves the folder."""

import hashlib
import json
import os
import shutil
from pathlib import Path
from typing import ClassVar

import pytest

from busybot.common.atomic_io import one_writer
from busybot.common.errors import BusybotError
from busybot.datasets import dvc_remote as module
from busybot.datasets.dataset import Dataset
from busybot.datasets.dvc_remote import address, check_listing, find_tool, pull, push, read_pointer
from busybot.datasets.freeze import freeze
from busybot.datasets.verify import verify
from tests.episodes.folders import make_dataset

POINTER = "outs:\n- md5: {md5}.dir\n  size: 10\n  nfiles: 2\n  hash: md5\n  path: {path}\n"
MD5 = "4ffb46ba37bd2ce52470086b4756420b"


@pytest.fixture
def frozen(tmp_path: Path) -> Path:
    dataset = make_dataset(tmp_path / "here" / "toys", boards=2, finished=(0, 1))
    freeze(dataset.path, None)
    return dataset.path


@pytest.fixture
def dvc() -> None:
    try:
        find_tool()
    except BusybotError:
        pytest.skip("DVC is not installed: `make dvc` does it")


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.long
@pytest.mark.usefixtures("dvc")
def test_a_pulled_dataset_is_the_pushed_one(frozen: Path, tmp_path: Path) -> None:
    sent = push(frozen, str(tmp_path / "remote"))
    assert sent.pointer == frozen.with_name("toys.dvc") and sent.files == len(contents(frozen))
    there = tmp_path / "there" / "toys"
    there.parent.mkdir()
    shutil.copy(sent.pointer, there.parent)
    got = pull(there, str(tmp_path / "remote"))
    assert got.new and contents(there) == contents(frozen)
    assert Dataset.open(there).hashes() == Dataset.open(frozen).hashes()
    assert {entry.name for entry in there.parent.iterdir()} == {"toys", "toys.dvc"}
    assert not pull(there, str(tmp_path / "remote")).new, "nothing is fetched twice"
    (there / ".hidden").write_text("of a file manager")
    assert not pull(there, str(tmp_path / "remote")).new


@pytest.mark.long
@pytest.mark.usefixtures("dvc")
@pytest.mark.parametrize(
    ("damaged", "more"), [("dataset.json", b"more"), ("manifest.json", b"more"), ("manifest.json", b"\n")]
)
def test_what_was_changed_on_the_way_gets_no_name(damaged: str, more: bytes, frozen: Path, tmp_path: Path) -> None:
    """Whoever controls the storage can put something else under an address, but not what the manifest says, nor
    another manifest than the pointer means."""
    sent = push(frozen, str(tmp_path / "remote"))
    there = tmp_path / "there" / "toys"
    there.parent.mkdir()
    shutil.copy(sent.pointer, there.parent)
    listing = next((tmp_path / "remote").rglob("*.dir"))
    first = next(one for one in json.loads(listing.read_text()) if one["relpath"] == damaged)
    stored = tmp_path / "remote" / "files" / "md5" / first["md5"][:2] / first["md5"][2:]
    whole = stored.read_bytes()
    stored.chmod(0o644)
    stored.write_bytes(whole + more)
    with pytest.raises(BusybotError, match=f"{damaged} came from there"):
        pull(there, str(tmp_path / "remote"))
    assert not there.exists()
    stored.write_bytes(whole)
    assert pull(there, str(tmp_path / "remote")).new, "what was damaged is fetched again"
    assert contents(there) == contents(frozen)


@pytest.mark.long
@pytest.mark.usefixtures("dvc")
def test_names_that_mean_something_to_other_programs_are_names(tmp_path: Path) -> None:
    for name in ("run-12:30", "yes", "1e3"):
        dataset = make_dataset(tmp_path / name, boards=1, finished=(0,))
        freeze(dataset.path, None)
        before = contents(dataset.path)
        push(dataset.path, str(tmp_path / "remote"))
        dataset.path.rename(tmp_path / "away")
        assert pull(dataset.path, str(tmp_path / "remote")).new and contents(dataset.path) == before
        shutil.rmtree(tmp_path / "away")


@pytest.mark.long
@pytest.mark.usefixtures("dvc")
def test_what_a_remote_lacks_and_what_dvc_says_is_told(frozen: Path, tmp_path: Path) -> None:
    push(frozen, str(tmp_path / "remote"))
    frozen.rename(tmp_path / "away")
    (tmp_path / "empty").mkdir()
    with pytest.raises(BusybotError, match=r"empty: it does not hold what .*toys\.dvc means"):
        pull(frozen, str(tmp_path / "empty"))
    (tmp_path / "away").rename(frozen)
    with pytest.raises(BusybotError, match="DVC cannot add: .*/proc/nowhere"):
        push(frozen, "/proc/nowhere")


def test_links_in_a_frozen_dataset_are_named_and_not_sent(frozen: Path, tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("secret")
    (frozen / "objects").mkdir()
    (frozen / "objects" / "extra.txt").symlink_to(tmp_path / "secret")
    assert [problem.what for problem in verify(frozen).problems if "extra.txt" in problem.file]
    with pytest.raises(BusybotError, match="extra.txt: neither a file"):
        push(frozen, str(tmp_path / "remote"))
    (frozen / "objects" / "extra.txt").rename(frozen / ".extra.txt")
    with pytest.raises(BusybotError, match="extra.txt: neither a file"):
        push(frozen, str(tmp_path / "remote"))


def test_two_do_not_fetch_one_dataset_at_once(frozen: Path, tmp_path: Path) -> None:
    (frozen.parent / "other.dvc").write_text(POINTER.format(md5=MD5, path="other"))
    work = frozen.parent / ".other.pull"
    work.mkdir()
    with one_writer(work), pytest.raises(BusybotError, match="another process"):
        pull(frozen.with_name("other"), str(tmp_path / "remote"))


class Refuses:
    """In DVC's place: tells what it was given, and does nothing."""

    given: ClassVar[dict[str, bytes]] = {}

    def __init__(self, folder: Path, remote: str, endpoint: str | None):
        self.given.update(contents(folder))
        raise BusybotError("no")


def test_settings_that_lie_where_a_pull_goes_on_are_not_those_of_dvc(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_Repository", Refuses)
    (tmp_path / "toys.dvc").write_text(POINTER.format(md5=MD5, path="toys"))
    planted = {
        "cache/files/md5/4f/fb": "fetched before",
        "config": f"[cache]\n    dir = {tmp_path / 'elsewhere'}\n",
        "config.local": "['remote \"shared\"']\n    url = https://evil.example\n",
        "../dvc.yaml": "stages: {a: {cmd: touch x}}",
    }
    for name, text in planted.items():
        place = tmp_path / ".toys.pull" / ".dvc" / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)
    with pytest.raises(BusybotError, match="no"):
        pull(tmp_path / "toys", "remote")
    config = b"[core]\n    no_scm = True\n"
    assert Refuses.given == {".dvc/cache/files/md5/4f/fb": b"fetched before", ".dvc/config": config, ".lock": b""}


class Uploads:
    """In DVC's place: writes a pointer as DVC does, named after the folder."""

    def __init__(self, folder: Path, remote: str, endpoint: str | None):
        self.folder = folder

    def run(self, *arguments: str) -> None:
        name = Path(arguments[-1]).name
        (self.folder / f"{name}.dvc").write_text(POINTER.format(md5=MD5, path=name))


@pytest.mark.parametrize("given", ["link", "toys/.", "toys/episodes/.."])
def test_the_pointer_lies_beside_the_folder_however_it_is_named(
    given: str, frozen: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_Repository", Uploads)
    monkeypatch.chdir(frozen.parent)
    os.symlink("toys", "link")
    before = contents(frozen)
    assert push(Path(given), "remote").pointer.absolute() == frozen.with_name("toys.dvc")
    monkeypatch.chdir(frozen)
    assert push(Path(), "remote").pointer == frozen.with_name("toys.dvc") and contents(frozen) == before


def test_another_dataset_than_the_pointer_means_is_not_taken_for_it(frozen: Path) -> None:
    listing = [
        {"md5": hashlib.md5(data).hexdigest(), "relpath": name} for name, data in sorted(contents(frozen).items())
    ]
    own = hashlib.md5(json.dumps(listing).encode()).hexdigest()
    pointer = frozen.with_name("toys.dvc")
    pointer.write_text(POINTER.format(md5=own, path="toys"))
    assert not pull(frozen, "remote").new
    pointer.write_text(POINTER.format(md5=MD5, path="toys"))
    with pytest.raises(BusybotError, match=r"not the dataset that \S*toys.dvc means") as error:
        pull(frozen, "remote")
    assert error.value.hint == "move it away"


def test_only_frozen_datasets_are_shared(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "my toys", boards=1, finished=(0,))
    with pytest.raises(BusybotError, match="frozen") as error:
        push(dataset.path, str(tmp_path / "remote"))
    assert error.value.hint == f"busybot dataset freeze '{dataset.path}'"


def test_a_changed_dataset_is_not_sent(frozen: Path, tmp_path: Path) -> None:
    file = frozen / "dataset.json"
    file.chmod(0o644)
    file.write_text(file.read_text() + " ")
    with pytest.raises(BusybotError, match="dataset.json"):
        push(frozen, str(tmp_path / "remote"))


@pytest.mark.parametrize(
    "text",
    [
        POINTER.format(md5=MD5, path="../elsewhere"),
        POINTER.format(md5=MD5, path="/etc"),
        POINTER.format(md5=MD5, path="other"),
        POINTER.format(md5="../../x", path="toys"),
        POINTER.format(md5=MD5, path="toys") + "cmd: touch /tmp/x\n",
        POINTER.format(md5=MD5, path="toys") + "deps:\n- path: https://example.org/x\n",
        POINTER.format(md5=MD5, path="toys") + "  remote: other\n",
        POINTER.format(md5=MD5, path="toys").replace("outs:\n", "outs:\n- path: x\n"),
        "[" * 5000,
        "outs: &a [*a]",
        "x" * 20_000,
        "",
    ],
)
def test_pointers_that_lead_elsewhere_are_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "toys.dvc").write_text(text)
    with pytest.raises(BusybotError, match="toys.dvc"):
        read_pointer(tmp_path / "toys.dvc", "toys")


def test_a_pointer_that_is_a_link_is_refused(tmp_path: Path) -> None:
    os.symlink("/etc/passwd", tmp_path / "toys.dvc")
    with pytest.raises(BusybotError, match="toys.dvc"):
        pull(tmp_path / "toys", str(tmp_path))


@pytest.mark.parametrize("name", ["../x", "/etc/passwd", "a/../../x", "..\\x", "a\0b", ""])
def test_listings_that_leave_the_folder_are_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / "list.dir").write_text(json.dumps([{"md5": MD5, "relpath": "fine"}, {"md5": MD5, "relpath": name}]))
    with pytest.raises(BusybotError, match="outside"):
        check_listing(tmp_path / "list.dir", f"{MD5}.dir")


def test_a_list_that_the_pointer_does_not_mean_is_refused(tmp_path: Path) -> None:
    listing = tmp_path / "list.dir"
    listing.write_text(json.dumps([{"md5": MD5, "relpath": "fine"}]))
    own = hashlib.md5(listing.read_bytes()).hexdigest()
    assert check_listing(listing, f"{own}.dir") == {"fine": MD5}
    with pytest.raises(BusybotError, match="not the list of files that the pointer means"):
        check_listing(listing, f"{MD5}.dir")


def test_passwords_are_not_taken_from_the_command_line() -> None:
    with pytest.raises(BusybotError, match="ASCII"):
        address("/data/café")
    with pytest.raises(BusybotError, match="password"):
        address("ssh://me:secret@host/path")
    assert address("s3://bucket/path") == "s3://bucket/path"
    with pytest.raises(BusybotError, match="Invalid IPv6 URL") as error:
        address("ssh://me:secret@[host/path")
    assert error.value.hint and "secret" not in str(error.value)
    with pytest.raises(BusybotError, match="no host has") as error:
        address("ssh://me:secret@host\u2100/path")
    assert "secret" not in str(error.value)
