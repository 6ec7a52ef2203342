"""What might decide a responder, as contexts that explain what it shows.

An *explanation* is a set of inputs (trigger links, and responders as they were before the action) and what of their
past is remembered: nothing, their states some actions ago, since when a link was pressed, which was pressed last, ...
After every action it is in a *context*, a number. If it is the right one, equal contexts are followed by equal states
of the responder, whatever the function from contexts to states is: so an explanation needs no list of functions, and
gates that training never saw are explained as well as others.

How well explanations do is counted (`evidence`) and judged by a network (`networks`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, product
from typing import Literal

import numpy as np

from busybot.common.errors import BusybotError
from busybot.training.device import memory_limit

STATES = 3
"""A responder has so many at most; so has a link."""
DELAYS = 4
"""Inputs are remembered for up to so many actions, less one."""
LONGEST = 5
"""A press so many actions ago is long ago."""
INPUTS = 3
"""An explanation has so many inputs at most."""
WAYS = ("up", "down")
"""A link is pressed up when it comes to rest in its highest state, down in its lowest: pictures do not tell which is
on."""


@dataclass(frozen=True)
class Memory:
    """What an explanation remembers.

    Attributes:
        name: for people.
        what: of its inputs: `nothing`, their `states`, whether one was pressed an `odd` number of times, `since` when,
            or which one was pressed `last`.
        delay: so many actions ago they were in these states.
        ways: which presses count, of each input, numbers in `WAYS`.
        own: also the responder's state before the action, which is what luck leaves in place.
    """

    name: str
    what: Literal["nothing", "states", "odd", "since", "last"]
    delay: int = 0
    ways: tuple[int, ...] = ()
    own: bool = False


REMEMBERED = (
    Memory("none", "nothing"),
    Memory("own", "nothing", own=True),
    *(Memory(f"late {delay}", "states", delay) for delay in range(DELAYS)),
    Memory("own and now", "states", own=True),
    *(Memory(f"odd presses {way}", "odd", ways=(number,)) for number, way in enumerate(WAYS)),
    *(Memory(f"since press {way}", "since", ways=(number,)) for number, way in enumerate(WAYS)),
    *(
        Memory(f"last press {WAYS[one]}, {WAYS[two]}", "last", ways=(one, two))
        for one, two in product((0, 1), repeat=2)
    ),
)
"""What explanations may remember."""
MEMORIES = tuple(one.name for one in REMEMBERED)


def memories(*what: str) -> list[int]:
    """Numbers of what remembers one of these, in `REMEMBERED`."""
    return [number for number, one in enumerate(REMEMBERED) if one.what in what]


NONE, NOW, UNRELIABLE = map(MEMORIES.index, ("none", "late 0", "own and now"))
SINCE = memories("since")
SURE, UNSURE = 0.03, 0.4
"""Pseudo-counts of the estimators: of what is determined, and of what has a luck of its own."""
LUCK, MISTAKE = 0.8, 0.01
"""How often what may fail succeeds, about; and how often something else is seen than what can be."""


@dataclass(frozen=True)
class Trace:
    """States on a new board and after each of T actions; L links, R responders.

    Attributes:
        links: int (T + 1, L).
        responders: int (T + 1, R).
        sizes: number of states of each link.
        hidden: bool (T + 1, R), where a responder was not seen: its state is the one that it was last seen in, and
            tells nothing. None if all were seen at all times.
    """

    links: np.ndarray
    responders: np.ndarray
    sizes: tuple[int, ...]
    hidden: np.ndarray | None = None

    @property
    def seen(self) -> np.ndarray:
        """bool (T + 1, R), where a responder was seen."""
        return np.ones(self.responders.shape, bool) if self.hidden is None else ~self.hidden

    def first(self, actions: int) -> "Trace":
        """What was known after so many actions."""
        hidden = None if self.hidden is None else self.hidden[: actions + 1]
        return Trace(self.links[: actions + 1], self.responders[: actions + 1], self.sizes, hidden)

    def longer(self, links: np.ndarray | Sequence[int], responders: np.ndarray, times: int = 1) -> "Trace":
        """After one more action, or several, which left links and responders so, for all to see."""
        hidden = None if self.hidden is None else np.pad(self.hidden, ((0, times), (0, 0)))
        return Trace(
            np.vstack([self.links, *[links] * times]),
            np.vstack([self.responders, *[responders] * times]),
            self.sizes,
            hidden,
        )


@dataclass(frozen=True)
class Explanations:
    """H of them, on a board with I = L + R inputs: links, then responders.

    Attributes:
        inputs: bool (H, I).
        memory: int (H,), which of `REMEMBERED`.
        contexts: int (T + 1, H), on the new board and after each action; equal ones are equal numbers. What `own` adds
            is left out.
        own: bool (H,), whether the responder's state before the action is part of the context.
        reads: int (2, E), explanations and inputs that they read.
        fewer: int (E,), the explanation that remembers the same without this input.
        parts: int (H, 2 ** INPUTS), itself first, and those that remember the same of some of its inputs, or of none.
        signs: int (H, 2 ** INPUTS), of inclusion and exclusion: 1 where an even number of inputs is left out, -1 where
            an odd one is, 0 where there are no more.
        met: int (H,), how many contexts there are. What `own` adds is left out, and of presses what was never pressed.
    """

    inputs: np.ndarray
    memory: np.ndarray
    contexts: np.ndarray
    own: np.ndarray
    reads: np.ndarray
    fewer: np.ndarray
    parts: np.ndarray
    signs: np.ndarray
    met: np.ndarray


@dataclass(frozen=True)
class Layout:
    """All explanations of boards with so many links and responders.

    Attributes:
        inputs, memory, own, reads, fewer, parts, signs: as of `Explanations`.
        places, weights: int (H, INPUTS), which columns of `_memories` a context is the weighted sum of.
        since, last: rows of those that remember since when a link was pressed, or which was pressed last.
    """

    inputs: np.ndarray
    memory: np.ndarray
    own: np.ndarray
    reads: np.ndarray
    fewer: np.ndarray
    parts: np.ndarray
    signs: np.ndarray
    places: np.ndarray
    weights: np.ndarray
    since: np.ndarray
    last: np.ndarray


@lru_cache(maxsize=64)
def layout(links: int, responders: int) -> Layout:
    """Up to two inputs of which at most one is a responder, and up to three links; only links have a longer past."""
    count, late = links + responders, [number for number, one in enumerate(REMEMBERED) if one.delay]
    single = [(one,) for one in range(links)]
    pairs, threes = list(combinations(range(links), 2)), list(combinations(range(links), INPUTS))
    mixed = [(one, other) for one in range(links) for other in range(links, count)]
    groups: list[tuple[int, Sequence[tuple[int, ...]]]] = [(number, [()]) for number in memories("nothing")]
    for sets in ([(one,) for one in range(count)], [*pairs, *mixed], threes):
        groups += [(NOW, sets), (UNRELIABLE, sets)]
    groups += [(number, sets) for sets in (single, pairs) for number in late]
    groups += [(number, single) for number in memories("odd", "since")]
    groups += [(number, pairs) for number in memories("last")]
    every = [(number, one) for number, sets in groups for one in sets]
    told, memory = np.zeros((len(every), count), bool), np.array([number for number, _ in every])
    places, weights = np.full((len(every), INPUTS), -1), np.zeros((len(every), INPUTS), int)
    for row, (number, inputs) in enumerate(every):
        told[row, inputs] = True
        places[row, : len(inputs)] = _columns(REMEMBERED[number], inputs, links, count)
        last = REMEMBERED[number].what == "last"
        weights[row, : len(inputs)] = (1, -1) if last else STATES ** np.arange(len(inputs))
    reads = np.array(np.nonzero(told))
    own = np.array([REMEMBERED[number].own for number in memory])
    since, of_last = (np.flatnonzero(np.isin(memory, which)) for which in (SINCE, memories("last")))
    return Layout(told, memory, own, reads, *_fewer(told, memory, reads), places, weights, since, of_last)


def _columns(memory: Memory, inputs: Sequence[int], links: int, count: int) -> list[int]:
    """The columns of `_memories` that an explanation reads, one for each of its inputs."""
    if not memory.ways:
        return [memory.delay * count + one for one in inputs]
    odd = len(WAYS) * (memory.what == "odd")
    return [DELAYS * count + (way + odd) * links + one for way, one in zip(memory.ways, inputs, strict=True)]


def _fewer(told: np.ndarray, memory: np.ndarray, reads: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`fewer`, `parts` and `signs` of `Explanations`; what no other one remembers, as presses, leaves nothing."""
    place = {(one, *np.flatnonzero(row)): number for number, (one, row) in enumerate(zip(memory, told, strict=True))}
    nothing = {REMEMBERED[number].own: place[number,] for number in memories("nothing")}

    def without(number: int, left_out: Sequence[int]) -> int:
        rest = [one for one in np.flatnonzero(told[number]) if one not in left_out]
        none = nothing[REMEMBERED[memory[number]].own]
        return place.get((memory[number], *rest), none) if rest else none

    parts, signs = np.zeros((2, len(told), 2**INPUTS), int)
    for number, row in enumerate(told):
        inputs = np.flatnonzero(row).tolist()
        some = [left_out for count in range(len(inputs) + 1) for left_out in combinations(inputs, count)]
        if REMEMBERED[memory[number]].what == "last":
            some = [(), tuple(inputs[:1])]  # with one press of the two there is nothing to compare
        parts[number, : len(some)] = [without(number, left_out) for left_out in some]
        signs[number, : len(some)] = [(-1) ** len(left_out) for left_out in some]
    return np.array([without(number, [one]) for number, one in reads.T], int), parts, signs


