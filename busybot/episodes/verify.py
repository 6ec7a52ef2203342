"""Does a dataset hold what it says? Structure, checksums, boards, and tables against the episodes themselves."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from busybot.episodes.dataset import BOARDS_PER_SHARD, INFO_FILE, Dataset
from busybot.episodes.dataset_info import CollectInfo
from busybot.episodes.schema import TABLES
from busybot.episodes.tables import EPISODES_PER_SHARD, Rows, episode_rows, read_shard, split_by_episode
from busybot.errors import BusybotError
from busybot.files import inside
from busybot.workers import share

MEND_TABLES = "remove the file; `busybot collect` on the dataset makes it again from the episodes"
LINK = "a link where a file or folder is expected"
MEND_STRAY = "move it out of the dataset"
MEND_EPISODE = "remove the file; `busybot collect` on the dataset records the episode again"


@dataclass(frozen=True)
class Problem:
    """Something that is not as it should be: the file, the fault, and what mends it."""

    file: str
    what: str
    mend: str


@dataclass(frozen=True)
class Report:
    """What `verify` found: the number of episodes that it read, and the problems in a fixed order."""

    episodes: int
    problems: tuple[Problem, ...]

    @property
    def ok(self) -> bool:
        return not self.problems


@dataclass(frozen=True)
class _Task:
    path: Path
    index: int
    board_digest: str | None
    collect: CollectInfo | None


@dataclass(frozen=True)
class _Checked:
    rows: Rows | None
    problems: tuple[Problem, ...]


def verify(path: Path, workers: int = 1, progress: Callable[[int, int], None] | None = None) -> Report:
    """Look for everything that can be wrong with the dataset.

    Every episode is read whole: all checksums, all images decoded, rows and digests derived again and compared with
    the tables. Boards without an episode are no problem: collecting can continue.

    Args:
        progress: called with the number of episodes done and the number of all.

    Raises:
        BusybotError: if the folder is no dataset at all.
    """
    dataset = Dataset.open(path)
    problems = [*_strangers(dataset)]
    if any(problem.what == LINK for problem in problems):
        return Report(0, tuple(problems))  # nothing is read through a link
    digests, board_problems = _boards(dataset)
    problems += board_problems
    finished = sorted(dataset.finished())
    if finished and dataset.info.collect is None:
        what = "there are episodes, but not how they were collected"
        problems.append(Problem(str(path / INFO_FILE), what, "collect into a new dataset"))
    done = 0
    for shard in sorted({index // EPISODES_PER_SHARD for index in finished} | _table_shards(dataset)):
        indices = [i for i in finished if i // EPISODES_PER_SHARD == shard]
        tasks = [_Task(dataset.episode_path(i), i, digests.get(i), dataset.info.collect) for i in indices]
        rows: dict[int, Rows] = {}
        for task, checked in zip(tasks, share(_check_episode, tasks, workers), strict=True):
            problems += checked.problems
            if checked.rows is not None:
                rows[task.index] = checked.rows
            done += 1
            if progress is not None:
                progress(done, len(finished))
        problems += _tables(dataset, shard, rows, set(indices))
    return Report(len(finished), tuple(problems))


def _strangers(dataset: Dataset) -> Iterator[Problem]:
    """Links, and files that are not the dataset's."""
    shards = -(-dataset.info.boards // BOARDS_PER_SHARD)
    expected = {
        "": {INFO_FILE, "boards", "episodes", "tables"},
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
                yield Problem(str(entry), LINK, MEND_STRAY)
            elif entry.name not in names and not entry.name.startswith("."):
                yield Problem(str(entry), "not part of a dataset", MEND_STRAY)


def _boards(dataset: Dataset) -> tuple[dict[int, str], list[Problem]]:
    """Digest of every board, and what is wrong with the boards."""
    try:
        boards = dataset.boards()
    except BusybotError as error:
        return {}, [Problem(str(dataset.path / "boards"), error.what, error.mend or "generate the dataset again")]
    info, problems = dataset.info, []
    for board in boards:
        if (board.seed, board.split) != (info.seed, info.split):
            what = f"board {board.index} has seed {board.seed} and split {board.split!r}, "
            what += f"the dataset {info.seed} and {info.split!r}"
            problems.append(Problem(str(dataset.path / "boards"), what, "generate the dataset again"))
    return {board.index: board.digest() for board in boards}, problems


def _check_episode(task: _Task) -> _Checked:
    """Read one file; runs in a worker."""
    try:
        rows = episode_rows(task.path, task.index)
    except BusybotError as error:
        return _Checked(None, (Problem(str(task.path), error.what, MEND_EPISODE),))
    episode = {name: rows["episodes"][name][0].as_py() for name in rows["episodes"].column_names}
    faults = []
    if task.board_digest is not None and episode["board_digest"] != task.board_digest:
        faults.append(f"its board is not board {task.index} of the dataset")
    if task.collect is not None:
        wanted = task.collect
        pairs = [("policy", wanted.policy), ("strict", wanted.strict), ("delta", wanted.delta)]
        pairs.append(("image_format", wanted.images))
        faults += [f"{name} is {episode[name]!r}, the dataset says {value!r}" for name, value in pairs
                   if episode[name] is not None and episode[name] != value]  # fmt: skip
        if episode["steps"] != wanted.steps:
            faults.append(f"it has {episode['steps']} steps, the dataset says {wanted.steps}")
    return _Checked(rows, tuple(Problem(str(task.path), fault, MEND_EPISODE) for fault in faults))


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
            yield Problem(str(path), error.what, MEND_TABLES)
            continue
        for index in sorted(finished | set(stored)):
            if index not in finished:
                yield Problem(str(path), f"holds episode {index}, which is not there", MEND_TABLES)
            elif index in derived:
                fault = _difference(derived[index], stored, name, index)
                if fault:
                    yield Problem(str(path), fault, MEND_TABLES)


def _difference(derived: Rows, stored: dict, name: str, index: int) -> str | None:
    expected, found = derived[name], stored.get(index)
    if found is None:
        return f"lacks episode {index}" if expected.num_rows else None
    if expected.num_rows != found.num_rows:
        return f"episode {index} has {found.num_rows} rows, its file gives {expected.num_rows}"
    columns = [column for column in expected.column_names if not expected[column].equals(found[column])]
    return f"episode {index} differs from its file in {', '.join(columns)}" if columns else None
