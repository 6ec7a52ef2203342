"""Laws simulate a board as its mechanisms do, find plans through them, and learn from what came otherwise."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from busybot.boards.mechanisms.base import Mechanism
from busybot.boards.mechanisms.chance import Unreliable
from busybot.boards.mechanisms.delay import Delay
from busybot.boards.mechanisms.gate import Gate
from busybot.boards.mechanisms.latch import Latch
from busybot.boards.mechanisms.timer import Timer
from busybot.boards.mechanisms.toggle import Toggle
from busybot.reason.models.mechanism.contexts import MEMORIES, REMEMBERED, Trace, explanations_of
from busybot.reason.models.mechanism.laws import Laws, Links, Moment, _Law

AND = Gate(sizes=(2, 2), table=(0, 0, 0, 1), function="and")
CASES = {
    "late 0": AND,
    "late 1": Delay(sizes=(2, 2), table=(0, 1, 1, 1), actions=1),
    "odd presses up": Toggle(sizes=(2,), table=(0, 1)),
    "since press up": Timer(sizes=(2,), table=(1, 0), actions=2),
    "last press up, up": Latch(sizes=(2, 2), table=(0, 1)),
}


def watched(mechanism: Mechanism, actions: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Two links that are flipped at random, and the responder that the first of them drive: (T + 1, 2), (T + 1, 1)."""
    rng, links = np.random.default_rng(seed), [(0, 0)]
    shown, memory = mechanism.start(links[0][: len(mechanism.sizes)])
    told = [shown]
    for flipped in rng.integers(2, size=actions):
        now = list(links[-1])
        now[flipped] ^= 1
        links.append((now[0], now[1]))
        shown, memory = mechanism.step(links[-1][: len(mechanism.sizes)], memory, None)
        told.append(shown)
    return np.array(links), np.array(told)[:, None]


def laws_of(memory: str, mechanism: Mechanism, links: np.ndarray, shown: np.ndarray) -> Laws:
    """Told the right explanation, and one that is wrong and less probable."""
    inputs = np.zeros((2, 3), bool)
    inputs[0, : len(mechanism.sizes)] = True
    return Laws((2, 2), inputs, np.array([MEMORIES.index(memory), 0]), np.array([[0.9, 0.1]]), links, shown)


def moves(moment: Moment) -> Iterator[Links]:
    yield moment.links
    for link in range(2):
        yield tuple(state ^ (number == link) for number, state in enumerate(moment.links))


@pytest.mark.parametrize("memory", CASES)
def test_what_was_watched_follows_from_the_right_law(memory: str) -> None:
    mechanism = CASES[memory]
    laws = laws_of(memory, mechanism, *watched(mechanism, 40))
    links, shown = watched(mechanism, 30, seed=7)
    moment = Moment.new(links[0], shown[0])
    for states, right in zip(links[1:].tolist(), shown[1:].tolist(), strict=True):
        [told] = (laws.expected(moment, [tuple(states)])[-1].shown,)
        assert told == tuple(right)
        moment = laws.learn(moment, tuple(states), tuple(right))


def test_where_what_may_fail_goes_is_learned_from_its_failures_too() -> None:
    """An AND that fails in half of the actions: where luck is given it is one, whatever shows before."""
    mechanism, rng = Unreliable(sizes=(2, 2), table=AND.table, probability=0.5), np.random.default_rng(2)
    links, _ = watched(AND, 40)
    shown, memory = [0], (0,)
    for row in links[1:]:
        state, memory = mechanism.step(tuple(row.tolist()), memory, rng)
        shown.append(state)
    assert shown != (links.min(1)).tolist(), "it failed"
    laws = laws_of("own and now", mechanism, links, np.array(shown)[:, None])
    for way in product((0, 1), repeat=2):
        for before in (0, 1):
            [told] = laws.expected(Moment.new((0, 0), (before,)), [way])[-1].shown
            assert told == min(way)


