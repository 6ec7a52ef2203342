"""Which version of a package is installed, to be told beside what it made."""

from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version

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
