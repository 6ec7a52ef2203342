"""Boards as a PyTorch Geometric dataset: what is read when, in which order, and what is drawn for it (nothing)."""

import numpy as np
import pytest
import torch
from torch_geometric.data import Dataset, HeteroData

from busybot.common.errors import BusybotError
from busybot.reason.inputs.board_dataset import BoardDataset, batches_of, in_turn, step_targets, touches


def graph(number: int, steps: int = 3) -> HeteroData:
    """A board of `number` + 1 objects whose steps touch object 0, nothing, object 0 and so on."""
    data = HeteroData()
    data["object"].pos = torch.full((number + 1, 3), float(number))
    data["step"].num_nodes = steps
    data["step", "touches", "object"].edge_index = touches(np.where(np.arange(steps) % 2, -1, 0))
    return data


def test_it_is_a_dataset_of_pytorch_geometric() -> None:
    made: list[int] = []

    def noting(number: int) -> HeteroData:
        made.append(number)
        return graph(number)

    dataset = BoardDataset([4, 2, 0, 7], noting)
    assert isinstance(dataset, Dataset) and len(dataset) == 4 and not made
    assert len(dataset[1]["object"].pos) == 3 and made == [2]
    assert [len(data["object"].pos) for data in dataset[[3, 0]]] == [8, 5]
    kept = [graph(1), graph(5)]
    assert BoardDataset(kept)[1] is kept[1]


def test_batches_hold_the_chosen_boards_in_their_order() -> None:
    batches = list(batches_of(BoardDataset(range(5), graph), [np.array([3, 1]), [0]]))
    assert [batch.num_graphs for batch in batches] == [2, 1]
    assert batches[0]["object"].pos[:, 0].tolist() == [3] * 4 + [1] * 2
    assert batches[0]["object"].batch.tolist() == [0] * 4 + [1] * 2
    assert step_targets(batches[0], "object").tolist() == [[0, -1, 0], [4, -1, 4]]


def test_loading_draws_no_number_of_the_process() -> None:
    torch.manual_seed(0)
    next(batches_of(BoardDataset(range(5), graph), [[3, 1]]))
    drawn = torch.rand(1)
    torch.manual_seed(0)
    assert torch.equal(drawn, torch.rand(1))


@pytest.mark.parametrize("steps", [0, 1, 4])
def test_steps_and_what_they_touch(steps: int) -> None:
    batch = next(batches_of(BoardDataset([0, 1], lambda number: graph(number, steps)), [[0, 1]]))
    expected = [[node if step % 2 == 0 else -1 for step in range(steps)] for node in (0, 1)]
    assert step_targets(batch, "object").tolist() == expected


def test_boards_in_turn() -> None:
    cpu = torch.device("cpu")
    assert [list(part) for part in in_turn(5, 2, cpu)] == [[0, 1], [2, 3], [4]]
    assert list(in_turn(0, 2, cpu)) == []


def test_boards_with_different_numbers_of_steps_do_not_go_together() -> None:
    dataset = BoardDataset([5, 6], lambda steps: graph(1, steps))
    assert next(batches_of(dataset, [[1]]))["step"].num_nodes == 6
    with pytest.raises(BusybotError, match="boards with 5, 6 steps in one batch"):
        next(batches_of(dataset, [[0, 1]]))
