"""Verifies a dataset: structure, checksums, boards, and tables against the episodes themselves."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from busybot.common.atomic_io import inside
from busybot.common.errors import BusybotError, without_name
from busybot.common.process_pool import share
from busybot.datasets.bundled_assets import OBJECTS_FOLDER, library_of
from busybot.datasets.dataset import BOARDS_PER_SHARD, INFO_FILE, Dataset
from busybot.datasets.info import CollectInfo
from busybot.datasets.manifest import CARD_FILE, HINT_FETCH, MANIFEST_FILE, is_frozen, read_manifest, unlike_manifest
from busybot.datasets.membership import faults_of
from busybot.datasets.repair import DAMAGED_FOLDER
from busybot.episodes.schema import TABLES
from busybot.episodes.tables import EPISODES_PER_SHARD, Rows, episode_rows, read_shard, split_by_episode

HINT_TABLES = "remove the file; `busybot collect` on the dataset makes it again from the episodes"
LINK = "a link where a file or folder is expected"
HINT_STRAY = "move it out of the dataset"
HINT_EPISODE = "`busybot dataset repair` saves what can be saved; or remove the file and collect again"

Progress = Callable[[int, int], None]
"""Told after each episode: those that are done, and all."""


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


@dataclass(frozen=True)
class _VerifyTask:
    path: Path
    index: int
    board_digest: str | None
    collect: CollectInfo | None


@dataclass(frozen=True)
class _Checked:
    rows: Rows | None
    problems: tuple[Problem, ...]


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
    finished = sorted(dataset.finished())
    if finished and dataset.info.collect is None:
        what = "there are episodes, but not how they were collected"
        problems.append(Problem(str(path / INFO_FILE), what, "collect into a new dataset"))
    problems += _episodes(dataset, finished, digests, workers, progress)
    if is_frozen(path):
        problems += _manifest(dataset, workers, sound=not problems)
    objects, object_problems = _objects(dataset, assets)
    return VerifyReport(len(finished), (*problems, *object_problems), is_frozen(path), objects, dataset.info.boards)


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
    if sound and vars(dataset.hashes()) != manifest.hashes.model_dump():
        yield Problem(str(dataset.path / MANIFEST_FILE), "its hashes are not those of the dataset", HINT_FETCH)


def _objects(dataset: Dataset, assets: str | None) -> tuple[int | None, list[Problem]]:
    recorded = dataset.info.assets.sha256
    try:
        library_of(dataset, assets)
    except BusybotError as error:
        if assets is None and not (dataset.path / OBJECTS_FOLDER).exists():
            return None, []
        place = assets or str(dataset.path / OBJECTS_FOLDER)
        return None, [Problem(place, error.what, error.hint or HINT_FETCH)]
    return len(recorded), []


def _strangers(dataset: Dataset) -> Iterator[Problem]:
    """Links, and files that are not the dataset's."""
    shards = -(-dataset.info.boards // BOARDS_PER_SHARD)
    expected = {
        "": {INFO_FILE, "boards", "episodes", "tables", MANIFEST_FILE, CARD_FILE, OBJECTS_FOLDER, DAMAGED_FOLDER},
        "boards": {f"boards-{shard:05d}.jsonl" for shard in range(shards)},
        "episodes": {f"{index:06d}.mcap" for index in range(dataset.info.boards)},
        "tables": set(TABLES),
        **{f"tables/{name}": {f"part-{shard:05d}.parquet" for shard in range(dataset.info.boards)} for name in TABLES},
    }
    for folder, names in expected.items():
        place = dataset.path / folder
        if not place.is_dir() or place.is_symlink() and folder:
            continue
        for entry in sorted(place.iterdir()):
            if entry.is_symlink():
                yield Problem(str(entry), LINK, HINT_STRAY)
            elif entry.name not in names and not entry.name.startswith("."):
                yield Problem(str(entry), "not part of a dataset", HINT_STRAY)


def _boards(dataset: Dataset) -> tuple[dict[int, str], list[Problem]]:
    """Digest of every board, and what is wrong with the boards."""
    try:
        boards = dataset.boards()
    except BusybotError as error:
        return {}, [Problem(str(dataset.path / "boards"), error.what, error.hint or "generate the dataset again")]
    info, problems = dataset.info, []
    for board in boards:
        if (board.seed, board.split) != (info.seed, info.split):
            what = f"board {board.index} has seed {board.seed} and split {board.split!r}, "
            what += f"the dataset {info.seed} and {info.split!r}"
            problems.append(Problem(str(dataset.path / "boards"), what, "generate the dataset again"))
    return {board.index: board.digest() for board in boards}, problems


def _episodes(
    dataset: Dataset, finished: list[int], digests: dict[int, str], workers: int, progress: Progress | None
) -> Iterator[Problem]:
    """Read every episode, and compare the tables with what they should hold, one shard after the other."""
    done = 0
    for shard in sorted({index // EPISODES_PER_SHARD for index in finished} | _table_shards(dataset)):
        indices = [i for i in finished if i // EPISODES_PER_SHARD == shard]
        tasks = [_VerifyTask(dataset.episode_path(i), i, digests.get(i), dataset.info.collect) for i in indices]
        rows: dict[int, Rows] = {}
        for task, checked in zip(tasks, share(_check_episode, tasks, workers), strict=True):
            yield from checked.problems
            if checked.rows is not None:
                rows[task.index] = checked.rows
            done += 1
            if progress is not None:
                progress(done, len(finished))
        yield from _tables(dataset, shard, rows, set(indices))


def _check_episode(task: _VerifyTask) -> _Checked:
    """Read one file; runs in a worker."""
    try:
        rows = episode_rows(task.path, task.index)
    except BusybotError as error:
        return _Checked(None, (Problem(str(task.path), without_name(error, task.path), HINT_EPISODE),))
    faults = faults_of(rows, task.index, task.board_digest, task.collect)
    return _Checked(rows, tuple(Problem(str(task.path), fault, HINT_EPISODE) for fault in faults))


def _table_shards(dataset: Dataset) -> set[int]:
    return {shard for name in TABLES for shard in dataset.stored_shards(name)}


def _tables(dataset: Dataset, shard: int, derived: dict[int, Rows], finished: set[int]) -> Iterator[Problem]:
    """Compare the stored rows of a shard with those that its episodes give now."""
    for name in TABLES:
        path = inside(dataset.path, f"tables/{name}/part-{shard:05d}.parquet")
        if not path.exists():
            yield Problem(str(path), f"missing; {len(finished)} episodes belong to it", "`busybot collect` makes it")
            continue
        try:
            stored = split_by_episode(read_shard(path, name))
        except BusybotError as error:
            yield Problem(str(path), without_name(error, path), HINT_TABLES)
            continue
        for index in sorted(finished | set(stored)):
            if index not in finished:
                yield Problem(str(path), f"holds episode {index}, which is not there", HINT_TABLES)
            elif index in derived:
                fault = _difference(derived[index], stored, name, index)
                if fault:
                    yield Problem(str(path), fault, HINT_TABLES)


def _difference(derived: Rows, stored: dict, name: str, index: int) -> str | None:
    expected, found = derived[name], stored.get(index)
    if found is None:
        return f"lacks episode {index}" if expected.num_rows else None
    if expected.num_rows != found.num_rows:
        return f"episode {index} has {found.num_rows} rows, its file gives {expected.num_rows}"
    columns = [column for column in expected.column_names if not expected[column].equals(found[column])]
    return f"episode {index} differs from its file in {', '.join(columns)}" if columns else None
