"""Datasets as tables that others wrote, in LeRobot's layout or ours: what they say of themselves, and their columns."""

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from busybot.datasets.exporting.lerobot import RGB
from busybot.datasets.exporting.targets import export_recordings
from busybot.datasets.importing.camera_pictures import decode_bytes
from tests.datasets.camera_folders import read_rows, write_camera_folder, write_table
from tests.datasets.test_imports_of_containers import log_of, state_rows, with_keys
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode
from tests.hostile.containers import NAME, odd_clock
from tests.hostile.damage import ANY, JSON, PATHS, TEXT, TEXTS, Damage, flipped, odd_csv
from tests.hostile.doors import _imported, imported_from, in_a_line, odd_picture
from tests.hostile.targets import Target, _printed

COLUMNS = ("timestamp", "episode_index", "action", "pixel", RGB)


def _dataset(folder: Path) -> None:
    made = make_dataset(folder / "made", boards=2, finished=(0, 1))
    export_recordings(made, "lerobot", folder / "t")


def _read(folder: Path) -> Any:
    return imported_from(folder / "t", camera=RGB)


def _tabled(folder: Path) -> None:
    """A robot's dataset, whose actions say nothing here, beside a folder of tables for each of its episodes."""
    _dataset(folder)
    info = folder / "t" / "meta" / "info.json"
    told = json.loads(info.read_text())
    told["features"]["action"]["names"] = ["joint"] * 6
    info.write_text(json.dumps(told))
    for index in (0, 1):
        episode = make_episode(index)
        tables = write_camera_folder(folder / "tables" / f"{index:06d}", episode, times=True)
        for file in [*tables.glob("*.png"), tables / "frames.csv"]:
            file.unlink()
        rows = read_rows(tables / "actions.csv")
        write_table(tables / "actions.csv", [row | {"time": n + 0.5} for n, row in enumerate(rows)])
        with_keys(tables)
        log = [json.loads(line) for line in log_of(state_rows(episode)[0]).splitlines()]
        lines = [json.dumps(line | {"ts": line["ts"] - 100}) + "\n" for line in log]
        (tables / "states.jsonl").write_text("".join(lines))
        (tables / "camera.json").write_text(
            json.dumps({"matrix": episode.camera.matrix.tolist(), "pose": episode.camera.pose.tolist()})
        )


def _read_tabled(folder: Path) -> Any:
    """Whatever the tables tell, the pictures are those of the recordings, in their order."""
    shown = [rgb for path in sorted(folder.glob("t/data/*/*.parquet")) for rgb in _pictures(path)]
    told, boards, found = imported_from(folder / "t", camera=RGB, tables=folder / "tables")
    for _, _, pictures in found:
        left = iter(shown)
        if not all(rgb in left for rgb, _ in pictures):
            raise ValueError("its pictures are others, or in another order")
    return told, boards, found


def _pictures(path: Path) -> list[bytes]:
    return [decode_bytes(row["bytes"], "").tobytes() for row in pq.read_table(path)[RGB].to_pylist()]


def in_table(change: Callable[[dict[str, Any], np.random.Generator], object]) -> Damage:
    """The change, done to the columns by name; the file stays valid."""

    def damaged(data: bytes, rng: np.random.Generator) -> bytes:
        table = pq.read_table(pa.BufferReader(data))
        columns = dict(zip(table.column_names, table.columns, strict=True))
        change(columns, rng)
        buffer = io.BytesIO()
        pq.write_table(pa.Table.from_arrays(list(columns.values()), list(columns)), buffer, compression="zstd")
        return buffer.getvalue()

    damaged.__name__ = change.__name__
    return damaged


def _name(rng: np.random.Generator) -> str:
    return COLUMNS[int(rng.integers(len(COLUMNS)))]


def odd_column(columns: dict[str, Any], rng: np.random.Generator) -> None:
    """A column is gone, is called otherwise or has values of another type."""
    name = _name(rng)
    columns.update(odd_values(name, columns.pop(name), int(rng.integers(10)), rng))


