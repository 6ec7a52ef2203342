"""Folders of unfinished work: hidden beside what they become, locked while their process lives.

What a killed process left is told from what another one is working on by the lock, which ends with its process, and is
removed when the same work begins again. Where a file system has no locks, nothing is removed.
"""

import fcntl
import os
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from busybot.errors import BusybotError


@contextmanager
def unfinished(parent: Path, name: str) -> Iterator[Path]:
    """A new folder `parent/.NAME-....tmp`; what is left of it at the end is removed. It may be renamed away.

    Args:
        parent: an existing folder.
        name: of the kind of work; `remove_abandoned` gets the same.
    """
    while True:
        folder = parent / f".{name}-{os.urandom(4).hex()}.tmp"
        folder.mkdir()
        lock = _lock(folder)
        if lock is not None:
            break  # else another process took it for abandoned, in the moment between the two calls
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os.close(lock)


def remove_abandoned(parent: Path, name: str, rescue: Callable[[Path], None] | None = None) -> None:
    """Remove such folders of processes that are no more.

    Args:
        rescue: called with each folder before it is removed.
    """
    ours = re.compile(rf"\.{re.escape(name)}-[0-9a-f]{{8}}\.tmp")
    if not parent.is_dir():
        return
    for folder in sorted(parent.iterdir()):
        if not ours.fullmatch(folder.name) or folder.is_symlink() or not folder.is_dir():
            continue
        lock = _lock(folder, when_unknown=False)
        if lock is None:
            continue
        try:
            if rescue is not None:
                rescue(folder)
            shutil.rmtree(folder, ignore_errors=True)
        finally:
            os.close(lock)


def refuse_taken(place: Path) -> None:
    """Only what is absent, or an empty folder, can become something new by renaming.

    Raises:
        BusybotError: something is there.
    """
    if place.is_symlink() or (place.exists() and (not place.is_dir() or any(place.iterdir()))):
        raise BusybotError(f"{place}: it exists and is not an empty folder", "name another folder, or remove it")
    if place.is_dir() and (place.is_mount() or place.samefile(os.curdir)):  # it could not be replaced, or be found
        raise BusybotError(f"{place}: it is the current folder or a mounted one", "name a new folder in it")


def _lock(folder: Path, when_unknown: bool = True) -> int | None:
    """Descriptor that holds the folder's lock; None when another process has it or the folder is gone.

    Args:
        when_unknown: whether a folder that cannot be locked at all counts as locked by this process.
    """
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        locked = folder.exists() and os.path.samestat(os.fstat(descriptor), folder.lstat())
    except BlockingIOError:
        locked = False
    except OSError:
        locked = when_unknown
    if locked:
        return descriptor
    os.close(descriptor)
    return None
