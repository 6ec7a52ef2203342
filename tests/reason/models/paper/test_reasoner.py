"""The paper's networks as a reasoner: shapes, what they may know, other people's boards."""

import numpy as np
import pytest
import torch

from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.base import Reasoner, believed
from busybot.reason.models.paper.config import PaperNetworkConfig
from busybot.reason.models.paper.networks import PaperNetwork, PaperReasoner
from tests.reason.paper_scenes import SMALL, watched

CANDIDATES = SMALL.model_copy(update={"pairs": "candidates"})


@pytest.fixture(params=[SMALL, CANDIDATES], ids=["all", "candidates"])
def reasoner(request: pytest.FixtureRequest) -> PaperReasoner:
    torch.manual_seed(0)
    config: PaperNetworkConfig = request.param
    return PaperReasoner(PaperNetwork(config), "embedded")


def ahead(seen: BoardSequence, images: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frames before, and actions, of the steps after so many images."""
    return seen.features[images - 1 : -1], seen.actions[images - 1 :], seen.acted[images - 1 :]


def test_it_is_a_reasoner(reasoner: PaperReasoner) -> None:
    as_declared: Reasoner = reasoner
    assert (as_declared.name, as_declared.encoder) == ("paper", "embedded")


def test_a_graph_has_probabilities_of_candidates_after_each_step(reasoner: PaperReasoner) -> None:
    seen = watched(triggers=2, responders=3, steps=6)
    graph = reasoner.graph(seen)
    assert graph.probabilities.shape == (6, 5, 5) and graph.prior is not None and graph.threshold == 0.5
    assert not graph.probabilities[:, ~seen.candidates].any()
    inside = graph.probabilities[:, seen.candidates]
    assert ((inside > 0) & (inside < 1)).all() and len(np.unique(inside)) > 6


def test_what_is_believed_after_a_step_is_what_a_shorter_sequence_says(reasoner: PaperReasoner) -> None:
    seen = watched(steps=6)
    graph = reasoner.graph(seen)
    for steps in range(1, 6):
        shorter = reasoner.graph(seen.first(steps + 1))
        assert np.allclose(shorter.after(steps), graph.after(steps), atol=1e-6)
        brief = believed(reasoner, seen.first(steps + 1))
        assert len(brief.probabilities) == 1 and np.array_equal(brief.probabilities[-1], shorter.probabilities[-1])
        assert np.array_equal(brief.after(0), shorter.after(0))
    alone = reasoner.graph(seen.first(1))
    assert alone.probabilities.shape == (1, 5, 5) and np.allclose(alone.after(1), graph.after(0), atol=1e-6)


def test_probabilities_are_those_of_the_network(reasoner: PaperReasoner) -> None:
    seen = watched(triggers=2, responders=3, steps=6)
    boards = reasoner.board_of(seen)
    assert isinstance(reasoner.network, PaperNetwork)
    with torch.no_grad():
        relations = reasoner.network.infer(boards.edge_index, boards.observed(7))
    matrix = reasoner.graph(seen).after(6)
    pairs = zip(*boards.edge_index, relations.probabilities, strict=True)
    found = {(int(sender), int(receiver)): float(p) for sender, receiver, p in pairs}
    for trigger, responder in zip(*np.nonzero(seen.candidates), strict=True):
        assert matrix[trigger, responder] == pytest.approx(found[trigger, responder], abs=1e-6)


def test_steps_are_predicted_each_on_its_own_and_for_responders_only(reasoner: PaperReasoner) -> None:
    seen = watched(triggers=2, responders=3, steps=8)
    current, actions, acted = ahead(seen, 5)
    acted = np.array([0, 1, -1, 0])
    after = reasoner.predict(seen.first(5), current, actions, acted)
    assert after.shape == current.shape and after.dtype == np.float32
    assert np.array_equal(after[:, seen.triggers], current[:, seen.triggers])
    assert (after[:, seen.responders] != current[:, seen.responders]).all((1, 2)).all()
    for step in range(4):
        one = slice(step, step + 1)
        alone = reasoner.predict(seen.first(5), current[one], actions[one], acted[one])
        assert np.allclose(alone, after[one], atol=1e-5)


def test_predictions_are_those_of_the_training(reasoner: PaperReasoner) -> None:
    seen = watched(triggers=2, responders=3, steps=8)
    with torch.no_grad():
        expected = reasoner.network(reasoner.board_of(seen), 5)[0].transpose(0, 1).numpy()
    after = reasoner.predict(seen.first(5), *ahead(seen, 5))
    responders = np.flatnonzero(seen.responders)
    assert np.allclose(after[:, responders], expected[:, responders], atol=1e-5)


def test_relations_of_a_history_are_inferred_once(reasoner: PaperReasoner, monkeypatch: pytest.MonkeyPatch) -> None:
    """An agent asks at every step."""
    seen, inferred, infer = watched(triggers=2, responders=3, steps=8), [], PaperNetwork.infer
    monkeypatch.setattr(PaperNetwork, "infer", lambda *told: inferred.append(1) or infer(*told))
    known, current = seen.first(5), ahead(seen, 5)
    once, again = (reasoner.predict(known, *current) for _ in range(2))
    assert np.array_equal(once, again) and len(inferred) == 1
    reasoner.predict(seen.first(6), *current)
    assert len(inferred) == 2, "other images, other relations"


@pytest.mark.parametrize(("triggers", "responders"), [(0, 3), (3, 0), (1, 1), (4, 8), (0, 0)])
def test_any_number_of_objects_will_do(reasoner: PaperReasoner, triggers: int, responders: int) -> None:
    seen = watched(triggers=triggers or 1, responders=responders or 1, steps=4)
    kept = [
        i for i in range(len(seen.positions)) if (seen.triggers[i] and triggers) or (seen.responders[i] and responders)
    ]
    seen = BoardSequence(
        seen.features[:, kept],
        seen.positions[kept],
        seen.actions,
        np.where(triggers, seen.acted, -1),
        seen.triggers[kept],
        seen.responders[kept],
    )
    graph = reasoner.graph(seen)
    assert graph.probabilities.shape == (4, len(kept), len(kept)) and np.isfinite(graph.probabilities).all()
    after = reasoner.predict(seen.first(3), *ahead(seen, 3))
    assert after.shape == (2, len(kept), 256) and np.isfinite(after).all()
    assert reasoner.predict(seen, np.zeros((0, len(kept), 256)), np.zeros((0, 6)), np.zeros(0, int)).shape[0] == 0
