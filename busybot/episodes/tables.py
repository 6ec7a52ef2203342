"""Episodes as tables for pandas and pyarrow, made from files as they were read back.

`episode_rows` is what a worker returns to its parent; `write_shard` puts the rows of many episodes in a Parquet file.
"""

import hashlib
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from busybot.boards.directions import DIRECTIONS
from busybot.common.atomic_io import read_regular, write_atomically
from busybot.common.errors import BusybotError
from busybot.common.limits import MAX_TABLE_BYTES, MIB
from busybot.episodes.codec import EncodedImage, LazyImages
from busybot.episodes.digests import episode_digests
from busybot.episodes.episode import Episode
from busybot.episodes.mcap import channels
from busybot.episodes.mcap.reader import decode_episode
from busybot.episodes.mcap.records import Records, parse_records, read_records
from busybot.episodes.schema import STEP_FIELDS, TABLES, arrow_schema

EPISODES_PER_SHARD = 500
EPISODES_PER_ROW_GROUP = 25
MAX_SHARD_ROWS = EPISODES_PER_SHARD * 1001 * 64
"""Of `steps` and `objects`, where nobody knows the episodes: a thousand steps each on boards of 64 objects."""
MAX_SHARD_MEMORY = 4096 * MIB
"""Of a shard's values, decoded: a small file can hold one value many times."""
ROWS_KEY, MADE_OF_KEY = b"busybot_rows", b"busybot_made_of"
HINT_TABLES = "`busybot dataset repair DATASET` makes it again from the episodes"

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
    row = {**_episode(episode), **_facts(records)}
    columns = {"episodes": {name: [value] for name, value in row.items()}}
    columns |= {"steps": step_columns(episode), "objects": object_columns(episode)}
    tables = {}
    for name, values in columns.items():
        count = len(next(iter(values.values())))
        tables[name] = pa.table({"episode": [index] * count, **values}, schema=arrow_schema(name))
    return tables


def _facts(records: Records) -> dict[str, Any]:
    """What the file says beyond the episode."""
    metadata = records.metadata[channels.METADATA]
    said = {"image_format": metadata.get("image_format", ""), "schema_version": metadata["schema_version"]}
    return {"bytes": records.size, "checksum": records.checksum, **said}


def _episode(episode: Episode) -> dict[str, Any]:
    board, camera, encoded = episode.board, episode.camera, _encoded(episode)
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
        "depth": encoded[0].depth is not None,
        "segmentation": encoded[0].segmentation is not None,
        "truth": known,
        "delta": _setting(episode, "delta", int),
        "strict": _setting(episode, "strict", bool),
        "width": camera.width,
        "height": camera.height,
        "camera_matrix": camera.matrix.ravel().tolist(),
        "camera_pose": camera.pose.ravel().tolist(),
        **{name: json.dumps(getattr(episode, name), sort_keys=True) for name in ("settings", "renderer", "versions")},
        "successes": sum(step.success for step in episode.steps) if known else None,
        **{f"{kind}_digest": digest for kind, digest in vars(episode_digests(episode)).items()},
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


def _encoded(episode: Episode) -> Sequence[EncodedImage]:
    assert isinstance(episode.images, LazyImages)
    return episode.images.encoded


def step_columns(episode: Episode) -> dict[str, list[Any]]:
    """Columns of table `steps` but the episode's index, by name: those of the field list, null where unknown."""
    rows = [episode.values(k) for k in range(len(episode.steps))]
    for row in rows:
        row["direction_vector"] = DIRECTIONS[row["direction"]]
    known = knows_truth(episode)
    columns: dict[str, list[Any]] = {}
    for field in STEP_FIELDS:
        values = [row[field.name] for row in rows]
        several = len(field.columns) > 1
        if field.unknown is not None:
            nothing = (None,) * len(field.columns) if several else None
            values = [nothing if value == field.unknown else value for value in values]
        elif field.privileged and not known:
            values = [None] * len(values)
        for i, column in enumerate(field.columns):
            columns[column.name] = [value[i] for value in values] if several else values
    return columns


