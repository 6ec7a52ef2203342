"""Boards that stay on the device: batches of them are those that are read, bit by bit, and so are the weights."""

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import torch
from torch import Tensor

from busybot.reason.models.paper.config import PaperLoopConfig, PaperReasonConfig
from busybot.reason.models.paper.data import boards_of
from busybot.reason.models.paper.learner import PaperLearner
from busybot.reason.models.paper.resident import ResidentBoards
from busybot.training.loop import fit
from tests.reason.paper_scenes import SMALL, watched

BOARDS = [watched(seed, triggers=1 + seed % 3, responders=2 + seed % 4, steps=5) for seed in range(7)]
"""Of 3 to 8 objects; the network has 6 nodes."""


@pytest.fixture(autouse=True)
def threads() -> Iterator[None]:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


@pytest.mark.parametrize("pairs", ["all", "candidates"])
@pytest.mark.parametrize("chosen", [[4], [6, 0, 3], [2, 5, 1, 4, 0, 6, 3]])
def test_a_batch_is_the_one_that_is_read(pairs: Literal["all", "candidates"], chosen: list[int]) -> None:
    config = SMALL.model_copy(update={"pairs": pairs})
    expected = boards_of([BOARDS[number] for number in chosen], config)
    parts = [boards_of(BOARDS[:3], config), boards_of(BOARDS[3:], config)]
    batch = ResidentBoards(parts).batch(np.array(chosen))
    assert batch.sizes == expected.sizes and sum(batch.sizes) == len(batch.positions)
    for name, value in vars(expected).items():
        assert not isinstance(value, Tensor) or torch.equal(getattr(batch, name), value), name


def test_no_number_leaves_the_device() -> None:
    """On a device without numbers whatever asked for one would be refused."""
    whole = boards_of(BOARDS, SMALL)
    resident = ResidentBoards([whole])
    resident._boards = whole.to("meta")
    batch = resident.batch(np.array([3, 1]))
    assert {value.device.type for value in vars(batch).values() if isinstance(value, Tensor)} == {"meta"}
    assert batch.features.shape == (12, 6, 256) and batch.sizes == (6, 6)


def test_a_training_ends_in_the_weights_of_one_that_reads_its_boards(tmp_path: Path) -> None:
    loop = PaperLoopConfig(judge=2, report=1)
    config = PaperReasonConfig(network=SMALL, images=4, epochs=2, batch=3, threads=1, loop=loop)
    ended = {}
    for name, resident in (("read", False), ("resident", True)):
        learner = PaperLearner(config, BOARDS, [], 0, resident)
        fit(learner, tmp_path / name, config.loop)
        ended[name] = learner.network.state_dict()
    assert all(torch.equal(value, ended["resident"][name]) for name, value in ended["read"].items())
