"""The trained `event` networks as a `Reasoner`."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch_geometric.data import Batch
from torch_geometric.utils import scatter

from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.base import InferredGraph
from busybot.reason.models.event.data import Context, Queries, apart, board_graph, context_of, trigger_rows
from busybot.reason.models.event.networks import Effects, EventNet
from busybot.training.device import threads


class EventReasoner:
    """Judges one board at a time, in one thread: networks so small gain nothing from more, which wait for each other.

    Args:
        network: trained.
        encoder: which features it was trained on.
        blur: looks so near each other are the same, in units of the smallest change (`LossConfig.blur`).
    """

    name = "event"

    def __init__(self, network: EventNet, encoder: str, blur: float = 0.5):
        self.network, self.encoder, self.blur = network.eval(), encoder, blur

    @threads(1)
    @torch.no_grad()
    def graph(self, seen: BoardSequence) -> InferredGraph:
        """Edge probabilities after each step, and before the first: the prior. Zeros but for candidates.

        A network without inference claims no relation.
        """
        beliefs = np.zeros((seen.steps + 1, *seen.candidates.shape))
        if not self.network.inference:
            return InferredGraph(self.name, beliefs[: max(1, seen.steps)])
        known = self._known(seen)
        for step in range(seen.steps + 1):
            # pairs stand in the order of the candidates
            beliefs[step][seen.candidates] = self.network.log_edges(known.first(step))[0].exp().numpy()
        return InferredGraph(self.name, beliefs[1:] if seen.steps else beliefs, prior=beliefs[0])

    @threads(1)
    @torch.no_grad()
    def predict(self, seen: BoardSequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """Features after each of S steps, as `Reasoner.predict`: each is a copy, of the current ones or of earlier."""
        result = np.array(current, np.float32)
        responders = np.flatnonzero(seen.responders)
        if not len(responders) or not len(actions) or not seen.steps:
            return result
        known = self._known(seen)
        looks = torch.from_numpy(np.ascontiguousarray(seen.features[:, responders].swapaxes(0, 1)))
        now = torch.from_numpy(np.ascontiguousarray(result[:, responders].swapaxes(0, 1)))
        asked = Queries(
            apart(now, looks) / self.network.scale,
            torch.from_numpy(np.asarray(actions, np.float32))[None],
            torch.from_numpy(trigger_rows(seen.triggers, np.asarray(acted, np.int64)))[None],
        )
        choice = likeliest_outcome(self.network, known, asked, self.blur)
        for row, step in torch.nonzero(choice.frame >= 0).tolist():
            result[step, responders[row]] = seen.features[int(choice.frame[row, step]), responders[row]]
        return result

    def _known(self, seen: BoardSequence) -> Context:
        return context_of(Batch.from_data_list([board_graph(seen)]), self.network.scale)


@dataclass(frozen=True)
class LikeliestOutcome:
    """What is expected of each step.

    Attributes:
        frame: int (R, Q), the frame whose look is copied; -1 where the responder stays as it is.
        change: (R, Q), probability that it changes.
    """

    frame: Tensor
    change: Tensor


def likeliest_outcome(network: EventNet, seen: Context, asked: Queries, blur: float) -> LikeliestOutcome:
    """The likeliest look of every responder after every step: the present one or an earlier one."""
    effects = network.effects(seen, asked)
    log_edges, _ = network.log_edges(seen)
    trigger, row = seen.edge_index
    on = asked.acted[seen.board[row]] == trigger[:, None]  # (E, Q)
    edge = scatter(log_edges.exp()[:, None] * on, row, dim_size=len(seen.board), reduce="sum")
    change = edge * torch.sigmoid(effects.change)
    if not effects.frames.shape[1]:
        return LikeliestOutcome(torch.full(change.shape, -1), change)
    likely, best = (change.unsqueeze(-1) * _mass(effects, seen, blur)).max(-1)
    frame = effects.frames[:, None].expand(-1, change.shape[1], -1).gather(2, best.unsqueeze(-1))[..., 0]
    return LikeliestOutcome(torch.where(likely > 1 - change, frame, -1), change)


def _mass(effects: Effects, seen: Context, blur: float) -> Tensor:
    """Probability of the look of each candidate, (R, Q, 2K): candidates that look alike support each other."""
    frames = effects.frames
    rows = seen.distances.gather(1, frames[:, :, None].expand(-1, -1, seen.distances.shape[2]))
    between = rows.gather(2, frames[:, None].expand(-1, frames.shape[1], -1))  # (R, 2K, 2K)
    alike = torch.exp(-0.5 * (between / blur) ** 2)
    return torch.einsum("rqc,rcd->rqd", effects.choice[..., :-1].exp(), alike)
