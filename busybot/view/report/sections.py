"""The parts of a report that show numbers: tables, single evaluations, robustness, cost, and where they come from."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from busybot.common.rng import generator
from busybot.evaluation.reference_tables import INTERACTION, PLANNING, REASONING, ReferenceRow, Role, Table
from busybot.evaluation.results import KINDS
from busybot.evaluation.statistics import LEAST_PAIRS, compare_boards
from busybot.view.figures.curves import BASELINES, robustness_figure, strength_words, title_of
from busybot.view.report.gates import judge
from busybot.view.report.page import (
    Block,
    Entry,
    Fold,
    Grid,
    Heading,
    Items,
    Picture,
    Text,
    Tone,
    difference,
    number,
    plain_grid,
    reference,
)
from busybot.view.report.results import (
    InteractResult,
    PlanResult,
    ReasonResult,
    Results,
    RowFound,
    Score,
    Stages,
    TableFile,
    score,
    score_of,
)
from busybot.view.report.world_results import WorldReason, name_of, told_apart

Judged = InteractResult | ReasonResult | WorldReason
_Told = TypeVar("_Told")

SECTIONS: dict[str, tuple[Role, ...]] = {
    "ours": ("ours",),
    "changed, or another method": ("ablation", "competitor"),
    "trivial, and oracles": ("trivial", "bound"),
}
MISSING = Entry("missing", tone="missing")
NONE = Entry("-", tone="reference")
RUN = {
    1: f"{KINDS['table1']} --assets DIR --work FOLDER --out table1.json",
    2: f"{KINDS['table2']} --data FOLDER --work FOLDER --out table2.json",
    3: f"{KINDS['table3']} --policy-model MODEL --reasoner M0 M1 M2 --work FOLDER --out table3.json",
}
"""What makes the numbers of a table."""
ROBUSTNESS_RUN = f"{KINDS['reason-robustness']} --data DATASET --model event=FOLDER --out FILE"
SPLITS = {"train": "validation"}
"""Splits of datasets under the names that the tables' columns have."""
SKILLS = {"interact": "Acting", "reason": "Reasoning"}
HASHES = ("board_hash", "trace_hash", "content_hash")


def _reference(value: float | None) -> Entry:
    return Entry("" if value is None else reference(value), tone="reference")


def _share(value: float | None) -> Entry:
    return NONE if value is None else Entry(number(100 * value))


def table_grid(table: Table, rows: dict[str, RowFound], beside: bool = True) -> Grid:
    """All rows of a table by what they stand for, then bound, gates, aims and the paper's rows.

    Args:
        beside: False for the rows alone that were run, without what the paper's objects are measured by.
    """
    lines: list[tuple[str, tuple[Entry, ...]]] = []
    for words, roles in SECTIONS.items():
        shown = [row for row in table.rows if row.role in roles and (beside or row.name in rows)]
        lines += [(words, ())] if shown else []
        lines += [(row.words, _entries(table, row, rows.get(row.name), beside)) for row in shown]
    if beside:
        if table.skill == REASONING.skill:
            lines.append(("what the recordings determine", _bounds(table, rows)))
        lines.append(("asked of us", ()))
        for kind, values in (("gate", table.gates), ("aim", table.aims)):
            lines += [(f"{kind}: {name}", tuple(map(_reference, percents))) for name, percents in values.items()]
        lines.append(("the paper", ()))
        lines += [(name, tuple(map(_reference, values))) for name, values in table.paper.items()]
    groups = tuple((words, len(table.keys)) for words in table.splits.values())
    return Grid(groups, tuple(table.keys.values()) * len(table.splits), tuple(lines), "percent")