def object_columns(episode: Episode) -> dict[str, Any]:
    """Columns of table `objects` but the episode's index, by name: a row per frame and object, frame by frame."""
    placed, encoded = episode.board.objects, _encoded(episode)
    frames, count = len(episode.frame_of), len(placed)
    columns: dict[str, Any] = {
        "frame": np.repeat(np.arange(frames), count),
        "object": np.tile(np.arange(count), frames),
        **{name: [getattr(o, name) for o in placed] * frames for name in ("role", "category", "instance")},
        **{name: np.array([getattr(o, name) for o in placed] * frames, np.float32) for name in ("yaw", "scale")},
    }
    positions = np.tile(episode.positions, (frames, 1)).astype(np.float32)
    for i, axis in enumerate("xyz"):
        columns[f"position_{axis}"] = pa.array(positions[:, i], mask=np.isnan(positions[:, i]))
    first = np.tile(encoded[0].boxes, (frames, 1))
    boxes = np.stack([encoded[i].boxes for i in episode.frame_of]).reshape(-1, 4)
    for prefix, values in (("first_box", first), ("box", boxes)):
        for i, side in enumerate(("u0", "v0", "u1", "v1")):
            columns[f"{prefix}_{side}"] = pa.array(values[:, i], pa.int16(), mask=(values < 0).any(axis=1))
    return columns


def write_shard(path: Path, table: str, rows: Iterable[pa.Table], root: Path | None = None, made_of: str = "") -> None:
    """Write the rows of consecutive episodes, whole or not at all, a row group per 25 episodes.

    The file's metadata hold a SHA-256 over its rows as they are stored, so that a table that somebody edited is not
    taken for ours.

    Args:
        root: the dataset's folder; see `atomic_io`.
        made_of: digest of the episodes that the rows were derived from; it is stored with them.
    """
    episodes = list(rows)
    buffer = io.BytesIO()
    with pq.ParquetWriter(buffer, arrow_schema(table), compression="zstd") as writer:
        for start in range(0, len(episodes), EPISODES_PER_ROW_GROUP):
            writer.write_table(pa.concat_tables(episodes[start : start + EPISODES_PER_ROW_GROUP]).combine_chunks())
        digest = hashlib.sha256(buffer.getbuffer()).hexdigest()
        writer.add_key_value_metadata({ROWS_KEY: digest, MADE_OF_KEY: made_of})
    write_atomically(path, buffer.getvalue(), root)


def counts_of(episodes: pa.Table) -> dict[str, int]:
    """How many rows of each table belong to these rows of table `episodes`."""
    steps, objects = episodes["steps"].to_pylist(), episodes["objects"].to_pylist()
    frames = sum((count + 1) * each for count, each in zip(steps, objects, strict=True))
    return {"episodes": episodes.num_rows, "steps": sum(steps), "objects": frames}


def read_shard(path: Path, table: str, columns: list[str] | None = None, most: int | None = None) -> pa.Table:
    """A shard of the table; the table's metadata hold what it was made of (`MADE_OF_KEY`), if the file says so.

    Args:
        most: rows that it may have, if the episodes are known: see `counts_of`.

    Raises:
        BusybotError: naming the file, if it is no Parquet file, its columns are not the schema's, it was edited, it has
            more rows or values than there can be, or several rows of an episode.
    """
    schema = arrow_schema(table)
    schema = schema if columns is None else pa.schema([schema.field(name) for name in columns])
    try:
        data = read_regular(path, MAX_TABLE_BYTES, HINT_TABLES)
        file = pq.ParquetFile(pa.BufferReader(data))
        _refuse_swelling(path, table, file, most)
        made_of = _checked_origin(path, data, file)
        found = {field.name: field.type for field in file.schema_arrow}
        later = {column.name for column in TABLES[table] if column.later} - found.keys()
        wrong = [
            field.name
            for field in arrow_schema(table)
            if field.name not in later and found.get(field.name) != field.type
        ]
        if wrong:
            what = f"{path}: not table {table!r} of this schema version: {', '.join(wrong)}"
            raise BusybotError(what, HINT_TABLES)
        wanted = [name for name in schema.names if name not in later] or [arrow_schema(table).names[0]]
        rows = _read(path, data, file, arrow_schema(table), wanted)
        for name in later & set(schema.names):
            rows = rows.append_column(name, pa.nulls(rows.num_rows, schema.field(name).type))
        rows = rows.select(schema.names).cast(schema)
    except (OSError, pa.ArrowException, ValueError, KeyError) as error:  # of nulls, and of two columns of one name
        raise BusybotError(f"{path}: not a readable Parquet file: {error}", HINT_TABLES) from None
    if table == "episodes" and "episode" in rows.schema.names and (np.diff(rows["episode"].to_numpy()) <= 0).any():
        raise BusybotError(f"{path}: it has several rows of an episode, or not in order", HINT_TABLES)
    return rows.replace_schema_metadata((schema.metadata or {}) | made_of)


