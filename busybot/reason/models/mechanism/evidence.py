"""How well explanations have done: what the `mechanism` network judges.

An explanation is good when equal contexts were followed by equal states, and an input of it matters when the responder
showed different states in contexts that differ in this input alone. Both are counted here, after every action; where a
responder was not seen, nothing is. Cost: H explanations of T actions, R responders and E inputs that explanations read
compare (H + E) R T^2 pairs of moments.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import one_hot

from busybot.reason.models.mechanism.contexts import (
    LONGEST,
    RESTED,
    SINCE,
    STATES,
    SURE,
    UNRELIABLE,
    UNSURE,
    Explanations,
    Trace,
    attempts,
)

EVIDENCE = 15
"""Numbers that are counted of an explanation, see `Evidence`."""
EITHER, LEFT = 2, 14
"""Two of its columns."""
SCALE = 5.0
"""Log probabilities are told in units of it."""
WITNESSES = 2
"""Numbers that are counted of an input of an explanation."""
LARGEST = 80.0
"""Of the logarithm of a ratio: float32 ends not far beyond. A simpler explanation so far ahead is believed anyway."""
FEWEST = 1e-3
"""Of the functions that agree with what was shown at least so many are left; sums of rounded shares may be none."""
RECENT = 10
"""So many actions are recent."""


@dataclass(frozen=True)
class Evidence:
    """What was counted of R responders after each of K numbers of actions; H explanations read E inputs.

    Columns of explanations, over the new board and all actions so far:

    | column | meaning |
    |---|---|
    | 0, 1 | log probability / `SCALE` that the explanation gave to each state before it showed (Krichevsky & Trofimov \
1981, with pseudo-counts `SURE` and `UNSURE`) |
    | 2 | the same where each context is either sure or not, which is found out; of what may fail that of what it \
showed, if each context has one state where the responder goes, unless it fails |
    | 3 | contexts that were new |
    | 4 | equal contexts, and never this state before |
    | 5 | equal contexts, and sometimes this state before |
    | 6 | equal contexts, and always this state before |
    | 7 | of these, those that changed the responder |
    | 8 | of column 3, those that changed the responder |
    | 9 | changes of the responder |
    | 10 | actions |
    | 11 | column 0 of the last `RECENT` actions |
    | 12 | the same, if nothing but these actions is known |
    | 13 | column 4 of the last `RECENT` actions |
    | 14 | column 0, of what may fail column 2, if every input is to matter; of what remembers since when a link was \
pressed, if it shows one state for so many actions and then another one; of what moves by itself, if it changes when \
some other responder does (column 2 if there is none) |

    Columns 3 to 10 and 13 are log(1 + number). Columns of inputs, as log(1 + number): pairs of moments whose contexts
    differ in this input alone and in which the responder showed different states, or equal ones.

    Attributes:
        explanations: float32 (R, H, K, 15).
        inputs: float32 (R, E, K, 2), in the order of `Explanations.reads`.
    """

    explanations: Tensor
    inputs: Tensor


def evidence_of(trace: Trace, found: Explanations, after: Sequence[int]) -> Evidence:
    """Count what is known after so many actions each."""
    shown = torch.from_numpy(np.ascontiguousarray(trace.responders.T))
    before = torch.cat([shown[:, :1], shown[:, :-1]], 1)  # a new board has rested for long
    moments, seen = torch.as_tensor(after), torch.from_numpy(np.ascontiguousarray(trace.seen.T))
    earlier = Earlier(found, before)
    counted = _of_explanations(earlier, found, shown, before, seen)
    return Evidence(counted[:, :, moments], _of_inputs(earlier, found, shown, seen)[:, :, moments])


class Earlier:
    """Which earlier moments had equal contexts; M moments, H explanations, R responders.

    Args:
        before: (R, M), the responders' states before each action.
    """

    def __init__(self, found: Explanations, before: Tensor):
        each, own = torch.from_numpy(np.ascontiguousarray(found.contexts.T)), found.own
        count = each.shape[1]
        steps = torch.arange(count)
        self.past = steps[:, None] > steps
        self.recent = (self.past & (steps[:, None] - steps <= RECENT)).float()
        self.same = each[:, :, None] == each[:, None]  # (H, M, M)
        self.alike = before[:, :, None] == before[:, None]  # (R, M, M)
        self.own = torch.from_numpy(own)
        self._rows = [torch.from_numpy(np.flatnonzero(which)) for which in (~own, own)]
        free, bound = (self.same[rows] & self.past for rows in self._rows)
        self._free, self._bound = free.float(), (bound & self.alike[:, None]).float()

    def sum(self, numbers: Tensor, recent: bool = False) -> Tensor:
        """Over earlier moments of equal context, (R, H, M, N) from (R, M, N) or (R, H, M, N)."""
        free, bound = (one * self.recent if recent else one for one in (self._free, self._bound))
        each = numbers[:, None].expand(-1, len(self.own), -1, -1) if numbers.dim() == 3 else numbers
        of_free, of_bound = (each.index_select(1, rows) for rows in self._rows)
        # what is free is equal for all responders, whose numbers stand side by side
        side_by_side = of_free.permute(1, 2, 0, 3).reshape(*free.shape[:2], -1)
        shape = *free.shape[:2], len(numbers), numbers.shape[-1]
        summed = torch.bmm(free, side_by_side).view(shape).permute(2, 0, 1, 3)
        told = numbers.new_empty(each.shape)
        told.index_copy_(1, self._rows[0], summed)
        return told.index_copy_(1, self._rows[1], bound @ of_bound)


def known_states(shown: Tensor) -> Tensor:
    """How many states each responder is known to have at each moment, two at least, (R, M)."""
    return (shown.cummax(1).values + 1).clamp(min=2)


def estimated(right: Tensor, total: Tensor, ways: Tensor | int, few: float) -> Tensor:
    """Log probability of a state that followed so many times of all (Krichevsky & Trofimov 1981), with `few`
    pseudo-counts of each of these many states."""
    return torch.log((right + few) / (total + few * ways))


def _log_probabilities(
    earlier: Earlier, shown: Tensor, follow: Tensor, hidden: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Of what was shown, before it was: by sure contexts, unsure ones, and where either is found out, (R, H, M) each.

    Args:
        shown: int (R, M).
        follow: (R, H, M, STATES), how often each state followed equal contexts.
        hidden: bool (R, 1, M), where it was not seen what was shown, which is certain then.
    """
    right, total, ways = _right(follow, shown), follow.sum(-1), known_states(shown)[:, None]
    sure, unsure = (estimated(right, total, ways, few).masked_fill(hidden, 0.0) for few in (SURE, UNSURE))
    # log probability of what each has seen in this context
    known = earlier.sum(torch.stack([sure, unsure], -1)).unbind(-1)
    either = torch.logaddexp(known[0] + sure, known[1] + unsure) - torch.logaddexp(*known)
    return sure, unsure, either


