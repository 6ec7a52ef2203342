"""A dataset in LeRobot's layout, version 3.0, with lossless pictures instead of videos; nothing privileged is in it.

A frame is a row of `data/chunk-000/file-000.parquet`, an episode one of `meta/episodes/...`; beside them are
`meta/info.json`, `meta/stats.json` and `meta/tasks.parquet`. What LeRobot leaves open is chosen so:

- Row t has what was seen before action t, the action, and what came of it. After the last action there is a row more,
  which shows what it left: its action is all zeros (a direction of length 0 is none), and `next.done` is true there as
  it is after the last action.
- `observation.images.rgb` is the recorded JPEG or PNG, `observation.images.depth` a TIFF of float32 in board units,
  which all versions read as numbers; no unit is stated, since a board unit is no metre.
- Actions have no duration: `fps` is 1.
- Statistics of pictures are those of at most eight frames an episode and every fourth pixel, as its readers sample.
  Those of the whole are put together from the episodes'; quantiles as their weighted means.
"""

import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from PIL import Image

from busybot.boards.directions import DIRECTIONS
from busybot.common.atomic_io import write_atomically, write_json
from busybot.common.errors import BusybotError
from busybot.datasets.exporting.folder import CHUNK, Row, Source, merge, read_table, write_table
from busybot.datasets.exporting.frames import IMAGE, image_features
from busybot.datasets.manifest import CARD_FILE
from busybot.episodes.codec import PNG_MAGIC, LazyImages
from busybot.episodes.episode import Episode, Step
from busybot.episodes.mcap.reader import read_episode

RGB, DEPTH = "observation.images.rgb", "observation.images.depth"
FPS = 1
_FILES = {
    "data.parquet": "data/chunk-{chunk:03d}/file-{file:03d}.parquet",
    "meta.parquet": "meta/episodes/chunk-{chunk:03d}/file-{file:03d}.parquet",
}
TASKS = ("Find out what the switches of the board do", "Bring the board into the state that its goal image shows")
"""Of boards without and with a goal."""

POSITION_AND_DIRECTION = ("position_x", "position_y", "position_z", "direction_x", "direction_y", "direction_z")
"""Components of an action."""
_AXES = list(POSITION_AND_DIRECTION)
_VECTORS: dict[str, tuple[pa.DataType, list[str]]] = {
    "action": (pa.list_(pa.float32(), 6), _AXES),
    "pixel": (pa.list_(pa.int64(), 2), ["u", "v"]),
}
_SCALARS: dict[str, pa.DataType] = {
    "next.reward": pa.float32(),
    "next.done": pa.bool_(),
    "next.distance": pa.float32(),
    "next.changed_pixels": pa.int64(),
    "timestamp": pa.float32(),
    "frame_index": pa.int64(),
    "episode_index": pa.int64(),
    "index": pa.int64(),
    "task_index": pa.int64(),
}
_QUANTILES = {f"q{percent:02d}": percent / 100 for percent in (1, 10, 50, 90, 99)}
_KINDS = ("min", "max", "mean", "std", "count", *_QUANTILES)


def check(source: Source) -> None:
    """All frames of such a dataset are alike.

    Raises:
        BusybotError: they are not, or what is privileged was asked for.
    """
    if source.privileged:
        what = "LeRobot's layout has no place for what is privileged: its readers take all columns for observations"
        raise BusybotError(what, "leave --privileged out, or export to hf, parquet or images")
    if len({(row["width"], row["height"], row["depth"]) for row in source.rows}) > 1:
        what = "LeRobot wants all pictures of one size, and depth for all or none; the recordings differ"
        raise BusybotError(what, "export to hf, parquet or images, or collect them alike")


def write_episode(recording: Path, row: Row, privileged: bool, folder: Path) -> None:
    """The frames of one recording, and what `meta/episodes` says of it."""
    episode = read_episode(recording, "lazy")
    count = len(episode.steps) + 1
    columns = _pictures(episode) | _values(episode, row["place"], row["first"])
    schema = _schema(list(columns))
    write_table(folder / "data.parquet", [pa.table(columns, schema)], folder)
    meta = {"episode_index": row["place"], "tasks": [TASKS[columns["task_index"][0]]], "length": count}
    meta |= {"dataset_from_index": row["first"], "dataset_to_index": row["first"] + count}
    for name, values in (_samples(episode) | _numbers(columns)).items():
        meta |= {f"stats/{name}/{kind}": value.tolist() for kind, value in _statistics(values).items()}
    write_table(folder / "meta.parquet", [pa.Table.from_pylist([meta])], folder)


