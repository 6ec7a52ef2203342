"""A folder's files in memory, read once: what is checked, hashed and parsed is the same bytes.

References between files (URDF to mesh, mesh to material, material to texture) are looked up among these files by name,
never on disk, so no path and no link can lead out of the folder.
"""

import hashlib
import json
import os
import posixpath
import re
import stat
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NoReturn

from busybot.common.errors import BusybotError

MAX_FILES = 4096
MAX_DEPTH = 8
MAX_BYTES = 128 << 20
_PLAIN_NAME = re.compile(r"[^\x00-\x1f\x7f:\\]{1,240}")


@dataclass(frozen=True)
class Snapshot:
    """The regular files of a folder.

    Attributes:
        folder: where they were read.
        files: bytes by path relative to the folder, "/" between parts, sorted.
    """

    folder: Path
    files: dict[str, bytes]

    @cached_property
    def sha256(self) -> str:
        """Hash over names and bytes; independent of where the folder is and of file times."""
        digest = hashlib.sha256()
        for name, data in self.files.items():
            encoded = name.encode()
            digest.update(len(encoded).to_bytes(8, "little") + encoded + len(data).to_bytes(8, "little"))
            digest.update(data)
        return digest.hexdigest()

    def refuse(self, name: str, what: str, hint: str) -> NoReturn:
        raise BusybotError(f"{self.folder / name}: {what}", hint)

    def require(self, name: str, limit: int, hint: str) -> bytes:
        """The bytes of `name`; refused by name when absent or above `limit` bytes."""
        if name not in self.files:
            self.refuse(name, "there is no such file", "copy the whole object folder again")
        if len(self.files[name]) > limit:
            self.refuse(name, f"{len(self.files[name])} bytes are more than the {limit} allowed", hint)
        return self.files[name]

    def parse_json(self, name: str, text: str | bytes, hint: str) -> Any:
        """The JSON value of `text`, which `name` holds."""
        try:
            return json.loads(text)
        except (ValueError, RecursionError) as error:
            self.refuse(name, f"not valid JSON: {str(error)[:200]}", hint)

    def reference(self, source: str, target: str, limit: int) -> str:
        """The file that `source` refers to as `target`, relative to the folder of `source`.

        Raises:
            BusybotError: `target` has a scheme, is absolute, climbs out, is absent or above `limit` bytes.
        """
        refers = f"refers to {target[:80]!r}, which"
        if not _PLAIN_NAME.fullmatch(target) or target.startswith("/"):
            hint = "name a file inside the object's folder, without scheme, drive or backslash"
            self.refuse(source, f"{refers} is not a plain relative path", hint)
        name = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
        if name == ".." or name.startswith("../"):
            self.refuse(source, f"{refers} leaves the object's folder", "copy the file inside")
        if name not in self.files:
            self.refuse(source, f"{refers} is missing", "add the file or remove the reference")
        self.require(name, limit, "simplify it")
        return name


def read_snapshot(folder: Path) -> Snapshot:
    """Read every file under `folder`; links, devices and monstrous folders are refused before anything is read."""
    if not folder.is_dir():
        raise BusybotError(f"{folder}: not a folder", "name an object's folder")
    paths = _walk(folder, folder, 0, [])
    total = sum(size for _, size in paths)
    if total > MAX_BYTES:
        largest, size = max(paths, key=lambda one: one[1])
        what = f"{folder}: {total} bytes are more than the {MAX_BYTES} allowed, {size} of them in {largest.name!r}"
        raise BusybotError(what, "remove or simplify files")
    files = {}
    for path, size in sorted(paths):
        name = path.relative_to(folder).as_posix()
        try:
            descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
            with open(descriptor, "rb") as file:
                files[name] = file.read(size + 1)
        except OSError as error:
            raise BusybotError(f"{path}: cannot be read: {error.strerror}", "make it readable") from None
        if len(files[name]) != size:
            raise BusybotError(f"{path}: changed while it was read", "try again when nothing writes to it")
    return Snapshot(folder, dict(sorted(files.items())))


def _walk(root: Path, folder: Path, depth: int, found: list[tuple[Path, int]]) -> list[tuple[Path, int]]:
    if depth > MAX_DEPTH:
        raise BusybotError(f"{folder}: more than {MAX_DEPTH} folders deep", "flatten the object's folder")
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                _visit(root, entry, depth, found)
    except OSError as error:
        raise BusybotError(f"{folder}: cannot be listed: {error.strerror}", "make it readable") from None
    return found


def _visit(root: Path, entry: os.DirEntry[str], depth: int, found: list[tuple[Path, int]]) -> None:
    path = Path(entry.path)
    try:
        entry.name.encode()
    except UnicodeEncodeError:
        raise BusybotError(f"{path.parent}: {entry.name!r} is not a UTF-8 file name", "rename it") from None
    if entry.is_symlink():
        raise BusybotError(f"{path}: is a link; links in an object's folder are not followed", "copy the file itself")
    if entry.is_dir():
        _walk(root, path, depth + 1, found)
        return
    info = entry.stat(follow_symlinks=False)
    if not stat.S_ISREG(info.st_mode):
        raise BusybotError(f"{path}: is not a regular file", "remove it")
    found.append((path, info.st_size))
    if len(found) > MAX_FILES:
        raise BusybotError(f"{root}: more than {MAX_FILES} files", "remove what does not belong to the object")
