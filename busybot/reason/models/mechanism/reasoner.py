"""The `mechanism` model as a reasoner: parents of every responder, and what it shows next.

What a responder shows after an action is what it showed in equal contexts, over all explanations, each with its
probability. A context that was never seen says that nothing changes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.base import InferredGraph, InferredLinks
from busybot.reason.models.mechanism.contexts import MEMORIES, STATES, Explanations, Trace, explanations_of
from busybot.reason.models.mechanism.networks import MechanismNet, explanation_graph
from busybot.reason.models.mechanism.perception import Perceived, perceive
from busybot.reason.pyg import Batch

RARE = 0.05
"""Pseudo-count of what never followed a context."""
KINDS = {
    "none": "rest",
    "own": "flicker",
    "own and now": "unreliable",
    "odd": "toggle",
    "since": "timer",
    "last": "latch",
}
"""Kinds of mechanisms (`boards.mechanisms`) by what is remembered; what remembers nothing is named by its inputs."""


@dataclass(frozen=True)
class _Understood:
    """A recording and what explains it; R responders, H explanations, K moments.

    Attributes:
        shares: float (R, H, K), probability of each explanation after so many actions each.
    """

    perceived: Perceived
    found: Explanations
    shares: np.ndarray

    @property
    def trace(self) -> Trace:
        return self.perceived.trace

    def following(self, contexts: np.ndarray, before: np.ndarray) -> np.ndarray:
        """The likeliest states after an action, int (R,).

        Args:
            contexts: int (H,), after the action; what `own` adds is left out.
            before: int (R,), states before it.
        """
        shown = self.trace.responders
        earlier = np.concatenate([shown[:1], shown[:-1]])
        equal = (self.found.contexts == contexts).astype(float)  # (T + 1, H)
        states = np.eye(STATES)[shown]  # (T + 1, R, S)
        alike = states * (earlier == before)[..., None]
        counts = np.where(
            self.found.own[None, :, None],
            np.einsum("th,trs->rhs", equal, alike),
            np.einsum("th,trs->rhs", equal, states),
        )
        total = counts.sum(2, keepdims=True)
        likely = np.where(total > 0, (counts + RARE) / (total + STATES * RARE), np.eye(STATES)[before][:, None])
        known = np.arange(STATES) <= shown.max(0)[:, None]
        return np.asarray((np.einsum("rh,rhs->rs", self.shares[..., -1], likely) * known).argmax(1))


class MechanismReasoner:
    """See `Reasoner`.

    Args:
        encoder: of the features that it was trained with.
    """

    name = "mechanism"

    def __init__(self, net: MechanismNet, encoder: str):
        self._net, self.encoder = net.eval(), encoder
        self._last: tuple[BoardSequence, _Understood] | None = None

    def graph(self, seen: BoardSequence) -> InferredGraph:
        """Edge probabilities after each step, at the level of objects and of links, with kinds and lags."""
        known = self._explained(seen, range(seen.steps + 1))
        links, objects = known.perceived.links, len(seen.triggers)
        owners = np.concatenate([links.owners, known.perceived.responders]).astype(int)
        of_objects = np.zeros((len(known.found.inputs), objects), bool)
        for row, inputs in zip(of_objects, known.found.inputs, strict=True):
            row[owners[inputs]] = True
        moments = known.shares.shape[2]
        pairs = np.zeros((moments, objects, objects))
        pairs[:, :, known.perceived.responders] = np.einsum("rhk,hi->kir", known.shares, of_objects)
        single = np.zeros((moments, len(links.owners), objects))
        own = known.found.inputs[:, : len(links.owners)]
        single[:, :, known.perceived.responders] = np.einsum("rhk,hi->kir", known.shares, own)
        kinds, lags = self._named(known, objects)
        after = slice(1, None) if moments > 1 else slice(None)
        return InferredGraph(
            self.name,
            pairs[after],
            prior=pairs[0],
            links=InferredLinks(links.clusters, single[1:]),
            kinds=kinds,
            lags=lags,
        )

    def predict(self, seen: BoardSequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """What follows each action by itself, if links stand as they did at the end of what was seen."""
        known, told = self._understand(seen), []
        for looks, action, owner in zip(current, actions, acted, strict=True):
            before = known.perceived.states_of(looks)
            links = known.perceived.moved(known.trace.links[-1], action, int(owner))
            after = known.following(self._context(known.trace, links, before), before)
            changed = np.isin(np.arange(len(looks)), known.perceived.responders[after != before])
            told.append(np.where(changed[:, None], known.perceived.shown(after, looks), looks))
        return np.array(told, np.float32).reshape(current.shape)

    def what_if(self, seen: BoardSequence, steps: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """See `Imagining`: what links did before is remembered, by the explanations that need it."""
        known = self._understand(seen)
        told = np.zeros((*actions.shape[:2], *seen.features.shape[1:]), np.float32)
        for question, start in enumerate(steps.tolist()):
            trace = known.trace.first(start)
            for number, (action, owner) in enumerate(zip(actions[question], acted[question].tolist(), strict=True)):
                before = trace.responders[-1]
                links = known.perceived.moved(trace.links[-1], action, owner)
                after = known.following(self._context(trace, links, before), before)
                trace = _longer(trace, links, after)
                told[question, number] = known.perceived.shown(after, seen.features[0])
        return told

    def _understand(self, seen: BoardSequence) -> _Understood:
        """What was asked about last is remembered: evaluators ask several things of one recording."""
        if self._last is not None:
            known, understood = self._last
            if known.watch is seen.watch and known.steps == seen.steps and known.features.base is seen.features.base:
                return understood
        self._last = (seen, self._explained(seen, [seen.steps]))
        return self._last[1]

    @torch.no_grad()
    def _explained(self, seen: BoardSequence, after: Sequence[int]) -> _Understood:
        perceived = perceive(seen, self.encoder)
        found = explanations_of(perceived.trace)
        graph = explanation_graph(perceived.trace, after)
        final, _ = self._net(Batch.from_data_list([graph]))
        shares = final.exp().view(len(perceived.responders), len(found.own), -1).double().numpy()
        return _Understood(perceived, found, shares)

    def _context(self, trace: Trace, links: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Contexts (H,) after one more action that left the links so."""
        return explanations_of(_longer(trace, links, before)).contexts[-1]

    def _named(self, known: _Understood, objects: int) -> tuple[tuple[str, ...], np.ndarray]:
        kinds, lags = [""] * objects, np.full(objects, -1)
        count = len(known.perceived.links.owners)
        for index, shares in zip(known.perceived.responders, known.shares[..., -1], strict=True):
            best = int(shares.argmax())
            inputs, memory = known.found.inputs[best], MEMORIES[known.found.memory[best]]
            late = int(memory.split()[1]) if memory.startswith("late") else 0
            by_inputs = "delay" if late else "one-to-one" if inputs.sum() == 1 else "gate"
            kinds[index] = KINDS.get(memory, KINDS.get(memory.split()[0], by_inputs))
            if inputs.any():
                lags[index] = late + int(inputs[count:].any())
        return tuple(kinds), lags


def _longer(trace: Trace, links: np.ndarray, responders: np.ndarray) -> Trace:
    return Trace(np.vstack([trace.links, links]), np.vstack([trace.responders, responders]), trace.sizes)
