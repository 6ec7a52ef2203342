"""Spaces of hypotheses about what decides a responder, for evaluators only: `upper_bound` observes in them.

A hypothesis is a mechanism of `boards.mechanisms` with its inputs, so that the observer and the board cannot disagree
on what a mechanism does. The space of a world holds what `boards.worlds` can draw there, each with the probability that
it is drawn. What depends on a board's other responders is left out of these probabilities: that every link has
something to do (and is drawn more often as long as it has nothing), and that only what has a luck of its own is
followed. Where each responder follows one link or none it is not left out (`wirings`).

Probabilities that mechanisms draw from an interval (how often a lamp fails) stand at `LEVELS` places in it.

Nothing that infers, predicts, explores or plans may import this module.
"""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import combinations, permutations, product
from typing import Any, ClassVar, TypeVar, cast

import numpy as np

from busybot.boards.mechanisms import Mechanism, known_kind
from busybot.boards.mechanisms.base import Inputs
from busybot.boards.mechanisms.delay import Delay
from busybot.boards.mechanisms.direct import OneToOne
from busybot.boards.mechanisms.latch import Latch
from busybot.boards.mechanisms.rest import Rest
from busybot.boards.real_board import WIRINGS
from busybot.boards.relations import STEP_OF_STATE
from busybot.boards.spec import PAPER, BoardSpec
from busybot.boards.worlds import BUILT, CLOCKED, DIRECT, INERT, NOVEL, REAL_BOARD, REWIRED_AT, World, world_named
from busybot.common.errors import BusybotError
from busybot.reason.evaluation.wirings import Drawn, Listed, Wiring

LEVELS = 5
"""A probability that is drawn from an interval is taken for one of so many in it."""
NOTHING, CLOCK, UNRELIABLE = Rest.kind, "clock", "unreliable"
MOST_REMEMBERED = 1024
"""Of a mechanism that may remember more than so many different things nobody lists what it does; built-in ones have
some dozens."""
DRAWN_BY = "draw by `integers`, `choice`, `uniform`, or a comparison of `random()`"
STEPS = tuple(range(REWIRED_AT[0], REWIRED_AT[1] + 1))
"""Numbers of the actions after which a rewiring may show first."""
Result = TypeVar("Result")
Stages = tuple[bool, bool]
"""Whether a responder can have two states, and whether three."""


class Tabled(OneToOne):
    """A responder that shows any function of two links, also one that no gate computes."""

    kind: ClassVar[str] = "table"
    arity: ClassVar[tuple[int, int]] = (2, 2)


@dataclass(frozen=True)
class Hypothesis:
    """A mechanism and its inputs.

    Attributes:
        inputs: numbers among the board's inputs: trigger links in their order, then responders in theirs.
    """

    mechanism: Mechanism
    inputs: tuple[int, ...]

    @property
    def kind(self) -> str:
        """The paper's three kinds of following one link are one."""
        kind = self.mechanism.kind
        return DIRECT if kind.startswith("one-to-many") else kind

    @cached_property
    def meaning(self) -> tuple[Any, ...]:
        """Equal for hypotheses that respond equally to everything that can be done, whatever they are called.

        Exact for luck of equal names: how probable it is does not count, what it does counts.
        """
        order = tuple(sorted(range(len(self.inputs)), key=self.inputs.__getitem__))
        return tuple(sorted(self.inputs)), *_meaning(self.mechanism, order)


class Branches:
    """Stands for a generator of luck, and takes the first of all ways but where it is told another one."""

    def __init__(self, path: Sequence[int]):
        self.path, self.weight = path, 1.0
        self.taken: list[int] = []
        self.ways: list[int] = []

    def pick(self, weights: Sequence[float]) -> int:
        number = len(self.taken)
        way = self.path[number] if number < len(self.path) else 0
        self.taken.append(way)
        self.ways.append(len(weights))
        self.weight *= weights[way] / sum(weights)
        return way

    def integers(self, low: int, high: int | None = None, endpoint: bool = False) -> int:
        first, last = (0, low) if high is None else (low, high)
        return first + self.pick([1.0] * (last - first + endpoint))

    def choice(self, values: Sequence[Any]) -> Any:
        return values[self.pick([1.0] * len(values))]

    def uniform(self, low: float, high: float) -> float:
        return low + (high - low) * (self.pick([1.0] * LEVELS) + 0.5) / LEVELS

    def random(self) -> "_Throw":
        return _Throw(self)

    def __getattr__(self, name: str) -> Any:
        raise BusybotError(f"a mechanism draws by `{name}`, whose results nobody can list", DRAWN_BY)


