"""The benchmark's boards of every world, frozen by seed and hash: draw them, and see that they are those.

    python datasets/worlds.py [WORLD ...] [--assets DIR] [--out FOLDER]
    python datasets/worlds.py --write [--assets DIR]

Without options the boards of all sets are drawn again with procedural objects and compared with `datasets/worlds/`,
board by board; `--assets` names other objects, for which sets must have been written, too. `--out` leaves a dataset of
boards for each set, FOLDER/WORLD/SET, as `busybot generate` makes it: ready for `busybot collect`.

A set is a world, a split and a seed: `validation` has the split `train`, for choices and constants; the three others
are test splits, to be judged once. Nobody trains on boards of this seed. `--write` writes the files anew.
"""

import argparse
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

from busybot.boards.config import SPLITS, BoardConfig
from busybot.boards.generate import GENERATOR_VERSION
from busybot.boards.spec import PAPER, BoardSpec
from busybot.boards.worlds import NOVEL, WORLDS
from busybot.cli.common import episode_progress
from busybot.common.atomic_io import read_json, write_json
from busybot.common.errors import BusybotError
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.objects.library import Library
from busybot.objects.resolve import find

FILES = Path(__file__).with_suffix("")
SEED, BOARDS = 20261122, 200
VALIDATION = "validation"
SETS = {VALIDATION: "train", **{split: split for split in SPLITS if split != "train"}}
"""Split of each set."""
DIGITS = 16
"""Of each board's hash; the hash over all of them is whole."""
Card = dict[str, Any]


def sets_of(world: str) -> list[str]:
    """The paper's world has no mechanisms that training could lack."""
    return [name for name in SETS if (world, name) != (PAPER, NOVEL)]


def config_of(world: str, name: str, boards: int = BOARDS) -> BoardConfig:
    """How a set's boards are drawn; fewer of them are the first ones."""
    values = {"world": world, "split": SETS[name], "seed": SEED, "boards": boards, "group_size": 1}
    return BoardConfig.model_validate(values)


def command_of(world: str, name: str, library: Library) -> str:
    """What a reader types to draw a set by hand."""
    assets = "" if library.name == "procedural" else f" --assets {library.name}"
    drawn = f"--world {world} --split {SETS[name]} --boards {BOARDS} --seed {SEED} --group-size 1"
    return f"busybot generate OUT {drawn}{assets}"


def card(world: str, name: str, dataset: Dataset, library: Library) -> Card:
    """What a set is: how it is drawn, its hashes, and what is on its boards."""
    boards = dataset.boards()
    return {
        "command": command_of(world, name, library),
        "generator": GENERATOR_VERSION,
        "objects_sha256": library.sha256,
        "board_hash": dataset.hashes().board,
        "boards": len(boards),
        "on_them": contents(boards),
        "board_digests": " ".join(board.digest()[:DIGITS] for board in boards),
    }


def contents(boards: list[BoardSpec]) -> dict[str, Any]:
    """Numbers of boards by links, locks behind each other and rewirings, and of responders by mechanism."""
    links = Counter(sum(len(placed.states) for placed in board.objects) for board in boards)
    locks = Counter(len(board.locks) for board in boards if board.locks)
    kinds = Counter(relation.kind for board in boards for relation in board.relations)
    return {
        "by_links": {str(count): links[count] for count in sorted(links)},
        "by_locks": {str(count): locks[count] for count in sorted(locks)},
        "rewired": sum(bool(board.rewirings) for board in boards),
        "with_idle_links": sum(bool(board.idle) for board in boards),
        "responders_by_mechanism": dict(sorted(kinds.items())),
    }


def unlike(told: Card, dataset: Dataset) -> list[int]:
    """Numbers of the boards that are not those of the card, or that it does not have."""
    wanted = told["board_digests"].split()
    return [
        board.index
        for board in dataset.each_board()
        if board.index >= len(wanted) or board.digest()[:DIGITS] != wanted[board.index]
    ]


def drawn(world: str, library: Library, folder: Path) -> dict[str, Dataset]:
    """A dataset of boards for each of a world's sets; what an earlier call made is left as it is."""
    with episode_progress(world) as progress:
        datasets = {}
        for number, name in enumerate(sets_of(world), start=1):
            datasets[name] = create_dataset(folder / world / name, config_of(world, name), library)
            progress(number, len(sets_of(world)))
    return datasets


def write(world: str, library: Library, folder: Path) -> None:
    """The world's file with the cards of its sets with these objects; those with others stay."""
    file = FILES / f"{world}.json"
    values = read_json(file) if file.exists() else {"world": world, "seed": SEED, "objects": {}}
    datasets = drawn(world, library, folder)
    values["objects"][library.name] = {name: card(world, name, datasets[name], library) for name in datasets}
    write_json(file, values)


def check(world: str, library: Library, folder: Path) -> list[str]:
    """What is unlike the world's file.

    Raises:
        BusybotError: it has no sets with these objects.
    """
    cards = read_json(FILES / f"{world}.json")["objects"].get(library.name)
    if cards is None:
        raise BusybotError(f"{world}: no sets with the objects of {library.name}", "write them: --write --assets DIR")
    faults = []
    for name, dataset in drawn(world, library, folder).items():
        if cards[name]["board_hash"] != dataset.hashes().board:
            objects = "" if cards[name]["objects_sha256"] == library.sha256 else "; the objects are others"
            faults.append(f"{world}/{name}: boards {unlike(cards[name], dataset)} are others{objects}")
    return faults


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("worlds", nargs="*", choices=[[], PAPER, *WORLDS], metavar="WORLD", help="all by default")
    parser.add_argument("--assets", default="procedural", help="`procedural`, or a folder of objects")
    parser.add_argument("--out", type=Path, help="folder for datasets of the boards")
    parser.add_argument("--write", action="store_true", help="write what is drawn as what is to be drawn")
    arguments = parser.parse_args()
    try:
        library = find(arguments.assets)
        faults: list[str] = []
        with tempfile.TemporaryDirectory() as temporary:
            for world in arguments.worlds or (PAPER, *WORLDS):
                if arguments.write:
                    write(world, library, Path(temporary))
                else:
                    faults += check(world, library, arguments.out or Path(temporary))
    except BusybotError as error:
        sys.exit(f"error: {error}")
    sys.exit("\n".join(faults) or None)


if __name__ == "__main__":
    main()
