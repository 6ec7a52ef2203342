"""Folders at an address of fsspec (S3, memory, HTTP, ...), read only and by byte ranges.

A `RemotePath` stands where reading a dataset has a `pathlib.Path`, and has those of its methods that reading needs.
Whatever else is asked for, writing above all, needs a path of the file system (`os.fspath`) and is refused.
"""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeGuard, cast
from urllib.parse import SplitResult, unquote, urlsplit

from busybot.common.errors import BusybotError, needs_extra

SCHEME = re.compile(r"^[A-Za-z][A-Za-z0-9+.:-]+://")
"""What an address of fsspec begins with."""
HINT_COPY = "copy the dataset into a folder of this machine first"
_SECRET = re.compile(r"(?<=//)[^/\s]*@")
"""Name and password in an address; who forgot to encode a sign of the latter shall not read half of it."""


@dataclass(frozen=True)
class RemotePath:
    """A file or folder at or below an address; never outside, whatever a stranger's file names.

    The file system is looked up for each request: fsspec keeps it, and makes another one in a forked process.

    Attributes:
        address: of the dataset, as fsspec takes it.
        options: for the file system (`storage_options`), as keys or the address of a server.
        parts: the way from there.
    """

    address: str
    options: Mapping[str, Any] = field(default_factory=dict, hash=False, repr=False)
    parts: tuple[str, ...] = ()

    def __truediv__(self, name: str) -> "RemotePath":
        parts = name.split("/")
        if {"", ".", ".."} & set(parts) or "\0" in name:
            raise BusybotError(f"{self}: the path {name!r} leaves the folder")
        return replace(self, parts=self.parts + tuple(parts))

    def __str__(self) -> str:
        return "/".join((_SECRET.sub("", self.address).rstrip("/"), *self.parts))

    def __fspath__(self) -> str:
        raise BusybotError(f"{self}: what lies at an address is only read, and not by this function", HINT_COPY)

    def __getattr__(self, name: str) -> Any:
        """Other methods of a path are refused in the same words."""
        if name.startswith("_"):  # copying and pickling ask for such
            raise AttributeError(name)
        return self.__fspath__()

    @property
    def name(self) -> str:
        """The last part."""
        return str(self).rpartition("/")[2]

    def is_dir(self) -> bool:
        """Whether there is a folder."""
        return self._kind() == "directory"

    def is_file(self) -> bool:
        """Whether there is a file."""
        return self._kind() == "file"

    def exists(self) -> bool:
        """Whether anything is there."""
        return self._kind() is not None

    def is_symlink(self) -> bool:
        """Never: a store has no links."""
        return False

    def sizes(self) -> dict[str, int]:
        """Bytes of the files in this folder, by their names; nothing where there is no folder."""
        with self._told() as (system, _):
            found = self._files()
            silent = [one["name"] for one in found.values() if one["size"] is None]  # lists of HTTP tell none
            asked = dict(zip(silent, system.sizes(silent) if silent else (), strict=True))
            return {name: int(asked.get(one["name"], one["size"]) or 0) for name, one in found.items()}

    def iterdir(self) -> Iterator["RemotePath"]:
        """The files in this folder."""
        return (self / name for name in self.names())

    def names(self) -> list[str]:
        """Names of the files in this folder."""
        return list(self._files())

    def _files(self) -> dict[str, dict[str, Any]]:
        """What the store lists of the files in this folder, by their names."""
        with self._told() as (system, location):
            try:
                found = system.ls(location, detail=True)
            except FileNotFoundError:
                return {}
            names = {one["name"].rstrip("/").rpartition("/"): one for one in found if one["type"] == "file"}
            own = location.strip("/")  # a file is listed as itself
            return {name[2]: one for name, one in names.items() if name[0].strip("/") == own}

    def size(self) -> int:
        """Bytes of the file.

        Raises:
            BusybotError: there is no file, or the store does not tell.
        """
        with self._told() as (system, location):
            facts = system.info(location)
            if facts["type"] != "file" or facts["size"] is None:
                raise BusybotError(f"{self}: not a regular file", "name the address of a dataset's folder")
            return int(facts["size"])

    def read(self, start: int, end: int) -> bytes:
        """Bytes `start` to `end` of the file; fewer where it ends before."""
        with self._told() as (system, location):
            data: bytes = system.cat_file(location, start=start, end=end) if start < end else b""
            return data[start:end] if len(data) > end - start else data  # a server that knows no ranges sends all

    def forget(self) -> None:
        """Ask the store anew for what was listed before."""
        with self._told() as (system, location):
            system.invalidate_cache(location)

    def _kind(self) -> str | None:
        with self._told() as (system, location):
            try:
                kind: str = system.info(location)["type"]
            except FileNotFoundError:
                return None
            return kind

    @contextmanager
    def _told(self) -> Iterator[tuple[Any, str]]:
        """The file system and where this lies in it; faults become errors that name the address."""
        import fsspec

        try:
            system, root = fsspec.core.url_to_fs(self.address, **self.options)
            yield system, "/".join((root.rstrip("/"), *self.parts))
        except BusybotError:
            raise
        except FileNotFoundError:
            raise BusybotError(f"{self}: there is no such file or folder", "check the address") from None
        except ImportError as error:
            if self.address.startswith(("s3:", "s3a:")):
                raise needs_extra("s3fs", "s3") from None
            raise BusybotError(f"{self}: {error}", HINT_COPY) from None
        except Exception as error:  # every kind of store has its own: no credentials, no server, no such protocol
            what = f"{self}: {type(error).__name__}: {_SECRET.sub('', str(error))}"
            raise BusybotError(what, "check the address and `storage_options`") from None


def is_remote(path: object) -> TypeGuard[RemotePath]:
    """Whether a dataset's path is an address."""
    return isinstance(path, RemotePath)


def split_address(address: str) -> SplitResult:
    """The parts of an address.

    Raises:
        BusybotError: it is none. Name and password are not told.
    """
    try:
        return urlsplit(address)
    except ValueError as error:  # a bracket stays open, or the host, which is quoted with name and password, is none
        why = "it has signs that no host has" if "@" in str(error) else error
        raise BusybotError(f"{RemotePath(address)}: {why}", "check the address, as s3://bucket/path") from None


def place_of(address: str | Path, options: Mapping[str, Any] | None = None) -> Path:
    """A folder of this machine, or an address, which stands for one where it is only read.

    Args:
        options: for the file system of an address.

    Raises:
        BusybotError: it is no address, of another machine, or its file system cannot be reached.
    """
    if not isinstance(address, str) or SCHEME.match(address) is None:
        return Path(address)
    parts = split_address(address)
    if parts.scheme in ("file", "local"):
        if parts.netloc not in ("", "localhost"):
            what = f"{RemotePath(address)}: a folder of another machine"
            raise BusybotError(what, "write file:///PATH for one of this machine")
        return Path(unquote(parts.path))
    remote = RemotePath(address, dict(options or {}))
    remote.forget()  # what an earlier call listed may have grown
    return cast(Path, remote)  # it has what reading needs, and refuses all else
