"""A dataset as plain tables for causal discovery: what every variable showed, what was done to it, the true graph.

Nothing in them is a picture, and all of it is privileged: links and states as the simulator knows them. The tables
are `COLUMNS`, one Parquet file each; from `graph` and the links' states alone the responders of a world without chance
can be computed again, as `tests/datasets/test_causal_export.py` does.

Variables are named after their object: `lamp_5` is a responder, `switch_2.link_0` a trigger link. A hidden clock is a
variable, too (`clock`), which no row of `states` shows.
"""

import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from busybot import __version__
from busybot.boards.dynamics import Dynamics, Links
from busybot.boards.mechanisms import Mechanism
from busybot.boards.spec import BoardSpec
from busybot.boards.true_causes import Period, VariableNames, lag, periods
from busybot.boards.worlds import links_of
from busybot.common.atomic_io import (
    make_folder,
    naming_writes,
    new_file,
    refuse_taken,
    remove_abandoned,
    rename,
    unfinished,
    write_new,
)
from busybot.common.errors import BusybotError, naming
from busybot.common.process_pool import Progress, share
from busybot.common.text import markdown_code, markdown_text
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import collect_command
from busybot.datasets.manifest import CARD_FILE
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.schema import Column
from busybot.episodes.tables import knows_truth
from busybot.objects.library import Library

BOARDS_PER_ROW_GROUP = 250

_BOARD = Column("board", pa.int32(), "index of the board in the dataset")
COLUMNS: dict[str, tuple[Column, ...]] = {
    "states": (
        _BOARD,
        Column("step", pa.int32(), "0 is the new board; step k shows what k actions have left"),
        Column("variable", pa.string(), "its name on the board"),
        Column("role", pa.string(), "link (a trigger link, which can be moved) or responder"),
        Column("state", pa.int8(), "discrete state of the variable at this step"),
        Column("attempted", pa.bool_(), "whether the action that led to this step took hold of this link"),
        Column("moved", pa.bool_(), "whether it moved it: the mask of interventions"),
    ),
    "variables": (
        _BOARD,
        Column("variable", pa.string(), "its name on the board"),
        Column("role", pa.string(), "link, responder, or clock (hidden: it is in no row of `states`)"),
        Column("object", pa.int16(), "index of its object on the board", nullable=True),
        Column("category", pa.string(), "kind of that object", nullable=True),
        Column("link", pa.string(), "name of the link", nullable=True),
        Column("states", pa.int8(), "number of its states; of a responder, that it may show here", nullable=True),
        Column("idle", pa.bool_(), "whether it is a link that controls nothing on purpose"),
    ),
    "graph": (
        _BOARD,
        Column("parent", pa.string(), "variable that is read; null if its child changes by itself", nullable=True),
        Column("child", pa.string(), "responder whose state the mechanism decides"),
        Column("lag", pa.int8(), "a change of the parent shows so many steps later at the earliest", nullable=True),
        Column("kind", pa.string(), "of the mechanism"),
        Column("input", pa.int8(), "place of the parent among the mechanism's inputs, from 0", nullable=True),
        Column("inputs", pa.int8(), "how many inputs the mechanism has"),
        Column("table", pa.string(), "JSON: the mechanism's states; of most kinds by its inputs', the last fastest"),
        Column("parameters", pa.string(), "JSON: what else its kind is told"),
        Column("memory", pa.bool_(), "whether it remembers more than its inputs' states"),
        Column("chance", pa.bool_(), "whether luck decides with it"),
        Column("clock", pa.string(), "hidden common cause: those of one name have their luck in common", nullable=True),
        Column("since", pa.int32(), "first step whose state this mechanism decides"),
        Column("until", pa.int32(), "step from which on another one does (rewired)", nullable=True),
        Column("sentence", pa.string(), "the mechanism in words"),
    ),
    "locks": (
        _BOARD,
        Column("link", pa.string(), "link that is held"),
        Column("responder", pa.string(), "responder that holds it"),
        Column("open_states", pa.string(), "JSON: states of the responder, before the action, in which it does not"),
    ),
    "boards": (
        _BOARD,
        Column("world", pa.string(), "what its mechanisms were drawn from"),
        Column("split", pa.string(), "split that it was drawn for"),
        Column("seed", pa.int64(), "from which it was drawn"),
        Column("policy", pa.string(), "what chose the actions"),
        Column("oracle", pa.bool_(), "whether that knew what only the simulator knows"),
        Column("steps", pa.int32(), "number of actions"),
        Column("moved", pa.int32(), "how many of them moved a link"),
        Column("board_hash", pa.string(), "SHA-256 over the board's values"),
        Column("trace_hash", pa.string(), "SHA-256 over actions and states"),
    ),
}
"""The tables, in the order in which the card tells of them."""

