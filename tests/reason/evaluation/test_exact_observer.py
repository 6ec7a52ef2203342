"""The exact observer against brute force, and the table of what recordings determine at a reduced size."""

import time
from collections.abc import Iterator, Sequence
from itertools import combinations, product
from typing import Any, ClassVar

import numpy as np
import pytest

from benchmarks.studies.bounds import Drawn, Symbolic, play
from busybot.boards.config import BoardConfig
from busybot.boards.dynamics import Dynamics, Links
from busybot.boards.generate import generate_boards
from busybot.boards.mechanisms import Mechanism
from busybot.boards.mechanisms.base import Inputs, Memory
from busybot.boards.spec import BODY, BoardSpec, LinkRef, PlacedObject, Relation, Rewiring
from busybot.boards.worlds import NOVEL, WORLDS
from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.objects.resolve import find
from busybot.reason.evaluation.hypotheses import (
    LEVELS,
    STEPS,
    Hypothesis,
    Space,
    board_space,
    machine_of,
    outcomes,
    space_of,
    table_space,
)
from busybot.reason.evaluation.upper_bound import Belief, Observer, greedy, observe
from tests.boards.mechanisms.strange import Counting

SINGLE, ANY = (True, False), (True, True)
Trace = tuple[np.ndarray, np.ndarray]


# what the observer is compared with: boards that the law of boards moves, with luck that is told


class Told(Dynamics):
    """A board whose luck is told: for each stream whether its chances come true, action by action."""

    def __init__(self, board: BoardSpec, links: Links, luck: dict[str, Sequence[bool]]):
        super().__init__(board, links)
        self.luck, self.asked = luck, {}  # type: tuple[dict[str, Sequence[bool]], dict[tuple[str, int], float]]

    def chance(self, bound: Any, tick: int) -> Any:
        return _Told(self, bound.stream, tick)


class _Told:
    def __init__(self, board: Told, stream: str, tick: int):
        self.board, self.stream, self.tick = board, stream, tick

    def random(self) -> "_Told":
        return self

    def __lt__(self, probability: float) -> bool:
        self.board.asked[self.stream, self.tick] = probability
        return self.board.luck[self.stream][self.tick]


def board_of(space: Space, causes: Sequence[Hypothesis], streams: dict[int, str] | None = None) -> BoardSpec:
    """A board with one switch for each link, on which these hypotheses hold."""
    place = {"position": (0.0, 0.0, 0.0), "yaw": 0.0, "scale": 1.0}
    switches = [PlacedObject(key="Switch/a", role="trigger", states=(0,), **place) for _ in space.sizes]
    lamps = [PlacedObject(key="Lamp/a", role="responder", **place) for _ in causes]
    relations = tuple(
        relation_of(space, number, one, (streams or {}).get(number))
        for number, one in enumerate(causes)
        if one.inputs or one.mechanism.draws or any(one.mechanism.table)
    )
    return BoardSpec(
        index=0, seed=0, split="train", appearance_group=0, texture="wood", color=(1, 1, 1),
        objects=(*switches, *lamps), relations=relations, world="mixed",
    )  # fmt: skip


def relation_of(space: Space, responder: int, one: Hypothesis, stream: str | None = None) -> Relation:
    links = len(space.sizes)
    triggers = [LinkRef(object=place, link="l" if place < links else BODY) for place in one.inputs]
    stage = "multi" if max(one.mechanism.table) > 1 else "single"
    parameters = one.mechanism.parameters() | ({"stream": stream} if stream else {})
    return Relation(
        kind=one.mechanism.kind, triggers=tuple(triggers), responder=links + responder, stage=stage,
        states=one.mechanism.table, parameters=parameters,
    )  # fmt: skip


def links_of(space: Space) -> Links:
    return Links(tuple((number, "l") for number in range(len(space.sizes))), space.sizes)


