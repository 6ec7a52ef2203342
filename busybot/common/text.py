"""Text from outside: names, settings and paths that somebody else chose, before they are printed, drawn or written."""

import re

_UNSEEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u2028\u2029\u200e\u200f\u202a-\u202e\u2066-\u2069\ufeff\ufffe\uffff\ud800-\udfff]"
)
"""Controls of terminals, marks that turn the direction of text, halves of surrogate pairs and what is no character; not
tab and line feed."""


def plain(text: object) -> str:
    """The text with all that a terminal, a page or an encoder would take for something else as escapes, as `\\x1b`."""
    return _UNSEEN.sub(lambda found: found[0].encode("unicode_escape").decode(), str(text))


def one_line(text: object) -> str:
    """The same, with line feeds as escapes, too: what follows one would look like a line of ours."""
    return plain(text).replace("\n", "\\n")


def unlinked(value: object) -> object:
    """A value of JSON whose strings are plain, of one line, and no links of Markdown, nor where such links lead."""
    if isinstance(value, str):
        return re.sub(r"\](?=[(\[:])", "] ", re.sub(r"\s*\n\s*", " ", plain(value)))
    if isinstance(value, list):
        return [unlinked(part) for part in value]
    if isinstance(value, dict):
        return {unlinked(name): unlinked(part) for name, part in value.items()}
    return value


def markdown_text(text: str) -> str:
    """Text from a file, in one line, without what Markdown or HTML would take for markup."""
    return re.sub(r"([\\`*_{}\[\]()<>#|!~&])", r"\\\1", " ".join(text.split()))


def markdown_code(text: str) -> str:
    """The same as a piece of code, also within a table."""
    return f"`{' '.join(text.replace('`', ' ').replace('|', ' ').split())}`"
