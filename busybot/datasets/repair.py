"""Repairing a dataset: damaged episodes are saved as far as possible, tables made again.

An episode that could be saved in part is an ordinary recording of fewer steps, marked in its settings
(`salvage.SALVAGED`). It counts as finished: collecting continues with the other boards. Where the episode can be
recorded again, dropping the part is better: collecting then makes the whole episode as it was.

The original of every file that is replaced or removed is kept in the dataset's folder `damaged`.
"""

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from busybot.common.atomic_io import inside, remove, remove_leftovers, scan, write_atomically
from busybot.common.errors import BusybotError, without_name
from busybot.common.process_pool import share
from busybot.datasets.create import continue_or_create
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import CollectInfo
from busybot.datasets.manifest import is_frozen
from busybot.datasets.membership import faults_of, is_partial
from busybot.episodes.mcap.records import MAX_FILE_BYTES
from busybot.episodes.mcap.salvage import salvage
from busybot.episodes.tables import EPISODES_PER_SHARD, Rows, episode_rows, read_shard, split_by_episode

DAMAGED_FOLDER = "damaged"

Fate = Literal["sound", "whole", "partial", "dropped"]


@dataclass(frozen=True)
class RepairVerdict:
    """What becomes of one episode.

    Attributes:
        fate: `sound` needs nothing, `whole` was saved entirely, `partial` in part, `dropped` not at all.
        why: the fault of a damaged file.
        steps: kept ones, `of` so many.
    """

    episode: int
    fate: Fate
    why: str = ""
    steps: int = 0
    of: int = 0


@dataclass(frozen=True)
class Repaired:
    """What `repair` found and did.

    Attributes:
        damaged: verdicts on all episodes that were not sound.
        leftovers: temporary files of killed writers that were removed.
        originals: where the damaged files are kept.
    """

    dataset: Path
    sound: int
    damaged: tuple[RepairVerdict, ...]
    leftovers: int
    originals: Path


@dataclass(frozen=True)
class _RepairTask:
    file: Path
    index: int
    board_digest: str
    collect: CollectInfo | None
    stored: Rows | None
    keep_partial: bool


