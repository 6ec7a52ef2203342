"""Compares two datasets: their descriptions, then boards, actions, states and images."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from busybot.common.atomic_io import parse_json
from busybot.common.config import changes, flat
from busybot.common.errors import BusybotError
from busybot.common.process_pool import share
from busybot.datasets.dataset import Dataset
from busybot.episodes.episode_diff import Difference, compare_episodes
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.tables import EPISODES_PER_SHARD, HINT_TABLES


@dataclass(frozen=True)
class DatasetDifference:
    """How dataset B differs from dataset A.

    Attributes:
        settings: what `dataset.json` says, by dotted name: (in A, in B); None where it says nothing. Names are passed
            over.
        boards: indices of boards that differ or that only one of them has.
        only_in_a, only_in_b: indices of episodes.
        actions, states, joints, rewards, images: episodes in which they differ; `images` counts pictures, camera and
            links.
        versions: episodes recorded with other packages, another renderer or other settings; what differs, by name.
        episodes: for each episode whose content differs, how.
    """

    settings: dict[str, tuple[Any, Any]]
    boards: list[int]
    only_in_a: list[int]
    only_in_b: list[int]
    actions: list[int] = field(default_factory=list)
    states: list[int] = field(default_factory=list)
    joints: list[int] = field(default_factory=list)
    rewards: list[int] = field(default_factory=list)
    images: list[int] = field(default_factory=list)
    versions: dict[str, list[int]] = field(default_factory=dict)
    episodes: dict[int, Difference] = field(default_factory=dict)

    @property
    def equal(self) -> bool:
        """Whether nothing differs."""
        return not any(vars(self).values())


def diff(
    first: Path, second: Path, workers: int = 1, progress: Callable[[int, int], None] | None = None
) -> DatasetDifference:
    """Compare two datasets by board index.

    Episodes whose digests in the tables are equal are taken to be equal; `verify` tells whether the tables are right.

    Args:
        progress: of the episodes that must be read because their digests differ: done and all.

    Raises:
        BusybotError: one of the folders is no dataset, or one of its files is damaged.
    """
    datasets = (Dataset.open(first), Dataset.open(second))
    rows = [{row["episode"]: row for row in dataset.episodes_table().to_pylist()} for dataset in datasets]
    boards = [{board.index: board.digest() for board in dataset.boards()} for dataset in datasets]
    settings = [flat(dataset.info.model_dump(mode="json", exclude={"name"})) for dataset in datasets]
    both = sorted(rows[0].keys() & rows[1].keys())
    found = DatasetDifference(
        settings=changes(*settings),
        boards=list(changes(*boards)),
        only_in_a=sorted(rows[0].keys() - rows[1].keys()),
        only_in_b=sorted(rows[1].keys() - rows[0].keys()),
    )
    for index in both:
        for name in _versions(datasets, (rows[0][index], rows[1][index])):
            found.versions.setdefault(name, []).append(index)
    unlike = [i for i in both if any(rows[0][i][key] != rows[1][i][key] for key in ("board_digest", "content_digest"))]
    pairs = [(datasets[0].episode_path(i), datasets[1].episode_path(i)) for i in unlike]
    for done, (index, difference) in enumerate(zip(unlike, share(_compare, pairs, workers), strict=True), start=1):
        _sort_in(found, index, difference)
        if progress:
            progress(done, len(unlike))
    return found


def _versions(datasets: Sequence[Dataset], rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    if rows[0]["schema_version"] != rows[1]["schema_version"]:
        yield "schema_version"
    for column in ("versions", "renderer", "settings"):
        told = [flat(_told(*pair, column), f"{column}.") for pair in zip(datasets, rows, strict=True)]
        yield from changes(*told)


def _told(dataset: Dataset, row: dict[str, Any], column: str) -> dict[str, Any]:
    """What a row of table `episodes` tells in a column as JSON; whoever wrote the table may have put anything there."""
    try:
        told = parse_json(row[column])
    except (ValueError, RecursionError):
        told = None
    if not isinstance(told, dict):
        file = dataset.table_path("episodes", row["episode"] // EPISODES_PER_SHARD)
        raise BusybotError(f"{file}: episode {row['episode']}: {column} is no object of JSON", HINT_TABLES)
    return told


def _compare(pair: tuple[Path, Path]) -> Difference:
    return compare_episodes(*(read_episode(path, images="lazy") for path in pair))


def _sort_in(found: DatasetDifference, index: int, difference: Difference) -> None:
    found.episodes[index] = difference
    same_length = difference.steps[0] == difference.steps[1]
    for episodes, differs in (
        (found.actions, difference.action is not None or not same_length),
        (found.states, difference.state is not None or not same_length),
        (found.joints, difference.joints > 0),
        (found.rewards, difference.reward is not None),
        (found.images, not (difference.image.equal and difference.scene and difference.positions) or not same_length),
    ):
        if differs:
            episodes.append(index)
