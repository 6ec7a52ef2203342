"""One board's causes as a model tells them, beside the truth and beside what the recording determines.

For evaluators only. `causes_summary` makes figures of many boards.

- *Parents* are directed pairs of objects, links collapsed: triggers and, where a responder may move another one, pairs
  of responders. At the level of links the rows are trigger links and responders; a model's links are clusters of
  contacts, which stand for the true links that they share most actions with (Kuhn 1955, one to one).
- *Mechanisms* are asked for by a tour (`what_if`), their kinds and lags are compared where a model tells them.
- The *bound* is what the exact observer (`upper_bound`) knows of the true states that the same actions led to. It is
  there where the recording knows states and the observer's space, which somebody can list, explains them.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from busybot.boards.dynamics import Dynamics, DynamicState, Links
from busybot.boards.mechanisms.rest import Rest
from busybot.boards.spec import BODY, PAPER, BoardSpec, LinkRef
from busybot.boards.true_causes import relations_at
from busybot.boards.worlds import DIRECT, WORLDS, links_of
from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.episodes.episode import Episode
from busybot.objects.library import Library
from busybot.reason.evaluation.decoders import StateReadout
from busybot.reason.evaluation.ground_truth import CauseTruth, causes_of, trace_of
from busybot.reason.evaluation.hypotheses import NOTHING, Hypothesis, Stages, board_space, lag_of
from busybot.reason.evaluation.rewirings import (
    ChangeBelief,
    JudgedRewirings,
    Rewired,
    first_steps,
    judge_rewirings,
    shown_rewirings,
)
from busybot.reason.evaluation.upper_bound import Belief, Observer
from busybot.reason.evaluation.what_if import Pairs, Questions, contacts_of, pairs, told_rightly, tour
from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.base import InferredGraph, InferredLinks, Reasoner, imagine

ACTIONS = 40
"""Discovery is followed for so many actions."""
CLAIMED = 0.5
"""The exact observer claims what is more probable than not."""


@dataclass(frozen=True)
class JudgedMechanism:
    """What decides one responder, and who knows it; None where nobody could be asked.

    Attributes:
        responder: index of the object.
        kind: of its mechanism, "rest" if nothing moves it; the paper's kinds are one.
        driven: whether it has inputs.
        right, bound: whether the model, and the exact observer, foretell it on the whole tour.
        kind_right, kind_bound, lag_right, lag_bound: whether they name its kind and its lag.
        asked: whether each of its inputs took more than one state on the tour; else nobody is right, knowing or not.
        met: whether the observed actions brought each of its inputs into all the states that it takes on the tour.
    """

    responder: int
    kind: str
    driven: bool
    right: bool | None = None
    bound: bool | None = None
    kind_right: bool | None = None
    kind_bound: bool | None = None
    lag_right: bool | None = None
    lag_bound: bool | None = None
    asked: bool = True
    met: bool = True


@dataclass(frozen=True)
class JudgedCauses:
    """A board of N objects, followed for K actions.

    Attributes:
        candidates: bool (N, N), pairs that are judged.
        true: bool (K + 1, N, N), the parents after so many actions; a rewiring changes them.
        probabilities: float (K + 1, N, N), the model's.
        claimed: bool (K + 1, N, N), what the model claims.
        bound: bool (K + 1, N, N), what the exact observer claims; None without one.
        observed: float (K + 1, N, N), his probabilities; None without one.
        links, links_bound: int (K + 1, N, 3), at the level of links for each responder how many parents are rightly
            claimed, claimed and true; None where links are not told, or there is no observer.
        links_silent: the same with no link claimed, where links are not told; it counts if they are on other boards.
        mechanisms: of the responders that show in the first frame.
        told: bool (P, 2, N), whether the model told of each responder what happened, and what had happened without an
            action, in each pair of questions; True for what is not asked. None where it cannot be asked.
        unlucky: bool (P, N), see `what_if.Pairs`; of what is asked.
        exchanged: bool (P, N), whose mechanism had been exchanged when what was asked about ended.
        rewired: whether changed mechanisms are found; None where nobody knows the states.
        spurious: int (K + 1, 2), pairs of objects, and of links and objects, that are claimed besides, of objects that
            are not there (`proposed`); None where all objects were given.
    """

    candidates: np.ndarray
    true: np.ndarray
    probabilities: np.ndarray
    claimed: np.ndarray
    bound: np.ndarray | None = None
    observed: np.ndarray | None = None
    links: np.ndarray | None = None
    links_bound: np.ndarray | None = None
    links_silent: np.ndarray | None = None
    mechanisms: tuple[JudgedMechanism, ...] = ()
    told: np.ndarray | None = None
    unlucky: np.ndarray | None = None
    exchanged: np.ndarray | None = None
    rewired: JudgedRewirings | None = None
    spurious: np.ndarray | None = None


@dataclass(frozen=True)
class Watched:
    """A recording as it is judged. What does not depend on who is judged is found out once.

    Attributes:
        actions: of all T steps, as of `observation.pushes_of`.
        acted: of all T steps, as of `BoardSequence`.
        judged: bool (N,), responders that show in the first frame.
        images: how many were observed when mechanisms are asked about.
        library: the board's objects; in the paper's world the board tells what is needed of them.
        sequence, judge: with what features reasoners are asked about mechanisms, and what reads their answers as
            states; None for models that infer a graph alone.
        detected: int (T + 1, L) and (T + 1, N), states of trigger links and objects that the exact observer is told in
            place of the true ones; None for the true ones.
        error: probability that a responder's detected state is wrong.
    """

    episode: Episode
    actions: np.ndarray
    acted: np.ndarray
    judged: np.ndarray
    images: int
    library: Library | None = None
    sequence: BoardSequence | None = None
    judge: StateReadout | None = None
    detected: tuple[np.ndarray, np.ndarray] | None = None
    error: float = 0.0

    @property
    def steps(self) -> int:
        """How many actions were observed."""
        return min(self.images - 1, len(self.episode.steps))

    @property
    def followed(self) -> int:
        """K, for how many actions a model is followed: those of discovery, and all that were observed."""
        return min(len(self.episode.steps), max(ACTIONS, self.images - 1))

    def ask(self, reasoner: Reasoner | None, questions: Questions) -> np.ndarray | None:
        """Whether each responder is told rightly, bool (Q, N); None if nobody can be asked."""
        if reasoner is None or self.sequence is None or self.judge is None:
            return None
        seen = self.sequence.first(self.images)
        told = imagine(reasoner, seen, questions.steps, questions.actions, questions.acted)
        read = self.judge.read(told.reshape(-1, *told.shape[2:]))
        return told_rightly(read.reshape(*told.shape[:2], -1), questions)

    @cached_property
    def candidates(self) -> np.ndarray:
        """See `JudgedCauses`."""
        return candidates_of(self.episode.board)

    @cached_property
    def true(self) -> np.ndarray:
        """See `JudgedCauses`."""
        board = self.episode.board
        return (
            np.array([parents_at(board, max(0, number - 1)) for number in range(self.followed + 1)]) & self.candidates
        )

    @cached_property
    def replayed(self) -> "_Replayed | None":
        """See `_replayed`."""
        return _replayed(self)

    @cached_property
    def observed(self) -> "_Observed | None":
        """See `_observed`; None where nothing can be replayed, either."""
        if self.replayed is None:
            return None
        triggers, shown = self.detected or (self.replayed.triggers, self.replayed.shown)
        return _observed(replace(self.replayed, triggers=triggers, shown=shown), self.followed, self.error)

    @cached_property
    def bound(self) -> np.ndarray | None:
        """See `JudgedCauses`."""
        return None if self.observed is None else (self.observed.objects > CLAIMED) & self.candidates

    @cached_property
    def shown_rewirings(self) -> list[Rewired]:
        """See `rewirings.shown_rewirings`; of what was replayed."""
        assert self.replayed is not None
        return shown_rewirings(self.replayed.dynamics, self.replayed.triggers, self.replayed.states)

    @cached_property
    def controlled(self) -> np.ndarray:
        """bool (N,), whose answers to pairs of questions count: what a link controls; of what was replayed."""
        assert self.replayed is not None
        truth = causes_of(self.episode.board, self.replayed.law.links, max(0, self.steps - 1))
        return np.asarray(self.judged & truth.link_parents.any(0))

    @cached_property
    def pairs(self) -> Pairs | None:
        """See `what_if.pairs`; of what was replayed."""
        assert self.replayed is not None
        replayed, actions = self.replayed, self.actions[: self.steps]
        observed = (replayed.triggers, replayed.states)
        return pairs(replayed.dynamics, self.episode, actions, self.acted, *observed, self.controlled)

    @cached_property
    def asked(self) -> "_Asked":
        """What is asked about mechanisms, of what was replayed."""
        assert self.replayed is not None
        return _asked(self, self.replayed)


def candidates_of(board: BoardSpec) -> np.ndarray:
    """bool (N, N): what may be a parent of what. Responders may where the board's world lets one follow another."""
    roles = np.array([placed.role for placed in board.objects], str)
    responders = roles == "responder"
    found = (roles == "trigger")[:, None] & responders[None]
    world = WORLDS.get(board.world)
    if (world is not None and world.follows) or any(
        ref.link == BODY for one in board.relations for ref in one.triggers
    ):
        found |= responders[:, None] & responders[None] & ~np.eye(len(roles), dtype=bool)
    return found


