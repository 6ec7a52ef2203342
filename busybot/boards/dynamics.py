"""How a board changes from action to action: its mechanisms, locks and rewirings, without a simulator.

The truth of a board in any world is a function of the states of its trigger links after each action. The simulator
shows it, replay puts it back, tasks are searched in it, and evaluators ask it "what if".

Luck is drawn anew for each action from (seed, split, board, stream, number of the action): a state needs no generator,
and what follows a restored state is what would have followed then.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, islice

from busybot.boards.mechanisms import Mechanism, mechanism_of
from busybot.boards.mechanisms.base import Inputs, Luck, Memory
from busybot.boards.spec import BODY, BoardSpec, LinkRef, Relation
from busybot.common.errors import BusybotError
from busybot.common.rng import generator

Triggers = tuple[int, ...]
"""State of each trigger link."""
STAGES = {"single": 2, "multi": 3}
"""How many states a responder has."""
HINT_OBJECTS = "use the objects with which the boards were generated"


@dataclass(frozen=True)
class Links:
    """A board's trigger links in its order, object by object.

    Attributes:
        names: object and name of each.
        sizes: number of states of each.
    """

    names: tuple[tuple[int, str], ...]
    sizes: tuple[int, ...]


@dataclass(frozen=True)
class DynamicState:
    """What distinguishes a board from a new one beside its trigger links' states.

    Attributes:
        tick: number of actions so far.
        shown: state of every object's responder, -1 for triggers.
        memories: of the board's mechanisms, in the order of its relations.
    """

    tick: int
    shown: tuple[int, ...]
    memories: tuple[tuple[int, ...], ...]

    @property
    def flat(self) -> tuple[int, ...]:
        """The memories one after the other, as recordings store them."""
        return tuple(number for memory in self.memories for number in memory)


@dataclass(frozen=True)
class Bound:
    """A mechanism and what it is bound to.

    Attributes:
        responder: index of the object that it decides.
        inputs: of each input the number of a trigger link, or the index of a responder and True.
        stream: names its luck.
        stages: how many states the responder has.
    """

    mechanism: Mechanism
    responder: int
    inputs: tuple[tuple[int, bool], ...]
    stream: str
    stages: int

    def read(self, triggers: Sequence[int], shown: Sequence[int]) -> Inputs:
        return tuple(shown[place] if responder else triggers[place] for place, responder in self.inputs)

    def start(self, inputs: Inputs) -> tuple[int, Memory]:
        """As `Mechanism.start`.

        Raises:
            BusybotError: the responder has no such state.
        """
        return self._checked(*self.mechanism.start(inputs))

    def step(self, inputs: Inputs, memory: Memory, chance: Luck | None) -> tuple[int, Memory]:
        """As `Mechanism.step`.

        Raises:
            BusybotError: the responder has no such state.
        """
        return self._checked(*self.mechanism.step(inputs, memory, chance))

    def _checked(self, state: int, memory: Memory) -> tuple[int, Memory]:
        if not 0 <= state < self.stages:
            what = f"its mechanism, of the kind {self.mechanism.kind!r}, shows state {state} of {self.stages}, from 0"
            raise BusybotError(f"responder {self.responder}: {what}", "correct what its class starts and steps to")
        return state, memory


class Dynamics:
    """The law of one board.

    Args:
        lucky: whether chance plays its part; without, whatever may fail succeeds and nothing moves by itself.

    Raises:
        BusybotError: a relation is of an unknown kind, or relations or states do not fit the board's links.
    """

    def __init__(self, board: BoardSpec, links: Links, lucky: bool = True):
        if board.model_extra:
            what = f"board {board.index} has {', '.join(map(repr, sorted(board.model_extra)))}, unknown here"
            raise BusybotError(what, "a later version of busybot wrote it")
        self.board, self.links, self.lucky = board, links, lucky
        self._check_states()
        self._number = {name: number for number, name in enumerate(links.names)}
        self._bound = tuple(map(self._bind, board.relations))
        # a responder has one relation at any time: a later one takes the place of the one before
        place = {relation.responder: number for number, relation in enumerate(board.relations)}
        if len(place) < len(board.relations):
            raise BusybotError(
                f"board {board.index} has two relations for one responder",
                "a mechanism with several inputs decides a responder that several links drive",
            )
        self._rewired: dict[int, list[tuple[int, Bound]]] = {}
        for one in board.rewirings:
            if one.relation.responder not in place:
                raise BusybotError(
                    f"board {board.index}: a rewiring of responder {one.relation.responder}, which has no relation"
                )
            before = board.relations[place[one.relation.responder]]
            if one.relation.stage != before.stage:
                what = f"a rewiring makes it {one.relation.stage}-stage, and it is built {before.stage}-stage"
                raise BusybotError(f"board {board.index}, responder {before.responder}: {what}", "keep its stage")
            found = (place[one.relation.responder], self._bind(one.relation))
            self._rewired.setdefault(one.step, []).append(found)
        self._locks = tuple((self.number(lock.link), lock) for lock in board.locks)

    def start(self, triggers: Sequence[int]) -> DynamicState:
        """A new board, on which everything has rested for long."""
        shown = [-1 if placed.role == "trigger" else 0 for placed in self.board.objects]
        memories: list[tuple[int, ...]] = [()] * len(self._bound)
        # what reads a responder reads what it has long shown: as many rounds as the longest chain has members
        for _ in range(max(1, len(self._bound))):
            before = list(shown)
            for number, bound in enumerate(self._bound):
                shown[bound.responder], memories[number] = bound.start(bound.read(triggers, shown))
            if shown == before:
                break
        return DynamicState(0, tuple(shown), tuple(memories))

    def step(self, triggers: Sequence[int], state: DynamicState) -> DynamicState:
        """After one more action, which left the trigger links in these states."""
        shown, memories = list(state.shown), list(state.memories)
        bound_now = self.bound_at(state.tick)
        fresh = {place for place, _ in self._rewired.get(state.tick, ())}
        for number, bound in enumerate(bound_now):
            inputs = bound.read(triggers, state.shown)
            if number in fresh:
                shown[bound.responder], memories[number] = bound.start(inputs)
                continue
            chance = self.chance(bound, state.tick) if bound.mechanism.draws and self.lucky else None
            shown[bound.responder], memories[number] = bound.step(inputs, state.memories[number], chance)
        return DynamicState(state.tick + 1, tuple(shown), tuple(memories))

    def run(self, triggers: Iterable[Sequence[int]]) -> list[DynamicState]:
        """The states of an episode: the new board's, then one after each action.

        Args:
            triggers: states of the trigger links, on the new board and after each action.
        """
        first, *after = triggers
        return list(accumulate(after, lambda state, now: self.step(now, state), initial=self.start(first)))

    def showing(self, triggers: Sequence[int], shown: tuple[int, ...]) -> DynamicState:
        """A new board's state but for what shows: for a picture of a goal."""
        return DynamicState(0, shown, self.start(triggers).memories)

    def moves(self, triggers: Triggers, state: DynamicState) -> list[Triggers]:
        """States of the trigger links after each action that there is: one link a step further, or nothing moved."""
        found = [triggers] if self.remembers else []
        for number, (now, size) in enumerate(zip(triggers, self.links.sizes, strict=True)):
            if not self.locked(number, state.shown):
                found += [
                    (*triggers[:number], there, *triggers[number + 1 :])
                    for there in (now - 1, now + 1)
                    if 0 <= there < size
                ]
        return found

    def locked(self, link: int, shown: Sequence[int]) -> bool:
        """Whether a trigger link is held while the responders show these states."""
        return any(number == link and shown[lock.responder] not in lock.states for number, lock in self._locks)

    def chance(self, bound: Bound, tick: int) -> Luck:
        """Where the luck of a mechanism comes from, at the action of that number."""
        board = self.board
        return generator(board.seed, board.split, board.index, f"mechanism/{bound.stream}/{tick}")

    def mechanism(self, responder: int, tick: int = 0) -> Mechanism | None:
        """The responder's mechanism after so many actions."""
        found = (one.mechanism for one in self.bound_at(tick) if one.responder == responder)
        return next(found, None)

    def bound_at(self, tick: int) -> tuple[Bound, ...]:
        """The mechanisms that decide what shows after action number `tick`, from 0."""
        if not self._rewired:
            return self._bound
        now = list(self._bound)
        for step in sorted(self._rewired):
            if step <= tick:
                for place, bound in self._rewired[step]:
                    now[place] = bound
        return tuple(now)

    @cached_property
    def remembers(self) -> bool:
        """Whether what shows depends on more than the trigger links' present states, unlike in the paper's world."""
        # a kind that begins with nothing to remember may have something later
        memory = any(one.mechanism.draws or type(one.mechanism).step is not Mechanism.step for one in self._bound)
        return memory or bool(self._rewired) or any(responder for one in self._bound for _, responder in one.inputs)

    def _bind(self, relation: Relation) -> Bound:
        inputs = tuple(self._input(reference) for reference in relation.triggers)
        sizes = [self._stages(place) if responder else self.links.sizes[place] for place, responder in inputs]
        mechanism = mechanism_of(relation, sizes)
        if max(mechanism.table, default=0) >= STAGES[relation.stage]:
            what = f"a {relation.stage}-stage responder has no state {max(mechanism.table)}"
            raise BusybotError(f"board {self.board.index}, responder {relation.responder}: {what}")
        stream = str(relation.parameters.get("stream", relation.responder))
        return Bound(mechanism, relation.responder, inputs, stream, STAGES[relation.stage])

    def _input(self, reference: LinkRef) -> tuple[int, bool]:
        if reference.link == BODY and self.board.objects[reference.object].role == "responder":
            return reference.object, True
        return self.number(reference), False

    def number(self, reference: LinkRef) -> int:
        """Place of a trigger link among the board's."""
        number = self._number.get((reference.object, reference.link))
        if number is None:
            what = f"a relation names link {reference.link!r} of object {reference.object}, which is no trigger link"
            raise BusybotError(f"board {self.board.index}: {what}", HINT_OBJECTS)
        return number

    def _check_states(self) -> None:
        """Refuse states of trigger links, at the start or in the goal, that the links do not have."""
        sizes: list[list[int]] = [[] for _ in self.board.objects]
        for (index, _), size in zip(self.links.names, self.links.sizes, strict=True):
            sizes[index].append(size)
        goal = iter(self.board.task.goal if self.board.task else ())
        for index, (placed, own) in enumerate(zip(self.board.objects, sizes, strict=True)):
            for states in (placed.states, tuple(islice(goal, len(own))) or placed.states):
                if len(states) != len(own) or any(state >= size for state, size in zip(states, own, strict=True)):
                    what = f"states {list(states)} for trigger links with {own} of them"
                    raise BusybotError(f"board {self.board.index}, object {index} ({placed.key}): {what}", HINT_OBJECTS)

    def _stages(self, responder: int) -> int:
        stages = {one.responder: one.stage for one in self.board.relations}
        return STAGES[stages.get(responder, "single")]