def walk(sizes: Sequence[int], actions: int, rng: np.random.Generator) -> np.ndarray:
    """States of links, of which each action moves at most one by one state."""
    states = [[int(rng.integers(size)) for size in sizes]]
    for _ in range(actions):
        now = list(states[-1])
        link = int(rng.integers(len(sizes)))
        if rng.random() < 0.9:
            now[link] = min(max(now[link] + int(rng.choice([-1, 1])), 0), sizes[link] - 1)
        states.append(now)
    return np.array(states)


def shown_by(space: Space, board: BoardSpec, triggers: np.ndarray) -> np.ndarray:
    states = Dynamics(board, links_of(space)).run(triggers.tolist())
    return np.array([state.shown for state in states])[:, len(space.sizes) :]


def likelihood(space: Space, responder: int, one: Hypothesis, trace: Trace) -> float:
    """Probability of what a responder showed, by moving a board for every luck that there is.

    What other responders show is put in their place, so that only this one is asked.
    """
    triggers, shown = trace
    actions = len(triggers) - 1
    causes = [Hypothesis(machine_free(), ())] * space.responders
    causes[responder] = one
    board = board_of(space, causes)
    stream = str(len(space.sizes) + responder)
    total = 0.0
    lucky = product((True, False), repeat=actions) if one.mechanism.draws else [(True,) * actions]
    for luck in lucky:
        dynamics = Told(board, links_of(space), {stream: luck})
        fits = explained(dynamics, space, responder, triggers, shown)
        total += fits * (chance_of(dynamics, luck) if one.mechanism.draws else 1.0)
    return total


def machine_free() -> Mechanism:
    return table_space(2, 1).hypotheses[0].mechanism


def explained(dynamics: Dynamics, space: Space, responder: int, triggers: np.ndarray, shown: np.ndarray) -> bool:
    """Whether the responder shows what was seen, when the others showed what they did."""
    first, links = len(space.sizes), triggers.tolist()
    place = first + responder

    def among(state: Any, row: int) -> Any:
        others = [-1] * first + shown[row].tolist()
        others[place] = state.shown[place]
        return type(state)(state.tick, tuple(others), state.memories)

    state = dynamics.start(links[0])
    bound = [one for one in dynamics.bound_at(0) if one.responder == place]
    if bound:  # the new board's other responders are what they were
        now, memory = bound[0].mechanism.start(bound[0].read(links[0], [-1] * first + shown[0].tolist()))
        state = type(state)(0, (*state.shown[:place], now, *state.shown[place + 1 :]), (memory,))
    if state.shown[place] != shown[0, responder]:
        return False
    for row, now_ in enumerate(links[1:]):
        state = dynamics.step(now_, among(state, row))
        if state.shown[place] != shown[row + 1, responder]:
            return False
    return True


def chance_of(dynamics: Told, luck: Sequence[bool]) -> float:
    """Probability of this luck; where nobody asked for it, of half the ways."""
    found = 1.0
    asked = {tick: probability for (_, tick), probability in dynamics.asked.items()}
    for tick, came in enumerate(luck):
        probability = asked.get(tick, 0.5)
        found *= probability if came else 1 - probability
    return found


def drawn_causes(space: Space, rng: np.random.Generator) -> list[Hypothesis]:
    """Of the prior, but for followers of what has no luck of its own: boards have none."""
    links = len(space.sizes)
    while True:
        causes = [space.hypotheses[int(rng.choice(len(column), p=column))] for column in space.prior.T]
        read = [causes[place - links] for one in causes for place in one.inputs if place >= links]
        if all(one.kind == "unreliable" and max(one.mechanism.table) == 1 for one in read):
            return causes


# the spaces


def test_all_ways_of_drawing_are_found_with_their_probabilities() -> None:
    def draw(rng: np.random.Generator) -> tuple[Any, ...]:
        if rng.random() < 0.25:
            return ("rare", int(rng.integers(1, 3)))
        return ("usual", str(rng.choice(["a", "b"])), round(float(rng.uniform(0, 1)), 1))

    found = outcomes(draw)
    assert sum(weight for weight, _ in found) == pytest.approx(1)
    assert len(found) == 2 + 2 * LEVELS
    assert [weight for weight, one in found if one == ("rare", 2)] == [pytest.approx(0.125)]
    with pytest.raises(BusybotError, match="permutation"):
        outcomes(lambda rng: rng.permutation(3))
    for compare in (lambda luck: luck > 0.25, lambda luck: luck >= 0.25, lambda luck: not luck < 0.25):
        assert outcomes(lambda rng, ask=compare: ask(rng.random())) == [(0.25, False), (0.75, True)]
    with pytest.raises(BusybotError, match="calculates with luck"):
        outcomes(lambda rng: int(rng.random() * 3))