def parents_at(board: BoardSpec, action: int) -> np.ndarray:
    """bool (N, N), object pairs, of the relations that decide what shows after that action."""
    found = np.zeros((len(board.objects),) * 2, bool)
    for relation in relations_at(board, action + 1):
        for trigger in relation.triggers:
            found[trigger.object, relation.responder] = True
    return found


def judge_causes(
    watched: Watched,
    graph: InferredGraph,
    reasoner: Reasoner | None = None,
    early: Mapping[int, InferredGraph] | None = None,
) -> JudgedCauses:
    """Compare what a model tells of a recorded board with the truth.

    Args:
        graph: inferred from at least the observed images; it is followed step by step.
        reasoner: who is asked about mechanisms; None for a model that infers a graph alone.
        early: what is believed after some numbers of actions by who has seen no more; elsewhere `graph` tells it,
            which may have found objects' links and looks in later pictures.
    """
    board, numbers = watched.episode.board, range(watched.followed + 1)
    early = {number: one for number, one in (early or {}).items() if number in numbers}
    after = [early.get(number, graph) for number in numbers]
    claimed = np.array([one.claimed(number) for number, one in enumerate(after)]) & watched.candidates
    links = _links_after(watched, graph, early, claimed)
    judged = JudgedCauses(
        watched.candidates,
        watched.true,
        np.array([one.after(number) for number, one in enumerate(after)], np.float32),
        claimed,
        links=None if graph.links is None else links,
        links_silent=links if graph.links is None else None,
    )
    if watched.replayed is None:
        return judged
    known, said = None, None
    if watched.observed is not None:
        known = watched.observed.changes
        told = watched.observed
        judged = replace(judged, bound=watched.bound, observed=told.objects, links_bound=told.links)
    if graph.changed is not None and graph.changed_at is not None:
        said = ChangeBelief(graph.changed, graph.changed_at)
    changes = judge_rewirings(board, watched.shown_rewirings, watched.judged, watched.followed, said, known)
    return _with_mechanisms(replace(judged, rewired=changes), watched, graph, reasoner)


