"""The one error that users are meant to read: what is wrong, where, and how to mend it."""

from collections.abc import Iterator
from contextlib import contextmanager

LONGEST = 1200
"""Characters of a message."""


class BusybotError(Exception):
    """Input or environment at fault. The command line prints the message and exits with 1.

    Args:
        what: the fault, naming the file, episode or place.
        hint: what the user can do about it, as a command or a sentence.
    """

    def __init__(self, what: str, hint: str | None = None):
        self.what, self.hint = _readable(what), hint
        super().__init__(self.what if hint is None else f"{self.what}\n  hint: {hint}")


def _readable(text: str) -> str:
    """A message that quotes megabytes of somebody's file helps nobody: its beginning and its end do."""
    return text if len(text) <= LONGEST else f"{text[: LONGEST * 2 // 3]} ... {text[-LONGEST // 4 :]}"


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
