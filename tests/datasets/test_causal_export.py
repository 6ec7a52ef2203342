"""Tables for causal discovery: they hold all that decides the responders, and say what they are."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.datasets.exporting.causal import COLUMNS, export_causal
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from tests.cli.commands import busybot
from tests.episodes.folders import make_dataset
from tests.episodes.symbolic import library_at, make_world_dataset

Objects = Callable[[int], Path]
ROOT = Path(__file__).resolve().parents[2]


def exported(tmp_path: Path, folder: Path, world: str, split: str = "train") -> Path:
    dataset = make_world_dataset(tmp_path / "data", folder, world, split=split)
    export_causal(dataset, library_at(folder), tmp_path / "out")
    return tmp_path / "out"


class Tables:
    """The tables of one board, as a reader who knows nothing of busybot has them."""

    def __init__(self, folder: Path, board: int):
        loaded = {name: pd.read_parquet(folder / f"{name}.parquet") for name in COLUMNS}
        self.states, self.variables, self.graph, self.locks, self.boards = (
            table[table.board == board] for table in loaded.values()
        )
        self.data = self.states.pivot(index="step", columns="variable", values="state")
        self.sizes = self.variables.set_index("variable").states


def rebuilt(tables: Tables) -> pd.DataFrame:
    """States of all responders from the graph and the links' states, by the specifications of the kinds."""
    steps, found = len(tables.data), tables.data.copy()
    for (child, since), edges in tables.graph.groupby(["child", "since"]):
        first = edges.sort_values("input").iloc[0]
        edges = edges[edges.input.notna()].sort_values("input")
        until = steps if pd.isna(first.until) else int(first.until)
        inputs = [list(tables.data[parent]) for parent in edges.parent]
        states = decided(
            first, inputs, [int(tables.sizes[p]) for p in edges.parent], list(map(int, edges.lag)), int(since), until
        )
        found.loc[since : until - 1, child] = np.array(states, np.int8)
    return found


def decided(
    edge: pd.Series, inputs: list[list[int]], sizes: list[int], lags: list[int], since: int, until: int
) -> list[int]:
    """States from `since` to `until`; before `since` everything had rested as it was then."""
    table, told = json.loads(edge.table), json.loads(edge.parameters)

    def row(step: int) -> int:
        number = 0
        for values, size, late in zip(inputs, sizes, lags, strict=True):
            number = number * size + values[max(step - late, since)]
        return number

    def presses(place: int, step: int) -> bool:
        return step > since and inputs[place][step - 1] != inputs[place][step] == sizes[place] - 1

    steps = range(since, until)
    if edge.kind == "timer":
        return [table[any(presses(0, k - back) for back in range(told["actions"]))] for k in steps]
    if edge.kind == "toggle":
        return [table[sum(presses(0, k) for k in range(since, step + 1)) % 2] for step in steps]
    if edge.kind == "latch":
        on, found = told["first"], []
        for step in steps:
            on = 1 if presses(0, step) else 0 if presses(1, step) else on
            found.append(table[on])
        return found
    return [table[row(step)] for step in steps]


@pytest.mark.parametrize(
    ("world", "split"),
    [
        ("gates", "train"), ("gates", "novel-mechanism"), ("time", "train"), ("time", "novel-mechanism"),
        ("lock", "train"), ("rewired", "train"), ("paper", "train"),
    ],
)  # fmt: skip
def test_the_responders_follow_from_the_tables_alone(
    world: str, split: str, few_objects: Objects, tmp_path: Path
) -> None:
    folder = exported(tmp_path, few_objects(0), world, split)
    for board in range(3):
        tables = Tables(folder, board)
        assert not tables.graph.chance.any() and tables.data.shape[0] == 31
        pd.testing.assert_frame_equal(rebuilt(tables), tables.data)
        assert tables.data.nunique().max() > 1, "something happened"
    if world == "rewired":
        assert (pd.read_parquet(folder / "graph.parquet").since > 20).any()
    if world == "lock":
        assert len(pd.read_parquet(folder / "locks.parquet")) >= 3


