"""From a configuration and a library to a dataset folder with boards and no episodes yet."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from pydantic import ValidationError

from busybot.boards.config import BoardConfig
from busybot.boards.generate import GENERATOR_VERSION, Redraws, generate_boards
from busybot.boards.spec import BoardSpec
from busybot.common.config import changes
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import first_fault
from busybot.datasets.dataset import HINT_OTHER, INFO_FILE, Dataset
from busybot.datasets.info import AssetsInfo, DatasetInfo, GeneratorInfo, name_of
from busybot.datasets.manifest import refuse_frozen
from busybot.objects.library import Library

HINT_AGAIN = "only datasets of `busybot generate` can be made again"


def create_dataset(
    path: Path,
    config: BoardConfig,
    library: Library,
    redraws: Redraws | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Dataset:
    """Draw the boards and write the dataset; it records the objects that stand on them, with their hashes.

    A dataset that was made from the same configuration and objects is left as it is, with its episodes; if it was to
    have fewer boards, it grows: the rest is drawn, and all is as if it had been drawn at once.

    Args:
        progress: told after each board: drawn ones and all.

    Raises:
        BusybotError: the folder holds something else, or the configuration cannot be met (with the numbers).
    """
    before = _same(Dataset.open(path), config, library) if (path / INFO_FILE).is_file() else None
    if before is not None and before.info.boards == config.boards:
        return before
    used: set[str] = set()

    def drawn() -> Iterator[BoardSpec]:
        for number, board in enumerate(generate_boards(config, library, redraws), start=1):
            used.update(placed.key for placed in board.objects)
            if progress:
                progress(number, config.boards)
            yield board

    def info() -> DatasetInfo:
        return DatasetInfo(
            name=name_of(path.resolve().name),
            split=config.split,
            seed=config.seed,
            boards=config.boards,
            generator=GeneratorInfo(version=GENERATOR_VERSION, config=config.model_dump(mode="json")),
            assets=AssetsInfo(
                source="procedural" if library.name == "procedural" else "folder",
                name=library.name,
                sha256={key: library.get(key).sha256 for key in sorted(used)},
            ),
        )

    return Dataset.create(path, info, drawn()) if before is None else before.grow(info, drawn())


def _same(dataset: Dataset, config: BoardConfig, library: Library) -> Dataset:
    """The dataset, if it was made from this, or with fewer boards; its recorded objects must be the library's."""
    info, changed = dataset.info, changes(dataset.info.generator.config, config.model_dump(mode="json"))
    if info.boards < config.boards and changed.get("boards") == (info.boards, config.boards):
        del changed["boards"]
    differing = [f"{name} differs (was {was!r}, now {now!r})" for name, (was, now) in changed.items()]
    if info.generator.version != GENERATOR_VERSION:
        differing.append(f"version of the generator differs (was {info.generator.version}, now {GENERATOR_VERSION})")
    hashes = {key: model.sha256 for key, model in library.objects.items()}
    if any(hashes.get(key) != sha256 for key, sha256 in info.assets.sha256.items()):
        differing.append("other objects")
    if differing:
        what = f"{dataset.path}: another dataset is there: {'; '.join(differing)}"
        raise BusybotError(what, HINT_OTHER)
    return dataset


def continue_or_create(path: Path, info: DatasetInfo, boards: Sequence[BoardSpec]) -> Dataset:
    """Open the dataset that an earlier, interrupted call made, or make it.

    Raises:
        BusybotError: the folder holds something else, or a frozen dataset.
    """
    if not (path / INFO_FILE).exists():
        return Dataset.create(path, info, boards)
    dataset = Dataset.open(path)
    if dataset.info != info or [board.digest() for board in dataset.boards()] != [b.digest() for b in boards]:
        raise BusybotError(f"{path}: it is there and another dataset", HINT_OTHER)
    refuse_frozen(path)
    return dataset


def boards_again(generator: GeneratorInfo, library: Library, recorded: list[BoardSpec]) -> tuple[list[BoardSpec], str]:
    """Boards from the recorded configuration; the recorded ones where another version of the generator drew them."""
    if generator.version != GENERATOR_VERSION:
        return recorded, "dataset"
    boards = list(drawn_again(generator, library))
    if len(boards) != len(recorded):
        what = f"the recorded configuration gives {len(boards)} boards, the dataset has {len(recorded)}"
        raise BusybotError(what, HINT_AGAIN)
    return boards, "configuration"


def drawn_again(generator: GeneratorInfo, library: Library) -> Iterator[BoardSpec]:
    """The boards that the recorded configuration gives with this library.

    Raises:
        BusybotError: it is none, or cannot be met.
    """
    try:
        config = BoardConfig.model_validate(generator.config)
    except ValidationError as error:
        raise BusybotError(f"the recorded configuration of the generator: {first_fault(error)}", HINT_AGAIN) from None
    yield from generate_boards(config, library)
