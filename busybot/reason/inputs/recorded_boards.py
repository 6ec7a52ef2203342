"""The boards of several datasets that a model of relations is trained on, and those that it is held back from."""

from collections.abc import Iterable, Iterator
from collections.abc import Sequence as Several
from dataclasses import dataclass

from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.reason.inputs.feature_store import Features
from busybot.reason.inputs.sequence import BoardSequence
from busybot.training.splits import groups_apart


@dataclass(frozen=True)
class Recorded:
    """Boards that are read when they are asked for.

    Attributes:
        features: of each dataset.
        places: for each board the number of its dataset and its episode.
    """

    features: tuple[Features, ...]
    places: tuple[tuple[int, int], ...]

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, index: int) -> BoardSequence:
        dataset, episode = self.places[index]
        return self.features[dataset].sequence(episode)

    def __iter__(self) -> Iterator[BoardSequence]:
        return (self[index] for index in range(len(self)))


def held_apart(
    datasets: Several[Dataset], features: Iterable[Features], share: float, seed: int, most: int | None = None
) -> tuple[Recorded, Recorded]:
    """Boards to train on, and boards of other appearance groups to judge by.

    Args:
        share: of the groups that is held out, rounded up; 0 for none. With a single group none is.
        most: train on the first so many of the other boards; None for all.

    Raises:
        BusybotError: there is no recorded board.
    """
    known = tuple(features)
    group_of = {}
    for number, (dataset, found) in enumerate(zip(datasets, known, strict=True)):
        boards = dataset.boards()
        for episode in found:
            board = boards[episode]
            group_of[number, episode] = (board.seed, board.split, board.appearance_group)
    if not group_of:
        raise BusybotError("no board has an episode to train on", "busybot collect DATASET")
    held = groups_apart(set(group_of.values()), share, seed, "reason/held out")
    train = tuple(place for place, group in group_of.items() if group not in held)
    judge = tuple(place for place, group in group_of.items() if group in held)
    return Recorded(known, train[:most]), Recorded(known, judge)
