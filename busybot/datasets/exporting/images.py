"""A dataset as files that everything opens: JPEG and PNG pictures, and CSV tables that name them.

`episodes/000123` has `rgb/00000.jpg`, `depth/00000.png` and the tables of `frames.TABLES` as `frames.csv`,
`objects.csv`, `episodes.csv` (one row), in which the place of a picture is its file, relative to the table. Frames that
show no change share a file. Lists are JSON; an empty cell is a value that is not known. What only the simulator knows
lies in `privileged_*.csv` and `segmentation`, if it was asked for.
"""

import csv
import io
import json
from pathlib import Path, PurePosixPath
from typing import Any

import pyarrow as pa

from busybot.common.atomic_io import make_folder, write_atomically, write_new
from busybot.datasets.exporting.folder import Source
from busybot.datasets.exporting.frames import IMAGE, episode_tables
from busybot.datasets.manifest import CARD_FILE

_TEXT = """# Recordings as pictures and tables

Every folder in `episodes` is a recording. `frames.csv` has a row per frame: its picture `rgb`, its `depth`, and the
action that was taken there (where, in which direction, what changed); the last row has no action. `objects.csv` has
where each object is in the first picture, `episodes.csv` the camera and how all was recorded. A value v >= 1 of a depth
picture (16-bit PNG) is `depth_offset` + v * `depth_scale` board units (`episodes.csv`), 0 is nothing.
{privileged}
"""
_PRIVILEGED = """
`privileged_*.csv` and the folders `segmentation` hold what only the simulator knows; nothing that learns may read them.
"""


def write_episode(recording: Path, row: dict[str, Any], privileged: bool, folder: Path) -> None:
    """The pictures and tables of one recording."""
    written: set[str] = set()
    for name, table in episode_tables(recording, row, privileged).items():
        columns = [_cells(table, column, folder, written) for column in table.column_names]
        text = io.StringIO(newline="")
        lines = csv.writer(text, lineterminator="\n")
        lines.writerow(table.column_names)
        lines.writerows(zip(*columns, strict=True))
        write_new(folder / f"{name}.csv", text.getvalue().encode(), folder)


def _cells(table: pa.Table, name: str, folder: Path, written: set[str]) -> list[Any]:
    """The cells of a column; pictures among them are written."""
    values = table[name].to_pylist()
    if table.schema.field(name).type == IMAGE:
        return [None if value is None else _file(value, folder, written) for value in values]
    return [json.dumps(value) if isinstance(value, list) else value for value in values]


def _file(picture: dict[str, Any], folder: Path, written: set[str]) -> str:
    name = PurePosixPath(*PurePosixPath(picture["path"]).parts[2:]).as_posix()
    if name not in written:
        make_folder((folder / name).parent, folder)
        write_new(folder / name, picture["bytes"], folder)
        written.add(name)
    return name


def finish(folder: Path, source: Source) -> None:
    """README.md beside the episodes."""
    text = _TEXT.format(privileged=_PRIVILEGED if source.privileged else "")
    write_atomically(folder / CARD_FILE, text.encode(), folder)
