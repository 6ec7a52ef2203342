"""A dataset's folder: made once, continued safely, never left through a link."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from busybot.boards.config import BoardConfig
from busybot.common.atomic_io import remove
from busybot.common.errors import BusybotError
from busybot.datasets import dataset as module
from busybot.datasets import verify as verifying
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import collect_command, name_of
from busybot.datasets.verify import verify
from busybot.episodes.mcap.writer import write_episode
from busybot.episodes.tables import MADE_OF_KEY, episode_rows, read_shard, write_shard
from busybot.objects.library import Library
from tests.episodes.folders import COLLECT, make_dataset
from tests.episodes.synthetic import make_board, make_episode, make_real_episode


def edit_info(path: Path, **values: object) -> None:
    file = path / "dataset.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **values}))


def test_what_is_created_is_what_is_opened(tmp_path: Path) -> None:
    made = make_dataset(tmp_path / "d")
    found = Dataset.open(tmp_path / "d")
    assert found.info == made.info and found.info.collect == COLLECT
    assert found.boards() == [make_board(i) for i in range(4)]
    assert found.board(2) == make_board(2)
    assert found.finished() == {0, 1, 3}
    names = {str(p.relative_to(tmp_path / "d")) for p in (tmp_path / "d").rglob("*") if p.is_file()}
    assert names == {
        "dataset.json",
        "boards/boards-00000.jsonl",
        *(f"episodes/00000{i}.mcap" for i in (0, 1, 3)),
        *(f"tables/{name}/part-00000.parquet" for name in ("episodes", "steps", "objects")),
    }


def test_boards_are_spread_over_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "BOARDS_PER_SHARD", 3)
    dataset = make_dataset(tmp_path / "d", boards=7, finished=())
    assert sorted(p.name for p in (tmp_path / "d/boards").iterdir()) == [f"boards-0000{i}.jsonl" for i in range(3)]
    assert [board.index for board in dataset.boards()] == list(range(7))
    assert dataset.board(6).index == 6


def test_a_folder_with_something_in_it_is_not_overwritten(tmp_path: Path) -> None:
    info = make_dataset(tmp_path / "d").info
    for path in (tmp_path / "d", tmp_path / "d/dataset.json"):
        with pytest.raises(BusybotError, match="not an empty folder") as error:
            Dataset.create(path, info, [])
        assert error.value.hint
    (tmp_path / "empty").mkdir()
    Dataset.create(tmp_path / "empty", info.model_copy(update={"boards": 0}))
    with pytest.raises(BusybotError, match="1 boards where 4 were announced"):
        Dataset.create(tmp_path / "e", info, [make_board(0)])
    with pytest.raises(BusybotError, match="board 1 stands at place 0"):
        Dataset.create(tmp_path / "f", info, [make_board(1)])


def test_what_is_no_dataset_is_refused_with_the_reason(tmp_path: Path) -> None:
    with pytest.raises(BusybotError, match="no such folder"):
        Dataset.open(tmp_path / "absent")
    with pytest.raises(BusybotError, match="not a dataset"):
        Dataset.open(tmp_path)
    path = make_dataset(tmp_path / "d", finished=()).path
    for values, what in (
        ({"schema_version": "9.0"}, "schema version 9.0; this installation reads 1.2"),
        ({"boards": -1}, "boards: Input should be greater"),
        ({"surprise": 1}, "surprise: Extra inputs"),
    ):
        edit_info(path, **values)
        with pytest.raises(BusybotError, match=what):
            Dataset.open(path)
        shutil.rmtree(path)
        make_dataset(path, finished=())
    (path / "dataset.json").write_text("{")
    with pytest.raises(BusybotError, match="not valid JSON"):
        Dataset.open(path)


@pytest.mark.parametrize(("group", "name"), [("generator", "config"), ("collect", "settings")])
def test_values_so_deep_that_nobody_can_write_them_are_refused(group: str, name: str, tmp_path: Path) -> None:
    """Freezing and comparing would fall over them."""
    path = make_dataset(tmp_path / "d").path
    told = json.loads((path / "dataset.json").read_text())
    for depth in (99, 100, 300):
        value: Any = 1
        for _ in range(depth):
            value = [value] if depth % 2 else {"a": value}
        told[group][name] = {"deep": value}
        (path / "dataset.json").write_text(json.dumps(told))
        if depth < 100:
            assert Dataset.open(path).info.model_dump(mode="json")[group][name] == told[group][name]
            continue
        with pytest.raises(BusybotError, match=rf"dataset.json: {group}.{name}: it has more than 100 levels"):
            Dataset.open(path)


def test_damaged_boards_are_named_with_their_line(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "d", finished=())
    file = tmp_path / "d/boards/boards-00000.jsonl"
    lines = file.read_text().splitlines()
    file.write_text("\n".join([lines[0], lines[1].replace("train", ""), *lines[2:]]))
    with pytest.raises(BusybotError, match="boards-00000.jsonl: line 2"):
        dataset.boards()
    file.write_text("\n".join(lines[:2]))
    with pytest.raises(BusybotError, match="it should have 4 lines, one for each board, and has 2"):
        dataset.board(0)


def test_boards_and_episodes_that_do_not_exist_are_refused(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "d", finished=())
    for call in (dataset.board, dataset.episode_path):
        for index in (-1, 4):
            with pytest.raises(BusybotError, match=str(index)):
                call(index)


def test_collecting_continues_only_with_the_recorded_settings(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "d")
    Dataset.open(dataset.path).begin_collecting(COLLECT)
    other = COLLECT.model_copy(update={"delta": 7, "strict": True})
    with pytest.raises(BusybotError, match="delta 20, now 7; strict False, now True"):
        Dataset.open(dataset.path).begin_collecting(other)


def test_what_a_killed_writer_left_is_ignored_and_removed(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "d")
    gone = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True, check=True)
    left = tmp_path / f"d/episodes/.000002.mcap.{int(gone.stdout)}.tmp"
    alive = tmp_path / f"d/episodes/.000002.mcap.{os.getpid()}.tmp"
    for file in (left, alive):
        file.write_bytes(b"half")
    assert dataset.finished() == {0, 1, 3}
    assert dataset.remove_leftovers() == 1
    assert not left.exists() and alive.exists()


def test_only_episodes_of_the_dataset_count(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "d")
    for name in ("000099.mcap", "1.mcap", "0000002.mcap", "000002.mcap\n", "000002.mcap.bak", "notes.txt"):
        (tmp_path / "d/episodes" / name).write_bytes(b"")
    assert dataset.finished() == {0, 1, 3}
    odd = tmp_path / "d/episodes/000002.mcap"
    for make in (lambda: odd.symlink_to(dataset.episode_path(0)), odd.mkdir, lambda: os.mkfifo(odd)):
        make()
        with pytest.raises(BusybotError, match="000002.mcap: a link, or no regular file"):
            dataset.finished()
        remove(odd)
    (tmp_path / "d/episodes").rename(tmp_path / "d/away")
    (tmp_path / "d/episodes").touch()
    with pytest.raises(BusybotError, match="episodes: not a folder"):
        dataset.finished()


def test_nothing_is_read_through_a_link_that_leaves(tmp_path: Path) -> None:
    outside = make_dataset(tmp_path / "outside")
    dataset = make_dataset(tmp_path / "d")
    (tmp_path / "d/episodes/000002.mcap").symlink_to(outside.episode_path(0))
    with pytest.raises(BusybotError, match="leaves the folder"):
        dataset.episode_path(2)
    for name in ("episodes", "boards", "tables"):
        shutil.rmtree(tmp_path / "d" / name)
        (tmp_path / "d" / name).symlink_to(tmp_path / "outside" / name)
    for call in (dataset.finished, dataset.boards, dataset.write_tables, lambda: dataset.table("steps")):
        with pytest.raises(BusybotError, match="leaves the folder"):
            call()


def test_one_collector_at_a_time(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "d", finished=())
    refused = pytest.raises(BusybotError, match="another process")
    with dataset.locked(), refused, Dataset.open(dataset.path).locked():
        pass
    with dataset.locked():
        pass


def derived(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Numbers of the episodes whose rows are derived from their files from now on."""
    found: list[int] = []
    monkeypatch.setattr(module, "episode_rows", lambda path, index: found.append(index) or episode_rows(path, index))
    return found


