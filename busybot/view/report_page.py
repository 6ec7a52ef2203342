"""A page as blocks, and the blocks as Markdown and as HTML.

Text of blocks is Markdown of the simplest kind: `code`, **bold**, [links](target). In HTML everything else is escaped,
so that nothing from a result file becomes markup.
"""

import base64
import html
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from busybot.view.report_style import STYLE

Tone = Literal["", "reached", "missed", "missing", "reference", "text"]
MARKS = {"reached": " ✓", "missed": " ✗"}
MOST_COLUMNS = 8
"""A table of more columns is set more densely."""


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


def markdown(blocks: list[Block], folder: Path) -> str:
    """The page as Markdown; pictures are links relative to `folder`."""
    return "\n\n".join(_markdown(block, folder) for block in blocks) + "\n"


def _markdown(block: Block, folder: Path) -> str:
    match block:
        case Heading():
            return f"{'#' * block.level} {block.text}"
        case Text():
            return block.text
        case Tiles():
            return "\n".join(f"- **{number}** {words}" for number, words, _ in block.tiles)
        case Items():
            return "\n".join(f"- {item}" for item in block.items)
        case Picture():
            return f"![{block.caption}]({block.path.relative_to(folder).as_posix()})\n\n*{block.caption}*"
        case Fold():
            inner = "\n\n".join(_markdown(part, folder) for part in block.blocks)
            return f"<details><summary>{html.escape(block.summary)}</summary>\n\n{inner}\n\n</details>"
        case Grid():
            return _markdown_grid(block)


def _markdown_grid(grid: Grid) -> str:
    groups = [name for name, count in grid.groups for _ in range(count)] or [""] * len(grid.heads)
    heads = [f"{group}: {head}" if group else head for group, head in zip(groups, grid.heads, strict=True)]
    lines = [f"| {' | '.join([grid.corner, *heads])} |", "|---" * (1 + len(heads)) + "|"]
    for name, entries in grid.rows:
        cells = [_markdown_entry(entry) for entry in entries] or [""] * len(heads)
        shown = name if entries else f"*{name}*"
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in [shown, *cells]) + " |")
    return "\n".join(lines)


def _markdown_entry(entry: Entry) -> str:
    return f"{entry.text}{' ' + entry.small if entry.small else ''}{MARKS.get(entry.tone, '')}"


def document(title: str, blocks: list[Block]) -> str:
    """The page as one HTML file: styles and pictures are inside."""
    body = "\n".join(_html(block) for block in blocks)
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(title)}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n{body}\n</main>\n"
        "</body>\n</html>\n"
    )


def _html(block: Block) -> str:
    match block:
        case Heading():
            anchor = re.sub(r"[^a-z0-9]+", "-", block.text.lower()).strip("-")
            return f'<h{block.level} id="{anchor}">{inline(block.text)}</h{block.level}>'
        case Text():
            return f"<p>{inline(block.text)}</p>"
        case Tiles():
            tiles = (
                f'<div class="tile {tone}"><b>{html.escape(number)}</b><span>{inline(words)}</span></div>'
                for number, words, tone in block.tiles
            )
            return f'<div class="tiles">{"".join(tiles)}</div>'
        case Items():
            return "<ul>" + "".join(f"<li>{inline(item)}</li>" for item in block.items) + "</ul>"
        case Picture():
            return _html_picture(block)
        case Fold():
            inner = "\n".join(_html(part) for part in block.blocks)
            return f"<details><summary>{html.escape(block.summary)}</summary>\n{inner}\n</details>"
        case Grid():
            return _html_grid(block)


def _html_picture(picture: Picture) -> str:
    kind = "png" if picture.path.suffix.lower() == ".png" else "jpeg"
    data = base64.b64encode(picture.path.read_bytes()).decode()
    caption = inline(picture.caption)
    alt = html.escape(picture.caption, quote=True)
    image = f'<img alt="{alt}" src="data:image/{kind};base64,{data}">'
    return f"<figure>{image}<figcaption>{caption}</figcaption></figure>"


def _html_grid(grid: Grid) -> str:
    dense = ' class="dense"' if len(grid.heads) > MOST_COLUMNS else ""
    lines = [f'<div class="wide"><table{dense}>', "<thead>"]
    if grid.groups:
        spans = "".join(f'<th colspan="{count}" class="group">{inline(name)}</th>' for name, count in grid.groups)
        lines.append(f"<tr><th></th>{spans}</tr>")
    heads = "".join(f"<th>{inline(head)}</th>" for head in grid.heads)
    lines += [f"<tr><th>{inline(grid.corner)}</th>{heads}</tr>", "</thead>", "<tbody>"]
    for name, entries in grid.rows:
        if not entries:
            lines.append(f'<tr class="section"><th colspan="{1 + len(grid.heads)}">{inline(name)}</th></tr>')
            continue
        cells = "".join(_html_entry(entry) for entry in entries)
        lines.append(f"<tr><th>{inline(name)}</th>{cells}</tr>")
    return "\n".join([*lines, "</tbody>", "</table></div>"])


def _html_entry(entry: Entry) -> str:
    small = f" <small>{inline(entry.small)}</small>" if entry.small else ""
    meaning = f' class="{entry.tone}"' if entry.tone else ""
    return f"<td{meaning}>{inline(entry.text)}{MARKS.get(entry.tone, '')}{small}</td>"


def inline(text: str) -> str:
    """Escaped text with `code`, **bold** and links to pages and headings."""
    parts = re.split(r"(`[^`]+`)", html.escape(text.replace("\0", ""), quote=True))
    kept = [f"<code>{part[1:-1]}</code>" for part in parts[1::2]]
    marked = "".join(part if place % 2 == 0 else f"\0{place // 2}\0" for place, part in enumerate(parts))
    marked = re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", marked)
    marked = re.sub(r"\[([^\]]+)\]\((https://[^\s)]+|#[a-z0-9-]+)\)", r'<a href="\2">\1</a>', marked)
    return re.sub(r"\0(\d+)\0", lambda found: kept[int(found[1])], marked)