@pytest.mark.parametrize("world", ["paper", "gates"])
def test_a_board_without_responders_has_no_space(world: str) -> None:
    switch = PlacedObject(key="Switch/s", role="trigger", position=(0, 0, 0), yaw=0, scale=1, states=(0,))
    board = BoardSpec(
        index=7, seed=0, split="train", appearance_group=0, texture="wood", color=(1, 1, 1), objects=(switch,),
        relations=(), world=world,
    )  # fmt: skip
    with pytest.raises(BusybotError, match="board 7 has no responder"):
        board_space(board, (2,), ())


class Beginning(Counting):
    """Begins with more different things to remember than anybody lists."""

    arity: ClassVar[tuple[int, int]] = (11, 11)

    def start(self, inputs: Inputs) -> tuple[int, Memory]:
        return self.shown(inputs), (0, *inputs)


def test_nothing_in_a_space_responds_as_what_nobody_can_list() -> None:
    space, counting = space_of("gates", False, (2, 2), (ANY,) * 2), Counting(sizes=(2,), table=(0, 1))
    beginning = Beginning(sizes=(2,) * 11, table=(0, 1) * 1024)
    for endless in (counting, beginning):
        with pytest.raises(BusybotError, match="remember more than 1024"):
            machine_of(endless)
    assert space.meaning_of(Hypothesis(counting, (0,))) == -1


@pytest.mark.parametrize("novel", [False, True])
@pytest.mark.parametrize("world", WORLDS)
def test_tables_say_what_the_mechanisms_do(world: str, novel: bool) -> None:
    """Every mechanism of every world, for two- and three-state links, along random walks."""
    rng = generator(0, world, int(novel), "walks")
    space = space_of(world, novel, (2, 3, 2), (ANY,) * 4)
    different = {one.mechanism for one in space.hypotheses}
    for mechanism in different:
        machine, inputs = machine_of(mechanism), walk(mechanism.sizes, 12, rng) if mechanism.sizes else [[]] * 13
        rows = [int(np.ravel_multi_index(row, mechanism.sizes)) if len(row) else 0 for row in inputs]
        shown, memory = mechanism.start(tuple(map(int, inputs[0])))
        number = int(machine.start_memory[rows[0]])
        assert shown == machine.start_shown[rows[0]]
        for row, now in zip(rows[1:], inputs[1:], strict=True):
            states = tuple(map(int, now))
            ways = (
                outcomes(lambda luck, at=states, old=memory, law=mechanism: law.step(at, old, luck))
                if mechanism.draws
                else [(1.0, mechanism.step(states, memory, None))]
            )
            way = int(rng.integers(len(ways)))
            weight, (shown, memory) = ways[way]
            assert (shown, weight) == (machine.shown[row, number, way], pytest.approx(machine.luck[row, number, way]))
            number = int(machine.memory[row, number, way])