def test_tables_follow_the_episodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = make_dataset(tmp_path / "d")
    read = derived(monkeypatch)
    dataset.write_tables()
    assert not read, "up to date"
    write_episode(dataset.episode_path(2), make_episode(2))
    dataset.write_tables()
    assert read == [2], "only what is missing"
    assert dataset.table("episodes")["episode"].to_pylist() == [0, 1, 2, 3]
    write_episode(dataset.episode_path(1), make_episode(1, steps=3))
    dataset.write_tables()
    assert read == [2, 1], "what has changed since"
    write_episode(dataset.episode_path(1), make_episode(1))
    dataset.write_tables({1: episode_rows(dataset.episode_path(1), 1)})
    assert read == [2, 1], "what is given is taken"
    assert dataset.table("steps").num_rows == 24
    dataset.episode_path(3).unlink()
    dataset.write_tables()
    assert dataset.table("episodes")["episode"].to_pylist() == [0, 1, 2]


def test_what_is_stored_on_the_way_costs_its_own_shards_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "EPISODES_PER_SHARD", 2)
    dataset = make_dataset(tmp_path / "d", boards=6, finished=(0, 1, 2))
    touched: list[int] = []
    stored_rows = Dataset.stored_rows
    monkeypatch.setattr(Dataset, "stored_rows", lambda self, shard: touched.append(shard) or stored_rows(self, shard))
    for index in (3, 5):
        write_episode(dataset.episode_path(index), make_episode(index))
    dataset.store_rows({index: episode_rows(dataset.episode_path(index), index) for index in (3, 5)})
    assert touched == [1, 2] and dataset.table("episodes")["episode"].to_pylist() == [0, 1, 2, 3, 5]
    before = {name: dataset.table(name) for name in ("episodes", "steps", "objects")}
    dataset.write_tables()
    assert all(dataset.table(name).equals(table) for name, table in before.items())


