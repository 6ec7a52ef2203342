"""The worlds: what may decide the responders of a board, beside the paper's relations (docs/guides/worlds.md).

A board's relations, locks and rewirings depend on (seed, split, index) and its objects alone. A draw is thrown away and
drawn anew when a link that is not declared idle controls nothing, when nothing on the board is what its world is about,
when a responder that links drive does not change whatever is done for so many actions (`PROBE`), or when a rewiring
changes nothing that one sees.

Boards of the split `novel-mechanism` have the training split's objects and, in their relations, what the mechanisms
hold out (`Mechanism.draw`).
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import accumulate, product
from typing import Annotated

import numpy as np
from pydantic import Field

from busybot.boards.dynamics import STAGES, Dynamics, Links
from busybot.boards.mechanisms import OWN, Mechanism, kind_named, known_kind, mechanism_of
from busybot.boards.mechanisms.rest import Rest
from busybot.boards.scenes import SCENES
from busybot.boards.spec import BODY, PAPER, WORLDS_VERSION, BoardSpec, LinkRef, Lock, Relation, Rewiring
from busybot.common import plugins
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel
from busybot.common.rng import generator
from busybot.objects.model import ObjectModel

Share = Annotated[float, Field(ge=0, le=1)]
PROBE = 200
"""So many random actions show whether a responder can change, and whether a rewiring changes anything."""
CHAIN_TRIES = 200
"""A chain of locks is looked for in so many steps."""
DRAWS = 200
"""A board's relations are drawn so often before its objects are given up."""
MECHANISM_TRIES = 40
REWIRED_AT = (20, 25)
"""After which action a relation changes, inclusive."""
INERT = 0.1
"""Share of responders that nothing controls, beside those that no mechanism fits. They show what something that links
drive would have shown at first: what a board looks like does not tell who is moved."""
UNUSED_WEIGHT = 4.0
"""A link that controls nothing yet is chosen so many times more often."""
NOVEL = "novel-mechanism"
MOST_INPUTS = 3
"""Of a mechanism that is alone in a world, of drawn boards."""
CLOCKED = (2, 3)
"""A hidden clock moves so many responders."""


class World(FrozenModel):
    """What the boards of a world are drawn from.

    Attributes:
        about: what makes its causes hard, in words.
        kinds: of mechanisms with inputs, with the weights by which responders draw them.
        two: share of responders with a second input, where a kind may have it; of these, under `novel-mechanism`, a
            third has three.
        flickers: share of responders that move by themselves.
        clock: share of boards with a hidden clock.
        follows: share of responders that read another responder, if there is one with a luck of its own.
        followers: least number of these.
        idle: share of links that control nothing.
        locked: whether links are held.
        rewired: share of boards on which a relation changes.
    """

    about: str = ""
    kinds: dict[str, Annotated[float, Field(gt=0)]]
    two: Share = 0.0
    flickers: Share = 0.0
    clock: Share = 0.0
    follows: Share = 0.0
    followers: Annotated[int, Field(ge=0)] = 0
    idle: Share = 0.0
    locked: Share = 0.0
    rewired: Share = 0.0


