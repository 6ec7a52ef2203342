"""The parts of a report about Tables 1 to 3: numbers beside the paper's, gates that are missed, provenance."""

from collections.abc import Sequence
from typing import Any

from busybot.view.protocol import REASONING, TABLES, Role, Row, Table
from busybot.view.report_gates import Verdict, judge
from busybot.view.report_page import Block, Entry, Fold, Grid, Items, Text, Tiles, Tone
from busybot.view.report_read import Cell, Results, RowFound

SECTIONS: dict[str, tuple[Role, ...]] = {
    "ours": ("ours",),
    "changed, or another method": ("ablation", "competitor"),
    "trivial, and oracles": ("trivial", "bound"),
}
MISSING = Entry("missing", tone="missing")
NONE = Entry("-", tone="reference")
RUN = {
    1: "python -m benchmarks.table1 --assets DIR --work FOLDER --out table1.json",
    2: "python -m benchmarks.table2 --data FOLDER --work FOLDER --out table2.json",
    3: "python -m benchmarks.table3 --policy-model MODEL --reasoner M0 M1 M2 --work FOLDER --out table3.json",
}
"""What makes the numbers of a table."""
OTHER_OBJECTS = (
    "**Procedural objects**: the gates and the paper's numbers are those of the paper's 58 objects. Beside others they "
    "only say where one stands."
)


def number(value: float) -> str:
    """Percent with one digit."""
    return f"{value:.1f}"


def half_width(low: float, high: float) -> str:
    """Half an interval whose ends are percent; pages and reports round it here, and so alike."""
    return f"± {number((high - low) / 2)}"


def reference(value: float) -> str:
    """A percentage of the paper or of the protocol: one digit, two where it is below 1."""
    return f"{value:g}" if value < 1 else number(value)


def summary_tiles(verdicts: Sequence[Verdict], results: Results) -> Tiles:
    """How many gates are reached, missed, and not measured; how many rows were run."""
    reached, missed, unknown = ([one for one in verdicts if one.reached is state] for state in (True, False, None))
    rows = sum(row.name in results.tables.get(table.number, {}) for table in TABLES for row in table.rows)
    total = sum(len(table.rows) for table in TABLES)
    tiles: list[tuple[str, str, Tone]] = [
        (str(len(reached)), "gates reached", "reached"),
        (str(len(missed)), "gates missed, [named below](#gates-that-are-missed)", "missed" if missed else "reached"),
        (str(len(unknown)), "gates without a measurement", "missing"),
        (f"{rows} / {total}", "rows of the three tables were run", ""),
    ]
    return Tiles(tuple(tiles))


def gate_blocks(verdicts: Sequence[Verdict], results: Results) -> list[Block]:
    """Every missed gate with how much it is missed by; then what was not measured, rows without a gate included."""
    missed = [one for one in verdicts if one.reached is False]
    made_up = any(about.get("assets") == "procedural" for about in results.about.values())
    blocks: list[Block] = [Text(OTHER_OBJECTS)] if made_up else []
    if missed:
        heads = ("measured", "gate", "short by", "bound")
        rows = tuple((_place(one), _missed(one)) for one in missed)
        blocks.append(Grid((), heads, rows, "percent"))
        blocks.append(
            Text(
                "Measured: over all boards with half the width of the 95 % interval over boards, or the mean of "
                "several seeds with the extremes. A gate is for every seed. The bound is what the recordings "
                "determine at all."
            )
        )
    else:
        blocks.append(Text("None of those that were measured."))
    bounded = [one for one in verdicts if one.by_bound]
    if bounded:
        blocks.append(Text("Reached only because the recordings do not determine more (the protocol allows it):"))
        blocks.append(Items(tuple(f"{_place(one)}: {_value(one.cell)}, bound {_bound(one.cell)}" for one in bounded)))
    known = {(one.table.number, one.row.words) for one in verdicts if one.reached is not None}
    rows_left = dict.fromkeys((one.table.number, one.row.words) for one in verdicts if one.reached is None)
    unknown = [f"Table {table}: {words}{' (in part)' * ((table, words) in known)}" for table, words in rows_left]
    if unknown:
        blocks += [Text("Not measured, so neither reached nor missed:"), Items(tuple(unknown))]
    return [
        *blocks,
        Text("Rows that have no gate, but stand beside those that have one:"),
        Items(tuple(_rest(results))),
    ]


