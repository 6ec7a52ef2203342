"""Frozen datasets to shared storage and back, through DVC: a folder, S3, SSH, whatever DVC has as a remote.

`push` sends a dataset's files and writes a small pointer beside it, `NAME.dvc`, to be kept in version control; `pull`
makes the dataset where its pointer is. DVC addresses files by MD5; what was pulled is compared with the SHA-256 of the
manifest, and the manifest with the pointer, before it gets its name. Each works in a DVC repository of its own, so none
is needed and none is touched.

A pointer and what a remote answers may come from anybody: both may name nothing outside of the dataset's folder.
"""

import hashlib
import json
import os
import re
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from busybot.common.atomic_io import (
    LOCK_FILE,
    copy_file,
    make_folder,
    one_writer,
    open_regular,
    remove,
    rename,
    scan,
    write_atomically,
)
from busybot.common.config import parse_yaml
from busybot.common.errors import BusybotError, without_name
from busybot.common.frozen_model import FrozenModel, first_fault
from busybot.common.limits import MAX_HASHED_BYTES
from busybot.common.remote import split_address
from busybot.datasets.manifest import (
    MANIFEST_FILE,
    is_frozen,
    is_plain_path,
    plain_files,
    read_manifest,
    unlike_manifest,
)

LARGEST_POINTER = 10_000
LARGEST_LISTING = 1 << 30
REMOTE, POINTER = "shared", "pointer.dvc"
ERROR = "ERROR: "
"""How lines of DVC begin that tell why."""
MD5 = re.compile(r"[0-9a-f]{32}")
OWN_TOOL = Path(__file__).resolve().parents[2] / ".tools" / "dvc" / "bin" / "dvc"
"""Where `make dvc` puts it."""


class _Out(FrozenModel):
    """The only kind of output that a pointer of ours has."""

    md5: Annotated[str, Field(pattern=r"^[0-9a-f]{32}\.dir$")]
    size: Annotated[int, Field(ge=0)]
    nfiles: Annotated[int, Field(ge=1, le=10_000_000)]
    hash: Literal["md5"]
    path: Annotated[str, Field(min_length=1, max_length=200)]


class _Pointer(FrozenModel):
    outs: Annotated[tuple[_Out, ...], Field(min_length=1, max_length=1)]


@dataclass(frozen=True)
class Shared:
    """What was sent or fetched; `new` is False where everything was there already."""

    dataset: Path
    pointer: Path
    files: int
    bytes: int
    new: bool = True


def push(dataset: Path, remote: str, endpoint: str | None = None) -> Shared:
    """Send a frozen dataset, and write its pointer: of a link, beside the folder that it leads to.

    Args:
        remote: a folder, or an address that DVC understands, such as `s3://bucket/path`. Credentials come from the
            environment, as the storage's own tools read them.
        endpoint: of S3-compatible storage that is not Amazon's.

    Raises:
        BusybotError: the dataset is not frozen or was changed since, DVC is missing, or the storage refuses.
    """
    if not is_frozen(dataset):
        raise BusybotError(
            f"{dataset}: only frozen datasets are shared", f"busybot dataset freeze {shlex.quote(str(dataset))}"
        )
    plain_files(dataset)  # DVC would send what a link leads to
    _must_be_whole(dataset)
    place = _folder_of(dataset)
    pointer = pointer_of(place)
    with tempfile.TemporaryDirectory(prefix="busybot-push-") as folder:
        dvc = _Repository(Path(folder), remote, endpoint)
        dvc.run("add", "--to-remote", "--remote", REMOTE, str(place.resolve()))
        text = (Path(folder) / pointer.name).read_bytes()
        out = read_pointer(Path(folder) / pointer.name, place.name)
    write_atomically(pointer, text)
    return Shared(dataset, pointer, out.nfiles, out.size)


def pull(dataset: Path, remote: str, endpoint: str | None = None) -> Shared:
    """Make the dataset that the pointer beside it means. What an interrupted pull fetched is kept for the next one.

    Raises:
        BusybotError: there is no pointer, it or the remote's listing leaves the folder, something else is in the way,
            DVC is missing, the storage refuses, or what came is not what the manifest says.
    """
    if dataset.is_symlink():
        raise BusybotError(f"{dataset}: something else is there", "move it away")
    dataset = _folder_of(dataset)
    pointer = pointer_of(dataset)
    out = read_pointer(pointer, dataset.name)
    if dataset.exists():
        if not is_frozen(dataset):
            raise BusybotError(f"{dataset}: something else is there", "move it away")
        _must_be_whole(dataset)
        if out.md5 not in _addresses(dataset):
            raise BusybotError(f"{dataset}: it is not the dataset that {pointer} means", "move it away")
        return Shared(dataset, pointer, out.nfiles, out.size, new=False)
    work = dataset.parent / f".{dataset.name}.pull"
    make_folder(work, dataset.parent)
    plain_files(work)
    with one_writer(work):
        _keep_cache_alone(work)
        _fetch(work, pointer, out, _Repository(work, remote, endpoint), remote)
        rename(work / dataset.name, dataset, dataset.parent)
        remove(work, dataset.parent)
    return Shared(dataset, pointer, out.nfiles, out.size)