def test_interventions_are_the_moves_of_single_links(few_objects: Objects, tmp_path: Path) -> None:
    folder = exported(tmp_path, few_objects(0), "lock")
    for board in range(3):
        tables = Tables(folder, board)
        moved = tables.states.pivot(index="step", columns="variable", values="moved")
        tried = tables.states.pivot(index="step", columns="variable", values="attempted")
        links = list(tables.variables[tables.variables.role == "link"].variable)
        pd.testing.assert_frame_equal(moved[links].iloc[1:], tables.data[links].diff().iloc[1:] != 0)
        assert tried.sum(axis=1).max() == 1 and not (moved & ~tried).any(axis=None)
        assert int(moved.sum().sum()) == int(tables.boards.moved.iloc[0]) < tried.sum().sum(), "locks and rests"
        for lock in tables.locks.itertuples():
            held = ~tables.data[lock.responder].isin(json.loads(lock.open_states)).shift(1, fill_value=False)
            assert not moved[lock.link][held].any(), "a held link does not move"


def test_what_luck_and_clocks_decide_is_named(few_objects: Objects, tmp_path: Path) -> None:
    folder = exported(tmp_path, few_objects(0), "chance")
    graph, variables = (pd.read_parquet(folder / f"{name}.parquet") for name in ("graph", "variables"))
    assert {"unreliable", "clock"} <= set(graph[graph.chance].kind) <= {"unreliable", "flicker", "clock"}
    assert set(graph[~graph.chance].kind) <= {"rest"}
    clocked = graph[graph.clock.notna()]
    assert (clocked.parent == "clock").all() and clocked.groupby("board").size().between(2, 3).all()
    assert set(variables[variables.role == "clock"].board) == set(clocked.board) and len(clocked)
    assert graph[graph.kind == "flicker"].parent.isna().all()
    states = pd.read_parquet(folder / "states.parquet")
    assert "clock" not in set(states.variable), "it is hidden"
    for board, together in clocked.groupby("board"):
        data = Tables(folder, int(board)).data[list(together.child)]
        flips = data.diff().iloc[1:] != 0
        assert flips.nunique(axis=1).max() == 1, "what one clock moves changes together"


def test_a_responder_that_another_one_reads_acts_a_step_later(few_objects: Objects, tmp_path: Path) -> None:
    folder = exported(tmp_path, few_objects(0), "chain")
    graph, variables = (pd.read_parquet(folder / f"{name}.parquet") for name in ("graph", "variables"))
    read = graph.merge(variables, left_on=["board", "parent"], right_on=["board", "variable"])
    chained = read[read.role == "responder"]
    assert len(chained) and (chained.lag == 1).all() and (read[read.role == "link"].lag == 0).all()


