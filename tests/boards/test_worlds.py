"""Boards of every world: nothing on them is idle by chance, held-out mechanisms are held out, locks can be opened."""

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from busybot.boards import worlds
from busybot.boards.config import SPLITS, BoardConfig
from busybot.boards.dynamics import Dynamics, Links
from busybot.boards.generate import generate_boards
from busybot.boards.mechanisms import available, mechanism_of
from busybot.boards.spec import BODY, BoardSpec, LinkRef, Relation
from busybot.boards.task import affectable, reachable, start_states
from busybot.boards.worlds import DIRECT, NOVEL, WORLDS, draw_locks, links_of, with_world, world_named
from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.objects.library import Library
from busybot.objects.resolve import find
from tests.boards.worlds_by_hand import board, links, relation
from tests.boards.worlds_by_hand import link as switch

BOARDS = 30
Function = tuple[str, tuple[int, ...], tuple[int, ...], int]
"""Kind, sizes of the inputs, table, actions."""


@pytest.fixture(scope="module", params=["procedural", pytest.param("real", marks=pytest.mark.long)])
def library(request: pytest.FixtureRequest) -> Library:
    if request.param == "procedural":
        return find("procedural")
    return Library.load(request.getfixturevalue("partnet"))


_drawn: dict[tuple[object, ...], list[BoardSpec]] = {}


def boards(library: Library, world: str, **options: object) -> list[BoardSpec]:
    """Boards of a world; several tests share those with the same options."""
    values = {"boards": BOARDS, "group_size": 1, "world": world, **options}
    key = (library.name, *sorted((name, str(value)) for name, value in values.items()))
    if key not in _drawn:
        _drawn[key] = list(generate_boards(BoardConfig.model_validate(values), library))
    return _drawn[key]


def links_on(spec: BoardSpec, library: Library) -> Links:
    return links_of([library.get(placed.key) for placed in spec.objects])


def functions(spec: BoardSpec, law: Dynamics) -> list[Function]:
    """What the board's mechanisms do that have inputs, those of rewirings included."""
    ticks = (0, *(one.step for one in spec.rewirings))
    found = [law.mechanism(one.responder, tick) for one in spec.relations for tick in ticks]
    return [(one.kind, one.sizes, one.table, one.parameters().get("actions", 0)) for one in found if one and one.sizes]


@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("world", WORLDS)
def test_every_world_and_split_has_boards_on_which_all_links_do_something(
    library: Library, world: str, split: str
) -> None:
    found = boards(library, world, split=split)
    assert len(found) == BOARDS == len({spec.digest() for spec in found})
    for spec in found:
        there = links_on(spec, library)
        assert (spec.world, spec.schema_version) == (world, "1.1") and 3 <= len(there.names) <= 6
        relations = [*spec.relations, *(one.relation for one in spec.rewirings)]
        used = {(ref.object, ref.link) for one in spec.relations for ref in one.triggers if ref.link != BODY}
        idle = {(ref.object, ref.link) for ref in spec.idle}
        assert used | idle == set(there.names) and not used & idle and used
        assert len({one.responder for one in spec.relations}) == len(spec.relations)
        assert all(spec.objects[one.responder].role == "responder" for one in relations)
        effects = [library.get(spec.objects[one.responder].key).effect for one in relations]
        assert all(getattr(effect, one.stage) for effect, one in zip(effects, relations, strict=True))
        Dynamics(spec, there)
        assert BoardSpec.model_validate_json(spec.model_dump_json()) == spec


