"""Pages of which a program makes the part below a mark."""

from collections.abc import Callable
from pathlib import Path

from busybot.files import write_atomically


def renewed(text: str, mark: str, made: str) -> str:
    """The page with everything below the mark replaced."""
    return f"{text.split(mark)[0]}{mark}\n\n{made}"


def renew(path: Path, page: Callable[[str], str]) -> None:
    """Replace a page's file by what `page` makes of its text."""
    write_atomically(path, page(path.read_text(encoding="utf-8")).encode())
