"""When another mechanism took the place of the first one: rewirings, as far as what was shown tells.

What a responder showed is either explained by one explanation throughout, or by one until some action and another one,
which knows nothing of what was before, from then on. Both are weighed by the probability that explanations gave to what
came, before it came (Adams & MacKay, Bayesian online changepoint detection, 2007, with one change at most). How seldom
changes are, and what is luck, the network learns (`networks`). Cost: that of the evidence for every action at which the
change may have come.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import one_hot

from busybot.reason.models.mechanism.contexts import MEMORIES, STATES, Explanations, Trace
from busybot.reason.models.mechanism.evidence import Earlier, log_probabilities

NOTHING = -20.0
"""Log odds where nothing can have changed."""
_NOW = [MEMORIES.index(name) for name in ("none", "late 0")]
EARLIEST = 8
"""What was seen of a mechanism for fewer actions is not taken for another one."""


def changes_of(trace: Trace, found: Explanations) -> tuple[np.ndarray, np.ndarray]:
    """What speaks for a change of R responders' mechanisms, and where it lies.

    Returns:
        float32 (T + 1, R, 3), log odds on the new board and after each action, if changed and unchanged mechanisms were
        as frequent: of all explanations, of those without luck, and of one or two links as they are now; int (R,), the
        first action after which it showed what the new one makes of it, if there is one.
    """
    shown = torch.from_numpy(np.ascontiguousarray(trace.responders.T))
    before = torch.cat([shown[:, :1], shown[:, :-1]], 1)
    prior = _prior(trace, found)
    moments = shown.shape[1]
    now = np.isin(found.memory, _NOW) & (found.inputs.sum(1) <= 2) & ~found.inputs[:, -len(shown) :].any(1)
    kinds = [torch.from_numpy(np.flatnonzero(which)) for which in (np.ones_like(now), ~found.own, now)]
    first = _explained(found, shown, before, 0, prior, kinds)  # (R, M, 3)
    later = torch.full((len(shown), moments, moments, 3), -torch.inf)  # by the moment of the change, and until when
    for start in range(EARLIEST, moments):
        later[:, start, start:] = first[:, start - 1, None] + _explained(found, shown, before, start, prior, kinds)
    either = torch.logsumexp(later, 1) - torch.arange(moments).clamp(min=1).log()[:, None]
    odds = (either - first).clamp(min=NOTHING)
    return odds.transpose(0, 1).numpy(), later[:, :, -1, 0].argmax(1).numpy()


def _prior(trace: Trace, found: Explanations) -> Tensor:
    """Log probability of each explanation, (R, H): all that remember the same of equally many inputs share one."""
    kinds = found.memory * (found.inputs.shape[1] + 1) + found.inputs.sum(1)
    _, which, counts = np.unique(kinds, return_inverse=True, return_counts=True)
    share = torch.from_numpy(-np.log(counts[which.ravel()] * len(counts))).float()
    itself = torch.from_numpy(found.inputs[:, trace.links.shape[1] :].T.copy())
    return torch.where(itself, -torch.inf, share)


def _explained(
    found: Explanations, shown: Tensor, before: Tensor, start: int, prior: Tensor, kinds: Sequence[Tensor]
) -> Tensor:
    """Log probability of all that was shown from a moment on, until each later one, by these kinds of explanations,
    (R, M - start, kinds)."""
    earlier, own = Earlier(found, before, start), shown[:, start:]
    sure, _, either = log_probabilities(earlier, own, earlier.sum(one_hot(own, STATES).float()))
    told = torch.where(earlier.own[:, None], either, sure)  # what has no luck never shows anything else
    logs = told.cumsum(-1) + prior[..., None]
    return torch.stack([torch.logsumexp(logs.index_select(1, of), 1) for of in kinds], -1)