@dataclass
class _Throw:
    """A number from 0 to 1 that is known when it is compared with another one, once."""

    branches: Branches

    def __lt__(self, other: float) -> bool:
        return self.branches.pick([other, 1 - other]) == 0

    __le__ = __lt__

    def __ge__(self, other: float) -> bool:
        return not self < other

    __gt__ = __ge__

    def _unlisted(self, *_: object) -> Any:
        raise BusybotError("a mechanism calculates with luck, whose results nobody can list", DRAWN_BY)

    __float__ = __int__ = __mul__ = __rmul__ = __add__ = __radd__ = __sub__ = __rsub__ = __truediv__ = _unlisted


def outcomes(draw: Callable[[np.random.Generator], Result]) -> list[tuple[float, Result]]:
    """All results of a function that draws, in a fixed order, each with its probability; equal ones are not merged.

    Raises:
        BusybotError: it draws by something else than `integers`, `choice`, `uniform` and comparisons of `random()`.
    """
    return [(weight, result) for _, weight, result in paths(draw)]


def paths(draw: Callable[[np.random.Generator], Result]) -> list[tuple[tuple[int, ...], float, Result]]:
    """As `outcomes`, each with what was drawn on the way there, as `Branches` takes it."""
    found: list[tuple[tuple[int, ...], float, Result]] = []
    waiting: list[tuple[int, ...]] = [()]
    while waiting:
        path = waiting.pop()
        branches = Branches(path)
        result = draw(cast(np.random.Generator, branches))
        found.append((tuple(branches.taken), branches.weight, result))
        for depth in range(len(path), len(branches.taken)):
            waiting += [(*branches.taken[:depth], way) for way in range(1, branches.ways[depth])]
    return sorted((one for one in found if one[1] > 0), key=lambda one: one[0])


@dataclass(frozen=True, eq=False)
class Machine:
    """A mechanism as tables. X combinations of inputs, the last fastest; M numbered memories; O outcomes of luck.

    Attributes:
        sizes: number of states of each input.
        start_shown, start_memory: int (X,), on a new board.
        shown, memory: int (X, M, O), after an action that left the inputs so, from each memory.
        luck: float (X, M, O), probability of each outcome.
    """

    sizes: tuple[int, ...]
    start_shown: np.ndarray
    start_memory: np.ndarray
    shown: np.ndarray
    memory: np.ndarray
    luck: np.ndarray


@lru_cache(maxsize=4096)
def machine_of(mechanism: Mechanism) -> Machine:
    """The tables of a mechanism, by asking it for everything that it may do.

    Raises:
        BusybotError: it draws what nobody can list, or remembers more than `MOST_REMEMBERED` different things.
    """
    combinations_ = list(product(*(range(size) for size in mechanism.sizes)))
    starts = [mechanism.start(inputs) for inputs in combinations_]
    numbers = {memory: number for number, memory in enumerate(dict.fromkeys(memory for _, memory in starts))}
    steps: dict[tuple[int, int], list[tuple[float, tuple[int, int]]]] = {}
    waiting = list(numbers)
    while waiting:
        if len(numbers) > MOST_REMEMBERED:
            what = (
                f"a mechanism of the kind {mechanism.kind!r} may remember more than {MOST_REMEMBERED} different things"
            )
            raise BusybotError(f"{what}, which nobody can list", "let counts end somewhere")
        memory = waiting.pop(0)
        for row, inputs in enumerate(combinations_):
            told = []
            for weight, (shown, after) in _lucky(mechanism, inputs, memory):
                if after not in numbers:
                    numbers[after] = len(numbers)
                    waiting.append(after)
                told.append((weight, (shown, numbers[after])))
            steps[row, numbers[memory]] = told
    ways = max(len(told) for told in steps.values())
    shape = (len(combinations_), len(numbers), ways)
    shown, memory_after, luck = np.zeros(shape, int), np.zeros(shape, int), np.zeros(shape)
    for (row, number), told in steps.items():
        for way in range(ways):
            weight, (state, after_number) = told[min(way, len(told) - 1)]
            shown[row, number, way], memory_after[row, number, way] = state, after_number
            luck[row, number, way] = weight if way < len(told) else 0
    first = np.array([shown_ for shown_, _ in starts]), np.array([numbers[memory] for _, memory in starts])
    return Machine(mechanism.sizes, *first, shown, memory_after, luck)