def _entries(table: Table, row: ReferenceRow, found: RowFound | None, gated: bool) -> tuple[Entry, ...]:
    """The cells of a row: numbers with their spread, marked where there is a gate."""
    if found is None:
        return (MISSING,) * len(table.columns())
    entries = []
    for split, key in table.columns():
        told = found.cells.get((split, key))
        if (split, key) not in found.cells:
            entries.append(Entry(found.note or "missing", tone="missing"))
        elif told is None:
            entries.append(NONE)
        else:
            verdict = judge(table, row, split, key, told) if gated else None
            tone: Tone = "" if verdict is None else "reached" if verdict.reached else "missed"
            entries.append(Entry(number(told.value), told.spread, tone))
    return tuple(entries)


def _bounds(table: Table, rows: dict[str, RowFound]) -> tuple[Entry, ...]:
    entries = []
    for column in table.columns():
        told = [rows[row.name].cells.get(column) for row in table.rows if row.name in rows and row.role == "ours"]
        known = [one.bound for one in told if one is not None and one.bound is not None]
        entries.append(_reference(None) if not known else Entry(number(known[0]), tone="reference"))
    return tuple(entries)


def several_files(table: Table, files: Sequence[TableFile]) -> Text:
    """How the files of a table stand on the page, and which rows none of them has."""
    run = {row.name for file in files for row in file.own}
    left = [row.words for row in table.rows if row.name not in run]
    missing = f" **Missing** in all of them: {'; '.join(left)}." if left else ""
    return Text(
        f"{len(files)} files have rows of this table; each stands by itself, with the rows that it has.{missing}"
    )


def about_file(file: TableFile) -> Text:
    """What the rows of a file have in common, where others stand beside it."""
    objects, profile = file.about.get("assets") or "not told", file.about.get("profile")
    return Text(f"Objects: {objects}.{f' Profile: {profile}.' if profile else ''}")


def strange_rows(files: Sequence[TableFile]) -> list[Block]:
    """Rows of files that their table does not know, so that nobody looks for them in vain."""
    told = {file.name: [f"`{name}`" for name in file.rows.keys() - {row.name for row in file.own}] for file in files}
    lines = [f"{', '.join(sorted(names))} of `{file}`" for file, names in told.items() if names]
    return [Text(f"Not shown, because this table has no such rows: {'; '.join(lines)}.")] if lines else []


def provenance(file: TableFile) -> Fold:
    """Commands, seeds, hashes and versions of every row of a file."""
    about = file.about
    machine = _in_a_line(about.get("machine") or {})
    blocks: list[Block] = []
    where = [f"{name}: {value}." for name, value in (("Objects", about.get("assets")), ("Machine", machine)) if value]
    if where:
        blocks.append(Text(" ".join(where)))
    if commands := about.get("commands"):
        blocks += [Text("all rows"), Items(tuple(f"`{command}`" for command in commands))]
    seen: dict[tuple[str, ...], str] = {}
    for row in file.own:
        found = file.rows[row.name]
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
        data = [*training["rounds"], *training["data"]]
        hashes = ", ".join(f"`{str(entry['content_hash'])[:16]}`" for entry in data if entry.get("content_hash"))
        seed = "" if training["seed"] is None else f"seed {training['seed']}"
        told = ", ".join(filter(None, (seed, hashes and f"content of its data {hashes}")))
        lines += [f"training: {told}"] if told else []
        lines += [f"made with {_in_a_line(training['versions'])}"] if training["versions"] else []
    return lines + [f"judged, {split}: {_dataset(result.dataset)}" for split, result in found.results.items()]


def _in_a_line(values: dict[str, Any]) -> str:
    return ", ".join(f"{name} {value}" for name, value in values.items())


def _dataset(origin: dict[str, Any]) -> str:
    """Which boards, in a line."""
    hashes = [f"{key.replace('_', ' ')} `{str(origin[key])[:16]}`" for key in HASHES if origin.get(key)]
    seed = f", seed {origin['seed']}" if origin.get("seed") is not None else ""
    boards = "" if origin.get("boards") is None else f"{origin['boards']} boards{seed}"
    return ", ".join(filter(None, (boards, *hashes)))


