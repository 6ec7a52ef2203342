"""Files that are whole or absent, and paths that stay inside their folder."""

import contextlib
import hashlib
import json
import os
import stat
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from busybot.errors import BusybotError


def write_atomically(path: Path, data: bytes) -> None:
    """Write under a temporary name, sync, rename: a file with its final name is whole."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with open(temporary, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        with contextlib.suppress(OSError):  # the fault that led here is the one to tell
            temporary.unlink(missing_ok=True)


def write_json(path: Path, value: Any) -> None:
    """Write JSON with sorted keys and a final newline, atomically."""
    write_atomically(path, (json.dumps(value, indent=2, sort_keys=True, allow_nan=False) + "\n").encode())


def read_json(path: Path, max_bytes: int = 64 << 20) -> Any:
    """Read JSON from a regular file of at most `max_bytes`; errors name the file and the line."""
    try:
        if path.exists() and not path.is_file():
            raise BusybotError(f"{path}: not a regular file")
        size = path.stat().st_size
        if size > max_bytes:
            raise BusybotError(f"{path}: {size} bytes are more than the {max_bytes} that such a file may have")
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise BusybotError(f"{path}: there is no such file") from None
    except (ValueError, RecursionError) as error:  # of decoding, of JSON, and of numbers with thousands of digits
        mend = "restore it from a copy, or make it again with the command that wrote it"
        raise BusybotError(f"{path}: not valid JSON: {error}", mend) from None
    except OSError as error:
        raise BusybotError(f"{path}: cannot be read: {error.strerror}") from None


def inside(folder: Path, relative: str) -> Path:
    """`folder / relative`, refused when it is absolute, climbs out, or leaves the folder through a link."""
    candidate = folder / relative
    try:
        stays = not Path(relative).is_absolute() and candidate.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):  # a link to itself
        stays = False
    if not stays:
        raise BusybotError(f"{folder}: the path {relative!r} leaves the folder", "remove it or copy the file inside")
    return candidate


def sha256_of(path: Path) -> str:
    """SHA-256 over a file's bytes, hexadecimal."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@dataclass
class Scan:
    """What lies under a folder, by path relative to it with "/" between parts, in sorted order.

    Attributes:
        files: size in bytes of every regular file.
        others: links, devices, sockets: what is neither a regular file nor a folder.
    """

    files: dict[str, int] = field(default_factory=dict)
    others: list[str] = field(default_factory=list)


def scan(folder: Path) -> Scan:
    """Look through the folder and all folders in it; no link is followed."""
    found = Scan()
    waiting = [""]
    while waiting:
        place = waiting.pop()
        with os.scandir(folder / place) as entries:
            for entry in entries:
                name = f"{place}{entry.name}"
                if entry.is_dir(follow_symlinks=False):
                    waiting.append(f"{name}/")
                elif stat.S_ISREG((facts := entry.stat(follow_symlinks=False)).st_mode):
                    found.files[name] = facts.st_size
                else:
                    found.others.append(name)
    return Scan(dict(sorted(found.files.items())), sorted(found.others))
