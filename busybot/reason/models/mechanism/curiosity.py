"""What an action would tell: the information that is expected of it about what explains each responder.

The outcome of an action is foretold by every explanation; where those that are still probable disagree, or none has met
the situation, seeing it tells most. That is the mutual information between the outcome and what explains it, which is
an explanation and how often which state follows its contexts, or where they make a responder go that may fail to
(Houlsby & others, Bayesian active learning by disagreement, 2011). Responders are added up, as if each had its own
outcome independently of the others.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import digamma, entr

from busybot.reason.models.mechanism.contexts import (
    ATTEMPTS,
    STATES,
    SURE,
    UNRELIABLE,
    UNSURE,
    Explanations,
    Trace,
    contexts_of,
    followed,
    goals,
)

LOCKED = 0.2
"""How probable it is that a link waits for a responder, before it was tried."""
GIVES = 0.98
"""How probably a link moves that nothing holds, if pushed as it moved before; what is held seems to move as probably as
this one does not."""
MAY_GIVE = 0.5
"""The same if pushed in a way of which that is not known."""


@dataclass(frozen=True)
class Expected:
    """What is expected of M moves.

    Attributes:
        information: in nats, float (M,).
        shown: how probably each responder is in each state afterwards, float (M, R, S).
    """

    information: np.ndarray
    shown: np.ndarray

    def take(self, chosen: Sequence[int]) -> "Expected":
        """Of those moves."""
        return Expected(self.information[list(chosen)], self.shown[list(chosen)])


def expected(
    trace: Trace,
    found: Explanations,
    shares: np.ndarray,
    moves: Sequence[Sequence[int]],
    of: np.ndarray | None = None,
) -> Expected:
    """What each move would tell and show.

    Args:
        found: explanations of the trace.
        shares: float (R, H), the probability of each.
        moves: states in which each would leave the links.
        of: bool (R, T + 1), the moments that tell of these explanations; all by default.
    """
    before = trace.responders[-1]
    there = _states(trace.responders)
    few = np.where(found.own, UNSURE, SURE)[:, None] * there[:, None]  # (R, H, S)
    lucky = found.memory == UNRELIABLE
    tries = np.exp(ATTEMPTS[before]) * there[..., None]  # (R, after, goals)
    tries /= tries.sum(1, keepdims=True)
    open_ = entr(tries).sum(1)
    told, shown = [], []
    for links in moves:
        [contexts] = contexts_of(trace.longer(links, before), 1)
        likely, inner = _foretold(followed(trace, found, contexts, before, of) + few)
        going, _ = goals(trace, found, contexts, of)
        likely[:, lucky], inner[:, lucky] = (
            np.einsum("rug,rag->rua", going, tries),
            np.einsum("rug,rg->ru", going, open_),
        )
        mean = np.einsum("rh,rhs->rs", shares, likely)
        told.append(float((entr(mean).sum(-1) - (shares * inner).sum(-1)).sum()))
        shown.append(mean)
    return Expected(np.array(told), np.array(shown).reshape(len(moves), *there.shape))


def released(responders: np.ndarray, tries: Sequence[Sequence[int]], shown: np.ndarray | None = None) -> np.ndarray:
    """How probable it is that something may move that could not whenever it was tried, if a responder's state held it:
    any responder in any of its states may be what it waits for, but those in which it was tried in vain.

    Args:
        responders: int (T + 1, R), states after each action.
        tries: for each of F things the actions that failed to move it, from 0.
        shown: how probably each responder is in each state then, float (M, R, S); as after the last action without it.

    Returns:
        float (F,), or (M, F).
    """
    there = _states(responders)
    now = np.eye(STATES)[responders[-1]] if shown is None else shown
    told = []
    for actions in tries:
        in_vain = (responders[list(actions)][..., None] == np.arange(STATES)).any(0)
        waited_for = there & ~in_vain
        told.append((now * waited_for).sum((-2, -1)) / max(1, waited_for.sum()))
    return np.stack(told, axis=-1) if told else np.zeros((*now.shape[:-2], 0))


def yields(responders: np.ndarray, tries: Sequence[tuple[int, bool, bool]], locked: float = LOCKED) -> float:
    """How probable it is that a link would move now if it were pushed, as a share of how probable that is of one that
    nothing holds: any responder in any of its states may be what it waits for, or none.

    Args:
        responders: int (T + 1, R), states after each action; of one that is not known, a negative one after the last.
        tries: the actions that took hold of the link, from 0, whether each moved it, and whether it is known that it
            moves if pushed like that.
        locked: how probable it is that the link waits for a responder, before it was tried.
    """
    actions, moved, known = (list(one) for one in zip(*tries, strict=True)) if tries else ([], [], [])
    gives = np.where(known, GIVES, MAY_GIVE)
    there = _states(responders)
    met = responders[np.array(actions, int)][..., None] == np.arange(STATES)  # (tries, R, states)
    works = np.where(met, gives[:, None, None], 1 - GIVES)
    told = np.where(np.array(moved, bool)[:, None, None], works, 1 - works).prod(0)
    waits = locked * there * told / max(1, there.sum())
    alone = (1 - locked) * np.where(moved, gives, 1 - gives).prod()
    last = responders[-1]
    waits = waits[last >= 0]
    now = (waits * (last[last >= 0, None] == np.arange(STATES))).sum()
    held = waits.sum() - now
    return float((alone + now + held * (1 - GIVES) / GIVES) / (alone + now + held))


def certainty(found: Explanations, shares: np.ndarray) -> float:
    """The probability that the likeliest set of parents is the right one, of the responder of which that is least sure;
    1 where nothing responds.

    Not of all together: where much was seen a model is right more often than it says, of every responder, so that a
    product is far too low, and lower the more responders there are.

    Args:
        shares: float (R, H), the probability of each explanation.
    """
    _, which = np.unique(found.inputs, axis=0, return_inverse=True)
    return float(min((np.bincount(which.ravel(), own).max() for own in shares), default=1.0))


def _states(responders: np.ndarray) -> np.ndarray:
    """Which states each responder is known to have, bool (R, S), from those after each action, int (T + 1, R)."""
    return np.arange(STATES) < np.maximum(responders.max(0) + 1, 2)[:, None]


def _foretold(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How probable each state is, and how open that stays if its probability were known.

    Args:
        counts: (R, H, S), of a Dirichlet distribution of what follows; zeros where a state cannot.

    Returns:
        float (R, H, S); expected entropy, float (R, H).
    """
    total = counts.sum(-1, keepdims=True)
    likely = counts / total
    return likely, digamma(total[..., 0] + 1) - (likely * digamma(counts + 1)).sum(-1)
