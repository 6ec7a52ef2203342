"""What a recording determines: an exact Bayesian observer of the true symbolic trace, and an experimenter who asks it.

The observer is told the states of all trigger links and responders after every action, and knows the space of
hypotheses (`hypotheses`): no learner knows as much. It filters each hypothesis's memory forward through the trace
(Bayes' rule; exact where luck plays a part, too), and weighs what responders have in common: a hidden clock that moves
two or three of them, and that on a board at most one mechanism is rewired.

The greedy experimenter moves the link from which it expects to learn most about the mechanisms: the mutual information
between what each responder will show next and how it responds, summed over responders.

Evaluator code: nothing that infers, predicts, explores or plans may import this module.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from busybot.common.errors import BusybotError
from busybot.reason.evaluation.hypotheses import STEPS, Hypothesis, Machine, Space, machine_of

STATES = 3
"""A responder has so many at most."""
WIDTH = 3
"""A mechanism has so many inputs at most."""
ALIKE = 1e-9
"""Information is compared to this, nats."""


class _Tables:
    """The machines of a space, side by side, so that all hypotheses are asked at once."""

    def __init__(self, space: Space):
        self.sure = space.sure
        machines = {one.mechanism: machine_of(one.mechanism) for one in space.hypotheses}
        self._read(space)
        certain = [machines[one.mechanism] for one in space.hypotheses[: self.sure]]
        lucky = [machines[one.mechanism] for one in space.hypotheses[self.sure :]]
        self.start_shown, self.start_memory, self.shown, self.memory = _stacked(certain)
        self.lucky_shown, self.lucky_memory, *_ = _stacked(lucky)
        self.chances = _chances(lucky)

    def _read(self, space: Space) -> None:
        shape = (len(space.hypotheses), WIDTH)
        self.places, self.strides, self.sizes = np.zeros(shape, int), np.zeros(shape, int), np.ones(shape, int)
        for number, one in enumerate(space.hypotheses):
            sizes = one.mechanism.sizes
            for place, (read, size) in enumerate(zip(one.inputs, sizes, strict=True)):
                self.places[number, place], self.sizes[number, place] = read, size
                self.strides[number, place] = int(np.prod(sizes[place + 1 :], dtype=int))

    def rows(self, inputs: np.ndarray) -> np.ndarray:
        """int (H,), which combination of its inputs each hypothesis meets.

        Args:
            inputs: int (L + R,), states of links and responders; one beyond what an input may be counts as high.
        """
        return np.asarray((np.minimum(inputs[self.places], self.sizes - 1) * self.strides).sum(1))


def _stacked(machines: Sequence[Machine]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """start_shown, start_memory (H, X) and, of the first outcome, shown, memory (H, X, M); what is not there is 0."""
    inputs = max((one.shown.shape[0] for one in machines), default=1)
    memories = max((one.shown.shape[1] for one in machines), default=1)
    starts, steps = np.zeros((2, len(machines), inputs), int), np.zeros((2, len(machines), inputs, memories), int)
    for number, one in enumerate(machines):
        here = one.shown.shape[:2]
        starts[:, number, : here[0]] = one.start_shown, one.start_memory
        steps[:, number, : here[0], : here[1]] = one.shown[..., 0], one.memory[..., 0]
    return starts[0], starts[1], steps[0], steps[1]


def _chances(machines: Sequence[Machine]) -> np.ndarray:
    """float (H, X, M, STATES * M), probability of showing each state and remembering that, from each memory."""
    inputs = max((one.shown.shape[0] for one in machines), default=1)
    memories = max((one.shown.shape[1] for one in machines), default=1)
    found = np.zeros((len(machines), inputs, memories, STATES, memories))
    for number, one in enumerate(machines):
        row, memory, _ = np.indices(one.shown.shape)
        np.add.at(found[number], (row, memory, one.shown, one.memory), one.luck)
    return found.reshape(*found.shape[:3], STATES * memories)


@lru_cache(maxsize=64)
def _tables(space: Space) -> _Tables:
    return _Tables(space)


@dataclass(frozen=True, eq=False)
class _Run:
    """All hypotheses after the same actions, as if each had held since the run began.

    Attributes:
        memory: int (H,), of the hypotheses without luck, which are the first.
        belief: float (H', R, M), of the memories of those with luck, as responders' states tell.
        log: float (H, R), log probability of all that each responder has shown.
    """

    space: Space
    memory: np.ndarray
    belief: np.ndarray
    log: np.ndarray

    @staticmethod
    def start(space: Space, inputs: np.ndarray, seen: np.ndarray) -> "_Run":
        """Begins with what a new mechanism shows.

        Args:
            seen: float (R, STATES), probability of what is seen if each state is true.
        """
        tables = _tables(space)
        rows, sure = tables.rows(inputs), tables.sure
        memory = tables.start_memory[np.arange(sure), rows[:sure]]
        lucky = tables.lucky_memory[np.arange(len(tables.chances)), rows[sure:]]
        belief = np.zeros((len(lucky), space.responders, tables.chances.shape[2]))
        belief[np.arange(len(lucky)), :, lucky] = 1
        return _Run(space, memory, belief, _log(_agreement(_Run.first(space, inputs), seen)))

    @staticmethod
    def first(space: Space, inputs: np.ndarray) -> np.ndarray:
        """float (H, R, STATES), what new mechanisms show."""
        tables = _tables(space)
        rows, sure = tables.rows(inputs), tables.sure
        certain = tables.start_shown[np.arange(sure), rows[:sure]]
        lucky = tables.lucky_shown[np.arange(len(tables.chances)), rows[sure:]]
        shown = np.eye(STATES)[np.concatenate([certain, lucky])]
        return np.repeat(shown[:, None], space.responders, axis=1)

    def predict(self, inputs: np.ndarray) -> np.ndarray:
        """float (H, R, STATES), what each hypothesis expects after an action that leads to these inputs."""
        rows = _tables(self.space).rows(inputs)
        return self._expected(rows, self._lucky(rows))

    def after(self, inputs: np.ndarray, seen: np.ndarray) -> "_Run":
        """One action later."""
        tables = _tables(self.space)
        rows, sure = tables.rows(inputs), tables.sure
        lucky = self._lucky(rows)
        log = self.log + _log(_agreement(self._expected(rows, lucky), seen))
        memory = tables.memory[np.arange(sure), rows[:sure], self.memory]
        belief = (lucky * seen[..., None]).sum(2)
        total = belief.sum(-1, keepdims=True)
        return _Run(self.space, memory, np.divide(belief, total, out=self.belief.copy(), where=total > 0), log)

    def _expected(self, rows: np.ndarray, lucky: np.ndarray) -> np.ndarray:
        tables, found = _tables(self.space), np.empty((len(rows), self.space.responders, STATES))
        certain = tables.shown[np.arange(tables.sure), rows[: tables.sure], self.memory]
        found[: tables.sure] = np.eye(STATES)[certain][:, None]
        found[tables.sure :] = lucky.sum(-1)
        return found

    def _lucky(self, rows: np.ndarray) -> np.ndarray:
        """float (H', R, STATES, M), what those with luck show and remember next."""
        tables = _tables(self.space)
        flat = self.belief @ tables.chances[np.arange(len(tables.chances)), rows[tables.sure :]]
        return flat.reshape(*self.belief.shape[:2], STATES, self.belief.shape[2])


def _unexplained(actions: int) -> BusybotError:
    return BusybotError(
        f"nothing in the space explains what a responder showed in {actions} actions",
        "declare a larger space, or allow for errors",
    )


def _agreement(expected: np.ndarray, seen: np.ndarray) -> np.ndarray:
    return np.asarray((expected * seen).sum(-1))


def _log(probability: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return np.log(probability)


def _total(log: np.ndarray, axis: int = 0) -> np.ndarray:
    most = _finite(log.max(axis))
    return _log(np.exp(log - np.expand_dims(most, axis)).sum(axis)) + most


def _shares(log: np.ndarray) -> np.ndarray:
    """Weights with sum 1 in each column, 0 in one that is impossible throughout."""
    most = log.max(0, initial=-np.inf)
    weights = np.exp(log - np.where(np.isfinite(most), most, 0))
    return np.asarray(weights / np.maximum(weights.sum(0), np.finfo(float).tiny))


@dataclass(frozen=True, eq=False)
class _Weights:
    """What is believed of each responder's mechanism, H hypotheses of R responders; together 1 for each responder.

    Attributes:
        kept: float (H, R), that this one decides it, and no other one will.
        before, after: for each of `STEPS` that this one decides it until then, or from then on.
    """

    kept: np.ndarray
    before: dict[int, np.ndarray]
    after: dict[int, np.ndarray]

    def at(self, action: int) -> np.ndarray:
        """float (H, R), that this one decides what shows after the action of that number, from 0."""
        earlier = [weights for step, weights in self.before.items() if action < step]
        later = [weights for step, weights in self.after.items() if action >= step]
        return np.asarray(sum([*earlier, *later], self.kept))


@dataclass(frozen=True, eq=False)
class _Moment:
    """What there is to know between two actions.

    Attributes:
        shown: int (R,), the responders' states.
        runs: by the first action after which the run's mechanisms decide; -1 for those of the new board.
    """

    shown: np.ndarray
    runs: dict[int, _Run]


@dataclass(frozen=True, eq=False)
class Belief:
    """The posterior after so many actions. H hypotheses, R responders, I = L + R inputs.

    Attributes:
        actions: how many.
        weights: see `_Weights`.
        last: the moment after them.
    """

    space: Space
    actions: int
    weights: _Weights
    last: _Moment

    @cached_property
    def now(self) -> np.ndarray:
        """float (H, R), probability that this is the mechanism that decides now."""
        return self.weights.at(self.actions - 1)

    def parents(self) -> np.ndarray:
        """float (I, R), probability that an input is a parent, link by link."""
        return np.asarray(self.space.parents.T.astype(float) @ self.now)

    def object_parents(self, owners: Sequence[int], objects: int) -> np.ndarray:
        """float (N, R), probability that any input of an object is a parent.

        Args:
            owners: index of the object of each of the I inputs.
            objects: N, how many there are.
        """
        of_object = np.zeros((len(owners), objects))
        of_object[np.arange(len(owners)), owners] = 1
        return np.asarray((self.space.parents @ of_object > 0).T.astype(float) @ self.now)

    def parent_sets(self) -> list[tuple[int, ...]]:
        """The most probable set of inputs of each responder, by their numbers."""
        numbers, sets = self.space.parent_sets
        mass = np.zeros((len(sets), self.space.responders))
        np.add.at(mass, numbers, self.now)
        return [sets[number] for number in mass.argmax(0)]

    def mechanisms(self) -> tuple[list[Hypothesis], np.ndarray]:
        """The most probable mechanism of each responder, and float (R,) its probability; what responds alike is one."""
        mass = self._by_meaning(self.now)
        best = mass.argmax(0)
        likeliest = [
            int(np.where(self.space.meanings == meaning, self.now[:, responder], -1).argmax())
            for responder, meaning in enumerate(best)
        ]
        return [self.space.hypotheses[number] for number in likeliest], mass.max(0)

    def kinds(self) -> list[dict[str, float]]:
        """Probability of each kind of mechanism, for each responder."""
        return self._told([one.kind for one in self.space.hypotheses])

    def lags(self) -> list[dict[int, float]]:
        """Probability of each lag (`hypotheses.lag_of`), for each responder."""
        return self._told(self.space.lags.tolist())

    def changed(self) -> tuple[np.ndarray, np.ndarray]:
        """Probability that another mechanism decides each responder than at the start, float (R,), and the likeliest
        action, from 0, from which on it does, int (R,); -1 where none may have been."""
        done = sorted(step for step in self.weights.after if step < self.actions)
        if not done:
            return np.zeros(self.space.responders), np.full(self.space.responders, -1)
        of_step = np.array([self.weights.after[step].sum(0) for step in done])
        return of_step.sum(0), np.where(of_step.any(0), np.array(done)[of_step.argmax(0)], -1)

    def predict(self, triggers: Sequence[int]) -> np.ndarray:
        """Probability of each responder's states, float (R, STATES), after a next action that leaves the trigger links
        in these."""
        return np.asarray(sum((weights[..., None] * told).sum(0) for weights, told in self._told_by(triggers)))

    def information(self, triggers: Sequence[int]) -> float:
        """What the next action is expected to tell about the mechanisms, if links rest so after it: nats, summed over
        responders. How probable luck is is not asked for."""
        joint = np.zeros((int(self.space.meanings.max()) + 1, self.space.responders, STATES))
        for weights, told in self._told_by(triggers):
            joint += self._by_meaning(weights[..., None] * told)
        return _entropy(joint.sum(0)) + _entropy(joint.sum(2)) - _entropy(joint)

    def _told_by(self, triggers: Sequence[int]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Weights (H, R) and predictions (H, R, STATES) of what may decide after the next action."""
        inputs = np.concatenate([np.asarray(triggers, int), self.last.shown])
        old = sum((weights for step, weights in self.weights.before.items() if self.actions < step), self.weights.kept)
        yield old, self.last.runs[-1].predict(inputs)
        for step, weights in self.weights.after.items():
            if step == self.actions:
                yield weights, _Run.first(self.space, inputs)
            elif step < self.actions:
                yield weights, self.last.runs[step].predict(inputs)

    def _by_meaning(self, values: np.ndarray) -> np.ndarray:
        """Sums over hypotheses that respond alike."""
        order, starts = _sorted_meanings(self.space)
        return np.asarray(np.add.reduceat(values[order], starts, axis=0))

    def _told(self, names: Sequence) -> list[dict]:
        """Sums over hypotheses of one name, for each responder."""
        places = {name: place for place, name in enumerate(dict.fromkeys(names))}
        mass = np.zeros((len(places), self.space.responders))
        np.add.at(mass, [places[name] for name in names], self.now)
        return [dict(zip(places, column, strict=True)) for column in mass.T.tolist()]


@lru_cache(maxsize=64)
def _sorted_meanings(space: Space) -> tuple[np.ndarray, np.ndarray]:
    order = np.argsort(space.meanings, kind="stable")
    return order, np.flatnonzero(np.diff(space.meanings[order], prepend=-1))


def _entropy(probability: np.ndarray) -> float:
    inside = probability[probability > 0]
    return float(-(inside * np.log(inside)).sum())


class Observer:
    """Sees a board action by action.

    Args:
        space: that its mechanisms are of.
        triggers: int (L,), states of the trigger links on the new board.
        shown: int (R,), states of the responders there.
        error: probability that a responder's state is not the one that is told; then it is any other one.
    """

    def __init__(self, space: Space, triggers: Sequence[int], shown: Sequence[int], error: float = 0.0):
        self.space = space
        self._emission = np.where(np.eye(STATES, dtype=bool), 1 - error, error / (STATES - 1))
        self._exact = not error
        states = np.asarray(shown, int)
        run = _Run.start(space, np.concatenate([np.asarray(triggers, int), states]), self._emission[states])
        self._history = [_Moment(states, {-1: run})]
        self._together = np.ones((len(states), len(states)), bool)  # have changed at the same actions

    def see(self, triggers: Sequence[int], shown: Sequence[int]) -> None:
        """One more action, which left links and responders in these states."""
        before, number, states = self._history[-1], len(self._history) - 1, np.asarray(shown, int)
        inputs, seen = np.concatenate([np.asarray(triggers, int), before.shown]), self._emission[states]
        runs = {began: run.after(inputs, seen) for began, run in before.runs.items()}
        if self.space.rewired and number in STEPS:
            runs[number] = _Run.start(self.space, inputs, seen)
        changed = before.shown != states
        self._together &= changed[:, None] == changed[None]
        self._history.append(_Moment(states, runs))

    def belief(self) -> Belief:
        """What is to be believed now.

        Raises:
            BusybotError: nothing in the space explains what was seen.
        """
        return Belief(self.space, len(self._history) - 1, self._weights(), self._history[-1])

    def _weights(self) -> _Weights:
        space, log = self.space, self._history[-1].runs[-1].log
        now = len(self._history) - 1
        if space.wiring is not None:
            most = _finite(log.max(0))
            shares = space.wiring.shares(np.exp(log - most))
            if not np.allclose(shares.sum(0), 1):
                raise _unexplained(now)
            return _Weights(shares, {}, {})
        alone = _log(space.prior) + log
        # those that are to come are alike
        of_step = {step: self._rewired(step) for step in {min(step, now) for step in STEPS}} if space.rewired else {}
        rewired = {step: of_step[min(step, now)] for step in STEPS} if space.rewired else {}
        sets, masses = self._masses(_total(alone), rewired)
        with np.errstate(invalid="ignore"):
            share = np.exp(masses - _total(masses.ravel()))  # sets, (nobody, R)
        if not np.isfinite(share).all():
            raise _unexplained(now)
        moved = (sets * share.sum(1)[:, None]).sum(0)
        changed = share[:, 1:].sum(0)
        kept = _shares(alone) * (1 - moved - changed).clip(0)
        if space.clocks is not None:
            kept += _shares(_log(space.clocks.prior) + log) * moved
        total = _total(np.stack([one.mass for one in rewired.values()])) if rewired else np.zeros(0)
        when = {step: np.exp(one.mass - _finite(total)) for step, one in rewired.items()}
        return _Weights(
            kept,
            {step: one.before * when[step] * changed for step, one in rewired.items()},
            {step: one.after * when[step] * changed for step, one in rewired.items()},
        )

    def _masses(self, alone: np.ndarray, rewired: dict[int, "_Rewired"]) -> tuple[np.ndarray, np.ndarray]:
        """bool (C, R), the groups that a clock may move, the first without any; and float (C, 1 + R), log probability
        of each group and of nobody, or that responder, being rewired."""
        space, count = self.space, self.space.responders
        sets, log = np.zeros((1, count), bool), np.zeros(1)
        if space.clocks is not None:
            groups, of_groups = self._clocked()
            sets, log = (
                np.concatenate([sets, groups]),
                np.concatenate([_log(np.array([1 - space.clocks.share])), of_groups]),
            )
        nobody = np.where(sets, 0, alone).sum(1)
        masses = np.full((len(sets), 1 + count), -np.inf)
        masses[:, 0] = log + nobody + _log(np.array(1 - space.rewired))
        if rewired:
            changed = _total(np.stack([one.mass for one in rewired.values()])) - np.log(len(rewired))
            for responder in range(count):
                others = np.where(sets | (np.arange(count) == responder), 0, alone).sum(1)
                likely = np.where(sets[:, responder], -np.inf, changed[responder])
                masses[:, 1 + responder] = log + others + likely + np.log(space.rewired / count)
        return sets, masses

    def _clocked(self) -> tuple[np.ndarray, np.ndarray]:
        """The groups that a clock may move, bool (C, R), and the log probability of each and of what it shows.

        All of a group have one luck. With errors that would have to be summed over what was not seen: there each is
        given a luck of its own, which makes a clock and responders that flicker equally good explanations.
        """
        clocks = self.space.clocks
        assert clocks is not None
        own, first = (_total(_log(clocks.prior) + self._history[when].runs[-1].log) for when in (-1, 0))
        groups, priors = _groups(self.space)
        told = np.full(len(groups), -np.inf)
        for number, (prior, members) in enumerate(zip(priors, map(list, clocks.sets), strict=True)):
            if not self._exact:
                told[number] = prior + own[members].sum()
            elif self._together[members[0], members].all():
                told[number] = prior + own[members[0]] + first[members[1:]].sum()
        return groups, told

    def _rewired(self, step: int) -> "_Rewired":
        """What a responder was before and is after a rewiring of that step, if there was one or is to be one."""
        space, now = self.space, len(self._history) - 1
        early = self._history[min(step, now)].runs[-1].log
        late = self._history[-1].runs[step].log if step < now else np.zeros_like(early)
        before, after = np.zeros_like(early), np.zeros_like(early)
        scale = _finite(early.max(0)) + _finite(late.max(0))
        until, since = (np.exp(one - _finite(one.max(0))) for one in (early, late))
        again = 1 / space.orders[:, None]  # share that is written down in the same way, which is no rewiring
        for chance, within in _rewirable(space):
            first, second = chance * until, within * since
            before += first * (second.sum(0) - second * again).clip(0)
            after += second * (first.sum(0) - first * again).clip(0)
        mass = before.sum(0)
        safe = np.maximum(mass, np.finfo(float).tiny)
        return _Rewired(before / safe, after / safe, _log(mass) + scale)


@lru_cache(maxsize=64)
def _groups(space: Space) -> tuple[np.ndarray, np.ndarray]:
    """The groups that a clock may move, bool (C, R), and the log probability that it moves each, float (C,)."""
    clocks = space.clocks
    assert clocks is not None
    groups, sizes = np.zeros((len(clocks.sets), space.responders), bool), [len(group) for group in clocks.sets]
    for row, group in zip(groups, clocks.sets, strict=True):
        row[list(group)] = True
    return groups, np.log([clocks.share / len(set(sizes)) / sizes.count(size) for size in sizes])


@lru_cache(maxsize=64)
def _rewirable(space: Space) -> list[tuple[np.ndarray, np.ndarray]]:
    """For each number of states, which a responder keeps: float (H, R), how probable each mechanism is before a
    rewiring, which leads to another one, and after it."""
    again, found = 1 / space.orders[:, None], []
    for stages in np.unique(space.stages):
        prior = np.where((space.stages == stages)[:, None], space.driven, 0)
        within = prior / np.maximum(prior.sum(0), np.finfo(float).tiny)
        found.append((prior / np.maximum(1 - within * again, ALIKE), within))
    return found


@dataclass(frozen=True, eq=False)
class _Rewired:
    """Shares (H, R) of what was there before and after, and log probability (R,) of what was shown."""

    before: np.ndarray
    after: np.ndarray
    mass: np.ndarray


def _finite(log: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(log), log, 0)


def observe(space: Space, triggers: np.ndarray, shown: np.ndarray, error: float = 0.0) -> list[Belief]:
    """The exact posterior on the new board and after every action.

    Args:
        triggers: int (T + 1, L), states of the trigger links.
        shown: int (T + 1, R), states of the responders.
        error: see `Observer`.

    Raises:
        BusybotError: nothing in the space explains what was seen.
    """
    observer = Observer(space, triggers[0], shown[0], error)
    found = [observer.belief()]
    for links, states in zip(triggers[1:], shown[1:], strict=True):
        observer.see(links, states)
        found.append(observer.belief())
    return found


def greedy(belief: Belief, choices: Sequence[Sequence[int]], rng: np.random.Generator) -> int:
    """The number of the choice that is expected to tell most about the mechanisms; chance decides among equal ones.

    Args:
        choices: states of the trigger links after each action that may be done.
    """
    worth = np.array([belief.information(one) for one in choices])
    best = np.flatnonzero(worth > worth.max() - ALIKE)
    return int(best[int(rng.integers(len(best)))])
