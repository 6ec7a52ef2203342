"""From a configuration and a library to a dataset folder with boards and no episodes yet."""

from pathlib import Path

from busybot.boards.config import BoardConfig
from busybot.boards.generate import GENERATOR_VERSION, Redraws, generate_boards
from busybot.episodes.dataset import Dataset
from busybot.episodes.dataset_info import AssetsInfo, DatasetInfo, GeneratorInfo
from busybot.objects.library import Library


def create_dataset(path: Path, config: BoardConfig, library: Library, redraws: Redraws | None = None) -> Dataset:
    """Draw the boards and write the dataset; it records the objects that stand on them, with their hashes.

    Raises:
        BusybotError: the folder is not empty, or the configuration cannot be met (with the numbers).
    """
    boards = list(generate_boards(config, library, redraws))
    used = sorted({placed.key for board in boards for placed in board.objects})
    info = DatasetInfo(
        name=path.resolve().name,
        split=config.split,
        seed=config.seed,
        boards=len(boards),
        generator=GeneratorInfo(version=GENERATOR_VERSION, config=config.model_dump(mode="json")),
        assets=AssetsInfo(
            source="procedural" if library.name == "procedural" else "folder",
            name=library.name,
            sha256={key: library.get(key).sha256 for key in used},
        ),
    )
    return Dataset.create(path, info, boards)