@pytest.mark.parametrize("world", WORLDS)
def test_held_out_mechanisms_are_held_out(library: Library, world: str) -> None:
    seen: dict[str, set[Function]] = {}
    for split in ("train", NOVEL):
        laws = [(spec, Dynamics(spec, links_on(spec, library))) for spec in boards(library, world, split=split)]
        seen[split] = {one for spec, law in laws for one in functions(spec, law)}
    assert seen["train"] and seen[NOVEL] and not seen["train"] & seen[NOVEL]
    for kind, sizes, table, actions in seen[NOVEL]:
        assert kind in ("gate", "toggle", "unreliable") or (kind == "delay" and actions in (2, 3)), (kind, table)
        assert kind == "delay" or kind == "toggle" or len(sizes) > 1
    assert not any(kind == "toggle" or len(sizes) > 2 or actions in (2, 3) and kind == "delay"
                   for kind, sizes, _, actions in seen["train"])  # fmt: skip


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("split", ["train", NOVEL])
def test_whatever_links_drive_changes_and_is_about_the_world(library: Library, world: str, split: str) -> None:
    for spec in boards(library, world, split=split)[:15]:
        law = Dynamics(spec.model_copy(update={"rewirings": ()}), links_on(spec, library))
        rng, triggers = np.random.default_rng(spec.index), start_states(spec)
        state = law.start(triggers)
        seen: dict[int, set[int]] = {one: set() for one in affectable(spec)}
        for _ in range(300):
            moves = law.moves(triggers, state)
            triggers = moves[int(rng.integers(len(moves)))]
            state = law.step(triggers, state)
            for index, states in seen.items():
                states.add(state.shown[index])
        if world == "lock":  # what random moves hardly ever find, but nothing is remembered: there are few states
            for _, _, there in reachable(law, start_states(spec), 60, most=10**6):
                for index, states in seen.items():
                    states.add(there.shown[index])
        assert seen and all(len(states) > 1 for states in seen.values()), spec.index
        kinds = {one.kind for one in spec.relations}
        chained = any(ref.link == BODY for one in spec.relations for ref in one.triggers)
        about = {"gates": "gate" in kinds, "time": bool(kinds & {"delay", "timer", "latch", "toggle"})}
        about |= {"chance": "unreliable" in kinds, "chain": chained, "lock": bool(spec.locks)}
        assert about.get(world, True) and bool(spec.rewirings) >= (world == "rewired")


@pytest.mark.long
def test_worlds_have_what_their_shares_say() -> None:
    library = find("procedural")
    made = {world: boards(library, world, boards=150) for world in ("chance", "chain", "mixed")}
    count = {world: Counter(one.kind for spec in found for one in spec.relations) for world, found in made.items()}
    clocked = [sum(one.kind == "clock" for one in spec.relations) for spec in made["chance"]]
    assert set(clocked) == {0, 2, 3} and 0.4 < np.mean(np.array(clocked) > 0) < 0.85
    for spec in made["chance"]:
        streams = [one.parameters for one in spec.relations if one.kind == "clock"]
        assert len({(one["stream"], one["probability"]) for one in streams}) <= 1
    assert count["chance"]["flicker"] > 20 and np.mean([bool(spec.idle) for spec in made["chance"]]) > 0.05
    drives = [one for spec in made["chain"] for one in spec.relations if any(r.link == BODY for r in one.triggers)]
    assert len(drives) >= 150 and {one.kind for one in drives} == {"gate", DIRECT}
    for spec in made["chain"]:  # what is read has a luck of its own: else its driver would explain the reader, too
        kind_of = {one.responder: one.kind for one in spec.relations}
        read = {ref.object for one in spec.relations for ref in one.triggers if ref.link == BODY}
        assert {kind_of[one] for one in read} == {"unreliable"}
    assert all(count["mixed"][kind] for kind in ("gate", "delay", "timer", "latch", "unreliable", "flicker", DIRECT))
    assert any(spec.locks for spec in made["mixed"]) and any(spec.rewirings for spec in made["mixed"])


@pytest.mark.parametrize("world", ["rewired", "mixed"])
@pytest.mark.parametrize("split", ["train", NOVEL])
def test_what_is_rewired_then_does_something_else(library: Library, world: str, split: str) -> None:
    found = [spec for spec in boards(library, world, split=split) if spec.rewirings]
    assert len(found) == BOARDS if world == "rewired" else found
    for spec in found:
        (one,) = spec.rewirings
        assert 20 <= one.step <= 25
        there, responder = links_on(spec, library), one.relation.responder
        changed = tuple(one.relation if old.responder == responder else old for old in spec.relations)
        free = {"rewirings": (), "locks": ()}
        before, after = (Dynamics(spec.model_copy(update=free | {"relations": r}), there, lucky=False)
                         for r in (spec.relations, changed))  # fmt: skip
        rng, triggers = np.random.default_rng(0), start_states(spec)
        first, second = before.start(triggers), after.start(triggers)
        differ = 0
        for _ in range(300):
            moves = before.moves(triggers, first)
            triggers = moves[int(rng.integers(len(moves)))]
            first, second = before.step(triggers, first), after.step(triggers, second)
            differ += first.shown[responder] != second.shown[responder]
        assert differ, spec.index
        assert responder not in {lock.responder for lock in spec.locks}