DIRECT = "one-to-one"
PAPERS = (DIRECT, "one-to-many-effects", "one-to-many-objects")
MEMORYLESS = (*PAPERS, "gate")
WORLDS: dict[str, World] = {
    "gates": World(
        about="an effect is visible only in some contexts",
        kinds={"gate": 0.9, DIRECT: 0.1}, two=1.0,
    ),
    "time": World(
        about="an effect comes late, ends, or depends on what was pressed before",
        kinds={"delay": 0.35, "timer": 0.25, "latch": 0.2, "toggle": 0.2, DIRECT: 0.1}, two=0.5,
    ),
    "chance": World(
        about="effects fail and catch up later, responders move by themselves or together, links have no effect",
        kinds={"unreliable": 1.0}, two=0.2, flickers=0.15, clock=0.7, idle=0.2,
    ),
    "chain": World(
        about="a responder is an input of another one: ancestors are not parents",
        kinds={"unreliable": 0.7, "gate": 0.15, DIRECT: 0.15}, two=0.25, follows=0.45, followers=1,
    ),
    "lock": World(
        about="links yield only while a responder is in a state: what cannot be moved now may move later",
        kinds={"gate": 0.6, DIRECT: 0.4}, two=0.6, locked=1.0,
    ),
    "rewired": World(
        about="a mechanism changes after action 20 to 25: what was learned is no longer true",
        kinds={"gate": 0.7, DIRECT: 0.3}, two=0.7, rewired=1.0,
    ),
    "mixed": World(
        about="all of it, drawn per responder",
        kinds={"gate": 0.25, "delay": 0.15, "timer": 0.1, "toggle": 0.1, "latch": 0.1, "unreliable": 0.2, DIRECT: 0.1},
        two=0.4, flickers=0.08, clock=0.3, follows=0.2, idle=0.1, locked=0.3, rewired=0.25,
    ),
}  # fmt: skip
"""By name, all but the paper's own, whose relations `boards.relations` draws."""
REAL_BOARD = "real-board"
BUILT = {
    REAL_BOARD: World(about="the paper's real board: three switches, three LEDs, six wirings", kinds={DIRECT: 1}),
    **{name: World(about=scene.about, kinds={DIRECT: 1}) for name, scene in SCENES.items()},
}
"""Worlds whose boards have objects and relations of their own, made by `boards.real_board` and `boards.scenes`."""


def world_named(name: str, novel: bool = False) -> World:
    """The world of that name; a mechanism's name is a world in which it is the only one.

    Args:
        novel: whether its boards are of the split `novel-mechanism`.

    Raises:
        BusybotError: there is none, or a mechanism that no link drives, or that the split does not have.
    """
    if name in WORLDS or (name in BUILT and not novel):
        return (WORLDS | BUILT)[name]
    if name in BUILT:
        other = f"leave --split {NOVEL} out, or choose another world: {', '.join(WORLDS)}"
        raise BusybotError(f"the world {name!r} has no split {NOVEL!r}", other)
    kind = kind_named(name)
    if kind is None:
        known = [PAPER, *WORLDS, *BUILT]
        near = get_close_matches(name.casefold(), [*known, *_alone()], 1)
        meant = f"did you mean {near[0]}? " if near else ""
        raise BusybotError(
            f"there is no world {name!r}", f"{meant}choose from {', '.join(known)}, or the name of a mechanism"
        )
    if not kind.arity[1]:
        raise BusybotError(f"no link drives the mechanism {name!r}", "choose a world that has it: chance or mixed")
    least, most = kind.arity
    if least > MOST_INPUTS:
        what = f"the mechanism {name!r} has at least {least} inputs, and of drawn ones none has more than {MOST_INPUTS}"
        raise BusybotError(what, "write boards with it by hand, or let it have fewer")
    possible = range(max(least, 1), min(most, MOST_INPUTS) + 1)
    counts = [count for count in possible if _is_drawn(kind, count, novel)]
    if not counts and not any(_is_drawn(kind, count, not novel) for count in possible):
        raise BusybotError(f"the mechanism {name!r} draws none of itself", "let its `draw` return one for some sizes")
    if not counts:
        split = f"the split {NOVEL!r} has" if novel else f"only the split {NOVEL!r} has"
        other = f"leave --split {NOVEL} out" if novel else f"give --split {NOVEL}"
        raise BusybotError(f"{split} {'no' if novel else 'the'} mechanism {name!r}", other)
    return World(about=f"{name} alone", kinds={name: 1.0}, two=float(counts[0] > 1))


def _alone() -> list[str]:
    """Mechanisms whose names are worlds; packages are not loaded for their names."""
    return [*(name for name, kind in OWN.items() if kind.arity[1]), *plugins.names("mechanisms")]


def _is_drawn(kind: type[Mechanism], inputs: int, novel: bool) -> bool:
    """Whether a mechanism of this kind is drawn for so many inputs of some sizes, and some stages."""
    rng = generator(0, NOVEL, 0, "is it drawn")
    sizes = product((2, 3), repeat=inputs)
    return any(kind.draw(one, stages, novel, rng) for one in sizes for stages in STAGES.values())


def links_of(models: Sequence[ObjectModel]) -> Links:
    """The trigger links of a board with these objects."""
    links = [(index, link) for index, model in enumerate(models) for link in model.trigger_links]
    return Links(tuple((index, link.name) for index, link in links), tuple(link.states for _, link in links))


