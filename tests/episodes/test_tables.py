"""Rows: derived from files, the same after Parquet."""

from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from busybot.common.errors import BusybotError
from busybot.episodes import tables as module
from busybot.episodes.mcap.writer import write_episode
from busybot.episodes.schema import TABLES, arrow_schema
from busybot.episodes.tables import (
    EPISODES_PER_SHARD,
    counts_of,
    episode_rows,
    read_shard,
    split_by_episode,
    write_shard,
)
from tests.episodes.synthetic import KEYS, make_episode, make_real_episode


def rows_of(episode, path: Path, index: int = 0) -> dict[str, pd.DataFrame]:
    write_episode(path, episode)
    return {name: table.to_pandas() for name, table in episode_rows(path, index).items()}


def test_steps_say_what_was_done_and_what_happened(tmp_path: Path) -> None:
    episode = make_episode(3)
    steps = rows_of(episode, tmp_path / "e.mcap", 3)["steps"]
    assert list(steps.step) == list(range(6)) and (steps.episode == 3).all()
    for k, step in enumerate(episode.steps):
        row = steps.iloc[k]
        assert (row.pixel_u, row.pixel_v) == step.pixel
        assert (row.position_x, row.position_y, row.position_z) == step.position
        assert row.direction_x**2 + row.direction_y**2 + row.direction_z**2 == pytest.approx(1)
        assert tuple(row.executed) == step.executed
        assert tuple(row.trigger_states_after) == step.trigger_states_after
        assert (row.image_before, row.image_after) == tuple(episode.frame_of[k : k + 2])
        assert (row.success, row.acted_object, row.reward) == (step.success, step.acted_object, step.reward)


def test_objects_have_a_row_per_frame_with_first_and_current_box(tmp_path: Path) -> None:
    episode = make_episode()
    objects = rows_of(episode, tmp_path / "e.mcap")["objects"]
    assert len(objects) == len(episode.frame_of) * len(KEYS)
    last = objects[(objects.frame == 6) & (objects.object == 2)].iloc[0]
    assert [last.first_box_u0, last.first_box_v0, last.first_box_u1, last.first_box_v1] == list(
        episode.images[0].boxes[2]
    )
    assert [last.box_u0, last.box_v0, last.box_u1, last.box_v1] == list(episode.images[-1].boxes[2])
    assert (last.role, last.category, last.instance) == ("responder", "Door", "d1")
    assert last.position_x == pytest.approx(float(episode.positions[2, 0]))
    door = objects[objects.object == 2]
    assert door.box_v0.nunique() == 2 and door.first_box_v0.nunique() == 1


def test_the_episode_row_sums_up(tmp_path: Path) -> None:
    row = rows_of(make_episode(), tmp_path / "e.mcap")["episodes"].iloc[0]
    assert (row.steps, row.images, row.objects, row.successes) == (6, 5, 5, 4)
    assert row.bytes == (tmp_path / "e.mcap").stat().st_size
    assert (row.image_format, row.delta, row.strict, row.truth) == ("jpeg", 20, False, True)
    assert len(row.content_digest) == 64


def test_a_recording_from_elsewhere_has_nulls_where_it_cannot_know(tmp_path: Path) -> None:
    write_episode(tmp_path / "e.mcap", make_real_episode())
    tables = episode_rows(tmp_path / "e.mcap", 0)
    unknown = {
        "steps": {c.name for c in TABLES["steps"] if c.privileged} | {"pixel_u", "pixel_v"},
        "episodes": {"successes", "delta", "strict"},
        "objects": {c for c in tables["objects"].column_names if c.startswith(("box", "first_box", "position"))},
    }
    for name, columns in unknown.items():
        assert {c for c in tables[name].column_names if tables[name][c].null_count} == columns
        assert all(tables[name][c].null_count == tables[name].num_rows for c in columns)
        write_shard(tmp_path / name, name, [tables[name]])
        assert read_shard(tmp_path / name, name).equals(tables[name])
    assert tables["episodes"]["truth"].to_pylist() == [False]