def test_boards_are_drawn_while_they_are_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "BOARDS_PER_SHARD", 2)
    info = make_dataset(tmp_path / "d").info
    written: list[int] = []

    def drawn():
        for index in range(4):
            written.append(len(list(tmp_path.rglob(".e-*/boards/boards-*.jsonl"))))
            yield make_board(index)

    dataset = Dataset.create(tmp_path / "e", lambda: info.model_copy(update={"name": f"after {len(written)}"}), drawn())
    assert written == [0, 0, 1, 1] and Dataset.open(tmp_path / "e").info.name == dataset.info.name == "after 4"
    assert dataset.boards() == list(dataset.each_board()) == [make_board(index) for index in range(4)]


def test_tables_can_always_be_made_again(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "d")
    expected = {name: dataset.table(name) for name in ("episodes", "steps", "objects")}
    shutil.rmtree(tmp_path / "d/tables")
    dataset.write_tables()
    assert all(dataset.table(name).equals(table) for name, table in expected.items())
    (tmp_path / "d/tables/steps/part-00000.parquet").write_bytes(b"broken")
    dataset.write_tables()
    assert dataset.table("steps").equals(expected["steps"])


def test_hashes_depend_on_values_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = make_dataset(tmp_path / "one", boards=5, finished=range(5)).hashes()
    monkeypatch.setattr(module, "EPISODES_PER_SHARD", 2)
    monkeypatch.setattr(module, "BOARDS_PER_SHARD", 2)
    other = make_dataset(tmp_path / "elsewhere/two", boards=5, finished=(4, 2, 0, 1, 3))
    assert sorted(p.name for p in (other.path / "tables/steps").iterdir()) == [
        f"part-0000{i}.parquet" for i in range(3)
    ]
    assert other.hashes() == one
    shutil.rmtree(other.path / "tables")
    assert other.hashes() == one, "without tables they are derived from the episodes"
    png = make_dataset(tmp_path / "png", boards=5, finished=range(5), images="png").hashes()
    assert (png.board, png.trace) == (one.board, one.trace) and png.content != one.content
    fewer = make_dataset(tmp_path / "fewer", boards=5, finished=range(4)).hashes()
    assert fewer.board == one.board and fewer.trace != one.trace and fewer.content != one.content


