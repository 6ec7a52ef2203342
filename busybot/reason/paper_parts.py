"""What the paper's graph networks are built of (paper appendix A.1 "Reasoning module", "Network details").

Layers for edges begin with a linear map of (receiver, sender, edge), which `paper_pairs` computes without joining them.
`paper_dense` has the same networks as the paper writes them, on the same weights.
"""

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from busybot.reason.paper_boards import ACTION, Frames
from busybot.reason.paper_config import PaperNetworkConfig
from busybot.reason.paper_pairs import Pairs

KINDS = 2
"""Types of edges: 0 no relation, 1 relation."""


class Actions(nn.Module):
    """Embeds the action on each node: three linear layers with ReLUs between them.

    A node that is not acted on has an action of zeros. It is embedded once for all.
    """

    def __init__(self, config: PaperNetworkConfig):
        super().__init__()
        first, *rest = (nn.Linear(a, b) for a, b in pairwise((ACTION, *[config.action] * 3)))
        self.layers = nn.Sequential(first, *(part for layer in rest for part in (nn.ReLU(), layer)))

    def forward(self, frames: Frames) -> Tensor:
        """(M, F, 256), for every node and frame."""
        still = self.layers(frames.actions.new_zeros(ACTION))
        embedded = still.expand(*frames.states.shape[:2], -1).clone()
        board, frame = torch.nonzero(frames.actors >= 0, as_tuple=True)
        embedded[frames.actors[board, frame], frame] = self.layers(frames.actions[board, frame])
        return embedded


class Normalise(nn.BatchNorm1d):
    """Batch normalisation of the last axis over all others."""

    def forward(self, input: Tensor) -> Tensor:
        return super().forward(input.flatten(0, -2)).view(input.shape)


class Layers(nn.Module):
    """Linear layers, a ReLU after each, batch normalisation at the end.

    Args:
        widths: of the input and of each layer.
    """

    def __init__(self, widths: tuple[int, ...], normalise: bool):
        super().__init__()
        first, *rest = (nn.Linear(a, b) for a, b in pairwise(widths))
        self.first, self.rest = first, nn.ModuleList(rest)
        self.normalise = Normalise(widths[-1]) if normalise else nn.Identity()

    def forward(self, x: Tensor) -> Tensor:
        return self.after(self.first(x))

    def of_pairs(self, pairs: Pairs, nodes: Tensor, edges: Tensor | None) -> Tensor:
        """The same for an input of (receiver, sender, edge)."""
        return self.after(pairs.linear(self.first.weight, self.first.bias, nodes, edges))

    def after(self, x: Tensor) -> Tensor:
        """What follows the first linear map."""
        for layer in self.rest:
            x = layer(functional.relu(x))
        return self.normalise(functional.relu(x))


