"""A training that is stopped and goes on ends in the weights of one that is not."""

from pathlib import Path

import numpy as np
import pytest
import torch

from busybot.errors import BusybotError
from busybot.reason.paper_config import PaperReasonConfig
from busybot.reason.paper_learner import PaperLearner
from busybot.reason.sequence import Sequence
from tests.reason.paper_scenes import SMALL, watched

CONFIG = PaperReasonConfig(
    network=SMALL.model_copy(update={"dropout": 0.2, "pairs": "candidates"}), images=4, epochs=3, batch=2
)
BOARDS = [watched(seed, steps=5) for seed in range(3)]


def learner(folder: Path, config: PaperReasonConfig = CONFIG) -> PaperLearner:
    return PaperLearner(config, 0, len(BOARDS), folder / "checkpoint.safetensors")


def go_on(learner: PaperLearner, until: int) -> list[float]:
    """Iterate; the losses."""
    losses = []
    while learner.iteration < until:
        sequences: list[Sequence] = [BOARDS[board] for board in learner.chosen()]
        losses.append(learner.iterate(sequences).loss)
    return losses


def test_the_schedule_is_so_many_epochs_over_all_boards(tmp_path: Path) -> None:
    whole = learner(tmp_path)
    assert whole.iterations == 3 * 2
    seen = []
    for whole.iteration in range(6):
        seen.append(list(whole.chosen()))
    assert [len(batch) for batch in seen] == [2, 1] * 3
    assert all(sorted(seen[2 * epoch] + seen[2 * epoch + 1]) == [0, 1, 2] for epoch in range(3))
    paper = PaperReasonConfig(network=SMALL)
    assert PaperLearner(paper, 0, 10_000, tmp_path / "none").iterations == 200 * 157


@pytest.mark.parametrize("inference", [True, False])
def test_a_stopped_training_goes_on_exactly(tmp_path: Path, inference: bool) -> None:
    config = CONFIG.model_copy(update={"inference": inference})
    whole = learner(tmp_path, config)
    losses = go_on(whole, 6)
    first = learner(tmp_path, config)
    assert first.iteration == 0
    begun = go_on(first, 3)
    first.save()
    second = learner(tmp_path, config)
    assert second.iteration == 3 and second.last == begun[-1]
    assert begun + go_on(second, 6) == losses
    for one, other in zip(whole.network.state_dict().values(), second.network.state_dict().values(), strict=True):
        assert torch.equal(one, other)


def test_what_is_learnt_can_be_asked(tmp_path: Path) -> None:
    trained = learner(tmp_path)
    go_on(trained, 1)
    reasoner = trained.reasoner("embedded")
    assert reasoner.encoder == "embedded" and reasoner.graph(BOARDS[0]).probabilities[:, BOARDS[0].candidates].all()
    after = reasoner.predict(BOARDS[0].first(4), BOARDS[0].features[3:5], BOARDS[0].actions[3:], np.array([0, 1]))
    assert after.shape == (2, 5, 256)


def test_a_checkpoint_of_other_networks_is_refused(tmp_path: Path) -> None:
    learner(tmp_path).save()
    other = CONFIG.model_copy(update={"network": SMALL.model_copy(update={"hidden": 9})})
    with pytest.raises(BusybotError, match=r"checkpoint\.safetensors: not the weights of this network"):
        learner(tmp_path, other)
