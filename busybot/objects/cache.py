"""The user's cache: built procedural libraries, and where libraries with given hashes were last seen.

The cache is a convenience: an unreadable or unwritable one costs time, never correctness.
"""

import json
import os
from pathlib import Path

from busybot.common.atomic_io import write_json

_INDEX = "libraries.json"
_MAX_ENTRIES = 64


def cache_folder() -> Path:
    """`$BUSYBOT_CACHE`, else `$XDG_CACHE_HOME/busybot`, else `~/.cache/busybot`; not made here."""
    if own := os.environ.get("BUSYBOT_CACHE"):
        return Path(own)
    if shared := os.environ.get("XDG_CACHE_HOME"):
        return Path(shared) / "busybot"
    return Path.home() / ".cache" / "busybot"


def remember(path: Path, objects: dict[str, str]) -> None:
    """Note that the library at `path` held these objects (sha256 by key); the newest entry comes last."""
    place = str(path.resolve())
    entries = _read()
    if list(entries) and list(entries)[-1] == place and entries[place] == objects:
        return
    entries.pop(place, None)
    entries[place] = objects
    try:
        kept = list(entries.items())[-_MAX_ENTRIES:]
        write_json(cache_folder() / _INDEX, [{"path": path, "objects": hashes} for path, hashes in kept])
    except OSError:
        return


def places(expected: dict[str, str]) -> list[Path]:
    """Folders whose library, when last seen, held every expected object with its hash; newest first."""
    found = [Path(place) for place, objects in _read().items() if expected.items() <= objects.items()]
    return found[::-1]


def _read() -> dict[str, dict[str, str]]:
    try:
        entries = json.loads((cache_folder() / _INDEX).read_text(encoding="utf-8"))
        return {str(entry["path"]): {str(k): str(v) for k, v in entry["objects"].items()} for entry in entries}
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return {}