def cost_grid(results: Results) -> Grid | None:
    """Time and memory of the trainings, as far as they were measured."""
    lines = []
    for run in results.rows():
        costs = [training["cost"] for training in run.found.trainings if training["cost"]] if run.found else []
        if costs:
            minutes = [f"{cost['seconds'] / 60:.1f}" for cost in costs]
            known = [cost["megabytes"] for cost in costs if cost["megabytes"] is not None]
            memory = f"{max(known) / 1000:.1f}" if known else "-"
            lines.append((f"Table {run.table.number}, {run.words}", (", ".join(minutes), memory)))
    return plain_grid(("minutes", "GB at most"), lines, "training") if lines else None


def calibration_grid(results: Results) -> Grid | None:
    """How far the probabilities of edges can be believed."""
    lines = []
    for run in (run for row in REASONING.rows for run in results.runs(REASONING, row)):
        told = run.found.results if run.found else {}
        if any(getattr(one, "brier", None) is not None for one in told.values()):
            cells = [cell for split in REASONING.splits for cell in _calibrated(told.get(split))]
            lines.append((run.words, tuple(cells)))
    groups = tuple((words, 2) for words in REASONING.splits.values())
    return Grid(groups, ("ECE, doubted", "Brier") * len(REASONING.splits), tuple(lines)) if lines else None


def _calibrated(told: InteractResult | ReasonResult | None) -> tuple[Entry, Entry]:
    """Calibration error over what is doubted, with the number of pairs, and the Brier score."""
    if not isinstance(told, ReasonResult):
        return NONE, NONE
    found, brier = told.calibration, NONE if told.brier is None else Entry(f"{told.brier:.4f}")
    if found is None:
        return NONE, brier
    enough = found.ece_uncertain is not None and found.pairs_uncertain >= LEAST_PAIRS
    return Entry(f"{found.ece_uncertain:.4f}" if enough else NONE.text, f"({found.pairs_uncertain})"), brier


def by_file(given: Mapping[str, _Told], blocks_of: Callable[[_Told, str], list[Block]]) -> list[Block]:
    """What each file tells; under the file's name, if there are several.

    Args:
        blocks_of: of what a file tells; its second argument keeps apart what is drawn of several files.
    """
    names = told_apart(given)
    blocks: list[Block] = []
    for place, (file, told) in enumerate(given.items()):
        blocks += [Heading(f"`{names[file]}`", 3)] if len(given) > 1 else []
        blocks += blocks_of(told, f"-{place}" if place else "")
    return blocks


def robustness_blocks(results: Results, figures: Path) -> list[Block]:
    """What disturbed recordings cost, as each file tells it."""
    missing = Text(f"**Missing**: what disturbed recordings cost. `{ROBUSTNESS_RUN}` measures it.")
    found = by_file(results.robustness, lambda told, suffix: _robustness(told, figures / f"robustness{suffix}.png"))
    return found or [missing]


def _robustness(told: dict[str, Any], figure: Path) -> list[Block]:
    """Quality against the strength of every disturbance as a figure, its numbers, and what is done."""
    names, disturbances = list(dict.fromkeys((*told["models"], *BASELINES))), told["disturbances"]
    lines = []
    for name, rows in told["rows"].items():
        for row in rows:
            shares = [row["models"].get(model, {}).get(key) for model in names for key in ("edge_f1", "pred_a")]
            words = f", {strength_words(told, name, row['strength'])}" if name in disturbances else ""
            lines.append((f"{title_of(told, name)}{words}", tuple(map(_share, (*shares, row["known"])))))
    groups = (*((name, 2) for name in names), ("", 1))
    grid = Grid(groups, (*("edges (F1)", "Pred-A") * len(names), "known"), tuple(lines), "percent")
    done = Items(tuple(f"{title_of(told, name)}: {one['what']}" for name, one in disturbances.items()))
    caption = "Edges and predictions when recordings are disturbed, always in one way at a time; 0 is undisturbed."
    note = (
        f"{told['boards']} boards. Baselines stand with defaults and with the best of several settings, chosen "
        "with the truth. Known: steps that could be predicted in spite of the disturbance."
    )
    told_of = (Text(note), Fold("Numbers, and what is done", (grid, done)))
    if disturbances.keys().isdisjoint(told["rows"]):  # of pictures without losses alone, say
        return [*told_of]
    return [Picture(robustness_figure(figure, told, figure.parent.parent), caption), *told_of]


