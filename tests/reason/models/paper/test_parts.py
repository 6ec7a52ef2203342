"""The building blocks of the paper's networks: shapes, both forms of an edge function, orders that must not matter."""

import pytest
import torch
from torch import Tensor

from busybot.reason.models.paper.parts import EdgeFunction, GraphNet, Layers, Recurrent, TimeConvolution, factor
from tests.reason.paper_scenes import SMALL

NODES, FRAMES, WIDTH, OWN = 5, 4, 6, 3
EDGES = torch.tensor([[0, 2, 1, 0, 4, 3], [1, 1, 0, 2, 2, 4]])


def made(kind: str, inputs: int) -> EdgeFunction:
    torch.manual_seed(0)
    if kind == "layers":
        return Layers((inputs, 7, 8), normalise=True).double()
    part = TimeConvolution if kind == "time" else Recurrent
    return part(SMALL.model_copy(update={"kernel": 3}), inputs, 8).double()


def numbers(*shape: int) -> Tensor:
    return torch.randn(*shape, dtype=torch.float64, generator=torch.Generator().manual_seed(len(shape)))


@pytest.mark.parametrize("kind", ["layers", "time", "recurrent"])
@pytest.mark.parametrize("own", [OWN, 0])
def test_an_edge_function_is_that_of_receiver_sender_and_edge_in_both_forms(kind: str, own: int) -> None:
    function, nodes = made(kind, 2 * WIDTH + own), numbers(NODES, FRAMES, WIDTH)
    edges = numbers(EDGES.shape[1], FRAMES, own) if own else None
    sender, receiver = EDGES
    joined = torch.cat([nodes[receiver], nodes[sender], *([] if edges is None else [edges])], -1)
    expected = function(joined)
    assert expected.shape == (EDGES.shape[1], 1 if kind == "time" else FRAMES, 8)
    for factored in (True, False):
        factor(function, factored)
        torch.testing.assert_close(function.of_edges(EDGES, nodes, edges), expected, rtol=1e-10, atol=1e-12)


def net(types: int = 1, steps: int = 1) -> GraphNet:
    torch.manual_seed(1)
    return GraphNet(SMALL, WIDTH, OWN, 7, 2, types, steps).double().eval()


@pytest.mark.parametrize(("types", "steps"), [(1, 1), (2, 1), (1, 2)])
def test_the_order_of_nodes_and_of_edges_does_not_matter(types: int, steps: int) -> None:
    network, nodes, edges = net(types, steps), numbers(NODES, FRAMES, WIDTH), numbers(EDGES.shape[1], FRAMES, OWN)
    weights = numbers(EDGES.shape[1], types).softmax(-1)
    node, edge = network(EDGES, nodes, edges, weights)
    assert node.shape == (NODES, FRAMES, 7) and edge.shape == (EDGES.shape[1], FRAMES, 2)
    generator = torch.Generator().manual_seed(2)
    order, places = torch.randperm(NODES, generator=generator), torch.randperm(EDGES.shape[1], generator=generator)
    moved = order.argsort()[EDGES][:, places]  # node i is now where `order` has it
    other_node, other_edge = network(moved, nodes[order], edges[places], weights[places])
    torch.testing.assert_close(other_node, node[order])
    torch.testing.assert_close(other_edge, edge[places])


def test_a_node_without_edges_and_a_graph_without_any_have_outputs() -> None:
    network, nodes = net(), numbers(NODES, FRAMES, WIDTH)
    node, edge = network(torch.empty(2, 0, dtype=torch.int64), nodes, numbers(0, FRAMES, OWN))
    assert node.shape == (NODES, FRAMES, 7) and edge.shape == (0, FRAMES, 2)
    alone, _ = network(EDGES, nodes, numbers(EDGES.shape[1], FRAMES, OWN))
    torch.testing.assert_close(alone[3], node[3])  # no edge leads to node 3


def test_a_second_step_reaches_the_neighbours_of_neighbours() -> None:
    chain = torch.tensor([[0, 1], [1, 2]])
    nodes, edges = numbers(3, 1, WIDTH), numbers(2, 1, OWN)
    other = nodes.clone()
    other[0] += 1
    for steps, reached in ((1, False), (2, True)):
        first, second = (net(steps=steps)(chain, each, edges)[0][2] for each in (nodes, other))
        assert torch.equal(first, second) != reached
