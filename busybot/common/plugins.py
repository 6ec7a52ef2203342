"""What installed packages bring: entry points of the groups `busybot.mechanisms`, `encoders`, `reasoners`, `agents` and
`objects` (docs/extending/template). A package is loaded when it is named, mechanisms also when all are listed.
"""

import hashlib
from collections.abc import Iterable
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal, get_args

from busybot.common.errors import BusybotError

HINT = "repair its package or uninstall it"
Kind = Literal["mechanisms", "encoders", "reasoners", "agents", "objects"]


def names(kind: Kind) -> list[str]:
    """What packages bring of a kind, by the names that commands take."""
    return sorted(_points(kind))


@cache
def load(kind: Kind, name: str) -> Any:
    """What a package brings under a name.

    Raises:
        BusybotError: two packages bring it, or it cannot be loaded.
    """
    point, *others = _points(kind)[name]
    if others:
        what = f"{where(kind, name)}: {others[0].value!r} has the same name {name!r}"
        raise BusybotError(what, "uninstall one of the packages")
    try:
        return point.load()
    except Exception as error:  # whatever a stranger's module does when it is imported
        raise BusybotError(f"{where(kind, name)} cannot be loaded: {error}", HINT) from error


def where(kind: Kind, name: str) -> str:
    """What a package's entry point is called in messages."""
    point = _points(kind)[name][0]
    package = f" (package {point.dist.name})" if point.dist else ""
    return f"entry point {point.value!r} of the group busybot.{kind}{package}"


def make(kind: Kind, name: str, *arguments: Any) -> Any:
    """The same, called.

    Raises:
        BusybotError: it cannot be.
    """
    maker = load(kind, name)
    try:
        return maker(*arguments)
    except BusybotError:
        raise
    except Exception as error:
        what = f"{where(kind, name)} cannot be made: {type(error).__name__}: {error}"
        raise BusybotError(what, HINT) from error


def packages() -> dict[str, str]:
    """Installed packages that bring something: their version, and a digest of the sources of the modules that they
    name, by their name. What was computed with one may differ from what is computed with another."""
    points = [point for kind in get_args(Kind) for several in _points(kind).values() for point in several]
    modules: dict[tuple[str, str], set[str]] = {}
    for point in points:
        if point.dist is not None:
            modules.setdefault((point.dist.name, point.dist.version), set()).add(point.module.partition(".")[0])
    return {name: f"{version}, sha256 {_digest(found)}" for (name, version), found in sorted(modules.items())}


def _digest(modules: Iterable[str]) -> str:
    """Of all sources of top-level modules; of one that is not there, of its name."""
    digest = hashlib.sha256()
    for module in sorted(modules):
        spec = find_spec(module)
        folders = list(spec.submodule_search_locations or ()) if spec else []
        files = [file for folder in folders for file in Path(folder).rglob("*.py")]
        if spec and not folders and spec.origin and Path(spec.origin).is_file():
            files = [Path(spec.origin)]
        digest.update(module.encode())
        for file in sorted(files):
            digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


@cache
def _points(kind: Kind) -> dict[str, list[EntryPoint]]:
    found: dict[str, list[EntryPoint]] = {}
    for point in entry_points(group=f"busybot.{kind}"):
        found.setdefault(point.name, []).append(point)
    return found