def _schema(names: Iterable[str]) -> pa.Schema:
    types: dict[str, pa.DataType] = {RGB: IMAGE, DEPTH: IMAGE, **_SCALARS}
    types |= {name: kind for name, (kind, _) in _VECTORS.items()}
    pictures = [name for name in names if types[name] == IMAGE]
    return pa.schema([(name, types[name]) for name in names], image_features(pictures))


def _pictures(episode: Episode) -> dict[str, list[dict[str, Any]]]:
    assert isinstance(episode.images, LazyImages)
    rgbs, depths = [one.rgb for one in episode.images.encoded], dict[int, bytes]()
    if episode.images.encoded[0].depth is not None:
        depths = {i: _tiff(image.depth) for i, image in enumerate(episode.images) if image.depth is not None}
    suffix = "png" if rgbs[0].startswith(PNG_MAGIC) else "jpg"
    columns = {RGB: [_picture(rgbs[image], frame, suffix) for frame, image in enumerate(episode.frame_of)]}
    if depths:
        columns[DEPTH] = [_picture(depths[image], frame, "tiff") for frame, image in enumerate(episode.frame_of)]
    return columns


def _picture(data: bytes, frame: int, suffix: str) -> dict[str, Any]:
    return {"bytes": data, "path": f"frame-{frame:06d}.{suffix}"}


def _tiff(depth: np.ndarray) -> bytes:
    """Float32 (H, W) as a TIFF without loss."""
    file = io.BytesIO()
    Image.fromarray(depth).save(file, "TIFF", compression="tiff_adobe_deflate")
    return file.getvalue()


def _values(episode: Episode, place: int, first: int) -> dict[str, Any]:
    """The columns without pictures: a row per action, and one for the frame after the last."""
    steps, count = episode.steps, len(episode.steps) + 1
    frames = np.arange(count)
    done = np.zeros(count, bool)
    done[-2:] = True
    return {
        "action": [_action(step) for step in steps] + [[0.0] * len(_AXES)],
        "pixel": [list(step.pixel) for step in steps] + [[-1, -1]],
        "next.reward": [float(step.reward) for step in steps] + [0.0],
        "next.done": done.tolist(),
        "next.distance": [step.distance for step in steps] + [0.0],
        "next.changed_pixels": [step.changed_pixels for step in steps] + [0],
        "timestamp": (frames / FPS).tolist(),
        "frame_index": frames.tolist(),
        "episode_index": [place] * count,
        "index": (first + frames).tolist(),
        "task_index": [int(len(episode.goals) > 0)] * count,
    }


def _action(step: Step) -> list[float]:
    return [*step.position, *DIRECTIONS[step.direction]]


def _samples(episode: Episode) -> dict[str, np.ndarray]:
    """Values of the pictures, (pixels, channels, 1, 1): colours from 0 to 1, depth in board units."""
    chosen = np.unique(np.linspace(0, len(episode.images) - 1, min(8, len(episode.images))).astype(int))
    images = [episode.images[int(number)] for number in chosen]
    found = {RGB: np.concatenate([image.rgb[::4, ::4].reshape(-1, 3, 1, 1) for image in images]) / 255}
    if images[0].depth is not None:
        values = [image.depth[::4, ::4].reshape(-1, 1, 1, 1) for image in images if image.depth is not None]
        found[DEPTH] = np.concatenate(values).astype(np.float64)
    return found


def _numbers(columns: dict[str, Any]) -> dict[str, np.ndarray]:
    """Values of the other columns, (frames, components)."""
    names = [*_VECTORS, *_SCALARS]
    return {name: np.array(columns[name], np.float64).reshape(len(columns[name]), -1) for name in names}


def _statistics(values: np.ndarray) -> dict[str, np.ndarray]:
    """Over the first axis."""
    simple = {"min": values.min(0), "max": values.max(0), "mean": values.mean(0), "std": values.std(0)}
    quantiles = np.quantile(values, list(_QUANTILES.values()), axis=0)
    return {**simple, "count": np.array([len(values)]), **dict(zip(_QUANTILES, quantiles, strict=True))}