def _rest(results: Results) -> list[str]:
    """For every table which of its rows without a gate were measured, in part or not at all."""
    lines = []
    for table in TABLES:
        told: dict[str, list[str]] = {"measured": [], "measured in part": [], "**missing**": []}
        for row in (row for row in table.rows if row.gate is None):
            found = results.tables.get(table.number, {}).get(row.name)
            columns = 0 if found is None else len(found.cells)
            part = "measured in part" if columns else "**missing**"
            note = f" ({found.note})" if found is not None and found.note else ""  # nothing to measure
            told["measured" if note or columns == len(table.columns()) else part].append(row.words + note)
        lines += [f"Table {table.number}, {state}: {'; '.join(rows)}" for state, rows in told.items() if rows]
    return lines


def _place(one: Verdict) -> str:
    return f"Table {one.table.number}, {one.row.words}, {one.table.splits[one.split]}: {one.table.keys[one.key]}"


def _missed(one: Verdict) -> tuple[Entry, ...]:
    assert one.cell is not None and one.worst is not None
    measured = Entry(number(one.cell.value), _spread(one.cell), "missed")
    return (measured, Entry(f"{one.gate:g}"), Entry(number(one.gate - one.worst)), Entry(_bound(one.cell)))


def _bound(cell: Cell | None) -> str:
    return "" if cell is None or cell.bound is None else number(cell.bound)


def _value(cell: Cell | None) -> str:
    return "-" if cell is None else number(cell.value)


def _spread(cell: Cell) -> str:
    if cell.low is None or cell.high is None:
        return ""
    return f"({number(cell.low)} to {number(cell.high)})" if cell.several else half_width(cell.low, cell.high)


def table_grid(table: Table, rows: dict[str, RowFound]) -> Grid:
    """All rows of a table by what they stand for, then bound, gates, aims and the paper's rows."""
    lines: list[tuple[str, tuple[Entry, ...]]] = []
    for words, roles in SECTIONS.items():
        lines.append((words, ()))
        lines += [(row.words, row_entries(table, row, rows.get(row.name))) for row in table.rows if row.role in roles]
    if table is REASONING:
        lines.append(("what the recordings determine", _bounds(table, rows)))
    lines.append(("asked of us", ()))
    for kind, values in (("gate", table.gates), ("aim", table.aims)):
        for name, percents in values.items():
            lines.append((f"{kind}: {name}", tuple(_reference(value) for value in percents)))
    lines.append(("the paper", ()))
    lines += [(name, tuple(_reference(value) for value in values)) for name, values in table.paper.items()]
    groups = tuple((words, len(table.keys)) for words in table.splits.values())
    return Grid(groups, tuple(table.keys.values()) * len(table.splits), tuple(lines), "percent")


def row_entries(table: Table, row: Row, found: RowFound | None) -> tuple[Entry, ...]:
    """The cells of a row: numbers with their spread, marked where there is a gate."""
    if found is None:
        return (MISSING,) * len(table.columns())
    entries = []
    for split, key in table.columns():
        cell = found.cells.get((split, key))
        if (split, key) not in found.cells:
            entries.append(Entry(found.note or "missing", tone="missing"))
        elif cell is None:
            entries.append(NONE)
        else:
            verdict = judge(table, row, split, key, cell)
            tone: Tone = "" if verdict is None else "reached" if verdict.reached else "missed"
            entries.append(Entry(number(cell.value), _spread(cell), tone))
    return tuple(entries)


def _reference(value: float | None) -> Entry:
    return Entry("" if value is None else reference(value), tone="reference")


def _bounds(table: Table, rows: dict[str, RowFound]) -> tuple[Entry, ...]:
    entries = []
    for column in table.columns():
        cells = [rows[row.name].cells.get(column) for row in table.rows if row.name in rows and row.role == "ours"]
        known = [cell.bound for cell in cells if cell is not None and cell.bound is not None]
        entries.append(Entry(number(known[0]) if known else "", tone="reference"))
    return tuple(entries)


