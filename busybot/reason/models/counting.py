"""Graphs from which objects changed in which steps, without training: counting, and the competitor PC.

Counting, the simplest reasoner: responder j depends on trigger i when j changes
in the steps that acted on i and not in the others. For each responder the hypotheses are
"no trigger" and "trigger i" for every i, at most one trigger per responder as on the paper's boards. Under "trigger i"
the responder changes at one unknown rate in the steps that acted on i and at another, the noise rate, in all others;
under "no trigger" at the noise rate everywhere. Both rates have Beta priors, so the likelihood of what was seen is a
ratio of Beta functions, and Bayes' rule gives edge probabilities.

PC is constraint-based causal discovery with G-squared tests (causal-learn, from the extra `causal`), on what counting
sees. Variables of a step are "trigger i was acted on" and "responder j changed", one sample for each step. It is known
that nothing causes an action. An edge is claimed where PC leaves trigger and responder adjacent and the responder
changes more often when the trigger is acted on. Probabilities are 0 or 1: PC gives none. A step acts on one trigger, so
the actions determine each other, which PC's assumption of faithfulness excludes: given the other triggers, an action
has nothing left to explain, and full PC removes true edges. Without conditioning (`condition` 0) this does not happen,
and what remains are tests of every pair by itself.

A step after which *nothing* looks different says only that its action failed; both leave it out.
"""

import warnings
from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.special import betaln, softmax

from busybot.common.errors import needs_extra
from busybot.common.frozen_model import FrozenModel
from busybot.reason.inputs.object_masks import ChangeConfig, changes
from busybot.reason.inputs.observation import ObservedEpisode, acted_objects
from busybot.reason.models.base import InferredGraph

Weight = Annotated[float, Field(gt=0, le=1e9)]


class CountConfig(FrozenModel):
    """Priors of the counting inference.

    Attributes:
        controlled: probability that a responder has a trigger at all (about half of them have, on training boards).
        effect: Beta(a, b) of the rate of change in steps that acted on the trigger. Wide, because a trigger with
            several links changes the responder through one of them only.
        noise: Beta(a, b) of the rate of change in all other steps. Small: on training objects none of 14,000 unchanged
            appearances was taken for a change. Where many are, a larger rate keeps precision up at the cost of recall.
        claimed: an edge is claimed when its probability exceeds this. Where two triggers move a responder together,
            each of them has about half.
        change: when a responder counts as changed.
    """

    controlled: Annotated[float, Field(gt=0, lt=1)] = 0.5
    effect: tuple[Weight, Weight] = (1.5, 1.0)
    noise: tuple[Weight, Weight] = (1.0, 5000.0)
    claimed: Annotated[float, Field(ge=0, lt=1)] = 0.5
    change: ChangeConfig = ChangeConfig()


def count(observed: ObservedEpisode, config: CountConfig | None = None) -> InferredGraph:
    """Edge probabilities after each step.

    Without any step the graph has one entry: the prior.
    """
    config = config or CountConfig()
    changed = changes(observed, config.change)
    probabilities = count_changes(changed, acted_objects(observed), observed.triggers, observed.responders, config)
    prior = np.zeros(probabilities.shape[1:])
    if len(observed.triggers):
        prior[np.ix_(observed.triggers, observed.responders)] = config.controlled / len(observed.triggers)
    return InferredGraph("count", probabilities, config.claimed, prior)


def count_changes(
    changed: np.ndarray, acted: np.ndarray, triggers: np.ndarray, responders: np.ndarray, config: CountConfig
) -> np.ndarray:
    """The inference itself, on discrete facts.

    Args:
        changed: bool (T, N), whether each object changed in each step.
        acted: int (T,), index of the trigger acted on, -1 for none.
        triggers, responders: indices of objects.

    Returns:
        float (max(T, 1), N, N): `[t, i, j]` is the probability that i controls j, from steps 0 to t.
    """
    if not len(changed):
        # a step that says nothing leaves the prior
        changed, acted = np.zeros((1, changed.shape[1]), bool), np.array([-1])
    steps, objects = changed.shape
    probabilities = np.zeros((steps, objects, objects))
    if not len(triggers) or not len(responders):
        return probabilities
    informative = np.asarray(changed.any(axis=1))
    # (T, I) and (T, J), then sums over the steps so far: actions per trigger, changes per responder, coincidences
    on: np.ndarray = np.equal.outer(acted, triggers)
    on &= informative[:, None]
    moved = changed[:, responders]
    total = np.cumsum(informative)[:, None, None]
    actions = np.cumsum(on, axis=0)[:, :, None]
    seen = np.cumsum(moved, axis=0)[:, None, :]
    together = np.cumsum(on[:, :, None] & moved[:, None, :], axis=0)
    caused = _log_evidence(together, actions - together, config.effect)
    by_chance = _log_evidence(seen - together, (total - actions) - (seen - together), config.noise)
    none = _log_evidence(seen, total - seen, config.noise) + np.log(1 - config.controlled)
    some = caused + by_chance + np.log(config.controlled / len(triggers))
    posterior = softmax(np.concatenate([none, some], axis=1), axis=1)[:, 1:]
    probabilities[:, triggers[:, None], responders[None]] = posterior
    return probabilities