def odd_values(name: str, old: Any, kind: int, rng: np.random.Generator) -> dict[str, Any]:
    """What is there in place of a column: none of kind 0, the same by another name of kind 1, else another type."""
    count = len(old)
    if kind == 0:
        return {}
    if kind == 1:
        return {TEXTS[int(rng.integers(len(TEXTS)))].encode(errors="replace").decode(): old}
    others = [pa.nulls(count), pa.array(["1"] * count), pa.array([True] * count), pa.array([[0.5]] * count)]
    others += [pa.array([b"x"] * count), pa.array([{"a": 1}] * count), pa.array([2**64 - 1] * count, pa.uint64())]
    others += [pa.array([10**18] * count, pa.timestamp("ns", "Asia/Kolkata"))]
    return {name: others[kind - 2]}


def odd_cell(columns: dict[str, Any], rng: np.random.Generator) -> None:
    """One value is another one of the same type."""
    name = _name(rng)
    values: list[Any] = columns[name].to_pylist()
    row, kind = int(rng.integers(len(values))), columns[name].type
    odd: dict[str, tuple[Any, ...]] = {
        "timestamp": (None, float("nan"), float("inf"), -1.0, 0.0, 1e30, 1e-30),
        "episode_index": (None, -1, 2**40, 1, 10**6),
        "action": (None, [], [0.0] * 5, [0.0] * 6, [float("nan")] * 6, [1e38] * 6, [None] * 6, [0.0] * 7),
        "pixel": (None, [], [1], [-1, 0], [2**31, 0], [2**62, 2**62], [1, 2, 3], [None, None]),
    }
    if name in odd:
        values[row] = odd[name][int(rng.integers(len(odd[name])))]
        free = {"action": pa.list_(pa.float32()), "pixel": pa.list_(pa.int64()), "timestamp": pa.float64()}
        free["episode_index"] = pa.int64()
        columns[name] = pa.array(values, free.get(name, kind))
        return
    data, choice = values[row]["bytes"], int(rng.integers(4))
    path = PATHS[int(rng.integers(len(PATHS)))]
    changed = (None, {"bytes": None, "path": path}, {"bytes": odd_picture(data, rng), "path": path})
    values[row] = (*changed, {"bytes": flipped(data, rng), "path": None})[choice]
    columns[name] = pa.array(values, kind)


def rows_bomb(columns: dict[str, Any], rng: np.random.Generator) -> None:
    """So many rows that are equal that a small file holds gigabytes."""
    picture = int(rng.integers(2))
    times = int(rng.choice([1000, 200_000])) if picture else 3_000_000
    for name, column in list(columns.items()):
        if name not in COLUMNS or (not picture and name not in ("timestamp", "episode_index")):
            columns.pop(name)
            continue
        whole = column.combine_chunks() if isinstance(column, pa.ChunkedArray) else column
        if name == RGB:
            data = np.random.default_rng(0).bytes(300_000 if picture else 1)
            struct = pa.DictionaryArray.from_arrays(pa.array(np.zeros(times, np.int32)), pa.array([data], pa.binary()))
            columns[name] = pa.StructArray.from_arrays([struct], ["bytes"])
        else:
            columns[name] = whole.take(pa.array(np.zeros(times, np.int32)))
        if name == "timestamp":
            columns[name] = pa.array(np.arange(times) / 10)
    if not picture:
        columns["action"] = columns["pixel"] = columns[RGB] = pa.nulls(times)


def odd_beside(data: bytes, rng: np.random.Generator) -> bytes:
    """What suits the file: JSON, lines of it, or a table."""
    if data.startswith(b'{"ts"'):
        return (odd_clock, in_a_line(JSON[int(rng.integers(len(JSON)))]))[int(rng.integers(2))](data, rng)
    return (JSON[int(rng.integers(len(JSON)))] if data.startswith(b"{") else odd_csv)(data, rng)


def _exported(folder: Path) -> None:
    export_recordings(make_dataset(folder / "made", boards=2, finished=(0, 1)), "parquet", folder / "t")