def _lucky(mechanism: Mechanism, inputs: Inputs, memory: tuple[int, ...]) -> list[tuple[float, Any]]:
    if not mechanism.draws:
        return [(1.0, mechanism.step(inputs, memory, None))]
    return outcomes(lambda chance: mechanism.step(inputs, memory, chance))


@lru_cache(maxsize=16384)
def _meaning(mechanism: Mechanism, order: tuple[int, ...]) -> tuple[Any, ...]:
    """The smallest machine that answers alike, its inputs in this order: equal for mechanisms that respond equally.

    States are pairs of the inputs' last states and a memory, and those that no sequence of actions tells apart are one.
    An action moves one input by one state (a responder with more than two may skip one; no mechanism reads such).
    """
    machine = machine_of(mechanism)
    sizes = tuple(mechanism.sizes[place] for place in order)
    rows = np.arange(int(np.prod(sizes, dtype=int))).reshape([mechanism.sizes[i] for i in range(len(order))])
    rows = rows.transpose(order).ravel()  # of the machine, for combinations of the ordered inputs
    # deterministic ones answer every luck alike
    ways = max(2, machine.shown.shape[2])
    way = np.minimum(np.arange(ways), machine.shown.shape[2] - 1)
    shown, memory = machine.shown[rows][..., way], machine.memory[rows][..., way]
    near = _near(sizes)
    label = _told_apart(near, shown, memory)
    return sizes, _digest(near, machine.start_shown[rows], machine.start_memory[rows], shown, memory, label)


def _near(sizes: tuple[int, ...]) -> np.ndarray:
    """bool (X, X): combinations of inputs that one action can lead to from each."""
    states = np.array(list(product(*(range(size) for size in sizes)))).reshape(
        int(np.prod(sizes, dtype=int)), len(sizes)
    )
    return np.asarray(np.abs(states[:, None] - states[None]).sum(2) <= 1)


def _told_apart(near: np.ndarray, shown: np.ndarray, memory: np.ndarray) -> np.ndarray:
    """int (X, M): pairs of last inputs and memory with equal numbers answer alike from then on."""
    inputs, memories, _ = shown.shape
    label = np.repeat(np.arange(inputs), memories).reshape(inputs, memories)
    there = near[:, None, :, None]
    answer = np.where(there, shown.transpose(1, 0, 2)[None], -1).reshape(inputs * memories, -1)
    after = np.arange(inputs)[:, None, None]
    while True:
        following = np.where(there, label[after, memory].transpose(1, 0, 2)[None], -1).reshape(inputs * memories, -1)
        rows = np.concatenate([label.reshape(-1, 1), answer, following], axis=1)
        finer = np.unique(rows, axis=0, return_inverse=True)[1].reshape(inputs, memories)
        if finer.max() == label.max():
            return label
        label = finer


def _digest(
    near: np.ndarray,
    start_shown: np.ndarray,
    start_memory: np.ndarray,
    shown: np.ndarray,
    memory: np.ndarray,
    label: np.ndarray,
) -> bytes:
    """SHA-256 of the machine with its states numbered in the order in which they are come upon."""
    numbers: dict[int, int] = {}
    waiting: list[tuple[int, int]] = []

    def number(inputs: int, remembered: int) -> int:
        name = int(label[inputs, remembered])
        if name not in numbers:
            numbers[name] = len(numbers)
            waiting.append((inputs, remembered))
        return numbers[name]

    told: list[int] = []
    for inputs, remembered in enumerate(start_memory.tolist()):
        told += [int(start_shown[inputs]), number(inputs, remembered)]
    while waiting:
        inputs, remembered = waiting.pop(0)
        for after in np.flatnonzero(near[inputs]).tolist():
            for way in range(shown.shape[2]):
                told += [int(shown[after, remembered, way]), number(after, int(memory[after, remembered, way]))]
    return hashlib.sha256(np.array(told).tobytes()).digest()


