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
from itertools import combinations

import numpy as np

STATES = 3
"""A responder has so many at most; so has a link."""
DELAYS = 4
"""Inputs are remembered for up to so many actions, less one."""
LONGEST = 5
"""A press so many actions ago is long ago."""
INPUTS = 3
"""An explanation has so many inputs at most."""
WAYS = ("up", "down")
MEMORIES = (
    "none", "own", *(f"late {late}" for late in range(DELAYS)), "own and now",
    *(f"{what} {way}" for what in ("odd presses", "since press") for way in WAYS),
    *(f"last press {one}, {two}" for one in WAYS for two in WAYS),
)  # fmt: skip
"""What explanations remember. `own` is the responder's state before the action, which is what luck leaves in place. A
link is pressed up when it comes to rest in its highest state, down in its lowest: pictures do not tell which is on."""
_OF_PRESSES = [number for number, name in enumerate(MEMORIES) if name.startswith(("odd", "last"))]
_SINCE = [number for number, name in enumerate(MEMORIES) if name.startswith("since")]
SURE, UNSURE = 0.03, 0.4
"""Pseudo-counts of the estimators: of what is determined, and of what has a luck of its own."""


@dataclass(frozen=True)
class Trace:
    """States on a new board and after each of T actions; L links, R responders.

    Attributes:
        links: int (T + 1, L).
        responders: int (T + 1, R).
        sizes: number of states of each link.
    """

    links: np.ndarray
    responders: np.ndarray
    sizes: tuple[int, ...]

    def first(self, actions: int) -> "Trace":
        """What was known after so many actions."""
        return Trace(self.links[: actions + 1], self.responders[: actions + 1], self.sizes)

    def longer(self, links: np.ndarray | Sequence[int], responders: np.ndarray) -> "Trace":
        """After one more action, which left links and responders so."""
        return Trace(np.vstack([self.links, links]), np.vstack([self.responders, responders]), self.sizes)


@dataclass(frozen=True)
class Explanations:
    """H of them, on a board with I = L + R inputs: links, then responders.

    Attributes:
        inputs: bool (H, I).
        memory: int (H,), which of `MEMORIES`.
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
class _Group:
    """Explanations that remember the same, of equally many inputs: int (n, inputs), numbers of the inputs of each."""

    memory: str
    sets: np.ndarray


@dataclass(frozen=True)
class Layout:
    """All explanations of boards with so many links and responders, group by group."""

    groups: tuple[_Group, ...]
    inputs: np.ndarray
    memory: np.ndarray
    own: np.ndarray
    reads: np.ndarray
    fewer: np.ndarray
    parts: np.ndarray
    signs: np.ndarray


@lru_cache(maxsize=64)
def layout(links: int, responders: int) -> Layout:
    """Up to two inputs of which at most one is a responder, and up to three links; only links have a longer past."""
    count, late = links + responders, [f"late {delay}" for delay in range(1, DELAYS)]
    single = [(one,) for one in range(links)]
    pairs, threes = list(combinations(range(links), 2)), list(combinations(range(links), INPUTS))
    mixed = [(one, other) for one in range(links) for other in range(links, count)]
    groups = [_group("none", [()]), _group("own", [()])]
    for sets in ([(one,) for one in range(count)], [*pairs, *mixed], threes):
        groups += [_group("late 0", sets), _group("own and now", sets)]
    groups += [_group(memory, sets) for sets in (single, pairs) for memory in late]
    groups += [_group(f"{what} {way}", single) for what in ("odd presses", "since press") for way in WAYS]
    groups += [_group(f"last press {one}, {two}", pairs) for one in WAYS for two in WAYS]
    groups = [group for group in groups if len(group.sets)]
    told = np.zeros((sum(len(group.sets) for group in groups), count), bool)
    for row, inputs in zip(told, (one for group in groups for one in group.sets), strict=True):
        row[inputs] = True
    names = [group.memory for group in groups for _ in group.sets]
    memory = np.array([MEMORIES.index(name) for name in names])
    reads = np.array(np.nonzero(told))
    own = np.array([name.startswith("own") for name in names])
    return Layout(tuple(groups), told, memory, own, reads, *_fewer(told, names, reads))


def _fewer(told: np.ndarray, names: Sequence[str], reads: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`fewer`, `parts` and `signs` of `Explanations`; what no other one remembers, as presses, leaves nothing."""
    place = {(name, *np.flatnonzero(row)): number for number, (name, row) in enumerate(zip(names, told, strict=True))}

    def without(number: int, left_out: Sequence[int]) -> int:
        rest = [one for one in np.flatnonzero(told[number]) if one not in left_out]
        nothing = place["own" if names[number].startswith("own") else "none",]
        return place.get((names[number], *rest), nothing) if rest else nothing

    parts, signs = np.zeros((2, len(told), 2**INPUTS), int)
    for number, row in enumerate(told):
        inputs = np.flatnonzero(row).tolist()
        some = [left_out for count in range(len(inputs) + 1) for left_out in combinations(inputs, count)]
        if names[number].startswith("last"):
            some = [(), tuple(inputs[:1])]  # with one press of the two there is nothing to compare
        parts[number, : len(some)] = [without(number, left_out) for left_out in some]
        signs[number, : len(some)] = [(-1) ** len(left_out) for left_out in some]
    return np.array([without(number, [one]) for number, one in reads.T], int), parts, signs