def link_names(episode: Episode) -> tuple[LinkRef, ...]:
    """What may be a parent at the level of links: the trigger links in the board's order, then the responders."""
    links = tuple(LinkRef(object=link.object, link=link.name) for link in episode.links if link.trigger)
    objects = enumerate(episode.board.objects)
    return links + tuple(LinkRef(object=index, link=BODY) for index, one in objects if one.role == "responder")


def true_links(board: BoardSpec, names: Sequence[LinkRef], action: int) -> np.ndarray:
    """bool (I, N): which of these are parents of what shows after the action of that number."""
    place = {name: number for number, name in enumerate(names)}
    found = np.zeros((len(names), len(board.objects)), bool)
    for relation in relations_at(board, action + 1):
        for trigger in relation.triggers:
            if trigger in place:
                found[place[trigger], relation.responder] = True
    return found


def held_links(episode: Episode) -> np.ndarray:
    """The true link that each action held, int (T,), by its place among `link_names`; -1 for none."""
    place = {(name.object, name.link): number for number, name in enumerate(link_names(episode))}
    return np.array([place.get((step.acted_object, step.acted_link), -1) for step in episode.steps], int)


def matched_links(clusters: np.ndarray, held: np.ndarray, links: int) -> dict[int, int]:
    """The true link that each cluster of contacts stands for: one to one, so that most actions agree.

    Args:
        clusters: int (T,), of each action, -1 for none.
        held: int (T,), the link that it truly held, -1 for none.
        links: how many there are.

    Returns:
        links by cluster; clusters that share no action with the link that is left for them have none.
    """
    from scipy.optimize import linear_sum_assignment  # slow to load

    both = (clusters >= 0) & (held >= 0)
    shared = np.zeros((int(clusters.max(initial=-1)) + 1, links), int)
    np.add.at(shared, (clusters[both], held[both]), 1)
    pairs_ = zip(*linear_sum_assignment(shared, maximize=True), strict=True)
    return {int(cluster): int(link) for cluster, link in pairs_ if shared[cluster, link]}


