"""Whether a command explains itself and shows progress: `--quiet`, which stands in the environment, so that worker
processes inherit it."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

QUIET = "BUSYBOT_QUIET"


def is_quiet() -> bool:
    """Whether progress and explanations are not wanted."""
    return os.environ.get(QUIET, "0") not in ("", "0")


def be_quiet(wanted: bool) -> None:
    """Be quiet from now on, in this process and in those that it starts."""
    if wanted:
        os.environ[QUIET] = "1"


@contextmanager
def quiet_within() -> Iterator[None]:
    """Around a command: what it was told ends with it."""
    before = os.environ.get(QUIET)
    try:
        yield
    finally:
        os.environ.pop(QUIET, None)
        if before is not None:
            os.environ[QUIET] = before
