"""A board's law: mechanisms together, one tick an action, locks, rewirings, and luck that belongs to its action."""

from dataclasses import replace
from itertools import pairwise, permutations

import numpy as np
import pytest

from busybot.boards.dynamics import Dynamics, DynamicState
from busybot.boards.spec import LinkRef, Task
from busybot.common.errors import BusybotError
from tests.boards.worlds_by_hand import board, body, dynamics, link, links, lock, relation, rewiring

KNOB = LinkRef(object=0, link="knob")
FOLLOWS = relation("one-to-one", 2, [link(0)], (0, 1))
THREE = relation("gate", 2, [link(0), link(1)], (0, 0, 0, 2), function="and")


def random_walk(sizes: tuple[int, ...], steps: int, seed: int = 0) -> list[tuple[int, ...]]:
    """States of the links on a new board and after each of some actions, some of which move nothing."""
    rng = np.random.default_rng(seed)
    now = [0] * len(sizes)
    walk = [tuple(now)]
    for _ in range(steps):
        number = int(rng.integers(len(sizes)))
        now[number] = int(np.clip(now[number] + rng.integers(-1, 2), 0, sizes[number] - 1))
        walk.append(tuple(now))
    return walk


def shown(law: Dynamics, responder: int, walk: list[tuple[int, ...]]) -> list[int]:
    return [state.shown[responder] for state in law.run(walk)]


def test_a_responder_shows_what_its_mechanism_says_and_triggers_and_idle_responders_nothing() -> None:
    law = dynamics([FOLLOWS, relation("gate", 4, [link(0), link(1)], (0, 0, 0, 1), function="and")])
    states = law.run([(0, 0), (1, 0), (1, 1), (0, 1)])
    assert [state.shown for state in states] == [
        (-1, -1, 0, 0, 0, 0),
        (-1, -1, 1, 0, 0, 0),
        (-1, -1, 1, 0, 1, 0),
        (-1, -1, 0, 0, 0, 0),
    ]
    assert [state.tick for state in states] == [0, 1, 2, 3]


def mixed(order: tuple[int, ...] = (0, 1, 2, 3)) -> Dynamics:
    relations = [
        relation("unreliable", 2, [link(0)], (0, 1), probability=0.7),
        relation("gate", 3, [body(2), link(1)], (0, 1, 1, 0), function="xor"),
        relation("delay", 4, [link(1)], (1, 0), actions=2),
        relation("flicker", 5, [], (0, 1), probability=0.2),
    ]
    return dynamics([relations[place] for place in order])


def test_the_order_of_relations_does_not_matter() -> None:
    walk = random_walk((2, 2), 60)
    runs = {tuple(state.shown for state in mixed(order).run(walk)) for order in permutations(range(4))}
    assert len(runs) == 1 and len({shown for run in runs for shown in run}) > 8


def test_a_run_is_one_step_after_the_other() -> None:
    law, walk = mixed(), random_walk((2, 2), 40)
    state, states = law.start(walk[0]), [law.start(walk[0])]
    for triggers in walk[1:]:
        state = law.step(triggers, state)
        states.append(state)
    assert law.run(walk) == states and law.run(walk) == mixed().run(walk)


def test_what_follows_a_state_that_was_kept_is_what_followed_then() -> None:
    """Luck belongs to the action's number: no generator's state is needed."""
    walk = random_walk((2, 2), 60)
    states = mixed().run(walk)
    for k in (0, 1, 17, 59):
        state, again = states[k], mixed()
        kept = DynamicState(state.tick, tuple(state.shown), tuple(state.memories))
        for later, triggers in enumerate(walk[k + 1 :], start=k + 1):
            kept = again.step(triggers, kept)
            assert kept == states[later]
    other = board(list(mixed().board.relations), index=1)
    assert Dynamics(other, links()).run(walk) != states  # another board has a luck of its own


def test_inputs_that_are_responders_show_one_action_later() -> None:
    relations = [FOLLOWS, relation("one-to-one", 3, [body(2)], (1, 0)), relation("one-to-one", 4, [body(3)], (0, 1))]
    for order in permutations(relations):
        law = dynamics(list(order))
        walk = [(0, 0), (1, 0), (1, 0), (1, 0), (0, 0)]
        assert [state.shown[2:5] for state in law.run(walk)] == [(0, 1, 1), (1, 1, 1), (1, 0, 1), (1, 0, 0), (0, 0, 0)]
        assert law.start((1, 0)).shown[2:5] == (1, 0, 0)  # on a new board everything has rested for long


def test_without_luck_what_may_fail_succeeds_and_nothing_moves_by_itself() -> None:
    law = Dynamics(mixed().board, links(), lucky=False)
    walk = random_walk((2, 2), 60)
    assert set(shown(law, 5, walk)) == {0} and set(shown(mixed(), 5, walk)) == {0, 1}
    assert shown(law, 2, walk) == [triggers[0] for triggers in walk] != shown(mixed(), 2, walk)


def test_a_hidden_clock_moves_its_responders_together_and_others_have_a_luck_of_their_own() -> None:
    clocks = [relation("clock", k, [], (0, 1), probability=0.2, stream="clock") for k in (2, 3)]
    flickers = [relation("flicker", k, [], (0, 1), probability=0.2) for k in (4, 5)]
    states = dynamics(clocks + flickers).run([(0, 0)] * 300)
    changes = np.array([[a != b for a, b in zip(one.shown, two.shown, strict=True)] for one, two in pairwise(states)])
    assert (changes[:, 2] == changes[:, 3]).all() and 30 < changes[:, 2].sum() < 90
    assert (changes[:, 4] != changes[:, 5]).any() and (changes[:, 3] != changes[:, 4]).any()