def _keep_cache_alone(work: Path) -> None:
    """Keep of an interrupted pull what it fetched, which is compared later, and nothing that tells DVC what to do: who
    sent the pointer may have sent this folder with it, with a cache elsewhere, or with another remote."""
    own = work / ".dvc"
    strange = [place for place in work.iterdir() if place.name not in (LOCK_FILE, ".dvc")]
    strange += [place for place in (own.iterdir() if own.is_dir() else ()) if place.name != "cache"]
    for place in strange:
        remove(place, work)
    if own.is_dir():  # without settings it would be made anew, and empty
        write_atomically(own / "config", b"[core]\n    no_scm = True\n", work)


def _fetch(work: Path, pointer: Path, out: _Out, dvc: "_Repository", remote: str) -> None:
    """Make the dataset in the repository `work`; what is not what it should be is not kept for the next time.

    Raises:
        BusybotError: see `pull`.
    """
    copy_file(pointer, work / POINTER, work.parent)  # under this name, for DVC reads `a:b.dvc` as a stage of `a`
    dvc.run("fetch", POINTER)
    listing = _cached(work, out.md5)
    if not listing.is_file():
        raise BusybotError(
            f"{remote}: it does not hold what {pointer} means", "is it the --remote that it was sent to?"
        )
    try:
        entries = check_listing(listing, out.md5)
    except BusybotError:
        remove(listing, work)
        raise
    dvc.run("checkout", "--force", POINTER)
    fetched = work / out.path
    if faults := _faults(fetched, entries):
        for name in faults:
            remove(_cached(work, entries.get(name, out.md5)), work)  # what is not listed makes the list a wrong one
        remove(fetched, work)
        name, fault = next(iter(faults.items()))
        what = f"{remote}: {name} came from there, {fault}"
        raise BusybotError(what, "do the same again; if that does not help, fetch it from another remote")


def _faults(fetched: Path, entries: Mapping[str, str]) -> dict[str, str]:
    """What is wrong with files that were fetched, by name: nothing in a whole frozen dataset whose manifest is the one
    that is listed. DVC does not look at what it has fetched before."""
    if not is_frozen(fetched):
        return {MANIFEST_FILE: "which is none of a frozen dataset"}
    if _md5_of(fetched / MANIFEST_FILE) != entries.get(MANIFEST_FILE):
        return {MANIFEST_FILE: "which is not that of the dataset that the pointer means"}
    try:
        return {name: fault for name, fault, _ in unlike_manifest(fetched, read_manifest(fetched))}
    except BusybotError as error:
        return {MANIFEST_FILE: without_name(error, fetched / MANIFEST_FILE)}


def _cached(work: Path, digest: str) -> Path:
    """Where DVC keeps what it fetched."""
    return work / ".dvc" / "cache" / "files" / "md5" / digest[:2] / digest[2:]


def pointer_of(dataset: Path) -> Path:
    """The pointer's file, beside the dataset."""
    return dataset.with_name(f"{dataset.name}.dvc")


def _folder_of(dataset: Path) -> Path:
    """The folder itself, after which DVC names the pointer, also where a link or `.` stands for it."""
    own_name = dataset.name not in ("", "..") and not dataset.is_symlink()
    return dataset if own_name else dataset.resolve()


def _addresses(dataset: Path) -> set[str]:
    """What DVC would call this frozen dataset: as it is, and without the hidden files that came in after freezing."""
    frozen = {*read_manifest(dataset).files, MANIFEST_FILE}
    hashes = {name: _md5_of(dataset / name) for name in scan(dataset).files}
    return {_address_of(hashes), _address_of({name: hashes[name] for name in frozen})}


def _md5_of(file: Path) -> str:
    with open_regular(file, MAX_HASHED_BYTES) as opened:
        return hashlib.file_digest(opened, lambda: hashlib.md5(usedforsecurity=False)).hexdigest()


def _address_of(hashes: Mapping[str, str]) -> str:
    """DVC's name of a folder: the MD5 of the list of its files with theirs, as DVC writes it."""
    listing = [{"md5": hashes[name], "relpath": name} for name in sorted(hashes)]
    data = json.dumps(listing, sort_keys=True).encode()
    return f"{hashlib.md5(data, usedforsecurity=False).hexdigest()}.dir"


