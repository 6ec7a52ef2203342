"""The manifest of a frozen dataset, and its comparison with the files that are there.

It lists every file with its hash, and all that decided their content. A dataset is frozen from the moment its manifest
is there under its final name: nothing is collected into it any more.
"""

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError, field_validator

from busybot.common.atomic_io import inside, scan, sha256_of
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel, Values, first_fault
from busybot.common.process_pool import share
from busybot.datasets.info import CollectInfo, GeneratorInfo, Seed, Version, read_description
from busybot.episodes.digests import Digests, Sha256
from busybot.objects.license import UNKNOWN

MANIFEST_FILE, CARD_FILE = "manifest.json", "README.md"
MANIFEST_VERSION = "1.0"
MAX_MANIFEST_BYTES = 512 << 20
"""A million files need about 150 MB."""
FILES_AT_ONCE = 500
"""That a worker hashes before it answers: small files take less time than an answer."""
NOT_PLAIN = "neither a file nor a folder but a link or device"
HINT_FETCH = "fetch the dataset again from where it came; `busybot dataset repair DATASET --out DIR` saves what it can"

_SPDX = re.compile(r"[A-Za-z0-9.+-]+")
_FILE_NAME = re.compile(r"(?!\.\.?(/|$))[^/\\\x00-\x1f]+(/(?!\.\.?(/|$))[^/\\\x00-\x1f]+)*")


class FileEntry(FrozenModel):
    """One file: SHA-256 and size in bytes."""

    sha256: Sha256
    bytes: Annotated[int, Field(ge=0)]


class AssetEntry(FrozenModel):
    """One object.

    Attributes:
        sha256: over the object's files.
        licence: SPDX identifier, or in words.
        carried: whether its files lie in the dataset's folder `objects`.
    """

    sha256: Sha256
    licence: Annotated[str, Field(min_length=1, max_length=500)]
    carried: bool


class Origin(FrozenModel):
    """What so many episodes have in common.

    Attributes:
        renderer: fingerprint of the renderer that made their pictures.
        versions: of the packages that recorded them.
    """

    renderer: Values
    versions: Values
    episodes: Annotated[int, Field(ge=1)]


class Manifest(FrozenModel):
    """A frozen dataset.

    Attributes:
        schema_version: of episodes and tables.
        board_seed, policy_seed: from which boards and actions were drawn.
        generator: what drew the boards: version and configuration.
        collect: how the episodes were recorded: the whole configuration.
        origins: renderers and packages, most episodes first.
        partial: episodes that `repair` could save only in part.
        boards_again: whether the configuration gave the same boards again when the dataset was frozen.
        assets: by object key, those on the boards and those carried besides.
        frozen_with: versions of the packages that froze the dataset.
        files: by path relative to the dataset; all but the manifest itself.
    """

    manifest_version: Version = MANIFEST_VERSION
    schema_version: Version
    name: str
    split: str
    boards: int
    steps: int
    hashes: Digests
    board_seed: Seed
    policy_seed: Seed
    generator: GeneratorInfo
    collect: CollectInfo
    origins: list[Origin]
    partial: list[int] = []
    boards_again: bool
    assets: dict[str, AssetEntry]
    frozen_with: dict[str, str]
    files: dict[str, FileEntry]

    @property
    def licence(self) -> str | None:
        """SPDX identifier of the licence that all objects have, None where they have several or an unknown one."""
        found = {entry.licence for entry in self.assets.values()}
        only = found.pop() if len(found) == 1 else UNKNOWN
        return only if only != UNKNOWN and _SPDX.fullmatch(only) else None

    @field_validator("files")
    @classmethod
    def _inside(cls, files: dict[str, FileEntry]) -> dict[str, FileEntry]:
        for name in files:
            if not is_plain_path(name):
                raise ValueError(f"{name[:80]!r} is not a plain relative path")
        return files


def is_plain_path(name: str) -> bool:
    """Whether a name that a stranger gave is a relative path without control characters and ways out of its folder."""
    return _FILE_NAME.fullmatch(name) is not None


def is_frozen(path: Path) -> bool:
    """Whether the folder has a manifest, readable or not."""
    file = path / MANIFEST_FILE
    return file.is_symlink() or file.exists()


