"""What `dataset export` wrote, one recording after the other: its tables as checked rows, and its pictures.

`images` has a folder for each recording, `parquet` and `hf` have tables of all; `exporting.frames` tells their columns.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any, Protocol, TypeVar

from pydantic import ValidationError

from busybot.common.atomic_io import folders_with, inside, read_regular, regular_files
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import first_fault
from busybot.common.limits import MAX_PICTURE_BYTES, MAX_RECORDING_BYTES
from busybot.datasets.exporting.frames import EPISODES_FOLDER, IMAGE, TABLES
from busybot.datasets.importing.containers import read_rows
from busybot.datasets.importing.csv_tables import Row, read_table

HINT = "`busybot dataset export DATASET --to images` writes such a folder, `--to parquet` such tables"
TABLES_FOLDER, OBJECTS = "data", "objects"
BATCH = 64
"""Rows that are decoded at once."""

AnyRow = TypeVar("AnyRow", bound=Row)


class ExportedRecording(Protocol):
    """One recording of an export."""

    @property
    def place(self) -> str:
        """For messages."""

    def file(self, table: str) -> Path:
        """Where a table lies."""

    def rows(self, table: str, model: type[AnyRow]) -> list[AnyRow]:
        """Its rows of a table, at least one but of `objects`; BusybotError names the file and the row."""

    def picture(self, name: str) -> bytes:
        """A picture that a row of `frames` names."""

    def frames(self) -> int:
        """How many there are."""

    def forget(self) -> None:
        """Keep no pictures any longer."""


@dataclass(frozen=True)
class RecordingFolder:
    """A recording in a folder of its own."""

    folder: Path

    @property
    def place(self) -> str:
        return str(self.folder)

    def file(self, table: str) -> Path:
        return inside(self.folder, f"{table}.csv")

    def rows(self, table: str, model: type[AnyRow]) -> list[AnyRow]:
        return read_table(self.file(table), model, HINT, may_be_empty=table == OBJECTS)

    def picture(self, name: str) -> bytes:
        return read_regular(
            inside(self.folder, name), MAX_PICTURE_BYTES, "put the picture there, or correct frames.csv"
        )

    def frames(self) -> int:
        return len(self.rows("frames", Row))

    def forget(self) -> None:
        """It keeps none."""


@dataclass(frozen=True)
class _Part:
    """Where a recording's rows of a table are."""

    file: Path
    first: int
    count: int


@dataclass(frozen=True, eq=False)
class RecordingRows:
    """A recording in tables of all."""

    index: int
    parts: dict[str, _Part]
    _kept: dict[str, bytes] = field(default_factory=dict)

    @property
    def place(self) -> str:
        return f"{self.file('frames')}: episode {self.index}"

    def file(self, table: str) -> Path:
        return self.parts[table].file

    def rows(self, table: str, model: type[AnyRow]) -> list[AnyRow]:
        part, columns = self.parts[table], [name for name in model.model_fields if name != "line"]
        pictures = {column.name for column in TABLES[table] if column.type == IMAGE}
        rows: list[AnyRow] = []
        own, size = islice(read_rows(part.file, columns, BATCH, part.first), part.count), 0
        for number, told in enumerate(own, start=part.first + 1):
            try:
                shown = {name: _picture(told[name], name) for name in told.keys() & pictures}
                size += sum(len(one[0]) for one in shown.values() if one)
                if size > MAX_RECORDING_BYTES:
                    what = f"{self.place} has more than {MAX_RECORDING_BYTES} bytes of pictures"
                    raise BusybotError(f"{part.file}: row {number}: {what}", "export shorter recordings")
                names = {name: one and self._named(*one) for name, one in shown.items()}
                rows.append(model.model_validate(told | names | {"line": number}))
            except (ValidationError, ValueError) as error:
                fault = first_fault(error) if isinstance(error, ValidationError) else error
                raise BusybotError(f"{part.file}: row {number}: {fault}", HINT) from None
        return rows

    def _named(self, data: bytes, path: Any) -> str:
        """The name by which `picture` finds it; those that other programs wrote may have none."""
        name = str(path or hashlib.sha256(data).hexdigest())
        if self._kept.setdefault(name, data) != data:
            raise ValueError(f"another picture is called {name!r}, too")
        return name

    def picture(self, name: str) -> bytes:
        if len(self._kept[name]) > MAX_PICTURE_BYTES:
            raise BusybotError(f"{self.place}: {name} has more than {MAX_PICTURE_BYTES} bytes", HINT)
        return self._kept[name]

    def frames(self) -> int:
        return self.parts["frames"].count

    def forget(self) -> None:
        self._kept.clear()