Rows = dict[str, list[tuple[Any, ...]]]
"""Rows of each table, values in the order of its columns."""


@dataclass(frozen=True)
class Exported:
    """What was written: the folder, how many boards, and the rows of each table."""

    out: Path
    boards: int
    rows: dict[str, int]


def export_causal(
    dataset: Dataset, library: Library, out: Path, workers: int = 1, progress: Progress | None = None
) -> Exported:
    """Write the tables of all recorded boards and a card into a new folder, which is there whole or not at all.

    Args:
        library: with the dataset's objects: they tell how many states a link has.

    Raises:
        BusybotError: something is at `out`, nothing is recorded, or a recording knows no states.
    """
    place = out.absolute()
    refuse_taken(place)
    if place.resolve().is_relative_to(dataset.path.resolve()):
        raise BusybotError(f"{out}: it lies in the dataset", "name a folder beside it")
    episodes = dataset.episodes_table().to_pylist()
    if not episodes:
        raise BusybotError(f"{dataset.path}: no board has an episode", collect_command(dataset.path, dataset.info))
    links, worlds = _boards(dataset, library, {row["episode"] for row in episodes})
    tasks = [(dataset.episode_path(row["episode"]), row, links[row["episode"]]) for row in episodes]
    make_folder(place.parent)
    remove_abandoned(place.parent, place.name)
    with unfinished(place.parent, place.name) as folder:
        counts = _write_tables(folder, share(_rows_of, tasks, workers), len(tasks), progress)
        write_new(folder / CARD_FILE, card(dataset, episodes, worlds, counts).encode(), folder)
        refuse_taken(place)
        rename(folder, place)
    return Exported(out, len(tasks), counts)


def _boards(dataset: Dataset, library: Library, recorded: set[int]) -> tuple[dict[int, Links], list[str]]:
    """Links of each recorded board, and what worlds there are; one pass, for each board alone costs a whole file."""
    links, worlds = dict[int, Links](), set[str]()
    for board in dataset.each_board():
        if board.index in recorded:
            links[board.index] = links_of([library.get(placed.key) for placed in board.objects])
            worlds.add(board.world)
    return links, sorted(worlds)


def _write_tables(folder: Path, found: Iterator[Rows], boards: int, progress: Progress | None) -> dict[str, int]:
    """Write what is found, some boards at a time; returns the rows of each table."""
    counts = dict.fromkeys(COLUMNS, 0)
    waiting: list[Rows] = []
    with ExitStack() as files:
        writers = {name: files.enter_context(_writer(folder, name, files)) for name in COLUMNS}
        for done, one in enumerate(found, start=1):
            waiting.append(one)
            if len(waiting) == BOARDS_PER_ROW_GROUP or done == boards:
                for name, writer in writers.items():
                    rows = _table(name, waiting)
                    with naming_writes(folder / f"{name}.parquet"):
                        writer.write_table(rows)
                    counts[name] += rows.num_rows
                waiting.clear()
            if progress:
                progress(done, boards)
    return counts


def _writer(folder: Path, table: str, files: ExitStack) -> pq.ParquetWriter:
    file = new_file(folder / f"{table}.parquet", folder)
    files.enter_context(file)
    return pq.ParquetWriter(file, _schema(table), compression="zstd")