def _group(memory: str, sets: Sequence[tuple[int, ...]]) -> _Group:
    return _Group(memory, np.array(sets, int).reshape(len(sets), -1) if sets else np.zeros((0, 0), int))


def explanations_of(trace: Trace) -> Explanations:
    """All explanations of a board, with their contexts."""
    known, late = layout(trace.links.shape[1], trace.responders.shape[1]), _late_inputs(trace)
    since, odd = _presses(trace)  # each int (2, T + 1, L), up and down
    found = []
    for group in known.groups:
        what, *rest = group.memory.replace(",", "").split()
        if what == "odd":
            found.append(odd[WAYS.index(rest[-1])][:, group.sets[:, 0]])
        elif what == "since":
            found.append(since[WAYS.index(rest[-1])][:, group.sets[:, 0]].clip(max=LONGEST))
        elif what == "last":
            one, two = (since[WAYS.index(way)][:, group.sets[:, k]] for k, way in enumerate(rest[-2:]))
            found.append(np.sign(one - two))
        else:
            found.append(_joint(late[int(rest[0]) if what == "late" else 0][:, group.sets]))
    contexts = np.concatenate(found, axis=1)
    sizes = np.array([*trace.sizes, *np.maximum(trace.responders.max(0) + 1, 2)])
    met = np.where(known.inputs, sizes, 1).prod(1)
    met = np.where(np.isin(known.memory, _OF_PRESSES), 2, met)
    met = np.where(np.isin(known.memory, _SINCE), LONGEST + 1, met)
    return Explanations(
        known.inputs, known.memory, contexts, known.own, known.reads, known.fewer, known.parts, known.signs, met
    )


def followed(trace: Trace, found: Explanations, contexts: np.ndarray, before: np.ndarray) -> np.ndarray:
    """How often each state followed what was the same, float (R, H, STATES).

    Args:
        contexts: int (H,) or (R, H), after an action; what `own` adds is left out.
        before: int (R,), the responders' states before it.
    """
    shown = trace.responders
    earlier = np.concatenate([shown[:1], shown[:-1]])
    each = np.broadcast_to(contexts, (shown.shape[1], len(found.own)))
    equal = (found.contexts[:, None] == each).astype(float)  # (T + 1, R, H)
    states = np.eye(STATES)[shown]  # (T + 1, R, S)
    alike = states * (earlier == before)[..., None]
    counts = [np.einsum("trh,trs->rhs", equal, each) for each in (alike, states)]
    return np.where(found.own[None, :, None], *counts)


def _late_inputs(trace: Trace) -> list[np.ndarray]:
    """For each delay, int (T + 1, I): links after, and responders before, the action that was so many actions ago.

    Before the first action everything has rested for long.
    """
    responders = np.concatenate([trace.responders[:1], trace.responders[:-1]])
    rows = np.concatenate([trace.links, responders], axis=1)
    steps = np.arange(len(rows))
    return [rows[np.maximum(steps - delay, 0)] for delay in range(DELAYS)]


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


def _joint(states: np.ndarray) -> np.ndarray:
    """One number for each of the last rows of states (..., n)."""
    return np.asarray(states @ (STATES ** np.arange(states.shape[-1])))
