"""Result files, read for a report by the kind that they name (`busybot.evaluation.results`).

Files hold shares from 0 to 1; the cells of tables are percent.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, ValidationError, field_validator, model_validator

from busybot.common.atomic_io import read_json, regular_files, sha256_of
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import first_fault
from busybot.common.text import unlinked
from busybot.evaluation.reference_tables import BOUND_SLACK, TABLES, ReferenceRow, Table
from busybot.evaluation.results import KINDS, read_result
from busybot.evaluation.statistics import Interval, widest
from busybot.training.model_cards import rounds_of
from busybot.view.report.page import number, spread
from busybot.view.report.world_results import Count, Evaluation, OnBoards, ResultFile, WorldResults, told_apart

PICTURES = (".png", ".jpg", ".jpeg")
SHOWN = (
    *("interact", "reason", "plan", "play", "table1", "table2", "table3", "worlds", "curiosity"),
    *("world-gates", "world-plans", "reason-robustness", "stages"),
)
"""Kinds that a report shows."""
TRIAL = "smoke"
"""The profile that only tries whether everything runs."""
MOST_PICTURES = 24
"""Of all given folders together: a report is one file."""


def _without_level(told: Any) -> Any:
    """Intervals alone, without how much lies within them."""
    return {name: one for name, one in told.items() if name != "level"} if isinstance(told, dict) else told


Intervals = Annotated[dict[str, Interval], BeforeValidator(_without_level)]


class InteractResult(Evaluation):
    """Of `busybot eval interact`."""

    precision: float | None
    recall: float | None
    precision_exploring: float | None = None
    boards: int
    policy: str = ""
    strict: bool = False
    intervals: Intervals
    object_intervals: Intervals = {}
    by_step: list[dict[str, float | None]] = []
    by_board: dict[str, OnBoards] = {}


class _AfterImages(ResultFile):
    """Scores after so many images."""

    images: Count
    edge_p: float | None
    edge_r: float | None
    edge_r_bound: float | None
    pred_a: float | None
    pred_a_bound: float | None


class _Calibration(ResultFile):
    """How far beliefs in pairs are off: of those that are doubted, and how many that is."""

    ece_uncertain: float | None
    pairs_uncertain: int


class ReasonResult(Evaluation):
    """Of `busybot eval reason`."""

    model: str | None = None
    boards: int
    edge_p: float | None
    edge_r: float | None
    edge_r_bound: float | None = None
    pred_a: float | None = None
    pred_a_successful: float | None = None
    pred_a_bound: float | None = None
    bounds: dict[str, dict[str, float | None] | None] | None = None
    brier: float | None = None
    calibration: _Calibration | None = None
    intervals: Intervals
    object_intervals: Intervals = {}
    by_images: list[_AfterImages] = []
    by_board: dict[str, OnBoards] = {}
    baselines: dict[str, dict[str, float | None]] = {}
    persistence: dict[str, Any] | None = None


class AgentScores(ResultFile):
    """One agent on the tasks of a dataset; in a table the success of several seeds."""

    success: float | None
    interval: tuple[float, float] | None = None
    object_interval: tuple[float, float] | None = None
    solved: float | None = None
    steps: float | None = None
    seeds: list[float] = []


class PlanResult(Evaluation):
    """Of `busybot eval plan`; `kinds` has the number of tasks by the kind of their relations."""

    agents: dict[str, AgentScores]
    kinds: dict[str, int]
    tasks: int


class _Cost(ResultFile):
    seconds: float
    megabytes: float | None = None


class _Training(ResultFile):
    """What a training tells of itself, of a learned agent more; Table 2 keeps its cost beside that."""

    seed: int | None = None
    rounds: list[dict[str, Any]] = []
    data: list[dict[str, Any]] = []
    versions: dict[str, Any] | None = None
    cost: _Cost | None = None

    @model_validator(mode="before")
    @classmethod
    def _with_cost(cls, value: Any) -> Any:
        told = value.get("training") if isinstance(value, dict) else None
        return {**told, "cost": value.get("cost")} if isinstance(told, dict) else value

    @field_validator("rounds", mode="before")
    @classmethod
    def _one_by_one(cls, value: Any) -> Any:
        return rounds_of(value)


class _Row(ResultFile):
    """A row of a table, with its commands and trainings."""

    commands: list[str] = []
    training: list[_Training] = []

    @field_validator("training", mode="before")
    @classmethod
    def _as_list(cls, value: Any) -> Any:
        return value if isinstance(value, list) else [value] if value else []

    @property
    def trainings(self) -> list[dict[str, Any]]:
        return [one.model_dump() for one in self.training]


class _TableFile(ResultFile):
    """What a table's file tells of itself, beside its rows."""

    rows: dict[str, Any] | None = None
    assets: str | None = None
    machine: dict[str, Any] | None = None
    commands: list[str] | None = None
    profile: str | None = None


