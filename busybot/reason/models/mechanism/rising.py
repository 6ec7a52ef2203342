"""Which way round links are. Pictures show that a link has two states; which is the higher one, its look may tell.

Gates are true, and presses count, where links rest in their highest state. Objects of the training split are known:
which way a link of this form was pushed when it rose. What looks like none of them is left open. What that tells of an
explanation (`explained`) is a ratio of probabilities: of a gate of two links, that it is one of both resting high, or
both low, as far as what was shown leaves that open (`alike_of`); of presses, that this way was up.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import logsigmoid

from busybot.reason.inputs.trigger_links import ObservedLinks
from busybot.reason.models.mechanism.contexts import (
    REMEMBERED,
    RESTED,
    STATES,
    Explanations,
    Trace,
    attempts,
    layout,
    memories,
)
from busybot.reason.pyg import scatter

FORM = 10
"""Numbers of a form: direction in which a link was pushed from its lowest number to its highest (3), outlines
(`ObservedLinks.outlines`, the box's by their logarithms), number of states."""
SCALES = (1, 1, 1, 8, 8, 20, 20, 20, 20, 1)
NEAR, OPEN = 0.2, 0.3
"""How far apart like forms are; and how many more of each way round are imagined than were seen. These three were
chosen by what training boards, and training objects, tell of each other."""
KEPT = 1024
"""So many forms are known at most."""
SUREST = 0.95
"""No link is believed to be one way round with a greater probability: mechanisms that training never saw read links
otherwise."""
FARTHEST = 20.0
"""Log odds beyond it say no more."""
_TABLED = memories("states")


def forms_of(links: ObservedLinks) -> np.ndarray:
    """What L links look like, float32 (L, FORM); NaN where that was not seen."""
    steps = range(STATES - 1)
    pushed = [sum((one[k, k + 1] - one[k + 1, k] for k in steps), np.zeros(3)) for one in links.directions]
    ways = np.array(pushed, float).reshape(-1, 3)
    lengths = np.linalg.norm(ways, axis=1, keepdims=True)
    ways = np.divide(ways, lengths, out=np.full_like(ways, np.nan), where=lengths > 0)
    outlines = np.full((len(ways), 6), np.nan) if links.outlines is None else links.outlines
    box, own = np.log(outlines[:, :2]), outlines[:, 2:]
    return np.hstack([ways, box, own, np.array(links.sizes, float).reshape(-1, 1)]).astype(np.float32)


class Rising(nn.Module):
    """Log odds that the states of links are numbered as they rise, from what is known of links like them.

    Shapes:
        input: (L, FORM).
        output: (L,); 0 where a form is NaN.
    """

    forms: Tensor
    rises: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("forms", torch.zeros(KEPT, FORM))
        self.register_buffer("rises", torch.zeros(KEPT))

    def learn(self, forms: np.ndarray, rises: np.ndarray) -> None:
        """Remember links, `KEPT` at most, whose states are numbered as they rise (1), or the other way round (-1)."""
        self.forms.zero_()
        self.rises.zero_()
        self.forms[: len(forms)] = torch.from_numpy(forms)
        self.rises[: len(forms)] = torch.from_numpy(rises).float()

    def forward(self, forms: Tensor) -> Tensor:
        """See above."""
        return odds_of(forms, self.forms, self.rises)


def odds_of(forms: Tensor, known: Tensor, rises: Tensor) -> Tensor:
    """See `Rising`; a link that was pushed the other way is another one the other way round.

    Args:
        known: (N, FORM).
        rises: float (N,), 1 or -1; 0 for what does not count.
    """
    scales, back = forms.new_tensor(SCALES), forms.new_ones(FORM)
    back[:3] = -1
    asked, told = torch.nan_to_num(forms)[:, None] * scales, known * scales
    near = [torch.exp(-((asked - other) ** 2).sum(-1) / (2 * NEAR**2)) * rises.abs() for other in (told, told * back)]
    higher = (near[0] * (rises > 0) + near[1] * (rises < 0)).sum(-1) + OPEN / 2
    lower = (near[0] * (rises < 0) + near[1] * (rises > 0)).sum(-1) + OPEN / 2
    most = float(np.log(SUREST / (1 - SUREST)))
    return torch.where(forms.isnan().any(-1), 0.0, (higher / lower).log().clamp(-most, most))


def alike_of(trace: Trace, found: Explanations, after: Sequence[int]) -> Tensor:
    """Of explanations by two links of two states: log odds, after so many actions each, that of the four combinations
    of these the one that differs from the other three has both in states of one number, if one does. Float32 (R, H, K);
    0 for all others."""
    links, responders = trace.links.shape[1], torch.from_numpy(np.ascontiguousarray(trace.responders.T))
    two = np.array(trace.sizes) == 2
    gates = np.isin(found.memory, _TABLED) & (found.inputs.sum(1) == 2) & ((found.inputs[:, :links] & two).sum(1) == 2)
    told = torch.zeros(len(responders), len(gates), len(after))
    seen = torch.from_numpy(trace.seen.T)[..., None]
    rests = torch.from_numpy(RESTED)[responders] * seen  # (R, M, S)
    fails = torch.from_numpy(attempts(responders.numpy())) * seen
    for logs, own in ((rests, False), (fails, True)):
        rows = np.flatnonzero(gates & (found.own == own))
        met = torch.from_numpy(found.contexts[:, rows, None] == _COMBINED)  # (M, rows, 4)
        each = torch.einsum("mhc,rms->rmhcs", met.double(), logs).cumsum(1)[:, torch.as_tensor(after)]
        combined = torch.einsum("rkhcs,fc->rkhfs", each, _DIFFERING)
        functions = combined[..., None] + (each.sum(-2, keepdim=True) - combined)[..., None, :]
        functions.masked_fill_(torch.eye(STATES, dtype=torch.bool), -torch.inf)  # both would show the same
        total = torch.logsumexp(functions, (-2, -1))  # (R, K, rows, 5)
        odds = torch.logsumexp(total[..., _ALIKE], -1) - torch.logsumexp(total[..., _UNLIKE], -1)
        told[:, rows] = odds.clamp(-FARTHEST, FARTHEST).transpose(1, 2).float()
    return told


_COMBINED = np.array([0, 1, STATES, STATES + 1])
"""Contexts of two links of two states: both low, the first high, the second, both."""
_DIFFERING = torch.tensor([[1, 0, 0, 0], [0, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 1, 1, 0]]).double()
_ALIKE, _UNLIKE = [0, 1, 4], [2, 3, 4]
"""Functions of these: which differ from the others. An exclusive or is one whichever way round links are."""


def ways_of(links: int, responders: int) -> np.ndarray:
    """Of each input that an explanation reads, the way in which it has to be pressed, int (E,): 1 up, -1 down, 0 for
    what reads no presses."""
    known = layout(links, responders)
    told = []
    for number, row in enumerate(known.inputs):
        ways = REMEMBERED[known.memory[number]].ways
        told += [-1 if way else 1 for way in ways] or [0] * int(row.sum())
    return np.array(told, int)


def lawful(ratio: Tensor, shares: Tensor, owner: Tensor, board: Tensor, boards: int) -> Tensor:
    """Logarithms of how much more probable explanations are, float (X, K), if it is as likely as not that a board's
    mechanisms follow the law at all: what explains its other responders tells that.

    Args:
        ratio: (X, K), as of `explained`, where they follow it.
        shares: (X, K), how probable explanations are without it.
        owner: (X,), the responder that an explanation explains, of R.
        board: (R,), the board of a responder.
        boards: how many there are.
    """
    own = scatter(shares * ratio.exp(), owner, dim_size=len(board), reduce="sum").log()
    others = scatter(own, board, dim_size=boards, reduce="sum")[board] - own
    odds = others[owner]
    return torch.logaddexp(ratio + logsigmoid(odds), logsigmoid(-odds))


def explained(rising: Tensor, read: Tensor, source: Tensor, ways: Tensor, alike: Tensor) -> Tensor:
    """How much more probable explanations are for which way round links seem to be, (X, K): logarithms.

    Args:
        rising: log odds of all inputs, 0 where nothing is known.
        read: of each input that an explanation reads, its number.
        source: the explanation.
        ways: as of `ways_of`.
        alike: (X, K), as of `alike_of`.
    """
    odds = rising[read]
    both = odds.new_ones(len(alike)).scatter_reduce(0, source, torch.tanh(odds / 2), "prod")[:, None]
    gates = torch.log1p(both * torch.tanh(alike / 2))  # 2 (q s + (1 - q) (1 - s)), q and s as differences
    pressed = torch.where(ways == 0, 0.0, logsigmoid(ways * odds) + np.log(2))
    return gates + odds.new_zeros(len(alike)).scatter_add(0, source, pressed)[:, None]