def finish(folder: Path, source: Source) -> None:
    """The episodes put together, and the description."""
    merge(folder, source.rows, _FILES, _complete)
    parts = sorted((folder / "meta" / "episodes").glob("*/*.parquet"))
    meta = pa.concat_tables(read_table(path) for path in parts)
    tasks = TASKS[: 1 + (TASKS[1] in meta["tasks"].combine_chunks().flatten().to_pylist())]
    listed = pd.DataFrame({"task_index": range(len(tasks))}, index=pd.Index(tasks, name="task"))
    write_table(folder / "meta" / "tasks.parquet", [pa.Table.from_pandas(listed)], folder)
    write_json(folder / "meta" / "stats.json", _all_statistics(meta), folder)
    write_json(folder / "meta" / "info.json", _info(source, len(tasks)), folder)
    write_atomically(folder / CARD_FILE, _CARD.encode(), folder)


def _complete(name: str, table: pa.Table, number: int) -> pa.Table:
    """What `meta/episodes` says of the files in which an episode is."""
    if name == "meta.parquet":
        for place in ("data", "meta/episodes"):
            for kind, value in (("chunk", number // CHUNK), ("file", number % CHUNK)):
                table = table.append_column(f"{place}/{kind}_index", pa.array([value]))
    return table


def _all_statistics(meta: pa.Table) -> dict[str, Any]:
    """Of all episodes from each one's."""
    found: dict[str, Any] = {}
    names = {column.split("/")[1] for column in meta.column_names if column.startswith("stats/")}
    for name in sorted(names):
        one = {kind: np.array(meta[f"stats/{name}/{kind}"].to_pylist()) for kind in _KINDS}
        counts = one["count"].reshape(-1, *[1] * (one["mean"].ndim - 1))
        mean = (one["mean"] * counts).sum(0) / counts.sum()
        spread = ((one["std"] ** 2 + (one["mean"] - mean) ** 2) * counts).sum(0) / counts.sum()
        every = {"min": one["min"].min(0), "max": one["max"].max(0), "mean": mean, "std": np.sqrt(spread)}
        every |= {kind: (one[kind] * counts).sum(0) / counts.sum() for kind in _QUANTILES}
        found[name] = {kind: value.tolist() for kind, value in every.items()} | {"count": [int(counts.sum())]}
    return found


def _info(source: Source, tasks: int) -> dict[str, Any]:
    rows = source.rows
    width, height, depth = (rows[0][name] for name in ("width", "height", "depth"))
    pictures = {RGB: 3, DEPTH: 1} if depth else {RGB: 3}
    features: dict[str, dict[str, Any]] = {
        name: {"dtype": "image", "shape": [height, width, channels], "names": ["height", "width", "channels"]}
        for name, channels in pictures.items()
    }
    if depth:
        features[DEPTH]["info"] = {"is_depth_map": True}
    for name, (kind, names) in _VECTORS.items():
        features[name] = {"dtype": _dtype(kind.value_type), "shape": [len(names)], "names": names}
    features |= {name: {"dtype": _dtype(kind), "shape": [1], "names": None} for name, kind in _SCALARS.items()}
    return {
        "codebase_version": "v3.0",
        "robot_type": "busybot",
        "total_episodes": len(rows),
        "total_frames": sum(row["steps"] + 1 for row in rows),
        "total_tasks": tasks,
        "chunks_size": CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": FPS,
        "splits": {"train": f"0:{len(rows)}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": features,
    }


def _dtype(kind: pa.DataType) -> str:
    return {pa.float32(): "float32", pa.int64(): "int64", pa.bool_(): "bool"}[kind]


_CARD = """---
task_categories:
- robotics
tags:
- LeRobot
- busybot
configs:
- config_name: default
  data_files: data/*/*.parquet
---

# Recordings of toy boards in LeRobot's layout, version 3.0

Row t has what was seen before action t, the action (where a robot takes hold, and in which direction it pulls), and
what came of it. After the last action of an episode a row more shows what it left; its action is all zeros. Depth is a
TIFF of float32 in board units. Nothing that only the simulator knows is in it.

    from lerobot.datasets.lerobot_dataset import LeRobotDataset
    frames = LeRobotDataset("me/boards", root="FOLDER")

On the hub the dataset needs a tag with the version: `v3.0`.
"""