def with_world(board: BoardSpec, models: Sequence[ObjectModel], name: str, depth: tuple[int, int]) -> BoardSpec | None:
    """The board with relations of the world; None if these objects do not suffice.

    Args:
        models: of the board's objects, in order.
        depth: least and most number of locks, in a world that has them.
    """
    novel, links = board.split == NOVEL, links_of(models)
    world, rng = world_named(name, novel), generator(board.seed, board.split, board.index, "world")
    if not links.names:  # a library may have nothing but responders among its switches
        return None
    blank = {**dict(board), "schema_version": WORLDS_VERSION, "world": name}
    for _ in range(DRAWS):
        drawn = _Draw(world, models, links, novel, rng)
        relations = drawn.relations()
        if relations is None:
            continue
        found = BoardSpec.model_validate({**blank, "relations": relations, "idle": drawn.idle_links()})
        if world.locked and rng.random() < world.locked:
            locks = draw_locks(found, links, depth, rng)
            if locks is None:
                continue
            found = found.model_copy(update={"locks": locks})
        walk = _walk(found, links, rng)
        if not _all_change(found, links, walk):
            continue
        if world.rewired and rng.random() < world.rewired:
            rewiring = drawn.rewiring(found, walk)
            if rewiring is None:
                continue
            found = found.model_copy(update={"rewirings": (rewiring,)})
        return found
    return None


def _walk(board: BoardSpec, links: Links, rng: np.random.Generator) -> list[tuple[int, ...]]:
    """States of the trigger links on a new board and after each of some random actions, as if nothing held them."""
    walk = [tuple(state for placed in board.objects for state in placed.states)]
    for number, up in zip(rng.integers(len(links.sizes), size=PROBE), rng.integers(2, size=PROBE), strict=True):
        now, last = list(walk[-1]), links.sizes[number] - 1
        now[number] = 1 - now[number] if last == 1 else min(max(now[number] + 2 * int(up) - 1, 0), last)
        walk.append(tuple(now))
    return walk


def _all_change(board: BoardSpec, links: Links, walk: Sequence[tuple[int, ...]]) -> bool:
    """Whether each responder that something drives shows more than one state."""
    resting = {relation.responder for relation in board.relations if relation.triggers}
    dynamics = Dynamics(board, links, lucky=False)
    state = start = dynamics.start(walk[0])
    for triggers in walk[1:]:
        state = dynamics.step(triggers, state)
        resting = {responder for responder in resting if state.shown[responder] == start.shown[responder]}
        if not resting:
            return True
    return False


def _acts_otherwise(old: BoardSpec, new: BoardSpec, links: Links, walk: Sequence[tuple[int, ...]]) -> bool:
    """Whether two boards show different things while the same is done on them, after what they show at first."""
    laws = [Dynamics(board, links, lucky=False) for board in (old, new)]
    one, other = (law.start(walk[0]) for law in laws)
    for triggers in walk[1:]:
        one, other = laws[0].step(triggers, one), laws[1].step(triggers, other)
        if one.shown != other.shown:
            return True
    return False


