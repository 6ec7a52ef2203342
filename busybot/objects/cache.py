"""The user's cache: built procedural libraries, parsed objects, and where libraries with given hashes were last seen.

The cache is a convenience: an unreadable or unwritable one costs time, never correctness.
"""

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from busybot.common.atomic_io import read_json, read_text, write_atomically, write_json
from busybot.common.errors import BusybotError
from busybot.objects.model import ObjectModel

_INDEX = "libraries.json"
_MAX_ENTRIES = 64
_MAX_PARSED, _MAX_BYTES = 20_000, 64 << 20


def cache_folder() -> Path:
    """`$BUSYBOT_CACHE`, else `$XDG_CACHE_HOME/busybot`, else `~/.cache/busybot`; not made here."""
    if own := os.environ.get("BUSYBOT_CACHE"):
        return Path(own)
    if shared := os.environ.get("XDG_CACHE_HOME"):
        return Path(shared) / "busybot"
    return Path.home() / ".cache" / "busybot"


@contextmanager
def parsed_objects() -> Iterator[dict[str, ObjectModel]]:
    """Objects that were parsed before, by the hash of their files; those that are put in are there the next time.

    They are kept by what the files hold and by the code that parsed them, so that neither can be out of date.
    """
    path = cache_folder() / f"parsed-{_parser_hash()}.json"
    known = _read_parsed(path)
    before = len(known)
    yield known
    if len(known) > before:
        kept = dict(list(known.items())[-_MAX_PARSED:])
        with suppress(OSError, BusybotError):
            write_atomically(path, _PARSED.dump_json(kept))


_PARSED = TypeAdapter(dict[str, ObjectModel])


@lru_cache(maxsize=4)
def _read_parsed(path: Path) -> dict[str, ObjectModel]:
    try:
        return _PARSED.validate_json(read_text(path, _MAX_BYTES))
    except (BusybotError, ValueError):
        return {}


@lru_cache(maxsize=1)
def _parser_hash() -> str:
    """Names what decides how files are parsed: the modules that do it, and NumPy, which rounds."""
    digest = hashlib.sha256(np.__version__.encode())
    folder = Path(__file__).parent
    for source in [folder / "model.py", *sorted((folder / "partnet").glob("*.py"))]:
        digest.update(source.name.encode() + b"\0" + source.read_bytes())
    return digest.hexdigest()[:16]


def remember(path: Path, objects: dict[str, str]) -> None:
    """Note that the library at `path` held these objects (sha256 by key); the newest entry comes last."""
    place = str(path.resolve())
    entries = _read()
    if list(entries) and list(entries)[-1] == place and entries[place] == objects:
        return
    entries.pop(place, None)
    entries[place] = objects
    kept = list(entries.items())[-_MAX_ENTRIES:]
    with suppress(OSError, BusybotError):
        write_json(cache_folder() / _INDEX, [{"path": path, "objects": hashes} for path, hashes in kept])


def places(expected: dict[str, str]) -> list[Path]:
    """Folders whose library, when last seen, held every expected object with its hash; newest first."""
    found = [Path(place) for place, objects in _read().items() if expected.items() <= objects.items()]
    return found[::-1]


def _read() -> dict[str, dict[str, str]]:
    try:
        entries = read_json(cache_folder() / _INDEX)
        return {str(entry["path"]): {str(k): str(v) for k, v in entry["objects"].items()} for entry in entries}
    except (BusybotError, TypeError, KeyError, AttributeError):
        return {}
