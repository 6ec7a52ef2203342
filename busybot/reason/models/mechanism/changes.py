"""When another mechanism took the place of the first one: rewirings, as far as what was shown tells.

What a responder showed is either explained by one explanation throughout, or by one until some action and another one,
which knows nothing of what was before, from then on. Both are weighed by the probability that explanations gave to what
came, before it came (Adams & MacKay, Bayesian online changepoint detection, 2007, with one change at most). How seldom
changes are, and what is luck, the network learns (`networks`).

What was counted from one moment until another is counted for all first moments at once: S of them, on M moments of one
responder, by H explanations. H M S numbers are kept at once, of each responder after the other.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import avg_pool1d

from busybot.reason.models.mechanism.contexts import (
    NONE,
    NOW,
    RESTED,
    STATES,
    SURE,
    UNRELIABLE,
    UNSURE,
    Explanations,
    Trace,
    attempts,
)
from busybot.reason.models.mechanism.evidence import estimated

NOTHING = -20.0
"""Log odds where nothing can have changed."""
KINDS = ("all", "without luck", "one or two links as they are now")
"""Explanations whose odds are told."""
EARLIEST = 8
"""What was seen of a mechanism for fewer actions is not taken for another one."""
BESIDE = 1
"""A change is taken to lie where one is likeliest within so many actions."""


@dataclass(frozen=True)
class Changes:
    """What speaks for changes of R responders' mechanisms after each of K numbers of actions.

    Attributes:
        odds: float32 (K, R, 3), log odds, if changed and unchanged mechanisms were as frequent, by explanations of each
            of `KINDS`.
        places: int (R,), the first action after which it showed what the new one makes of it, if there is one; of all
            actions, and by all of `KINDS`, each of which counts as much.
        since: float32 (R, H, K), how probable each of H explanations makes what was shown if it explains it since a
            change, whenever that was, and any other one before: log probability, less that of the best one that there
            can be; 0 where nothing can have changed.
    """

    odds: np.ndarray
    places: np.ndarray
    since: np.ndarray


def changes_of(trace: Trace, found: Explanations, after: Sequence[int]) -> Changes:
    """See `Changes`."""
    (moments, responders), links = trace.responders.shape, trace.links.shape[1]
    asked = torch.as_tensor([*after, moments - 1])  # and at the end, which tells places
    odds = torch.full((responders, len(asked), len(KINDS)), NOTHING)
    since, places = torch.zeros(responders, len(found.own), len(asked)), torch.zeros(responders, dtype=torch.int64)
    counted, kinds = _Counted(found, moments), _kinds(found, links)
    for number, own in enumerate(torch.from_numpy(trace.responders.T.copy()) if moments > EARLIEST else ()):
        seen = None if trace.hidden is None else torch.from_numpy(~trace.hidden[:, number])
        logs, prior = counted.explained(own, seen).cumsum(1), _prior(found, links + number)  # (H, M, S)
        logs[:, :, 1:].masked_fill_(counted.before[:, 1:], -torch.inf)
        starts, whole, anew = counted.starts[1:], logs[..., 0] + prior[:, None], logs[:, asked, 1:]
        since_when = torch.zeros(len(starts))
        for kind, of in enumerate(kinds):
            until = torch.logsumexp(whole[of], 0)  # (M,)
            later = torch.logsumexp(anew[of] + prior[of, None, None], 0) + until[starts - 1]  # (K + 1, S - 1)
            odds[number, :, kind] = torch.logsumexp(later, 1) - asked.clamp(min=1).log() - until[asked]
            since_when += later[-1].softmax(0)
        either = anew + torch.logsumexp(whole, 0)[starts - 1]  # (H, K + 1, S - 1)
        places[number] = starts[_likeliest(since_when)]
        explained = torch.logsumexp(either, -1)
        best = explained[prior.isfinite()].max(0).values
        since[number] = torch.where(best.isfinite(), explained - best, 0.0)
    odds.clamp_(min=NOTHING)
    return Changes(odds[:, :-1].transpose(0, 1).numpy(), places.numpy(), since[..., :-1].numpy())


def _kinds(found: Explanations, links: int) -> list[Tensor]:
    """Explanations of each of `KINDS`."""
    now = np.isin(found.memory, (NONE, NOW)) & (found.inputs.sum(1) <= 2) & ~found.inputs[:, links:].any(1)
    return [torch.from_numpy(np.flatnonzero(which)) for which in (np.ones_like(now), ~found.own, now)]


def _likeliest(shares: Tensor) -> int:
    """Where most lies, with the neighbours: single ones may be high by chance."""
    return int(avg_pool1d(shares[None], 2 * BESIDE + 1, stride=1, padding=BESIDE)[0].argmax())


def _prior(found: Explanations, itself: int) -> Tensor:
    """Log probability of each explanation, (H,): all that remember the same of equally many inputs share one."""
    kinds = found.memory * (found.inputs.shape[1] + 1) + found.inputs.sum(1)
    _, which, counts = np.unique(kinds, return_inverse=True, return_counts=True)
    share = -np.log(counts[which.ravel()] * len(counts))
    return torch.from_numpy(np.where(found.inputs[:, itself], -np.inf, share)).float()


class _Counted:
    """What was counted since each of S first moments: the new board, and those after which a change may have come.

    Attributes:
        starts: int (S,).
        before: bool (M, S), whether a moment lies before the first one.
    """

    def __init__(self, found: Explanations, moments: int):
        steps = torch.arange(moments)
        self.starts = torch.cat([steps[:1], steps[EARLIEST:]])
        self.before, past = steps[:, None] < self.starts, steps[:, None] > steps
        self._since_first = (~self.before).float()
        contexts = torch.from_numpy(np.ascontiguousarray(found.contexts.T))
        same = (contexts[:, :, None] == contexts[:, None]) & past  # (H, M, M)
        lucky = found.memory == UNRELIABLE
        self._rows = [torch.from_numpy(np.flatnonzero(which)) for which in (~found.own, lucky, found.own & ~lucky)]
        self._free, self._lucky, self._alone = (same.index_select(0, rows).float() for rows in self._rows)
        self._total = self._since(self._free)

    def _since(self, numbers: Tensor) -> Tensor:
        """Sums over the moments from each first one on, (..., M, S) from (..., M, M)."""
        return numbers @ self._since_first

    def explained(self, shown: Tensor, seen: Tensor | None = None) -> Tensor:
        """Log probability of each state of a responder, before it showed, by what is known since each first moment,
        (H, M, S); 0 before that. The estimators are those of `evidence`.

        Args:
            shown: int (M,).
            seen: bool (M,), when that was seen; always by default. What was not is certain, and tells nothing.
        """
        counts = torch.ones(len(shown)) if seen is None else seen.float()
        agrees, before = (shown[:, None] == shown).float(), torch.cat([shown[:1], shown[:-1]])
        ways = (torch.where(self.before, -1, shown[:, None]).cummax(0).values + 1).clamp(min=2)
        told = shown.new_empty((sum(map(len, self._rows)), *ways.shape), dtype=torch.float32)
        total = self._total if seen is None else self._since(self._free * counts)
        told[self._rows[0]] = estimated(self._since(self._free * counts * agrees), total, ways, SURE)
        told[self._rows[1]] = self._unless_it_fails(shown, counts, ways)
        told[self._rows[2]] = self._by_itself(before, agrees, counts, ways)
        return told.masked_fill_(self.before, 0.0).mul_(counts[:, None])

    def _unless_it_fails(self, shown: Tensor, counts: Tensor, ways: Tensor) -> Tensor:
        """Of what goes where its context says, unless that fails."""
        going, at_rest = torch.from_numpy(attempts(shown.numpy())).float(), torch.from_numpy(RESTED).float()[shown]
        going, at_rest = going * counts[:, None], at_rest * counts[:, None]
        first = torch.arange(len(shown))[:, None] == self.starts
        known, shows = [], []
        for goal in range(min(STATES, int(ways.max()))):
            found = self._since(self._lucky * going[:, goal])
            found += self._lucky[..., self.starts] * (at_rest - going)[self.starts, goal]  # a first one has rested
            known.append(found.masked_fill(goal >= ways, -torch.inf))
            shows.append(known[-1] + torch.where(first, at_rest[:, None, goal], going[:, None, goal]))
        return torch.logsumexp(torch.stack(shows), 0) - torch.logsumexp(torch.stack(known), 0)

    def _by_itself(self, before: Tensor, agrees: Tensor, counts: Tensor, ways: Tensor) -> Tensor:
        """Of what remembers itself alone, where it is found out whether that is sure."""
        same = self._alone * (before[:, None] == before) * counts
        right, total = self._since(same * agrees), self._since(same)
        logs = [estimated(right, total, ways, few) for few in (SURE, UNSURE)]
        known = [same @ one.masked_fill(self.before, 0.0) for one in logs]
        return torch.logaddexp(known[0] + logs[0], known[1] + logs[1]) - torch.logaddexp(*known)