def _log_evidence(successes: np.ndarray, failures: np.ndarray, prior: tuple[float, float]) -> np.ndarray:
    """Log probability of a sequence with so many successes and failures, its rate drawn from Beta(prior)."""
    a, b = prior
    return betaln(successes + a, failures + b) - betaln(a, b)


class PcConfig(FrozenModel):
    """Parameters of PC.

    Attributes:
        alpha: significance level of the independence tests.
        condition: largest number of variables to condition on; None for PC in full.
        change: when a responder counts as changed.
    """

    alpha: Annotated[float, Field(gt=0, lt=1)] = 0.2
    condition: Annotated[int, Field(ge=0)] | None = None
    change: ChangeConfig = ChangeConfig()


def discover(observed: ObservedEpisode, config: PcConfig | None = None) -> InferredGraph:
    """Edges after each step.

    Raises:
        BusybotError: causal-learn is not installed.
    """
    config = config or PcConfig()
    changed = changes(observed, config.change)
    edges = discover_changes(changed, acted_objects(observed), observed.triggers, observed.responders, config)
    return InferredGraph("pc", edges)


def discover_changes(
    changed: np.ndarray, acted: np.ndarray, triggers: np.ndarray, responders: np.ndarray, config: PcConfig
) -> np.ndarray:
    """The discovery itself; arguments and result as of `count_changes`."""
    steps, objects = changed.shape
    edges = np.zeros((max(steps, 1), objects, objects))
    informative = np.asarray(changed.any(axis=1))
    actions = np.equal.outer(acted, triggers)
    for step in range(steps):
        if not informative[step]:
            edges[step] = edges[step - 1] if step else 0
            continue
        seen = np.flatnonzero(informative[: step + 1])
        did, moved = actions[seen], changed[np.ix_(seen, responders)]
        edges[step][np.ix_(triggers, responders)] = adjacent(did, moved, config) & _more_often(did, moved)
    return edges


def _more_often(did: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Whether responders change more often when a trigger is acted on, bool (I, J), from (samples, I) and (.., J)."""
    with_it = did.T.astype(float) @ moved / np.maximum(did.sum(0), 1)[:, None]
    without = (~did).T.astype(float) @ moved / np.maximum((~did).sum(0), 1)[:, None]
    return np.asarray(with_it > without)


def adjacent(did: np.ndarray, moved: np.ndarray, config: PcConfig) -> np.ndarray:
    """Pairs that PC leaves adjacent, bool (I, J).

    Args:
        did: int or bool (samples, I), what nothing causes.
        moved: int or bool (samples, J), what it may cause.

    Raises:
        BusybotError: causal-learn is not installed.
    """
    data = np.concatenate([did, moved], axis=1).astype(int)
    # what never varied is independent of everything
    varied = np.flatnonzero(data.min(0) != data.max(0))
    found = np.zeros((data.shape[1],) * 2, bool)
    if len(varied) > 1:
        found[np.ix_(varied, varied)] = _pc(data[:, varied], varied < did.shape[1], config)
    return found[: did.shape[1], did.shape[1] :]


def _pc(data: np.ndarray, exogenous: np.ndarray, config: PcConfig) -> np.ndarray:
    """Adjacency bool (V, V) of the variables of data, int (samples, V); nothing causes an exogenous one, bool (V,)."""
    try:
        from causallearn.graph.GraphNode import GraphNode
        from causallearn.search.ConstraintBased.PC import pc
        from causallearn.utils.PCUtils.BackgroundKnowledge import BackgroundKnowledge
    except ImportError:
        raise needs_extra("causal-learn", "causal") from None
    names = [f"v{number}" for number in range(data.shape[1])]
    nodes, knowledge = [GraphNode(name) for name in names], BackgroundKnowledge()
    for effect in np.flatnonzero(exogenous):
        for cause in nodes:
            knowledge.add_forbidden_by_node(cause, nodes[effect])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = pc(
            data,
            config.alpha,
            "gsq",
            background_knowledge=knowledge,
            max_k=config.condition,
            show_progress=False,
            node_names=names,
        )
    order = [names.index(node.get_name()) for node in found.G.get_nodes()]
    adjacent = np.zeros((len(names),) * 2, bool)
    adjacent[np.ix_(order, order)] = np.asarray(found.G.graph) != 0
    return adjacent
