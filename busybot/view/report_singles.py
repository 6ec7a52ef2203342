"""The part of a report about single evaluations: numbers beside the paper's, the trivial baselines' and the gate."""

from typing import Any

from busybot.view.protocol import INTERACTION, REASONING, Row, Table
from busybot.view.report_gates import judge
from busybot.view.report_page import Block, Entry, Grid, Heading, Items, Text, Tone
from busybot.view.report_read import Cell, InteractResult, ReasonResult, Results, cell_of
from busybot.view.report_sections import NONE, dataset, number, reference, versions

KEYS = {"train": "validation"}
"""Splits of datasets under the names that the tables' columns have."""


def single_blocks(results: Results) -> list[Block]:
    """A table for every single evaluation."""
    blocks: list[Block] = []
    for name, result in results.singles.items():
        table = INTERACTION if isinstance(result, InteractResult) else REASONING
        origin = result.dataset
        blocks.append(Heading(f"{_subject(result)} on {origin.get('name')} ({origin.get('split')})", 3))
        blocks.append(_grid(table, result))
        items = [f"file `{name}`", f"boards: {dataset(origin)}", f"seed of the evaluation {result.seed}"]
        items += [f"`{result.command}`"] if result.command else []
        told = (result.model_extra or {}).get("versions")
        items += [f"made with {versions(told)}"] if isinstance(told, dict) else []
        blocks.append(Items(tuple(items)))
    if blocks:
        note = (
            "The paper's numbers and the gates are those of its 58 objects and of thousands of boards: beside other "
            "objects, or a few boards, they say where one stands and are neither reached nor missed."
        )
        blocks.insert(0, Text(note))
    return blocks


def _subject(result: InteractResult | ReasonResult) -> str:
    if isinstance(result, InteractResult):
        return f"Acting: {result.policy}{', strict' if result.strict else ''}"
    return f"Reasoning: {result.model}"


def _grid(table: Table, result: InteractResult | ReasonResult) -> Grid:
    split = KEYS.get(result.dataset.get("split", ""), result.dataset.get("split", ""))
    row = _row(table, result)
    baselines = _baselines(result)
    heads = ("measured", "95 % interval", *baselines, "bound", "the paper", "gate")
    lines = []
    for key, words in table.keys.items():
        cell = cell_of(result, key)
        known = split in table.splits
        paper = table.at(table.paper[row.paper], split, key) if known and row.paper else None
        gate = table.at(table.gates[row.gate], split, key) if known and row.gate else None
        verdict = judge(table, row, split, key, cell) if known else None
        tone: Tone = "" if verdict is None or cell is None else "reached" if verdict.reached else "missed"
        trivial = [_share(values.get(key)) for values in baselines.values()]
        lines.append((words, (*_measured(cell, tone), *trivial, _bound(cell), _percent(paper), _percent(gate))))
    return Grid((), heads, tuple(lines), f"percent, {result.boards} boards")


def _row(table: Table, result: InteractResult | ReasonResult) -> Row:
    """Who is judged, as a row of its table: the paper's BusyBot stands beside whatever was learned."""
    if isinstance(result, ReasonResult):
        trivial = result.model in ("count", "persistence", "pc")
        return Row("", "", "trivial") if trivial else Row("", "", "ours", "BusyBot", "event")
    if result.policy in ("random", "scripted"):
        return Row("", "", "trivial")
    return Row("", "", "ours", "BusyBot", "strict" if result.strict else "free")


def _baselines(result: InteractResult | ReasonResult) -> dict[str, dict[str, Any]]:
    """Trivial answers on the same boards, as the result tells them."""
    if isinstance(result, InteractResult):
        return {}
    told: dict[str, dict[str, Any]] = {
        name.replace("_", " "): dict(values) for name, values in result.baselines.items()
    }
    return told | ({"nothing changes": result.persistence} if result.persistence else {})


def _measured(cell: Cell | None, tone: Tone) -> tuple[Entry, Entry]:
    if cell is None:
        return NONE, Entry("")
    if cell.low is None or cell.high is None:
        return Entry(number(cell.value), tone=tone), Entry("")
    return Entry(number(cell.value), tone=tone), Entry(f"{number(cell.low)} to {number(cell.high)}")


def _bound(cell: Cell | None) -> Entry:
    return Entry("" if cell is None or cell.bound is None else number(cell.bound), tone="reference")


def _percent(value: float | None) -> Entry:
    return Entry("" if value is None else reference(value), tone="reference")


def _share(value: Any) -> Entry:
    return Entry(number(100 * value) if isinstance(value, float | int) else "", tone="reference")