def _table(name: str, several: Sequence[Rows]) -> pa.Table:
    rows = [row for one in several for row in one[name]]
    values = list(zip(*rows, strict=True)) or [()] * len(COLUMNS[name])
    arrays = [pa.array(column, known.type) for column, known in zip(values, COLUMNS[name], strict=True)]
    return pa.table(arrays, schema=_schema(name))


def _schema(table: str) -> pa.Schema:
    return pa.schema([column.field() for column in COLUMNS[table]])


def _rows_of(task: tuple[Path, dict[str, Any], Links]) -> Rows:
    """All rows of one episode."""
    path, row, links = task
    episode = read_episode(path, "lazy")
    with naming(str(path)):
        recorded = tuple((link.object, link.name) for link in episode.links if link.trigger)
        if not knows_truth(episode):
            raise BusybotError("it knows no states: it was recorded without a simulator", "leave it out of the dataset")
        if recorded != links.names:
            raise BusybotError("its trigger links are not those of the objects", "name the right ones: --assets DIR")
        dynamics = Dynamics(episode.board, links)
    board, number = episode.board, row["episode"]
    names = VariableNames(board)
    told = (board.world, board.split, board.seed, episode.policy, episode.oracle, len(episode.steps))
    moved = sum(step.success for step in episode.steps)
    parts: Rows = {
        "states": list(_states(episode, names)),
        "variables": list(_variables(board, links, names)),
        "graph": list(_graph(board, dynamics, names)),
        "locks": [(names.of(lock.link), names.body(lock.responder), json.dumps(lock.states)) for lock in board.locks],
        "boards": [(*told, moved, row["board_digest"], row["trace_digest"])],
    }
    return {name: [(number, *values) for values in rows] for name, rows in parts.items()}


def _states(episode: Episode, names: VariableNames) -> Iterator[tuple[Any, ...]]:
    links = [(link.object, link.name) for link in episode.links if link.trigger]
    if not episode.steps:
        return
    first = episode.steps[0]
    frames: list[tuple[Any, ...]] = [(0, first.trigger_states_before, first.responder_states_before, None, False)]
    for number, step in enumerate(episode.steps, start=1):
        held = (step.acted_object, step.acted_link)
        frames.append((number, step.trigger_states_after, step.responder_states_after, held, step.success))
    responders = [index for index, placed in enumerate(episode.board.objects) if placed.role == "responder"]
    for number, triggers, shown, held, moved in frames:
        for link, state in zip(links, triggers, strict=True):
            yield number, names.link(*link), "link", state, link == held, link == held and moved
        for index in responders:
            yield number, names.body(index), "responder", shown[index], False, False


def _variables(board: BoardSpec, links: Links, names: VariableNames) -> Iterator[tuple[Any, ...]]:
    idle = {(one.object, one.link) for one in board.idle}
    for (index, name), size in zip(links.names, links.sizes, strict=True):
        yield names.link(index, name), "link", index, board.objects[index].category, name, size, (index, name) in idle
    stages: dict[int, str] = {period.relation.responder: period.relation.stage for period in periods(board)}
    for index, placed in enumerate(board.objects):
        if placed.role == "responder":
            states = {"single": 2, "multi": 3}.get(stages.get(index, ""), 1)
            yield names.body(index), "responder", index, placed.category, None, states, False
    for clock in sorted({_clock(period) for period in periods(board)} - {None}, key=str):
        yield clock, "clock", None, None, None, None, False


def _clock(period: Period) -> str | None:
    stream = period.relation.parameters.get("stream")
    return None if stream is None else str(stream)