def test_three_lines_of_pandas_load_it(few_objects: Objects, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of the card, which are those of the guide."""
    folder = exported(tmp_path, few_objects(0), "gates")
    text = (folder / "README.md").read_text()
    lines = [line.strip() for line in text.splitlines() if line.startswith("    ")]
    assert len(lines) == 3
    assert all(line in (ROOT / "docs/guides/share-a-dataset.md").read_text() for line in lines)
    monkeypatch.chdir(folder)
    found: dict = {}
    exec("\n".join(lines), found)
    assert found["data"].shape[0] == 31 and not found["data"].isna().any(axis=None)


def test_the_card_says_what_every_column_means(few_objects: Objects, tmp_path: Path) -> None:
    folder = exported(tmp_path, few_objects(0), "mixed")
    text, hashes = (folder / "README.md").read_text(), Dataset.open(tmp_path / "data").hashes()
    assert {f"{name}.parquet" for name in COLUMNS} | {"README.md"} == {path.name for path in folder.iterdir()}
    for name, columns in COLUMNS.items():
        schema = pq.read_schema(folder / f"{name}.parquet")
        assert schema.names == [column.name for column in columns]
        for column in columns:
            assert f"| `{column.name}` |" in text and column.description in text
            assert schema.field(column.name).metadata[b"description"].decode() == column.description
    for fact in (hashes.board, hashes.trace, hashes.content, "world `mixed`", "seed 0", "90 recorded steps"):
        assert fact in text, fact


def test_the_file_of_boards_is_not_read_for_each_of_them(
    few_objects: Objects, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset, read, original = make_world_dataset(tmp_path / "data", few_objects(0), "gates"), [], Dataset._lines
    monkeypatch.setattr(Dataset, "_lines", lambda self, shard: (read.append(shard), original(self, shard))[1])
    assert export_causal(dataset, library_at(few_objects(0)), tmp_path / "out").boards > 1
    assert len(read) == 2  # for the links, and for the hashes that the card tells


def test_words_of_a_strangers_dataset_stay_words(tmp_path: Path, few_objects: Objects) -> None:
    dataset = make_world_dataset(tmp_path / "data", few_objects(0), "gates", boards=1)
    evil = "<script>alert(1)</script> [x](http://evil) `code`\n# heading"
    info = dataset.info.model_copy(update={"name": evil})
    (tmp_path / "data" / "dataset.json").write_text(info.model_dump_json())
    export_causal(Dataset.open(tmp_path / "data"), library_at(few_objects(0)), tmp_path / "out")
    body = (tmp_path / "out" / "README.md").read_text().split("---", 2)[2]
    assert "<script>" not in body and "[x](" not in body and "\n# heading" not in body


def test_only_a_new_folder_is_written(few_objects: Objects, tmp_path: Path) -> None:
    folder = few_objects(0)
    dataset = make_world_dataset(tmp_path / "data", folder, "gates", boards=1)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "precious").write_text("kept")
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    for place, what in (("mine", "not an empty folder"), ("link", "not an empty folder"), ("data/x", "in the dataset")):
        with pytest.raises(BusybotError, match=what) as error:
            export_causal(dataset, library_at(folder), tmp_path / place)
        assert error.value.hint
    assert [p.name for p in (tmp_path / "mine").iterdir()] == ["precious"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["data", "link", "mine"], "nothing half done is left"


def blinded(episode: Episode) -> Episode:
    """As from a real board, whose states nobody knows."""
    whens = ("before", "after")
    names = [f"{name}_{when}" for name in ("trigger_states", "responder_states", "joint_positions") for when in whens]
    unknown: dict = dict.fromkeys([*names, "memory_after"], ())
    unknown |= {"acted_object": -1, "acted_link": "", "success": False}
    steps = [replace(step, **unknown) for step in episode.steps]
    return replace(episode, links=tuple(link for link in episode.links if not link.trigger), steps=steps)


def test_recordings_without_states_or_with_other_objects_are_refused(few_objects: Objects, tmp_path: Path) -> None:
    folder = few_objects(0)
    dataset = make_world_dataset(tmp_path / "data", folder, "gates", boards=1)
    file = dataset.episode_path(0)
    episode, kept = read_episode(file), file.read_bytes()
    renamed = tuple(replace(link, name=f"{link.name}-x") if link.trigger else link for link in episode.links)
    for other, fault in ((blinded(episode), "knows no states"), (replace(episode, links=renamed), "trigger links")):
        write_episode(file, other, "png")
        with pytest.raises(BusybotError, match=fault) as error:
            export_causal(Dataset.open(tmp_path / "data"), library_at(folder), tmp_path / "out")
        assert "000000.mcap" in error.value.what and error.value.hint
        file.write_bytes(kept)
    shutil.rmtree(tmp_path / "data" / "episodes")
    with pytest.raises(BusybotError, match="no board has an episode"):
        export_causal(Dataset.open(tmp_path / "data"), library_at(folder), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_command_says_what_it_wrote(few_objects: Objects, tmp_path: Path) -> None:
    make_world_dataset(tmp_path / "data", few_objects(0), "mixed", boards=2)
    out = tmp_path / "out"
    done = busybot(
        "dataset", "export", tmp_path / "data", "--format", "causal", "--out", out,
        "--assets", few_objects(0), "--workers", "1", "--json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["boards"] == 2 and told["format"] == "causal" and told["out"] == str(out)
    assert told["rows"] == {name: len(pd.read_parquet(out / f"{name}.parquet")) for name in COLUMNS}
    again = busybot("dataset", "export", tmp_path / "data", "--out", out, "--assets", few_objects(0))
    assert again.returncode == 1 and "not an empty folder" in again.stderr
    assert (
        busybot("dataset", "export", make_dataset(tmp_path / "d").path, "--format", "x", "--out", out).returncode == 2
    )
