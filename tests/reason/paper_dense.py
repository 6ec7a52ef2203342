"""The `paper` networks as the paper writes them: every pair of N nodes in every frame, inputs joined, no shortcuts.

The reference for `PaperNetwork`, with whose weights it computes. Arrays have a board axis B and two node axes, receiver
first.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from busybot.reason.models.paper.networks import PaperNetwork, drawn
from busybot.reason.models.paper.parts import GraphNet, Layers, Nothing, Recurrent, TimeConvolution


@dataclass(frozen=True)
class Masks:
    """Which nodes and pairs there are.

    Attributes:
        nodes: bool (B, N).
        pairs: bool (B, N, N), receiver first.
    """

    nodes: Tensor
    pairs: Tensor


@dataclass(frozen=True)
class DenseRelations:
    """logits and types (B, N, N, 2), embeddings (B, N, N, 32)."""

    logits: Tensor
    types: Tensor
    embeddings: Tensor


def infer(network: PaperNetwork, states: Tensor, actions: Tensor, masks: Masks, noise: Tensor | None) -> DenseRelations:
    """Relations from observed frames.

    Args:
        states: (B, F, N, 259).
        actions: (B, F, N, 6), zeros for objects that are not acted on.
        noise: (B, N, N, 2).
    """
    nodes, edges = graph_net(network.spatial, states, None, None, masks)  # (B, F, N, 128), (B, F, N, N, 128)
    seen = torch.cat([states, network.actions.layers(actions)], -1)
    node = over_time(network.node_time, torch.cat([nodes, seen], -1), masks.nodes)
    edge = over_time(network.edge_time, torch.cat([*ends(seen), edges], -1), masks.pairs)
    logits = graph_net(network.edge_types, node, edge, None, masks)[1][:, 0]
    types = drawn(logits, noise, network.config.temperature)
    return DenseRelations(logits, types, graph_net(network.edge_embeddings, node, edge, types, masks)[1][:, 0])


def predict(network: PaperNetwork, states: Tensor, actions: Tensor, graph: DenseRelations, masks: Masks) -> Tensor:
    """Features after each frame's action, (B, F, N, 256); states and actions as in `infer`."""
    related = graph.types[..., 1:]
    acting = graph.embeddings[:, None].expand(-1, states.shape[1], -1, -1, -1)
    nodes, edges = graph_net(network.dynamic, states, acting, related, masks)
    seen = torch.cat([states, network.actions.layers(actions)], -1)
    nodes = recurrent(network.node_recurrent, torch.cat([nodes, seen], -1))
    edges = recurrent(network.edge_recurrent, torch.cat([*ends(seen), edges, acting], -1))
    after = graph_net(network.decode, torch.cat([nodes, seen], -1), torch.cat([edges, acting], -1), related, masks)[0]
    return after + states[..., :-3] if network.config.residual else after


def graph_net(
    net: GraphNet, nodes: Tensor, edges: Tensor | None, types: Tensor | None, masks: Masks
) -> tuple[Tensor, Tensor]:
    """`GraphNet` on nodes (B, F, N, D), edges (B, F, N, N, E) and types (B, N, N, K)."""

    def mixed(by_type: nn.ModuleList, nodes: Tensor, edges: Tensor | None) -> Tensor:
        joined = torch.cat([*ends(nodes), *([] if edges is None else [edges])], -1)
        each = torch.stack([layered(layers, joined, masks.pairs) for layers in by_type], -1)  # type: ignore[arg-type]
        return (each if types is None else each * types[:, None, :, :, None]).sum(-1)

    node, edge = layered(net.encode_node, nodes, masks.nodes), mixed(net.encode_edge, nodes, edges)
    node_effect, edge_effect = node, edge
    for propagate in net.propagate_edge:
        assert isinstance(propagate, nn.ModuleList)
        edge_effect = mixed(propagate, node_effect, edge_effect)
        joined = torch.cat([node, node_effect, edge_effect.sum(3)], -1)
        node_effect = layered(net.propagate_node, joined, masks.nodes)
    return (
        decoded(net.decode_node, torch.cat([node_effect, node], -1), masks.nodes),
        decoded(net.decode_edge, torch.cat([edge_effect, edge], -1), masks.pairs),
    )


def ends(nodes: Tensor) -> tuple[Tensor, Tensor]:
    """Receiver and sender of every pair: (..., N, D) -> twice (..., N, N, D)."""
    shape = (*nodes.shape[:-1], nodes.shape[-2], nodes.shape[-1])
    return nodes.unsqueeze(-2).expand(shape), nodes.unsqueeze(-3).expand(shape)


def layered(layers: Layers, x: Tensor, mask: Tensor) -> Tensor:
    """The layers on what there is, zeros elsewhere: x (B, F, ...), mask (B, ...)."""
    for layer in (layers.first, *layers.rest):
        x = layer(x).relu()
    there = mask[:, None].expand(x.shape[:-1])
    return torch.zeros_like(x).masked_scatter(there[..., None], layers.normalise(x[there]))


def decoded(decoder: nn.Module, x: Tensor, mask: Tensor) -> Tensor:
    """What a graph network's decoder says of nodes or edges."""
    if isinstance(decoder, Nothing):
        return x[..., :0]
    assert isinstance(decoder, nn.Sequential) and isinstance(decoder[0], Layers)
    return decoder[1](layered(decoder[0], x, mask))


def over_time(convolution: TimeConvolution, x: Tensor, mask: Tensor) -> Tensor:
    """The convolution over time: x (B, F, ..., C), mask (B, ...) -> (B, 1, ..., outputs)."""
    there = x.movedim(1, -2)[mask]  # (rows, F, C)
    embedded = convolution(there)[:, 0]
    result = embedded.new_zeros(*mask.shape, embedded.shape[-1])
    return result.masked_scatter(mask[..., None], embedded)[:, None]


def recurrent(part: Recurrent, x: Tensor) -> Tensor:
    """The recurrent network, one step from an empty memory for each row: x (..., inputs)."""
    memory = part.units(x.flatten(0, -2)[:, None])[0][:, 0]
    return part.last(memory.relu()).view(*x.shape[:-1], -1)
