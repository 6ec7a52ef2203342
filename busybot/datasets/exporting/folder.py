"""The folder that an export is written into, so that a cut one goes on where it was.

Everything is written in `OUT.partial`, which becomes `OUT` when it is complete. Each episode is a folder of its own
there, `episodes/000123`, made under another name and then renamed: it is whole or absent, and what is there is not
written again. Targets of large files put the episodes together at the end, file by file (`merge`); which episodes go
into which file is written down before the first one, so that this goes on, too.
"""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import accumulate
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from busybot.common.atomic_io import (
    LOCK_FILE,
    make_folder,
    one_writer,
    read_json,
    read_regular,
    refuse_taken,
    remove,
    remove_leftovers,
    rename,
    replacing,
    scan,
    unfinished,
    write_json,
)
from busybot.common.errors import BusybotError
from busybot.common.limits import MAX_TABLE_BYTES
from busybot.common.process_pool import Progress, share
from busybot.datasets.dataset import Dataset
from busybot.datasets.exporting.frames import EPISODES_FOLDER
from busybot.datasets.info import DatasetInfo, collect_command
from busybot.datasets.manifest import is_frozen, read_manifest
from busybot.episodes.digests import Digests
from busybot.episodes.mcap.records import fingerprint

VERSION = 1
"""Of the layout of all targets: a cut export is not continued by another one."""
SHARD_BYTES = 100_000_000
"""Of a large file: LeRobot's default, and what Hugging Face's viewer advises."""
CHUNK = 1000
"""Large files in a folder, where a target numbers folders."""
ROW_GROUP_EACH = ("frames.parquet", "privileged_frames.parquet", "data.parquet")
"""Tables with a row group per episode, so that one can be read alone; others are small."""
MARKER, PLAN = ".export.json", ".plan.json"

Row = dict[str, Any]
"""Of the dataset's table `episodes`; with `place` among the exported ones, and `first`, its first frame of all."""


@dataclass(frozen=True)
class Source:
    """What is exported.

    Attributes:
        rows: of the dataset's table `episodes`, one per recording, in order.
        privileged: whether what only the simulator knows is exported, too.
        licence: of a frozen dataset whose objects have all the same: an SPDX identifier.
    """

    info: DatasetInfo
    rows: list[Row]
    hashes: Digests
    privileged: bool
    licence: str | None


WriteEpisode = Callable[[Path, Row, bool, Path], None]
"""Writes one episode: its recording, its row of table `episodes`, whether privileged, the folder, which is new."""
Finish = Callable[[Path, Source], None]
"""Makes the rest in the folder that holds all episodes."""
Complete = Callable[[str, pa.Table, int], pa.Table]


def _take_all(source: Source) -> None:
    """Most formats hold everything."""


@dataclass(frozen=True)
class Target:
    """A format.

    Attributes:
        write: importable by name.
        check: refuses a dataset that the format cannot hold.
    """

    name: str
    write: WriteEpisode
    finish: Finish
    check: Callable[[Source], None] = _take_all


@dataclass(frozen=True)
class Exported:
    """What was written; `continued` is the number of episodes that an earlier call, which was cut, had written."""

    out: Path
    episodes: int
    frames: int
    continued: int
    bytes: int
    files: int


def export_folder(
    dataset: Dataset,
    out: Path,
    target: Target,
    privileged: bool = False,
    workers: int = 1,
    progress: Progress | None = None,
) -> Exported:
    """Export all recordings into a new folder, or go on with what an earlier call began.

    Raises:
        BusybotError: something is at `out`, or beside it an unfinished export of something else; nothing is recorded.
    """
    place = out.absolute()
    complete = (place / MARKER).is_file() and not place.is_symlink()  # an earlier call was killed at its very end
    if not complete:
        refuse_taken(place)
    if place.resolve().is_relative_to(dataset.path.resolve()):
        raise BusybotError(f"{out}: it lies in the dataset", "name a folder beside it")
    rows = _placed(dataset.episodes_table().to_pylist())
    if not rows:
        raise BusybotError(f"{dataset.path}: no board has an episode", collect_command(dataset.path, dataset.info))
    licence = read_manifest(dataset.path).licence if is_frozen(dataset.path) else None
    source = Source(dataset.info, rows, dataset.hashes(), privileged, licence)
    target.check(source)
    folder = unfinished_place(place)
    facts = {"target": target.name, "version": VERSION, "privileged": privileged, **source.hashes.model_dump()}
    if complete:
        if read_json(place / MARKER) != facts:
            refuse_taken(place)
        with one_writer(place):
            return _finished(out, rows, len(rows))
    _refuse_foreign(folder)
    make_folder(folder)
    with one_writer(folder):
        if not (folder / MARKER).exists():
            write_json(folder / MARKER, facts, folder)
        elif read_json(folder / MARKER) != facts:
            raise BusybotError(f"{folder}: an unfinished export of something else, or of another kind", _hint(folder))
        remove_leftovers(folder)
        continued = _write_episodes(dataset, source, folder, target.write, workers, progress)
        target.finish(folder, source)
        refuse_taken(place)
        rename(folder, place)
        return _finished(out, rows, continued)


def _finished(out: Path, rows: list[Row], continued: int) -> Exported:
    """What is at its place, without what helped to write it; the marker goes last, for it tells that this is not done.

    Call it under the lock.
    """
    for name in (PLAN, LOCK_FILE, MARKER):
        remove(out / name, out)
    sizes = scan(out).files.values()
    return Exported(out, len(rows), sum(row["steps"] + 1 for row in rows), continued, sum(sizes), len(sizes))


