"""Repairing a dataset: damaged episodes are saved as far as possible, tables made again.

An episode that could be saved in part is an ordinary recording of fewer steps, marked in its settings
(`episode.SALVAGED`). It counts as finished: collecting continues with the other boards. Where the episode can be
recorded again, dropping the part is better: collecting then makes the whole episode as it was.

The original of every file that is replaced or removed is kept in the dataset's folder `damaged`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, Literal

from busybot.common.atomic_io import copy_file, inside, read_regular, remove, write_atomically
from busybot.common.errors import BusybotError, without_name
from busybot.common.limits import MAX_HASHED_BYTES, MAX_RECORDING_BYTES
from busybot.common.process_pool import share
from busybot.datasets.create import continue_or_create
from busybot.datasets.dataset import DAMAGED_FOLDER, OBJECTS_FOLDER, Dataset
from busybot.datasets.info import DatasetInfo
from busybot.datasets.manifest import is_frozen, plain_files
from busybot.datasets.verify import faults_of, is_partial
from busybot.episodes.mcap.salvage import Salvaged, salvage
from busybot.episodes.tables import Rows, episode_rows
from busybot.objects.library import SPLIT_FILE, Library
from busybot.objects.resolve import mismatch

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


_Task = tuple[Path, int, str, Rows]
"""A file, the index of its episode, the digest of its board, and what the tables know of it."""


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
    plain_files(path)
    if out is None:
        if is_frozen(path):
            raise BusybotError(f"{path}: the dataset is frozen", "write the repaired one elsewhere: --out DIR")
        with dataset.locked():
            return _repair(dataset, dataset, keep_partial, workers, progress)
    if out.resolve().is_relative_to(path.resolve()):
        raise BusybotError(f"{out}: it is the damaged dataset itself, or lies in it", "name another folder")
    target = continue_or_create(out, dataset.info, dataset.boards())
    with target.locked():
        _copy_objects(path, out)
        return _repair(dataset, target, keep_partial, workers, progress)


def _copy_objects(source: Path, target: Path) -> None:
    """Put the objects that a dataset carries into another one, the list of all last: with it they are there. If one of
    them is damaged, they are looked for elsewhere, by their hashes."""
    try:
        if mismatch(Library.load(source / OBJECTS_FOLDER), Dataset.open(source).info.assets.sha256):
            return
    except BusybotError:
        return
    names = [name for name in plain_files(source) if name.startswith(f"{OBJECTS_FOLDER}/")]
    for name in sorted(names, key=lambda name: name == f"{OBJECTS_FOLDER}/{SPLIT_FILE}"):
        if not (target / name).exists():
            copy_file(source / name, target / name, target)


def _repair(
    source: Dataset, target: Dataset, keep_partial: bool, workers: int, progress: Callable[[int, int], None] | None
) -> Repaired:
    leftovers = target.remove_leftovers()
    boards = source.boards()
    finished = source.finished_by_shard()
    examine = partial(_examine, info=source.info, keep_partial=keep_partial)
    rows: dict[int, Rows] = {}
    verdicts: list[RepairVerdict] = []
    episodes = sum(map(len, finished.values()))
    for shard, indices in finished.items():
        stored = _stored(source, shard)
        tasks = [(source.episode_path(i), i, boards[i].digest(), stored.get(i, {})) for i in indices]
        for verdict, found, data in share(examine, tasks, workers):
            _put(source, target, verdict, data)
            if found is not None:
                rows[verdict.episode] = found
            verdicts.append(verdict)
            if progress:
                progress(len(verdicts), episodes)
    target.write_tables(rows)
    damaged = tuple(verdict for verdict in verdicts if verdict.fate != "sound")
    originals = source.path / ("episodes" if source is not target else DAMAGED_FOLDER)
    return Repaired(target.path, len(verdicts) - len(damaged), damaged, leftovers, originals)


def _stored(dataset: Dataset, shard: int) -> dict[int, Rows]:
    """What the tables know of a shard's episodes, as far as they can be read."""
    found: dict[int, dict[str, Any]] = {}
    for name in ("episodes", "steps"):
        for index, rows in dataset.stored_rows(shard, (name,)).items():
            found.setdefault(index, {}).update(rows)
    return dict(found)


def _examine(task: _Task, info: DatasetInfo, keep_partial: bool) -> tuple[RepairVerdict, Rows | None, bytes | None]:
    """Verdict on a file, its rows for the tables, and the bytes that replace it; runs in a worker."""
    file, index, board_digest, stored = task
    verdict, data = RepairVerdict(index, "sound"), None
    rows: Rows
    try:
        rows = episode_rows(file, index)
    except BusybotError as error:
        fault = without_name(error, file)
        try:
            saved = _save(file)
            data, rows = saved.data, episode_rows(file, index, saved.data)
            _check_stored(stored, rows, saved)
        except BusybotError as other:
            return RepairVerdict(index, "dropped", f"{fault}; {without_name(other, file)}"), None, None
        verdict = RepairVerdict(index, "whole" if saved.whole else "partial", fault, saved.steps, saved.of)
    faults = faults_of(rows, index, board_digest, info)
    if not keep_partial and is_partial(rows["episodes"]["settings"][0].as_py()):
        faults.append("it could be saved in part only")
    if faults:
        return RepairVerdict(index, "dropped", "; ".join(faults)), None, None
    return verdict, rows, data


def _save(file: Path) -> Salvaged:
    try:
        return salvage(read_regular(file, MAX_RECORDING_BYTES))
    except MemoryError:
        raise MemoryError(str(file)) from None  # where there is more of it, nothing may be wrong


def _check_stored(stored: Rows, rows: Rows, saved: Salvaged) -> None:
    """What is saved must agree with what the tables remember of the file as it was, and all of it must be certain."""
    remembers_all = saved.whole and "episodes" in stored
    if remembers_all:
        name = "content_digest"
        if stored["episodes"][name][0] != rows["episodes"][name][0]:
            raise BusybotError("what is left of it differs from what the tables say of it")
    if "steps" in stored:
        remembered = stored["steps"].slice(0, rows["steps"].num_rows)
        if not all(remembered[name].equals(rows["steps"][name]) for name in remembered.column_names):
            raise BusybotError("the steps that are left differ from those in the tables")
    if not (saved.certain or remembers_all):
        raise BusybotError("its scale of depth is not the usual one, and nothing tells whether that part is damaged")


def _put(source: Dataset, target: Dataset, verdict: RepairVerdict, data: bytes | None) -> None:
    """Carry out a verdict. In place, the original is kept first; killed in between, the next run does the same."""
    file, place = source.episode_path(verdict.episode), target.episode_path(verdict.episode)
    if source is target and verdict.fate != "sound":
        _keep(target.path, file)
    if verdict.fate == "dropped":
        remove(place, target.path)
    elif source is not target or data is not None:
        write_atomically(place, read_regular(file, MAX_RECORDING_BYTES) if data is None else data, target.path)


def _keep(folder: Path, file: Path) -> None:
    """A copy in `damaged`, under the first name that is free or holds the same bytes."""
    data = read_regular(file, MAX_HASHED_BYTES)
    for number in count():
        place = inside(folder, f"{DAMAGED_FOLDER}/{file.name}{f'.{number}' if number else ''}")
        if not place.exists():
            write_atomically(place, data, folder)
        if read_regular(place, MAX_HASHED_BYTES) == data:
            return
