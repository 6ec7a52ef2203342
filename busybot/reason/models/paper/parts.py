"""Parts of the paper's graph networks (paper appendix A.1 "Reasoning module", "Network details").

An edge leads from a sender j to a receiver i. Nodes and edges have any number of frames, each computed on its own but
for the convolution over time. Letters: M nodes, P edges, F frames, D and E numbers of a node and of an edge.
"""

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from busybot.reason.models.message_passing import GraphModule
from busybot.reason.models.paper.config import PaperNetworkConfig
from busybot.reason.models.paper.data import ACTION, Frames
from busybot.reason.pyg import OptTensor

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


class EdgeFunction(GraphModule):
    """A network f that begins with a linear map W, and that is applied to nodes or to edges:

        h_ij = f(W [n_i; n_j; e_ij]) = f(W_r n_i + W_s n_j + W_e e_ij)

    The left form is the paper's: what belongs to an edge is joined, then multiplied. The right one gives the same
    numbers within rounding, and multiplies nodes once each, not once for every edge (`factored`).

    Shapes:
        nodes: (M, F, D).
        edge_index: (2, P).
        edges: (P, F, E); None if E is 0.
        output: of nodes (M, F, H), of edges (P, F, H).
    """

    factored = True
    """Which form is computed; `factor` chooses for a whole network."""
    bias_of_edges = False
    """Whether the bias is added to W_e e_ij instead of W_r n_i: the order of sums decides the last bits of weights."""

    def __init__(self) -> None:
        super().__init__(aggr=None)

    def linear(self, x: Tensor, columns: slice = slice(None), bias: bool = True) -> Tensor:
        """The first map, or what some of its columns contribute to it: (R, F, columns) to whatever `after` takes."""
        raise NotImplementedError

    def after(self, x: Tensor) -> Tensor:
        """All that follows the first map."""
        raise NotImplementedError

    def forward(self, x: Tensor) -> Tensor:
        """f(W x), (R, F, H), of numbers that stand side by side, (R, F, D)."""
        return self.after(self.linear(x))

    def of_edges(self, edge_index: Tensor, nodes: Tensor, edges: Tensor | None) -> Tensor:
        """h of every edge."""
        if not self.factored:
            return self.edge_updater(edge_index, x=nodes, edge_attr=edges)
        width = nodes.shape[-1]
        received = self.linear(nodes, slice(width), bias=edges is None or not self.bias_of_edges)
        sent = self.linear(nodes, slice(width, 2 * width), bias=False)
        own = None if edges is None else self.linear(edges, slice(2 * width, None), bias=self.bias_of_edges)
        return self.edge_updater(edge_index, x=(sent, received), edge_attr=own)

    def edge_update(self, x_i: Tensor, x_j: Tensor, edge_attr: OptTensor) -> Tensor:
        """h from an edge's ends and its own numbers, or from what they contribute to the first map."""
        if self.factored:
            return self.after(x_i + x_j if edge_attr is None else x_i + x_j + edge_attr)
        return self.forward(torch.cat([x_i, x_j] if edge_attr is None else [x_i, x_j, edge_attr], -1))


def factor(network: nn.Module, factored: bool) -> None:
    """Choose the form in which a network's edge functions are computed."""
    for part in network.modules():
        if isinstance(part, EdgeFunction):
            part.factored = factored


class Layers(EdgeFunction):
    """Linear layers, a ReLU after each, batch normalisation at the end.

    Args:
        widths: of the input and of each layer.
    """

    def __init__(self, widths: tuple[int, ...], normalise: bool):
        super().__init__()
        first, *rest = (nn.Linear(a, b) for a, b in pairwise(widths))
        self.first, self.rest = first, nn.ModuleList(rest)
        self.normalise = Normalise(widths[-1]) if normalise else nn.Identity()

    def linear(self, x: Tensor, columns: slice = slice(None), bias: bool = True) -> Tensor:
        return functional.linear(x, self.first.weight[:, columns], self.first.bias if bias else None)

    def after(self, x: Tensor) -> Tensor:
        for layer in self.rest:
            x = layer(functional.relu(x))
        return self.normalise(functional.relu(x))