class GraphNet(nn.Module):
    """A graph network like the Interaction Network:

        h_ij = f_rel(n_i, n_j, e_ij)        h_i = f_obj(n_i, sum over j of h_ij)

    Encode (1 layer), propagate (4 layers for edges and 2 for nodes in each step), decode (2 layers).

    With several types of edges there is an encoder and, in each step, a propagator for each type; what they say of an
    edge is weighted with the edge's types and added. All steps share the node's layers, as in V-CDN.

    Args:
        node_in, edge_in: numbers that nodes and edges come with.
        node_out, edge_out: numbers that they leave with; 0 for none.
        types: types of edges.
        steps: of propagation.
    """

    def __init__(
        self,
        config: PaperNetworkConfig,
        node_in: int,
        edge_in: int,
        node_out: int,
        edge_out: int,
        types: int = 1,
        steps: int = 1,
    ):
        super().__init__()
        hidden, normalise = config.hidden, config.normalise
        self.encode_node = Layers((node_in, hidden), normalise)
        self.encode_edge = nn.ModuleList(Layers((2 * node_in + edge_in, hidden), normalise) for _ in range(types))
        along = (3 * hidden, *[hidden] * config.edge_layers)
        self.propagate_edge = nn.ModuleList(
            nn.ModuleList(Layers(along, normalise) for _ in range(types)) for _ in range(steps)
        )
        self.propagate_node = Layers((3 * hidden, *[hidden] * config.node_layers), normalise)
        self.decode_node = _decoder(hidden, node_out, normalise)
        self.decode_edge = _decoder(hidden, edge_out, normalise)

    def forward(
        self, pairs: Pairs, nodes: Tensor, edges: Tensor | None, weights: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Pass messages.

        Shapes:
            nodes: (M, F, node_in).
            edges: (P, F, edge_in), or None if they come with nothing.
            weights: (P, types), of the types of each edge; None for 1.
            output: (M, F, node_out) and (P, F, edge_out).
        """
        node, edge = self.encode_node(nodes), _mixed(self.encode_edge, pairs, nodes, edges, weights)
        node_effect, edge_effect = node, edge
        for propagate in self.propagate_edge:
            assert isinstance(propagate, nn.ModuleList)
            edge_effect = _mixed(propagate, pairs, node_effect, edge_effect, weights)
            node_effect = self.propagate_node(torch.cat([node, node_effect, pairs.gather(edge_effect)], -1))
        return (
            self.decode_node(torch.cat([node_effect, node], -1)),
            self.decode_edge(torch.cat([edge_effect, edge], -1)),
        )


def _mixed(by_type: nn.ModuleList, pairs: Pairs, nodes: Tensor, edges: Tensor | None, weights: Tensor | None) -> Tensor:
    """(P, F, H): what the types' layers say, weighted and added."""
    said = [layers.of_pairs(pairs, nodes, edges) for layers in by_type]  # type: ignore[operator]
    if weights is None:
        return torch.stack(said).sum(0) if len(said) > 1 else said[0]
    return sum((weights[:, kind, None, None] * each for kind, each in enumerate(said)), torch.zeros_like(said[0]))


class Nothing(nn.Module):
    """For what is not asked for."""

    def forward(self, x: Tensor) -> Tensor:
        return x[..., :0]


def _decoder(hidden: int, outputs: int, normalise: bool) -> nn.Module:
    if not outputs:
        return Nothing()
    return nn.Sequential(Layers((2 * hidden, hidden), normalise), nn.Linear(hidden, outputs))


class TimeConvolution(nn.Module):
    """Embeddings of all frames to one: three 1-D convolutions, halving time after the first two, and a maximum over
    what is left of it.

    A last frame without a partner is kept when time is halved, so any number of frames will do.

    Shapes:
        input: (R, F, inputs).
        output: (R, 1, outputs).
    """

    def __init__(self, config: PaperNetworkConfig, inputs: int, outputs: int):
        super().__init__()
        width, kernel, half = config.convolution, config.kernel, config.kernel // 2
        self.first = nn.Conv1d(inputs, width, kernel, padding=half)
        self.rest = nn.ModuleList(nn.Conv1d(width, width, kernel, padding=half) for _ in range(2))
        self.normalise = nn.ModuleList(nn.BatchNorm1d(width) if config.normalise else nn.Identity() for _ in range(3))
        self.last = nn.Conv1d(width, outputs, 1)

    def forward(self, x: Tensor) -> Tensor:
        return self.after(self.first(x.transpose(1, 2)))

    def of_pairs(self, pairs: Pairs, nodes: Tensor, edges: Tensor) -> Tensor:
        """The same for an input of (receiver, sender, edge): nodes (M, F, D), edges (P, F, E)."""
        width, half = nodes.shape[-1], self.first.kernel_size[0] // 2
        received, sent, own = self.first.weight.split([width, width, edges.shape[-1]], 1)
        seen = nodes.transpose(1, 2)
        both = pairs.ends(*(functional.conv1d(seen, part, padding=half) for part in (received, sent)))
        return self.after(both + functional.conv1d(edges.transpose(1, 2), own, self.first.bias, padding=half))

    def after(self, x: Tensor) -> Tensor:
        """What follows the first convolution."""
        x = self.normalise[0](functional.relu(x))
        for convolution, normalise in zip(self.rest, self.normalise[1:], strict=True):
            x = normalise(functional.relu(convolution(functional.max_pool1d(x, 2, ceil_mode=True))))
        return self.last(x).amax(2)[:, None]


class Recurrent(nn.Module):
    """The recurrent part of the graph recurrent network: two gated recurrent units and a linear layer.

    A step is predicted from one frame (the paper's f(n_t, a_t, E)), so it begins with an empty memory and what weighs
    the memory has no effect: steps may be computed in any order, or all at once.

    Shapes:
        input: (R, F, inputs), F steps.
        output: (R, F, outputs).
    """

    def __init__(self, config: PaperNetworkConfig, inputs: int, outputs: int):
        super().__init__()
        self.units = nn.GRU(inputs, config.recurrent, 2, batch_first=True, dropout=config.dropout)
        self.last = nn.Linear(config.recurrent, outputs)

    def forward(self, x: Tensor) -> Tensor:
        weight, bias, _ = self._unit(0)
        return self.after(functional.linear(x, weight, bias))

    def of_pairs(self, pairs: Pairs, nodes: Tensor, edges: Tensor) -> Tensor:
        """The same for an input of (receiver, sender, edge): nodes (M, F, D), edges (P, F, E)."""
        weight, bias, _ = self._unit(0)
        return self.after(pairs.linear(weight, bias, nodes, edges))

    def after(self, gates: Tensor) -> Tensor:
        """What follows the first linear map."""
        memory = functional.dropout(_from_empty(gates, self._unit(0)[2]), self.units.dropout, self.training)
        weight, bias, own_bias = self._unit(1)
        return self.last(functional.relu(_from_empty(functional.linear(memory, weight, bias), own_bias)))

    def _unit(self, number: int) -> tuple[Tensor, Tensor, Tensor]:
        """Weight and bias of what comes in, and the memory's bias."""
        names = ("weight_ih", "bias_ih", "bias_hh")
        weight, bias, own_bias = (getattr(self.units, f"{name}_l{number}") for name in names)
        return weight, bias, own_bias


def _from_empty(gates: Tensor, bias: Tensor) -> Tensor:
    """A gated recurrent unit's memory after its first step: (..., 3 H) -> (..., H)."""
    reset, keep, new = gates.chunk(3, -1)
    reset_bias, keep_bias, new_bias = bias.chunk(3)
    fresh = torch.tanh(new + torch.sigmoid(reset + reset_bias) * new_bias)
    return (1 - torch.sigmoid(keep + keep_bias)) * fresh
