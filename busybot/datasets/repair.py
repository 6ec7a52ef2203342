"""Repairing a dataset: damaged episodes are saved as far as possible, tables made again.

An episode that could be saved in part is an ordinary recording of fewer steps, marked in its settings
(`episode.SALVAGED`). It counts as finished: collecting continues with the other boards. Where the episode can be
recorded again, dropping the part is better: collecting then makes the whole episode as it was.

The original of every file that is replaced or removed is kept in the folder `damaged` of its dataset. A repaired
dataset elsewhere may have recorded episodes since: sound ones stay there.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, Literal

from busybot.common.atomic_io import copy_file, inside, read_regular, remove, sha256_of, write_atomically
from busybot.common.errors import BusybotError, without_name
from busybot.common.limits import MAX_RECORDING_BYTES
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

Fate = Literal["sound", "whole", "partial", "dropped", "there"]


@dataclass(frozen=True)
class RepairVerdict:
    """What becomes of one episode.

    Attributes:
        fate: `sound` needs nothing, `whole` was saved entirely, `partial` in part, `dropped` not at all;
            `there`: the other dataset has a recording of its own, which stays.
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
class _Examined:
    """What is to be done about an episode.

    Attributes:
        rows: of it for the tables; None if it is dropped.
        data: the bytes of its file; None for those that it has.
        stays: whether the file that is at its place is let be.
    """

    verdict: RepairVerdict
    rows: Rows | None = None
    data: bytes | None = None
    stays: bool = False


_Task = tuple[Path, Path | None, int, str, Rows]
"""A file, what its place holds already, the index of its episode, the digest of its board, and what the tables know of
it."""


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
            one. A repetition continues, and leaves what was recorded there since.
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
    finished, there = source.finished_by_shard(), target.finished()
    examine = partial(_examine, info=source.info, keep_partial=keep_partial)
    rows: dict[int, Rows] = {}
    verdicts: list[RepairVerdict] = []
    episodes = sum(map(len, finished.values()))
    for shard, indices in finished.items():
        stored = _stored(source, shard)
        held = {i: target.episode_path(i) for i in indices if i in there}
        tasks = [(source.episode_path(i), held.get(i), i, boards[i].digest(), stored.get(i, {})) for i in indices]
        for found in share(examine, tasks, workers):
            _put(source, target, found)
            if found.rows is not None:
                rows[found.verdict.episode] = found.rows
            verdicts.append(found.verdict)
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


def _examine(task: _Task, info: DatasetInfo, keep_partial: bool) -> _Examined:
    """What is to be done about a file, and what its place holds; runs in a worker."""
    file, there, index, board_digest, stored = task
    found = _judged(file, index, board_digest, stored, info, keep_partial)
    if there == file:
        return replace(found, stays=found.verdict.fate == "sound")
    if there is None:
        return found
    try:
        if found.rows is not None and read_regular(there, MAX_RECORDING_BYTES) == _bytes_of(file, found):
            return replace(found, stays=True)
        rows = episode_rows(there, index)
    except BusybotError:
        return found
    if faults_of(rows, index, board_digest, info) or not _is_as_good(rows, found.rows, keep_partial):
        return found
    fate: Fate = "sound" if found.verdict.fate == "sound" else "there"
    return _Examined(RepairVerdict(index, fate, found.verdict.why), rows, stays=True)


def _is_as_good(there: Rows, found: Rows | None, keep_partial: bool) -> bool:
    """Whether a sound recording that is there is worth as much as what would take its place."""
    if not _is_part(there):
        return True
    if found is None or not keep_partial:
        return keep_partial
    return _is_part(found) and there["steps"].num_rows >= found["steps"].num_rows


def _is_part(rows: Rows) -> bool:
    return is_partial(rows["episodes"]["settings"][0].as_py())


def _judged(
    file: Path, index: int, board_digest: str, stored: Rows, info: DatasetInfo, keep_partial: bool
) -> _Examined:
    """Verdict on a file, its rows for the tables, and the bytes that replace it."""
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
            return _Examined(RepairVerdict(index, "dropped", f"{fault}; {without_name(other, file)}"))
        verdict = RepairVerdict(index, "whole" if saved.whole else "partial", fault, saved.steps, saved.of)
    faults = faults_of(rows, index, board_digest, info)
    if not keep_partial and _is_part(rows):
        faults.append("it could be saved in part only")
    if faults:
        return _Examined(RepairVerdict(index, "dropped", "; ".join(faults)))
    return _Examined(verdict, rows, data)


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


def _put(source: Dataset, target: Dataset, found: _Examined) -> None:
    """Carry out a verdict. What is replaced or removed is kept first; killed in between, the next run does the same."""
    if found.stays:
        return
    file, place = source.episode_path(found.verdict.episode), target.episode_path(found.verdict.episode)
    if place.exists():
        _keep(target.path, place)
    if found.verdict.fate == "dropped":
        remove(place, target.path)
    else:
        write_atomically(place, _bytes_of(file, found), target.path)


def _bytes_of(file: Path, found: _Examined) -> bytes:
    """Of a file that is kept, or of what was saved of it."""
    return read_regular(file, MAX_RECORDING_BYTES) if found.data is None else found.data


def _keep(folder: Path, file: Path) -> None:
    """A copy in `damaged`, under the first name that is free or holds the same bytes; what is damaged may be of any
    size, and never lies in memory."""
    digest = sha256_of(file)
    for number in count():
        place = inside(folder, f"{DAMAGED_FOLDER}/{file.name}{f'.{number}' if number else ''}")
        if not place.exists():
            copy_file(file, place, folder)
        if sha256_of(place) == digest:
            return
