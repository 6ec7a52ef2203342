"""The `paper` model of relations: its networks and the trained reasoner (paper section 4.2, appendix A.1).

Inference, from the first frames and the actions between them:

1. the first graph network embeds nodes and edges in every frame (128-d);
2. with the frame's states and the embedded actions these go through a convolution over time;
3. the second graph network tells each edge's type: no relation, or a relation;
4. conditioned on the types, the third one gives each edge a 32-d embedding of how it acts.

Dynamics, from one frame, the action and the edges: a graph network embeds nodes and edges of related pairs, a recurrent
network takes in the action, and a last graph network decodes the features after the action.

What the paper leaves open, and what is chosen here (see also `config`):

- An edge is a pair of two nodes: none leads from a node to itself.
- The second graph network propagates twice, the others once; only node outputs of the last one and edge outputs of the
  second and third are used. V-CDN has it so.
- "4 layers for edges" is one perceptron of four layers; V-CDN has two of two layers where there are two types.
- Edges of the type "no relation" carry no messages in the dynamics network.
- Training draws edge types with Gumbel-softmax noise; otherwise an edge's types are their probabilities.
- What follows the last observed frame is not known to the inference network: zeros, as where nothing is acted on.
- Networks begin with torch's default weights, but for the layers that embed actions (`learner.make_network`).

Without inference (the paper's ablation) all that was seen goes into predicting the next state. What is chosen there:
the spatial graph network embeds the observed frames and the one that the action changes, which comes last; the
convolution over time, the recurrent network and the last graph network are those of the full model, without edge types.

Every network computes its edge functions in one of two forms that give the same numbers (`parts.EdgeFunction`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from busybot.reason.inputs.sequence import CHANNELS, BoardSequence
from busybot.reason.models.base import InferredGraph
from busybot.reason.models.paper.config import PaperNetworkConfig, PaperReasonConfig
from busybot.reason.models.paper.data import STATE, Boards, Frames, boards_of, states_of
from busybot.reason.models.paper.parts import KINDS, Actions, GraphNet, Recurrent, TimeConvolution, factor


@dataclass(frozen=True)
class Relations:
    """The inferred graph.

    Attributes:
        logits: (P, 2), of "no relation" and "relation".
        types: (P, 2), weights of the two types, which add up to 1.
        embeddings: (P, 1, 32), how each edge acts.
    """

    logits: Tensor
    types: Tensor
    embeddings: Tensor

    @property
    def probabilities(self) -> Tensor:
        """(P,), of a relation."""
        return self.logits.softmax(-1)[:, 1]


class PaperNetwork(nn.Module):
    """Inference and dynamics networks; 18.4 M parameters as the paper has them:

        E = f_inference(n_1, a_1, ..., n_F)        n_t+1 = f_dynamics(n_t, a_t, E)

    Args:
        factored: multiply nodes before they are joined to edges, not after: the same numbers in less time.

    Shapes:
        edge_index: (2, P).
        frames: see `Frames`.
        output: (M, F, 256), and `Relations`.
    """

    def __init__(self, config: PaperNetworkConfig, factored: bool = True):
        super().__init__()
        self.config = config
        wide, edge, seen = config.embedding, config.edge_embedding, STATE + config.action
        self.actions = Actions(config)
        self.spatial = GraphNet(config, STATE, 0, wide, wide)
        self.node_time = TimeConvolution(config, seen + wide, wide)
        self.edge_time = TimeConvolution(config, 2 * seen + wide, wide)
        self.edge_types = GraphNet(config, wide, wide, 0, KINDS, steps=2)
        self.edge_embeddings = GraphNet(config, wide, wide, 0, edge, types=KINDS)
        self.dynamic = GraphNet(config, STATE, edge, wide, wide)
        self.node_recurrent = Recurrent(config, seen + wide, wide)
        self.edge_recurrent = Recurrent(config, 2 * seen + wide + edge, wide)
        self.decode = GraphNet(config, seen + wide, wide + edge, CHANNELS, 0)
        factor(self, factored)

    def forward(
        self, boards: Boards, images: int, noise: Tensor | None = None, steps: int | None = None
    ) -> tuple[Tensor, Relations]:
        """Infer the graph from the first `images` frames and predict each of the following steps from its true frame,
        (M, S, 256).

        Args:
            steps: at most so many; None for all.
        """
        relations = self.infer(boards.edge_index, boards.observed(images), noise)
        return self.predict(boards.edge_index, boards.predicted(images, steps)[0], relations), relations

    def infer(self, edge_index: Tensor, frames: Frames, noise: Tensor | None = None) -> Relations:
        """Relations from observed frames.

        Args:
            noise: (P, 2), Gumbel noise with which the types are drawn; None for their probabilities.
        """
        nodes, edges = self.spatial(edge_index, frames.states, None)
        return self.relate(edge_index, frames, nodes, edges, noise)

    def relate(
        self, edge_index: Tensor, frames: Frames, nodes: Tensor, edges: Tensor, noise: Tensor | None = None
    ) -> Relations:
        """Relations from spatial embeddings: nodes (M, F, 128) and edges (P, F, 128)."""
        seen = torch.cat([frames.states, self.actions(frames)], -1)
        node = self.node_time(torch.cat([nodes, seen], -1))
        edge = self.edge_time.of_edges(edge_index, seen, edges)
        logits = self.edge_types(edge_index, node, edge)[1][:, 0]
        types = drawn(logits, noise, self.config.temperature)
        return Relations(logits, types, self.edge_embeddings(edge_index, node, edge, types)[1])

    def predict(self, edge_index: Tensor, frames: Frames, relations: Relations) -> Tensor:
        """Features after each frame's action, (M, F, 256), every frame on its own."""
        related = relations.types[:, 1:]  # (P, 1): edges without a relation carry no messages
        acting = relations.embeddings.expand(-1, frames.states.shape[1], -1)
        node, edge = self.dynamic(edge_index, frames.states, acting, related)
        seen = torch.cat([frames.states, self.actions(frames)], -1)
        node = self.node_recurrent(torch.cat([node, seen], -1))
        edge = self.edge_recurrent.of_edges(edge_index, seen, torch.cat([edge, acting], -1))
        after = self.decode(edge_index, torch.cat([node, seen], -1), torch.cat([edge, acting], -1), related)[0]
        return after + frames.states[..., :CHANNELS] if self.config.residual else after