@dataclass
class _Draw:
    """One draw of a board's relations."""

    world: World
    models: Sequence[ObjectModel]
    links: Links
    novel: bool
    rng: np.random.Generator

    def __post_init__(self) -> None:
        free = self.rng.random(len(self.links.sizes)) >= self.world.idle
        if free.sum() < 2:
            free[:] = True
        self.active = [int(n) for n in np.flatnonzero(free)]
        self.used: set[int] = set()
        self.left = 0
        """So many responders are to be drawn, with the one that is."""
        weights = np.array(list(self.world.kinds.values()))
        self.names, self.shares = list(self.world.kinds), (np.cumsum(weights) / weights.sum()).tolist()

    def idle_links(self) -> tuple[LinkRef, ...]:
        return tuple(self._reference(n) for n in range(len(self.links.sizes)) if n not in self.active)

    def relations(self) -> tuple[Relation, ...] | None:
        """Relations of responders; None if some link has nothing to do."""
        world, rng = self.world, self.rng
        responders = [int(i) for i in rng.permutation([i for i, model in enumerate(self.models) if model.effect])]
        found: dict[int, Relation] = {}
        single = [one for one in responders if self._stages(one)[0]]
        if world.clock and rng.random() < world.clock and len(single) > CLOCKED[1]:
            for one in self._clocked(single):
                found[one.responder] = one
        for responder in responders:
            if responder in found:
                continue
            self.left = len(responders) - len(found)
            if self.world.locked == 1 and self.used and self.left < self._unused:
                return None
            relation = None
            if rng.random() >= INERT or self._pressed:
                relation = self._spontaneous(responder) or self._following(responder, found) or self._driven(responder)
            found[responder] = relation or self._resting(responder)
        chained = sum(any(ref.link == BODY for ref in one.triggers) for one in found.values())
        of_the_world = not set(world.kinds).isdisjoint(one.kind for one in found.values() if one.kind not in PAPERS)
        if chained < world.followers or (not of_the_world and self._own_kinds()):
            return None
        if not self.used.issuperset(self.active):
            return None
        return tuple(found[one] for one in sorted(found))

    def _own_kinds(self) -> bool:
        """Whether the world is about mechanisms that the paper's does not have, and not about what becomes of any."""
        return not set(self.world.kinds) <= set(PAPERS) and max(self.world.locked, self.world.rewired) < 1

    def rewiring(self, board: BoardSpec, walk: Sequence[tuple[int, ...]]) -> Rewiring | None:
        """Another mechanism for one of the responders that links drive, and nothing depends on, which does something
        else.

        Args:
            walk: that shows it.
        """
        relations = board.relations
        driven = [one for one in relations if one.triggers and all(ref.link != BODY for ref in one.triggers)]
        needed = {ref.object for one in relations for ref in one.triggers if ref.link == BODY}
        needed |= {lock.responder for lock in board.locks}
        driven = [one for one in driven if one.responder not in needed]
        if not driven:
            return None
        for _ in range(MECHANISM_TRIES):
            old = driven[int(self.rng.integers(len(driven)))]
            new = self._driven(old.responder, old.stage)
            if new is None or new == old:
                continue
            changed = tuple(new if one is old else one for one in relations)
            after = board.model_copy(update={"relations": changed})
            if _all_change(after, self.links, walk) and _acts_otherwise(board, after, self.links, walk):
                return Rewiring(step=int(self.rng.integers(*REWIRED_AT, endpoint=True)), relation=new)
        return None

    def _clocked(self, single: list[int]) -> Iterator[Relation]:
        count = int(self.rng.integers(*CLOCKED, endpoint=True))
        chosen = self.rng.choice(single, count, replace=False)
        drawn = [OWN["clock"].draw((), 2, self.novel, self.rng) for _ in chosen]
        for responder, mechanism in zip(chosen, drawn, strict=True):
            assert mechanism is not None and drawn[0] is not None
            shared = mechanism.model_copy(update={"probability": drawn[0].parameters()["probability"]})
            yield _relation(shared, (), int(responder), "single", stream="clock")

    def _spontaneous(self, responder: int) -> Relation | None:
        if not self.world.flickers or self.rng.random() >= self.world.flickers or not self._stages(responder)[0]:
            return None
        mechanism = OWN["flicker"].draw((), 2, self.novel, self.rng)
        return _relation(mechanism, (), responder, "single") if mechanism else None

    def _following(self, responder: int, found: dict[int, Relation]) -> Relation | None:
        """What reads a responder that has a luck of its own: else what drives that one would explain this one, too."""
        if not self.world.follows or self.rng.random() >= self.world.follows or not self._stages(responder)[0]:
            return None
        read = [one for one in found.values() if one.kind == "unreliable" and one.stage == "single"]
        if not read:
            return None
        source = LinkRef(object=read[int(self.rng.integers(len(read)))].responder, link=BODY)
        for _ in range(MECHANISM_TRIES):
            second = self.novel or self.rng.random() < self.world.two
            numbers = self._inputs(1) if second else []
            sizes = (2, *(self.links.sizes[n] for n in numbers))
            mechanism = OWN["gate" if second else DIRECT].draw(sizes, 2, self.novel, self.rng)
            if mechanism is not None:
                self.used.update(numbers)
                references = (source, *map(self._reference, numbers))
                return _relation(mechanism, references, responder, "single")
        return None

    def _driven(self, responder: int, stage: str | None = None) -> Relation | None:
        """What trigger links drive; None if no kind of the world fits the responder."""
        for _ in range(MECHANISM_TRIES):
            kind = known_kind(self.names[bisect_left(self.shares, self.rng.random())])
            if kind.arity[0] > len(self.active):
                continue
            numbers = self._inputs(self._count(kind))
            sizes = tuple(self.links.sizes[n] for n in numbers)
            suitable = [name for name, fits in zip(("single", "multi"), self._stages(responder), strict=True) if fits]
            chosen = stage or suitable[int(self.rng.integers(len(suitable)))]
            mechanism = kind.draw(sizes, 2 if chosen == "single" else 3, self.novel, self.rng)
            if mechanism is not None:
                self.used.update(numbers)
                return _relation(_paper_kind(mechanism), tuple(map(self._reference, numbers)), responder, chosen)
        return None

    def _resting(self, responder: int) -> Relation:
        """What nothing moves: it shows what links would have made of it, had they driven it, from any states."""
        used = set(self.used)
        other = self._driven(responder)
        self.used = used
        if other is None:
            stages = 2 if self._stages(responder)[0] else 3
            stage, state = ("single" if stages == 2 else "multi"), int(self.rng.integers(stages))
        else:
            sizes = [self.links.sizes[self.links.names.index((ref.object, ref.link))] for ref in other.triggers]
            states = tuple(int(self.rng.integers(size)) for size in sizes)
            stage, (state, _) = other.stage, mechanism_of(other, sizes).start(states)
        return _relation(Rest(sizes=(), table=(state,)), (), responder, stage)

    def _count(self, kind: type[Mechanism]) -> int:
        least, most = kind.arity
        wanted = 2 if self.rng.random() < self.world.two else 1
        if self.novel and wanted == 2 and self.rng.random() < 1 / 3:
            wanted = 3
        return min(max(wanted, least), most, len(self.active))

    def _inputs(self, count: int) -> list[int]:
        """Numbers of so many links, those that control nothing yet more often.

        Where links are held, all but one control something already, if so many do: what holds a link depends on links
        that come earlier.
        """
        used = 0.0 if self._pressed and len(self.used) >= count else 1.0
        weights = [used if n in self.used else UNUSED_WEIGHT for n in self.active]
        if self.world.locked == 1 and len(self.used) >= count > 1:
            first = self._one(weights)
            return [first, *map(int, self.rng.choice(sorted(self.used - {first}), count - 1, replace=False))]
        if count == 1:
            return [self._one(weights)]
        shares = np.array(weights) / sum(weights)
        return [int(n) for n in self.rng.choice(self.active, count, replace=False, p=shares)]

    @property
    def _unused(self) -> int:
        return len(self.active) - len(self.used)

    @property
    def _pressed(self) -> bool:
        """Whether no responder that is left can be spared, where each gives one link something to do."""
        return self.world.locked == 1 and 0 < self.left <= self._unused

    def _one(self, weights: list[float]) -> int:
        """The same number as `rng.choice` with these weights would give, in a twentieth of the time."""
        whole = sum(weights)
        shares = list(accumulate(weight / whole for weight in weights))
        return self.active[bisect_right([share / shares[-1] for share in shares], self.rng.random())]

    def _stages(self, responder: int) -> tuple[bool, bool]:
        """Whether it can have two states, and whether three."""
        effect = self.models[responder].effect
        assert effect is not None
        return effect.single is not None, effect.multi is not None

    def _reference(self, number: int) -> LinkRef:
        index, name = self.links.names[number]
        return LinkRef(object=index, link=name)