def refuse_frozen(path: Path) -> None:
    """Refuse to write into a frozen dataset."""
    if is_frozen(path):
        hint = "work on a copy without manifest.json (`chmod -R u+w COPY` first), or collect into another dataset"
        raise BusybotError(f"{path}: the dataset is frozen", hint)


def read_manifest(path: Path) -> Manifest:
    """The manifest of the dataset in folder `path`.

    Raises:
        BusybotError: it is absent, not readable, or of a newer version.
    """
    values = read_description(inside(path, MANIFEST_FILE), "manifest", MANIFEST_VERSION, MAX_MANIFEST_BYTES)
    try:
        return Manifest.model_validate(values)
    except ValidationError as error:
        raise BusybotError(f"{path / MANIFEST_FILE}: {first_fault(error)}", HINT_FETCH) from None


def plain_files(path: Path) -> dict[str, int]:
    """Sizes of all files under a folder, by their paths in it.

    Raises:
        BusybotError: a link or device is among them.
    """
    found = scan(path)
    if found.others:
        what = f"{path / found.others[0]}: {NOT_PLAIN}"
        raise BusybotError(what, "put a copy of the file in its place, or remove it")
    return found.files


def file_entries(path: Path, names: list[str], workers: int = 1) -> dict[str, FileEntry]:
    """Hash and size of files in the folder."""
    parts = [names[start : start + FILES_AT_ONCE] for start in range(0, len(names), FILES_AT_ONCE)]
    return {name: entry for found in share(partial(_entries, path), parts, workers) for name, entry in found.items()}


def _entries(path: Path, names: list[str]) -> dict[str, FileEntry]:
    files = {name: path / name for name in names}
    return {name: FileEntry(sha256=sha256_of(file), bytes=file.stat().st_size) for name, file in files.items()}


def refuse_unlike_manifest(path: Path, hashes: Digests, checksums: bool) -> None:
    """Compare a frozen dataset with its manifest, as cheaply as it is safe, before somebody relies on it.

    All sizes are compared, the hashes over its values, and the SHA-256 of every file but the objects', whose hashes are
    compared when they are loaded, and the recordings'.

    Args:
        hashes: as they are now.
        checksums: whether they rest on the recordings' checksums; otherwise the recordings are hashed, too.

    Raises:
        BusybotError: naming the first file that is not as the manifest says.
    """
    manifest = read_manifest(path)
    passed = ("objects/", "episodes/") if checksums else ("objects/",)
    for name, fault, hint in unlike_manifest(path, manifest, passed=passed):
        raise BusybotError(f"{path / name}: the dataset is frozen, but this file is {fault}", hint)
    if hashes != manifest.hashes:
        raise BusybotError(
            f"{path}: the dataset is frozen, but its recordings are not those of its manifest", HINT_FETCH
        )


def unlike_manifest(
    path: Path, manifest: Manifest, workers: int = 1, passed: tuple[str, ...] = ()
) -> Iterator[tuple[str, str, str]]:
    """Files that are missing, changed or not in the manifest, and links: (path in the dataset, fault, hint).

    Hidden files are passed over: version control and download tools put theirs beside the data.

    Args:
        passed: only the size is compared of files whose path begins so.
    """
    scanned = scan(path)
    found = scanned.files
    for name in scanned.others:
        if not _hidden(name):
            yield name, NOT_PLAIN, "put a copy of the file in its place"
    for name in sorted(manifest.files.keys() - found.keys()):
        yield name, "missing; the manifest lists it", HINT_FETCH
    shared = sorted(manifest.files.keys() & found.keys())
    same_size = [name for name in shared if found[name] == manifest.files[name].bytes and not name.startswith(passed)]
    entries = file_entries(path, same_size, workers)
    for name in shared:
        if found[name] != manifest.files[name].bytes:
            yield name, f"{found[name]} bytes, the manifest says {manifest.files[name].bytes}", HINT_FETCH
        elif name in entries and entries[name] != manifest.files[name]:
            yield name, "its content changed after freezing: another SHA-256 than the manifest's", HINT_FETCH
    for name in sorted(found.keys() - manifest.files.keys() - {MANIFEST_FILE}):
        if not _hidden(name):
            yield name, "not in the manifest", "move it out of the dataset"


def _hidden(name: str) -> bool:
    return any(part.startswith(".") for part in name.split("/"))