def stage_blocks(stages: Stages) -> list[Block]:
    """Wall time of a pipeline's stages, those of one kind together."""
    kinds: dict[str, list[float]] = {}
    for name, stage in stages.stages.items():
        kinds.setdefault("features" if name.endswith(".features") else name.split("/")[0], []).append(stage.seconds)
    named = {**{f"`{kind}`": one for kind, one in kinds.items()}, "all": [s for one in kinds.values() for s in one]}
    lines = [(name, (str(len(one)), f"{sum(one) / 60:.1f}")) for name, one in named.items()]
    unfinished = [name for name, stage in stages.stages.items() if not stage.done]
    machine = _in_a_line(stages.machine or {}) or "not recorded"
    words = f"Wall time of the run by output folder, interrupted attempts included. Machine: {machine}."
    words += f" Not finished: {', '.join(unfinished)}." if unfinished else ""
    return [Text(words), plain_grid(("stages", "minutes"), lines, "run")]


def single_blocks(results: Results) -> list[Block]:
    """A table for every single evaluation: numbers beside the paper's, the trivial baselines' and the gate."""
    blocks: list[Block] = []
    for name, result in results.singles.items():
        table = INTERACTION if isinstance(result, InteractResult) else REASONING
        words = f"{SKILLS[table.skill]}: {subject(result)}"
        blocks += _single(words, name, result, f"{result.boards} boards", _single_grid(table, result))
    for name, plan in results.plans.items():
        blocks += _single("Planning", name, plan, f"{plan.tasks} tasks", _plan_grid(plan))
    if blocks:
        note = (
            "The paper's numbers and the gates are those of its 58 objects and of thousands of boards: beside other "
            "objects, or on a few boards, they only say where one stands."
        )
        blocks.insert(0, Text(note))
    return [*blocks, *compared(results.singles)]


def compared(results: Mapping[str, Judged]) -> list[Block]:
    """Evaluations of one skill on the same boards, or recordings: all others against the one that was given first.

    Args:
        results: by file.
    """
    groups: dict[tuple[Any, ...], list[tuple[str, Judged]]] = {}
    for name, result in results.items():
        boards = result.dataset.get("board_hash")
        if boards and result.by_board:
            which = (type(result), str(boards), str(result.dataset.get("content_hash")), result.boards)
            groups.setdefault(which, []).append((name, result))
    grids = [_comparison(told) for told in groups.values() if len(told) > 1]
    return [Heading("On the same boards", 3), Text(PAIRED), *grids] if grids else []


PAIRED = (
    "What each has more than the one that was given first, in points, and how probable so large a difference is, "
    "either way, if both are equally good (p): a permutation test that swaps what they did on a board. It says nothing "
    "about boards with other objects."
)


def _comparison(told: list[tuple[str, Judged]]) -> Grid:
    (first_name, first), *others = told
    called = COMPARED[type(first)]
    keys = [key for key in called if key in first.by_board]
    lines = []
    for name, other in others:
        mine, theirs = ({key: one.model_dump() for key, one in each.by_board.items()} for each in (other, first))
        found = compare_boards(theirs, mine, generator(0, "", 0, "report/compared"))
        told_of = [found.get(key, {"difference": None}) for key in keys]
        cells = ["-" if one["difference"] is None else difference(one["difference"], one["p"]) for one in told_of]
        lines.append((_named(name, other), cells))
    heads = [called[key] for key in keys]
    return plain_grid(heads, lines, f"against {_named(first_name, first)}, {first.boards} boards")