class PaperHistoryNetwork(nn.Module):
    """The ablation without inference: n_t+1 = f(n_1, a_1, ..., n_F, n_t, a_t). Arguments as of `PaperNetwork`."""

    def __init__(self, config: PaperNetworkConfig, factored: bool = True):
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
        factor(self, factored)

    def forward(
        self, boards: Boards, images: int, noise: Tensor | None = None, steps: int | None = None
    ) -> tuple[Tensor, None]:
        """Predict each of the steps that follow the first `images` frames, (M, S, 256); there is no graph."""
        return self.foresee(boards.edge_index, boards.observed(images), boards.predicted(images, steps)[0]), None

    def foresee(self, edge_index: Tensor, observed: Frames, frames: Frames) -> Tensor:
        """Features after each frame's action, (M, S, 256), every frame on its own."""
        count = observed.states.shape[1]
        states = torch.cat([observed.states, frames.states], 1)
        nodes, edges = self.spatial(edge_index, states, None)
        acted = torch.cat([self.actions(observed), self.actions(frames)], 1)
        after = []
        for last in range(count, states.shape[1]):
            known = [*range(count), last]
            seen = torch.cat([states[:, known], acted[:, known]], -1)
            node = self.node_time(torch.cat([nodes[:, known], seen], -1))
            edge = self.edge_time.of_edges(edge_index, seen, edges[:, known])
            after.append(self.decode(edge_index, self.node_recurrent(node), self.edge_recurrent(edge))[0])
        predicted = torch.cat(after, 1)
        return predicted + frames.states[..., :CHANNELS] if self.config.residual else predicted


def drawn(logits: Tensor, noise: Tensor | None, temperature: float) -> Tensor:
    """Weights of the types: drawn by Gumbel-softmax, or their probabilities."""
    return logits.softmax(-1) if noise is None else ((logits + noise) / temperature).softmax(-1)


Network = PaperNetwork | PaperHistoryNetwork


def network_of(config: PaperReasonConfig) -> Network:
    """The networks that are trained with these parameters."""
    return PaperNetwork(config.network) if config.inference else PaperHistoryNetwork(config.network)


