"""What the relations of a board have in common, against all assignments one by one, and on boards that are drawn."""

from itertools import permutations

import numpy as np
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.dynamics import Dynamics
from busybot.boards.generate import generate_boards
from busybot.boards.worlds import links_of
from busybot.objects.resolve import find
from busybot.reason.evaluation import wirings
from busybot.reason.evaluation.hypotheses import board_space, drawn_wiring
from busybot.reason.evaluation.upper_bound import Observer
from busybot.reason.evaluation.wirings import Drawn, Listed

SINGLE, MULTI, ANY = (True, False), (False, True), (True, True)


def brute(wiring: Drawn, likely: np.ndarray) -> np.ndarray:
    """The shares of all assignments, each with the probability that it is drawn."""
    found, columns = np.zeros(likely.shape), np.arange(likely.shape[1])
    suits = np.array(wiring.suits)
    for chosen in permutations(range(likely.shape[1]), len(suits)):
        follows, weight, taken = np.full(likely.shape[1], len(likely) - 1), 1.0, np.zeros(likely.shape[1], bool)
        for number, (place, responder) in enumerate(zip(wiring.places, chosen, strict=True)):
            left = suits[number] & ~taken
            weight *= left[responder] / max(left.sum(), 1)
            taken[responder], follows[responder] = True, place
        found[follows, columns] += weight * likely[follows, columns].prod()
    return found / found[:, 0].sum()


@pytest.mark.parametrize("seed", range(4))
def test_shares_are_those_of_all_assignments(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sizes = (2, 3, 2, 2)
    wiring = drawn_wiring(sizes, (SINGLE, ANY, ANY, SINGLE, MULTI, ANY), (0, 1, 3))
    assert wiring.places == (1, 0, 3)  # links with three states choose first, and the idle one never
    likely = rng.random((len(sizes) + 1, 6))
    likely[0, 1] = likely[4, 3] = 0.0  # the fourth has moved
    shares = wiring.shares(likely)
    np.testing.assert_allclose(shares, brute(wiring, likely), atol=1e-12)
    assert not shares[2].any() and shares[4, 3] == 0
    np.testing.assert_allclose(wiring.shares(1e-300 * likely), shares, atol=1e-12)


def test_what_no_assignment_explains_has_no_shares() -> None:
    wiring = drawn_wiring((2,), (SINGLE, SINGLE), (0,))
    moved = np.array([[1.0, 1.0], [0.0, 0.0]])  # both have moved, and there is one link
    assert not wiring.shares(moved).any()
    assert not Listed(((0, 1),)).shares(moved).any()


def test_of_listed_wirings_each_is_as_probable_as_what_it_explains() -> None:
    wiring = Listed(((0, 1), (1, 0), (1, 2)))
    np.testing.assert_allclose(wiring.shares(np.ones((3, 2))), np.array([[1, 1], [2, 1], [0, 1]]) / 3)
    rests = np.array([[0.5, 0.5], [0.5, 0.5], [0.5, 1.0]])
    np.testing.assert_allclose(wiring.shares(rests)[:, 1], [0.25, 0.25, 0.5])


def test_of_many_responders_each_is_believed_in_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    wiring = drawn_wiring((2, 3, 2), (SINGLE, ANY, ANY, SINGLE, MULTI), (0, 1, 2))
    together = wiring.shares(np.ones((4, 5)))
    monkeypatch.setattr(wirings, "MOST", 4)
    np.testing.assert_allclose(wiring.shares(np.ones((4, 5))), together, atol=0.02)
    moved = np.ones((4, 5))
    moved[[0, 2, 3], 1] = 0.0
    assert wiring.shares(moved)[1, 1] == 1


@pytest.mark.parametrize("world", ["paper", "kitchen", "real-board"])
def test_what_is_doubted_is_as_often_so_as_is_believed(world: str) -> None:
    """Also as long as some links were not seen moving. In a kitchen, whose targets are not told, none is ruled out."""
    believed, true = [], []
    objects, rng = find("procedural"), np.random.default_rng(5)
    for board in generate_boards(BoardConfig(boards=24, group_size=1, seed=3, world=world), objects):
        models = [objects.get(placed.key) for placed in board.objects]
        links = links_of(models)
        effects = [model.effect for model in models if model.effect is not None]
        stages = [(one.single is not None, one.multi is not None) for one in effects]
        space, responders = board_space(board, links.sizes, stages)
        names = [(ref.object, ref.link) for relation in board.relations for ref in relation.triggers]
        follows = np.zeros((len(links.names), len(responders)), bool)
        for (owner, name), relation in zip(names, board.relations, strict=True):
            follows[links.names.index((owner, name)), responders.index(relation.responder)] = True
        dynamics = Dynamics(board, links)
        triggers = tuple(state for placed in board.objects if placed.role == "trigger" for state in placed.states)
        state = dynamics.start(triggers)
        observer = Observer(space, triggers, [state.shown[one] for one in responders])
        for _ in range(4):
            told = observer.belief().parents()[: len(links.names)]
            doubted = (told > 0.02) & (told < 0.98)
            believed += told[doubted].tolist()
            true += follows[doubted].tolist()
            assert not (follows & (told == 0)).any()  # what is so is never ruled out
            moves = [one for one in dynamics.moves(triggers, state) if one[0] == triggers[0] and one != triggers]
            triggers = moves[int(rng.integers(len(moves)))] if moves else triggers
            state = dynamics.step(triggers, state)
            observer.see(triggers, [state.shown[one] for one in responders])
    assert len(believed) > 100 and (world == "kitchen" or np.mean(believed) == pytest.approx(np.mean(true), abs=0.04))
