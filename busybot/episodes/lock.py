"""One writer per dataset, and the temporary files of writers that were killed."""

import fcntl
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from busybot.errors import BusybotError
from busybot.files import inside, scan

LOCK_FILE = ".lock"
_TEMPORARY_NAME = re.compile(r"^\..*\.(\d+)\.tmp$")


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Hold the folder's lock, which ends with the process, however it ends.

    Raises:
        BusybotError: another process holds it.
    """
    with open(inside(folder, LOCK_FILE), "w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            what = f"{folder}: another process is writing into this dataset"
            raise BusybotError(what, "wait until it is done, or end it") from None
        yield


def remove_leftovers(folder: Path) -> int:
    """Delete temporary files of writers that are no more; returns their number. Call it under `writing`."""
    leftovers = [
        folder / name
        for name in scan(folder).files
        if (match := _TEMPORARY_NAME.match(Path(name).name)) and not _alive(int(match[1]))
    ]
    for file in leftovers:
        file.unlink(missing_ok=True)
    return len(leftovers)


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True