def test_a_mechanism_is_learned_from_the_moments_that_tell_of_it() -> None:
    links, _ = watched(AND, 60)
    shown = np.where(np.arange(61) < 40, links.min(1), links.max(1))[:, None]
    inputs = np.array([[True, True, False]])
    told = [np.array([MEMORIES.index("late 0")]), np.ones((1, 1)), links, shown]
    late = np.arange(61)[None] >= 40
    both, first, later = (Laws((2, 2), inputs, *told, of=of) for of in (None, ~late, late))
    for way in product((0, 1), repeat=2):
        assert first.expected(Moment.new((0, 0), (0,)), [way])[-1].shown == (min(way),)
        assert later.expected(Moment.new((0, 0), (0,)), [way])[-1].shown == (max(way),)
    assert both.expected(Moment.new((0, 0), (0,)), [(0, 1)])[-1].shown == (0,)


def test_what_lasts_ends_when_it_must_if_nobody_looked() -> None:
    """It went out with the press and burned again two actions later; nobody looked in between: it may have burned one
    action after the press, but not four or five."""
    told = [np.array([MEMORIES.index("since press up")]), np.ones((1, 1))]
    links, shown = np.array([[0], [1], [1], [1], [0]]), np.array([[1], [0], [0], [1], [1]])
    of = np.array([[True, True, False, True, False]])
    laws = Laws((2,), np.array([[True, False]]), *told, links, shown, of)
    unmet = [_Law.follows(laws.best()[0], (since,)) for since in range(6)]
    assert unmet == [0, None, 1, 1, 1, 1]


@pytest.mark.parametrize("memory", CASES)
def test_plans_are_as_short_as_any(memory: str) -> None:
    mechanism = CASES[memory]
    laws = laws_of(memory, mechanism, *watched(mechanism, 40))
    start = Moment.new((0, 0), (mechanism.start((0, 0)[: len(mechanism.sizes)])[0],))
    wanted = {0: 1 - start.shown[0]}
    way = laws.plan(start, wanted, moves, 5)
    assert laws.reaches(start, way, wanted) and shows(mechanism, way) == wanted[0]
    for shorter in range(1, len(way)):
        for flips in product((None, 0, 1), repeat=shorter):
            assert shows(mechanism, walk(flips)) != wanted[0]