def test_a_locked_link_cannot_be_moved_until_its_responder_lets_it() -> None:
    law = dynamics([FOLLOWS], (2, 3), locks=[lock(1, 2, 1)], states=(0, 1))
    shut, opened = law.start((0, 1)), law.start((1, 1))
    assert law.locked(1, shut.shown) and not law.locked(1, opened.shown) and not law.locked(0, shut.shown)
    assert law.moves((0, 1), shut) == [(1, 1)]
    assert set(law.moves((1, 1), opened)) == {(0, 1), (1, 0), (1, 2)}
    twice = dynamics([FOLLOWS, relation("one-to-one", 3, [link(0)], (1, 0))], locks=[lock(1, 2, 1), lock(1, 3, 1)])
    assert all(twice.locked(1, twice.start((state, 0)).shown) for state in (0, 1))  # both must let it


def test_doing_nothing_is_a_move_where_time_matters() -> None:
    late = dynamics([relation("delay", 2, [link(0)], (0, 1), actions=1)])
    assert late.remembers and (0, 0) in late.moves((0, 0), late.start((0, 0)))
    direct = dynamics([FOLLOWS])
    assert not direct.remembers and (0, 0) not in direct.moves((0, 0), direct.start((0, 0)))
    assert dynamics([FOLLOWS, relation("one-to-one", 3, [body(2)], (0, 1))]).remembers


def test_a_rewired_relation_starts_anew_after_its_action() -> None:
    late = relation("delay", 2, [link(1)], (0, 1), actions=1)
    law = dynamics([FOLLOWS], rewirings=[rewiring(3, late)])
    walk = [(0, 0), (1, 0), (1, 1), (1, 1), (1, 1), (0, 0), (0, 0)]
    #       start   0       1       2       3: link 1 has long been on, 4: not yet, 5
    assert shown(law, 2, walk) == [0, 1, 1, 1, 1, 1, 0]
    off = [(0, 0), (1, 0), (1, 0), (1, 0), (1, 0), (1, 1), (1, 1)]
    assert shown(law, 2, off) == [0, 1, 1, 1, 0, 0, 1]
    kinds = [getattr(law.mechanism(2, tick), "kind", None) for tick in (0, 2, 3, 99)]
    assert kinds == ["one-to-one", "one-to-one", "delay", "delay"] and law.mechanism(3) is None
    assert law.remembers and law.run(off)[3].memories == ((),) and law.run(off)[4].memories == ((0,),)


def test_a_later_rewiring_takes_the_place_of_an_earlier_one() -> None:
    second, third = (relation("one-to-one", 2, [link(k)], table) for k, table in ((1, (0, 1)), (0, (1, 0))))
    law = dynamics([FOLLOWS], rewirings=[rewiring(4, third), rewiring(2, second)])
    assert shown(law, 2, [(1, 0)] * 7) == [1, 1, 1, 0, 0, 0, 0]
    assert shown(law, 2, [(0, 0)] * 7) == [0, 0, 0, 0, 0, 1, 1]


def test_a_goal_shows_what_it_says() -> None:
    law = mixed()
    now = law.showing((1, 0), (-1, -1, 0, 1, 1, 1))
    assert now.shown == (-1, -1, 0, 1, 1, 1) and now.memories == law.start((1, 0)).memories
    assert now.flat == tuple(number for memory in now.memories for number in memory)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"relations": [relation("and-gate", 2, [link(0)], (0, 1))]}, "unknown kind 'and-gate'"),
        ({"relations": [relation("one-to-one", 2, [link(0)], (0, 1, 0))]}, "its inputs have 2"),
        ({"relations": [relation("one-to-one", 2, [KNOB], (0, 1))]}, "'knob' of object 0"),
        ({"relations": [relation("one-to-one", 2, [body(1)], (0, 1))]}, "'body' of object 1"),
        ({"relations": [FOLLOWS, relation("toggle", 2, [link(1)], (0, 1))]}, "two relations for one responder"),
        ({"relations": [FOLLOWS], "rewirings": [rewiring(20, relation("toggle", 3, [link(1)], (0, 1)))]}, "rewiring"),
        ({"relations": [FOLLOWS], "rewirings": [rewiring(20, THREE)]}, "makes it multi-stage, and it is built single"),
        ({"relations": [FOLLOWS.model_copy(update={"states": (0, 2)})]}, "has no state 2"),
        ({"relations": [FOLLOWS], "magnets": [1]}, "'magnets', unknown here"),
        ({"states": (0, 2)}, r"object 1 \(Switch/s1\): states \[2\] for trigger links with \[2\] of them"),
        ({"states": (0,)}, "object 1 .*: states .* for trigger links"),
        ({"task": Task(kind="reach", links=(link(0), link(1)), goal=(0, 2))}, r"object 1 .*: states \[2\] for"),
    ],
)
def test_boards_without_a_law_are_refused(wrong: dict[str, object], message: str) -> None:
    with pytest.raises(BusybotError, match=message):
        Dynamics(board(**{"relations": [], **wrong}), links())  # type: ignore[arg-type]


def test_a_state_is_a_value() -> None:
    state = mixed().start((0, 0))
    assert replace(state, tick=1) != state and len({state, mixed().start((0, 0))}) == 1
