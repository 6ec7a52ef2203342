"""A dataset in LeRobot's layout 3.0 whose pictures lie in its tables (dtype `image`) to recordings.

Where something was held, and in which direction it was moved, is in the table only if this project wrote it (`dataset
export --to lerobot`). Of a robot's actions it is not: then a folder of tables tells it, in it a folder for each episode
(`000000`) with what a camera's folder has besides pictures (`camera_folder`); times are those of column `timestamp`.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from busybot.boards.directions import direction_of
from busybot.common.atomic_io import inside, read_json, read_regular
from busybot.common.errors import BusybotError, naming
from busybot.common.limits import MAX_TABLE_BYTES
from busybot.datasets.exporting.lerobot import POSITION_AND_DIRECTION
from busybot.datasets.importing.camera_folder import ImportOptions, narrowed, pictures_of, read_camera_folder
from busybot.datasets.importing.recording import KnownAction, Recording
from busybot.datasets.importing.shots import Shot, first_size

INFO_FILE = "meta/info.json"
HINT = "it reads version 3.0 with pictures in the tables; save the frames of videos as pictures, with frames.csv"


def read_lerobot(source: Path, options: ImportOptions) -> list[Recording]:
    """The episodes of a dataset.

    Raises:
        BusybotError: it is of another version, its pictures are videos, or nobody tells its actions.
    """
    info = read_json(inside(source, INFO_FILE))
    features = info.get("features") if isinstance(info, dict) else None
    if not isinstance(features, dict) or not str(info.get("codebase_version")).startswith("v3."):
        raise BusybotError(f"{source / INFO_FILE}: no dataset of LeRobot's version 3", HINT)
    camera = _camera(source, features, options.camera)
    action = features.get("action")
    own = isinstance(action, dict) and action.get("names") == list(POSITION_AND_DIRECTION) and "pixel" in features
    if not own and options.tables is None:
        what = f"{source}: its actions do not say where something was held, and in which direction it was moved"
        raise BusybotError(what, "--tables DIR: a folder for each episode, as DIR/000000/actions.csv")
    found = []
    for episode, rows in _episodes(source, camera, own).items():
        shots = [shot for shot, _ in rows]
        if options.tables is not None:
            found.append(read_camera_folder(inside(options.tables, f"{episode:06d}"), options, (source, shots)))
        else:
            told = _recording(source, episode, shots, [row for _, row in rows])
            found.append(told if options.width is None else narrowed(told, options.width))
    return found


def _camera(source: Path, features: dict[str, Any], wanted: str | None) -> str:
    kinds = {name: one.get("dtype") for name, one in features.items() if isinstance(one, dict)}
    names = sorted(name for name, kind in kinds.items() if kind in ("image", "video"))
    if wanted is None and len(names) != 1 or wanted is not None and wanted not in names:
        what = f"{source}: which of its cameras? {', '.join(names) or 'it has none'}"
        raise BusybotError(what, "--camera NAME takes one")
    chosen = wanted or names[0]
    if kinds[chosen] == "video":
        raise BusybotError(f"{source}: {chosen} is a video", HINT)
    return chosen


def _episodes(source: Path, camera: str, own: bool) -> dict[int, list[tuple[Shot, dict[str, Any]]]]:
    """Pictures and values of the rows, by episode."""
    names = ["timestamp", "episode_index", *(["action", "pixel"] if own else [])]
    found: dict[int, list[tuple[Shot, dict[str, Any]]]] = {}
    for path in sorted(source.glob("data/*/*.parquet")):
        name = path.relative_to(source).as_posix()
        data = pa.BufferReader(read_regular(inside(source, name), MAX_TABLE_BYTES))
        try:
            rows = pq.read_table(data, columns=names, use_threads=False).select(names).to_pylist()
        except (pa.ArrowException, KeyError, ValueError) as error:
            raise BusybotError(f"{path}: it cannot be read: {str(error)[:200]}", HINT) from None
        for number, row in enumerate(rows):
            where = f"{path}: row {number}"
            if not isinstance(row["episode_index"], int) or not isinstance(row["timestamp"], int | float):
                raise BusybotError(f"{where}: no episode_index, or no timestamp", HINT)
            shot = Shot(name, number, float(row["timestamp"]), None, where, camera)
            found.setdefault(row["episode_index"], []).append((shot, row))
    if not found:
        raise BusybotError(f"{source}: it has no rows in data/chunk-000", HINT)
    return dict(sorted(found.items()))


def _recording(source: Path, episode: int, shots: Sequence[Shot], rows: Sequence[dict[str, Any]]) -> Recording:
    """An episode whose rows say what was done; the last one shows what is left, and does nothing."""
    actions = []
    for shot, row in zip(shots[:-1], rows[:-1], strict=True):
        with naming(shot.where):
            (u, v), values = row["pixel"], row["action"]
            if min(u, v) < 0 or len(values) != 6 or not np.isfinite(values).all():
                raise BusybotError("the action has no pixel, or no six numbers", "--tables DIR tells actions otherwise")
            actions.append(KnownAction((u, v), None, direction_of(values[3:]), shot.where))
    size = first_size(source, shots)
    names = [f"{shot.name}, row {shot.number}" for shot in shots]
    place = source / f"episode {episode}"
    return Recording(place, size, partial(pictures_of, source, shots, size, None), names, actions)