@dataclass(frozen=True)
class Clocks:
    """What is known beforehand of hidden clocks.

    Attributes:
        share: probability that a board has one.
        sets: groups of responders that it may move, all equally probable within their size.
        prior: float (H, N), of the hypotheses on a responder that it moves.
    """

    share: float
    sets: tuple[tuple[int, ...], ...]
    prior: np.ndarray


@dataclass(frozen=True, eq=False)
class Space:
    """What might decide each of R responders that L links and other responders may move. H hypotheses.

    Attributes:
        sizes: number of states of each link.
        hypotheses: those without luck first.
        prior: float (H, R), of each alone, on a responder that no clock moves and that keeps its mechanism.
        stages: int (H,), number of states of the responder.
        driven: float (H, R), of those that may be rewired, or come of it.
        orders: int (H,), in how many ways a board may write it down, as the order of links in a gate: each is
            equally probable, and what is written differently is another mechanism for who draws a rewiring.
        clocks: None if there are none.
        rewired: share of boards on which one responder's mechanism changes, after one of `STEPS`.
        wiring: what assigns links to responders, where the hypotheses are, one for each link, that it is followed, and
            last that none is; None if each responder has causes of its own.
    """

    sizes: tuple[int, ...]
    hypotheses: tuple[Hypothesis, ...]
    prior: np.ndarray
    stages: np.ndarray
    driven: np.ndarray
    orders: np.ndarray
    clocks: Clocks | None = None
    rewired: float = 0.0
    wiring: Wiring | None = None

    @property
    def responders(self) -> int:
        return self.prior.shape[1]

    @cached_property
    def parents(self) -> np.ndarray:
        """bool (H, L + R), the inputs of each hypothesis."""
        found = np.zeros((len(self.hypotheses), len(self.sizes) + self.responders), bool)
        for row, one in zip(found, self.hypotheses, strict=True):
            row[list(one.inputs)] = True
        return found

    @cached_property
    def meanings(self) -> np.ndarray:
        """int (H,), equal for hypotheses that respond equally."""
        return np.array([self._codes[one.meaning] for one in self.hypotheses])

    @cached_property
    def parent_sets(self) -> tuple[np.ndarray, list[tuple[int, ...]]]:
        """int (H,), the number of each hypothesis's set of inputs, and these sets."""
        sets = [tuple(sorted(one.inputs)) for one in self.hypotheses]
        different = list(dict.fromkeys(sets))
        numbers = {one: number for number, one in enumerate(different)}
        return np.array([numbers[one] for one in sets]), different

    @cached_property
    def lags(self) -> np.ndarray:
        """int (H,), after how many actions an input shows at the earliest; -1 for those without inputs."""
        return np.array([lag_of(one, len(self.sizes)) for one in self.hypotheses])

    def meaning_of(self, hypothesis: Hypothesis) -> int:
        """The number in `meanings` of what responds like this, -1 if nothing here does, or nobody can tell."""
        try:
            return self._codes.get(hypothesis.meaning, -1)
        except BusybotError:  # nobody can list it, and all that is here is listed
            return -1

    @cached_property
    def _codes(self) -> dict[tuple[Any, ...], int]:
        different = dict.fromkeys(one.meaning for one in self.hypotheses)
        return {meaning: number for number, meaning in enumerate(different)}

    @cached_property
    def sure(self) -> int:
        """Number of hypotheses without luck, the first ones."""
        return sum(not one.mechanism.draws for one in self.hypotheses)


def lag_of(hypothesis: Hypothesis, links: int) -> int:
    """After how many actions an input shows at the earliest, -1 without inputs; responders are read late by one."""
    if not hypothesis.inputs:
        return -1
    return hypothesis.mechanism.lag + any(place >= links for place in hypothesis.inputs)


Weighted = dict[tuple[Any, ...], tuple[float, Hypothesis, int, set[tuple[tuple[int, ...], tuple[int, ...]]]]]
"""Weight, hypothesis, number of the responder's states and how it may be written down, by what makes hypotheses the
same."""


