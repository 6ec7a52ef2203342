"""Tables that people or other programs wrote: CSV lines as checked rows that know their line, for messages."""

import csv
import io
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BeforeValidator, ConfigDict, Field, ValidationError

from busybot.common.atomic_io import parse_json, read_text
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel, first_fault
from busybot.common.limits import MAX_JSON_BYTES

MOST_LINES = 1_000_000
"""Of a table, 1 GB of memory: a line for each picture of nine hours, 30 a second."""


def absent(cell: Any) -> Any:
    """None for an empty cell."""
    return None if cell is None or str(cell).strip() == "" else cell


def listed(cell: Any) -> Any:
    """The list that a cell holds as JSON."""
    return parse_json(cell) if isinstance(cell, str) and cell else cell


Number = Annotated[float, Field(allow_inf_nan=False, ge=-1e9, le=1e9)]
Pixel = Annotated[Annotated[int, Field(ge=-1, le=32767)] | None, BeforeValidator(absent)]
Maybe = Annotated[Number | None, BeforeValidator(absent)]
Whole = Annotated[int | None, BeforeValidator(absent)]
Text = Annotated[str | None, BeforeValidator(absent)]
Numbers = Annotated[tuple[Number, ...], BeforeValidator(listed)]


class Row(FrozenModel):
    """A line of a table; columns that are not named here are passed over.

    Attributes:
        line: in the file, counted as editors do.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")

    line: int = 0


AnyRow = TypeVar("AnyRow", bound=Row)


def read_table(file: Path, model: type[AnyRow], hint: str, may_be_empty: bool = False) -> list[AnyRow]:
    """The lines of a table, at least one.

    Args:
        may_be_empty: whether names of columns alone are a table, too.

    Raises:
        BusybotError: naming file and line, if there is none or are too many, one does not fit the model, or it has
            more cells than there are names; or a column that is read has a name twice.
    """
    rows: list[AnyRow] = []
    text = read_text(file, MAX_JSON_BYTES, hint).removeprefix("\ufeff")  # which spreadsheets write
    lines = csv.DictReader(io.StringIO(text, newline=""), strict=True)
    try:
        names = [name.strip() for name in lines.fieldnames or ()]
        for name in model.model_fields:
            if names.count(name) > 1:
                raise BusybotError(f"{file}: its column {name!r} stands there twice", "leave one of them")
        for line in lines:
            beyond = line.pop(None, None) or ()  # where the library puts cells without a name
            if any(absent(cell) for cell in beyond):
                what = f"line {lines.line_num}: {len(names) + len(beyond)} cells, its first line has {len(names)}"
                raise BusybotError(
                    f"{file}: {what}", "write decimal points, not commas; or put texts with commas in quotes"
                )
            if len(rows) == MOST_LINES:
                raise BusybotError(f"{file}: it has more than {MOST_LINES} lines", "divide the recording")
            values = {name.strip(): value for name, value in line.items() if value is not None}
            rows.append(model.model_validate(values | {"line": lines.line_num}))
    except ValidationError as error:
        raise BusybotError(f"{file}: line {lines.line_num}: {first_fault(error)}", hint) from None
    except (csv.Error, ValueError, RecursionError, AttributeError) as error:
        raise BusybotError(f"{file}: line {lines.line_num}: {error}", hint) from None
    if not rows and not (may_be_empty and lines.fieldnames):
        raise BusybotError(f"{file}: it has no line with values", hint)
    return rows