class _InteractRow(_Row):
    untrained: str | None = None
    config: InteractResult | None = Field(None, alias="novel-config")
    object: InteractResult | None = Field(None, alias="novel-object")


class _Seeds(ResultFile):
    """One split of Table 2: scores over seeds."""

    mean: dict[str, float | None]
    least: dict[str, float | None]
    most: dict[str, float | None]
    seeds: list[ReasonResult] = Field(min_length=1)


class _ReasonRow(_Row):
    splits: dict[str, _Seeds] = {}


class _PlanRow(_Row):
    splits: dict[str, dict[str, AgentScores]] = {}


class _Scores(ResultFile):
    edge_p: float | None = None
    edge_r: float | None = None
    edge_f1: float | None
    pred_a: float | None = None


class _Disturbed(ResultFile):
    """One strength of a disturbance: scores by model, and the share of steps that could be known in spite of it."""

    strength: float
    boards: int
    known: float
    models: dict[str, _Scores]


class _Disturbance(ResultFile):
    """What is done to recordings; older files have no title."""

    what: str
    unit: str
    title: str = ""


class _Robustness(ResultFile):
    """Of `benchmarks.studies.reason_robustness`: trained models, and rows by disturbance in growing strength."""

    boards: int
    models: dict[str, Any]
    disturbances: dict[str, _Disturbance]
    rows: dict[str, list[_Disturbed]]


class Stage(ResultFile):
    """One stage of a pipeline."""

    seconds: float
    done: bool


class Stages(ResultFile):
    """What the stages of a run took, by their output."""

    machine: dict[str, Any] | None = None
    stages: dict[str, Stage]


@dataclass(frozen=True)
class Score:
    """One number of a table, percent.

    Attributes:
        value: over all boards; the mean if there are several seeds.
        low: end of the 95 % interval over boards, or the least seed.
        high: the other end.
        bound: what the recordings determine at all, if that limits this number.
        several: the value is a mean over seeds, of which low and high are the least and the greatest.
        objects: ends of the 95 % interval over objects and their boards; of several seeds the widest ends.
    """

    value: float
    low: float | None = None
    high: float | None = None
    bound: float | None = None
    several: bool = False
    objects: tuple[float, float] | None = None

    @property
    def spread(self) -> str:
        """As tables show it behind the value; the interval over objects stands in square brackets."""
        around = spread(self.value, self.low, self.high, self.several)
        over_objects = f"[{number(self.objects[0])}-{number(self.objects[1])}]" if self.objects else ""
        return " ".join(filter(None, (around, over_objects)))


@dataclass
class RowFound:
    """A row that was run.

    Attributes:
        cells: by (split, key); what is undefined is None.
        note: why there is no number.
        trainings: provenance as told by the training; empty if nothing was trained.
        results: by split the first seed's whole result, for curves.
    """

    cells: dict[tuple[str, str], Score | None] = field(default_factory=dict)
    note: str | None = None
    commands: list[str] = field(default_factory=list)
    trainings: list[dict[str, Any]] = field(default_factory=list)
    results: dict[str, InteractResult | ReasonResult] = field(default_factory=dict)


@dataclass(frozen=True)
class TableFile:
    """What one file tells of one of the tables.

    Attributes:
        name: the file's, as short as tells it from all others of tables.
        rows: by name.
        about: assets, machine, commands and profile of the file as a whole.
    """

    table: Table
    name: str
    rows: dict[str, RowFound]
    about: dict[str, Any]

    @property
    def trial(self) -> bool:
        """Whether its numbers mean nothing."""
        return self.about.get("profile") == TRIAL

    @property
    def own(self) -> tuple[ReferenceRow, ...]:
        """The table's rows that it has."""
        return tuple(row for row in self.table.rows if row.name in self.rows)