def _unless_it_fails(earlier: Earlier, shown: Tensor, hidden: Tensor) -> Tensor:
    """Log probability of each state, before it showed, of what goes where its inputs say unless that fails, (R, O, M)
    for the explanations that remember the responder's own state."""
    logs = torch.from_numpy(attempts(shown.numpy())).float().masked_fill(hidden[:, 0, :, None], 0.0)  # (R, M, S)
    same = (earlier.same[earlier.own] & earlier.past).float()
    known = torch.einsum("uij,rjs->ruis", same, logs)
    known = known.masked_fill(torch.arange(STATES) >= known_states(shown)[:, None, :, None], -torch.inf)
    return torch.logsumexp(known + logs[:, None], -1) - torch.logsumexp(known, -1)


def _together(shown: Tensor, before: Tensor, seen: Tensor) -> Tensor:
    """Log probability of all changes of each responder until each moment, if some other one's changes tell it, (R, M);
    there has to be another one."""
    changes = shown != before
    alike = (changes[:, :, None] == changes[:, None]).float()  # (R, M, M)
    same = alike.tril(-1) * seen[:, None]
    told = torch.einsum("oij,rij->roi", same, alike * seen[:, None])
    total = torch.einsum("oij,rj->roi", same, seen)
    which = changes * (known_states(shown) - 1).log()  # it may have changed to any other state
    logs = ((estimated(told, total, 2, SURE) - which[:, None]) * seen[:, None]).cumsum(-1)  # (R, other R, M)
    others = ~torch.eye(len(shown), dtype=torch.bool)[..., None]
    return torch.logsumexp(logs.masked_fill(~others, -torch.inf), 1) - math.log(len(shown) - 1)


def _right(follow: Tensor, shown: Tensor) -> Tensor:
    """How often it was the state that shows, (R, H, M)."""
    return follow.gather(-1, shown[:, None, :, None].expand(*follow.shape[:3], 1))[..., 0]