def movable(law: Dynamics, spec: BoardSpec) -> tuple[set[int], int]:
    """Links that some sequence of actions moves, and how many states of the links there are; by search."""
    start = start_states(spec)
    states = {triggers for _, triggers, _ in reachable(law, start, 1000, most=100_000)}
    return {n for n in range(len(start)) if len({triggers[n] for triggers in states}) > 1}, len(states)


@pytest.mark.parametrize("split", ["train", NOVEL])
def test_locks_hold_at_first_and_can_all_be_opened(library: Library, split: str) -> None:
    for spec in boards(library, "lock", split=split):
        there = links_on(spec, library)
        law, start = Dynamics(spec, there, lucky=False), start_states(spec)
        held = [law.number(lock.link) for lock in spec.locks]
        assert len(set(held)) == len(held) and all(law.locked(n, law.start(start).shown) for n in held)
        free, states = movable(law, spec)
        assert free == set(range(len(start))) and states == np.prod(there.sizes)
        without = [law.number(lock.link) for lock in spec.locks[:-1]]
        for lock, later in pairwise(spec.locks):  # each is behind the one before it
            drivers = next(one.triggers for one in spec.relations if one.responder == later.responder)
            assert lock.link in drivers
        last = spec.model_copy(update={"locks": spec.locks[1:]}) if without else spec.model_copy(update={"locks": ()})
        assert movable(Dynamics(last, there, lucky=False), last)[1] == states  # the others hold without the first, too


@pytest.mark.parametrize("depth", [1, 2, 3, 4, 5, 6, 7, 8])
def test_locks_of_every_depth_are_drawn(library: Library, depth: int) -> None:
    span = (3, 6) if depth < 5 else (depth + 1, 12)
    for spec in boards(library, "lock", boards=2, depth=(depth, depth), links=span):
        there = links_on(spec, library)
        assert len(spec.locks) == depth and span[0] <= len(there.names) <= span[1]
        law, start = Dynamics(spec, there, lucky=False), start_states(spec)
        last = law.number(spec.locks[-1].link)
        for away, triggers, state in reachable(law, start, 40, most=100_000):
            if triggers[last] != start[last]:  # one action opens each lock, the last moves what was behind them
                assert away >= depth + 1
                break
            assert not law.locked(last, state.shown) or away < 40
        else:
            pytest.fail("the last lock cannot be opened")


def test_a_board_does_not_depend_on_how_many_there_are() -> None:
    library = find("procedural")
    for world in ("mixed", "lock"):
        few, many = (boards(library, world, boards=n, group_size=5) for n in (3, 12))
        _drawn.clear()
        assert few == many[:3] == boards(library, world, boards=3, group_size=5)
        assert len({spec.objects for spec in many}) == 3 and len({spec.digest() for spec in many}) == 12
        assert few != boards(library, world, boards=3, group_size=5, seed=1)
    assert boards(library, "gates", boards=3)[0].objects == boards(library, "time", boards=3)[0].objects


def test_more_links_on_request() -> None:
    found = boards(find("procedural"), "gates", boards=10, links=(7, 12))
    assert all(7 <= len(links_on(spec, find("procedural")).names) <= 12 for spec in found)
    assert BoardConfig(world="gates", links=(7, 12)).switches == (4, 6)


def test_for_many_links_there_are_enough_switches_up_to_what_a_board_has_room_for() -> None:
    (spec,) = boards(find("procedural"), "gates", boards=1, links=(13, 13))
    assert len(links_on(spec, find("procedural")).names) == 13
    assert BoardConfig(world="gates", links=(18, 18)).switches == (9, 9)
    with pytest.raises(ValueError, match="at least 19 are more than the 18"):
        BoardConfig(world="gates", links=(19, 20))
    many = BoardConfig(world="gates", links=(19, 20), switches=(10, 12), responders=(5, 6))
    assert (many.switches, many.responders) == ((10, 12), (5, 6))


@pytest.mark.parametrize(("world", "split"), [("latch", "train"), ("toggle", NOVEL), ("unreliable", NOVEL)])
def test_a_mechanisms_name_is_a_world_in_which_it_is_the_only_one(world: str, split: str) -> None:
    for spec in boards(find("procedural"), world, split=split, boards=10):
        assert {one.kind for one in spec.relations} - {"rest"} == {world} and spec.world == world


