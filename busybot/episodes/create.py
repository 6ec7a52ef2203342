"""From a configuration and a library to a dataset folder with boards and no episodes yet."""

from pathlib import Path

from busybot.boards.config import BoardConfig
from busybot.boards.generate import GENERATOR_VERSION, Redraws, generate_boards
from busybot.episodes.dataset import INFO_FILE, Dataset
from busybot.episodes.dataset_info import AssetsInfo, DatasetInfo, GeneratorInfo
from busybot.errors import BusybotError
from busybot.objects.library import Library


def create_dataset(path: Path, config: BoardConfig, library: Library, redraws: Redraws | None = None) -> Dataset:
    """Draw the boards and write the dataset; it records the objects that stand on them, with their hashes.

    A dataset that was made from the same configuration and objects is left as it is, with its episodes.

    Raises:
        BusybotError: the folder holds something else, or the configuration cannot be met (with the numbers).
    """
    if (path / INFO_FILE).is_file():
        return _same(Dataset.open(path), config, library)
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


def _same(dataset: Dataset, config: BoardConfig, library: Library) -> Dataset:
    """The dataset, if it was made from this; its recorded objects must be the library's."""
    info, wanted = dataset.info, config.model_dump(mode="json")
    recorded = info.generator.config
    differing = sorted(name for name in wanted.keys() | recorded.keys() if wanted.get(name) != recorded.get(name))
    if info.generator.version != GENERATOR_VERSION:
        differing.append("version of the generator")
    hashes = {key: model.sha256 for key, model in library.objects.items()}
    if any(hashes.get(key) != sha256 for key, sha256 in info.assets.sha256.items()):
        differing.append("objects")
    if differing:
        what = f"{dataset.path}: another dataset is there: {', '.join(differing)} differ"
        raise BusybotError(what, "name another folder, or remove it")
    return dataset