COMPARED: dict[type, dict[str, str]] = {
    InteractResult: INTERACTION.keys,
    ReasonResult: REASONING.keys,
    WorldReason: {"parent_f1": "F1, objects", "link_parent_f1": "F1, links", "mechanism_accuracy": "mechanisms"},
}
"""What is compared board by board, and what it is called."""


def _named(name: str, result: Judged) -> str:
    """Who was judged, and the end of the file's name: there may be several of them."""
    return f"{subject(result)} (`{'/'.join(Path(name).parts[-2:])}`)"


def _single(
    words: str, name: str, result: InteractResult | ReasonResult | PlanResult, judged: str, grid: Grid
) -> list[Block]:
    """Heading, numbers, and where they come from."""
    heading = Heading(f"{words} on {result.dataset.get('name')} ({result.dataset.get('split')})", 3)
    items = [f"file `{name}`", f"judged {judged} of {_dataset(result.dataset)}"]
    items += [f"seed of the evaluation {result.seed}", *([f"`{result.command}`"] if result.command else [])]
    extra = result.model_extra or {}
    items += [f"code of commit `{extra['commit']}`"] if extra.get("commit") else []
    items += [f"made with {_in_a_line(extra['versions'])}"] if isinstance(extra.get("versions"), dict) else []
    return [heading, grid, Items(tuple(items))]


def subject(result: Judged) -> str:
    """Who was judged, in short."""
    if isinstance(result, InteractResult):
        return f"{result.policy}{', strict' if result.strict else ''}"
    return name_of(result) if isinstance(result, WorldReason) else str(result.model)


def _single_grid(table: Table, result: InteractResult | ReasonResult) -> Grid:
    told_split = str(result.dataset.get("split"))  # whatever a file says
    split = SPLITS.get(told_split, told_split)
    gates = table.gates["event" if isinstance(result, ReasonResult) else "strict" if result.strict else "free"]
    baselines = _baselines(result) if isinstance(result, ReasonResult) else {}
    lines = []
    for key, words in table.keys.items():
        told = score_of(result, key)
        known = split in table.splits
        beside = [table.at(values, split, key) if known else None for values in (table.paper["BusyBot"], gates)]
        trivial = [_reference(None if (x := values.get(key)) is None else 100 * x) for values in baselines.values()]
        bound = Entry("" if told is None or told.bound is None else number(told.bound), tone="reference")
        lines.append((words, (*_measured(told), *trivial, bound, *map(_reference, beside))))
    heads = ("measured", "95 % interval", *baselines, "bound", "the paper", "gate")
    return Grid((), heads, tuple(lines), f"percent, {result.boards} boards")


def _baselines(result: ReasonResult) -> dict[str, dict[str, Any]]:
    """Trivial answers on the same boards, as the result tells them."""
    told: dict[str, Any] = {name.replace("_", " "): dict(values) for name, values in result.baselines.items()}
    return told | ({"nothing changes": result.persistence} if result.persistence else {})


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
        steps = NONE if scores.steps is None else Entry(number(scores.steps))
        measured = (*_measured(score(scores.success, scores.interval)), _share(scores.solved), steps)
        lines.append((row.words if row else agent, (*measured, *map(_reference, beside))))
    heads = ("success", "95 % interval", "tasks solved", "steps", "the paper", "gate")
    return Grid((), heads, tuple(lines), f"percent, {result.tasks} tasks")


def _measured(told: Score | None) -> tuple[Entry, Entry]:
    if told is None:
        return NONE, Entry("")
    interval = "" if told.low is None or told.high is None else f"{number(told.low)} to {number(told.high)}"
    return Entry(number(told.value)), Entry(interval)