def _refuse_swelling(path: Path, table: str, file: pq.ParquetFile, most: int | None) -> None:
    """Refuse what its own description says to be more than there can be, before it is decoded.

    Texts are left out of the sum: a description does not tell how often each is repeated.
    """
    groups = [file.metadata.row_group(number) for number in range(file.metadata.num_row_groups)]
    limit = EPISODES_PER_SHARD if table == "episodes" else MAX_SHARD_ROWS if most is None else most
    if (rows := max(file.metadata.num_rows, sum(group.num_rows for group in groups))) > limit:
        raise BusybotError(f"{path}: {rows:,} rows, at most {limit:,} belong to its episodes", HINT_TABLES)
    columns = [group.column(number) for group in groups for number in range(group.num_columns)]
    wide = ("INT64", "DOUBLE")
    size = sum(
        max(one.total_uncompressed_size, one.num_values * (8 if one.physical_type in wide else 4)) for one in columns
    )
    if size > MAX_SHARD_MEMORY:
        raise _too_much(path, size)


def _read(path: Path, data: bytes, file: pq.ParquetFile, schema: pa.Schema, names: list[str]) -> pa.Table:
    """Columns of the file. Of texts each different one is decoded once, until it is known what they are together."""
    texts = [name for name in names if pa.types.is_string(schema.field(name).type)]
    once = pq.ParquetFile(pa.BufferReader(data), metadata=file.metadata, read_dictionary=texts)
    # by Arrow's own threads it would be no faster, and one that still asks for Python at its end aborts the process
    rows = once.read(columns=names, use_threads=False)
    rows.validate(full=True)  # text that is no UTF-8 would only be noticed when it is used
    size = rows.nbytes + sum(_text_bytes(chunk) for name in texts for chunk in rows[name].chunks)
    if size > MAX_SHARD_MEMORY:
        raise _too_much(path, size)
    return rows


def _text_bytes(texts: pa.DictionaryArray) -> int:
    return pc.sum(pc.binary_length(texts.dictionary).take(texts.indices)).as_py() or 0


def _too_much(path: Path, size: int) -> BusybotError:
    what = f"{path}: {size:,} bytes of values, at most {MAX_SHARD_MEMORY:,} are read"
    return BusybotError(what, HINT_TABLES)


def _checked_origin(path: Path, data: bytes, file: pq.ParquetFile) -> dict[bytes, bytes]:
    """What the file says that it was made of; nothing where it is from before this was stored.

    Raises:
        BusybotError: its rows are not those that were written.
    """
    said = file.metadata.metadata or {}
    if ROWS_KEY not in said:
        if "checksum" in file.schema_arrow.names:
            raise BusybotError(f"{path}: it was written by another program", HINT_TABLES)
        return {}
    rows_end = len(data) - 8 - int.from_bytes(data[-8:-4], "little")  # length of the footer, and "PAR1"
    if hashlib.sha256(data[:rows_end]).hexdigest().encode() != said[ROWS_KEY]:
        raise BusybotError(f"{path}: it was edited, its rows are not those that were written", HINT_TABLES)
    return {MADE_OF_KEY: said.get(MADE_OF_KEY, b"")}


def split_by_episode(rows: pa.Table) -> dict[int, pa.Table]:
    """Rows of a shard by episode; they are stored in the order of episodes."""
    episodes = rows["episode"].to_numpy()
    starts = np.flatnonzero(np.diff(episodes, prepend=-1)).tolist()
    ends = [*starts[1:], len(episodes)] if starts else []
    return {int(episodes[a]): rows.slice(a, b - a) for a, b in zip(starts, ends, strict=True)}
