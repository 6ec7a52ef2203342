"""The schedule of the paper's training, and that a stopped training ends in the weights of one that is not."""

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from busybot.common.errors import BusybotError
from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.paper.config import PaperLoopConfig, PaperReasonConfig
from busybot.reason.models.paper.learner import PaperLearner
from busybot.reason.models.paper.networks import PaperHistoryNetwork, PaperNetwork, PaperReasoner
from busybot.reason.models.registry import ReasonerInfo, load_reasoner
from busybot.training.checkpoint import save_model
from busybot.training.loop import fit
from tests.reason.paper_scenes import SMALL, watched

CONFIG = PaperReasonConfig(
    network=SMALL.model_copy(update={"dropout": 0.2, "pairs": "candidates"}),
    images=4,
    epochs=3,
    batch=2,
    threads=1,
    loop=PaperLoopConfig(judge=2, report=1),
)
BOARDS = [watched(seed, steps=5) for seed in range(3)]
HELD_OUT = [watched(seed, steps=5) for seed in range(10, 13)]


@pytest.fixture(autouse=True)
def threads() -> Iterator[None]:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


class Killed(PaperLearner):
    """Dies in its fourth iteration."""

    def iterate(self, iteration: int) -> tuple[float, float]:
        if iteration == 3:
            raise KeyboardInterrupt
        return super().iterate(iteration)


def test_the_schedule_is_200_epochs_over_all_boards() -> None:
    paper = PaperLearner(PaperReasonConfig(network=SMALL, threads=1), BOARDS * 50, [], 0)
    assert paper.iterations == 200 * 3  # 150 boards, 64 at once
    assert PaperReasonConfig().loop.patience == PaperReasonConfig().loop.held_out == 0


class Watching(list[BoardSequence]):
    """Boards that note which of them are read."""

    def __init__(self, boards: Iterable[BoardSequence]):
        super().__init__(boards)
        self.read: list[int] = []

    def __getitem__(self, index: Any) -> Any:
        self.read.append(index)
        return super().__getitem__(index)


def test_an_epoch_sees_every_board_and_reads_those_of_an_iteration_only() -> None:
    boards = Watching(BOARDS)
    learner = PaperLearner(CONFIG, boards, [], 0)
    assert not boards.read
    for iteration in range(4):
        learner.iterate(iteration)
        assert len(boards.read) == (2, 3, 5, 6)[iteration]
    assert sorted(boards.read[:3]) == sorted(boards.read[3:]) == [0, 1, 2]


@pytest.mark.parametrize("inference", [True, False])
def test_killed_and_continued_it_ends_in_the_same_weights(tmp_path: Path, inference: bool) -> None:
    config = CONFIG.model_copy(update={"inference": inference})
    straight, continued = (PaperLearner(config, BOARDS, [], 0) for _ in range(2))
    fit(straight, tmp_path / "straight", config.loop)
    with pytest.raises(KeyboardInterrupt):
        fit(Killed(config, BOARDS, [], 0), tmp_path / "killed", config.loop)
    fit(continued, tmp_path / "killed", config.loop)
    assert continued.last == straight.last
    for one, other in zip(straight.network.state_dict().values(), continued.network.state_dict().values(), strict=True):
        assert torch.equal(one, other)
    other_seed = PaperLearner(config, BOARDS, [], 1).network.state_dict()
    assert not torch.equal(
        other_seed["spatial.encode_node.first.weight"], straight.network.spatial.encode_node.first.weight
    )


def test_the_last_weights_are_kept_unless_boards_are_held_out(tmp_path: Path) -> None:
    figures = fit(PaperLearner(CONFIG, BOARDS, [], 0), tmp_path / "all", CONFIG.loop)
    assert figures["best_iteration"] == figures["iterations"] == 6 and figures["held_out"] == {}
    judged = fit(PaperLearner(CONFIG, BOARDS, HELD_OUT, 0), tmp_path / "some", CONFIG.loop)
    looks = [(seen.features[3:5] - seen.features[4:6])[:, seen.responders] for seen in HELD_OUT]
    assert judged["held_out"]["loss_of_no_change"] == pytest.approx(np.mean(np.square(looks)), rel=1e-5)
    assert judged["held_out"]["loss"] > 0
    assert json.loads((tmp_path / "some" / "metrics.json").read_text()) == judged


@pytest.mark.parametrize(("inference", "kind"), [(True, PaperNetwork), (False, PaperHistoryNetwork)])
def test_a_saved_model_is_loaded_again(tmp_path: Path, inference: bool, kind: type) -> None:
    config = CONFIG.model_copy(update={"inference": inference})
    learner = PaperLearner(config, BOARDS, [], 0)
    learner.iterate(0)
    former = config.model_dump(mode="json", exclude={"observed", "steps"})  # cards of former versions have none
    info = ReasonerInfo(model="paper", encoder="random", config=former)
    save_model(tmp_path / "model", info, learner.network.state_dict())
    reasoner = load_reasoner(tmp_path)
    assert isinstance(reasoner, PaperReasoner) and isinstance(reasoner.network, kind) and reasoner.encoder == "random"
    seen = BOARDS[0]
    asked = (seen.first(4), seen.features[3:5], seen.actions[3:], seen.acted[3:])
    expected = PaperReasoner(learner.network, "random").predict(*asked)
    assert np.array_equal(reasoner.predict(*asked), expected)


def test_without_boards_there_is_nothing_to_train() -> None:
    with pytest.raises(BusybotError, match="no board to train on"):
        PaperLearner(CONFIG, [], HELD_OUT, 0)
