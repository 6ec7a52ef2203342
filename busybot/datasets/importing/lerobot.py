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

from busybot.boards.directions import direction_of
from busybot.common.atomic_io import inside, read_json
from busybot.common.errors import BusybotError, naming
from busybot.datasets.exporting.lerobot import POSITION_AND_DIRECTION
from busybot.datasets.importing.camera_folder import ImportOptions, narrowed, pictures_of, read_camera_folder
from busybot.datasets.importing.camera_pictures import Shot, first_size
from busybot.datasets.importing.containers import read_rows
from busybot.datasets.importing.recording import KnownAction, Recording
from busybot.datasets.importing.time_alignment import LATEST_S

INFO_FILE = "meta/info.json"
BATCH, MOST_ROWS = 4096, 100_000
"""Rows that are decoded at once, without pictures, and of an episode."""
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
        what = f"{source / INFO_FILE}: actions do not say where something was held, and in which direction it was moved"
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
        what = f"{source / INFO_FILE}: which of its cameras? {', '.join(names) or 'it has none'}"
        raise BusybotError(what, "--camera NAME takes one")
    chosen = wanted or names[0]
    if kinds[chosen] == "video":
        raise BusybotError(f"{source / INFO_FILE}: {chosen} is a video", HINT)
    return chosen


def _episodes(source: Path, camera: str, own: bool) -> dict[int, list[tuple[Shot, dict[str, Any]]]]:
    """Pictures and values of the rows, by episode."""
    names = ["timestamp", "episode_index", *(["action", "pixel"] if own else [])]
    found: dict[int, list[tuple[Shot, dict[str, Any]]]] = {}
    for path in sorted(source.glob("data/*/*.parquet")):
        name = path.relative_to(source).as_posix()
        for number, row in enumerate(read_rows(inside(source, name), names, BATCH)):
            where, episode, at = f"{path}: row {number}", row["episode_index"], row["timestamp"]
            if type(episode) is not int or type(at) not in (int, float) or not abs(at) < LATEST_S:
                raise BusybotError(f"{where}: no episode_index, or no timestamp", HINT)
            rows = found.setdefault(episode, [])
            if rows and (rows[-1][0].name != name or at <= rows[-1][0].time):
                what = f"{where}: of episode {episode}, but not after {rows[-1][0].where} in the same file"
                raise BusybotError(what, "an episode lies in one file, its rows in the order of timestamp")
            if len(rows) == MOST_ROWS:
                raise BusybotError(
                    f"{where}: episode {episode} has more than {MOST_ROWS} rows", "cut it into shorter ones"
                )
            rows.append((Shot(name, number, float(at), None, where, camera), row))
    if not found:
        raise BusybotError(f"{source}: it has no rows in data/chunk-000", HINT)
    return dict(sorted(found.items()))


def _recording(source: Path, episode: int, shots: Sequence[Shot], rows: Sequence[dict[str, Any]]) -> Recording:
    """An episode whose rows say what was done; the last one shows what is left, and does nothing."""
    actions = []
    for shot, row in zip(shots[:-1], rows[:-1], strict=True):
        with naming(shot.where):
            pixel, values = (_numbers(row[name], size) for name, size in (("pixel", 2), ("action", 6)))
            if not pixel or not values or min(pixel) < 0 or any(side % 1 for side in pixel):
                raise BusybotError("the action has no pixel, or no six numbers", "--tables DIR tells actions otherwise")
            u, v = map(int, pixel)
            actions.append(KnownAction((u, v), None, direction_of(values[3:]), shot.where))
    size = first_size(source, shots)
    names = [f"{shot.name}, row {shot.number}" for shot in shots]
    place = source / f"episode {episode}"
    return Recording(place, size, partial(pictures_of, source, shots, size, None), names, actions)


def _numbers(cell: Any, size: int) -> Sequence[float]:
    """The numbers of a row's list; empty where they are not so many, or not all of them are numbers."""
    fits = isinstance(cell, list) and len(cell) == size and all(type(one) in (int, float) for one in cell)
    return cell if fits and np.isfinite(cell).all() else ()
