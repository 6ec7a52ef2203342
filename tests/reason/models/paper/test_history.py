"""The ablation without inference: no graph, predictions from all that was seen."""

import numpy as np
import pytest
import torch

from busybot.common.rng import generator
from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.base import Reasoner
from busybot.reason.models.paper.config import PaperReasonConfig
from busybot.reason.models.paper.data import boards_of
from busybot.reason.models.paper.learner import iterate, make_network, make_optimizer
from busybot.reason.models.paper.networks import PaperHistoryNetwork, PaperReasoner
from tests.reason.paper_scenes import SMALL, watched

IMAGES = 4


@pytest.fixture(scope="module", params=["all", "candidates"])
def network(request: pytest.FixtureRequest) -> PaperHistoryNetwork:
    torch.manual_seed(0)
    return PaperHistoryNetwork(SMALL.model_copy(update={"pairs": request.param})).eval()


def predicted(network: PaperHistoryNetwork, seen: BoardSequence) -> torch.Tensor:
    with torch.no_grad():
        return network(boards_of([seen], network.config), IMAGES)[0]


@pytest.mark.parametrize("what", ["features", "actions", "acted"])
def test_a_prediction_depends_on_all_that_was_seen_and_on_its_own_step(network: PaperHistoryNetwork, what: str) -> None:
    seen = watched(steps=7)
    before = predicted(network, seen)
    for step in range(7):
        other = BoardSequence(**{name: value.copy() for name, value in seen.arrays.items()})
        changed = getattr(other, what)
        changed[step] = 1 - changed[step]
        moved = (predicted(network, other) - before).abs().amax((0, 2)) > 0
        if step < IMAGES - 1:
            assert moved.all()  # steps 3 to 6 are predicted
        elif what == "features" and step == IMAGES - 1:
            assert moved.all()  # the last frame seen
        else:
            assert moved.tolist() == [step == number for number in range(3, 7)]


def test_it_predicts_as_in_training_and_claims_no_relation(network: PaperHistoryNetwork) -> None:
    seen = watched(steps=7)
    reasoner: Reasoner = PaperReasoner(network, "embedded")
    after = reasoner.predict(seen.first(IMAGES), seen.features[3:7], seen.actions[3:], seen.acted[3:])
    expected = predicted(network, seen).transpose(0, 1).numpy()
    responders = np.flatnonzero(seen.responders)
    assert np.allclose(after[:, responders], expected[:, responders], atol=1e-5)
    assert np.array_equal(after[:, seen.triggers], seen.features[3:7, seen.triggers])
    assert not reasoner.graph(seen).claimed(7).any()


def test_it_is_trained_like_the_full_model() -> None:
    config = PaperReasonConfig(network=SMALL, images=IMAGES, inference=False, learning_rate=1e-2)
    network, boards = make_network(config, 0), boards_of([watched(1), watched(2)], SMALL)
    optimizer = make_optimizer(network, config)
    outcomes = [iterate(network, optimizer, boards, config, generator(0, "train", n, "test")) for n in range(15)]
    assert isinstance(network, PaperHistoryNetwork) and all(outcome.divergence == 0 for outcome in outcomes)
    assert outcomes[-1].error < 0.8 * outcomes[0].error
