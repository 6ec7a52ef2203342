"""Links that nobody saw moving, and how probable it is that one of them decides a responder.

The network weighs links that moved. A trigger may have others, behind a lock or where nobody got hold of them. What
tells of those is how many of its links are known, how often it was touched in vain, and whether known links explain
what responders do. A logistic model of that is learned from recorded boards once the network is trained.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy

from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.mechanism.contexts import Trace
from busybot.reason.models.mechanism.perception import Perceived
from busybot.reason.models.mechanism.rising import forms_of

SEVERAL = 2
"""Triggers of which so many links are known, or more, are judged alike."""
FACTS = 10
TOLD = 2 * FACTS + 2
"""Facts, the log odds of what is believed times each (the first is 1), their square, and what of them is positive."""
RARE = -2.0
"""Log odds where nothing was learned yet."""
TINY = 1e-4
"""Nothing is believed to be less probable, nor more probable than all but this, when it is learned."""
STEPS = 200
SMALL = 0.1
"""Squares of log odds are at most some tens; this makes them as large as the rest."""


@dataclass(frozen=True)
class Touched:
    """What a recording of T actions tells of its triggers.

    Attributes:
        trace: its links and responders.
        owners: int (L,), index of the trigger of each link.
        acted: int (T,), index of the trigger that each action touched, -1 for none.
        triggers: int (O,), indices of the triggers that show.
        forms: float32 (L, FORM), as of `rising.forms_of`; None if nobody knows.
        unsteady: whether the camera was not still.
    """

    trace: Trace
    owners: np.ndarray
    acted: np.ndarray
    triggers: np.ndarray
    forms: np.ndarray | None = None
    unsteady: bool = False

    @staticmethod
    def of(seen: BoardSequence, perceived: Perceived) -> "Touched":
        """What was perceived of a recording."""
        links, there = perceived.links, seen.shown_triggers
        owners, forms = links.owners.astype(int), forms_of(links)
        return Touched(perceived.trace, owners, perceived.acted, there, forms, links.steadied)

    def pairs(self, after: Sequence[int], shares: np.ndarray, inputs: np.ndarray) -> "Pairs":
        """What is known of all pairs after so many actions each.

        Args:
            shares: float (R, H, K), how probable each explanation was then.
            inputs: bool (H, I), what it reads, links first.
        """
        trace, moments = self.trace, np.asarray(after)
        own = self.owners == self.triggers[:, None]  # (O, L)
        known = inputs[:, : own.shape[1]]
        believed = np.einsum("rhk,ho->kor", shares, (known @ own.T).astype(float))
        unexplained = np.einsum("rhk,h->kr", shares, (~known.any(axis=1)).astype(float))[:, None]  # (K, 1, R)
        changed = ((trace.responders != trace.responders[0]).cumsum(axis=0)[moments] > 0)[:, None]
        moved = (trace.links[1:] != trace.links[:-1]) @ own.T  # (T, O)
        in_vain = _so_far((self.acted[:, None] == self.triggers) & ~moved)[moments]
        tries, actions = np.log1p(in_vain)[..., None], np.log1p(moments)[:, None, None]
        alone = 1 / (1 + (~own.any(axis=1)).sum())  # among triggers of which no link is known
        told = (
            *(1.0, unexplained, changed, unexplained * changed, actions, actions * unexplained),
            *(tries, tries * unexplained, alone * unexplained * changed, own.sum() / max(1, len(own))),
        )
        facts = np.stack([np.broadcast_to(one, believed.shape) for one in told], axis=-1)
        kinds = own.sum(axis=1).clip(max=SEVERAL)
        return Pairs(torch.from_numpy(believed).float(), torch.from_numpy(facts).float(), torch.from_numpy(kinds))


@dataclass(frozen=True)
class Pairs:
    """What is known of pairs of a trigger that shows and a responder: O triggers, R responders, K moments.

    Attributes:
        believed: float32 (K, O, R), how probable it is that a known link of the trigger decides the responder.
        facts: float32 (K, O, R, FACTS): 1; how probable it is that no known link explains the responder, whether it has
            changed, and the product of both; log(1 + n) of the number of actions, alone and where nothing explains it;
            the same of those that touched the trigger in vain; that product again, divided by one more than the number
            of triggers of which no link is known; known links a trigger.
        kinds: int64 (O,), number of known links of each trigger, at most `SEVERAL`.
    """

    believed: Tensor
    facts: Tensor
    kinds: Tensor


class Unseen(nn.Module):
    """How probable it is that any link of a trigger decides a responder, known or not.

    Shapes:
        input: `Pairs`; number of the world that is told, see `networks.world_number`.
        output: (K, O, R).

    Attributes:
        decay: of each kind of weights, how much the squares of their distances from where they began count in the loss.
    """

    decay: ClassVar[dict[str, float]]

    def forward(self, pairs: Pairs, world: int) -> Tensor:
        """See above."""
        kinds = pairs.kinds[:, None].expand(pairs.believed.shape[1:])
        return self._any(pairs.believed, pairs.facts, kinds, torch.full_like(kinds, world))

    def _any(self, believed: Tensor, facts: Tensor, kinds: Tensor, worlds: Tensor) -> Tensor:
        """Of pairs in any shape (..., the same with FACTS behind for `facts`), each with its own kind and world."""
        raise NotImplementedError

    def learn(self, boards: Sequence[tuple[Pairs, int]], true: Sequence[np.ndarray]) -> float:
        """Fit all weights to recorded boards, each with the world that is told of it; returns the mean negative log
        probability of the truth that they reach, nats, with the penalty of the weights.

        Args:
            true: bool (K, O, R) of each, whether the trigger decides the responder.
        """
        rows = [
            (
                pairs.believed.flatten(),
                pairs.facts.flatten(0, 2),
                pairs.kinds[:, None].expand(pairs.believed.shape[1:]).expand(pairs.believed.shape).flatten(),
                torch.full((pairs.believed.numel(),), world),
                torch.from_numpy(right).flatten(),
            )
            for (pairs, world), right in zip(boards, true, strict=True)
        ]
        believed, facts, kinds, worlds, right = (torch.cat(column) for column in zip(*rows, strict=True))
        start = {name: one.detach().clone() for name, one in self.named_parameters()}
        descent = torch.optim.LBFGS(self.parameters(), max_iter=STEPS, line_search_fn="strong_wolfe")

        def loss() -> Tensor:
            descent.zero_grad()
            told = self._any(believed, facts, kinds, worlds)
            lost = binary_cross_entropy(told.clamp(TINY, 1 - TINY), right.float())
            moved = (self.decay[name] * ((one - start[name]) ** 2).sum() for name, one in self.named_parameters())
            total = lost + sum(moved)
            total.backward()
            return total

        descent.step(loss)
        return float(loss().detach())


class UnseenAlike(Unseen):
    """What is believed of known links stays, and in the rest of all cases it may be a link that nobody saw moving: by a
    logistic model of `Pairs.facts`. Worlds differ in how probable a link is that nothing tells of.

    Args:
        worlds: how many may be told.
    """

    decay = {"weight": 1e-4, "world": 1e-4}

    def __init__(self, worlds: int):
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(SEVERAL + 1, FACTS))
        self.world = nn.Parameter(torch.zeros(SEVERAL + 1, worlds + 1))

    def _any(self, believed: Tensor, facts: Tensor, kinds: Tensor, worlds: Tensor) -> Tensor:
        logits = (facts * self.weight[kinds]).sum(-1) + self.world[kinds, worlds]
        return torch.as_tensor(believed + (1 - believed) * torch.sigmoid(logits + RARE))


class UnseenByWorld(Unseen):
    """A logistic model of `Pairs.facts` and of what is believed of known links. Each world weighs them in a way of its
    own, as far as its boards tell that it differs from what all have in common. It may believe less than the network
    does, too: what a link did that nobody saw may have been laid to a known one. Before it learns it believes what the
    network does.

    Weights decay so that training boards that are left out are foretold about as well as by any decay that was tried;
    they hardly depend on it.

    Args:
        worlds: how many may be told.
    """

    decay = {"weight": 1e-3, "world": 1e-2}

    def __init__(self, worlds: int):
        super().__init__()
        weight = torch.zeros(SEVERAL + 1, TOLD)
        weight[:, FACTS] = 1  # of the log odds themselves
        self.weight, self.world = nn.Parameter(weight), nn.Parameter(torch.zeros(SEVERAL + 1, worlds + 1, TOLD))

    def _any(self, believed: Tensor, facts: Tensor, kinds: Tensor, worlds: Tensor) -> Tensor:
        odds = believed.clamp(TINY, 1 - TINY).logit()[..., None]
        told = torch.cat([facts, odds * facts, SMALL * odds**2, odds.relu()], -1)
        return torch.sigmoid((told * (self.weight[kinds] + self.world[kinds, worlds])).sum(-1))


def _so_far(happened: np.ndarray) -> np.ndarray:
    """How often by each moment, (T + 1, ...) of (T, ...)."""
    return np.concatenate([np.zeros((1, *happened.shape[1:]), int), happened.cumsum(axis=0)])