class _Collected:
    """Hypotheses that are gathered one by one, equal ones once."""

    def __init__(self) -> None:
        self.found: Weighted = {}

    def add(self, weight: float, hypothesis: Hypothesis, stages: int) -> None:
        mechanism, inputs = hypothesis.mechanism, hypothesis.inputs
        luck = _luck(mechanism) if mechanism.draws else ()
        key = (stages, mechanism.kind, luck, hypothesis.meaning)
        before, first, _, written = self.found.get(key, (0.0, hypothesis, 0, set()))
        self.found[key] = (before + weight, first, stages, written | {(inputs, mechanism.table)})


@lru_cache(maxsize=4096)
def _luck(mechanism: Mechanism) -> tuple[Any, ...]:
    return tuple(mechanism.parameters().values())


@lru_cache(maxsize=256)
def space_of(world: str, novel: bool, sizes: tuple[int, ...], stages: tuple[Stages, ...]) -> Space:
    """What the boards of a world may have, as `boards.worlds` draws it.

    Args:
        world: its name, or the name of a mechanism; not the paper's, nor one of `boards.worlds.BUILT`.
        novel: whether they are of the split `novel-mechanism`.
        sizes: number of states of each trigger link.
        stages: of each responder, what it can be.

    Raises:
        BusybotError: there is no such world, or one of its mechanisms draws, or remembers, what nobody can list.
    """
    law = world_named(world, novel)
    single = [number for number, (two, _) in enumerate(stages) if two]
    of_links = {able: _driven(law, novel, sizes, able).found for able in set(stages)}
    driven = [of_links[able] for able in stages]
    resting = {able: _resting(of_links[able], able) for able in of_links}
    alone: dict[Any, Weighted] = {}  # responders that can be the same and read the same have the same column
    columns = []
    for number, able in enumerate(stages):
        sources = tuple(other for other in single if other != number) if law.follows and able[0] else ()
        if (able, sources) not in alone:
            alone[able, sources] = _alone(law, novel, sizes, able, of_links[able], resting[able], sources)
        columns.append(alone[able, sources])
    clocked: Weighted = {}
    if law.clock and len(single) > CLOCKED[1]:
        clocked = _drawn(CLOCK, (), (), 2, novel).found
    space = _table([*columns, *driven, clocked])
    count = len(stages)
    prior, of_clock = space.prior[:, :count], space.prior[:, -1:]
    clocks = None
    if clocked:
        sets = [one for size in range(CLOCKED[0], CLOCKED[1] + 1) for one in combinations(single, size)]
        clocks = Clocks(law.clock, tuple(sets), np.repeat(of_clock, count, axis=1))
    of_links_alone = space.prior[:, count:-1]
    return Space(sizes, space.hypotheses, prior, space.stages, of_links_alone, space.orders, clocks, law.rewired)


@dataclass(frozen=True)
class _Columns:
    hypotheses: tuple[Hypothesis, ...]
    prior: np.ndarray
    stages: np.ndarray
    orders: np.ndarray


def _table(columns: Sequence[Weighted]) -> _Columns:
    """Hypotheses of all columns, and the probability of each in each; a column without any stays 0."""
    every = {key: told[1:] for column in columns for key, told in column.items()}
    keys = sorted(every, key=lambda key: every[key][0].mechanism.draws)
    prior = np.array([[column.get(key, (0.0,))[0] for column in columns] for key in keys])
    prior /= np.maximum(prior.sum(0), np.finfo(float).tiny)
    stages = np.array([every[key][1] for key in keys])
    orders = np.array([len(every[key][2]) for key in keys])
    return _Columns(tuple(every[key][0] for key in keys), prior, stages, orders)


def _alone(
    law: World,
    novel: bool,
    sizes: tuple[int, ...],
    able: Stages,
    driven: Weighted,
    resting: Weighted,
    sources: tuple[int, ...],
) -> Weighted:
    """What may decide a responder that no clock moves: by itself, one of the sources, or what links drive."""
    rest = 1 - INERT
    kinds = [(law.flickers * able[0], _drawn("flicker", (), (), 2, novel).found)] if law.flickers else []
    if law.follows and UNRELIABLE in law.kinds and able[0]:
        kinds.append((law.follows, _following(law, novel, sizes, sources).found))
    kinds.append((1.0, driven))
    found = _Collected()
    for share, column in kinds:
        total = sum(weight for weight, *_ in column.values())
        if total > 0:
            for weight, one, stages, _ in column.values():
                found.add(rest * share * weight / total, one, stages)
            rest *= 1 - share
    total = sum(weight for weight, *_ in resting.values())
    for weight, one, stages, _ in resting.values():
        found.add((INERT + rest) * weight / total, one, stages)
    return found.found


