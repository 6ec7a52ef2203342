"""What is believed of links that nobody saw moving."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BODY
from busybot.boards.true_causes import relations_at
from busybot.objects.resolve import find
from busybot.reason.models.mechanism.config import MechanismConfig, MechanismNetConfig
from busybot.reason.models.mechanism.contexts import Trace
from busybot.reason.models.mechanism.networks import MechanismNet
from busybot.reason.models.mechanism.reasoner import MechanismReasoner
from busybot.reason.models.mechanism.training.labelled import (
    LabelledTrace,
    LabelledTriggers,
    draw_boards,
    true_triggers,
)
from busybot.reason.models.mechanism.training.learner import MechanismLearner
from busybot.reason.models.mechanism.unseen import FACTS, SEVERAL, Pairs, Touched, Unseen, UnseenAlike, UnseenByWorld

ACTIONS = 6


@pytest.fixture
def touched() -> Touched:
    """Trigger 4 has two known links, of which one moves in the second action, trigger 7 none; the first responder
    changes after the third. The fourth and the fifth touch trigger 7, the sixth trigger 4 in vain."""
    links, responders = np.zeros((ACTIONS + 1, 2), int), np.zeros((ACTIONS + 1, 2), int)
    links[2:, 1], responders[3:, 0] = 1, 1
    return Touched(Trace(links, responders, (2, 2)), np.array([4, 4]), np.array([-1, 4, -1, 7, 7, 4]), np.array([4, 7]))


INPUTS = np.array([[0, 0, 0, 0], [1, 0, 0, 0], [1, 1, 0, 0], [0, 0, 0, 1]], bool)
"""Nothing, one link, both, a responder."""


def test_what_is_known_of_pairs(touched: Touched) -> None:
    shares = np.tile(np.array([[0.4, 0.3, 0.2, 0.1], [1, 0, 0, 0]])[..., None], 2)
    pairs = touched.pairs([1, 6], shares, INPUTS)
    assert pairs.kinds.tolist() == [2, 0] and pairs.facts.shape == (2, 2, 2, FACTS)
    assert pairs.believed[1].tolist() == [[0.5, 0.0], [0.0, 0.0]], "no link of the second trigger is known"
    one, unexplained, changed, strange, actions, _, tries, _, alone, links = pairs.facts.double().unbind(-1)
    assert (one == 1).all() and unexplained[1].tolist() == pytest.approx(np.array([[0.5, 1.0]] * 2))
    assert changed.tolist() == [[[0, 0], [0, 0]], [[1, 0], [1, 0]]]
    assert torch.equal(strange, unexplained * changed) and torch.allclose(alone, strange / 2)
    assert actions[:, 0, 0].tolist() == pytest.approx(np.log([2, 7])) and (links == 1).all()
    assert tries[0].tolist() == [[0, 0], [0, 0]] and tries[1, :, 0].tolist() == pytest.approx(np.log([2, 3]))


def test_what_it_says_is_more_than_what_known_links_make_probable(touched: Touched) -> None:
    shares = np.tile(np.array([[0.0, 0.3, 0.7, 0.0], [0.9, 0.1, 0.0, 0.0]])[..., None], ACTIONS + 1)
    pairs, net = touched.pairs(range(ACTIONS + 1), shares, INPUTS), UnseenAlike(1)
    with torch.no_grad():
        net.weight += torch.randn(net.weight.shape, generator=torch.Generator().manual_seed(0))
        told = net(pairs, 1)
    assert told.shape == (ACTIONS + 1, 2, 2) and (told >= pairs.believed - 1e-6).all() and (told <= 1).all()
    assert told[:, 0, 0].tolist() == pytest.approx([1.0] * 7), "what is sure stays so"


def entropy(p: float) -> float:
    return float(-p * np.log(p) - (1 - p) * np.log(1 - p))


@pytest.mark.parametrize("kind", [UnseenAlike, UnseenByWorld])
def test_it_learns_how_often_triggers_decide_of_which_nothing_is_known(kind: type[Unseen]) -> None:
    """Half of those decide in the first world, nine of ten in the second; of others only what is believed is true."""
    rng, boards, true = np.random.default_rng(0), [], []
    for number in range(400):
        world, kinds = number % 2 + 1, torch.tensor([0, SEVERAL])
        believed = torch.zeros(1, 2, 3)
        believed[:, 1] = 0.3
        facts = torch.cat([torch.ones(1, 2, 3, 1), torch.zeros(1, 2, 3, FACTS - 1)], -1)
        boards.append((Pairs(believed, facts, kinds), world))
        often = np.array([[[0.5 if world == 1 else 0.9], [0.3]]])
        true.append(rng.random((1, 2, 3)) < often)
    net = kind(2)
    loss = net.learn(boards, true)
    assert loss == pytest.approx(np.mean([entropy(0.5), entropy(0.9), 2 * entropy(0.3)]) * 3 / 4, abs=0.02)
    told = [net(pairs, world)[0, :, 0].tolist() for pairs, world in boards[:2]]
    assert told[0] == pytest.approx([0.5, 0.3], abs=0.06) and told[1] == pytest.approx([0.9, 0.3], abs=0.06)
    again, learned = kind(2), net.state_dict()
    assert again.learn(boards, true) == loss
    assert all(torch.equal(one, learned[name]) for name, one in again.state_dict().items())


def test_it_may_speak_against_what_known_links_make_probable() -> None:
    """Where a fact holds, only half as often is true what is believed; before it learns it says what is believed."""
    rng, boards, true = np.random.default_rng(0), [], []
    for _ in range(400):
        held, believed = rng.random((1, 1, 3)) < 0.5, torch.full((1, 1, 3), 0.6)
        facts = torch.zeros(1, 1, 3, FACTS)
        facts[..., 0], facts[..., 6] = 1, torch.from_numpy(held)
        boards.append((Pairs(believed, facts, torch.tensor([1])), 1))
        true.append(rng.random((1, 1, 3)) < np.where(held, 0.3, 0.6))
    net = UnseenByWorld(1)
    assert torch.allclose(net(*boards[0]), boards[0][0].believed)
    net.learn(boards, true)
    pairs, _ = boards[0]
    told = net(Pairs(pairs.believed, torch.eye(FACTS)[[0, 0, 6]][None, None] + torch.eye(FACTS)[0], pairs.kinds), 1)
    assert told[0, 0, 2].item() == pytest.approx(0.3, abs=0.06)
    told = net(Pairs(pairs.believed, torch.eye(FACTS)[[0, 0, 0]][None, None], pairs.kinds), 1)
    assert told[0, 0].tolist() == pytest.approx([0.6] * 3, abs=0.06)


def test_worlds_may_weigh_facts_in_their_own_way() -> None:
    """In one world links are there where a fact holds, in the other where it does not."""
    rng, boards, true = np.random.default_rng(0), [], []
    for number in range(400):
        world, held = number % 2 + 1, rng.random((1, 1, 3)) < 0.5
        facts = torch.zeros(1, 1, 3, FACTS)
        facts[..., 0], facts[..., 2] = 1, torch.from_numpy(held)
        boards.append((Pairs(torch.zeros(1, 1, 3), facts, torch.tensor([1])), world))
        true.append(rng.random((1, 1, 3)) < np.where(held == (world == 1), 0.8, 0.1))
    alike, apart = (kind(2).learn(boards, true) for kind in (UnseenAlike, UnseenByWorld))
    best = (entropy(0.8) + entropy(0.1)) / 2
    assert alike > 0.6 and best < apart < best + 0.12, "as far as its boards tell that it differs"


def test_the_truth_tells_which_triggers_decide_whatever_the_link() -> None:
    changed = 0
    for board in generate_boards(BoardConfig(world="rewired", boards=6, seed=3, group_size=1), find("procedural")):
        triggers = [index for index, placed in enumerate(board.objects) if placed.role == "trigger"]
        responders = [index for index, placed in enumerate(board.objects) if placed.role == "responder"]
        told = np.array([true_triggers(board, triggers, responders, actions) for actions in range(41)])
        assert told.shape == (41, len(triggers), len(responders)) and np.array_equal(told[0], told[1])
        for moment in {0, 40} | {one.step + more for one in board.rewirings for more in (0, 1)}:
            relations = relations_at(board, moment)
            for place, responder in enumerate(responders):
                read = [ref for one in relations if one.responder == responder for ref in one.triggers]
                own = {ref.object for ref in read if ref.link != BODY}
                assert {triggers[row] for row in np.flatnonzero(told[moment, :, place])} == own
        changed += sum(not np.array_equal(told[one.step], told[one.step + 1]) for one in board.rewirings)
    assert changed > 1


@pytest.mark.long
def test_the_end_of_a_training_learns_it_and_nothing_else() -> None:
    """Boards of which half the links are hidden, each of a trigger of its own."""
    boards: list[LabelledTrace] = []
    for _, whole in draw_boards("gates", 12, 5, find("procedural"), 20):
        assert whole.parents is not None
        count, seen = len(whole.trace.sizes), slice(0, len(whole.trace.sizes) // 2)
        trace = replace(whole.trace, links=whole.trace.links[:, seen], sizes=whole.trace.sizes[seen])
        kept = np.r_[np.arange(len(trace.sizes)), np.arange(count, whole.parents.shape[1])]
        parts = []
        for actions in (5, 20):
            touched = Touched(trace.first(actions), np.arange(len(trace.sizes)), np.full(actions, -1), np.arange(count))
            parts.append(LabelledTriggers(touched, whole.parents[actions - 1, :count]))
        boards.append(replace(whole, trace=trace, parents=whole.parents[:, kept], triggers=tuple(parts)))
    told = MechanismNetConfig(worlds=("gates",), unseen=True)
    learner = MechanismLearner(MechanismConfig(net=told), boards, [], 0)
    before = {name: one.clone() for name, one in learner.network.state_dict().items()}
    learner.conclude()
    after = learner.network.state_dict()
    changed = {name for name in after if not torch.equal(after[name], before[name])}
    assert changed == {"unseen.weight", "unseen.world"}
    unseen = learner.network.unseen
    assert unseen is not None and not MechanismNet(MechanismNetConfig()).unseen
    reasoner, said, right = MechanismReasoner(learner.network, ""), [], []
    for board in boards:
        for part in board.triggers:
            actions = [len(part.touched.acted)]
            found, shares, _ = reasoner.explain(part.touched.trace, actions, "gates")
            with torch.no_grad():
                told = unseen(part.touched.pairs(actions, shares, found.inputs), 1)
            hidden = slice(len(board.trace.sizes), None)
            said.append(told[0, hidden].numpy().mean())
            right.append(part.deciding[hidden].mean())
    said_by, right_by = np.array(said).reshape(-1, 2).mean(0), np.array(right).reshape(-1, 2).mean(0)
    assert said_by.tolist() == pytest.approx(right_by.tolist(), abs=0.05), "after 5 actions, and after 20"