def _picture(cell: Any, name: str) -> tuple[bytes, Any] | None:
    """Bytes and path of a picture in a column of this name; None where there is none.

    Raises:
        ValueError: it is something else: whoever wrote the table chose the column's type.
    """
    if cell is None:
        return None
    data = cell.get("bytes") or b"" if isinstance(cell, dict) else None
    if not isinstance(data, bytes):
        raise ValueError(f"{name}: it holds no picture")
    return data, cell.get("path")


def exported_recordings(source: Path) -> Sequence[ExportedRecording]:
    """The recordings of an export, in order; none where it is of another kind.

    Raises:
        BusybotError: naming the file, if tables do not tell of the same recordings.
    """
    if folders := folders_with(inside(source, EPISODES_FOLDER)):
        return [RecordingFolder(folder) for folder in folders]
    if not (source / TABLES_FOLDER / "frames").is_dir():
        return []
    tables = {name: _parts(source, name) for name in ("frames", OBJECTS, "episodes")}
    if tables["episodes"].keys() - tables[OBJECTS].keys():
        tables[OBJECTS] = _without_objects(source, tables["episodes"]) | tables[OBJECTS]
    for name, parts in tables.items():
        if parts.keys() != tables["episodes"].keys():
            odd = min(parts.keys() ^ tables["episodes"].keys())
            there, missing = (name, "episodes") if odd in parts else ("episodes", name)
            what = f"{tables[there][odd].file}: episode {odd} is in the table `{there}` and not in `{missing}`"
            raise BusybotError(what, "export the dataset again")
    for index, part in tables["episodes"].items():
        if part.count > 1:  # a small file may have millions, and each would be read
            what = f"{part.file}: episode {index} has {part.count:,} rows, and not one"
            raise BusybotError(what, "export the dataset again")
    return [
        RecordingRows(index, {name: parts[index] for name, parts in tables.items()})
        for index in sorted(tables["episodes"])
    ]


def _parts(source: Path, table: str) -> dict[int, _Part]:
    """Where each episode's rows of a table are; they follow each other in one file."""
    found: dict[int, _Part] = {}
    folder = inside(source, f"{TABLES_FOLDER}/{table}")
    if odd := sorted(path for path in folder.glob("*.parquet") if path.is_dir()):
        raise BusybotError(f"{odd[0]}: a folder, where a table belongs", HINT)
    for file in regular_files(folder, lambda name: name.endswith(".parquet")) if folder.is_dir() else ():
        for number, row in enumerate(read_rows(file, ["episode"], 1 << 16)):
            index = row["episode"]
            if not isinstance(index, int) or index < 0:
                raise BusybotError(f"{file}: row {number + 1}: {index!r} is no number of an episode", HINT)
            before = found.get(index)
            if before is None:
                found[index] = _Part(file, number, 1)
            elif (before.file, before.first + before.count) == (file, number):
                found[index] = _Part(file, before.first, before.count + 1)
            else:
                raise BusybotError(f"{file}: row {number + 1}: episode {index} is in two places", HINT)
    if not found and table != OBJECTS:
        raise BusybotError(f"{folder}: it has no rows", HINT)
    return found


def _without_objects(source: Path, episodes: dict[int, _Part]) -> dict[int, _Part]:
    """No rows in table `objects`, of those recordings that say that they have no objects."""
    files, nothing = (
        {part.file for part in episodes.values()},
        _Part(inside(source, f"{TABLES_FOLDER}/{OBJECTS}"), 0, 0),
    )
    rows = (row for file in files for row in read_rows(file, ["episode", OBJECTS], 1 << 16))
    return {row["episode"]: nothing for row in rows if row[OBJECTS] == 0}
