"""The part of a report about single evaluations: numbers beside the paper's, the trivial baselines' and the gate."""

from typing import Any

from busybot.view.protocol import INTERACTION, REASONING, Table
from busybot.view.report_page import Block, Entry, Grid, Heading, Items, Text
from busybot.view.report_read import Cell, InteractResult, ReasonResult, Results, cell_of
from busybot.view.report_sections import NONE, dataset, number, reference, versions

KEYS = {"train": "validation"}
"""Splits of datasets under the names that the tables' columns have."""
SKILLS = {"interact": "Acting", "reason": "Reasoning"}


def single_blocks(results: Results) -> list[Block]:
    """A table for every single evaluation."""
    blocks: list[Block] = []
    for name, result in results.singles.items():
        table = INTERACTION if isinstance(result, InteractResult) else REASONING
        origin = result.dataset
        where = f"{origin.get('name')} ({origin.get('split')})"
        blocks.append(Heading(f"{SKILLS[table.skill]}: {subject(result)} on {where}", 3))
        blocks.append(_grid(table, result))
        items = [f"file `{name}`", f"boards: {dataset(origin)}", f"seed of the evaluation {result.seed}"]
        items += [f"`{result.command}`"] if result.command else []
        told = (result.model_extra or {}).get("versions")
        items += [f"made with {versions(told)}"] if isinstance(told, dict) else []
        blocks.append(Items(tuple(items)))
    if blocks:
        note = (
            "The paper's numbers and the gates are those of its 58 objects and of thousands of boards: beside other "
            "objects, or on a few boards, they only say where one stands."
        )
        blocks.insert(0, Text(note))
    return blocks


def subject(result: InteractResult | ReasonResult) -> str:
    """Who was judged, in short."""
    if isinstance(result, InteractResult):
        return f"{result.policy}{', strict' if result.strict else ''}"
    return str(result.model)


def _grid(table: Table, result: InteractResult | ReasonResult) -> Grid:
    split = KEYS.get(result.dataset.get("split", ""), result.dataset.get("split", ""))
    gates = table.gates["event" if isinstance(result, ReasonResult) else "strict" if result.strict else "free"]
    baselines = _baselines(result)
    lines = []
    for key, words in table.keys.items():
        cell = cell_of(result, key)
        known = split in table.splits
        beside = [table.at(values, split, key) if known else None for values in (table.paper["BusyBot"], gates)]
        trivial = [_share(values.get(key)) for values in baselines.values()]
        lines.append((words, (*_measured(cell), *trivial, _bound(cell), *map(_percent, beside))))
    heads = ("measured", "95 % interval", *baselines, "bound", "the paper", "gate")
    return Grid((), heads, tuple(lines), f"percent, {result.boards} boards")


def _baselines(result: InteractResult | ReasonResult) -> dict[str, dict[str, Any]]:
    """Trivial answers on the same boards, as the result tells them."""
    if isinstance(result, InteractResult):
        return {}
    told: dict[str, dict[str, Any]] = {
        name.replace("_", " "): dict(values) for name, values in result.baselines.items()
    }
    return told | ({"nothing changes": result.persistence} if result.persistence else {})


def _measured(cell: Cell | None) -> tuple[Entry, Entry]:
    if cell is None:
        return NONE, Entry("")
    if cell.low is None or cell.high is None:
        return Entry(number(cell.value)), Entry("")
    return Entry(number(cell.value)), Entry(f"{number(cell.low)} to {number(cell.high)}")


def _bound(cell: Cell | None) -> Entry:
    return Entry("" if cell is None or cell.bound is None else number(cell.bound), tone="reference")


def _percent(value: float | None) -> Entry:
    return Entry("" if value is None else reference(value), tone="reference")


def _share(value: Any) -> Entry:
    return Entry(number(100 * value) if isinstance(value, float | int) else "", tone="reference")