@pytest.mark.parametrize("table", TABLES)
def test_rows_are_the_same_after_parquet(tmp_path: Path, table: str) -> None:
    episodes = {}
    for index in (0, 1, 30):
        write_episode(tmp_path / "e.mcap", make_episode(index, steps=index % 3 + 1))
        episodes[index] = episode_rows(tmp_path / "e.mcap", index)[table]
    write_shard(tmp_path / "part", table, episodes.values())
    back = split_by_episode(read_shard(tmp_path / "part", table))
    assert set(back) == set(episodes)
    assert all(back[i].equals(episodes[i]) for i in episodes)
    assert pd.read_parquet(tmp_path / "part").columns.tolist() == arrow_schema(table).names


def test_shards_are_written_the_same_each_time(tmp_path: Path) -> None:
    write_episode(tmp_path / "e.mcap", make_episode())
    rows = episode_rows(tmp_path / "e.mcap", 0)["steps"]
    for name in ("a", "b"):
        write_shard(tmp_path / name, "steps", [rows])
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_more_than_there_can_be_is_refused_before_it_is_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_episode(tmp_path / "e.mcap", make_episode())
    rows = episode_rows(tmp_path / "e.mcap", 0)
    write_shard(tmp_path / "episodes", "episodes", [rows["episodes"]] * (EPISODES_PER_SHARD + 1))
    write_shard(tmp_path / "steps", "steps", [rows["steps"]])
    told = counts_of(rows["episodes"])
    assert told == {name: table.num_rows for name, table in rows.items()} and told["steps"] == 6
    assert read_shard(tmp_path / "steps", "steps", most=6).num_rows == 6
    monkeypatch.setattr(pq.ParquetFile, "read", lambda *_, **__: pytest.fail("decoded"))
    with pytest.raises(BusybotError, match="501 rows, at most 500"):
        read_shard(tmp_path / "episodes", "episodes")
    with pytest.raises(BusybotError, match="6 rows, at most 5"):
        read_shard(tmp_path / "steps", "steps", most=5)
    monkeypatch.setattr(module, "MAX_SHARD_MEMORY", 500)
    with pytest.raises(BusybotError, match="bytes of values, at most 500"):
        read_shard(tmp_path / "steps", "steps")


def test_a_text_that_is_stored_once_counts_as_often_as_it_stands_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_episode(tmp_path / "e.mcap", make_episode())
    row = episode_rows(tmp_path / "e.mcap", 0)["episodes"]
    place, long = row.schema.get_field_index("settings"), pa.array(["x" * 100_000])
    row = row.set_column(place, row.schema.field(place), long)
    rows = [row.set_column(0, row.schema.field(0), pa.array([number], pa.int32())) for number in range(100)]
    write_shard(tmp_path / "part", "episodes", rows)
    assert read_shard(tmp_path / "part", "episodes").equals(pa.concat_tables(rows))
    assert (tmp_path / "part").stat().st_size < 100_000
    monkeypatch.setattr(module, "MAX_SHARD_MEMORY", 5_000_000)
    with pytest.raises(BusybotError, match="bytes of values, at most 5,000,000"):
        read_shard(tmp_path / "part", "episodes")


def test_nulls_and_columns_of_one_name_are_refused(tmp_path: Path) -> None:
    write_episode(tmp_path / "e.mcap", make_episode())
    rows = episode_rows(tmp_path / "e.mcap", 0)["episodes"].drop_columns(["checksum"])  # as of the first version
    pq.write_table(rows.append_column("steps", rows["steps"]), tmp_path / "twice")
    place = rows.schema.get_field_index("steps")
    pq.write_table(rows.set_column(place, "steps", pa.nulls(1, pa.int32())), tmp_path / "nulls")
    for name in ("twice", "nulls"):
        with pytest.raises(BusybotError, match="not a readable Parquet file: .*steps"):
            read_shard(tmp_path / name, "episodes")


def test_what_is_no_table_of_this_schema_is_refused(tmp_path: Path) -> None:
    (tmp_path / "part").write_bytes(b"PAR1" * 9)
    with pytest.raises(BusybotError, match="not a readable Parquet file"):
        read_shard(tmp_path / "part", "steps")
    with pytest.raises(BusybotError, match="there is no such file"):
        read_shard(tmp_path / "absent", "steps")
    pd.DataFrame({"episode": [1]}).to_parquet(tmp_path / "part")
    with pytest.raises(BusybotError, match="not table 'steps' of this schema version: episode, step"):
        read_shard(tmp_path / "part", "steps")