BYTES, OF_RESPONDER = 28, 4
"""That are taken for each explanation and each pair of moments, and so many more for each responder: measured, at most,
on boards of 3 to 16 links."""


def explanations_of(trace: Trace) -> Explanations:
    """All explanations of a board, with their contexts.

    Raises:
        BusybotError: weighing them would take more than half of the memory that this process may have.
    """
    (moments, links), responders = trace.links.shape, trace.responders.shape[1]
    known = layout(links, responders)
    asked, most = (BYTES + OF_RESPONDER * responders) * len(known.own) * moments**2, memory_limit() // 2
    if asked > most:
        board = f"{moments - 1} actions on a board of {links} links that moved and {responders} responders"
        what = f"to weigh {len(known.own):,} explanations of each responder takes {asked / 2**30:,.1f} GiB"
        raise BusybotError(
            f"{board}: {what}, more than {most / 2**30:.1f}, half of what there is",
            "record fewer actions, or smaller boards; `--reasoner event` knows triggers instead of links",
        )
    sizes = np.array([*trace.sizes, *np.maximum(trace.responders.max(0) + 1, 2)], int)
    met = np.where(known.inputs, sizes, 1).prod(1)
    met = np.where(np.isin(known.memory, memories("odd", "last")), 2, met)
    met = np.where(np.isin(known.memory, SINCE), LONGEST + 1, met)
    return Explanations(
        known.inputs, known.memory, contexts_of(trace), known.own, known.reads, known.fewer, known.parts, known.signs,
        met,
    )  # fmt: skip


