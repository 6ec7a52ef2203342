"""Rows without learning of the table of worlds: what they see of a board, what they claim, and how they are tuned.

All rows see what pictures tell: which objects changed by their pixels, looks of responders as clusters of features,
and links by the pixels that their moves change (`inputs.trigger_links`, over all actions of the board). The exact
observer on what is detected is told states in place of these: an evaluator names clusters and looks by the true link
and state that they mostly are.

PC and Granger are those of causal-learn, from the extra `causal`. Both know which action took hold of which link, that
nothing causes an action, and that causes do not follow their effects: links, now and some actions ago, and in worlds in
which responders may follow each other also the responders one action ago. Granger's regression has all variables,
whatever may be a cause. Both see changes or states, whichever does better on training boards.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from busybot.boards.spec import BODY
from busybot.common.frozen_model import FrozenModel
from busybot.episodes.episode import Episode
from busybot.reason.evaluation.causes import candidates_of, link_names, matched_links, parents_at
from busybot.reason.evaluation.decoders import NearestState, judged_objects
from busybot.reason.evaluation.ground_truth import trace_of
from busybot.reason.inputs.object_masks import ChangeConfig, count_pixels
from busybot.reason.inputs.observation import observe_episode
from busybot.reason.inputs.sequence import BoardSequence, clusters_of, sequence_of, threshold_of
from busybot.reason.models.base import InferredGraph, InferredLinks
from busybot.reason.models.counting import CountConfig, PcConfig, adjacent, count_changes
from busybot.reason.models.lookup import LookupConfig

ACTIONS = (10, 22, 30)
"""Rows are judged after so many."""
ENCODER = "embedded"


@dataclass(frozen=True)
class Seen:
    """One board. T actions, N objects.

    Attributes:
        changed: bool (T, N), whether enough pixels of each object changed.
        looks: int (T + 1, N), label-free, 0 at first; 0 throughout for objects without features.
        held: int (T,), the trigger link that was truly held, -1 for none; for evaluators.
        links: how many trigger links there are; for evaluators.
    """

    episode: Episode
    sequence: BoardSequence
    changed: np.ndarray
    looks: np.ndarray
    held: np.ndarray
    links: int

    @staticmethod
    def of(episode: Episode, features: np.ndarray) -> "Seen":
        observed, config = observe_episode(episode), ChangeConfig()
        pixels, area = count_pixels(observed, config)
        sequence = sequence_of(observed, features)
        looks = clusters_of(sequence.features, threshold_of(ENCODER)).clip(0)
        names = [(name.object, name.link) for name in link_names(episode) if name.link != BODY]
        place = {name: number for number, name in enumerate(names)}
        held = np.array([place.get((step.acted_object, step.acted_link), -1) for step in episode.steps], int)
        changed = pixels > np.maximum(config.least, config.share * area)
        return Seen(episode, sequence, changed, looks, held, len(names))

    @property
    def responders(self) -> np.ndarray:
        return np.flatnonzero(self.sequence.responders)

    @property
    def clusters(self) -> np.ndarray:
        """int (T,), the link that each action took hold of as far as pictures tell, -1 for none."""
        return self.sequence.links.clusters

    def detected_rightly(self, clusters: np.ndarray, told: tuple[np.ndarray, np.ndarray]) -> tuple[float, float, float]:
        """Share of actions whose cluster stands for the link that they held, and of states of links and responders that
        are `detected`."""
        trace = trace_of(self.episode)
        assert trace is not None
        match = matched_links(clusters, self.held, self.links)
        same = [match.get(int(one), -1) == link for one, link in zip(clusters, self.held, strict=True)]
        right = np.equal(told[1], trace[1])[:, self.responders]
        return float(np.mean(same)), float(np.equal(told[0], trace[0]).mean()), float(right.mean())


class Tuned(FrozenModel):
    """What was chosen on training boards.

    Attributes:
        error: probability that a detected state of a responder is wrong, for the exact observer.
        counting, lookup: of these two.
    """

    error: float = 0.01
    counting: CountConfig = CountConfig()
    lookup: LookupConfig = LookupConfig()


class DiscoveryConfig(FrozenModel):
    """What a method of causal discovery is given.

    Attributes:
        states: it sees states, not changes.
        lags: actions that lie so far back at most are causes.
        level: significance level of PC's tests; the least coefficient, between standardised variables, that Granger
            claims.
        condition: PC conditions on so many variables at most.
    """

    states: bool = False
    lags: int = 0
    level: float = 0.05
    condition: int = 1


def counted(seen: Seen, clusters: np.ndarray, config: CountConfig) -> InferredGraph:
    """`count`, of objects as it is shipped, and by the same rule of clusters of contacts."""
    sequence, objects, links = seen.sequence, seen.changed.shape[1], int(clusters.max(initial=-1)) + 1
    triggers = np.flatnonzero(sequence.triggers)
    probabilities = count_changes(seen.changed, sequence.acted, triggers, seen.responders, config)
    wider = np.concatenate([seen.changed, np.zeros((len(clusters), links), bool)], axis=1)
    acted = np.where(clusters >= 0, objects + clusters, -1)
    single = count_changes(wider, acted, objects + np.arange(links), seen.responders, config)[:, objects:, :objects]
    prior = sequence.candidates * config.controlled / max(1, len(triggers))
    return InferredGraph("count", probabilities, config.claimed, prior, InferredLinks(clusters, single))


@dataclass(frozen=True)
class Samples:
    """What causal discovery sees of the first actions. n samples, K links, R responders.

    Attributes:
        links: int (n + 1, K), before and after each action; of changes, whether each was held.
        shown: int (n + 1, R), the same of responders.
        follows: whether responders may follow each other.
    """

    links: np.ndarray
    shown: np.ndarray
    follows: bool

    @staticmethod
    def of(seen: Seen, clusters: np.ndarray, actions: int, states: bool) -> "Samples":
        held = np.equal.outer(clusters, np.arange(int(clusters.max(initial=-1)) + 1))
        held, responders = np.concatenate([np.zeros_like(held[:1]), held]), seen.responders
        shown = np.concatenate([np.zeros((1, len(responders)), bool), seen.changed[:, responders]])
        if states:
            held, shown = np.cumsum(held, axis=0) % 2, seen.looks[:, responders]
        candidates = candidates_of(seen.episode.board)
        follows = bool(candidates[np.ix_(responders, responders)].any())
        return Samples(held[: actions + 1].astype(int), shown[: actions + 1].astype(int), follows)

    def causes(self, lags: int) -> np.ndarray:
        """int (n, (lags + 1) K + R or 0), the links after this action and those before it, then the responders before
        it."""
        count = len(self.links) - 1
        late = [self.links[np.maximum(np.arange(1, count + 1) - lag, 0)] for lag in range(lags + 1)]
        return np.concatenate([*late, *([self.shown[:-1]] if self.follows else [])], axis=1)


def pc(samples: Samples, config: DiscoveryConfig) -> np.ndarray:
    """bool (K + R, R), what causes what: adjacent in the graph that PC leaves, whatever the lag."""
    causes = samples.causes(config.lags)
    found = adjacent(causes, samples.shown[1:], PcConfig(alpha=config.level, condition=config.condition))
    return _joined(found, samples, config.lags)


def granger(samples: Samples, config: DiscoveryConfig) -> np.ndarray:
    """float (K + R, R), the largest coefficient of any lag in a sparse regression on the past (Granger 1969)."""
    from causallearn.search.Granger.Granger import Granger  # from the extra `causal`

    # a link's state after an action stands beside the responders' states before it: no cause is simultaneous
    ahead = np.concatenate([samples.links[1:], samples.links[-1:]])
    data = np.concatenate([ahead, samples.shown], axis=1).astype(float)
    spread = data.std(0)
    data = (data - data.mean(0)) / np.where(spread > 0, spread, 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = Granger(maxlag=config.lags + 1).granger_lasso(data)
    links, variables = samples.links.shape[1], data.shape[1]
    strongest = np.abs(found).reshape(variables, config.lags + 1, variables).max(1).T[:, links:]
    strongest[links:] *= samples.follows
    return strongest


def _joined(found: np.ndarray, samples: Samples, lags: int) -> np.ndarray:
    """bool (K + R, R) from bool ((lags + 1) K + R or 0, R)."""
    links, responders = samples.links.shape[1], samples.shown.shape[1]
    of_links = found[: (lags + 1) * links].reshape(lags + 1, links, responders).any(0)
    late = found[(lags + 1) * links :] if samples.follows else np.zeros((responders, responders), bool)
    return np.concatenate([of_links, late])


Method = Callable[[Samples, DiscoveryConfig], np.ndarray]
METHODS: dict[str, Method] = {"pc": pc, "granger": granger}


def strengths(
    seen: Seen, clusters: np.ndarray, method: str, config: DiscoveryConfig, after: Sequence[int] = ACTIONS
) -> dict[int, np.ndarray]:
    """float (K + R, R), what a method says of each pair after so many actions."""
    told = {}
    for actions in after:
        links, responders = int(clusters.max(initial=-1)) + 1, len(seen.responders)
        told[actions] = np.zeros((links + responders, responders))
        samples = Samples.of(seen, clusters, actions, config.states)
        used = np.flatnonzero(samples.links.any(0))  # the others have not been held yet
        fewer = replace(samples, links=samples.links[:, used])
        told[actions][[*used, *range(links, links + responders)]] = METHODS[method](fewer, config)
    return told


def discovered(
    seen: Seen, clusters: np.ndarray, name: str, told: dict[int, np.ndarray], config: DiscoveryConfig
) -> InferredGraph:
    """The graph of a method, by `strengths`, with its links; an object is a parent where one of its links is."""
    steps, objects, links = seen.sequence.steps, seen.changed.shape[1], int(clusters.max(initial=-1)) + 1
    owner = np.array([seen.sequence.acted[clusters == number][0] for number in range(links)], int)
    threshold = config.level if name == "granger" else 0.5
    graph, single = np.zeros((steps, objects, objects)), np.zeros((steps, links, objects))
    for actions, strength in told.items():
        for after in range(actions, steps + 1):
            single[after - 1][:, seen.responders] = strength[:links]
            graph[after - 1] = 0
            graph[after - 1][np.ix_(seen.responders, seen.responders)] = strength[links:]
            np.maximum.at(graph[after - 1], owner, single[after - 1])
    return InferredGraph(name, graph, threshold, links=InferredLinks(clusters, single))


def detected(seen: Seen, clusters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States of trigger links, int (T + 1, L), and of all objects, int (T + 1, N), as far as pictures tell."""
    trace = trace_of(seen.episode)
    assert trace is not None
    triggers, shown = trace
    links = np.repeat(triggers[:1], len(triggers), axis=0)
    for cluster, link in matched_links(clusters, seen.held, seen.links).items():
        own = seen.sequence.links.states[:, cluster]
        meant = {state: np.bincount(triggers[own == state, link]).argmax() for state in set(own.tolist())}
        links[:, link] = [meant[state] for state in own.tolist()]
    judged = judged_objects(observe_episode(seen.episode))
    read = NearestState(seen.sequence.features, seen.looks, shown, judged).read(seen.sequence.features)
    return links, np.where(judged, read, shown[:1])