def test_rows_that_the_tables_lack_are_derived_once_for_all_who_ask(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A collection that was killed lacks up to a shard of them."""
    dataset = make_dataset(tmp_path / "d")
    known = dataset.episodes_table()
    shutil.rmtree(dataset.path / "tables")
    asked = derived(monkeypatch)
    assert dataset.episodes_table().equals(known) and dataset.episodes_table().equals(known)
    assert dataset.episodes_table(["steps", "bytes"]).equals(known.select(["steps", "bytes"]))
    assert asked == [0, 1, 3]
    write_episode(dataset.episode_path(1), make_episode(7))
    changed = dataset.episodes_table()
    assert (
        asked == [0, 1, 3, 1]
        and not changed.equals(known)
        and changed.equals(Dataset.open(dataset.path).episodes_table())
    )


def test_tables_whose_episodes_are_all_gone_are_refused(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "d")
    for index in dataset.finished():
        dataset.episode_path(index).unlink()
    with pytest.raises(BusybotError, match="it has no table 'steps' yet"):
        dataset.to_pandas()


@pytest.mark.parametrize("settings", [{"chooser": 1, "render": 2}, {"chooser": "until_known", "render": "camera"}])
def test_the_command_that_goes_on_copes_with_settings_of_another_form(settings: dict, tmp_path: Path) -> None:
    info = make_dataset(tmp_path / "d").info
    collect = COLLECT.model_copy(update={"settings": settings})
    told = collect_command(tmp_path / "d", info.model_copy(update={"collect": collect}))
    assert told == f"busybot collect {tmp_path / 'd'} --steps 6 --policy random --set interaction.delta=20"


def test_whole_shards_without_episodes_disappear(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "EPISODES_PER_SHARD", 2)
    dataset = make_dataset(tmp_path / "d")
    dataset.episode_path(3).unlink()
    dataset.write_tables()
    assert [p.name for p in (tmp_path / "d/tables/steps").iterdir()] == ["part-00000.parquet"]


@pytest.mark.parametrize("table", ["episodes", "steps", "objects"])
def test_tables_torn_by_a_stop_are_mended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, table: str) -> None:
    """A writer is stopped before it writes one of the three tables; the next one leaves all of them whole."""
    dataset = make_dataset(tmp_path / "d")
    write_episode(dataset.episode_path(2), make_episode(2))

    def stopped(path: Path, name: str, rows: list[object], root: Path, made_of: str) -> None:
        if name == table:
            raise KeyboardInterrupt
        write_shard(path, name, rows, root, made_of)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(module, "write_shard", stopped)
        dataset.write_tables()
    dataset.write_tables()
    for name in ("episodes", "steps", "objects"):
        assert set(dataset.table(name)["episode"].to_pylist()) == {0, 1, 2, 3}
    assert verify(dataset.path).ok


def test_an_episode_has_one_row_whatever_a_table_says(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "d")
    whole, file = dataset.episodes_table(), dataset.table_path("episodes", 0)
    rows, hashes = read_shard(file, "episodes"), dataset.hashes()
    write_shard(file, "episodes", [rows.slice(0, 1), rows], made_of=rows.schema.metadata[MADE_OF_KEY].decode())
    again = Dataset.open(dataset.path)
    assert again.episodes_table().equals(whole) and again.hashes() == hashes
    with pytest.raises(BusybotError, match="several rows of an episode"):
        again.table("episodes")
    again.write_tables()
    assert Dataset.open(dataset.path).table("episodes").equals(whole)


@pytest.mark.parametrize("table", ["steps", "objects"])
def test_tables_hold_no_more_rows_than_the_episodes_have(table: str, tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "d")
    whole, file = dataset.table(table), dataset.table_path(table, 0)
    rows = read_shard(file, table)
    write_shard(file, table, [rows, rows.slice(0, 1)], made_of=rows.schema.metadata[MADE_OF_KEY].decode())
    with pytest.raises(BusybotError, match="rows, at most .* belong to its episodes"):
        dataset.table(table)
    dataset.write_tables()
    assert dataset.table(table).equals(whole)


def test_tables_of_boards_without_objects_are_not_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = make_dataset(tmp_path / "d", finished=())
    episode = make_real_episode()
    write_episode(
        dataset.episode_path(0),
        replace(
            episode,
            board=episode.board.model_copy(update={"objects": (), "relations": ()}),
            positions=np.zeros((0, 3), np.float32),
            images=[replace(image, boxes=np.zeros((0, 4), np.int16)) for image in episode.images],
        ),
    )
    dataset.write_tables()
    read = derived(monkeypatch)
    dataset.write_tables()
    assert not read and dataset.table("objects").num_rows == 0


def grown(dataset: Dataset, boards: int) -> Dataset:
    info = dataset.info.model_copy(update={"boards": boards})
    return dataset.grow(lambda: info, map(make_board, range(boards)))


@pytest.mark.parametrize("more", [5, 9])
def test_a_dataset_whose_growth_was_killed_is_as_before_and_grows_otherwise(
    more: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed when the boards are there and `dataset.json` does not tell of them yet."""
    for who in (module, verifying):
        monkeypatch.setattr(who, "BOARDS_PER_SHARD", 6)
    dataset = make_dataset(tmp_path / "d")
    hashes = dataset.hashes()

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(module, "write_json", killed)
        grown(dataset, 14)
    found = Dataset.open(dataset.path)
    assert found.info.boards == 4 and found.hashes() == hashes and found.boards() == [make_board(i) for i in range(4)]
    if more == 14:
        with found.locked():
            assert found.remove_leftovers() > 0
        assert verify(dataset.path).ok and found.hashes() == hashes
    assert Dataset.open(grown(found, more).path).boards() == [make_board(i) for i in range(more)]
    assert verify(dataset.path).ok, "nothing is left of the boards that were not told of"


@pytest.mark.parametrize("name", ["a" * 220, os.fsdecode(b"toys-\xff")])
def test_any_folder_can_hold_a_dataset(name: str, tmp_path: Path, few_objects: Callable[[int], Path]) -> None:
    made = create_dataset(tmp_path / name, BoardConfig(boards=1), Library.load(few_objects(0)))
    assert Dataset.open(made.path).info.name == name_of(name) == name.replace("\udcff", "?")[:200]


def test_settings_of_a_failed_start_do_not_bind(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "d", finished=())
    dataset.begin_collecting(COLLECT.model_copy(update={"steps": 9}))
    assert Dataset.open(dataset.path).info.collect.steps == 9  # type: ignore[union-attr]


def test_settings_that_another_process_recorded_meanwhile_are_seen(tmp_path: Path) -> None:
    early = make_dataset(tmp_path / "d", finished=())
    late = Dataset.open(early.path)
    late.begin_collecting(COLLECT.model_copy(update={"policy": "scripted"}))
    write_episode(late.episode_path(0), make_episode(0))
    with pytest.raises(BusybotError, match="policy 'scripted', now 'random'"):
        early.begin_collecting(COLLECT)
