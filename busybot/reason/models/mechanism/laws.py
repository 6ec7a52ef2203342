"""What a board does, by the likeliest explanations of a recording: simulated action by action, and learned further.

Each responder has several explanations at once, which lose weight when something else happens than they foretold (by
the estimator of `evidence.evidence_of`). What follows is what followed most often in the context of the weightiest one,
or where that makes go what may fail; a context that was never met says what it must if every input is to matter
(`completion`), or nothing.
"""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import softmax

from busybot.reason.models.mechanism.completion import completed, lasting
from busybot.reason.models.mechanism.contexts import (
    ATTEMPTS,
    DELAYS,
    LONGEST,
    REMEMBERED,
    RESTED,
    STATES,
    SURE,
    UNSURE,
    WAYS,
    Memory,
)

KEPT = 8
"""Explanations of a responder that are kept."""
NEVER = 10_000
"""Actions since a press that never was."""
MISREAD = 0.02
"""How often a look is taken for another one."""
NODES = 3000
"""A plan is looked for among so many states of the board."""

Links = tuple[int, ...]
Moves = Callable[["Moment"], Iterable[Links]]
"""The states of the links that an action may lead to."""


@dataclass(frozen=True)
class Moment:
    """A board and what explanations remember of it; L links, R responders.

    Attributes:
        links: (L,), states.
        shown: (R,), states of the responders.
        rows: for each of the last `DELAYS` actions, the latest first, the links after it and the responders before it.
        since: by way of pressing and link, actions since the last press.
        odd: by way and link, whether there was an odd number of presses.
    """

    links: Links
    shown: tuple[int, ...]
    rows: tuple[tuple[int, ...], ...]
    since: tuple[tuple[int, ...], ...]
    odd: tuple[tuple[int, ...], ...]

    @staticmethod
    def new(links: Sequence[int], shown: Sequence[int]) -> "Moment":
        """A board on which everything has rested for long."""
        states, none = tuple(map(int, links)), tuple(map(int, shown))
        never, even = ((NEVER,) * len(states),) * len(WAYS), ((0,) * len(states),) * len(WAYS)
        return Moment(states, none, ((*states, *none),) * DELAYS, never, even)

    def acted(self, links: Links, sizes: Sequence[int]) -> "Moment":
        """After an action that left the links so; the responders still as before it."""
        ends = ([size - 1 for size in sizes], [0] * len(sizes))
        pressed = [[a != b == end for a, b, end in zip(self.links, links, own, strict=True)] for own in ends]
        since = tuple(
            tuple(0 if one else min(k + 1, NEVER) for one, k in zip(new, old, strict=True))
            for new, old in zip(pressed, self.since, strict=True)
        )
        odd = tuple(
            tuple(k ^ one for one, k in zip(new, old, strict=True)) for new, old in zip(pressed, self.odd, strict=True)
        )
        return replace(self, links=links, rows=((*links, *self.shown), *self.rows[:-1]), since=since, odd=odd)


@dataclass
class _Law:
    """An explanation of one responder.

    Attributes:
        sizes: number of states of each input.
        rising: log odds that these are numbered as they rise.
        states: number of states of the responder.
        weight: log probability.
        counts: how often each state followed a context.
        goals: of what may fail: how well each state agrees with being where it goes in a context, see
            `contexts.attempts`.
    """

    inputs: tuple[int, ...]
    sizes: tuple[int, ...]
    rising: tuple[float, ...]
    states: int
    memory: Memory
    weight: float
    counts: dict[tuple[int, ...], list[int]] = field(default_factory=dict)
    goals: dict[tuple[int, ...], np.ndarray] = field(default_factory=dict)
    _unmet: dict[tuple[int, ...], np.ndarray] | None = None

    @staticmethod
    def of(
        inputs: np.ndarray, memory: Memory, share: float, states: int, sizes: Sequence[int], rising: Sequence[float]
    ) -> "_Law":
        """Of a responder with so many states, on a board with inputs of these sizes."""
        read = tuple(np.flatnonzero(inputs).tolist())
        of_inputs = tuple(sizes[one] for one in read), tuple(rising[one] for one in read)
        return _Law(read, *of_inputs, states, memory, float(np.log(share + 1e-9)))

    def context(self, after: Moment, before: int) -> tuple[int, ...]:
        """After an action, with the responder as it was before it."""
        memory = self.memory
        if memory.what == "odd":
            return (after.odd[memory.ways[0]][self.inputs[0]],)
        since = [after.since[way][link] for way, link in zip(memory.ways, self.inputs, strict=False)]
        if memory.what == "since":
            return (min(since[0], LONGEST),)
        if memory.what == "last":
            return (int(np.sign(since[0] - since[1])),)
        told = tuple(after.rows[memory.delay][one] for one in self.inputs)
        return (*told, before) if memory.own else told

    def met(self, context: tuple[int, ...]) -> int | None:
        """The state that followed mostly, of what may fail the one where it goes; None if the context was never met."""
        if self.fails:
            told = self.goals.get(context[:-1])
            return None if told is None else int(told.argmax())
        counts = self.counts.get(context)
        return None if counts is None else counts.index(max(counts))

    @property
    def fails(self) -> bool:
        """Whether it may fail to go where its inputs say."""
        return self.memory.own and bool(self.inputs)

    def follows(self, context: tuple[int, ...]) -> int | None:
        """The state that follows, also if the context was never met; None where that is open."""
        if (state := self.met(context)) is not None or self.memory.what in ("odd", "last") or not self.inputs:
            return state
        if self._unmet is None:
            followed = self.goals if self.fails else self.counts
            known = {inputs: int(np.argmax(told)) for inputs, told in followed.items()}
            if self.memory.what == "since":
                self._unmet = lasting(known, self.states)
            else:
                self._unmet = completed(known, self.sizes, self.states, self.rising)
        shares = self._unmet.get(context[: len(self.inputs)])
        return int(shares.argmax()) if shares is not None and shares.max() > 0.5 else None

    def probability(self, context: tuple[int, ...], state: int) -> float:
        """Of a state after a context, as often as it followed so far."""
        counts, few = self.counts.get(context, [0] * STATES), UNSURE if self.memory.own else SURE
        return (counts[state] + few) / (sum(counts) + few * self.states)

    def learn(self, context: tuple[int, ...], state: int, rested: bool) -> None:
        """That a state followed a context; or that it has rested for long."""
        self._unmet = None
        self.weight += float(np.log(self.probability(context, state)))
        self.counts.setdefault(context, [0] * STATES)[state] += 1
        if self.fails:
            told = RESTED[state] if rested else ATTEMPTS[context[-1], state]
            self.goals[context[:-1]] = self.goals.get(context[:-1], 0.0) + told