def _resting(driven: Weighted, able: Stages) -> Weighted:
    """What nothing moves: it shows what something that links drive would have shown at first, from any states."""
    found = _Collected()
    rests = {state: Hypothesis(Rest(sizes=(), table=(state,)), ()) for state in range(3)}
    for weight, one, stages, _ in driven.values():
        starts = _starts(one.mechanism)
        for state in starts:
            found.add(weight / len(starts), rests[state], stages)
    for state in () if driven else range(2 if able[0] else 3):
        found.add(1.0, rests[state], 2 if able[0] else 3)
    return found.found


@lru_cache(maxsize=4096)
def _starts(mechanism: Mechanism) -> list[int]:
    """What it shows on a new board, for all combinations of its inputs."""
    return [mechanism.start(states)[0] for states in product(*map(range, mechanism.sizes))]


def _drawn(kind: str, sizes: tuple[int, ...], inputs: tuple[int, ...], stages: int, novel: bool) -> _Collected:
    found = _Collected()
    for weight, mechanism in _outcomes(kind, sizes, stages, novel):
        found.add(weight, Hypothesis(mechanism, inputs), stages)
    return found


@lru_cache(maxsize=1024)
def _outcomes(kind: str, sizes: tuple[int, ...], stages: int, novel: bool) -> list[tuple[float, Mechanism]]:
    """What drawing a mechanism may give."""
    known = known_kind(kind)
    drawn = outcomes(lambda rng: known.draw(sizes, stages, novel, rng))
    return [(weight, mechanism) for weight, mechanism in drawn if mechanism is not None]


def _driven(law: World, novel: bool, sizes: tuple[int, ...], able: Stages) -> _Collected:
    """What links drive."""
    found = _Collected()
    suitable = [states for states, fits in zip((2, 3), able, strict=True) if fits]
    total = sum(law.kinds.values())
    for name, weight in law.kinds.items():
        for share, count in _counts(law, novel, known_kind(name), len(sizes)):
            orders = list(permutations(range(len(sizes)), count))
            for inputs, states in product(orders, suitable):
                each = weight / total * share / len(orders) / len(suitable)
                read = tuple(sizes[place] for place in inputs)
                for likely, mechanism in _outcomes(name, read, states, novel):
                    found.add(each * likely, Hypothesis(mechanism, inputs), states)
    return found


def _counts(law: World, novel: bool, kind: type[Mechanism], links: int) -> Iterator[tuple[float, int]]:
    """How many inputs, with what probability."""
    least, most = kind.arity
    third = 1 / 3 if novel else 0.0
    for share, wanted in ((1 - law.two, 1), (law.two * (1 - third), 2), (law.two * third, 3)):
        if share:
            yield share, min(max(wanted, least), most, links)


def _following(law: World, novel: bool, sizes: tuple[int, ...], sources: tuple[int, ...]) -> _Collected:
    """What reads another responder, alone or with a link."""
    found = _Collected()
    second = 1.0 if novel else law.two
    for source in sources:
        place = len(sizes) + source
        for likely, mechanism in _outcomes(DIRECT, (2,), 2, novel):
            found.add((1 - second) * likely, Hypothesis(mechanism, (place,)), 2)
        for link, size in enumerate(sizes):
            for likely, mechanism in _outcomes("gate", (2, size), 2, novel):
                found.add(second * likely / len(sizes), Hypothesis(mechanism, (place, link)), 2)
    return found


