"""Finds the library that a command or a dataset means: by name, by folder, or by the hashes that were recorded.

Where a library with certain objects was last seen is noted in the user's cache (`objects.cache`), so that a dataset's
objects are found again without being named.
"""

import os
from pathlib import Path

from busybot.common import plugins
from busybot.common.errors import BusybotError
from busybot.objects import cache
from busybot.objects.library import Library
from busybot.objects.procedural.build import procedural_library

_HINT = "name the library with which the dataset was made: --assets DIR"


def find(assets: str | None, expected: dict[str, str] | None = None) -> Library:
    """The library that a command or a dataset means.

    Args:
        assets: `procedural`, a library's folder, or the name of one that a package brings (entry-point group
            `busybot.objects`: a function that returns the folder). None: the one that holds `expected`, else
            `procedural`.
        expected: sha256 by key as a dataset recorded them.

    Raises:
        BusybotError: an expected object is absent or differs; it is named.
    """
    if assets is None and expected:
        return _find_by_hash(expected)
    library = _open(assets or "procedural")
    if problem := mismatch(library, expected or {}):
        raise BusybotError(problem, _HINT)
    return library


def mismatch(library: Library, expected: dict[str, str]) -> str | None:
    """What the library lacks or has otherwise, naming up to three objects; None when all is there."""
    faults = [f"{key} is absent" for key in sorted(expected) if key not in library.objects]
    faults += [
        f"{key} differs from the recorded one (sha256 {expected[key][:12]})"
        for key, model in library.objects.items()
        if key in expected and expected[key] != model.sha256
    ]
    if not faults:
        return None
    return f"{library.folder}: {'; '.join(faults[:3])}{f'; and {len(faults) - 3} more' if len(faults) > 3 else ''}"


def load_and_remember(path: Path) -> Library:
    """Read a library, and note in the user's cache where its objects lie."""
    with cache.parsed_objects() as known:
        library = Library.load(path, known)
    cache.remember(path, library.hashes())
    return library


def _open(assets: str) -> Library:
    if assets in plugins.names("objects") and not Path(assets).exists():
        return load_and_remember(_brought(assets))
    if assets != "procedural":
        return load_and_remember(Path(assets))
    with cache.parsed_objects() as known:
        library = procedural_library(known)
    cache.remember(library.folder, library.hashes())
    return library


def _brought(name: str) -> Path:
    """The folder of a library that a package brings."""
    folder = plugins.make("objects", name)
    if not isinstance(folder, str | Path):
        what = f"{plugins.where('objects', name)} returns a {type(folder).__name__}, not a library's folder"
        raise BusybotError(what, plugins.HINT)
    return Path(folder)


def _find_by_hash(expected: dict[str, str]) -> Library:
    """Where the objects were last seen, then `$BUSYBOT_PARTNET_DIR`, then the procedural ones."""
    candidates = [str(place) for place in cache.places(expected) if place.is_dir()]
    if variable := os.environ.get("BUSYBOT_PARTNET_DIR"):
        candidates.append(variable)
    problems = []
    for candidate in [*dict.fromkeys(candidates), *plugins.names("objects"), "procedural"]:
        try:
            library = _open(candidate)
        except BusybotError as error:
            problems.append(error.what)
            continue
        problem = mismatch(library, expected)
        if problem is None:
            return library
        problems.append(problem)
    raise BusybotError(f"no library holds the objects that the dataset recorded: {' | '.join(problems)}", _HINT)