def _paper_kind(mechanism: Mechanism) -> Mechanism:
    """Under the paper's name for a link with three states."""
    if mechanism.kind == DIRECT and mechanism.sizes == (3,):
        return OWN["one-to-many-effects"].model_validate(dict(mechanism))
    return mechanism


def _relation(
    mechanism: Mechanism, inputs: tuple[LinkRef, ...], responder: int, stage: str, stream: str | None = None
) -> Relation:
    parameters = mechanism.parameters() | ({"stream": stream} if stream else {})
    return Relation.model_validate(
        {
            "kind": mechanism.kind,
            "triggers": inputs,
            "responder": responder,
            "stage": stage,
            "states": mechanism.table,
            "parameters": parameters,
        }
    )


def draw_locks(
    board: BoardSpec, links: Links, depth: tuple[int, int], rng: np.random.Generator
) -> tuple[Lock, ...] | None:
    """A chain of locks: each link is held until a responder, which the link before it has a part in, has changed.

    Only responders without chance or memory hold links, and only where links that come earlier drive them. So all can
    be opened, from the first to the last, and any states of the links can be reached: those of the last link first.
    No other link changes the responder while the link before it is where it was, so that none is opened out of turn: it
    takes at least one action more than there are locks to move the last link, and more where a responder changes only
    after two links have moved, or after a link with three states has moved twice. Links that control nothing are not
    held.

    Returns:
        None if no chain of at least `depth[0]` locks is there.
    """
    least, most = max(1, depth[0]), min(depth[1], len(links.names) - 1)
    drivers = {one.responder: _drivers(one, links) for one in board.relations}
    drivers = {responder: numbers for responder, numbers in drivers.items() if numbers}
    if most < least or not drivers:
        return None
    idle = {links.names.index((ref.object, ref.link)) for ref in board.idle}
    wanted = int(rng.integers(least, most, endpoint=True))
    triggers = tuple(state for placed in board.objects for state in placed.states)
    keys = {one.responder: _keys(one, links, triggers) for one in board.relations if one.responder in drivers}
    chain = _longest_chain(drivers, keys, set(range(len(links.names))) - idle, wanted, rng)
    if len(chain) < least:
        return None
    shown = Dynamics(board, links, lucky=False).start(triggers).shown
    stages = {one.responder: STAGES[one.stage] for one in board.relations}
    return tuple(
        Lock(
            link=LinkRef(object=links.names[number][0], link=links.names[number][1]),
            responder=responder,
            states=tuple(state for state in range(stages[responder]) if state != shown[responder]),
        )
        for responder, number in chain
    )