def test_what_responds_alike_has_one_meaning_whatever_it_is_called() -> None:
    from busybot.boards.mechanisms.chance import Unreliable
    from busybot.boards.mechanisms.delay import Delay
    from busybot.boards.mechanisms.direct import ManyObjects, OneToOne
    from busybot.boards.mechanisms.gate import Gate, truth_table
    from busybot.boards.mechanisms.latch import Latch
    from busybot.boards.mechanisms.toggle import Toggle

    def gate(function: str) -> Gate:
        return Gate(sizes=(2, 2), table=truth_table(function, (2, 2)), function=function)

    def unreliable(probability: float) -> Unreliable:
        return Unreliable(sizes=(2,), table=(0, 1), probability=probability)

    follows = OneToOne(sizes=(2,), table=(0, 1))
    alike = [
        (Hypothesis(gate("and"), (0, 1)), Hypothesis(gate("and"), (1, 0))),
        (Hypothesis(gate("a-and-not-b"), (0, 1)), Hypothesis(gate("not-a-and-b"), (1, 0))),
        (Hypothesis(follows, (3,)), Hypothesis(ManyObjects(sizes=(2,), table=(0, 1)), (3,))),
        (Hypothesis(unreliable(0.7), (0,)), Hypothesis(unreliable(0.9), (0,))),
    ]
    for one, other in alike:
        assert one.meaning == other.meaning
    latch = Latch(sizes=(2, 2), table=(0, 1))
    different = [
        Hypothesis(follows, (0,)), Hypothesis(follows, (1,)), Hypothesis(unreliable(0.7), (0,)),
        Hypothesis(Delay(sizes=(2,), table=(0, 1), actions=1), (0,)), Hypothesis(gate("and"), (0, 1)),
        Hypothesis(Delay(sizes=(2,), table=(0, 1), actions=2), (0,)), Hypothesis(gate("a-and-not-b"), (0, 1)),
        Hypothesis(gate("a-and-not-b"), (1, 0)), Hypothesis(latch, (0, 1)), Hypothesis(latch, (1, 0)),
        Hypothesis(Latch(sizes=(2, 2), table=(0, 1), first=1), (0, 1)),
        Hypothesis(Toggle(sizes=(2,), table=(0, 1)), (0,)), Hypothesis(Toggle(sizes=(2,), table=(1, 0)), (0,)),
    ]  # fmt: skip
    assert len({one.meaning for one in different}) == len(different)


def test_meanings_agree_with_what_long_walks_show() -> None:
    """Without luck: two hypotheses of a space show the same along a long walk just when they mean the same."""
    rng = np.random.default_rng(3)
    for world, novel in (("time", False), ("time", True), ("gates", True)):
        space = space_of(world, novel, (2, 3, 2), (SINGLE,))
        triggers = [walk(space.sizes, 400, rng) for _ in range(2)]
        told = [b"".join(along(one, states) for states in triggers) for one in space.hypotheses[: space.sure]]
        for first, second in combinations(range(space.sure), 2):
            assert (told[first] == told[second]) == bool(space.meanings[first] == space.meanings[second])


def along(one: Hypothesis, triggers: np.ndarray) -> bytes:
    inputs = [tuple(int(row[place]) for place in one.inputs) for row in triggers]
    shown, memory = one.mechanism.start(inputs[0])
    told = [shown]
    for now in inputs[1:]:
        shown, memory = one.mechanism.step(now, memory, None)
        told.append(shown)
    return bytes(told)


@pytest.mark.parametrize("split", ["train", NOVEL])
@pytest.mark.parametrize("world", WORLDS)
def test_a_space_holds_what_its_world_draws(world: str, split: str) -> None:
    """Every mechanism of drawn boards is there, with a probability, and no recording is found to be impossible."""
    library = find("procedural")
    for number, spec in enumerate(
        generate_boards(BoardConfig(world=world, split=split, boards=3, group_size=1), library)
    ):
        board = Drawn(spec, library)
        space = board.space
        assert space.prior.sum(0) == pytest.approx(1)
        streams = [one.kind for one in spec.relations if "stream" in one.parameters]
        for responder, one in enumerate(board.truth()):
            meaning = space.meaning_of(one)
            assert meaning >= 0
            assert space.prior[space.meanings == meaning, responder].sum() > 0 or one.kind in streams
        told = play(board, "random", (30,), generator(0, split, number, "test"))
        assert np.isfinite(told).all()


# the posterior


def assert_posterior(space: Space, trace: Trace, belief: Belief) -> None:
    """Its posterior is the prior times the likelihood by brute force, where responders have nothing in common."""
    for responder in range(space.responders):
        likely = np.array([likelihood(space, responder, one, trace) for one in space.hypotheses])
        posterior = space.prior[:, responder] * likely
        np.testing.assert_allclose(belief.now[:, responder], posterior / posterior.sum(), atol=1e-10)


