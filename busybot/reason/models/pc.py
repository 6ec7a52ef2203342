"""A competitor: constraint-based causal discovery, PC with G-squared tests (causal-learn), on what counting sees.

Variables of a step are "trigger i was acted on" and "responder j changed", one sample for each step in which anything
changed. It is known that nothing causes an action. An edge is claimed where PC leaves trigger and responder adjacent
and the responder changes more often when the trigger is acted on. Probabilities are 0 or 1: PC gives none.

A step acts on one trigger, so the actions determine each other, which PC's assumption of faithfulness excludes: given
the other triggers, an action has nothing left to explain, and full PC removes true edges. Without conditioning
(`condition` 0) this does not happen, and what remains are tests of every pair by itself.

Needs the extra `causal`.
"""

import warnings
from typing import Annotated

import numpy as np
from pydantic import Field

from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel
from busybot.reason.inputs.object_masks import ChangeConfig, changes
from busybot.reason.inputs.observation import ObservedEpisode, acted_objects
from busybot.reason.models.base import InferredGraph


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
    return InferredGraph(
        "pc", discover_changes(changed, acted_objects(observed), observed.triggers, observed.responders, config)
    )


def discover_changes(
    changed: np.ndarray, acted: np.ndarray, triggers: np.ndarray, responders: np.ndarray, config: PcConfig
) -> np.ndarray:
    """The discovery itself; arguments and result as of `reason.models.counting.count_changes`."""
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
        edges[step][np.ix_(triggers, responders)] = _adjacent(did, moved, config) & _more_often(did, moved)
    return edges


def _more_often(did: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Whether responders change more often when a trigger is acted on, bool (I, J), from (samples, I) and (.., J)."""
    with_it = did.T.astype(float) @ moved / np.maximum(did.sum(0), 1)[:, None]
    without = (~did).T.astype(float) @ moved / np.maximum((~did).sum(0), 1)[:, None]
    return np.asarray(with_it > without)


def _adjacent(did: np.ndarray, moved: np.ndarray, config: PcConfig) -> np.ndarray:
    """Pairs that PC leaves adjacent, bool (I, J)."""
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
        raise BusybotError("causal-learn is not installed", "pip install 'busybot[causal]'") from None
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
