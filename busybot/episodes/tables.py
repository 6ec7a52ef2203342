"""Episodes as tables for pandas and pyarrow, made from files as they were read back.

`episode_rows` is what a worker returns to its parent; `write_shard` puts the rows of many episodes in a Parquet file.
"""

import io
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from busybot.boards.directions import DIRECTIONS
from busybot.common.atomic_io import write_atomically
from busybot.common.errors import BusybotError
from busybot.episodes.digests import Digests, episode_digests
from busybot.episodes.episode import Episode
from busybot.episodes.mcap import channels
from busybot.episodes.mcap.reader import decode_episode
from busybot.episodes.mcap.records import parse_records, read_records
from busybot.episodes.schema import STEP_FIELDS, arrow_schema

EPISODES_PER_SHARD = 500
EPISODES_PER_ROW_GROUP = 25

Rows = Mapping[str, pa.Table]
"""Table name to the rows of one episode or more."""


def episode_rows(path: Path, index: int, data: bytes | None = None) -> dict[str, pa.Table]:
    """Read the file and derive its rows of all three tables, with the digests.

    Args:
        index: of the episode in its dataset.
        data: the file's bytes, if it is not to be read.

    Raises:
        BusybotError: if the file cannot be read; see `episodes.mcap.reader.read_episode`.
    """
    records = read_records(path) if data is None else parse_records(data, str(path))
    episode = decode_episode(records, str(path), "lazy")
    metadata = records.metadata[channels.METADATA]
    about = FileFacts(records.size, metadata.get("image_format", ""), metadata["schema_version"])
    return rows_of(episode, index, about, episode_digests(episode))


@dataclass(frozen=True)
class FileFacts:
    """What the file says beyond the episode."""

    bytes: int
    image_format: str
    schema_version: str


def rows_of(episode: Episode, index: int, about: FileFacts, digests: Digests) -> dict[str, pa.Table]:
    """The rows of one episode; pure, no file is touched."""
    columns = {
        "episodes": {name: [value] for name, value in _episode(episode, about, digests).items()},
        "steps": _steps(episode),
        "objects": _objects(episode),
    }
    tables = {}
    for name, values in columns.items():
        count = len(next(iter(values.values())))
        tables[name] = pa.table({"episode": [index] * count, **values}, schema=arrow_schema(name))
    return tables


def _episode(episode: Episode, about: FileFacts, digests: Digests) -> dict[str, Any]:
    board, first = episode.board, _first_encoded(episode)
    known = knows_truth(episode)
    return {
        "board": board.index,
        "seed": board.seed,
        "split": board.split,
        "appearance_group": board.appearance_group,
        "policy": episode.policy,
        "oracle": episode.oracle,
        "steps": len(episode.steps),
        "images": len(episode.images),
        "objects": len(board.objects),
        "bytes": about.bytes,
        "image_format": about.image_format,
        "depth": first.depth is not None,
        "segmentation": first.segmentation is not None,
        "truth": known,
        "delta": _setting(episode, "delta", int),
        "strict": _setting(episode, "strict", bool),
        "width": episode.camera.width,
        "height": episode.camera.height,
        "camera_matrix": episode.camera.matrix.ravel().tolist(),
        "camera_pose": episode.camera.pose.ravel().tolist(),
        "schema_version": about.schema_version,
        "settings": json.dumps(episode.settings, sort_keys=True),
        "renderer": json.dumps(episode.renderer, sort_keys=True),
        "versions": json.dumps(episode.versions, sort_keys=True),
        "successes": sum(step.success for step in episode.steps) if known else None,
        "board_digest": digests.board,
        "trace_digest": digests.trace,
        "content_digest": digests.content,
    }


def _setting(episode: Episode, name: str, kind: type) -> Any:
    """From the settings or, of a simulated recording, from those of the interaction; None if there is no such value."""
    within = episode.settings.get("interaction")
    value: Any = episode.settings.get(name, within.get(name) if isinstance(within, dict) else None)
    fits = type(value) is kind
    return value if fits and -(2**31) <= value < 2**31 else None


def knows_truth(episode: Episode) -> bool:
    """False for a recording without simulator: its steps have no trigger states."""
    return any(link.trigger for link in episode.links)


def _first_encoded(episode: Episode) -> Any:
    return getattr(episode.images, "encoded", episode.images)[0]