WITHOUT_HELD_OUT = ("timer", "latch")
WITH_HELD_OUT = ("gates", "time", "unreliable", "chain", "delay")


@pytest.mark.parametrize(
    ("world", "novel"),
    [*product((*WITH_HELD_OUT, *WITHOUT_HELD_OUT), [False]), *product(WITH_HELD_OUT, [True])],
)
def test_the_posterior_is_that_of_brute_force(world: str, novel: bool) -> None:
    """Every luck of four actions, for each hypothesis, on a board with a three-state link."""
    space = space_of(world, novel, (2, 3, 2), (ANY, SINGLE))
    rng = generator(1, world, int(novel), "posterior")
    causes = drawn_causes(space, rng)
    triggers = walk(space.sizes, 4, rng)
    trace = triggers, shown_by(space, board_of(space, causes), triggers)
    for belief, actions in zip(observe(space, *trace), range(5), strict=True):
        if actions in (0, 2, 4):
            assert_posterior(space, (trace[0][: actions + 1], trace[1][: actions + 1]), belief)


def test_a_toggle_is_told_from_a_timer_and_a_delay() -> None:
    space = space_of("time", True, (2, 2), (SINGLE,))
    toggle = next(one for one in space.hypotheses if one.kind == "toggle" and one.inputs == (1,))
    triggers = np.array([[0, 0], [0, 1], [0, 0], [0, 1], [1, 1], [1, 0], [0, 0], [0, 1], [0, 0]])
    shown = shown_by(space, board_of(space, [toggle]), triggers)
    belief = observe(space, triggers, shown)[-1]
    found, probable = belief.mechanisms()
    assert (found[0], probable[0]) == (toggle, pytest.approx(1))
    assert belief.parent_sets() == [(1,)]
    assert belief.kinds()[0]["toggle"] == pytest.approx(1) and belief.lags()[0][0] == pytest.approx(1)


def test_a_hidden_clock_is_what_brute_force_says() -> None:
    """Over all groups that a clock may move, all its strokes, and all that may move the others."""
    space = space_of("chance", False, (2,), (SINGLE,) * 4)
    clocks = space.clocks
    assert clocks is not None
    rng = np.random.default_rng(5)
    triggers = walk(space.sizes, 4, rng)
    shown = np.array([[0, 0, 1, 0], [1, 1, 1, 0], [1, 1, 1, 1], [0, 0, 1, 0], [0, 0, 1, 0]])
    trace = triggers, shown
    alone = np.array([[likelihood(space, r, one, trace) for r in range(4)] for one in space.hypotheses]) * space.prior
    hidden = [number for number, one in enumerate(space.hypotheses) if one.kind == "clock"]
    weights = {(): (1 - clocks.share) * alone.sum(0).prod()}
    for group in clocks.sets:
        size = sum(len(other) == len(group) for other in clocks.sets)
        others = [r for r in range(4) if r not in group]
        together = strokes(space, hidden, group, clocks.prior, trace)
        weights[group] = clocks.share / 2 / size * together * alone.sum(0)[others].prod()
    total = sum(weights.values())
    belief = observe(space, triggers, shown)[-1]
    for responder in range(4):
        expected = sum(weight for group, weight in weights.items() if responder in group) / total
        assert belief.kinds()[responder]["clock"] == pytest.approx(expected, abs=1e-12)
    assert belief.kinds()[0]["clock"] > 0.5 > belief.kinds()[2]["clock"]