def board_space(
    board: BoardSpec, sizes: tuple[int, ...], stages: Sequence[Stages] | None = None
) -> tuple[Space, list[int]]:
    """The space of a board's world and split, and the indices of the board's responders.

    Args:
        sizes: number of states of each trigger link.
        stages: of each responder, what it can be; None if all that may be known is that links with three states move
            responders with three.

    Raises:
        BusybotError: the board has no responder, or as `space_of`.
    """
    responders = [index for index, placed in enumerate(board.objects) if placed.role == "responder"]
    if not responders:
        raise BusybotError(f"board {board.index} has no responder", "take boards on which something can be decided")
    able = tuple(stages) if stages is not None else ((True, 3 in sizes),) * len(responders)
    if board.world == REAL_BOARD:
        return wired_space(sizes, len(responders), Listed(WIRINGS)), responders
    if board.world in (PAPER, *BUILT):
        idle = {ref.object for ref in board.idle}  # all links of an object are, or none
        owners = [index for index, one in enumerate(board.objects) if one.role == "trigger" for _ in one.states]
        active = tuple(place for place, owner in enumerate(owners) if owner not in idle)
        return wired_space(sizes, len(responders), drawn_wiring(sizes, able, active)), responders
    return space_of(board.world, board.split == NOVEL, sizes, able), responders


@lru_cache(maxsize=256)
def drawn_wiring(sizes: tuple[int, ...], stages: tuple[Stages, ...], active: tuple[int, ...]) -> Drawn:
    """How the paper's boards assign links to responders (`boards.relations`): links with three states choose first.

    Args:
        active: numbers of the links that are not idle.
    """
    places = tuple(sorted(active, key=lambda place: sizes[place] != 3))
    return Drawn(tuple(tuple(able[sizes[place] == 3] for able in stages) for place in places), places)


@lru_cache(maxsize=256)
def wired_space(sizes: tuple[int, ...], responders: int, wiring: Wiring) -> Space:
    """What boards may have whose responders each follow one link, as the paper's do, or rest as they were made."""
    follows = [
        Hypothesis(OneToOne(sizes=(size,), table=STEP_OF_STATE if size == 3 else (0, 1)), (place,))
        for place, size in enumerate(sizes)
    ]
    hypotheses = (*follows, Hypothesis(Rest(sizes=(), table=(0,)), ()))
    prior = wiring.shares(np.ones((len(hypotheses), responders)))
    stages, orders = np.array([*sizes, 2]), np.ones(len(hypotheses), int)
    return Space(sizes, hypotheses, prior, stages, np.zeros_like(prior), orders, wiring=wiring)


@lru_cache(maxsize=16)
def table_space(links: int, responders: int) -> Space:
    """The space of symbolic boards: nothing, one link, two links (the 10 functions that depend on both), both also one
    or two actions late, and latches. One of these six families is as probable as another."""
    family = {name: _Collected() for name in ("nothing", "one", "one late", "two", "two late", "latch")}
    for state in (0, 1):
        family["nothing"].add(1.0, Hypothesis(Rest(sizes=(), table=(state,)), ()), 2)
    for link, table in product(range(links), ((0, 1), (1, 0))):
        family["one"].add(1.0, Hypothesis(OneToOne(sizes=(2,), table=table), (link,)), 2)
        for late in (1, 2):
            family["one late"].add(1.0, Hypothesis(Delay(sizes=(2,), table=table, actions=late), (link,)), 2)
    both = [four for four in product((0, 1), repeat=4) if _depends_on_both(four)]
    for pair, four in product(combinations(range(links), 2), both):
        family["two"].add(1.0, Hypothesis(Tabled(sizes=(2, 2), table=four), pair), 2)
        for late in (1, 2):
            family["two late"].add(1.0, Hypothesis(Delay(sizes=(2, 2), table=four, actions=late), pair), 2)
    for pair, first in product(permutations(range(links), 2), (0, 1)):
        family["latch"].add(1.0, Hypothesis(Latch(sizes=(2, 2), table=(0, 1), first=first), pair), 2)
    every: Weighted = {}
    for collected in family.values():
        each = 1 / len(collected.found)
        every |= {key: (weight * each, *rest) for key, (weight, *rest) in collected.found.items()}
    told = _table([every] * responders)
    return Space((2,) * links, told.hypotheses, told.prior, told.stages, np.zeros_like(told.prior), told.orders)


def _depends_on_both(table: tuple[int, ...]) -> bool:
    first, second = (table[0] != table[2] or table[1] != table[3]), (table[0] != table[1] or table[2] != table[3])
    return first and second
