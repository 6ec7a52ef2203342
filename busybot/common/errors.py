"""The one error that users are meant to read: what is wrong, where, and how to mend it."""

import errno
import os
import shutil
import tokenize
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from busybot.common.text import plain

LONGEST = 1200
"""Characters of a message."""
DAMAGED_ARRAY = (
    *(OSError, ValueError, KeyError, TypeError, EOFError, SyntaxError, RecursionError, MemoryError),
    *(tokenize.TokenError, zipfile.BadZipFile, zlib.error),
)
"""What `numpy.load` raises when a file is not what it expects: it parses the header as Python's text."""


class BusybotError(Exception):
    """Input or environment at fault. The command line prints the message and exits with 1.

    Args:
        what: the fault, naming the file, episode or place.
        hint: what the user can do about it, as a command or a sentence.
    """

    def __init__(self, what: str, hint: str | None = None):
        self.what, self.hint = _readable(plain(what)), None if hint is None else plain(hint)
        super().__init__(self.what if hint is None else f"{self.what}\n  hint: {self.hint}")


def _readable(text: str) -> str:
    """A message that quotes megabytes of somebody's file helps nobody: its beginning and its end do."""
    return text if len(text) <= LONGEST else f"{text[: LONGEST * 2 // 3]} ... {text[-LONGEST // 4 :]}"


class UsageError(BusybotError):
    """What was typed can never be right, whatever the files and the machine are: the command line exits with 2."""


class NoEpisodeError(BusybotError, IndexError):
    """A dataset has no episode of this number: also what Python's own sequences raise."""


EXTRA_OF = {
    **dict.fromkeys(("sapien", "gymnasium"), "sim"),
    **dict.fromkeys(("torch", "torch_geometric", "safetensors", "scipy"), "learn"),
    **dict.fromkeys(("rerun", "matplotlib", "jinja2", "markupsafe"), "view"),
}
"""Modules that a light install, which only reads recordings, does not have, with the extra that brings them."""


def needs_extra(package: str, extra: str) -> BusybotError:
    """The error of a command whose optional package is absent; a name on a package index may be somebody else's."""
    way = "setup" if extra in EXTRA_OF.values() else "extras"
    return BusybotError(
        f"{package} is not installed", f"in busybot's own folder: make {way}, or pip install -e '.[{extra}]'"
    )


@contextmanager
def naming_extras() -> Iterator[None]:
    """Tell which extra brings a package that is absent."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name not in EXTRA_OF:
            raise
        raise needs_extra(error.name, EXTRA_OF[error.name]) from None


@contextmanager
def naming(place: object) -> Iterator[None]:
    """Put the file or folder in front of messages that do not name it."""
    try:
        yield
    except BusybotError as error:
        if str(place) in error.what:
            raise
        raise BusybotError(f"{place}: {error.what}", error.hint) from None


def without_name(error: BusybotError, place: object) -> str:
    """What the error says, where the file or folder is named beside it."""
    return error.what.removeprefix(f"{place}: ")


FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
AGAIN = "then repeat the command: what was finished is kept"


def explained(error: OSError | MemoryError) -> BusybotError:
    """What the system refused, as an error for users: the path, the room that is left there, and what to do."""
    if isinstance(error, MemoryError):
        place = f"{error}: " if str(error) else ""
        return BusybotError(f"{place}there is not enough memory", f"fewer --workers need less; {AGAIN}")
    path, why = error.filename, error.strerror or str(error)
    if path is None and isinstance(error, FileNotFoundError) and not current_folder():
        return BusybotError("the current folder was deleted", "change into a folder that exists")
    where = "" if path is None else f"{os.fsdecode(path) if isinstance(path, bytes) else path}: "
    if error.errno in FULL:
        return BusybotError(f"{where}{why}; {_free(path)}", f"make room, or choose another disk, {AGAIN}")
    if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
        return BusybotError(f"{where}{why}", "choose a folder that you may write into, or change its permissions")
    return BusybotError(f"{where}{why}; {_free(path)}", "check that the path can be read and written")


def current_folder() -> Path | None:
    """Where commands write by default; None if somebody deleted it."""
    try:
        return Path.cwd()
    except OSError:
        return None


def _free(path: object) -> str:
    """How much room is left where the path is or would be; nobody knows which disk is full without one."""
    if path is None:
        return "how much room is left there is not known"
    try:
        place = Path(os.fsdecode(path) if isinstance(path, bytes) else str(path))
        while not place.exists() and place != place.parent:
            place = place.parent
        return f"{shutil.disk_usage(place).free / 1e6:.1f} MB are free on its disk"
    except (OSError, ValueError):
        return "how much room is left there is not known"
