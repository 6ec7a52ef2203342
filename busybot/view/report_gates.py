"""Which gates of the protocol are reached, missed, or not measured yet."""

from dataclasses import dataclass

from busybot.view.protocol import BOUND_SLACK, TABLES, Row, Table
from busybot.view.report_read import Cell, Results


@dataclass(frozen=True)
class Verdict:
    """One gate.

    Attributes:
        gate: percent that has to be reached.
        cell: what was measured; None if nothing was.
        worst: the value that was compared: the least of several seeds.
        reached: None if nothing was measured.
        by_bound: reached only because the recordings do not determine more.
    """

    table: Table
    row: Row
    split: str
    key: str
    gate: float
    cell: Cell | None = None
    worst: float | None = None
    reached: bool | None = None
    by_bound: bool = False


def judge(table: Table, row: Row, split: str, key: str, cell: Cell | None) -> Verdict | None:
    """Compare a number, or the worst of several seeds, with its gate; None if there is no gate for it."""
    gate = None if row.gate is None else table.at(table.gates[row.gate], split, key)
    if gate is None:
        return None
    if cell is None:
        return Verdict(table, row, split, key, gate)
    worst = cell.low if cell.several and cell.low is not None else cell.value
    slack = BOUND_SLACK.get(key)
    enough = round(worst, 6) >= gate  # shares times 100 are not exact
    near = slack is not None and cell.bound is not None and round(worst - cell.bound + slack[1], 6) >= 0
    return Verdict(table, row, split, key, gate, cell, worst, enough or near, near and not enough)


def verdicts(results: Results) -> list[Verdict]:
    """All gates of all tables, in the tables' order."""
    found = []
    for table in TABLES:
        rows = results.tables.get(table.number, {})
        for row in table.rows:
            told = rows.get(row.name)
            for split, key in table.columns():
                measured = None if told is None else told.cells.get((split, key))
                verdict = judge(table, row, split, key, measured)
                if verdict is not None:
                    found.append(verdict)
    return found
