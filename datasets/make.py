"""Make the tiny frozen dataset that tests, notebooks and newcomers use.

    python datasets/make.py [--out datasets/tiny] [--workers N]

Twelve boards with relations of all kinds, and what the scripted policy did on each in thirteen steps. The boards are
drawn from a small selection of the procedural objects (`SELECTION`), which the dataset carries: it can be looked at,
replayed and made again whatever becomes of the generator of objects. The same command continues after a stop; a
dataset that is frozen already is only checked.
"""

import argparse
import shutil
import sys
from pathlib import Path

from busybot.boards.config import BoardConfig
from busybot.common.atomic_io import scan, write_json
from busybot.common.errors import BusybotError
from busybot.datasets.bundled_assets import library_of
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.datasets.freeze import freeze
from busybot.datasets.manifest import is_frozen
from busybot.datasets.verify import verify
from busybot.objects.library import SPLIT_FILE, Library
from busybot.objects.model import kinds
from busybot.objects.partnet.folder_snapshot import read_snapshot
from busybot.objects.resolve import find
from busybot.sim.collect import CollectConfig, collect

SELECTION = {"Switch": 8, "Lamp": 4, "Door": 4, "Toy": 2}
"""Objects per category, of as many kinds and families as there are."""
BOARDS = BoardConfig(boards=12, group_size=3, uniform=True, seed=2026)
ACTIONS = CollectConfig(policy="scripted", steps=13)
MOST_BYTES = 15_000_000


def select(library: Library) -> dict[str, list[str]]:
    """Instances for training by category: one of each kind first, then one of each family, then more."""
    chosen: dict[str, list[str]] = {}
    for category, count in SELECTION.items():
        keys = sorted(key for key, _ in library.weights("train", category))
        rounds: list[list[str]] = []
        for facts in (lambda key: kinds(library.get(key)), lambda key: key.rpartition("-")[0], lambda key: key):
            first: dict[object, str] = {}
            for key in keys:
                first.setdefault(facts(key), key)
            rounds.append(list(first.values()))
        ordered = list(dict.fromkeys(key for keys in rounds for key in keys))
        chosen[category] = sorted(key.split("/")[1] for key in ordered[:count])
    return chosen


def make_selection(folder: Path) -> Library:
    """A library with the selected procedural objects, in a folder beside the dataset."""
    library = find("procedural")
    chosen = select(library)
    shutil.rmtree(folder, ignore_errors=True)
    for category, instances in chosen.items():
        for instance in instances:
            snapshot = read_snapshot(library.get(f"{category}/{instance}").folder)
            for name, data in snapshot.files.items():
                place = folder / category / instance / name
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_bytes(data)
    sections = {category: {"train": instances, "test": []} for category, instances in chosen.items()}
    write_json(folder / SPLIT_FILE, {"Reason": sections})
    return find(str(folder))


def make(out: Path, workers: int) -> None:
    """Make the dataset, or continue with it."""
    if not is_frozen(out):
        place = out.absolute().with_name(f".{out.name}-objects")
        library = make_selection(place)
        dataset = Dataset.open(out) if (out / "dataset.json").exists() else create_dataset(out, BOARDS, library)
        found = sorted({relation.kind for board in dataset.boards() for relation in board.relations})
        if len(found) < 3:
            raise BusybotError(f"{out}: its boards have relations of the kinds {found} only", "choose another seed")
        collect(dataset, library_of(dataset, str(place)), ACTIONS, workers)
        freeze(out, library, workers=workers)
        shutil.rmtree(place)
    report = verify(out, workers)
    size = sum(scan(out).files.values())
    print(f"{out}: {report.episodes} episodes, {report.objects} objects, {size:,} bytes")
    for problem in report.problems:
        print(f"{problem.file}: {problem.what}", file=sys.stderr)
    if not report.ok or report.objects is None or size > MOST_BYTES:
        raise BusybotError(f"{out}: not as it should be (at most {MOST_BYTES:,} bytes)", "remove it and make it again")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(__file__).with_name("tiny"), help="folder of the dataset")
    parser.add_argument("--workers", type=int, default=1, help="processes that share the work")
    arguments = parser.parse_args()
    try:
        make(arguments.out, arguments.workers)
    except BusybotError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
