"""The one error that users are meant to read: what is wrong, where, and how to mend it."""

from collections.abc import Iterator
from contextlib import contextmanager


class BusybotError(Exception):
    """Input or environment at fault. The command line prints the message and exits with 1.

    Args:
        what: the fault, naming the file, episode or place.
        mend: what the user can do about it, as a command or a sentence.
    """

    def __init__(self, what: str, mend: str | None = None):
        self.what, self.mend = what, mend
        super().__init__(what if mend is None else f"{what}\n  mend: {mend}")


@contextmanager
def naming(place: object) -> Iterator[None]:
    """Put the file or folder in front of messages that do not name it."""
    try:
        yield
    except BusybotError as error:
        if str(place) in error.what:
            raise
        raise BusybotError(f"{place}: {error.what}", error.mend) from None
