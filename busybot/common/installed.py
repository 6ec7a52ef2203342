"""Which version of a package is installed, to be told beside what it made, and which sources."""

import hashlib
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from busybot.common.errors import BusybotError

ALIASES = {"opencv-python": ("opencv-python-headless", "opencv-contrib-python", "opencv-contrib-python-headless")}
"""Other packages that are the same library: machines without a screen often have one of these."""


def installed_version(name: str) -> str:
    """Of a package, or of the first of its aliases that is installed.

    Raises:
        BusybotError: neither is.
    """
    for one in (name, *ALIASES.get(name, ())):
        with suppress(PackageNotFoundError):
            return version(one)
    raise BusybotError(f"the package {name} is not installed", "busybot doctor")


def source_digest(place: Path) -> str:
    """SHA-256 of a file, or of all files below a folder with their names, but what Python compiles."""
    digest = hashlib.sha256()
    found = place.rglob("*") if place.is_dir() else [place]
    for file in sorted(path for path in found if path.is_file() and "__pycache__" not in path.parts):
        name, content = file.relative_to(place).as_posix(), hashlib.sha256(file.read_bytes()).digest()
        digest.update(f"{name}\0".encode() + content)
    return digest.hexdigest()
