"""Verdicts on gates: reached, missed and by how much, or not measured."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from busybot.evaluation.reference_tables import BOUND_SLACK, TABLES, ReferenceRow, Table
from busybot.view.report.page import Block, Entry, Grid, Items, Text, Tiles, Tone, number
from busybot.view.report.results import Results, RowFound, Score, of_file

OTHER_OBJECTS = (
    "**Procedural objects**{of}: the gates and the paper's numbers are those of the paper's 58 objects. Beside others "
    "they only say where one stands."
)
MEASURED = (
    "Measured: over all boards with half the width of the 95 % interval over boards, or the mean of several seeds with "
    "the extremes. A gate is for every seed. The bound is what the recordings determine at all."
)
BOUNDED = "Reached only because the recordings do not determine more (which counts as reached):"


@dataclass(frozen=True)
class Verdict:
    """One gate.

    Attributes:
        gate: percent that has to be reached.
        score: what was measured; None if nothing was.
        worst: the value that was compared: the least of several seeds.
        reached: None if nothing was measured.
        by_bound: reached only because the recordings do not determine more.
        file: who says so, where several files of the table were given.
    """

    table: Table
    row: ReferenceRow
    split: str
    key: str
    gate: float
    score: Score | None = None
    worst: float | None = None
    reached: bool | None = None
    by_bound: bool = False
    file: str = ""


def judge(table: Table, row: ReferenceRow, split: str, key: str, score: Score | None) -> Verdict | None:
    """Compare a number, or the worst of several seeds, with its gate; None if there is no gate for it."""
    gate = None if row.gate is None else table.at(table.gates[row.gate], split, key)
    if gate is None:
        return None
    if score is None:
        return Verdict(table, row, split, key, gate)
    worst = score.low if score.several and score.low is not None else score.value
    slack = BOUND_SLACK.get(key)
    enough = round(worst, 6) >= gate  # shares times 100 are not exact
    near = slack is not None and score.bound is not None and round(worst - score.bound + slack[1], 6) >= 0
    return Verdict(table, row, split, key, gate, score, worst, enough or near, near and not enough)


def verdicts(results: Results) -> list[Verdict]:
    """All gates of all tables, in the tables' order, each of every file that measured it."""
    found: list[Verdict] = []
    for table in TABLES:
        for row in table.rows:
            runs = [(run.file, run.found) for run in results.runs(table, row) if run.found] or [("", RowFound())]
            for split, key in table.columns():
                told = [(file, judge(table, row, split, key, one.cells.get((split, key)))) for file, one in runs]
                judged = [replace(verdict, file=file) for file, verdict in told if verdict]
                found += [one for one in judged if one.reached is not None] or judged[:1]
    return found


def count_gates(verdicts: Iterable[Verdict], reached: bool | None) -> int:
    """Gates that are reached, missed (False) or not measured (None); what one file misses, others do not make good."""
    told: dict[tuple[object, ...], list[bool | None]] = {}
    for one in verdicts:
        told.setdefault((one.table.number, one.row.name, one.split, one.key), []).append(one.reached)
    states = [None if None in several else all(several) for several in told.values()]
    return states.count(reached)


def summary_tiles(verdicts: Sequence[Verdict], results: Results) -> Tiles:
    """How many gates are reached, missed, and not measured; how many rows were run."""
    reached, missed, unknown = (count_gates(verdicts, state) for state in (True, False, None))
    run = {(one.table.number, one.row.name) for one in results.rows() if one.found}
    rows = sum(len(table.rows) for table in TABLES)
    tiles: list[tuple[str, str, Tone]] = [
        (str(reached), "gates reached", "reached"),
        (str(missed), "gates missed, [named below](#gates-that-are-missed)", "missed" if missed else "reached"),
        (str(unknown), "gates without a measurement", "missing"),
        (f"{len(run)} / {rows}", "rows of the three tables were run", ""),
    ]
    return Tiles(tuple(tiles))


def gate_blocks(verdicts: Sequence[Verdict], results: Results) -> list[Block]:
    """Every missed gate with how much it is missed by; then what was not measured, rows without a gate included."""
    missed = [one for one in verdicts if one.reached is False]
    bounded = [one for one in verdicts if one.by_bound]
    blocks = _other_objects(results)
    if missed:
        rows = tuple((_place(one), _missed(one)) for one in missed)
        blocks += [Grid((), ("measured", "gate", "short by", "bound"), rows, "percent"), Text(MEASURED)]
    else:
        blocks.append(Text("None of those that were measured."))
    if bounded:
        told = [f"{_place(one)}: {number(one.score.value)}, bound {_bound(one.score)}" for one in bounded if one.score]
        blocks += [Text(BOUNDED), Items(tuple(told))]
    known = {(one.table.number, one.row.words) for one in verdicts if one.reached is not None}
    rows_left = dict.fromkeys((one.table.number, one.row.words) for one in verdicts if one.reached is None)
    unknown = [f"Table {table}: {words}{' (in part)' * ((table, words) in known)}" for table, words in rows_left]
    if unknown:
        blocks += [Text("Not measured, so neither reached nor missed:"), Items(tuple(unknown))]
    rest = Text("Rows that have no gate, but stand beside those that have one:")
    return [*blocks, rest, Items(tuple(_without_gate(results)))]


def _other_objects(results: Results) -> list[Block]:
    """A word on files about procedural objects: which these are, if others are about the paper's."""
    files = [file for table in TABLES for file in results.of_table(table) if results.trial or not file.trial]
    made_up = [file.name for file in files if file.about.get("assets") == "procedural"]
    others = {file.about.get("assets") for file in files} - {"procedural", None}
    of = f" of {', '.join(f'`{name}`' for name in made_up)}" if others else ""
    return [Text(OTHER_OBJECTS.format(of=of))] if made_up else []


def _without_gate(results: Results) -> list[str]:
    """For every table which of its rows without a gate were measured, in part or not at all."""
    lines = []
    for table in TABLES:
        told: dict[str, list[str]] = {"measured": [], "measured in part": [], "**missing**": []}
        for row in (row for row in table.rows if row.gate is None):
            runs = [run.found for run in results.runs(table, row) if run.found]
            found = max(runs, key=lambda one: len(one.cells), default=None)
            columns = 0 if found is None else len(found.cells)
            part = "measured in part" if columns else "**missing**"
            note = f" ({found.note})" if found is not None and found.note else ""  # nothing to measure
            told["measured" if note or columns == len(table.columns()) else part].append(row.words + note)
        lines += [f"Table {table.number}, {state}: {'; '.join(rows)}" for state, rows in told.items() if rows]
    return lines


def _place(one: Verdict) -> str:
    row = of_file(one.row.words, one.file)
    return f"Table {one.table.number}, {row}, {one.table.splits[one.split]}: {one.table.keys[one.key]}"


def _missed(one: Verdict) -> tuple[Entry, ...]:
    assert one.score is not None and one.worst is not None
    measured = Entry(number(one.score.value), one.score.spread, "missed")
    return (measured, Entry(f"{one.gate:g}"), Entry(number(one.gate - one.worst)), Entry(_bound(one.score)))


def _bound(score: Score) -> str:
    return "" if score.bound is None else number(score.bound)