def _steps(episode: Episode) -> dict[str, list[Any]]:
    """The columns of the field list, null where a value is unknown."""
    rows = [episode.values(k) for k in range(len(episode.steps))]
    for row in rows:
        row["direction_vector"] = DIRECTIONS[row["direction"]]
    known = knows_truth(episode)
    columns: dict[str, list[Any]] = {}
    for field in STEP_FIELDS:
        values = [row[field.name] for row in rows]
        if field.unknown is not None:
            nothing = None if len(field.columns) == 1 else (None,) * len(field.columns)
            values = [nothing if value == field.unknown else value for value in values]
        elif field.privileged and not known:
            values = [None] * len(values)
        if len(field.columns) == 1:
            columns[field.columns[0].name] = values
        else:
            columns |= {column.name: [value[i] for value in values] for i, column in enumerate(field.columns)}
    return columns


def _objects(episode: Episode) -> dict[str, Any]:
    """A row per frame and object, frame by frame."""
    placed = episode.board.objects
    frames, count = len(episode.frame_of), len(placed)
    encoded = getattr(episode.images, "encoded", episode.images)
    boxes = np.stack([encoded[i].boxes for i in episode.frame_of]).reshape(-1, 4)
    first = np.tile(encoded[0].boxes, (frames, 1))
    columns: dict[str, Any] = {
        "frame": np.repeat(np.arange(frames), count),
        "object": np.tile(np.arange(count), frames),
        "role": [o.role for o in placed] * frames,
        "category": [o.category for o in placed] * frames,
        "instance": [o.instance for o in placed] * frames,
        "yaw": np.tile(np.array([o.yaw for o in placed], np.float32), frames),
        "scale": np.tile(np.array([o.scale for o in placed], np.float32), frames),
    }
    positions = np.tile(episode.positions, (frames, 1)).astype(np.float32)
    for i, axis in enumerate("xyz"):
        columns[f"position_{axis}"] = pa.array(positions[:, i], mask=np.isnan(positions[:, i]))
    for prefix, values in (("first_box", first), ("box", boxes)):
        for i, side in enumerate(("u0", "v0", "u1", "v1")):
            columns[f"{prefix}_{side}"] = pa.array(values[:, i], pa.int16(), mask=(values < 0).any(axis=1))
    return columns


def write_shard(path: Path, table: str, rows: Iterable[pa.Table], root: Path | None = None) -> None:
    """Write the rows of consecutive episodes, whole or not at all, a row group per 25 episodes.

    Args:
        root: the dataset's folder; see `files`.
    """
    episodes = list(rows)
    buffer = io.BytesIO()
    with pq.ParquetWriter(buffer, arrow_schema(table), compression="zstd") as writer:
        for start in range(0, len(episodes), EPISODES_PER_ROW_GROUP):
            writer.write_table(pa.concat_tables(episodes[start : start + EPISODES_PER_ROW_GROUP]).combine_chunks())
    write_atomically(path, buffer.getvalue(), root)


def read_shard(path: Path, table: str, columns: list[str] | None = None) -> pa.Table:
    """A shard of the table.

    Raises:
        BusybotError: naming the file, if it is no Parquet file or its columns are not the schema's.
    """
    hint = "remove it; `busybot collect` on the dataset makes tables again from the episodes"
    try:
        file = pq.ParquetFile(io.BytesIO(path.read_bytes()))
        found = {field.name: field.type for field in file.schema_arrow}
        wrong = [f.name for f in arrow_schema(table) if found.get(f.name) != f.type]
        rows = None if wrong else file.read(columns=columns or arrow_schema(table).names)
        if rows is not None:
            rows.validate(full=True)  # text that is no UTF-8 would only be noticed when it is used
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        raise BusybotError(f"{path}: not a readable Parquet file: {error}", hint) from None
    if rows is None:
        raise BusybotError(f"{path}: not table {table!r} of this schema version: {', '.join(wrong)}", hint)
    return rows.cast(pa.schema([arrow_schema(table).field(name) for name in rows.column_names]))


def split_by_episode(rows: pa.Table) -> dict[int, pa.Table]:
    """Rows of a shard by episode; they are stored in the order of episodes."""
    episodes = rows["episode"].to_numpy()
    starts = np.flatnonzero(np.diff(episodes, prepend=-1)).tolist()
    ends = [*starts[1:], len(episodes)] if starts else []
    return {int(episodes[a]): rows.slice(a, b - a) for a, b in zip(starts, ends, strict=True)}