def provenance(table: Table, results: Results) -> Fold:
    """Commands, seeds, hashes and versions of every row that was run."""
    about = results.about.get(table.number, {})
    machine = ", ".join(f"{key} {value}" for key, value in about.get("machine", {}).items())
    blocks: list[Block] = []
    where = [f"{name}: {value}." for name, value in (("Objects", about.get("assets")), ("Machine", machine)) if value]
    if where:
        blocks.append(Text(" ".join(where)))
    if about.get("commands"):
        blocks += [Text("all rows"), Items(tuple(f"`{command}`" for command in about["commands"]))]
    seen: dict[tuple[str, ...], str] = {}
    for row in table.rows:
        found = results.tables.get(table.number, {}).get(row.name)
        if found is None:
            continue
        first = seen.setdefault(tuple(found.commands), row.words)
        commands = [f"`{command}`" for command in found.commands]
        if commands and first != row.words:
            commands = [f"commands as for {first}"]
        if lines := [*commands, *_origins(found)]:
            blocks += [Text(row.words), Items(tuple(lines))]
    return Fold("Commands, seeds, hashes, versions", tuple(blocks))


def _origins(found: RowFound) -> list[str]:
    """Trainings and boards of a row, as far as they were recorded."""
    lines = []
    for training in found.trainings:
        data = [*training.get("rounds", []), *training.get("data", [])]
        hashes = ", ".join(f"`{str(entry['content_hash'])[:16]}`" for entry in data if entry.get("content_hash"))
        seed = "" if training.get("seed") is None else f"seed {training['seed']}"
        told = ", ".join(filter(None, (seed, hashes and f"content of its data {hashes}")))
        lines += [f"training: {told}"] if told else []
        lines += [f"made with {versions(training['versions'])}"] if training.get("versions") else []
    for split, origin in found.judged.items():
        lines.append(f"judged, {split}: {dataset(origin)}")
    return lines


def versions(values: dict[str, Any]) -> str:
    """Package versions in a line."""
    return ", ".join(f"{name} {value}" for name, value in values.items()) or "not recorded"


def dataset(origin: dict[str, Any]) -> str:
    """Which boards, in a line."""
    hashes = [f"{key.replace('_', ' ')} `{str(origin[key])[:16]}`" for key in HASHES if origin.get(key)]
    seed = f", seed {origin['seed']}" if origin.get("seed") is not None else ""
    boards = "" if origin.get("boards") is None else f"{origin['boards']} boards{seed}"
    return ", ".join(filter(None, (boards, *hashes)))


HASHES = ("board_hash", "trace_hash", "content_hash")


def cost_grid(results: Results) -> Grid | None:
    """Time and memory of the trainings, as far as they were measured."""
    lines = []
    for table in TABLES:
        for row in table.rows:
            found = results.tables.get(table.number, {}).get(row.name)
            costs = [training["cost"] for training in found.trainings if training.get("cost")] if found else []
            if costs:
                minutes = [f"{cost['seconds'] / 60:.1f}" for cost in costs]
                known = [cost["megabytes"] for cost in costs if "megabytes" in cost]
                memory = f"{max(known) / 1000:.1f}" if known else "-"
                name = f"Table {table.number}, {row.words}"
                lines.append((name, (Entry(", ".join(minutes)), Entry(memory))))
    return Grid((), ("minutes", "GB at most"), tuple(lines), "training") if lines else None


def calibration_grid(results: Results) -> Grid | None:
    """How far the probabilities of edges can be believed."""
    lines = []
    for row in REASONING.rows:
        found = results.tables.get(2, {}).get(row.name)
        told = {} if found is None else {split: result.model_dump() for split, result in found.results.items()}
        if any(one.get("ece") is not None for one in told.values()):
            values = [told.get(split, {}).get(key) for split in REASONING.splits for key in ("ece", "brier")]
            lines.append((row.words, tuple(NONE if value is None else Entry(f"{value:.4f}") for value in values)))
    groups = tuple((words, 2) for words in REASONING.splits.values())
    return Grid(groups, ("ECE", "Brier") * len(REASONING.splits), tuple(lines)) if lines else None