def contexts_of(trace: Trace, moments: int | None = None) -> np.ndarray:
    """Contexts of all explanations, as of `Explanations`, at all moments or the last so many, int (moments, H)."""
    known = layout(trace.links.shape[1], trace.responders.shape[1])
    memories = _memories(trace)[-(moments or len(trace.links)) :]
    contexts = (memories[:, known.places] * known.weights).sum(-1)
    contexts[:, known.since] = contexts[:, known.since].clip(max=LONGEST)
    contexts[:, known.last] = np.sign(contexts[:, known.last])
    return np.asarray(contexts)


def followed(
    trace: Trace, found: Explanations, contexts: np.ndarray, before: np.ndarray, of: np.ndarray | None = None
) -> np.ndarray:
    """How often each state followed what was the same, float (R, H, STATES).

    Args:
        contexts: int (H,) or (R, H), after an action; what `own` adds is left out.
        before: int (R,), the responders' states before it.
        of: bool (R, T + 1), the moments that count; all by default.
    """
    shown = trace.responders
    earlier = np.concatenate([shown[:1], shown[:-1]])
    equal = (contexts[..., None] == found.contexts.T).astype(float)  # (H, T + 1) or (R, H, T + 1)
    states = np.eye(STATES)[shown.T] * (1 if of is None else of[..., None])  # (R, T + 1, S)
    alike = states * (earlier == before).T[..., None]
    return np.where(found.own[:, None], equal @ alike, equal @ states)