def strokes(space: Space, hidden: list[int], group: tuple[int, ...], prior: np.ndarray, trace: Trace) -> float:
    """Probability of what a group shows that one clock moves, by a board moved for every luck."""
    triggers, shown = trace
    total = 0.0
    for numbers in product(hidden, repeat=len(group)):
        drawn = [space.hypotheses[number] for number in numbers]
        if len({one.mechanism.parameters()["probability"] for one in drawn}) > 1:
            continue
        causes = [Hypothesis(machine_free(), ())] * space.responders
        for responder, one in zip(group, drawn, strict=True):
            causes[responder] = one
        board = board_of(space, causes, dict.fromkeys(group, "clock"))
        likely = 0.0
        for luck in product((True, False), repeat=len(triggers) - 1):
            dynamics = Told(board, links_of(space), {"clock": luck})
            states = np.array([state.shown for state in dynamics.run(triggers.tolist())])[:, len(space.sizes) :]
            if (states[:, group] == shown[:, group]).all():
                likely += chance_of(dynamics, luck)
        tables = np.prod([prior[number, r] for number, r in zip(numbers, group, strict=True)])
        # they have one probability, which is drawn once
        total += likely * tables * LEVELS ** (len(group) - 1)
    return total


def rewired_boards(space: Space) -> Iterator[tuple[float, list[Hypothesis], int | None, int, Hypothesis | None]]:
    """Prior, first mechanisms, who is rewired after which action, and what comes of it."""
    every = range(len(space.hypotheses))
    for numbers in product(every, repeat=space.responders):
        causes = [space.hypotheses[number] for number in numbers]
        for who, step in product(range(space.responders), STEPS):
            others = [space.prior[number, r] for r, number in enumerate(numbers) if r != who]
            first = space.driven[numbers[who], who]
            for later in every:
                if not first or not space.driven[later, who]:
                    continue
                # a gate may be written down anew with its links the other way round
                same = 1 / space.orders[numbers[who]]
                second = space.driven[later, who] / (1 - first * same) * (1 - same if later == numbers[who] else 1)
                weight = np.prod(others) * first * second / space.responders / len(STEPS)
                yield float(weight), causes, who, step, space.hypotheses[later]


def test_a_rewiring_is_what_brute_force_says() -> None:
    """Over all that two responders may be, which of them is rewired, after which action, and what comes of it."""
    space = space_of("rewired", False, (2, 2), (SINGLE,) * 2)
    rng = np.random.default_rng(2)
    triggers = walk(space.sizes, 40, rng)
    known = {(one.kind, one.inputs, one.mechanism.table): one for one in space.hypotheses}
    follows = known["one-to-one", (0,), (0, 1)]
    gate = next(one for one in space.hypotheses if one.kind == "gate")
    board = rewired_board(space, [gate, follows], 1, 21, known["one-to-one", (1,), (1, 0)])
    shown = shown_by(space, board, triggers)
    beliefs = observe(space, triggers, shown)
    for actions in (22, 25):
        posterior = np.zeros_like(space.prior)
        told: dict[Any, bytes] = {}
        for weight, causes, who, step, later in rewired_boards(space):
            assert who is not None and later is not None
            fits = True
            for responder, one in enumerate(causes):
                change = (step, later) if responder == who else None
                key = responder, one, change
                if key not in told:
                    alone = [Hypothesis(machine_free(), ())] * 2
                    alone[responder] = one
                    law = rewired_board(space, alone, responder, *change) if change else board_of(space, alone)
                    told[key] = shown_by(space, law, triggers[: actions + 1])[:, responder].tobytes()
                fits &= told[key] == shown[: actions + 1, responder].tobytes()
            if fits:
                for responder, one in enumerate(causes):
                    now = later if responder == who and step < actions else one
                    posterior[space.hypotheses.index(now), responder] += weight
        np.testing.assert_allclose(beliefs[actions].now, posterior / posterior.sum(0), atol=1e-10)
    found, _ = beliefs[40].mechanisms()
    assert found[1].inputs == (1,)


def rewired_board(space: Space, causes: Sequence[Hypothesis], who: int, step: int, later: Hypothesis) -> BoardSpec:
    rewiring = Rewiring(step=step, relation=relation_of(space, who, later))
    return board_of(space, causes).model_copy(update={"rewirings": (rewiring,)})