def f1_of(pairs: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    """Of claimed and true parents, bool arrays, pooled."""
    hits = sum((claimed & true).sum() for claimed, true in pairs)
    both = sum(claimed.sum() + true.sum() for claimed, true in pairs)
    return float(2 * hits / both) if both else 0.0


def tuned(boards: Sequence[Seen]) -> Tuned:
    """Constants that do best on training boards: for parents by F1 of objects over `ACTIONS` together. Methods of
    discovery, `lookup` and the observer's error are left as they are."""
    return Tuned(counting=_tuned_count(boards))


def _tuned_count(boards: Sequence[Seen]) -> CountConfig:
    best: tuple[float, CountConfig] = (-1, CountConfig())
    for controlled, effect, noise in product(
        (0.5, 0.8), ((1.5, 1.0), (1.0, 2.0), (1.0, 5.0)), ((1.0, 5000.0), (1.0, 100.0), (1.0, 20.0), (1.0, 5.0))
    ):
        config = CountConfig(controlled=controlled, effect=effect, noise=noise)
        graphs = [_count_objects(seen, config) for seen in boards]
        for claimed in (0.03, 0.1, 0.2, 0.3, 0.5):
            pairs = [pair for graph, seen in zip(graphs, boards, strict=True) for pair in _pairs(graph, seen, claimed)]
            best = max(best, (f1_of(pairs), config.model_copy(update={"claimed": claimed})), key=lambda one: one[0])
    return best[1]


def _count_objects(seen: Seen, config: CountConfig) -> np.ndarray:
    triggers = np.flatnonzero(seen.sequence.triggers)
    return count_changes(seen.changed, seen.sequence.acted, triggers, seen.responders, config)


def _pairs(graph: np.ndarray, seen: Seen, threshold: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Claimed and true parents after each of `ACTIONS`."""
    board = seen.episode.board
    candidates = candidates_of(board)
    return [
        ((graph[actions - 1] > threshold) & candidates, parents_at(board, actions - 1) & candidates)
        for actions in ACTIONS
    ]


def tuned_discovery(boards: Sequence[Seen], name: str) -> DiscoveryConfig:
    """The constants of `pc` or `granger` that do best on training boards, after 22 actions."""
    is_pc, clusters = name == "pc", [seen.clusters for seen in boards]
    tests = product((0.05, 0.2), (0, 1)) if is_pc else [(0.0, 0)]
    best: tuple[float, DiscoveryConfig] = (-1, DiscoveryConfig())
    for (level, condition), states, lags in product(tests, (False, True), (0, 2)):
        config = DiscoveryConfig(states=states, lags=lags, level=level, condition=condition)
        graphs = [
            discovered(seen, own, name, strengths(seen, own, name, config, (22,)), config).probabilities
            for seen, own in zip(boards, clusters, strict=True)
        ]
        for claimed in (0.5,) if is_pc else (0.05, 0.1, 0.2, 0.3, 0.5, 0.7):
            pairs = [_pairs(graph, seen, claimed)[1] for graph, seen in zip(graphs, boards, strict=True)]
            chosen = config if is_pc else config.model_copy(update={"level": claimed})
            best = max(best, (f1_of(pairs), chosen), key=lambda one: one[0])
    return best[1]
