"""Running set-up steps: quiet on the terminal, everything in a log file, and loud when one fails."""

from __future__ import annotations

import errno
import fcntl
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

LOG_LINES_SHOWN = 15
LINE_LENGTH_SHOWN = 200
REFUSED = errno.ENOSPC, errno.EDQUOT, errno.EACCES, errno.EPERM, errno.EROFS, errno.EISDIR
"""What a disk answers that is full, or where a file may not be written."""


class SetupError(Exception):
    """The set-up cannot go on: what is wrong, and what a person can do about it."""

    def __init__(self, what: str, hint: str):
        self.what, self.hint = what, hint
        super().__init__(f"{what}\n{hint}")


def say(message: str) -> None:
    """One line for the person who waits."""
    print(f"setup: {message}", file=sys.stderr, flush=True)


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Let one set-up at a time work in a folder; another one says that it waits, and goes on when the first has ended.

    The system takes the lock from a process that ends, however it does, and commands that are run do not inherit it.

    Raises:
        SetupError: also where a disk is full or may not be written to.
    """
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say(f"another set-up works in {folder}; waiting until it has ended")
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        except OSError:  # some file systems of other machines lock no folders
            pass
        yield
    except OSError as error:
        if error.errno not in REFUSED:
            raise
        where = "" if error.filename is None else f"{error.filename}: "
        hint = (
            "Make room on that disk, or change what lies there or who may write there; then run the same command again."
        )
        raise SetupError(f"{where}{error.strerror or error}", hint) from None
    finally:
        os.close(descriptor)


def clean_environment() -> dict[str, str]:
    """The environment without what would lead Python or pip away from the virtual environment."""
    misleading = (
        "PYTHONPATH",
        "PYTHONHOME",
        "PIP_USER",
        "PIP_TARGET",
        "PIP_PREFIX",
        "PIP_REQUIRE_HASHES",
        "VIRTUAL_ENV",
    )
    return {key: value for key, value in os.environ.items() if key not in misleading}


class Log:
    """Runs commands with their output in one file, which a failure names."""

    def __init__(self, path: Path):
        self.path = path
        path.write_text("", encoding="utf-8")

    def run(self, argv: Sequence[str], stdin: str | None = None, extra: dict[str, str] | None = None) -> bool:
        """Run to the end, with `extra` in the environment; True when the command succeeded."""
        start = time.monotonic()
        with self.path.open("a", encoding="utf-8") as log:
            log.write(f"$ {' '.join(argv)}\n")
            log.flush()
            try:
                done = subprocess.run(
                    argv,
                    input=stdin or "",
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    text=True,
                    env=clean_environment() | (extra or {}),
                )
                code = done.returncode
            except OSError as error:
                log.write(f"{error}\n")
                code = 127
            log.write(f"[exit {code} after {time.monotonic() - start:.1f} s]\n")
        return code == 0

    def must(self, argv: Sequence[str], what: str, hint: str, stdin: str | None = None) -> None:
        """Run, and fail loudly with `what` and `hint` when the command does."""
        if not self.run(argv, stdin):
            raise SetupError(f"{what}; the last lines of {self.path}:\n{self.tail()}", hint)

    def tail(self) -> str:
        """The last lines of the log that say something, indented."""
        lines = self.path.read_text(encoding="utf-8", errors="replace").splitlines()
        lines = [line[:LINE_LENGTH_SHOWN] for line in lines if not line.startswith("Requirement already satisfied")]
        return "\n".join(f"    {line}" for line in lines[-LOG_LINES_SHOWN:])