def _longest_chain(
    drivers: dict[int, frozenset[int]],
    keys: dict[int, frozenset[int]],
    links: set[int],
    wanted: int,
    rng: np.random.Generator,
) -> list[tuple[int, int]]:
    """Responders and the link that each of them holds, in the order in which they are opened, at most `wanted`.

    Args:
        drivers: of each responder that may hold a link, the links that drive it.
        keys: those of them without which it does not change.
        links: those that may be held.
    """
    best: list[tuple[int, int]] = []
    tries = CHAIN_TRIES

    def extend(chain: list[tuple[int, int]], free: frozenset[int], holder: int) -> None:
        nonlocal best, tries
        tries -= 1
        for number in map(int, rng.permutation(sorted(links - free))):
            longer, opened = [*chain, (holder, number)], free | {number}
            if len(longer) > len(best):
                best = longer
            for following in sorted(one for one, its in drivers.items() if number in keys[one] and its <= opened):
                if len(best) < wanted and tries > 0:
                    extend(longer, opened, following)
            if len(best) >= wanted or tries <= 0:
                return

    for first in map(int, rng.permutation(sorted(drivers))):
        if len(best) < wanted and tries > 0:
            extend([], drivers[first], first)
    return best


def _keys(relation: Relation, links: Links, triggers: Sequence[int]) -> frozenset[int]:
    """Numbers of the links that a responder without memory does not change without, from these states."""
    inputs = [links.names.index((ref.object, ref.link)) for ref in relation.triggers]
    table = np.array(relation.states).reshape([links.sizes[number] for number in inputs])
    return frozenset(
        number for axis, number in enumerate(inputs) if len(np.unique(np.take(table, triggers[number], axis))) == 1
    )


def _drivers(relation: Relation, links: Links) -> frozenset[int]:
    """Numbers of the links that drive a responder without chance or memory; none of them for any other."""
    if relation.kind not in MEMORYLESS or any(ref.link == BODY for ref in relation.triggers):
        return frozenset()
    return frozenset(links.names.index((ref.object, ref.link)) for ref in relation.triggers)
