"""The paper's networks, in both of their forms, compute what the paper's formulas say: outputs and gradients.

The formulas stand in `tests.reason.paper_dense`, with a board axis and two node axes.
"""

from collections.abc import Callable
from typing import Literal

import pytest
import torch
from torch import Tensor

from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.paper.config import PaperNetworkConfig
from busybot.reason.models.paper.data import Boards, Frames, boards_of
from busybot.reason.models.paper.networks import PaperNetwork
from tests.reason import paper_dense as dense
from tests.reason.paper_scenes import SMALL, watched

IMAGES = 5
SEEN = (watched(1, 2, 3), watched(2, 1, 2), watched(3, 2, 4))
PAIRS: list[Literal["all", "candidates"]] = ["all", "candidates"]

Params = list[Tensor]


def network_of(factored: bool = True, **changed: object) -> PaperNetwork:
    torch.manual_seed(0)
    return PaperNetwork(SMALL.model_copy(update=changed), factored).double()


def boards(config: PaperNetworkConfig, seen: tuple[BoardSequence, ...] = SEEN) -> Boards:
    return boards_of(seen, config).to("cpu", torch.float64)


def slots(joined: Boards) -> tuple[Tensor, Tensor]:
    """Board and place on it of every node."""
    pairs = [(board, place) for board, size in enumerate(joined.sizes) for place in range(size)]
    board, place = torch.tensor(pairs).T
    return board, place


def spread(joined: Boards, values: Tensor) -> Tensor:
    """(M, F, D) as (B, F, N, D) with zeros where no node is."""
    board, place = slots(joined)
    result = values.new_zeros(len(joined.sizes), max(joined.sizes), *values.shape[1:])
    result[board, place] = values
    return result.transpose(1, 2)


def dense_actions(joined: Boards, frames: Frames) -> Tensor:
    """The 6 numbers on the object acted on, zeros elsewhere: (B, F, N, 6)."""
    board, place = slots(joined)
    result = frames.actions.new_zeros(*frames.actors.shape, max(joined.sizes), 6)
    for b, f in torch.nonzero(frames.actors >= 0).tolist():
        node = frames.actors[b, f]
        assert board[node] == b
        result[b, f, place[node]] = frames.actions[b, f]
    return result


def masks_of(joined: Boards) -> dense.Masks:
    board, place = slots(joined)
    count = max(joined.sizes)
    nodes = torch.zeros(len(joined.sizes), count, dtype=torch.bool)
    nodes[board, place] = True
    pairs = torch.zeros(len(joined.sizes), count, count, dtype=torch.bool)
    pairs[edge_slots(joined)] = True
    return dense.Masks(nodes, pairs)


def edge_slots(joined: Boards) -> tuple[Tensor, Tensor, Tensor]:
    """Board, receiver and sender of every pair."""
    board, place = slots(joined)
    return board[joined.edge_index[1]], place[joined.edge_index[1]], place[joined.edge_index[0]]


def passing(network: PaperNetwork, joined: Boards, noise: Tensor | None) -> tuple[Tensor, ...]:
    predicted, relations = network(joined, IMAGES, noise)
    return predicted, relations.logits, relations.types, relations.embeddings[:, 0]


def plain(network: PaperNetwork, joined: Boards, noise: Tensor | None) -> tuple[Tensor, ...]:
    board, place = slots(joined)
    at, masks = edge_slots(joined), masks_of(joined)
    noises = None
    if noise is not None:
        noises = noise.new_zeros(*masks.pairs.shape, 2)
        noises[at] = noise
    observed, following = joined.observed(IMAGES), joined.predicted(IMAGES)[0]
    graph = dense.infer(network, spread(joined, observed.states), dense_actions(joined, observed), masks, noises)
    after = dense.predict(network, spread(joined, following.states), dense_actions(joined, following), graph, masks)
    return after.transpose(1, 2)[board, place], graph.logits[at], graph.types[at], graph.embeddings[at]


def gradients(network: PaperNetwork, compute: Callable[[], tuple[Tensor, ...]]) -> tuple[Tensor, ...]:
    """Of a sum over all outputs, with a weight of its own for each number."""
    network.zero_grad()
    outputs = compute()
    weights = torch.Generator().manual_seed(3)
    total = sum((o * torch.rand(o.shape, generator=weights, dtype=o.dtype)).sum() for o in outputs)
    assert isinstance(total, Tensor)
    total.backward()
    return tuple(torch.zeros_like(p) if p.grad is None else p.grad.clone() for p in network.parameters())


@pytest.mark.parametrize("factored", [True, False])
@pytest.mark.parametrize("pairs", PAIRS)
@pytest.mark.parametrize("training", [True, False])
@pytest.mark.parametrize("changed", [{}, {"normalise": False}, {"kernel": 3}, {"residual": True}], ids=str)
def test_outputs_and_gradients_are_those_of_the_formulas(
    factored: bool, pairs: str, training: bool, changed: dict[str, int]
) -> None:
    network = network_of(factored, pairs=pairs, **changed).train(training)
    joined = boards(network.config)
    noise = torch.randn(joined.edge_index.shape[1], 2, dtype=torch.float64) if training else None
    for one, other in zip(passing(network, joined, noise), plain(network, joined, noise), strict=True):
        assert one.abs().max() > 0
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-11)
    one_way = gradients(network, lambda: passing(network, joined, noise))
    other_way = gradients(network, lambda: plain(network, joined, noise))
    torch.testing.assert_close(one_way, other_way, rtol=1e-8, atol=1e-10)
    flowing = {n for (n, _), gradient in zip(network.named_parameters(), one_way, strict=True) if gradient.any()}
    assert not {n for n, _ in network.named_parameters()} - flowing - unused(network)


def unused(network: PaperNetwork) -> set[str]:
    """Weights without an effect on the outputs: of empty memories, and of what nobody asks for."""
    memory = {n for n, _ in network.named_parameters() if "weight_hh" in n}
    nodes_of_edges = {n for n, _ in network.named_parameters() if n.startswith("edge_embeddings.propagate_node")}
    last = "edge_types.propagate_node"  # used after the first of its two steps
    assert any(n.startswith(last) for n, _ in network.named_parameters())
    return memory | nodes_of_edges


def test_steps_at_once_are_steps_one_after_the_other() -> None:
    network = network_of().eval()
    joined = boards(network.config)
    edge_index = joined.edge_index
    graph = network.infer(edge_index, joined.observed(IMAGES))
    frames, _ = joined.predicted(3)
    together = network.predict(edge_index, frames, graph)
    for step in range(together.shape[1]):
        one = slice(step, step + 1)
        alone = network.predict(
            edge_index, Frames(frames.states[:, one], frames.actions[:, one], frames.actors[:, one]), graph
        )
        torch.testing.assert_close(alone, together[:, one])


@pytest.mark.parametrize("pairs", PAIRS)
def test_a_board_is_judged_alike_alone_and_among_others(pairs: str) -> None:
    network = network_of(pairs=pairs).eval()
    together = passing(network, boards(network.config), None)
    begin_node = begin_pair = 0
    for seen in SEEN:
        one = boards(network.config, (seen,))
        for whole, alone in zip(together, passing(network, one, None), strict=True):
            begin = begin_node if whole is together[0] else begin_pair
            torch.testing.assert_close(whole[begin : begin + len(alone)], alone)
        begin_node, begin_pair = begin_node + sum(one.sizes), begin_pair + one.edge_index.shape[1]
