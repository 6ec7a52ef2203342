"""Boards as a PyTorch Geometric dataset, over stored features or in memory, and batches of them from its `DataLoader`.

A model says what graph it makes of a board (`event_data.board_graph`, `paper_boards.board_graph`). Which boards an
iteration sees is drawn by the learner, so that a training that was stopped goes on with the same batches.
"""

from collections.abc import Callable, Iterable, Iterator
from collections.abc import Sequence as Several
from typing import Any, Protocol, TypeVar

import numpy as np
import torch
from torch_geometric.data import Batch, Dataset, HeteroData
from torch_geometric.loader import DataLoader

from busybot.common.errors import BusybotError

Board_co = TypeVar("Board_co", covariant=True)


class BoardSource(Protocol[Board_co]):
    """Boards in memory, or stored ones that are read one by one when they are asked for (`recorded.Recorded`)."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> Board_co: ...


class BoardDataset(Dataset):
    """A graph for every board; each has a node of type `step` for every action on it.

    Args:
        boards: graphs, or what they are made of.
        graph: makes one, whenever it is asked for.
    """

    def __init__(self, boards: BoardSource[Any], graph: Callable[[Any], HeteroData] = lambda board: board):
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


def batches_of(dataset: BoardDataset, chosen: Iterable[Several[int] | np.ndarray]) -> Iterator[Batch]:
    """The chosen boards of each batch as one graph."""
    generator = torch.Generator()  # the loader draws a seed for its workers; not from the numbers of the whole process
    return iter(DataLoader(dataset, batch_sampler=chosen, generator=generator))


def in_turn(boards: int, batch: int) -> list[range]:
    """The numbers of all boards, at most `batch` at once."""
    return [range(start, min(start + batch, boards)) for start in range(0, boards, batch)]


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