def unfinished_place(out: Path) -> Path:
    """Where an export to `out` is until it is complete."""
    return out.parent / f"{out.name}.partial"  # `.` and `/` have no name, and are refused where an export begins


def _placed(rows: list[Row]) -> list[Row]:
    firsts = accumulate((row["steps"] + 1 for row in rows), initial=0)
    return [
        row | {"place": place, "first": first} for place, (row, first) in enumerate(zip(rows, firsts, strict=False))
    ]


def _refuse_foreign(folder: Path) -> None:
    """Only what this module began is continued."""
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise BusybotError(f"{folder}: there is something that is no folder", _hint(folder))
    if folder.is_dir() and not (folder / MARKER).is_file() and {f.name for f in folder.iterdir()} - {LOCK_FILE}:
        raise BusybotError(f"{folder}: it is not an export that was begun", _hint(folder))


def _hint(folder: Path) -> str:
    return f"remove {folder.name}, or name another folder for the export"


def _write_episodes(
    dataset: Dataset, source: Source, folder: Path, write: WriteEpisode, workers: int, progress: Progress | None
) -> int:
    """Write what is not there yet; returns how many episodes were."""
    place = folder / EPISODES_FOLDER
    make_folder(place, folder)
    if (folder / PLAN).exists():  # all were there when it was made
        return len(source.rows)
    there = _episodes_there(folder)
    for name in sorted(name for name in there if name.startswith(".")):  # of an earlier call: this one has the lock
        remove(place / name, folder)
    missing = [row for row in source.rows if _name(row) not in there]
    tasks = [(dataset.episode_path(row["episode"]), row) for row in missing]
    done = len(source.rows) - len(missing)
    for count, _ in enumerate(share(partial(_write_one, folder, write, source.privileged), tasks, workers), start=1):
        if progress:
            progress(done + count, len(source.rows))
    return done


def _episodes_there(folder: Path) -> set[str]:
    """Names in the folder of episodes; links, and whatever else nobody exported, are refused."""
    odd = [name for name in scan(folder).others if name != LOCK_FILE]
    entries = list(os.scandir(folder / EPISODES_FOLDER))
    odd += [f"{EPISODES_FOLDER}/{entry.name}" for entry in entries if not entry.is_dir(follow_symlinks=False)]
    if odd:
        raise BusybotError(f"{folder / min(odd)}: a link, or nothing that an export writes", _hint(folder))
    return {entry.name for entry in entries}


def _name(row: Row) -> str:
    return f"{row['episode']:06d}"


def _write_one(folder: Path, write: WriteEpisode, privileged: bool, task: tuple[Path, Row]) -> None:
    recording, row = task
    found = fingerprint(recording)
    if found.bytes != row["bytes"] or row["checksum"] not in (None, found.checksum):
        raise BusybotError(f"{recording}: it changed while it was exported", "repeat the command")
    place = folder / EPISODES_FOLDER
    with unfinished(place, _name(row), folder) as new:
        write(recording, row, privileged, new)
        rename(new, place / _name(row), folder)


def write_table(path: Path, tables: Iterable[pa.Table], root: Path) -> None:
    """A Parquet file with a row group per table, whole or not at all."""
    writer = None
    with replacing(path, root) as file:
        for table in tables:
            writer = writer or pq.ParquetWriter(file, table.schema, compression="zstd", write_page_index=True)
            writer.write_table(table.combine_chunks(), row_group_size=max(table.num_rows, 1))
        assert writer is not None
        writer.close()


def _as_it_is(name: str, table: pa.Table, number: int) -> pa.Table:
    return table


def merge(folder: Path, rows: Sequence[Row], files: Mapping[str, str], complete: Complete = _as_it_is) -> None:
    """Put the episodes' Parquet files together into large ones and remove them.

    Args:
        files: by the file's name in an episode's folder, that of the large one, with places for `number` of the large
            file, or for `chunk` and `file` where a folder has a thousand of them.
        complete: what becomes of an episode's table when it is known into which large file it goes.
    """
    for number, episodes in enumerate(_plan(folder, rows)):
        parts = [folder / EPISODES_FOLDER / f"{index:06d}" for index in episodes]
        for name, large in files.items():
            path = folder / large.format(number=number, chunk=number // CHUNK, file=number % CHUNK)
            if not path.exists():
                tables = (complete(name, read_table(part / name), number) for part in parts)
                write_table(path, tables if name in ROW_GROUP_EACH else [pa.concat_tables(tables)], folder)
        for part in parts:
            remove(part, folder)
    remove(folder / EPISODES_FOLDER, folder)


def _plan(folder: Path, rows: Sequence[Row]) -> list[list[int]]:
    if (folder / PLAN).exists():
        plan: list[list[int]] = read_json(folder / PLAN)
        return plan
    sizes: dict[str, int] = {}
    for path, size in scan(folder / EPISODES_FOLDER).files.items():
        episode = path.split("/")[0]
        sizes[episode] = sizes.get(episode, 0) + size
    plan, filled = [[]], 0
    for row in rows:
        if plan[-1] and filled + sizes[_name(row)] > SHARD_BYTES:
            plan.append([])
            filled = 0
        plan[-1].append(row["episode"])
        filled += sizes[_name(row)]
    write_json(folder / PLAN, plan, folder)
    return plan


def read_table(path: Path) -> pa.Table:
    """Such a file, as it was written."""
    try:
        return pq.read_table(pa.BufferReader(read_regular(path, MAX_TABLE_BYTES)), use_threads=False)
    except pa.ArrowException as error:
        raise BusybotError(
            f"{path}: no Parquet file that can be read: {error}", "remove the unfinished export"
        ) from None