def test_states_from_which_the_same_follows_are_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a responder that follows two of four links late nothing is to be remembered but these two."""
    monkeypatch.setattr("busybot.reason.models.mechanism.laws.NODES", 60)
    rng, links = np.random.default_rng(0), [np.zeros(4, int)]
    for link in rng.integers(4, size=120):
        links.append(links[-1] ^ (np.arange(4) == link))
    seen = np.array(links)
    late = np.vstack([seen[:1], seen[:1], seen[:-2]])
    shown = np.stack([late[:, 0] & late[:, 1], seen[:, 2]], axis=1)
    inputs, memory = np.array([[1, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0]], bool), ["late 2", "late 0"]
    laws = Laws((2,) * 4, inputs, np.array([MEMORIES.index(one) for one in memory]), np.eye(2), seen, shown)

    def flips(moment: Moment) -> Iterator[Links]:
        yield moment.links
        yield from (tuple(np.array(moment.links) ^ (np.arange(4) == link)) for link in range(4))

    start, wanted = Moment.new((0,) * 4, (0, 0)), {0: 1, 1: 1}
    way = laws.plan(start, wanted, flips, 8)
    assert len(way) == 4 and laws.reaches(start, way, wanted)


def walk(flips: Sequence[int | None]) -> list[Links]:
    now, found = [0, 0], []
    for flip in flips:
        if flip is not None:
            now[flip] ^= 1
        found.append((now[0], now[1]))
    return found


def shows(mechanism: Mechanism, way: Sequence[Links]) -> int:
    shown, memory = mechanism.start((0, 0)[: len(mechanism.sizes)])
    for links in way:
        shown, memory = mechanism.step(links[: len(mechanism.sizes)], memory, None)
    return shown


def test_what_was_never_met_is_hoped_for_and_a_wrong_law_loses() -> None:
    links, shown = np.array([(0, 0), (1, 0), (0, 0), (0, 1)]), np.zeros((4, 1), int)  # both at once were never met
    laws = laws_of("late 0", AND, links, shown)
    start = Moment.new((0, 0), (0,))
    assert laws.plan(start, {0: 1}, moves, 4)[-1] == (1, 1), "if both matter, this is all that can light it"
    assert laws.plan(start, {0: 1}, moves, 1) == [], "it is two actions away"
    laws = laws_of("late 0", AND, links[:3], shown[:3])  # the second one may light it alone, or with the first one
    assert laws.plan(start, {0: 1}, moves, 4) == []
    assert laws.plan(start, {0: 1}, moves, 4, hopeful=True)[-1] == (0, 1)
    assert laws.plan(start, {0: 1}, moves, 0, hopeful=True) == []
    wrong = Laws((2, 2), np.array([[1, 0, 0], [0, 1, 0]], bool), np.array([MEMORIES.index("late 0")] * 2),
                 np.array([[0.6, 0.4]]), links[:1], shown[:1])  # fmt: skip
    moment = Moment.new((0, 0), (0,))
    for states, after in (((1, 0), 0), ((1, 1), 1), ((0, 1), 1), ((0, 0), 0), ((1, 0), 0)):
        moment = wrong.learn(moment, states, (after,))
    assert [law.inputs for law in wrong.best()] == [(1,)]


def test_what_agrees_with_laws_is_more_probable() -> None:
    laws, start = laws_of("late 0", AND, *watched(AND, 40)), Moment.new((0, 1), (0,))
    lit, dark = (laws.agreement(start, (1, 1), (state,)) for state in (1, 0))
    assert np.exp(lit) + np.exp(dark) == pytest.approx(1) and lit > dark
    new = laws_of("late 0", AND, np.array([(0, 0), (1, 0)]), np.zeros((2, 1), int))
    told = [new.agreement(start, (1, 1), (state,)) for state in (1, 0)]
    assert lit > told[0] and told[1] > dark, "it was never met"


def test_laws_are_told_in_words() -> None:
    names = ["object 0", "object 3", "object 1"]
    told = {
        memory: laws_of(memory, mechanism, *watched(mechanism, 40)).words(0, names)
        for memory, mechanism in CASES.items()
    }
    assert told == {
        "late 0": "shows look 1 only while object 0 is moved and object 3 is moved",
        "late 1": "shows look 0 only while object 0 is as at first and object 3 is as at first, 1 action later",
        "odd presses up": "changes with every press of object 0",
        "since press up": "changes for some actions when object 0 is pressed",
        "last press up, up": "is set by object 0, reset by object 3",
    }


@pytest.mark.parametrize(
    ("shown", "told"),
    [
        ((0, 0, 0, 0), "is decided by a and b together"),
        ((0, 1, 2, 2), "is decided by a and b together"),
        ((0, 1, 1, 0), "changes whenever a or b is moved"),
    ],
)
def test_two_inputs_are_told_as_a_function_only_if_they_are_one_that_has_a_name(
    shown: tuple[int, ...], told: str
) -> None:
    links = np.array([(0, 0), (1, 0), (0, 1), (1, 1)] * 3)
    laws = laws_of("late 0", AND, links, np.array(shown * 3)[:, None])
    assert laws.words(0, ["a", "b", "c"]) == told


def test_laws_remember_what_explanations_remember() -> None:
    """Contexts step by step (`_Law.context`) and over a trace (`explanations_of`) are equal at the same moments."""
    rng, sizes = np.random.default_rng(3), (2, 3, 2)
    links = np.stack([rng.integers(size, size=40) for size in sizes], 1)
    shown = rng.integers(2, size=(40, 2))
    found = explanations_of(Trace(links, shown, sizes))
    moments = [Moment.new(links[0], shown[0])]
    for states, now in zip(links[1:].tolist(), shown[1:].tolist(), strict=True):
        moments.append(replace(moments[-1].acted(tuple(states), sizes), shown=tuple(now)))
    for number, memory in enumerate(found.memory):
        law = _Law.of(found.inputs[number], REMEMBERED[memory], 1.0, 2, (*sizes, 2, 2), [0.0] * (len(sizes) + 2))
        told = [law.context(moment, 0) for moment in moments]
        pairs = set(zip(found.contexts[:, number].tolist(), told, strict=True))
        assert len(pairs) == len(set(told)) == len({context for context, _ in pairs}), MEMORIES[memory]
