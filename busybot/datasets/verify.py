"""Verifies a dataset: structure, checksums, boards, that recordings belong to them, tables against the episodes."""

import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from busybot.common.errors import BusybotError, without_name
from busybot.common.process_pool import Progress, share
from busybot.datasets.bundled_assets import library_of
from busybot.datasets.dataset import BOARDS_PER_SHARD, DAMAGED_FOLDER, HINT_GENERATE, INFO_FILE, OBJECTS_FOLDER, Dataset
from busybot.datasets.info import DatasetInfo, collect_command
from busybot.datasets.manifest import CARD_FILE, HINT_FETCH, MANIFEST_FILE, is_frozen, read_manifest, unlike_manifest
from busybot.episodes.episode import ENDED, SALVAGED
from busybot.episodes.schema import TABLES
from busybot.episodes.tables import HINT_TABLES, Rows, episode_rows, read_shard, split_by_episode

LINK = "a link where a file or folder is expected"
HINT_STRAY = "move it out of the dataset"
HINT_EPISODE = "`busybot dataset repair DATASET` saves what can be saved, and says how the rest comes back"


@dataclass(frozen=True)
class Problem:
    """Something that is not as it should be: the file, the fault, and what mends it."""

    file: str
    what: str
    hint: str


@dataclass(frozen=True)
class VerifyReport:
    """What `verify` found.

    Attributes:
        episodes: how many it read.
        boards: how many the dataset has; those without an episode are no problem.
        problems: in a fixed order.
        frozen: whether there is a manifest; all files were compared with it.
        objects: how many objects were compared with their recorded hashes; None if their files were not found.
    """

    episodes: int
    problems: tuple[Problem, ...]
    frozen: bool = False
    objects: int | None = None
    boards: int = 0

    @property
    def ok(self) -> bool:
        return not self.problems


def verify(
    path: Path,
    workers: int = 1,
    progress: Progress | None = None,
    assets: str | None = None,
) -> VerifyReport:
    """Look for everything that can be wrong with the dataset.

    Every episode is read whole: all checksums, all images decoded, rows and digests derived again and compared with
    the tables. Boards without an episode are no problem: collecting can continue. Of a frozen dataset all files are
    compared with the manifest. Objects are compared with their recorded hashes where their files are found.

    Args:
        assets: the library with the objects; other objects than the recorded ones are then a problem.

    Raises:
        BusybotError: if the folder is no dataset at all.
    """
    dataset = Dataset.open(path)
    problems = [*_strangers(dataset)]
    if any(problem.what == LINK for problem in problems):
        return VerifyReport(0, tuple(problems), boards=dataset.info.boards)  # nothing is read through a link
    digests, board_problems = _boards(dataset)
    problems += board_problems
    finished = len(dataset.finished())
    if finished and dataset.info.collect is None:
        what = "there are episodes, but not how they were collected"
        problems.append(Problem(str(path / INFO_FILE), what, "collect into a new dataset"))
    problems += _episodes(dataset, digests, workers, progress)
    if is_frozen(path):
        problems += _manifest(dataset, workers, sound=not problems)
    objects, object_problems = _objects(dataset, assets)
    return VerifyReport(finished, (*problems, *object_problems), is_frozen(path), objects, dataset.info.boards)


def _manifest(dataset: Dataset, workers: int, sound: bool) -> Iterator[Problem]:
    """Compare with the manifest: every file, and in a sound dataset the hashes over all values."""
    try:
        manifest = read_manifest(dataset.path)
    except BusybotError as error:
        file = dataset.path / MANIFEST_FILE
        yield Problem(str(file), without_name(error, file), error.hint or HINT_FETCH)
        return
    for name, fault, hint in unlike_manifest(dataset.path, manifest, workers):
        sound = False
        yield Problem(str(dataset.path / name), fault, hint)
    if sound and dataset.hashes(compare=False) != manifest.hashes:
        yield Problem(str(dataset.path / MANIFEST_FILE), "its hashes are not those of the dataset", HINT_FETCH)


