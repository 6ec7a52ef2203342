"""What an action would tell: most where explanations disagree, nothing where everything is known."""

import numpy as np
import pytest

from busybot.boards.mechanisms.gate import Gate
from busybot.reason.models.mechanism.contexts import MEMORIES, UNRELIABLE, Explanations, Trace, explanations_of
from busybot.reason.models.mechanism.curiosity import certainty, expected, released, yields
from busybot.reason.models.mechanism.reasoner import MechanismReasoner
from busybot.reason.models.registry import reasoner_of
from tests.reason.models.mechanism.test_laws import watched


def follows_the_first(actions: int) -> Trace:
    """Two links; the responder shows the first one's state, the other one has never moved."""
    links = np.zeros((actions + 1, 2), int)
    links[1::2, 0] = 1
    return Trace(links, links[:, :1].copy(), (2, 2))


def shares_of(found: Explanations, *inputs: tuple[int, ...]) -> np.ndarray:
    """All alike among those explanations that remember nothing and read just these."""
    now = found.memory == MEMORIES.index("late 0")
    read = [tuple(np.flatnonzero(row).tolist()) for row in found.inputs]
    fits = [now & np.array([own == one for own in read]) for one in inputs]
    shares = np.sum(fits, axis=0).astype(float)
    return (shares / shares.sum())[None]


def test_what_would_tell_two_explanations_apart_is_worth_most() -> None:
    """After an action both that read the first link, alone or with the second, agree: but for the second."""
    trace = follows_the_first(8)
    found = explanations_of(trace)
    told = expected(trace, found, shares_of(found, (0,), (0, 1)), [(1, 0), (0, 1), (0, 0)]).information
    assert told[1] > 5 * told[0] >= 0 and told[1] > 5 * told[2] >= 0
    sure = expected(trace, found, shares_of(found, (0,)), [(1, 0), (0, 1), (0, 0)])
    assert sure.information.max() < 0.05
    assert sure.shown[:, 0, 1] == pytest.approx([1, 0, 0], abs=0.01) and sure.shown.sum(-1) == pytest.approx(1)
    assert sure.take([2, 0]).shown[:, 0, 1] == pytest.approx([0, 1], abs=0.01)


def test_where_what_may_fail_goes_is_known_soon_and_its_failing_tells_little() -> None:
    """The responder went up with the link and down with it: trying the other link tells more than doing so again."""
    links, shown = np.array([[0, 0], [1, 0], [0, 0], [1, 0], [0, 0]]), np.array([[0], [1], [1], [1], [0]])
    trace = Trace(links, shown, (2, 2))
    found = explanations_of(trace)
    of_luck = found.memory == UNRELIABLE
    shares = sum(of_luck & (found.inputs == row).all(1) for row in ([1, 0, 0], [1, 1, 0])) / 2
    again, other = expected(trace, found, shares[None], [(1, 0), (1, 1)]).information
    assert 0 <= again < 0.05 and 3 * again < other


def test_certainty_is_that_of_sets_of_parents() -> None:
    trace = follows_the_first(4)
    found = explanations_of(trace)
    assert certainty(found, shares_of(found, (0,))) == 1
    assert certainty(found, shares_of(found, (0,), (1,))) == 0.5
    several = np.zeros((1, len(found.own)))  # explanations of one set are not told apart
    several[0, np.flatnonzero((found.inputs == np.array([True, False, False])).all(1))[:4]] = 0.25
    assert certainty(found, several) == 1
    both = np.concatenate([several, shares_of(found, (0,), (1,))])
    assert certainty(found, both) == 0.5, "of the responder that is least sure"
    assert certainty(found, both[:0]) == 1, "nothing responds"


def test_the_shipped_model_becomes_sure_of_a_gate_and_wants_to_see_what_it_has_not() -> None:
    reasoner = reasoner_of("mechanism")
    assert isinstance(reasoner, MechanismReasoner)
    links, shown = watched(Gate(sizes=(2, 2), table=(0, 0, 0, 1), function="and"), 30)
    trace = Trace(links, shown, (2, 2))
    found, shares, _ = reasoner.explain(trace, range(31))
    sure = [certainty(found, shares[..., after]) for after in (0, 3, 30)]
    assert sure[0] < 0.9 < sure[-1]  # no board of the training has one responder
    early = trace.first(1)
    known = explanations_of(early)
    flipped = early.links[-1].copy()
    moved = int(np.flatnonzero(early.links[0] != early.links[1])[0])
    flipped[1 - moved] ^= 1
    told = expected(early, known, reasoner.explain(early, [1])[1][..., 0], [flipped, early.links[-1]]).information
    assert told[0] > told[1]


def test_what_was_held_may_move_when_responders_look_as_they_never_did_when_it_was_tried() -> None:
    """Of three lamps the last one never changed: something may still wait for it, or for what was not tried."""
    shown = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    told = released(shown, [[0], [0, 1], [0, 1, 2], [3], []])
    assert told == pytest.approx([1 / 3, 1 / 2, 0, 0, 3 / 6])
    assert released(shown[:1], [[0]]) == pytest.approx([0]) and released(shown, []).shape == (0,)
    assert released(shown[:, :0], [[0]]) == pytest.approx([0]), "no responders"
    then = np.zeros((2, 3, 3))
    then[0, :, 0], then[1, 0, 1], then[1, 1, :2], then[1, 2, 1] = 1, 1, 0.5, 1
    told = released(shown, [[0], [0, 1], [0, 1, 2]], then)
    assert told == pytest.approx(np.array([[0, 0, 0], [2.5 / 3, 1.5 / 2, 1]])), "after either of two actions"
    assert released(shown, [], then).shape == (2, 0)


def test_a_known_link_is_believed_to_move_when_the_responder_looks_as_it_did_when_it_moved() -> None:
    """It moved while the first responder was on, and did not while it was off; the second was seen in both ways."""
    shown = np.array([[1, 0], [0, 0], [1, 1], [0, 1], [1, 0]])
    tries = [(0, True, True), (1, False, True), (2, True, True), (3, False, True)]
    on, off = yields(shown, tries), yields(np.vstack([shown, [[0, 0]]]), tries)
    assert on > 0.95 and off < 0.3
    assert yields(shown, []) < yields(shown, [tries[0], tries[2]]) <= 1, "what always moved is held by nothing"
    unlike = yields(np.vstack([shown, [[1, 1]]]), [tries[0], (0, False, True)])
    assert off < unlike < on, "the same looks, another outcome: bad luck"
    moved = [(0, False, False)] * 3 + [(0, True, True)]
    assert yields(shown, moved) > 0.9 > 0.5 > yields(shown, [(0, False, True)] * 3 + moved[3:]), "it was pushed wrongly"
    assert yields(shown[:, :0], [(0, True, True)]) == pytest.approx(1), "no responders"
