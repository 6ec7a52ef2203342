"""A page as blocks, and the blocks as Markdown and as HTML: the one way in which reports, docs and README show tables.

Text of blocks is Markdown of the simplest kind: `code`, **bold**, [links](target). Everything else in it is escaped, so
that nothing from a result file becomes markup. How HTML looks is said in `template.html`.
"""

import base64
import html
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape
from PIL import Image

from busybot.common.atomic_io import read_regular
from busybot.common.errors import BusybotError
from busybot.common.limits import MAX_PICTURE_BYTES, MAX_PICTURE_PIXELS
from busybot.common.text import plain

Tone = Literal["", "reached", "missed", "missing", "reference"]
MARKS = {"reached": " ✓", "missed": " ✗"}
SIZES, QUALITY = (1.0, 0.8, 0.65, 0.5, 0.4, 0.3, 0.2, 0.1, 0.05), 80
"""Of pictures that are made smaller: shares of their sides that are tried, and of JPEG."""


@dataclass(frozen=True)
class Entry:
    """A cell of a grid: what it says, what stands small behind it, and what it means."""

    text: str
    small: str = ""
    tone: Tone = ""


@dataclass(frozen=True)
class Heading:
    text: str
    level: int = 2


@dataclass(frozen=True)
class Text:
    text: str


@dataclass(frozen=True)
class Tiles:
    """A few large numbers: (number, words, tone)."""

    tiles: tuple[tuple[str, str, Tone], ...]


@dataclass(frozen=True)
class Grid:
    """A table.

    Attributes:
        groups: heads above the columns, each with the number of columns that it spans; Markdown has them in the heads.
        heads: of the columns behind the first one.
        rows: (name, cells); a row without cells is a line between sections.
    """

    groups: tuple[tuple[str, int], ...]
    heads: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Entry, ...]], ...]
    corner: str = ""


@dataclass(frozen=True)
class Picture:
    path: Path
    caption: str


@dataclass(frozen=True)
class Items:
    items: tuple[str, ...]


@dataclass(frozen=True)
class Fold:
    """What only some want to read."""

    summary: str
    blocks: tuple["Block", ...] = field(default=())


Block = Heading | Text | Tiles | Grid | Picture | Items | Fold


def plain_grid(heads: Sequence[str], rows: Sequence[tuple[str, Sequence[str]]], corner: str = "") -> Grid:
    """A table of texts alone."""
    return Grid((), tuple(heads), tuple((name, tuple(map(Entry, cells))) for name, cells in rows), corner)


def number(value: float) -> str:
    """Percent with one digit."""
    return f"{value:.1f}"


def difference(share: float, p: float) -> str:
    """A difference of shares in points, and how probable it is by chance."""
    return f"{100 * share:+.1f} ({p:.2g})"


def reference(value: float) -> str:
    """A percentage of the paper or of a gate: one digit, two where it is below 1."""
    return f"{value:g}" if value < 1 else number(value)


def spread(value: float, low: float | None, high: float | None, several: bool = False) -> str:
    """Half the width of an interval, or the bounds of a share of 0 or 100, or the extremes of several seeds, if they
    differ; all percent."""
    if low is None or high is None or (several and number(low) == number(high)):
        return ""
    if several or (value in (0, 100) and low < high):
        return f"({number(low)} to {number(high)})"
    return f"± {number((high - low) / 2)}"


def markdown(blocks: Sequence[Block], folder: Path = Path()) -> str:
    """The page as Markdown; pictures are links relative to `folder`."""
    return "\n\n".join(_markdown(block, folder) for block in blocks) + "\n"


def _markdown(block: Block, folder: Path) -> str:
    match block:
        case Heading():
            return f"{'#' * block.level} {_harmless(block.text)}"
        case Text():
            return _harmless(block.text)
        case Tiles():
            return "\n".join(f"- **{_harmless(figure)}** {_harmless(words)}" for figure, words, _ in block.tiles)
        case Items():
            return "\n".join(f"- {_harmless(item)}" for item in block.items)
        case Picture():
            caption = _harmless(block.caption)
            return f"![{caption}]({block.path.relative_to(folder).as_posix()})\n\n*{caption}*"
        case Fold():
            inner = "\n\n".join(_markdown(part, folder) for part in block.blocks)
            return f"<details><summary>{html.escape(plain(block.summary))}</summary>\n\n{inner}\n\n</details>"
        case Grid():
            return _markdown_grid(block)