def repair(
    path: Path,
    out: Path | None = None,
    keep_partial: bool = True,
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Repaired:
    """Save what can be saved.

    Args:
        out: write the repaired dataset to this new folder and leave the damaged one alone; the only way for a frozen
            one. A repetition continues.
        keep_partial: keep what is left of an episode; otherwise it is dropped, so that `collect` records it again.

    Raises:
        BusybotError: `dataset.json` or a board file is damaged, there are links in the dataset, it is frozen and `out`
            is None, or another process writes into it.
    """
    dataset = Dataset.open(path)
    _refuse_links(path)
    if out is None:
        if is_frozen(path):
            raise BusybotError(f"{path}: the dataset is frozen", "write the repaired one elsewhere: --out DIR")
        with dataset.locked():
            return _repair(dataset, dataset, keep_partial, workers, progress)
    if out.resolve() == path.resolve():
        raise BusybotError(f"{out}: it is the damaged dataset itself", "name another folder")
    target = continue_or_create(out, dataset.info, dataset.boards())
    with target.locked():
        return _repair(dataset, target, keep_partial, workers, progress)


def _refuse_links(path: Path) -> None:
    others = scan(path).others
    if others:
        what = f"{path / others[0]}: neither a file nor a folder but a link or device"
        raise BusybotError(what, "put a copy of the file in its place, or remove it")


def _repair(
    source: Dataset, target: Dataset, keep_partial: bool, workers: int, progress: Callable[[int, int], None] | None
) -> Repaired:
    leftovers = remove_leftovers(target.path)
    boards = source.boards()
    indices = sorted(source.finished())
    rows: dict[int, Rows] = {}
    verdicts: list[RepairVerdict] = []
    for start in range(0, len(indices), EPISODES_PER_SHARD):
        part = indices[start : start + EPISODES_PER_SHARD]
        stored = _stored(source, part)
        tasks = [
            _RepairTask(source.episode_path(i), i, boards[i].digest(), source.info.collect, stored.get(i), keep_partial)
            for i in part
        ]
        for verdict, found, data in share(_examine, tasks, workers):
            _put(source, target, verdict, data)
            if found is not None:
                rows[verdict.episode] = found
            verdicts.append(verdict)
            if progress:
                progress(len(verdicts), len(indices))
    target.write_tables(rows)
    damaged = tuple(verdict for verdict in verdicts if verdict.fate != "sound")
    sound = len(verdicts) - len(damaged)
    originals = source.path / ("episodes" if source is not target else DAMAGED_FOLDER)
    return Repaired(target.path, sound, damaged, leftovers, originals)


def _stored(dataset: Dataset, indices: Iterable[int]) -> dict[int, Rows]:
    """What the tables know of the episodes, as far as they can be read."""
    found: dict[int, dict[str, Any]] = {}
    for shard in {index // EPISODES_PER_SHARD for index in indices}:
        for name in ("episodes", "steps"):
            try:
                rows = split_by_episode(read_shard(dataset.table_path(name, shard), name))
            except BusybotError:
                continue
            for index, values in rows.items():
                found.setdefault(index, {})[name] = values
    return dict(found)


def _examine(task: _RepairTask) -> tuple[RepairVerdict, Rows | None, bytes | None]:
    """Verdict on a file, its rows for the tables, and the bytes that replace it; runs in a worker."""
    data = None
    verdict = RepairVerdict(task.index, "sound")
    rows: Rows
    try:
        rows = episode_rows(task.file, task.index)
    except BusybotError as error:
        fault = without_name(error, task.file)
        try:
            verdict, rows, data = _save(task, fault)
        except BusybotError as other:
            return RepairVerdict(task.index, "dropped", f"{fault}; {without_name(other, task.file)}"), None, None
    faults = faults_of(rows, task.index, task.board_digest, task.collect)
    settings = json.loads(rows["episodes"]["settings"][0].as_py())
    if not task.keep_partial and is_partial(settings):
        faults.append("it could be saved in part only")
    if faults:
        return RepairVerdict(task.index, "dropped", "; ".join(faults)), None, None
    return verdict, rows, data


def _save(task: _RepairTask, fault: str) -> tuple[RepairVerdict, Rows, bytes]:
    if task.file.stat().st_size > MAX_FILE_BYTES:
        raise BusybotError(f"more than {MAX_FILE_BYTES} bytes")
    saved = salvage(task.file.read_bytes())
    rows = episode_rows(task.file, task.index, saved.data)
    _check_stored(task.stored or {}, rows, saved.whole)
    verdict = RepairVerdict(task.index, "whole" if saved.whole else "partial", fault, saved.steps, saved.of)
    return verdict, rows, saved.data


def _check_stored(stored: Rows, rows: Rows, whole: bool) -> None:
    """What is saved must agree with what the tables remember of the file as it was."""
    if whole and "episodes" in stored:
        name = "content_digest"
        if stored["episodes"][name][0] != rows["episodes"][name][0]:
            raise BusybotError("what is left of it differs from what the tables say of it")
    if "steps" in stored:
        remembered = stored["steps"].slice(0, rows["steps"].num_rows)
        if not all(remembered[name].equals(rows["steps"][name]) for name in remembered.column_names):
            raise BusybotError("the steps that are left differ from those in the tables")


def _put(source: Dataset, target: Dataset, verdict: RepairVerdict, data: bytes | None) -> None:
    """Carry out a verdict. In place, the original is kept first; killed in between, the next run does the same."""
    file, place = source.episode_path(verdict.episode), target.episode_path(verdict.episode)
    if source is not target:
        if verdict.fate == "dropped":
            remove(place, target.path)
        else:
            write_atomically(place, file.read_bytes() if data is None else data, target.path)
    elif verdict.fate != "sound":
        _keep(target.path, file)
        if data is None:
            remove(file, target.path)
        else:
            write_atomically(file, data, target.path)


def _keep(folder: Path, file: Path) -> None:
    """A copy in `damaged`, under the first name that is free or holds the same bytes."""
    data = file.read_bytes()
    number = 0
    while True:
        place = inside(folder, f"{DAMAGED_FOLDER}/{file.name}{f'.{number}' if number else ''}")
        if not place.exists():
            write_atomically(place, data, folder)
            return
        if place.read_bytes() == data:
            return
        number += 1