class PaperReasoner:
    """The trained networks as a `Reasoner`; judges one board at a time. The ablation claims no relation.

    Args:
        network: trained.
        encoder: which features it was trained on.
        threshold: an edge is claimed beyond this probability. 0.5 is the likelier type, as the authors have it.
    """

    def __init__(self, network: Network, encoder: str, threshold: float = 0.5):
        self.network, self.encoder, self.threshold = network.eval(), encoder, threshold
        self.name = "paper" if isinstance(network, PaperNetwork) else "paper without inference"

    def graph(self, seen: BoardSequence) -> InferredGraph:
        """Edge probabilities after each step, and from the first frame alone: the prior. Zeros but for candidates."""
        beliefs = self._beliefs(seen, range(seen.steps + 1))
        return self._told(beliefs[1:] if seen.steps else beliefs, beliefs[0])

    def graph_at_the_end(self, seen: BoardSequence) -> InferredGraph:
        """See `Brief`."""
        beliefs = self._beliefs(seen, sorted({0, seen.steps}))
        return self._told(beliefs[-1:], beliefs[0])

    def _told(self, beliefs: np.ndarray, prior: np.ndarray) -> InferredGraph:
        known = isinstance(self.network, PaperNetwork)
        return InferredGraph(self.name, beliefs, self.threshold, prior if known else None)

    @torch.no_grad()
    def _beliefs(self, seen: BoardSequence, after: Sequence[int]) -> np.ndarray:
        """Edge probabilities after so many steps each; the ablation has none, which is zeros."""
        beliefs = np.zeros((len(after), *seen.candidates.shape))
        if not isinstance(self.network, PaperNetwork):
            return beliefs
        boards = self.board_of(seen)
        if boards.edge_index.shape[1]:
            frames = boards.observed(seen.steps + 1)
            nodes, edges = self.network.spatial(boards.edge_index, frames.states, None)
            for place, step in enumerate(after):
                first, known = frames.first(step + 1), slice(0, step + 1)
                relations = self.network.relate(boards.edge_index, first, nodes[:, known], edges[:, known])
                beliefs[place] = _matrix(boards, relations.probabilities, seen)
        return beliefs

    @torch.no_grad()
    def predict(self, seen: BoardSequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """Features after each of S steps, as `Reasoner.predict`; what is no responder stays as it is."""
        after = np.array(current, np.float32)
        boards = self.board_of(seen)
        if not boards.edge_index.shape[1] or not len(actions):
            return after
        features = boards.features.new_zeros(len(boards.positions), len(actions), after.shape[-1])
        features[: after.shape[1]] = torch.from_numpy(after).to(features).transpose(0, 1)
        frames = Frames(
            states_of(features, boards.positions),
            torch.from_numpy(np.array(actions, np.float32)).to(features)[None],
            torch.from_numpy(np.array(acted, np.int64)).to(features.device)[None],
        )
        predicted = self._foreseen(seen, boards, frames)
        after[:, seen.responders] = predicted.transpose(0, 1).cpu().numpy()[:, np.flatnonzero(seen.responders)]
        return after

    def _foreseen(self, seen: BoardSequence, boards: Boards, frames: Frames) -> Tensor:
        """Features after each frame's action, (M, S, 256); relations are inferred once, an agent asks at every step."""
        network, observed = self.network, boards.observed(seen.steps + 1)
        if not isinstance(network, PaperNetwork):
            return network.foresee(boards.edge_index, observed, frames)
        relations = seen.once((self, "relations"), lambda: network.infer(boards.edge_index, observed))
        return network.predict(boards.edge_index, frames, relations)

    def board_of(self, seen: BoardSequence) -> Boards:
        """One board, where the network is."""
        device = next(self.network.parameters()).device
        return seen.once((self, "board"), lambda: boards_of([seen], self.network.config).to(device))


def _matrix(boards: Boards, values: Tensor, seen: BoardSequence) -> np.ndarray:
    """(P,) of one board as (N, N), trigger in the row and responder in the column; zeros but for candidates."""
    count = len(seen.positions)
    matrix = np.zeros((len(boards.positions), len(boards.positions)))
    matrix[tuple(boards.edge_index.cpu().numpy())] = values.cpu().numpy()
    return np.where(seen.candidates, matrix[:count, :count], 0)
