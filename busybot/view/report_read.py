"""Result files of evaluations and benchmarks, read for a report.

Known are the files of `benchmarks/table1.py`, `table2.py` and `table3.py`, those of single `busybot eval` commands, and
those of `report_kinds`. Files say shares from 0 to 1; cells are percent.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from busybot.errors import BusybotError
from busybot.files import read_json, scan, sha256_of
from busybot.view.protocol import BOUND_SLACK, PLANNING, TABLES, Table
from busybot.view.report_kinds import Lenient, Other, PlanResult, Robustness, Stages, about, other_kind, training_of

PICTURES = (".png", ".jpg", ".jpeg")
MOST_PICTURES = 24
"""Of all given folders together: a report is one file."""


class InteractResult(Lenient):
    """What `busybot eval interact` tells."""

    precision: float | None
    recall: float | None
    precision_exploring: float | None = None
    boards: int
    policy: str = ""
    strict: bool = False
    intervals: dict[str, Any]
    by_step: list[dict[str, float | None]] = []
    dataset: dict[str, Any]
    seed: int | None = None
    command: str = ""


class ReasonResult(Lenient):
    """What `busybot eval reason` tells."""

    model: str | None = None
    images: int | None = None
    boards: int
    edge_p: float | None
    edge_r: float | None
    edge_r_bound: float | None = None
    pred_a: float | None = None
    pred_a_successful: float | None = None
    pred_a_bound: float | None = None
    ece: float | None = None
    brier: float | None = None
    intervals: dict[str, Any]
    by_images: list[dict[str, float | None]] = []
    baselines: dict[str, dict[str, float | None]] = {}
    persistence: dict[str, Any] | None = None
    dataset: dict[str, Any]
    seed: int | None = None
    command: str = ""


class _Row1(Lenient):
    commands: list[str] = []
    training: dict[str, Any] | None = None
    untrained: str | None = None
    config: InteractResult | None = Field(None, alias="novel-config")
    object: InteractResult | None = Field(None, alias="novel-object")


class _Split2(Lenient):
    mean: dict[str, float | None]
    least: dict[str, float | None]
    most: dict[str, float | None]
    seeds: list[ReasonResult] = Field(min_length=1)


class _Row2(Lenient):
    commands: list[str] = []
    training: list[dict[str, Any]] = []
    splits: dict[str, _Split2] = {}


class _Success(Lenient):
    success: float | None
    seeds: list[float] = []
    interval: tuple[float, float] | None = None


class _Row3(Lenient):
    commands: list[str] = []
    training: list[dict[str, Any]] = []
    splits: dict[str, dict[str, _Success]] = {}


Ends = tuple[float | None, float | None] | None


@dataclass(frozen=True)
class Cell:
    """One number of a table, percent.

    Attributes:
        value: over all boards; the mean if there are several seeds.
        low: end of the 95 % interval over boards, or the least seed.
        high: the other end.
        bound: what the recordings determine at all, if that limits this number.
        several: the value is a mean over seeds, of which low and high are the least and the greatest.
    """

    value: float
    low: float | None = None
    high: float | None = None
    bound: float | None = None
    several: bool = False


@dataclass
class RowFound:
    """A row that was run.

    Attributes:
        cells: by (split, key); what is undefined is None.
        note: why there is no number.
        trainings: provenance as told by the training; empty if nothing was trained.
        judged: origin of the boards by split.
        results: by split the first seed's whole result, for curves.
    """

    cells: dict[tuple[str, str], Cell | None] = field(default_factory=dict)
    note: str | None = None
    commands: list[str] = field(default_factory=list)
    trainings: list[dict[str, Any]] = field(default_factory=list)
    judged: dict[str, dict[str, Any]] = field(default_factory=dict)
    results: dict[str, InteractResult | ReasonResult] = field(default_factory=dict)


@dataclass
class Results:
    """All that was given.

    Attributes:
        tables: rows by name, by the table's number.
        about: assets, machine and commands of each table's file as a whole.
        singles: single evaluations of acting and reasoning by file.
        plans: those of planning.
        robustness, stages: the last ones given.
        pictures: in the order in which they were given.
        files: SHA-256 of every file that was read.
    """

    tables: dict[int, dict[str, RowFound]] = field(default_factory=dict)
    about: dict[int, dict[str, Any]] = field(default_factory=dict)
    singles: dict[str, InteractResult | ReasonResult] = field(default_factory=dict)
    plans: dict[str, PlanResult] = field(default_factory=dict)
    robustness: Robustness | None = None
    stages: Stages | None = None
    pictures: list[Path] = field(default_factory=list)
    files: dict[str, str] = field(default_factory=dict)


def read_results(paths: Iterable[Path]) -> Results:
    """Read files, and all results and pictures in folders; other files in folders are passed over.

    Raises:
        BusybotError: a path does not exist, a named file is no result, or one is damaged.
    """
    results = Results()
    for path in paths:
        if path.is_dir():
            for name in scan(path).files:
                _read(results, path / name, named=False)
        else:
            _read(results, path, named=True)
    return results


def _read(results: Results, file: Path, named: bool) -> None:
    if file.suffix.lower() in PICTURES:
        if len(results.pictures) < MOST_PICTURES:
            results.pictures.append(file)
            results.files[str(file)] = sha256_of(file)
        return
    if file.suffix != ".json" and not named:
        return
    value = read_json(file)
    try:
        known = _take(results, file, value)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise BusybotError(f"{file}: {place}: {first['msg']}", "make the result again") from None
    if known:
        results.files[str(file)] = sha256_of(file)
    elif named:
        what = f"{file}: it is no result that a report shows"
        raise BusybotError(what, "give files of `busybot eval ... --out`, of benchmarks/, or folders of them")


def _take(results: Results, file: Path, value: Any) -> bool:
    """Sort a file's content in; False if it is none of the known kinds."""
    if not isinstance(value, dict):
        return False
    if other := other_kind(value):
        _put_other(results, file, other.model_validate(value))
        return True
    if isinstance(rows := value.get("rows"), dict) and all(isinstance(row, dict) for row in rows.values()):
        number = _number(rows)
        if number is None:
            return False
        read = (_row1, _row2, _row3)[number - 1]
        results.tables.setdefault(number, {}).update({name: read(row) for name, row in rows.items()})
        results.about[number] = about(value)
        return True
    for kind, key in ((ReasonResult, "edge_p"), (InteractResult, "precision_exploring")):
        if key in value and "dataset" in value:
            results.singles[str(file)] = kind.model_validate(value)
            return True
    return False


