"""The event model's loss: the likelihood of what happened, by its two stages and the edges.

After a step a responder looks as before, or, if its trigger was acted on, as before or after a past change of it, or
like nothing seen yet. Around each known look there is a bell, so a step has a likelihood; a responder's steps together
have one for each possible trigger, and the edge probabilities weigh those. The sum over triggers is exact: they are
few, so no edges need be drawn (Gumbel) as in the paper.
"""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional
from torch_geometric.utils import scatter

from busybot.reason.models.event.config import LossConfig
from busybot.reason.models.event.data import Context, ObservedOutcome, Queries
from busybot.reason.models.event.networks import Effects, EventNet, log_sum


@dataclass(frozen=True)
class Loss:
    """Scalars.

    Attributes:
        total: what is minimised.
        surprise: mean negative log likelihood of a responder's step.
        divergence: of the edges from their prior, mean over responders.
    """

    total: Tensor
    surprise: Tensor
    divergence: Tensor


def loss_of(net: EventNet, seen: Context, asked: Queries, outcome: ObservedOutcome, config: LossConfig) -> Loss:
    """Loss of the steps asked for, given the known ones."""
    log_edges, log_none = net.log_edges(seen)
    controlled, idle = log_likelihoods(net.effects(seen, asked), outcome, config)  # (R, Q) each
    real = outcome.real[seen.board]
    trigger, row = seen.edge_index
    on = (asked.acted[seen.board[row]] == trigger[:, None]) & real[row]  # (E, Q)
    gain = ((controlled - idle)[row] * on).sum(1)
    if net.exclusive:
        explained = log_sum(log_edges + gain, log_none, row)
    else:
        mixed = torch.logaddexp(log_edges + gain, log_not(log_edges))
        explained = scatter(mixed, row, dim_size=len(seen.board), reduce="sum")
    surprise = -((idle * real).sum() + explained.sum()) / real.sum().clamp(min=1)
    apart = divergence(log_edges, log_none, row, config.prior, net.exclusive)
    return Loss(surprise + config.divergence * apart, surprise, apart)


def log_likelihoods(effects: Effects, outcome: ObservedOutcome, config: LossConfig) -> tuple[Tensor, Tensor]:
    """Of what each responder looks like afterwards, (R, Q): if its trigger was acted on, and if not."""

    def bell(distance: Tensor) -> Tensor:
        return torch.exp(-0.5 * (distance / config.blur) ** 2)

    stayed = bell(outcome.moved)
    copies = bell(outcome.look.gather(2, effects.frames[:, None].expand(-1, outcome.look.shape[1], -1)))
    choice = torch.exp(effects.choice)
    became = (choice[..., :-1] * copies).sum(-1) + choice[..., -1] * config.unknown
    change = torch.sigmoid(effects.change)
    controlled = (1 - change) * stayed + change * became
    return _log(controlled, config.floor), _log(stayed, config.floor)


def _log(likelihood: Tensor, floor: float) -> Tensor:
    return torch.log(floor + (1 - floor) * likelihood)


def log_not(log_probability: Tensor) -> Tensor:
    """log(1 - p) for log p <= 0."""
    return torch.log(-torch.expm1(log_probability.clamp(max=-1e-6)))


def divergence(log_edges: Tensor, log_none: Tensor, row: Tensor, prior: float, exclusive: bool) -> Tensor:
    """Kullback-Leibler divergence of the edges (E,) from edges of probability `prior` each, mean over responders (R,).

    For exclusive edges the odds of each against "no trigger" are those of the prior.
    """
    odds = torch.logit(torch.tensor(prior)).expand_as(log_edges)
    if exclusive:
        none = -log_sum(odds, torch.zeros_like(log_none), row)
        per_pair = log_edges.exp() * (log_edges - odds - none[row])
        per_row = log_none.exp() * (log_none - none)
    else:
        absent = log_not(log_edges)
        present = log_edges.exp() * (log_edges - functional.logsigmoid(odds))
        per_pair = present + absent.exp() * (absent - functional.logsigmoid(-odds))
        per_row = torch.zeros_like(log_none)
    return (scatter(per_pair, row, dim_size=len(log_none), reduce="sum") + per_row).mean()