def _of_explanations(earlier: Earlier, found: Explanations, shown: Tensor, before: Tensor, seen: Tensor) -> Tensor:
    """(R, H, M, 15); `seen` is bool (R, M)."""
    states, hidden = one_hot(shown, STATES).float() * seen[..., None], ~seen[:, None]
    follow, lately = earlier.sum(states), earlier.sum(states, recent=True)
    logs, failing = _log_probabilities(earlier, shown, follow, hidden), _unless_it_fails(earlier, shown, hidden)
    driven = torch.from_numpy(found.memory == UNRELIABLE)
    logs[2][:, driven] = failing[:, driven[earlier.own]]
    afresh = estimated(_right(lately, shown), lately.sum(-1), STATES, SURE).masked_fill(hidden, 0.0)
    total, agreed, changed = follow.sum(-1), _right(follow, shown), (shown != before)[:, None].expand(follow.shape[:3])
    fresh, never, always = total == 0, (total > 0) & (agreed == 0), (total > 0) & (agreed == total)
    counted = (
        fresh, never, (agreed > 0) & ~always, always, always & changed, fresh & changed, changed,
        torch.ones_like(changed),
    )  # fmt: skip
    sums = [one.cumsum(-1) for one in logs]
    columns = [one / SCALE for one in sums]
    columns += [torch.log1p((one & ~hidden).float().cumsum(-1)) for one in counted]
    columns += [_lately(logs[0]) / SCALE, _lately(afresh) / SCALE, torch.log1p(_lately((never & ~hidden).float()))]
    every = sums[0].clone()
    every[:, earlier.own] = failing.cumsum(-1)
    every = _if_every_input_matters(found, every, shown)
    lasting = np.isin(found.memory, SINCE)
    every[:, torch.from_numpy(lasting)] = _if_it_lasts(found.contexts[:, lasting], shown, seen)
    [alone] = np.flatnonzero(found.own & ~found.inputs.any(1))
    every[:, alone] = _together(shown, before, seen.float()) if len(shown) > 1 else sums[2][:, alone]
    columns.append(every / SCALE)
    return torch.stack(columns, -1)


def _if_it_lasts(since: np.ndarray, shown: Tensor, seen: Tensor) -> Tensor:
    """Log probability of what was shown, (R, N, M), if it shows one state for some actions since a press, one to
    `LONGEST`, and another one later.

    Args:
        since: int (M, N), contexts.
    """
    longest = torch.arange(1, LONGEST + 1)
    on = (torch.from_numpy(since.T.copy())[:, None] < longest[:, None]).float()[..., None]  # (N, actions, M, 1)
    agrees = (torch.from_numpy(RESTED).float()[shown] * seen[..., None])[:, None, None]  # (R, 1, 1, M, states)
    first, then = (on * agrees).cumsum(-2), ((1 - on) * agrees).cumsum(-2)
    ways, state = known_states(shown)[:, None], torch.arange(STATES)
    known = state < ways[..., None]  # (R, 1, M, S)
    there = (state[:, None] != state) & (known[..., None] & known[..., None, :])[:, None]
    logs = (first[..., :, None] + then[..., None, :]).masked_fill(~there, -torch.inf)  # (R, N, actions, M, S, S)
    return torch.logsumexp(logs, (2, 4, 5)) - (len(longest) * ways * (ways - 1)).log()


def _if_every_input_matters(found: Explanations, logs: Tensor, shown: Tensor) -> Tensor:
    """Log probability of what was shown, (R, H, M), if the functions that do without an input are left out.

    The probability of an explanation is the share of its functions that agree with what was shown. Of these and of all
    functions those of fewer inputs are taken away, by inclusion and exclusion.
    """
    states = known_states(shown)[:, None].log()
    functions = torch.from_numpy(found.met)[:, None] * states  # log number of functions, (R, H, M)
    parts, signs = torch.from_numpy(found.parts), torch.from_numpy(found.signs)[..., None]

    def left(counts: Tensor) -> Tensor:
        apart = (counts[:, parts] - counts[:, :, None]).clamp(max=LARGEST)  # or exp would be infinite
        share = (apart.exp() * signs).sum(2)
        return share.clamp(min=FEWEST).log() + counts

    return left(logs + functions) - left(functions)


def _lately(numbers: Tensor) -> Tensor:
    """Sums over the last `RECENT` moments, (..., M)."""
    total = numbers.cumsum(-1)
    total[..., RECENT:] -= total[..., :-RECENT].clone()
    return total


def _of_inputs(earlier: Earlier, found: Explanations, shown: Tensor, seen: Tensor) -> Tensor:
    """(R, E, M, 2)."""
    row = torch.from_numpy(found.reads[0])
    apart = earlier.same[torch.from_numpy(found.fewer)] & ~earlier.same[row] & earlier.past  # (E, M, M)
    own = earlier.own[row]
    other, both = shown[:, :, None] != shown[:, None], seen[:, :, None] & seen[:, None]  # (R, M, M)
    told = []
    for pairs in (other & both, ~other & both):
        count = torch.empty(len(shown), len(row), shown.shape[1])
        for which, wanted in ((~own, pairs), (own, pairs & earlier.alike)):
            count[:, which] = torch.einsum("eab,rab->rea", apart[which].float(), wanted.float())
        told.append(torch.log1p(count.cumsum(-1)))
    return torch.stack(told, -1)
