"""What a model says of a board's mechanisms, with the true names of links, and a verdict; for pictures and reports.

A model that sees pictures alone numbers a trigger's links as it finds them: its `object 0 (link 2)` may be `link_0` of
the file. A link that it found stands for the true one that they share most actions with, one to one
(`reason.evaluation.causes.matched_links`), as where models are judged.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from busybot.boards.spec import BODY, LinkRef
from busybot.reason.evaluation.causes import JudgedMechanism, matched_links
from busybot.reason.inputs.observation import acted_objects, observe_episode
from busybot.reason.models.base import InferredGraph, InferredLinks
from busybot.view.annotations import Verdict
from busybot.view.mechanisms import Factor, MechanismView, harmless

NOT_THERE = "a link that is not there"


@dataclass(frozen=True)
class Claim:
    """What a model says to decide a responder.

    Attributes:
        factor: between the claimed causes, also those that it misses, and the responder; its label is the claimed kind.
        verdicts: of each cause.
    """

    factor: Factor
    verdicts: tuple[Verdict, ...]

    @property
    def verdict(self) -> Verdict:
        """Of all causes together."""
        return next((name for name in self.verdicts if name != "correct"), "correct")


class Understanding:
    """What a model that tells a trigger's links apart says of a board at the end of an episode."""

    def __init__(self, view: MechanismView, inferred: InferredGraph, links: InferredLinks):
        self.view, self.inferred, self.links = view, inferred, links

    @cached_property
    def owners(self) -> np.ndarray:
        """Of each of K links that were found, the object that it belongs to, -1 if no action tells; int (K,)."""
        acted, clusters = acted_objects(observe_episode(self.view.episode)), self.links.clusters
        acted = acted[: len(clusters)]
        own = [acted[(clusters == k) & (acted >= 0)] for k in range(self.links.probabilities.shape[1])]
        return np.array([np.bincount(one).argmax() if len(one) else -1 for one in own], int)

    @cached_property
    def nodes(self) -> list[int | None]:
        """Of each link that was found, the node of the true link that it stands for; None for one that is not there."""
        place = {(link.object, link.link): number for number, link in enumerate(self.view.links)}
        steps = self.view.episode.steps[: len(self.links.clusters)]
        held = np.array([place.get((step.acted_object, step.acted_link), -1) for step in steps], int)
        match = matched_links(self.links.clusters[: len(held)], held, len(place))
        return [self.view.node(self.view.links[match[k]]) if k in match else None for k in range(len(self.owners))]

    def words(self, responder: int) -> str:
        """What the model says of a responder, "" if nothing, with names in place of numbers."""
        told = "" if self.inferred.words is None else self.inferred.words[responder]
        return re.sub(r"\bobject (\d+)(?: \(link (\d+)\))?", self._name, told)

    def _name(self, found: re.Match[str]) -> str:
        index, number = int(found[1]), int(found[2] or 1)
        own = np.flatnonzero(self.owners == index)
        if not len(own):
            return self.view.object_name(index)
        node = self.nodes[own[number - 1]] if number <= len(own) else None
        return f"{self.view.object_name(index)} ({NOT_THERE})" if node is None else self.view.nodes[node].name

    @cached_property
    def claims(self) -> list[Claim]:
        """Of the responders that links or responders decide, or are claimed to."""
        roles = [placed.role for placed in self.view.board.objects]
        found = [self._claim(index) for index, role in enumerate(roles) if role == "responder"]
        return [claim for claim in found if claim.factor.causes]

    def _claim(self, responder: int) -> Claim:
        effect, kinds = (self._body(responder),), self.inferred.kinds
        factors = self.view.factors(len(self.view.episode.steps))
        true = {cause for one in factors if one.effects == effect for cause in one.causes}
        told = [
            (self._body(owner) if node is None else node, node in true)
            for node, owner, probability in self._believed(responder)
            if probability > self.inferred.threshold and (node is not None or owner >= 0)
        ]
        missed = sorted(true - {cause for cause, right in told if right})
        verdicts: list[Verdict] = ["correct" if right else "wrong" for _, right in told]
        verdicts += ["missed"] * len(missed)
        label = harmless(kinds[responder]) if kinds and told else "nothing"
        causes = (*(cause for cause, _ in told), *missed)
        return Claim(Factor(str(responder), "mechanism", label, causes, effect), tuple(verdicts))

    def _believed(self, responder: int) -> Iterator[tuple[int | None, int, float]]:
        """Node, object and probability of every possible cause: of links that were found, and of responders."""
        steps = len(self.view.episode.steps)
        single, pairs = self.links.after(steps)[:, responder], self.inferred.after(steps)[:, responder]
        yield from zip(self.nodes, self.owners.tolist(), single.tolist(), strict=True)
        for index, placed in enumerate(self.view.board.objects):
            if placed.role == "responder":
                yield self._body(index), index, float(pairs[index])

    def _body(self, index: int) -> int:
        return self.view.node(LinkRef(object=index, link=BODY))

    def verdict(self, mechanism: JudgedMechanism) -> str:
        """Whether the links that decide a responder are the true ones, and whether what it shows is foretold."""
        effect = (self._body(mechanism.responder),)
        verdicts = [one for claim in self.claims if claim.factor.effects == effect for one in claim.verdicts]
        faults = [f"{count} {name}" for name in ("wrong", "missed") if (count := verdicts.count(name))]
        if faults:
            return f"links: {verdicts.count('correct')} right, {', '.join(faults)}"
        return "right" if mechanism.right else "links right, not what follows from them"