def _links_after(
    watched: Watched, graph: InferredGraph, early: Mapping[int, InferredGraph], claimed: np.ndarray
) -> np.ndarray:
    """See `count_links`; after some numbers of actions a graph of its own tells of links. Who is silent claims none."""
    numbers = [number for number in range(len(claimed)) if number not in early]
    counts = np.zeros((*claimed.shape[:2], 3), int)
    none = InferredLinks(np.full(len(watched.episode.steps), -1), np.zeros((1, 0, claimed.shape[1])))
    for one, own in [(graph, numbers), *((one, [number]) for number, one in early.items())]:
        counts[own] = count_links(watched.episode, one.links or none, one.threshold, claimed, watched.candidates, own)
    return counts


def count_links(
    episode: Episode,
    told: InferredLinks,
    threshold: float,
    claimed: np.ndarray,
    candidates: np.ndarray,
    numbers: Sequence[int] | None = None,
) -> np.ndarray:
    """Parents at the level of links, int (K + 1, N, 3), as `JudgedCauses.links`.

    A cluster that stands for no link is a parent that is not there. Responders are parents as the graph claims them.

    Args:
        threshold: a parent is claimed when its probability exceeds this.
        claimed: bool (K + 1, N, N), pairs of objects.
        candidates: bool (N, N), pairs of which one may be the other's parent: who has no such pair is no link's child.
        numbers: of actions, to count after these alone; the result then has a row for each.
    """
    names, held = link_names(episode), held_links(episode)
    length, links = min(len(held), len(told.clusters)), sum(name.link != BODY for name in names)
    match = matched_links(told.clusters[:length], held[:length], links)
    responders = [name.object for name in names[links:]]
    numbers = range(len(claimed)) if numbers is None else numbers
    counts = np.zeros((len(numbers), claimed.shape[1], 3), int)
    for row, number in enumerate(numbers):
        said = (told.after(number) > threshold) & candidates.any(0)  # (clusters, N)
        nowhere = [cluster for cluster in range(len(said)) if cluster not in match]
        mine = np.concatenate([np.zeros((links, claimed.shape[1]), bool), claimed[number, responders]])
        for cluster, link in match.items():
            mine[link] = said[cluster]
        counts[row] = count_parents(mine, true_links(episode.board, names, max(0, number - 1)))
        counts[row, :, 1] += said[nowhere].sum(0)
    return counts


