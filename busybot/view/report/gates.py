"""Verdicts on gates: reached, missed and by how much, or not measured."""

from collections.abc import Sequence
from dataclasses import dataclass

from busybot.evaluation.reference_tables import BOUND_SLACK, TABLES, ReferenceRow, Table
from busybot.view.report.page import Block, Entry, Grid, Items, Text, Tiles, Tone, number
from busybot.view.report.results import Results, Score

OTHER_OBJECTS = (
    "**Procedural objects**: the gates and the paper's numbers are those of the paper's 58 objects. Beside others they "
    "only say where one stands."
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
    """All gates of all tables, in the tables' order."""
    found = []
    for table, row, run in results.rows():
        for split, key in table.columns():
            verdict = judge(table, row, split, key, None if run is None else run.cells.get((split, key)))
            if verdict is not None:
                found.append(verdict)
    return found


def summary_tiles(verdicts: Sequence[Verdict], results: Results) -> Tiles:
    """How many gates are reached, missed, and not measured; how many rows were run."""
    reached, missed, unknown = (sum(one.reached is state for one in verdicts) for state in (True, False, None))
    runs = [run for _, _, run in results.rows()]
    tiles: list[tuple[str, str, Tone]] = [
        (str(reached), "gates reached", "reached"),
        (str(missed), "gates missed, [named below](#gates-that-are-missed)", "missed" if missed else "reached"),
        (str(unknown), "gates without a measurement", "missing"),
        (f"{len(runs) - runs.count(None)} / {len(runs)}", "rows of the three tables were run", ""),
    ]
    return Tiles(tuple(tiles))


def gate_blocks(verdicts: Sequence[Verdict], results: Results) -> list[Block]:
    """Every missed gate with how much it is missed by; then what was not measured, rows without a gate included."""
    missed = [one for one in verdicts if one.reached is False]
    bounded = [one for one in verdicts if one.by_bound]
    made_up = any(about.get("assets") == "procedural" for about in results.about.values())
    blocks: list[Block] = [Text(OTHER_OBJECTS)] if made_up else []
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


def _without_gate(results: Results) -> list[str]:
    """For every table which of its rows without a gate were measured, in part or not at all."""
    lines = []
    for table in TABLES:
        told: dict[str, list[str]] = {"measured": [], "measured in part": [], "**missing**": []}
        for row in (row for row in table.rows if row.gate is None):
            found = results.row(table, row.name)
            columns = 0 if found is None else len(found.cells)
            part = "measured in part" if columns else "**missing**"
            note = f" ({found.note})" if found is not None and found.note else ""  # nothing to measure
            told["measured" if note or columns == len(table.columns()) else part].append(row.words + note)
        lines += [f"Table {table.number}, {state}: {'; '.join(rows)}" for state, rows in told.items() if rows]
    return lines


def _place(one: Verdict) -> str:
    return f"Table {one.table.number}, {one.row.words}, {one.table.splits[one.split]}: {one.table.keys[one.key]}"


def _missed(one: Verdict) -> tuple[Entry, ...]:
    assert one.score is not None and one.worst is not None
    measured = Entry(number(one.score.value), one.score.spread, "missed")
    return (measured, Entry(f"{one.gate:g}"), Entry(number(one.gate - one.worst)), Entry(_bound(one.score)))


def _bound(score: Score) -> str:
    return "" if score.bound is None else number(score.bound)