def _attempts() -> np.ndarray:
    equal = np.eye(STATES, dtype=bool)
    stays, arrives, is_there = equal[:, :, None], equal[None], equal[:, None]
    going = np.where(arrives, LUCK, np.where(stays, 1 - LUCK, MISTAKE))
    return np.log(np.where(is_there, np.where(stays, 1 - MISTAKE, MISTAKE), going))


ATTEMPTS = _attempts()
"""About the log probability of a state, of what may fail, float (before, after, goal)."""
RESTED = np.log(np.where(np.eye(STATES, dtype=bool), 1 - MISTAKE, MISTAKE))
"""The same of what has rested for long, (state, goal)."""


def attempts(shown: np.ndarray) -> np.ndarray:
    """How well each state agrees with being where a responder was to go at each moment, if that may fail and leaves
    all as it was then: log probability of what it showed, float (..., M, STATES).

    Args:
        shown: int (..., M), from the new board on, which has rested for long.
    """
    later = ATTEMPTS[shown[..., :-1], shown[..., 1:]]
    return np.concatenate([RESTED[shown[..., :1]], later], axis=-2)


def goals(
    trace: Trace, found: Explanations, contexts: np.ndarray, of: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Where what may fail is to go: of the explanations that say so, U of them.

    Args:
        contexts, of: as of `followed`.

    Returns:
        float (R, U, STATES), how probable each state is; bool (R, U), whether the context was met.
    """
    of_luck = found.memory == UNRELIABLE
    equal = contexts[..., of_luck, None] == found.contexts.T[of_luck]  # (U, T + 1) or (R, U, T + 1)
    if of is not None:
        equal = equal & of[:, None]
    logs = equal.astype(float) @ attempts(trace.responders.T)
    logs = np.where(np.arange(STATES) <= np.maximum(trace.responders.max(0), 1)[:, None, None], logs, -np.inf)
    shares = np.exp(logs - logs.max(-1, keepdims=True))
    return shares / shares.sum(-1, keepdims=True), np.broadcast_to(equal.any(-1), shares.shape[:-1])


def _memories(trace: Trace) -> np.ndarray:
    """What may be remembered, int (T + 1, DELAYS I + 4 L + 1): for each delay the links after, and the responders
    before, the action that was so many actions ago; for each of `WAYS` since when each link was pressed; and whether an
    odd number of times; zeros. Before the first action everything has rested for long."""
    responders = np.concatenate([trace.responders[:1], trace.responders[:-1]])
    rows = np.concatenate([trace.links, responders], axis=1)
    steps = np.arange(len(rows))
    late = [rows[np.maximum(steps - delay, 0)] for delay in range(DELAYS)]
    since, odd = _presses(trace)
    return np.concatenate([*late, *since, *odd, np.zeros((len(rows), 1), int)], axis=1)


def _presses(trace: Trace) -> tuple[np.ndarray, np.ndarray]:
    """int (2, T + 1, L), of `WAYS`: actions since each link was pressed, `LONGEST` more than there were if it never
    was; and whether that happened an odd number of times."""
    ends = np.stack([np.array(trace.sizes) - 1, np.zeros(len(trace.sizes), int)])
    pressed = np.zeros((len(WAYS), *trace.links.shape), bool)
    pressed[:, 1:] = (trace.links[1:] != trace.links[:-1]) & (trace.links[1:] == ends[:, None])
    steps = np.arange(len(trace.links))[:, None]
    latest = np.maximum.accumulate(np.where(pressed, steps, -LONGEST - 1), axis=1)
    since = np.where(latest < 0, len(steps) + LONGEST, steps - latest)
    return since, np.cumsum(pressed, axis=1) % 2