def count_parents(claimed: np.ndarray, true: np.ndarray) -> np.ndarray:
    """int (N, 3): rightly claimed, claimed and true parents of each object, from bool (I, N)."""
    return np.stack([(claimed & true).sum(0), claimed.sum(0), true.sum(0)], axis=1)


@dataclass(frozen=True)
class Law:
    """What a board's objects say about its links and responders.

    Attributes:
        stages: of each responder, what it can be; None if nobody knows.
    """

    links: Links
    stages: tuple[Stages, ...] | None


def law_of(episode: Episode, library: Library | None) -> Law | None:
    """Links and responders of a board; None where nobody knows how many states its links have."""
    board = episode.board
    if library is not None:
        models = [library.get(placed.key) for placed in board.objects]
        effects = [model.effect for model in models if model.effect is not None]
        return Law(links_of(models), tuple((one.single is not None, one.multi is not None) for one in effects))
    if board.world != PAPER:
        return None
    sizes = {
        trigger: len(relation.states)
        for relation in board.relations
        if len(relation.triggers) == 1
        for trigger in relation.triggers
    }
    names = [name for name in link_names(episode) if name.link != BODY]
    found = tuple(max(2, sizes.get(name, 2)) for name in names)
    return Law(Links(tuple((name.object, name.link) for name in names), found), None)


@dataclass(frozen=True)
class _Replayed:
    """A recording whose states follow the board's law. T steps, L links, N objects, R responders.

    Attributes:
        triggers, shown: int (T + 1, L) and (T + 1, N).
        states: of the board, new and after each step.
        responders: indices of these objects.
        steps: observed actions.
    """

    board: BoardSpec
    law: Law
    dynamics: Dynamics
    triggers: np.ndarray
    shown: np.ndarray
    states: list[DynamicState]
    responders: list[int]
    names: tuple[LinkRef, ...]
    steps: int


def _replayed(watched: Watched) -> _Replayed | None:
    """None where nobody knows the states, or where they are not what the board's law makes of the actions."""
    episode, board = watched.episode, watched.episode.board
    law, trace = law_of(episode, watched.library), trace_of(episode)
    if law is None or trace is None:
        return None
    triggers, shown = trace
    try:
        dynamics = Dynamics(board, law.links)
        states = dynamics.run(triggers.tolist())
    except (BusybotError, IndexError):
        return None
    if not np.array_equal(np.array([state.shown for state in states]), shown):
        return None
    responders = [index for index, placed in enumerate(board.objects) if placed.role == "responder"]
    return _Replayed(board, law, dynamics, triggers, shown, states, responders, link_names(episode), watched.steps)


@dataclass(frozen=True)
class _Observed:
    """What the exact observer tells, as `JudgedCauses`, and what it believes after the observed actions.

    Attributes:
        objects: float (K + 1, N, N), probabilities of parents.
        links: as `JudgedCauses.links_bound`.
    """

    objects: np.ndarray
    links: np.ndarray
    belief: Belief
    changes: ChangeBelief


def _observed(replayed: _Replayed, count: int, error: float) -> _Observed | None:
    """None where the observer's space does not explain the recording, or nobody can list the space."""
    board, triggers, objects = replayed.board, replayed.triggers, len(replayed.board.objects)
    owners = [name.object for name in replayed.names]
    pairs_, links = np.zeros((count + 1, objects, objects)), np.zeros((count + 1, objects, 3), int)
    changes = ChangeBelief(np.zeros((count, objects)), np.full(objects, -1))
    last = None
    try:
        space, responders = board_space(board, replayed.law.links.sizes, replayed.law.stages)
        shown = replayed.shown[:, responders]
        observer = Observer(space, triggers[0], shown[0], error)
        for number in range(max(count, replayed.steps) + 1):
            if number:
                observer.see(triggers[number], shown[number])
            belief = observer.belief()
            if number <= count:
                pairs_[number][:, responders] = belief.object_parents(owners, objects)
                single = np.zeros((len(owners), objects), bool)
                single[:, responders] = belief.parents() > CLAIMED
                links[number] = count_parents(single, true_links(board, replayed.names, max(0, number - 1)))
                if number:
                    changes.changed[number - 1, responders], changes.changed_at[responders] = belief.changed()
            last = belief if number == replayed.steps else last
    except BusybotError:
        return None
    assert last is not None
    return _Observed(pairs_, links, last, changes)