def any_column(columns: dict[str, Any], rng: np.random.Generator) -> None:
    """One of all columns is gone, of another type, or has its values in another order or of another row."""
    name = sorted(columns)[int(rng.integers(len(columns)))]
    old, choice = columns[name], int(rng.integers(4))
    count = len(old)
    rows = [rng.permutation(count), np.full(count, rng.integers(count)), np.arange(count)[::-1]]
    if choice < 3:
        columns[name] = old.take(pa.array(rows[choice]))
        return
    del columns[name]
    columns.update(odd_values(name, old, int(rng.integers(10)), rng))


def other_cell(columns: dict[str, Any], rng: np.random.Generator) -> None:
    """One value is none, or far from all that there are; a picture is another one, or has another's name."""
    name = sorted(columns)[int(rng.integers(len(columns)))]
    values, kind, row = columns[name].to_pylist(), columns[name].type, int(rng.integers(len(columns[name])))
    if pa.types.is_struct(kind) and values[row] is not None:
        data, path = values[row]["bytes"], PATHS[int(rng.integers(len(PATHS)))]
        odd = ({"bytes": None, "path": path}, {"bytes": odd_picture(data, rng), "path": values[row]["path"]})
        values[row] = (*odd, {"bytes": flipped(data, rng), "path": None})[int(rng.integers(3))]
    elif pa.types.is_floating(kind):
        values[row] = float(rng.choice([np.nan, np.inf, -1e38, 1e-30]))
    elif pa.types.is_integer(kind):
        values[row] = int(rng.choice([-1, 0, 2 ** (kind.bit_width - 1) - 1, 7]))
    elif pa.types.is_string(kind):
        values[row] = TEXTS[int(rng.integers(len(TEXTS)))].encode(errors="replace").decode()
    else:
        values[row] = None
    columns[name] = pa.array(values, kind)


def many_rows(columns: dict[str, Any], rng: np.random.Generator) -> None:
    """Its last row so often that a small file holds gigabytes; pictures there are large."""
    count, times = len(next(iter(columns.values()))), int(rng.choice([5_000, 300_000]))
    numbers = np.append(np.arange(count), np.full(times, count - 1)).astype(np.int32)
    for name, column in columns.items():
        if pa.types.is_struct(column.type):
            kept = pa.array(np.zeros(len(numbers), np.int32))
            data = pa.DictionaryArray.from_arrays(kept, pa.array([rng.bytes(300_000)], pa.binary()))
            columns[name] = pa.StructArray.from_arrays([data, pa.nulls(len(numbers), pa.string())], ["bytes", "path"])
        else:
            columns[name] = column.take(pa.array(numbers))


TABLES = "tables beside recordings"
TABLED = (*TEXT, *[odd_beside] * 24)
TABLE = tuple(in_table(change) for change in (odd_column, odd_column, *[odd_cell] * 5))
EXPORTED = tuple(in_table(change) for change in (*[any_column] * 4, *[other_cell] * 6))
LEROBOT: dict[str, Target] = {
    "lerobot info": Target(_dataset, "t/meta/info.json", (*TEXT, *JSON, *JSON, *JSON), _read, False, NAME, 2),
    "lerobot tables": Target(_dataset, "t/data/*/*.parquet", (*ANY, *TABLE), _read, False, NAME, 2),
    "lerobot bombs": Target(_dataset, "t/data/*/*.parquet", (in_table(rows_bomb),), _read, False, NAME, 8),
    "exported tables": Target(_exported, "t/data/*/*.parquet", (*ANY, *EXPORTED), _imported, False, NAME, 2),
    "exported bombs": Target(_exported, "t/data/*/*.parquet", (in_table(many_rows),), _imported, False, NAME, 8),
    "tables beside recordings": Target(_tabled, "tables/*/*.*", TABLED, _read_tabled, False, TABLES, 2),
    "printed tables": Target(
        _tabled,
        "tables/*/*.*",
        TABLED,
        _printed("dataset", "import", "t", "--dry-run", "--camera", RGB, "--tables", "tables"),
        False,
        TABLES,
        8,
    ),
    "printed lerobot": Target(
        _dataset,
        "t/meta/info.json",
        JSON,
        _printed("dataset", "import", "t", "--dry-run", "--camera", RGB),
        False,
        NAME,
        8,
    ),
}
