"""The paper's ablation "w/o inference": no graph; all that was seen goes into predicting the next state.

What the paper leaves open, and what is chosen here: the spatial graph network embeds the observed frames and the one
that the action changes, which comes last; the convolution over time, the recurrent network and the last graph network
are those of the full model, without edge types.
"""

import numpy as np
import torch
from torch import Tensor, nn

from busybot.reason.paper_boards import STATE, Boards, Frames
from busybot.reason.paper_config import PaperNetworkConfig
from busybot.reason.paper_pairs import Pairs
from busybot.reason.paper_parts import Actions, GraphNet, Recurrent, TimeConvolution
from busybot.reason.paper_reasoner import foreseen
from busybot.reason.result import InferredGraph
from busybot.reason.sequence import CHANNELS, Sequence


class PaperHistoryNetwork(nn.Module):
    """Predicts features from all frames seen, the frame before an action, and the action."""

    def __init__(self, config: PaperNetworkConfig):
        super().__init__()
        self.config = config
        wide, seen = config.embedding, STATE + config.action
        self.actions = Actions(config)
        self.spatial = GraphNet(config, STATE, 0, wide, wide)
        self.node_time = TimeConvolution(config, seen + wide, wide)
        self.edge_time = TimeConvolution(config, 2 * seen + wide, wide)
        self.node_recurrent = Recurrent(config, wide, wide)
        self.edge_recurrent = Recurrent(config, wide, wide)
        self.decode = GraphNet(config, wide, wide, CHANNELS, 0)

    def forward(self, boards: Boards, images: int, noise: Tensor | None = None) -> tuple[Tensor, None]:
        """Predict each of the steps that follow the first `images` frames, (M, S, 256); there is no graph."""
        return self.foresee(boards.pairs, boards.observed(images), boards.predicted(images)[0]), None

    def foresee(self, pairs: Pairs, observed: Frames, frames: Frames) -> Tensor:
        """Features after each frame's action, (M, S, 256), every frame on its own."""
        count = observed.states.shape[1]
        states = torch.cat([observed.states, frames.states], 1)
        nodes, edges = self.spatial(pairs, states, None)
        acted = torch.cat([self.actions(observed), self.actions(frames)], 1)
        after = []
        for last in range(count, states.shape[1]):
            known = [*range(count), last]
            seen = torch.cat([states[:, known], acted[:, known]], -1)
            node = self.node_time(torch.cat([nodes[:, known], seen], -1))
            edge = self.edge_time.of_pairs(pairs, seen, edges[:, known])
            after.append(self.decode(pairs, self.node_recurrent(node), self.edge_recurrent(edge))[0])
        predicted = torch.cat(after, 1)
        return predicted + frames.states[..., :CHANNELS] if self.config.residual else predicted


class PaperHistoryReasoner:
    """The ablation as a `Reasoner`: claims no relation.

    Args:
        network: trained.
        encoder: which features it was trained on.
    """

    name = "paper without inference"

    def __init__(self, network: PaperHistoryNetwork, encoder: str):
        self.network, self.encoder = network.eval(), encoder

    def graph(self, seen: Sequence) -> InferredGraph:
        """No relations."""
        return InferredGraph(self.name, np.zeros((max(1, seen.steps), *seen.candidates.shape)))

    @torch.no_grad()
    def predict(self, seen: Sequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """Features after each of S steps, as `Reasoner.predict`; what is no responder stays as it is."""
        return foreseen(self.network, seen, current, actions, acted)