@dataclass(frozen=True)
class _Asked:
    """What is asked about a board's mechanisms, whoever is asked.

    Attributes:
        walk: the tour.
        mechanisms: of the responders that show in the first frame.
    """

    walk: Questions
    mechanisms: list["_Mechanism"]


def _asked(watched: Watched, replayed: _Replayed) -> _Asked:
    board, steps, links = replayed.board, replayed.steps, replayed.law.links
    truth = causes_of(board, links, max(0, steps - 1))
    contacts = contacts_of(watched.episode, watched.actions, watched.acted, links.sizes)
    past = tuple(one for one in board.rewirings if one.step < steps)
    calm = Dynamics(board.model_copy(update={"rewirings": past}), links, lucky=False)
    now = tuple(int(state) for state in replayed.triggers[steps])
    rng = generator(board.seed, board.split, board.index, "reason/tour")
    walk = tour(calm, now, replayed.states[steps], contacts, steps, rng)
    return _Asked(walk, _mechanisms(watched, truth, walk, replayed))


def _mechanisms(watched: Watched, truth: CauseTruth, walk: Questions, replayed: _Replayed) -> list["_Mechanism"]:
    bounds, found = [_Bound()] * len(replayed.responders), []
    if watched.observed is not None:
        bounds = _bounds(watched.observed.belief, truth, walk, replayed)
    for index, bound in zip(replayed.responders, bounds, strict=True):
        if watched.judged[index]:
            cause, read = _hypothesis(truth, index), truth.read[index]
            asked = _varied(walk, read, replayed)
            known = JudgedMechanism(
                index, cause.kind, bool(cause.inputs), bound=bound.known and asked, kind_bound=bound.kind,
                lag_bound=bound.lag, asked=asked, met=_met(walk, read, replayed),
            )  # fmt: skip
            found.append(_Mechanism(known, lag_of(cause, len(replayed.law.links.sizes))))
    return found


def _bounds(belief: Belief, truth: CauseTruth, walk: Questions, replayed: _Replayed) -> list["_Bound"]:
    """Of each responder. A mechanism is known that is claimed and responds as the true one does, asked about or not."""
    found = []
    told = zip(replayed.responders, *belief.mechanisms(), belief.kinds(), belief.lags(), strict=True)
    for index, likeliest, share, kinds, lags in told:
        cause = _hypothesis(truth, index)
        known = bool(share > CLAIMED and _alike(belief, likeliest, cause, index, walk, replayed))
        kind, lag = max(kinds, key=lambda one: kinds[one]), max(lags, key=lambda one: lags[one])
        found.append(_Bound(known, kind == cause.kind, lag == lag_of(cause, len(replayed.law.links.sizes))))
    return found


@dataclass(frozen=True)
class _Bound:
    """What the exact observer knows of a responder, as `JudgedMechanism`, asked about it or not."""

    known: bool | None = None
    kind: bool | None = None
    lag: bool | None = None


@dataclass(frozen=True)
class _Mechanism:
    """What is known of a responder's mechanism before a model is asked, and its lag."""

    known: JudgedMechanism
    lag: int


def _with_mechanisms(
    judged: JudgedCauses, watched: Watched, graph: InferredGraph, reasoner: Reasoner | None
) -> JudgedCauses:
    asked = watched.asked
    right = watched.ask(reasoner, asked.walk)
    if right is not None:
        judged = _with_pairs(judged, watched, reasoner)
    mechanisms = []
    for one in asked.mechanisms:
        index = one.known.responder
        mechanisms.append(
            replace(
                one.known,
                right=None if right is None else bool(right[0, index] and one.known.asked),
                kind_right=None if graph.kinds is None else _paper_name(graph.kinds[index]) == one.known.kind,
                lag_right=None if graph.lags is None else int(graph.lags[index]) == one.lag,
            )
        )
    return replace(judged, mechanisms=tuple(mechanisms))


