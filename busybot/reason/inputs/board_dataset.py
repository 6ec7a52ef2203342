"""Boards as a PyTorch Geometric dataset, over stored features or in memory, and batches of them from its `DataLoader`.

A model says what graph it makes of a board (`board_graph` in its `data`). Which boards an iteration sees is drawn by
the learner, so that a training that was stopped goes on with the same batches.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from busybot.common.errors import BusybotError
from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.pyg import Batch, DataLoader, Dataset, HeteroData
from busybot.training.device import slices
from busybot.training.loop import groups_apart

if TYPE_CHECKING:
    from pathlib import Path

    from busybot.datasets.dataset import Dataset as Recordings
    from busybot.episodes.episode import Episode
    from busybot.reason.inputs.feature_store import Features


@dataclass(frozen=True)
class RecordedBoards(Sequence[BoardSequence]):
    """Stored boards that are read one by one, when they are asked for.

    Attributes:
        features: of each dataset.
        places: for each board the number of its dataset and its episode.
    """

    features: tuple["Features", ...]
    places: tuple[tuple[int, int], ...]

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, index: Any) -> Any:
        dataset, episode = self.places[index]
        return self.features[dataset].sequence(episode)

    def episode(self, index: int) -> "Episode":
        """The recording itself, with what is privileged; pictures are decoded when asked for."""
        dataset, episode = self.places[index]
        return self.features[dataset].episode(episode)

    def file(self, index: int) -> "Path":
        """Of the recording."""
        dataset, episode = self.places[index]
        return self.features[dataset].file(episode)


def held_apart(
    datasets: Sequence["Recordings"], features: Iterable["Features"], share: float, seed: int, most: int | None = None
) -> tuple[RecordedBoards, RecordedBoards]:
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
            group_of[number, episode] = (boards[episode].seed, boards[episode].split, boards[episode].appearance_group)
    if not group_of:
        raise BusybotError("no board has an episode to train on", "busybot collect DATASET")
    held = groups_apart(set(group_of.values()), share, seed, "reason/held out")
    train = tuple(place for place, group in group_of.items() if group not in held)
    judge = tuple(place for place, group in group_of.items() if group in held)
    return RecordedBoards(known, train[:most]), RecordedBoards(known, judge)


class BoardDataset(Dataset):
    """A graph for every board; each has a node of type `step` for every action on it.

    Args:
        boards: graphs, or what they are made of.
        graph: makes one, whenever it is asked for.
    """

    def __init__(self, boards: Sequence[Any], graph: Callable[[Any], HeteroData] = lambda board: board):
        super().__init__()
        self.boards, self.graph = boards, graph

    def len(self) -> int:
        """Number of boards."""
        return len(self.boards)

    def get(self, idx: int) -> HeteroData:
        """The graph of a board."""
        return self.graph(self.boards[idx])

    def __getitems__(self, indices: Iterable[int]) -> list[HeteroData]:
        """The graphs of a batch, for the loader.

        Raises:
            BusybotError: boards were watched for different numbers of steps.
        """
        graphs = [self[int(index)] for index in indices]
        lengths = sorted({graph["step"].num_nodes for graph in graphs})
        if len(lengths) > 1:
            what = f"boards with {', '.join(map(str, lengths))} steps in one batch"
            raise BusybotError(what, "train on datasets whose episodes have equally many steps")
        return graphs


def batches_of(
    dataset: torch.utils.data.Dataset[HeteroData] | Sequence[HeteroData], chosen: Iterable[Sequence[int] | np.ndarray]
) -> Iterator[Batch]:
    """The chosen boards of each batch as one graph."""
    generator = torch.Generator()  # the loader draws a seed for its workers; not from the numbers of the whole process
    return iter(DataLoader(dataset, batch_sampler=chosen, generator=generator))


def in_turn(boards: int, batch: int, on: torch.device) -> Iterator[range]:
    """The numbers of all boards, `batch` at once, on a GPU more if there is memory."""
    return (range(part.start, part.stop) for part in slices(boards, batch, on))


def step_targets(batch: Batch, kind: str) -> torch.Tensor:
    """The node of a type that each step touches, int64 (B, T); -1 for none."""
    step, node = batch["step", "touches", kind].edge_index
    targets = torch.full((batch["step"].num_nodes,), -1, device=node.device)
    targets[step] = node
    return targets.view(batch.num_graphs, len(targets) // batch.num_graphs)


def touches(targets: np.ndarray) -> torch.Tensor:
    """Edges from steps to the nodes that they touch, int64 (2, A): the inverse of `step_targets` for one board."""
    steps = np.flatnonzero(targets >= 0)
    return torch.from_numpy(np.stack([steps, targets[steps]]).astype(np.int64))