def _markdown_grid(grid: Grid) -> str:
    groups = [name for name, count in grid.groups for _ in range(count)] or [""] * len(grid.heads)
    heads = [f"{group}: {head}" if group else head for group, head in zip(groups, grid.heads, strict=True)]
    lines = [[grid.corner, *heads]]
    for name, entries in grid.rows:
        cells = [" ".join(filter(None, (one.text, one.small))) + MARKS.get(one.tone, "") for one in entries]
        lines.append([name, *cells] if entries else [f"*{name}*", *[""] * len(heads)])
    head, *rows = (f"| {' | '.join(_harmless(cell).replace('|', chr(92) + '|') for cell in line)} |" for line in lines)
    return "\n".join([head, "|---" * len(lines[0]) + "|", *rows])


UNPAIRED = re.compile(r"``|\\[`|]")
"""Where Markdown takes other backticks for a pair than those that stand one after the other: runs of them, and those
before which a backslash stands; before a bar it may end a table's cell, and code with it."""


def _harmless(text: str) -> str:
    """Markdown in which no tag opens; within code nothing is one, and code stands between two single backticks.

    Where it is not certain what is code, nothing is.
    """
    told = plain(text)
    if UNPAIRED.search(told) or any(line.count("`") % 2 for line in told.split("\n")):
        return told.replace("<", "&lt;")
    parts = re.split(r"(`[^`]+`)", told)
    return "".join(part if place % 2 else part.replace("<", "&lt;") for place, part in enumerate(parts))


def share(value: float | None) -> str:
    """Percent of a share, a dash without one."""
    return "-" if value is None else number(100 * value)


def document(title: str, blocks: Sequence[Block], most_bytes: int | None = None) -> str:
    """The page as one HTML file: styles and pictures are inside, and everything that is text is escaped.

    Args:
        most_bytes: of all pictures, as they stand in the page; those that take more than their part are made smaller.
    """
    engine = _engine(autoescape=True)
    pictures = sum(isinstance(block, Picture) for block in blocks)
    data = data_url if most_bytes is None else partial(data_url, most_bytes=most_bytes // max(1, pictures))
    engine.filters |= {"kind": lambda block: type(block).__name__, "inline": inline, "anchor": anchor, "data": data}
    return engine.get_template("template.html").render(title=title, blocks=blocks, marks=MARKS) + "\n"


def filled(name: str, **values: Any) -> str:
    """A template of Markdown in this folder with its values, in which no tag opens."""
    engine = _engine(finalize=lambda value: _harmless(str(value)))
    engine.filters["percent"] = share
    return engine.get_template(name).render(**values) + "\n"


def _engine(**settings: Any) -> Environment:
    loader = FileSystemLoader(Path(__file__).parent)
    return Environment(loader=loader, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, **settings)


def anchor(text: str) -> str:
    """What links to a heading name it by."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")


def data_url(path: Path, most_bytes: int | None = None) -> str:
    """A picture's file as it stands within a page, made smaller if it would take more bytes there."""
    data, kind = read_regular(path, MAX_PICTURE_BYTES), "png" if path.suffix.lower() == ".png" else "jpeg"
    if most_bytes is not None and 4 * len(data) // 3 > most_bytes:
        data, kind = _smaller(path, data, 3 * most_bytes // 4 - 64), "jpeg"
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def _smaller(path: Path, data: bytes, most: int) -> bytes:
    """The picture as JPEG, as large as the bytes allow."""
    try:
        with Image.open(io.BytesIO(data)) as opened:
            if opened.width * opened.height > MAX_PICTURE_PIXELS:
                raise BusybotError(f"{path}: more than {MAX_PICTURE_PIXELS} pixels", "leave it out")
            picture = opened.convert("RGB")
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        raise BusybotError(f"{path}: not a picture that can be read", "leave it out") from None
    for part in SIZES:
        buffer = io.BytesIO()
        size = (max(1, round(part * picture.width)), max(1, round(part * picture.height)))
        picture.resize(size, Image.Resampling.LANCZOS).save(buffer, "JPEG", quality=QUALITY, optimize=True)
        if buffer.tell() <= most:
            break
    return buffer.getvalue()


def inline(text: str) -> Markup:
    """Escaped text with `code`, **bold** and links to pages and headings."""
    parts = re.split(r"(`[^`]+`)", str(escape(plain(text))))
    kept = [f"<code>{part[1:-1]}</code>" for part in parts[1::2]]
    marked = "".join(part if place % 2 == 0 else f"\0{place // 2}\0" for place, part in enumerate(parts))
    marked = re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", marked)
    marked = re.sub(r"\[([^\]]+)\]\((https://[^\s)]+|#[a-z0-9-]+)\)", r'<a href="\2">\1</a>', marked)
    return Markup(re.sub(r"\0(\d+)\0", lambda found: kept[int(found[1])], marked))