@pytest.mark.parametrize(
    ("world", "split", "message"),
    [
        ("sorcery", "train", "no world 'sorcery'; choose from paper, gates, time"),
        ("flicker", "train", "no link drives the mechanism 'flicker'"),
        ("toggle", "train", "only the split 'novel-mechanism' has the mechanism 'toggle'"),
        ("timer", NOVEL, "the split 'novel-mechanism' has no mechanism 'timer'; leave --split"),
        ("paper", NOVEL, "name another one: --world gates"),
    ],
)
def test_worlds_that_cannot_be_drawn_are_refused_at_once(world: str, split: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        BoardConfig(world=world, split=split)


def test_deeper_locks_need_more_links() -> None:
    with pytest.raises(ValueError, match="8 locks behind each other need 9 links.*give --links 9-12"):
        BoardConfig(world="lock", depth=(8, 8))
    assert BoardConfig(world="lock", depth=(8, 8), links=(3, 12)).least_links == 9
    assert BoardConfig(world="lock").least_links == BoardConfig(world="gates", depth=(5, 8)).least_links == 4


def test_kinds_of_the_worlds_are_there() -> None:
    assert {kind for world in WORLDS.values() for kind in world.kinds} <= set(available())
    assert all(world_named(name, novel) is WORLDS[name] for name in WORLDS for novel in (False, True))
    with pytest.raises(BusybotError):
        world_named("paper")


def test_idle_links_have_no_part_in_locks_and_rewirings_none_in_responders_that_hold_one() -> None:
    relations = [relation(DIRECT, 3, [switch(0)], (0, 1)), relation(DIRECT, 4, [switch(1)], (1, 0))]
    sizes = (2, 2, 2)
    spec = board(relations, sizes, idle=[switch(2)], states=(0, 1, 0))
    found = [draw_locks(spec, links(sizes), (1, 8), generator(0, "train", k, "test")) or () for k in range(20)]
    assert {(lock.responder, lock.link.object, lock.states) for (lock,) in found} == {(3, 1, (1,)), (4, 0, (1,))}
    assert draw_locks(spec, links(sizes), (2, 8), generator(0, "train", 0, "test")) is None
    assert draw_locks(board([], sizes), links(sizes), (1, 8), generator(0, "train", 0, "test")) is None
    for spec in boards(find("procedural"), "mixed", boards=200):
        assert not {one.relation.responder for one in spec.rewirings} & {lock.responder for lock in spec.locks}


def test_draws_on_which_nothing_can_be_found_are_thrown_away() -> None:
    """What the probe sees: a gate whose inputs never come together, and a rewiring that is the same in other words."""
    sizes = (2, 2)
    never = board(
        [relation(DIRECT, 2, [switch(0)], (0, 1)), Relation.model_validate({
            "kind": "gate", "triggers": (switch(0), LinkRef(object=2, link=BODY)), "responder": 3, "stage": "single",
            "states": (0, 0, 0, 0), "parameters": {"function": "and"}})], sizes,
    )  # fmt: skip
    walk = worlds._walk(never, links(sizes), generator(0, "train", 0, "test"))
    assert len(walk) == worlds.PROBE + 1 and len(set(walk)) == 4
    assert all(sum(a != b for a, b in zip(one, two, strict=True)) <= 1 for one, two in pairwise(walk))
    assert not worlds._all_change(never, links(sizes), walk)
    gate = relation("gate", 2, [switch(0), switch(1)], (0, 0, 0, 1), function="and")
    same = relation("gate", 2, [switch(1), switch(0)], (0, 0, 0, 1), function="and")
    late = relation("delay", 2, [switch(0), switch(1)], (0, 0, 0, 1), actions=1)
    there = links(sizes)
    assert worlds._all_change(board([gate], sizes), there, walk)
    assert not worlds._acts_otherwise(board([gate], sizes), board([same], sizes), there, walk)
    assert worlds._acts_otherwise(board([gate], sizes), board([late], sizes), there, walk)
    assert mechanism_of(gate, sizes) != mechanism_of(late, sizes)


def test_objects_without_links_do_not_suffice_for_any_world() -> None:
    """A stranger's switches may be responders: an annotation decides what an object does."""
    for name in WORLDS:
        assert with_world(board([], ()), [], name, (1, 8)) is None
