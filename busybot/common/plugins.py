"""What installed packages bring: entry points of the groups `busybot.mechanisms`, `encoders`, `reasoners`, `agents` and
`objects` (docs/extending/template). A package is loaded when it is named, mechanisms also when all are listed.
"""

import re
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal, get_args

from busybot.common.errors import BusybotError
from busybot.common.installed import source_digest

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


@cache
def packages() -> dict[str, str]:
    """Installed packages that bring something: their version, and a digest of the sources of the modules that they
    name, by their name. What was computed with one may differ from what is computed with another."""
    modules: dict[tuple[str, str], set[str]] = {}
    for kind in get_args(Kind):
        for point in (point for points in _points(kind).values() for point in points):
            if point.dist is not None:
                module = re.split(r"[.:]", point.value)[0]
                modules.setdefault((point.dist.name, point.dist.version), set()).add(module)
    digests = {package: "".join(map(_digest, sorted(found))) for package, found in sorted(modules.items())}
    return {name: f"{version}, {digest or 'not there'}" for (name, version), digest in digests.items()}


def _digest(module: str) -> str:
    """Of the sources of a top-level module; empty if it is not there."""
    try:
        spec = find_spec(module)
    except (ImportError, ValueError):
        return ""
    places = [*(spec.submodule_search_locations or ()), *filter(None, [spec.origin])] if spec else []
    return source_digest(Path(places[0])) if places and Path(places[0]).exists() else ""


@cache
def _points(kind: Kind) -> dict[str, list[EntryPoint]]:
    found: dict[str, list[EntryPoint]] = {}
    for point in entry_points(group=f"busybot.{kind}"):
        found.setdefault(point.name, []).append(point)
    return found