def _put_other(results: Results, file: Path, value: Other) -> None:
    if isinstance(value, PlanResult):
        results.plans[str(file)] = value
    elif isinstance(value, Robustness):
        results.robustness = value
    else:
        results.stages = value


def _number(rows: dict[str, Any]) -> int | None:
    """Which table has such rows."""
    for row in rows.values():
        if not isinstance(row.get("splits"), dict):
            return 1 if {"novel-config", "novel-object", "untrained"} & row.keys() else None
        for split in row["splits"].values():
            return 3 if isinstance(split, dict) and set(PLANNING.keys) & split.keys() else 2
    return None


def _row1(value: dict[str, Any]) -> RowFound:
    row = _Row1.model_validate(value)
    found = RowFound(commands=row.commands, trainings=[row.training] if row.training else [], note=row.untrained)
    for split, result in (("novel-config", row.config), ("novel-object", row.object)):
        if result is not None:
            _put(found, split, result, TABLES[0])
    return found


def _put(found: RowFound, split: str, result: InteractResult, table: Table) -> None:
    for key in table.keys:
        found.cells[split, key] = cell_of(result, key)
    found.judged[split], found.results[split] = result.dataset, result


def cell_of(result: InteractResult | ReasonResult, key: str) -> Cell | None:
    """A number of a single evaluation with its interval over boards; None if it is undefined."""
    share, interval = getattr(result, key), result.intervals.get(INTERVALS.get(key, key))
    return cell(share, interval, _bound(result, key))


INTERVALS = {"edge_p": "precision", "edge_r": "recall"}
"""Names of intervals that differ from those of the values."""


def cell(share: float | None, ends: Ends = None, bound: float | None = None, several: bool = False) -> Cell | None:
    """A cell from shares, None without a value."""
    if share is None:
        return None
    low, high, most = (None if x is None else 100 * x for x in (*(ends or (None, None)), bound))
    return Cell(100 * share, low, high, most, several)


def _bound(result: Any, key: str) -> float | None:
    return getattr(result, BOUND_SLACK[key][0], None) if key in BOUND_SLACK else None


def _row2(value: dict[str, Any]) -> RowFound:
    row = _Row2.model_validate(value)
    found = RowFound(commands=row.commands, trainings=list(map(training_of, row.training)))
    for split, judged in row.splits.items():
        first = judged.seeds[0]
        for key in TABLES[1].keys:
            ends = (judged.least.get(key), judged.most.get(key))
            mean = cell(judged.mean.get(key), ends, _bound(first, key), several=True)
            found.cells[split, key] = mean if len(judged.seeds) > 1 else cell_of(first, key)
        found.judged[split], found.results[split] = first.dataset, first
    return found


def _row3(value: dict[str, Any]) -> RowFound:
    row = _Row3.model_validate(value)
    found = RowFound(commands=row.commands, trainings=list(map(training_of, row.training)))
    for split, kinds in row.splits.items():
        for kind, told in kinds.items():
            several = len(told.seeds) > 1  # the interval is the first one's
            ends = (min(told.seeds), max(told.seeds)) if several else told.interval
            found.cells[split, kind] = cell(told.success, ends, several=several)
    return found