@dataclass(frozen=True)
class Run:
    """A row of a table as one file tells it.

    Attributes:
        found: None if no file has it.
        file: the file's name, empty where no other file of this table was given.
    """

    table: Table
    row: ReferenceRow
    found: RowFound | None = None
    file: str = ""

    @property
    def words(self) -> str:
        """For people: which row, and where several files may have it, whose."""
        return of_file(self.row.words, self.file)


def of_file(words: str, file: str) -> str:
    """Words with the file that they are about, if it has a name."""
    return f"{words}, `{file}`" if file else words


@dataclass
class Results:
    """All that was given.

    Attributes:
        table_files: files of tables by path: each tells its rows of its own objects, machine and profile.
        singles: single evaluations of acting and reasoning by file.
        plans: those of planning.
        worlds: all of other worlds than the paper's.
        robustness, stages: by file.
        pictures: in the order in which they were given.
        files: SHA-256 of every file that was read.
        without_kind: JSON files in folders that say no kind: they were passed over.
    """

    table_files: dict[str, TableFile] = field(default_factory=dict)
    singles: dict[str, InteractResult | ReasonResult] = field(default_factory=dict)
    plans: dict[str, PlanResult] = field(default_factory=dict)
    worlds: WorldResults = field(default_factory=WorldResults)
    robustness: dict[str, dict[str, Any]] = field(default_factory=dict)
    stages: dict[str, Stages] = field(default_factory=dict)
    pictures: list[Path] = field(default_factory=list)
    files: dict[str, str] = field(default_factory=dict)
    without_kind: int = 0

    @property
    def trial(self) -> bool:
        """Whether all numbers here are of the profile `smoke`."""
        others = (self.singles, self.plans, self.worlds, self.robustness)
        files = self.table_files.values()
        return bool(files) and all(file.trial for file in files) and not any(others)

    def of_table(self, table: Table) -> list[TableFile]:
        """Files that have rows of a table, those that have most first, trials last: not as they were given."""
        found = [file for file in self.table_files.values() if file.table.number == table.number and file.own]
        return sorted(found, key=lambda file: (file.trial, -len(file.own)))

    def runs(self, table: Table, row: ReferenceRow) -> list[Run]:
        """A row as each file tells it whose numbers mean something; in a trial as all do."""
        files = self.of_table(table)
        told = [file for file in files if row.name in file.rows and (self.trial or not file.trial)]
        return [Run(table, row, file.rows[row.name], file.name if len(files) > 1 else "") for file in told]

    def rows(self) -> Iterator[Run]:
        """The runs of all rows of all tables, in the tables' order; of a row that was not run that it was not."""
        for table in TABLES:
            for row in table.rows:
                yield from self.runs(table, row) or [Run(table, row)]


def read_results(paths: Iterable[Path], drawn: Path | None = None) -> Results:
    """Read files, and all results and pictures in folders; other files in folders are passed over.

    Args:
        drawn: the folder with an earlier report's own pictures, which is passed over, too.

    Raises:
        BusybotError: a path does not exist, a named file is no result that a report shows, or one is damaged.
    """
    results = Results()
    for path in paths:
        if path.is_dir():
            for file in regular_files(path, lambda name: Path(name).suffix.lower() in (*PICTURES, ".json")):
                if drawn is None or not file.resolve().is_relative_to(drawn.resolve()):
                    _read(results, file, named=False)
        else:
            _read(results, path, named=True)
    names = told_apart(results.table_files)
    results.table_files = {path: replace(file, name=names[path]) for path, file in results.table_files.items()}
    return results


def _read(results: Results, file: Path, named: bool) -> None:
    if file.suffix.lower() in PICTURES:
        if len(results.pictures) < MOST_PICTURES:
            results.pictures.append(file)
            results.files[str(file)] = sha256_of(file)
        return
    if not named and not _says_kind(results, file):
        return
    value: Any = unlinked(read_result(file))
    try:
        shown = _take(results, file, value)
    except ValidationError as error:
        raise BusybotError(f"{file}: {first_fault(error)}", "make the result again") from None
    if shown:
        results.files[str(file)] = sha256_of(file)
    elif named:
        what = f"{file}: a report does not show results of the kind {value['kind']}"
        raise BusybotError(what, f"it shows {', '.join(SHOWN)}")


def _says_kind(results: Results, file: Path) -> bool:
    if file.suffix != ".json":
        return False
    value = read_json(file)
    known = isinstance(value, dict) and isinstance(value.get("kind"), str) and value["kind"] in KINDS
    results.without_kind += not known
    return known