def test_what_nothing_explains_is_refused_unless_errors_are_allowed_for() -> None:
    space = space_of("gates", False, (2, 2), (SINGLE,))
    triggers, shown = np.zeros((3, 2), int), np.array([[0], [1], [0]])
    with pytest.raises(BusybotError, match="nothing in the space explains"):
        observe(space, triggers, shown)
    belief = observe(space, triggers, shown, error=0.05)[-1]
    assert belief.now.sum(0) == pytest.approx(1)


def test_errors_are_weighed_as_brute_force_weighs_them() -> None:
    space, error = space_of("gates", False, (2, 2), (SINGLE,)), 0.1
    rng = np.random.default_rng(8)
    triggers, shown = walk(space.sizes, 6, rng), rng.integers(0, 2, (7, 1))
    expected = (
        np.array([along_error(one, triggers, shown[:, 0], error) for one in space.hypotheses]) * space.prior[:, 0]
    )
    found = observe(space, triggers, shown, error)[-1].now[:, 0]
    np.testing.assert_allclose(found, expected / expected.sum(), atol=1e-12)


def along_error(one: Hypothesis, triggers: np.ndarray, shown: np.ndarray, error: float) -> float:
    wrong = (np.frombuffer(along(one, triggers), np.uint8) != shown).sum()
    return float((error / 2) ** wrong * (1 - error) ** (len(shown) - wrong))


# what is made of it


def test_the_probability_of_an_object_is_that_of_any_of_its_links() -> None:
    space = space_of("gates", False, (2, 2, 2), (SINGLE,) * 2)
    belief = observe(space, np.zeros((1, 3), int), np.zeros((1, 2), int))[0]
    together = belief.object_parents((0, 0, 1, 2, 3), 4)
    weights = belief.now[:, 0]
    any_of = sum(weight for weight, one in zip(weights, space.hypotheses, strict=True) if {0, 1} & set(one.inputs))
    assert together[0, 0] == pytest.approx(any_of)
    assert together[0, 0] < belief.parents()[:2, 0].sum()


@pytest.mark.parametrize("world", ["mixed", "chance", "rewired"])
def test_predictions_are_what_the_next_belief_is_made_of(world: str) -> None:
    """The probability that is told of a state is what observing it takes from all hypotheses, also across rewirings."""
    space = space_of(world, False, (2, 2), (SINGLE,) * 2)
    rng = generator(0, world, 0, "predict")
    triggers = walk(space.sizes, 26, rng)
    shown = shown_by(space, board_of(space, drawn_causes(space, rng)), triggers)
    for actions in (0, 5, 20, 22, 25):
        belief = observe(space, triggers[: actions + 1], shown[: actions + 1])[-1]
        told = belief.predict(triggers[actions + 1])
        assert told.sum(1) == pytest.approx(1)
        assert (told[np.arange(2), shown[actions + 1]] > 0).all()


def test_predictions_are_sure_once_the_mechanism_is_known() -> None:
    """A lamp follows link 0."""
    space = space_of("gates", False, (2, 2), (SINGLE,))
    follows = next(one for one in space.hypotheses if one.inputs == (0,) and one.mechanism.table == (0, 1))
    triggers = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0], [1, 0]])
    shown = shown_by(space, board_of(space, [follows]), triggers)
    before, *_, belief = observe(space, triggers, shown)
    assert belief.predict((0, 0))[0].tolist() == pytest.approx([1, 0, 0])
    assert belief.predict((1, 1))[0].tolist() == pytest.approx([0, 1, 0])
    assert 0 < before.predict((1, 0))[0, 1] < 1


def information(belief: Belief, space: Space, choice: Sequence[int]) -> float:
    """Entropy of the mechanism before, less what is expected to be left after the action, by observing each answer."""

    def entropy(now: np.ndarray) -> float:
        mass = np.bincount(space.meanings, now)
        return float(-(mass[mass > 0] * np.log(mass[mass > 0])).sum())

    triggers, shown = asked
    found = entropy(belief.now[:, 0])
    for state, probable in enumerate(belief.predict(choice)[0]):
        if probable > 0:
            after = observe(space, np.vstack([triggers, choice]), np.vstack([shown, [state]]))[-1]
            found -= probable * entropy(after.now[:, 0])
    return found


