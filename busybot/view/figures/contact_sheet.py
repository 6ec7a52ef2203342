"""A contact sheet of a library: a portrait of every object, by category and split, with small captions."""

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from busybot.common.atomic_io import write_atomically
from busybot.common.errors import BusybotError
from busybot.objects.library import OTHER, Library
from busybot.sim.thumbnails import GROUND, thumbnails
from busybot.view.palette import FAINT, INK, MUTED

FORMATS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".webp": "WEBP"}
MOST_PIXELS = {"PNG": 2**31 - 1, "JPEG": 65500, "WEBP": 16383}
"""Of a side."""
QUALITY = 88
COLUMNS = 12
EMPTY = 3
"""A picture's row whose pixels differ less than this from the ground is empty."""
CATEGORIES = {"Switch": "Switches", "Lamp": "Lamps", "Door": "Doors", "Toy": "Track toys"}
SPLITS = {"train": "for training", "novel": "novel, for testing", OTHER: "for scenes alone", "": "in no split"}
Group = tuple[str, str, list[str]]
"""Category, split and keys."""


def groups(library: Library) -> list[Group]:
    """The library's objects by category and split, in the order of the sheet; empty groups are left out."""
    found: list[Group] = []
    for category in CATEGORIES:
        keys = sorted(key for key, model in library.objects.items() if model.category == category)
        listed = {split: [key for key in keys if key in library.splits.get(split, {})] for split in SPLITS if split}
        listed[""] = [key for key in keys if not any(key in of_split for of_split in listed.values())]
        found += [(category, split, keys) for split, keys in listed.items() if keys]
    return found


def sheet(
    path: Path,
    library: Library,
    cell: int = 150,
    columns: int = COLUMNS,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> int:
    """Render the whole library into one picture.

    Args:
        path: PNG, JPEG or WebP, by its ending.
        cell: side of a portrait, pixels.
        columns: portraits in a row.
        progress: told after each portrait: drawn ones and all.

    Returns:
        the number of objects shown.

    Raises:
        BusybotError: the ending is none of these, an object cannot be loaded, or the file cannot be written.
    """
    if path.suffix.lower() not in FORMATS:
        what = f"{path}: a sheet cannot be written as {path.suffix or 'this'}"
        raise BusybotError(what, "end the name in .png or .jpg")
    shown = groups(library)
    keys = [key for _, _, of_group in shown for key in of_group]
    pictures: dict[str, np.ndarray] = {}
    for key, picture in zip(keys, thumbnails(library, keys, cell), strict=True):
        pictures[key] = picture
        progress(len(pictures), len(keys))
    for category in CATEGORIES:
        _trim(pictures, [key for key in keys if key.startswith(f"{category}/")])
    image = _Page(cell, columns, shown, pictures).draw(f"{library.name}: {len(keys)} objects")
    most = MOST_PIXELS[FORMATS[path.suffix.lower()]]
    if max(image.size) > most:
        what = f"{path}: a sheet of {image.width} x {image.height} pixels; {path.suffix} has room for {most} a side"
        raise BusybotError(what, "end the name in .png, or draw smaller portraits: --cell 150 --columns 12")
    buffer = io.BytesIO()
    image.save(buffer, FORMATS[path.suffix.lower()], quality=QUALITY, optimize=True)
    try:
        write_atomically(path, buffer.getvalue())
    except OSError as error:
        raise BusybotError(f"{path}: cannot be written: {error.strerror}", "choose another place") from None
    return len(keys)


def _trim(pictures: dict[str, np.ndarray], keys: list[str]) -> None:
    """Cut what is empty above and below in all of these pictures."""
    used = [np.abs(pictures[key].astype(int) - GROUND).max(axis=(1, 2)) > EMPTY for key in keys]
    rows = np.flatnonzero(np.any(used, axis=0))
    for key in keys:
        pictures[key] = pictures[key][rows[0] : rows[-1] + 1]


class _Page:
    """The sheet's layout: all lengths in pixels follow from the size of a portrait."""

    def __init__(self, cell: int, columns: int, shown: list[Group], pictures: dict[str, np.ndarray]):
        self.cell, self.columns, self.shown, self.pictures = cell, columns, shown, pictures
        self.caption, self.header, self.margin = round(0.20 * cell), round(0.34 * cell), round(0.22 * cell)

    def block(self, keys: list[str]) -> tuple[int, int]:
        """Height of a row of these portraits with its captions, and of all of their rows."""
        row = len(self.pictures[keys[0]]) + self.caption
        return row, row * -(-len(keys) // self.columns)

    def draw(self, title: str) -> Image.Image:
        height = sum(self.header + self.block(keys)[1] for _, _, keys in self.shown)
        width = self.columns * self.cell + 2 * self.margin
        image = Image.new("RGB", (width, height + 2 * self.margin + round(0.8 * self.header)), GROUND)
        pen = ImageDraw.Draw(image)
        pen.text((self.margin, self.margin), title, INK, _font(0.155 * self.cell))
        y = self.margin + round(0.8 * self.header)
        for category, split, keys in self.shown:
            self._heading(pen, y, category, split, len(keys))
            y += self.header
            step, total = self.block(keys)
            for number, key in enumerate(keys):
                row, column = divmod(number, self.columns)
                x, top = self.margin + column * self.cell, y + row * step
                image.paste(Image.fromarray(self.pictures[key]), (x, top))
                place = (x + self.cell / 2, top + step - self.caption)
                font = _font(0.085 * self.cell)
                pen.text(place, _fitting(key.split("/")[1], font, 0.96 * self.cell), MUTED, font, anchor="ma")
            y += total
        return image

    def _heading(self, pen: ImageDraw.ImageDraw, y: int, category: str, split: str, count: int) -> None:
        base = y + round(0.72 * self.header)
        pen.line([(self.margin, base + 6), (self.margin + self.columns * self.cell, base + 6)], FAINT, 1)
        name, font = CATEGORIES[category], _font(0.115 * self.cell)
        pen.text((self.margin, base), name, INK, font, anchor="ls")
        after = self.margin + pen.textlength(f"{name}  ", font)
        pen.text((after, base), f"{SPLITS[split]} ({count})", MUTED, font, anchor="ls")


def _fitting(name: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont, width: float) -> str:
    """The name, or as much of its beginning and end as a caption has room for; long ones often differ at the end."""
    shown = name
    for left in range(len(name) - 1, 1, -1):
        if font.getlength(shown) <= width:
            break
        shown = f"{name[: left - left // 2]}…{name[len(name) - left // 2 :]}"
    return shown


def _font(pixels: float) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size=max(round(pixels), 8))