def _take(results: Results, file: Path, value: dict[str, Any]) -> bool:
    """Sort a file's content in by its kind; False if it is none of `SHOWN`."""
    if results.worlds.take(str(file), value):
        return True
    match value["kind"]:
        case "interact":
            results.singles[str(file)] = InteractResult.model_validate(value)
        case "reason":
            results.singles[str(file)] = ReasonResult.model_validate(value)
        case "plan":
            results.plans[str(file)] = PlanResult.model_validate(value)
        case "reason-robustness":
            results.robustness[str(file)] = _Robustness.model_validate(value).model_dump()
        case "stages":
            results.stages[str(file)] = Stages.model_validate(value)
        case "table1" | "table2" | "table3" as kind:
            number, told = int(kind.removeprefix("table")), _TableFile.model_validate(value)
            about = told.model_dump(include={"assets", "machine", "commands", "profile"})
            rows = rows_of(number, told.rows or {})
            results.table_files[str(file)] = TableFile(TABLES[number - 1], file.name, rows, about)
        case _:
            return False
    return True


def rows_of(number: int, rows: dict[str, Any]) -> dict[str, RowFound]:
    """Rows of a table's file, or of one with rows alike, by name.

    Raises:
        pydantic.ValidationError: a row is not what rows of this table are.
    """
    read = {1: _interact_row, 2: _reason_row, 3: _plan_row}[number]
    return {name: read(row, TABLES[number - 1]) for name, row in rows.items()}


def _interact_row(value: dict[str, Any], table: Table) -> RowFound:
    row = _InteractRow.model_validate(value)
    found = RowFound(commands=row.commands, trainings=row.trainings, note=row.untrained)
    for split, result in (("novel-config", row.config), ("novel-object", row.object)):
        if result is not None:
            found.cells |= {(split, key): score_of(result, key) for key in table.keys}
            found.results[split] = result
    return found


def _reason_row(value: dict[str, Any], table: Table) -> RowFound:
    row = _ReasonRow.model_validate(value)
    found = RowFound(commands=row.commands, trainings=row.trainings)
    for split, judged in row.splits.items():
        first = judged.seeds[0]
        for key in table.keys:
            ends = (judged.least.get(key), judged.most.get(key))
            mean = score(judged.mean.get(key), ends, _bound(first, key), several=True)
            over_objects = widest(seed.object_intervals.get(INTERVALS.get(key, key)) for seed in judged.seeds)
            mean = _over_objects(mean, over_objects)
            found.cells[split, key] = mean if len(judged.seeds) > 1 else score_of(first, key)
        found.results[split] = first
    return found


def _plan_row(value: dict[str, Any], table: Table) -> RowFound:
    row = _PlanRow.model_validate(value)
    found = RowFound(commands=row.commands, trainings=row.trainings)
    for split, kinds in row.splits.items():
        for kind, told in kinds.items():
            several = len(told.seeds) > 1  # the interval is the first one's
            ends = (min(told.seeds), max(told.seeds)) if several else told.interval
            found.cells[split, kind] = _over_objects(score(told.success, ends, several=several), told.object_interval)
    return found


INTERVALS = {"edge_p": "precision", "edge_r": "recall"}
"""Names of intervals that differ from those of the values."""


def score_of(result: InteractResult | ReasonResult, key: str) -> Score | None:
    """A number of a single evaluation with its intervals; None if it is undefined."""
    name = INTERVALS.get(key, key)
    told = score(getattr(result, key), result.intervals.get(name), _bound(result, key))
    return _over_objects(told, result.object_intervals.get(name))


def _over_objects(told: Score | None, ends: Sequence[float] | None) -> Score | None:
    return told if told is None or ends is None else replace(told, objects=(100 * ends[0], 100 * ends[1]))


def score(
    share: float | None,
    ends: tuple[float | None, float | None] | None = None,
    bound: float | None = None,
    several: bool = False,
) -> Score | None:
    """Percent from shares, None without a value."""
    if share is None:
        return None
    low, high, most = (None if x is None else 100 * x for x in (*(ends or (None, None)), bound))
    return Score(100 * share, low, high, most, several)


def _bound(result: InteractResult | ReasonResult, key: str) -> float | None:
    """What the recordings determine of a number, as far as the result tells it."""
    if not isinstance(result, ReasonResult):
        return None
    if key in BOUND_SLACK:
        return getattr(result, BOUND_SLACK[key][0])
    return ((result.bounds or {}).get("not_knowing") or {}).get(key)