asked: Trace = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1]]), np.array([[0], [0], [1], [1]])


@pytest.mark.parametrize("world", ["gates", "time", "unreliable", "chain"])
def test_the_greedy_experimenter_expects_what_brute_force_says(world: str) -> None:
    space = space_of(world, False, (2, 2, 2), (SINGLE,))
    belief = observe(space, *asked)[-1]
    choices = [(0, 1, 1), (1, 0, 1), (1, 1, 0), (1, 1, 1)]
    worth = [information(belief, space, choice) for choice in choices]
    for choice, expected in zip(choices, worth, strict=True):
        assert belief.information(choice) == pytest.approx(expected, abs=1e-9)
    assert worth[greedy(belief, choices, np.random.default_rng(0))] == pytest.approx(max(worth))


TABLE = {  # worlds.md, per cent after 5, 10, 15, 22, 30, 40 actions: parents, mechanism
    (3, "random"): ((56, 87, 95, 99, 100, 100), (35, 78, 92, 98, 100, 100)),
    (3, "greedy"): ((69, 99, 99, 100, 100, 100), (51, 99, 99, 100, 100, 100)),
    (4, "random"): ((47, 75, 89, 98, 99, 100), (14, 61, 81, 94, 99, 100)),
}


@pytest.mark.parametrize(("links", "choice"), TABLE)
def test_the_table_comes_out_at_a_reduced_size(links: int, choice: str) -> None:
    """15 boards of six responders, within what so few say: 4 standard errors of boards, whose spread is measured."""
    actions = (5, 10, 15, 22, 30)
    boards = [Symbolic.draw(links, generator(7, "table", number, "draw")) for number in range(15)]
    told = np.array(
        [play(board, choice, actions, generator(7, "table", number, "play")) for number, board in enumerate(boards)]
    )
    shares = told[:, :, 6:] / 6
    error = np.maximum(shares.std(0, ddof=1) / np.sqrt(len(boards)), 0.02)
    for place in range(len(actions)):
        for which, expected in enumerate(TABLE[links, choice]):
            assert abs(shares[:, place, which].mean() - expected[place] / 100) < 4 * error[place, which]


def test_choosing_well_finds_mechanisms_sooner_than_chance() -> None:
    known = {}
    for choice in ("random", "greedy"):
        boards = [Symbolic.draw(4, generator(3, "gain", number, "draw")) for number in range(6)]
        told = [play(board, choice, (15,), generator(3, "gain", n, "play")) for n, board in enumerate(boards)]
        known[choice] = float(np.array(told)[:, 0, 7].sum())
    assert known["greedy"] > known["random"]


def test_six_responders_of_six_links_are_judged_within_a_second() -> None:
    space = space_of("mixed", False, (2,) * 6, (SINGLE,) * 6)
    rng = np.random.default_rng(0)
    triggers = walk(space.sizes, 30, rng)
    shown = shown_by(space, board_of(space, drawn_causes(space, rng)), triggers)
    observe(space, triggers[:2], shown[:2])  # tables are made once
    began = time.process_time()
    observer = Observer(space, triggers[0], shown[0])
    for row in range(1, 31):
        observer.see(triggers[row], shown[row])
    assert observer.belief().actions == 30
    assert time.process_time() - began < 1


@pytest.mark.parametrize("kind", ["toggle", "unreliable"])
def test_a_mechanism_is_a_world_of_its_own_also_in_the_split_of_new_kinds(kind: str) -> None:
    library = find("procedural")
    [spec] = generate_boards(BoardConfig(world=kind, split=NOVEL, boards=1, group_size=1), library)
    board = Drawn(spec, library)
    assert board.space.prior.sum(0) == pytest.approx(1)
    for responder, one in enumerate(board.truth()):
        meaning = board.space.meaning_of(one)
        assert meaning >= 0 and board.space.prior[board.space.meanings == meaning, responder].sum() > 0
