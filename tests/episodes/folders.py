"""Small datasets of synthetic episodes for tests."""

from collections.abc import Iterable
from pathlib import Path

from busybot.datasets.dataset import Dataset
from busybot.datasets.info import AssetsInfo, CollectInfo, DatasetInfo, GeneratorInfo
from busybot.episodes.codec import ImageFormat
from busybot.episodes.mcap.writer import write_episode
from tests.episodes.synthetic import DELTA, KEYS, make_board, make_episode

COLLECT = CollectInfo(
    policy="random", steps=6, images="jpeg", strict=False, delta=DELTA, settings={"render": {"fov_deg": 69.4}}
)


def make_dataset(
    path: Path,
    boards: int = 4,
    finished: Iterable[int] = (0, 1, 3),
    images: ImageFormat = "jpeg",
    strict: bool = False,
    split: str = "train",
) -> Dataset:
    """A dataset with some episodes and up-to-date tables."""
    info = DatasetInfo(
        name="toys",
        split=split,
        seed=0,
        boards=boards,
        generator=GeneratorInfo(version="1", config={"boards": boards}),
        assets=AssetsInfo(source="procedural", name="p", seed=0, sha256={key: "0" * 64 for key, _ in KEYS}),
    )
    dataset = Dataset.create(path, info, [make_board(i, split=split) for i in range(boards)])
    dataset.begin_collecting(COLLECT.model_copy(update={"images": images, "strict": strict}))
    for index in finished:
        write_episode(dataset.episode_path(index), make_episode(index, split=split), images)
    dataset.write_tables()
    return dataset