class Laws:
    """The laws of a board.

    Args:
        sizes: number of states of each link.
        inputs: bool (H, I), of the explanations.
        memory: int (H,), which of `REMEMBERED`.
        shares: float (R, H), probability of each explanation.
        links, responders: int (T + 1, L), (T + 1, R), what was seen.
        of: bool (R, T + 1), the moments that tell of these explanations; all by default.
        rising: float (L,), log odds that the links' states are numbered as they rise; nothing is known by default.
    """

    def __init__(
        self,
        sizes: Sequence[int],
        inputs: np.ndarray,
        memory: np.ndarray,
        shares: np.ndarray,
        links: np.ndarray,
        responders: np.ndarray,
        of: np.ndarray | None = None,
        rising: np.ndarray | None = None,
    ):
        self.sizes, self._ways = tuple(sizes), [max(2, int(column.max()) + 1) for column in responders.T]
        of_inputs = (*self.sizes, *self._ways)
        odds = (*([0.0] * len(self.sizes) if rising is None else rising.tolist()), *[0.0] * len(self._ways))
        self._laws = [
            [
                _Law.of(inputs[h], REMEMBERED[memory[h]], own[h], states, of_inputs, odds)
                for h in np.argsort(-own, kind="stable")[:KEPT]
            ]
            for own, states in zip(shares, self._ways, strict=True)
        ]
        weights = [[law.weight for law in laws] for laws in self._laws]
        moment = self.begin(links[0], responders[0], None if of is None else of[:, 0])
        for step in range(1, len(links)):
            told = None if of is None else of[:, step]
            moment = self.learn(moment, tuple(links[step].tolist()), tuple(responders[step].tolist()), told)
        for laws, known in zip(self._laws, weights, strict=True):  # the network has weighed this evidence
            for law, weight in zip(laws, known, strict=True):
                law.weight = weight

    def begin(self, links: Sequence[int], shown: Sequence[int], told: np.ndarray | None = None) -> Moment:
        """A new board as it stands; that it has stood so for long is learned, too.

        Args:
            told: bool (R,), of which responders anything is learned; all by default.
        """
        moment = Moment.new(links, shown)
        self._count(moment, moment.shown, moment.shown, told, rested=True)
        return moment

    def learn(self, moment: Moment, links: Links, shown: tuple[int, ...], told: np.ndarray | None = None) -> Moment:
        """After an action that left links and responders so; `told` as in `begin`."""
        after = moment.acted(links, self.sizes)
        self._count(after, moment.shown, shown, told)
        return replace(after, shown=shown)

    def _count(
        self,
        after: Moment,
        before: tuple[int, ...],
        shown: tuple[int, ...],
        told: np.ndarray | None,
        rested: bool = False,
    ) -> None:
        for number, laws in enumerate(self._laws):
            for law in laws if told is None or told[number] else ():
                law.learn(law.context(after, before[number]), shown[number], rested)

    def best(self) -> list[_Law]:
        """The weightiest law of each responder."""
        return [max(laws, key=lambda law: law.weight) for laws in self._laws]

    def plan(
        self, start: Moment, wanted: dict[int, int], moves: Moves, longest: int, hopeful: bool = False
    ) -> list[Links]:
        """The shortest way to a moment at which most of what is wanted shows: the links after each action.

        Args:
            wanted: states by number of the responder.
            moves: what can be done.
            longest: at most so many actions.
            hopeful: take what was never met for what is wanted.

        Returns:
            nothing if no way leads to more of it than shows already, or all of it does.
        """
        laws = self.best()
        ways: deque[tuple[Moment, tuple[Links, ...]]] = deque([(start, ())])
        best: tuple[int, tuple[Links, ...]] = (self._satisfied(start, wanted), ())
        seen = {self._key(start, laws)}
        while ways and len(seen) < NODES and best[0] < len(wanted):
            moment, way = ways.popleft()
            for links in moves(moment) if len(way) < longest else ():
                after = self._after(moment, links, laws, wanted if hopeful else {})
                key = self._key(after, laws)
                if key in seen:
                    continue
                seen.add(key)
                longer = (*way, links)
                if (count := self._satisfied(after, wanted)) > best[0]:
                    best = (count, longer)
                ways.append((after, longer))
        return list(best[1])

    def reaches(self, start: Moment, way: Sequence[Links], wanted: dict[int, int]) -> bool:
        """Whether all of what is wanted is expected at the end of a way."""
        return self._satisfied(self.expected(start, way)[-1], wanted) == len(wanted)

    def expected(self, start: Moment, way: Sequence[Links]) -> list[Moment]:
        """The start, and what follows each action of a way; what was never met leaves all as it is."""
        moments, laws = [start], self.best()
        for links in way:
            moments.append(self._after(moments[-1], links, laws, {}))
        return moments

    def agreement(self, moment: Moment, links: Links, shown: tuple[int, ...]) -> float:
        """Log probability of what shows after an action that left the links so, by all laws that are kept."""
        after, total = moment.acted(links, self.sizes), 0.0
        for laws, ways, before, state in zip(self._laws, self._ways, moment.shown, shown, strict=True):
            shares = softmax([law.weight for law in laws])
            told = sum(
                share * law.probability(law.context(after, before), state)
                for share, law in zip(shares, laws, strict=True)
            )
            total += float(np.log((1 - MISREAD) * told + MISREAD / ways))
        return total

    def _after(self, moment: Moment, links: Links, laws: list[_Law], hoped: dict[int, int]) -> Moment:
        after, shown = moment.acted(links, self.sizes), list(moment.shown)
        for number, (law, before) in enumerate(zip(laws, moment.shown, strict=True)):
            context = law.context(after, before)
            follows = law.met(context) if number in hoped else law.follows(context)
            shown[number] = hoped.get(number, before) if follows is None else follows
        return replace(after, shown=tuple(shown))

    def _satisfied(self, moment: Moment, wanted: dict[int, int]) -> int:
        return sum(moment.shown[number] == state for number, state in wanted.items())

    def _key(self, moment: Moment, laws: list[_Law]) -> tuple[object, ...]:
        """Equal where the same will follow."""
        late = [tuple(row[one] for row in moment.rows[: law.memory.delay] for one in law.inputs) for law in laws]
        memories = [law.context(moment, own) for law, own in zip(laws, moment.shown, strict=True) if law.memory.ways]
        return moment.links, moment.shown, tuple(late), tuple(memories)

    def words(self, number: int, names: Sequence[str]) -> str:
        """What decides a responder, for people.

        Args:
            names: of the inputs, links first.
        """
        law = self.best()[number]
        inputs, memory = [names[one] for one in law.inputs], law.memory
        if not inputs:
            states = {law.met(context) for context in law.counts}
            return "changes by itself" if memory.own and len(states) > 1 else "nothing moves it"
        if memory.what == "odd":
            return f"changes with every press of {inputs[0]}"
        if memory.what == "since":
            return f"changes for some actions when {inputs[0]} is pressed"
        if memory.what == "last":
            return f"is set by {inputs[0]}, reset by {inputs[1]}"
        late = ", sometimes late" if memory.own else ""
        if memory.delay:
            late = f", {memory.delay} action{'s' * (memory.delay > 1)} later"
        return f"{f'follows {inputs[0]}' if len(inputs) == 1 else self._together(law, inputs)}{late}"

    def _together(self, law: _Law, inputs: Sequence[str]) -> str:
        """How several inputs decide: by the one situation that is unlike all others, if there is one."""
        states: dict[tuple[int, ...], int | None] = {}
        for context in sorted(law.counts):
            states.setdefault(context[: len(inputs)], law.met(context))
        for state in set(states.values()):
            rare = [context for context, other in states.items() if other == state]
            if len(rare) == 1 < len(states) - 1 and len(set(states.values())) == 2:
                told = " and ".join(map(self._stands, law.inputs, inputs, rare[0]))
                return f"shows look {state} only while {told}"
        odd = {(sum(context) % 2, state) for context, state in states.items()}
        if len(inputs) == 2 and len(states) == 4 and len(odd) == len(set(states.values())) == 2:
            return f"changes whenever {' or '.join(inputs)} is moved"
        return f"is decided by {' and '.join(inputs)} together"

    def _stands(self, number: int, name: str, state: int) -> str:
        if number < len(self.sizes) and self.sizes[number] == 2:
            return f"{name} is {'moved' if state else 'as at first'}"
        return f"{name} is in state {state}"