class GraphNet(GraphModule):
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

    Shapes:
        edge_index: (2, P), senders and receivers.
        nodes: (M, F, node_in).
        edges: (P, F, edge_in).
        weights: (P, types).
        output: (M, F, node_out) and (P, F, edge_out).
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
        self, edge_index: Tensor, nodes: Tensor, edges: Tensor | None, weights: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Outputs of nodes and edges.

        Args:
            edges: None if they come with nothing.
            weights: of the types of each edge; None for 1.
        """
        node, edge = self.encode_node(nodes), _mixed(self.encode_edge, edge_index, nodes, edges, weights)
        node_effect, edge_effect, size = node, edge, (len(nodes), len(nodes))
        for step in self.propagate_edge:
            assert isinstance(step, nn.ModuleList)
            edge_effect = _mixed(step, edge_index, node_effect, edge_effect, weights)
            node_effect = self.propagate(edge_index, size, effect=edge_effect, encoded=node, before=node_effect)
        return (
            self.decode_node(torch.cat([node_effect, node], -1)),
            self.decode_edge(torch.cat([edge_effect, edge], -1)),
        )

    def message(self, effect: Tensor) -> Tensor:
        """h_ij."""
        return effect

    def update(self, inputs: Tensor, encoded: Tensor, before: Tensor) -> Tensor:
        """h_i from the sum of the messages, and from n_i as it was encoded and as it was before this step."""
        return self.propagate_node(torch.cat([encoded, before, inputs], -1))


def _mixed(
    by_type: nn.ModuleList, edge_index: Tensor, nodes: Tensor, edges: Tensor | None, weights: Tensor | None
) -> Tensor:
    """(P, F, H): what the types' layers say, weighted and added."""
    said = [layers.of_edges(edge_index, nodes, edges) for layers in by_type]  # type: ignore[operator]
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


class TimeConvolution(EdgeFunction):
    """Embeddings of all frames to one: three 1-D convolutions, halving time after the first two, and a maximum over
    what is left of it.

    A last frame without a partner is kept when time is halved, so any number of frames will do.

    Shapes:
        input: (R, F, inputs).
        output: (R, 1, outputs).
    """

    bias_of_edges = True

    def __init__(self, config: PaperNetworkConfig, inputs: int, outputs: int):
        super().__init__()
        width, kernel, half = config.convolution, config.kernel, config.kernel // 2
        self.first = nn.Conv1d(inputs, width, kernel, padding=half)
        self.rest = nn.ModuleList(nn.Conv1d(width, width, kernel, padding=half) for _ in range(2))
        self.normalise = nn.ModuleList(nn.BatchNorm1d(width) if config.normalise else nn.Identity() for _ in range(3))
        self.last = nn.Conv1d(width, outputs, 1)

    def linear(self, x: Tensor, columns: slice = slice(None), bias: bool = True) -> Tensor:
        weight, half = self.first.weight[:, columns], self.first.kernel_size[0] // 2
        x = x.transpose(1, 2)  # (R, columns, F)
        return functional.conv1d(x, weight, self.first.bias if bias else None, padding=half)

    def after(self, x: Tensor) -> Tensor:
        x = self.normalise[0](functional.relu(x))  # (R, width, F)
        for convolution, normalise in zip(self.rest, self.normalise[1:], strict=True):
            x = normalise(functional.relu(convolution(functional.max_pool1d(x, 2, ceil_mode=True))))
        return self.last(x).amax(2)[:, None]  # (R, outputs, F / 4) -> (R, 1, outputs)


class Recurrent(EdgeFunction):
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

    def linear(self, x: Tensor, columns: slice = slice(None), bias: bool = True) -> Tensor:
        weight, own, _ = self._unit(0)
        return functional.linear(x, weight[:, columns], own if bias else None)

    def after(self, x: Tensor) -> Tensor:
        memory = functional.dropout(_from_empty(x, self._unit(0)[2]), self.units.dropout, self.training)
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
