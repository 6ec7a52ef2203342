"""The part of a report about single evaluations: numbers beside the paper's, the trivial baselines' and the gate."""

from typing import Any

from busybot.view.protocol import INTERACTION, PLANNING, REASONING, Table
from busybot.view.report_kinds import PlanResult
from busybot.view.report_page import Block, Entry, Grid, Heading, Items, Text
from busybot.view.report_read import Cell, InteractResult, ReasonResult, Results, cell, cell_of
from busybot.view.report_sections import NONE, dataset, number, reference, versions

Single = InteractResult | ReasonResult | PlanResult
KEYS = {"train": "validation"}
"""Splits of datasets under the names that the tables' columns have."""
SKILLS = {"interact": "Acting", "reason": "Reasoning"}


def single_blocks(results: Results) -> list[Block]:
    """A table for every single evaluation."""
    blocks: list[Block] = []
    for name, result in results.singles.items():
        table = INTERACTION if isinstance(result, InteractResult) else REASONING
        blocks += _heading(f"{SKILLS[table.skill]}: {subject(result)}", result)
        blocks += [_grid(table, result), _origin(name, result, f"{result.boards} boards")]
    for name, plan in results.plans.items():
        blocks += _heading("Planning", plan)
        blocks += [_plan_grid(plan), _origin(name, plan, f"{plan.tasks} tasks")]
    if blocks:
        note = (
            "The paper's numbers and the gates are those of its 58 objects and of thousands of boards: beside other "
            "objects, or on a few boards, they only say where one stands."
        )
        blocks.insert(0, Text(note))
    return blocks


def _heading(words: str, result: Single) -> list[Block]:
    return [Heading(f"{words} on {result.dataset.get('name')} ({result.dataset.get('split')})", 3)]


def _origin(name: str, result: Single, judged: str) -> Items:
    """Where the numbers come from."""
    items = [f"file `{name}`", f"judged {judged} of {dataset(result.dataset)}", f"seed of the evaluation {result.seed}"]
    items += [f"`{result.command}`"] if result.command else []
    told = (result.model_extra or {}).get("versions")
    return Items(tuple(items + ([f"made with {versions(told)}"] if isinstance(told, dict) else [])))


def _plan_grid(result: PlanResult) -> Grid:
    """All agents; the paper's and the gate where the tasks are of one kind."""
    split, kind = result.dataset.get("split", ""), next(iter(result.kinds)) if len(result.kinds) == 1 else ""
    known = (split, kind) in PLANNING.columns()
    rows = {row.name: row for row in PLANNING.rows}
    lines = []
    for agent, scores in result.agents.items():
        row = rows.get(agent)
        paper = PLANNING.paper.get((row.paper if row else None) or "")
        gate = PLANNING.gates.get((row.gate if row else None) or "")
        beside = [PLANNING.at(values, split, kind) if known and values else None for values in (paper, gate)]
        shares = (Entry(number(100 * scores.solved)) if scores.solved is not None else NONE,)
        steps = (Entry(number(scores.steps)) if scores.steps is not None else NONE,)
        measured = _measured(cell(scores.success, scores.interval))
        lines.append((row.words if row else agent, (*measured, *shares, *steps, *map(_percent, beside))))
    heads = ("success", "95 % interval", "tasks solved", "steps", "the paper", "gate")
    return Grid((), heads, tuple(lines), f"percent, {result.tasks} tasks")


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
