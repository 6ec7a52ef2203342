"""A library of objects that comes with the package."""

from pathlib import Path


def folder() -> Path:
    """Where it lies: a folder `levers/CATEGORY/ID` for each object, as `busybot assets import` writes them."""
    return Path(__file__).parent / "levers"