def read_pointer(pointer: Path, name: str) -> _Out:
    """What a pointer says, if it is one of ours and means the folder `name` beside it.

    Raises:
        BusybotError: it is missing, damaged, or leads elsewhere.
    """
    if pointer.is_symlink() or not pointer.is_file():
        raise BusybotError(
            f"{pointer}: there is no such pointer", "`busybot dataset push` writes it where it is sent from"
        )
    hint = "get it anew from who shared the dataset"
    if pointer.stat().st_size > LARGEST_POINTER:
        raise BusybotError(f"{pointer}: too large for a pointer", hint)
    try:
        told = parse_yaml(pointer.read_text(encoding="utf-8"), str(pointer), words=True)
        out = _Pointer.model_validate(told).outs[0]
    except ValidationError as error:
        raise BusybotError(f"{pointer}: {first_fault(error)}", hint) from None
    except UnicodeDecodeError as error:
        raise BusybotError(f"{pointer}: not UTF-8: {error.reason}", hint) from None
    if out.path != name:
        raise BusybotError(f"{pointer}: it points to {out.path!r} instead of {name!r} beside it", hint)
    return out


def check_listing(listing: Path, address: str) -> dict[str, str]:
    """The MD5 of each file of a remote's list, if none is outside of the folder.

    Args:
        address: what the pointer calls the list.

    Raises:
        BusybotError: one is, the list is damaged, or it is another one.
    """
    hint = "the storage holds something else: ask who shared the dataset"
    if listing.stat().st_size > LARGEST_LISTING:
        raise BusybotError(f"{listing}: too large for a list of files", hint)
    try:
        entries = {str(entry["relpath"]): str(entry["md5"]) for entry in json.loads(listing.read_bytes())}
    except (ValueError, TypeError, KeyError, RecursionError):
        raise BusybotError(f"{listing}: not a list of files", hint) from None
    for name, digest in entries.items():
        if not is_plain_path(name):
            raise BusybotError(f"{listing}: it names {name!r}, outside of the dataset", hint)
        if not MD5.fullmatch(digest):
            raise BusybotError(f"{listing}: {name!r} has no MD5", hint)
    if f"{_md5_of(listing)}.dir" != address:
        raise BusybotError(f"{listing}: not the list of files that the pointer means", hint)
    return entries


def _must_be_whole(dataset: Path) -> None:
    for name, fault, hint in unlike_manifest(dataset, read_manifest(dataset)):
        raise BusybotError(f"{dataset / name}: {fault}", hint)


class _Repository:
    """A DVC repository of our own with one remote."""

    def __init__(self, folder: Path, remote: str, endpoint: str | None):
        self.folder, self.tool = folder, find_tool()
        if not (folder / ".dvc" / "config").is_file():
            self.run("init", "--no-scm", "--force")
        self.run("config", "cache.type", "hardlink,copy")
        self.run("remote", "add", "--force", "--default", REMOTE, address(remote))
        if endpoint is not None:
            self.run("remote", "modify", REMOTE, "endpointurl", endpoint)

    def run(self, *arguments: str) -> None:
        """Run DVC; its own words are the error's."""
        environment = dict(os.environ, DVC_NO_ANALYTICS="1")
        command = [self.tool, *arguments]
        done = subprocess.run(
            command, cwd=self.folder, env=environment, capture_output=True, text=True, stdin=subprocess.DEVNULL
        )
        if done.returncode:
            said = [line.strip() for line in done.stderr.splitlines() if line.strip()]
            why = next((line for line in said if line.startswith(ERROR)), (said or ["no word about why"])[0])
            raise BusybotError(f"DVC cannot {arguments[0]}: {why.removeprefix(ERROR)}", "mend it and do the same again")


def address(remote: str) -> str:
    """What DVC gets to know: folders in full, other addresses as they are.

    Raises:
        BusybotError: the address is none, or holds a password, which everybody could read in the list of processes, or
            is a folder that DVC cannot name.
    """
    parts = split_address(remote)
    if parts.password is not None:
        raise BusybotError(
            "the address of the remote holds a password", "give it in the environment, as AWS_SECRET_ACCESS_KEY"
        )
    if parts.scheme:
        return remote
    folder = str(Path(remote).expanduser().resolve())
    if not folder.isascii():
        raise BusybotError(
            f"{folder}: DVC knows no remote whose path is not plain ASCII", "name a folder without accents"
        )
    return folder


def find_tool() -> str:
    """DVC beside the project, or on the path."""
    found = str(OWN_TOOL) if OWN_TOOL.exists() else shutil.which("dvc")
    if found is None:
        raise BusybotError("DVC is not installed", "`make dvc` in the project, or `pipx install dvc`")
    return found