def _objects(dataset: Dataset, assets: str | None) -> tuple[int | None, list[Problem]]:
    recorded = dataset.info.assets.sha256
    try:
        library_of(dataset, assets)
    except BusybotError as error:
        if assets is None and not (dataset.path / OBJECTS_FOLDER).exists():
            return None, []
        place = Path(assets) if assets else dataset.path / OBJECTS_FOLDER
        return None, [_problem_in(place, error, HINT_FETCH)]
    return len(recorded), []


def _strangers(dataset: Dataset) -> Iterator[Problem]:
    """Links, and files that are not the dataset's."""
    boards = dataset.info.boards
    own = {INFO_FILE, "boards", "episodes", "tables", MANIFEST_FILE, CARD_FILE, OBJECTS_FOLDER, DAMAGED_FOLDER}
    expected: dict[str, Callable[[str], bool]] = {
        "": own.__contains__,
        "boards": _numbered("boards-{:05d}.jsonl", -(-boards // BOARDS_PER_SHARD)),
        "episodes": _numbered("{:06d}.mcap", boards),
        "tables": set(TABLES).__contains__,
        **dict.fromkeys((f"tables/{name}" for name in TABLES), _numbered("part-{:05d}.parquet", boards)),
    }
    for folder, is_own in expected.items():
        place = dataset.path / folder
        if not place.is_dir() or place.is_symlink() and folder:
            continue
        with os.scandir(place) as entries:
            names = {
                entry.name: entry.is_symlink() for entry in entries if entry.is_symlink() or not is_own(entry.name)
            }
        for name, link in sorted(names.items()):
            if link:
                yield Problem(str(place / name), LINK, HINT_STRAY)
            elif not name.startswith("."):
                yield Problem(str(place / name), "not part of a dataset", HINT_STRAY)


def _numbered(form: str, count: int) -> Callable[[str], bool]:
    """Tells whether a file's name is `form` with a number below the count."""

    def is_one(name: str) -> bool:
        digits = "".join(filter(str.isdecimal, name))
        return digits.isascii() and digits != "" and int(digits) < count and form.format(int(digits)) == name

    return is_one


def _boards(dataset: Dataset) -> tuple[dict[int, str], list[Problem]]:
    """Digest of every board, and what is wrong with the boards."""
    info, problems, digests = dataset.info, [], {}
    try:
        for board in dataset.each_board():
            digests[board.index] = board.digest()
            if (board.seed, board.split) != (info.seed, info.split):
                what = f"board {board.index} has seed {board.seed} and split {board.split!r}, "
                what += f"the dataset {info.seed} and {info.split!r}"
                problems.append(Problem(str(dataset.path / "boards"), what, HINT_GENERATE))
    except BusybotError as error:
        return {}, [_problem_in(dataset.path / "boards", error, HINT_GENERATE)]
    return digests, problems


def _problem_in(folder: Path, error: BusybotError, hint: str) -> Problem:
    """What an error says of a folder, or of the file in it that it names first."""
    what = without_name(error, folder)
    file, separator, fault = what.partition(": ")
    if separator and Path(file).is_relative_to(folder):
        return Problem(file, fault, error.hint or hint)
    return Problem(str(folder), what, error.hint or hint)


def _episodes(dataset: Dataset, digests: dict[int, str], workers: int, progress: Progress | None) -> Iterator[Problem]:
    """Read every episode, and compare the tables with what they should hold, one shard after the other."""
    finished, done, frozen = dataset.finished_by_shard(), 0, is_frozen(dataset.path)
    again = HINT_FETCH if frozen else collect_command(dataset.path, dataset.info)
    damaged, tables = (HINT_FETCH, HINT_FETCH) if frozen else (HINT_EPISODE, HINT_TABLES)
    tasks = [(index, digests.get(index)) for indices in finished.values() for index in indices]
    checked = share(partial(_check_episode, Dataset(dataset.path, dataset.info)), tasks, workers)
    for shard in sorted(finished.keys() | {shard for name in TABLES for shard in dataset.stored_shards(name)}):
        files = {index: dataset.episode_path(index) for index in finished.get(shard, ())}
        rows: dict[int, Rows] = {}
        for (index, file), (found, faults) in zip(files.items(), islice(checked, len(files)), strict=True):
            yield from (Problem(str(file), fault, damaged) for fault in faults)
            if found is not None:
                rows[index] = found
            done += 1
            if progress is not None:
                progress(done, len(tasks))
        yield from _tables(dataset, shard, rows, set(files), again, tables)


def _check_episode(dataset: Dataset, task: tuple[int, str | None]) -> tuple[Rows | None, list[str]]:
    """Rows and faults of an episode, given with its board's digest; runs in a worker."""
    index, board_digest = task
    file = dataset.episode_path(index)
    try:
        rows = episode_rows(file, index)
    except BusybotError as error:
        return None, [without_name(error, file)]
    return rows, faults_of(rows, index, board_digest, dataset.info)


def faults_of(rows: Rows, index: int, board_digest: str | None, info: DatasetInfo) -> list[str]:
    """What speaks against it, nothing if it belongs there.

    An episode that was saved in part, or that its policy ended, may have fewer steps than the collection if it says
    so. Imported recordings have lengths of their own, of which the dataset tells the longest.

    Args:
        rows: of the episode, as `tables.episode_rows` returns them.
        board_digest: of board `index`; None if it is not known.
        info: of the dataset that it should belong to.
    """
    collect = info.collect
    episode = {name: rows["episodes"][name][0].as_py() for name in rows["episodes"].column_names}
    faults = []
    if board_digest is not None and episode["board_digest"] != board_digest:
        faults.append(f"its board is not board {index} of the dataset")
    if collect is None:
        return faults
    pairs = [("policy", collect.policy), ("strict", collect.strict), ("delta", collect.delta)]
    pairs.append(("image_format", collect.images))
    faults += [
        f"{name} is {episode[name]!r}, the dataset says {value!r}"
        for name, value in pairs
        if episode[name] is not None and episode[name] != value
    ]
    possible = _possible_steps(episode["steps"], json.loads(episode["settings"]))
    if possible < 0 or (possible != collect.steps and not info.generator.imported):
        faults.append(f"it has {episode['steps']} steps, the dataset says {collect.steps}")
    return faults


def _possible_steps(steps: int, settings: dict[str, Any]) -> int:
    """How many steps an episode with so many might have had, by its own account; -1 if that contradicts itself."""
    for name in (SALVAGED, ENDED):
        said = settings.get(name)
        if isinstance(said, dict):
            of = said.get("of")
            if not isinstance(of, int) or of < steps:
                return -1
            steps = of
    return steps


def is_partial(settings: str) -> bool:
    """Whether an episode's settings, as the table has them, say that it was saved in part."""
    return isinstance(json.loads(settings).get(SALVAGED), dict)


def _tables(
    dataset: Dataset, shard: int, derived: dict[int, Rows], finished: set[int], again: str, tables: str
) -> Iterator[Problem]:
    """Compare the stored rows of a shard with those that its episodes give now.

    Args:
        again: how an episode comes back that is not there.
        tables: how a table is mended.
    """
    for name in TABLES:
        path = dataset.table_path(name, shard)
        if not path.exists():
            yield Problem(str(path), f"missing; {len(finished)} episodes belong to it", tables)
            continue
        try:
            stored = split_by_episode(read_shard(path, name))
        except BusybotError as error:
            yield Problem(str(path), without_name(error, path), tables)
            continue
        for index in sorted(finished | set(stored)):
            if index not in finished:
                yield Problem(str(path), f"holds episode {index}, which is not there", again)
            elif index in derived:
                fault = _difference(derived[index], stored, name, index)
                if fault:
                    yield Problem(str(path), fault, tables)


def _difference(derived: Rows, stored: dict, name: str, index: int) -> str | None:
    expected, found = derived[name], stored.get(index)
    if found is None:
        return f"lacks episode {index}" if expected.num_rows else None
    if expected.num_rows != found.num_rows:
        return f"episode {index} has {found.num_rows} rows, its file gives {expected.num_rows}"
    later = {one.name for one in TABLES[name] if one.later and found[one.name].null_count == found.num_rows}
    columns = [c for c in expected.column_names if c not in later and not expected[c].equals(found[c])]
    return f"episode {index} differs from its file in {', '.join(columns)}" if columns else None