def _with_pairs(judged: JudgedCauses, watched: Watched, reasoner: Reasoner | None) -> JudgedCauses:
    """What a model that can be asked answers to pairs of questions."""
    pairs_, nobody = watched.pairs, np.zeros((0, len(watched.controlled)), bool)
    if pairs_ is None:
        return replace(judged, told=nobody[:, None].repeat(2, axis=1), unlucky=nobody, exchanged=nobody)
    answers = [watched.ask(reasoner, questions) for questions in (pairs_.happened, pairs_.otherwise)]
    told = np.stack([one | ~watched.controlled for one in answers if one is not None], axis=1)
    exchanged = np.zeros(pairs_.unlucky.shape, bool)
    for responder, action in first_steps(watched.episode.board).items():
        exchanged[:, responder] = pairs_.after(action)
    return replace(judged, told=told, unlucky=pairs_.unlucky & watched.controlled, exchanged=exchanged)


def _hypothesis(truth: CauseTruth, index: int) -> Hypothesis:
    return Hypothesis(truth.mechanisms[index] or Rest(sizes=(), table=(0,)), truth.read[index])


def _varied(walk: Questions, read: Sequence[int], replayed: _Replayed) -> bool:
    """Whether all of these inputs took more than one state on the tour: else nobody was asked about them."""
    return all(column.min() < column.max() for column in _columns(walk.triggers[0], walk.shown[0], read, replayed))


def _met(walk: Questions, read: Sequence[int], replayed: _Replayed) -> bool:
    """Whether each of these inputs was, in the observed frames, in all the states that it takes on the tour."""
    asked = _columns(walk.triggers[0], walk.shown[0], read, replayed)
    seen = _columns(replayed.triggers[: replayed.steps + 1], replayed.shown[: replayed.steps + 1], read, replayed)
    return all(np.isin(one, other).all() for one, other in zip(asked, seen, strict=True))


def _columns(triggers: np.ndarray, shown: np.ndarray, read: Sequence[int], replayed: _Replayed) -> Iterator[np.ndarray]:
    """States of these inputs in all frames, from those of links (T, L) and objects (T, N)."""
    links = triggers.shape[1]
    return (triggers[:, one] if one < links else shown[:, replayed.names[one].object] for one in read)


def _alike(
    belief: Belief, likeliest: Hypothesis, cause: Hypothesis, index: int, walk: Questions, replayed: _Replayed
) -> bool:
    """Whether a mechanism responds as the true one does."""
    if belief.space.meaning_of(likeliest) == belief.space.meaning_of(cause):
        return True
    triggers = np.concatenate([replayed.triggers[: replayed.steps + 1], walk.triggers[0, 1:]])
    shown = np.concatenate([replayed.shown[: replayed.steps + 1], walk.shown[0, 1:]])
    before = np.concatenate([shown[:1], shown[:-1]])[:, replayed.responders]
    inputs = np.concatenate([triggers, before], axis=1)[:, list(likeliest.inputs)]
    read = np.minimum(inputs, np.array(likeliest.mechanism.sizes, int) - 1)
    state, memory = likeliest.mechanism.start(tuple(read[0].tolist()))
    told = [state]
    for row in read[1:]:
        state, memory = likeliest.mechanism.step(tuple(row.tolist()), memory, None)
        told.append(state)
    asked = slice(replayed.steps + 1, None)
    return told[asked] == shown[asked, index].tolist()


def _paper_name(kind: str) -> str:
    """The paper's kinds of following one link are one; who says nothing says that nothing moves it."""
    return DIRECT if kind.startswith("one-to-many") else kind or NOTHING