def _graph(board: BoardSpec, dynamics: Dynamics, names: VariableNames) -> Iterator[tuple[Any, ...]]:
    """An edge for every input of every mechanism, one for its clock, and one without parent if it has neither."""
    for period in periods(board):
        relation, clock = period.relation, _clock(period)
        mechanism = _mechanism(dynamics, period)
        inputs = [names.of(reference) for reference in relation.triggers]
        memory = bool(mechanism.start((0,) * len(inputs))[1])
        edges: list[tuple[str | None, int | None, int | None]] = [
            (name, lag(mechanism, reference), place)
            for place, (name, reference) in enumerate(zip(inputs, relation.triggers, strict=True))
        ]
        edges += [(clock, 0, None)] if clock is not None else []
        for parent, late, place in edges or [(None, None, None)]:
            yield (
                parent,
                names.body(relation.responder),
                late,
                relation.kind,
                place,
                len(inputs),
                json.dumps(relation.states),
                json.dumps(relation.parameters, sort_keys=True),
                memory,
                mechanism.draws,
                clock,
                period.since,
                period.until,
                mechanism.sentence(inputs),
            )


def _mechanism(dynamics: Dynamics, period: Period) -> Mechanism:
    found = dynamics.mechanism(period.relation.responder, max(period.since - 1, 0))
    assert found is not None
    return found


_TEXT = """
# {name}: tables for causal discovery

{boards} boards of the world {worlds} (split {split}, drawn with seed {seed}), {steps} recorded steps. Made by
`busybot dataset export DATASET --to causal --out DIR`, busybot {version}.

    import pandas as pd
    states, graph = pd.read_parquet("states.parquet"), pd.read_parquet("graph.parquet")
    data = states[states.board == 0].pivot(index="step", columns="variable", values="state")

`data` has a row per step and a column per variable; with `values="moved"` it is the mask of interventions: who is told
it may take the actions for randomised experiments on single variables.

## How the numbers were made

A simulated agent ({policy}, seed {policy_seed}) took hold of one point of the board an action and pulled. Only trigger
links give way. After every action, also one that moved nothing, each responder's mechanism reads its inputs and decides
the responder's state: the state of a child at step t depends on a link's at step t - `lag` (and, where it has a memory,
on earlier ones), and on another responder's at t - `lag`, where that is at least 1. States are the simulator's own, not
read from pictures. Luck is drawn anew for each action from the seed, the split, the board and the responder, or its
clock. `kind` is one of the mechanisms of busybot; what `table` and `parameters` mean stands in its specification there.
A link that a responder holds (`locks`) is attempted, but does not move.

| | |
|---|---|
| board hash | `{hashes.board}` |
| trace hash | `{hashes.trace}` |
| content hash of the recordings | `{hashes.content}` |
| generator | {generator}, parameters {config} |
| objects | {objects} |

## Columns

{columns}
"""


def card(dataset: Dataset, episodes: Sequence[dict[str, Any]], worlds: Sequence[str], rows: dict[str, int]) -> str:
    """The text of README.md.

    Args:
        episodes: rows of the dataset's table of that name.
        rows: how many each table has.
    """
    info = dataset.info
    front = ["---", f"pretty_name: {json.dumps(info.name)}", "tags:", "- causal-discovery", "- busybot", "configs:"]
    for name in COLUMNS:
        front += [f"- config_name: {name}", f"  data_files: {name}.parquet"]
    columns = [
        f"### {name}.parquet: {rows[name]} rows\n\n| column | type | meaning |\n|---|---|---|\n"
        + "\n".join(f"| `{c.name}` | {c.type}{' or null' if c.nullable else ''} | {c.description} |" for c in listed)
        for name, listed in COLUMNS.items()
    ]
    return "\n".join([*front, "---", ""]) + _TEXT.format(
        name=markdown_text(info.name),
        boards=rows["boards"],
        worlds=", ".join(map(markdown_code, worlds)),
        split=markdown_code(info.split),
        seed=info.seed,
        steps=sum(row["steps"] for row in episodes),
        version=__version__,
        policy=markdown_code(info.collect.policy) if info.collect else "unknown",
        policy_seed=info.collect.seed if info.collect else "unknown",
        hashes=dataset.hashes(),
        generator=markdown_text(info.generator.version),
        config=markdown_code(json.dumps(info.generator.config, sort_keys=True)),
        objects=markdown_text(f"{info.assets.name} ({len(info.assets.sha256)})"),
        columns="\n\n".join(columns),
    )
