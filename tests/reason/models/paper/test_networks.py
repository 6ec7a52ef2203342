"""The fidelity checklist's graph networks, line by line (protocol "Fidelity checklist" and "Reasoning")."""

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.paper.config import PaperNetworkConfig
from busybot.reason.models.paper.data import Boards, boards_of
from busybot.reason.models.paper.networks import PaperNetwork, Relations, drawn
from busybot.reason.models.paper.parts import GraphNet, Nothing
from tests.reason.paper_scenes import SMALL, watched

PAPER = PaperNetworkConfig()
GRAPH_NETS = ["spatial", "edge_types", "edge_embeddings", "dynamic", "decode"]


@pytest.fixture(scope="module")
def paper() -> PaperNetwork:
    with torch.device("meta"):
        return PaperNetwork(PAPER)


@pytest.fixture(scope="module")
def boards() -> Boards:
    """Two boards of 30 steps in the paper's setting."""
    return boards_of([watched(1, 2, 5, 30), watched(2, 3, 6, 30)], PAPER)


@pytest.fixture(scope="module")
def graph(boards: Boards) -> tuple[Tensor, Relations]:
    """What a network of the paper's size says of them."""
    with torch.no_grad():
        predicted, relations = PaperNetwork(PAPER).eval()(boards, 23)
    return predicted, relations


def linear(module: nn.Module) -> list[tuple[int, int]]:
    """Inputs and outputs of all linear layers in their order."""
    return [(part.in_features, part.out_features) for part in module.modules() if isinstance(part, nn.Linear)]


def test_a_node_has_256_visual_features_and_a_position(paper: PaperNetwork) -> None:
    seen = watched(steps=4)
    states = boards_of([seen], PAPER).observed(5).states
    assert states.shape == (10, 5, 259)
    for node in range(len(seen.positions)):
        assert np.array_equal(states[node, :, :256], seen.features[:, node])
        assert np.array_equal(states[node, :, 256:], np.tile(seen.positions[node], (5, 1)))
    for name in ("spatial", "dynamic"):
        assert getattr(paper, name).encode_node.first.in_features == 259


def test_a_trigger_shows_zeros() -> None:
    seen = watched()
    states = boards_of([seen], PAPER).observed(7).states[: len(seen.positions)]
    assert not states[seen.triggers][..., :256].any()
    assert states[seen.triggers][..., 256:].all() and states[seen.responders].any(-1).all()


def test_a_board_has_ten_nodes_the_vacant_ones_zeros() -> None:
    boards = boards_of([watched(1, 2, 3), watched(2, 3, 5)], PAPER)
    assert boards.sizes == (10, 10)
    states = boards.observed(3).states
    assert not states[5:10].any() and not states[18:].any() and states[:5].any()
    assert boards.edge_index.shape[1] == 2 * 10 * 9  # every node with every other one
    assert not boards.responders[5:10].any()


def test_an_action_is_embedded_by_three_layers_of_256(paper: PaperNetwork) -> None:
    assert linear(paper.actions) == [(6, 256), (256, 256), (256, 256)]
    assert [type(part) for part in paper.actions.layers] == [nn.Linear, nn.ReLU, nn.Linear, nn.ReLU, nn.Linear]


def test_the_object_acted_on_has_the_action_the_others_zeros() -> None:
    network, seen = PaperNetwork(SMALL), watched(3)
    seen.acted[1] = -1
    frames = boards_of([watched(4), seen], SMALL).observed(5)
    embedded = network.actions(frames)
    still = network.actions.layers(torch.zeros(6))
    for node in range(6):
        for frame in range(5):
            here = frame < 4 and frame != 1 and node == seen.acted[frame]
            expected = network.actions.layers(torch.from_numpy(seen.actions[frame])) if here else still
            torch.testing.assert_close(embedded[6 + node, frame], expected)


@pytest.mark.parametrize("name", GRAPH_NETS)
def test_a_graph_network_encodes_propagates_and_decodes_in_1_4_2_and_2_layers(paper: PaperNetwork, name: str) -> None:
    net = getattr(paper, name)
    assert isinstance(net, GraphNet)
    nodes = net.encode_node.first.in_features
    assert linear(net.encode_node) == [(nodes, 384)]
    for encoder in net.encode_edge:
        assert len(linear(encoder)) == 1
    for step in net.propagate_edge:
        assert isinstance(step, nn.ModuleList)
        for layers in step:
            assert linear(layers) == [(3 * 384, 384)] + 3 * [(384, 384)]
    assert linear(net.propagate_node) == [(3 * 384, 384), (384, 384)]
    decoders = [part for part in (net.decode_node, net.decode_edge) if not isinstance(part, Nothing)]
    assert decoders and all([a for a, _ in linear(part)] == [2 * 384, 384] for part in decoders)


def test_steps_and_types_of_the_graph_networks(paper: PaperNetwork) -> None:
    nets = [getattr(paper, name) for name in GRAPH_NETS]
    assert [len(net.propagate_edge) for net in nets] == [1, 2, 1, 1, 1]
    assert [len(net.encode_edge) for net in nets] == [1, 1, 2, 1, 1]


def test_a_relu_follows_every_layer_but_the_decoders_last() -> None:
    torch.manual_seed(0)
    net = GraphNet(SMALL.model_copy(update={"normalise": False}), 4, 2, 3, 2)
    seen: list[Tensor] = []
    for part in (net.encode_node, *net.encode_edge, net.propagate_node, net.decode_node[0]):  # type: ignore[index]
        part.register_forward_hook(lambda module, inputs, output: seen.append(output))
    boards = boards_of([watched(triggers=2, responders=2)], SMALL)
    decoded, _ = net(boards.edge_index, torch.randn(6, 3, 4), torch.randn(boards.edge_index.shape[1], 3, 2))
    assert len(seen) == 3  # edges are encoded without joining their inputs
    assert all((output >= 0).all() and (output == 0).any() for output in seen)
    assert (decoded < 0).any()


def test_the_spatial_encoder_gives_128_numbers_for_nodes_and_edges(paper: PaperNetwork, boards: Boards) -> None:
    nothing = boards.to("meta")
    nodes, edges = paper.spatial(nothing.edge_index, nothing.observed(23).states, None)
    assert nodes.shape == (20, 23, 128) and edges.shape == (180, 23, 128)


def test_embeddings_of_all_frames_are_brought_together_by_a_1d_convolution(paper: PaperNetwork) -> None:
    for part, inputs in ((paper.node_time, 128 + 259 + 256), (paper.edge_time, 128 + 2 * (259 + 256))):
        layers = [layer for layer in part.modules() if isinstance(layer, nn.Conv1d)]
        assert [(layer.in_channels, layer.out_channels) for layer in layers] == [
            (inputs, 512),
            (512, 512),
            (512, 512),
            (512, 128),
        ]
        for frames in (1, 2, 23, 24):
            assert part(torch.empty(4, frames, inputs, device="meta")).shape == (4, 1, 128)


def test_edges_have_two_types_and_32_numbers(graph: tuple[Tensor, Relations]) -> None:
    relations = graph[1]
    assert relations.logits.shape == relations.types.shape == (180, 2)
    assert relations.embeddings.shape == (180, 1, 32)


def test_edge_embeddings_depend_on_the_types() -> None:
    network, boards = PaperNetwork(SMALL).eval(), boards_of([watched()], SMALL)
    edges, observed = boards.edge_index, boards.observed(5)
    first, second = (network.infer(edges, observed, noise) for noise in noises(edges.shape[1]))
    assert torch.equal(first.logits, second.logits)
    assert (first.embeddings - second.embeddings).abs().max() > 0


def noises(pairs: int) -> tuple[Tensor, Tensor]:
    """Noise that makes relations unlikely, and likely."""
    unlikely = torch.tensor([20.0, -20.0]).repeat(pairs, 1)
    return unlikely, -unlikely


def test_the_dynamics_network_is_recurrent_and_predicts_256_numbers(
    paper: PaperNetwork, graph: tuple[Tensor, Relations]
) -> None:
    for part in (paper.node_recurrent, paper.edge_recurrent):
        assert isinstance(part.units, nn.GRU)
        assert (part.units.num_layers, part.units.hidden_size, part.last.out_features) == (2, 256, 128)
    assert graph[0].shape == (20, 8, 256)


def test_the_first_23_images_infer_and_the_steps_after_them_are_predicted() -> None:
    seen = watched(steps=30)
    boards = boards_of([seen], SMALL)
    observed, (frames, after) = boards.observed(23), boards.predicted(23)
    assert observed.states.shape[1] == 23
    assert (observed.actors[0, :22] == torch.from_numpy(seen.acted[:22])).all() and observed.actors[0, 22] == -1
    assert frames.states.shape[1] == after.shape[1] == 8
    assert np.array_equal(frames.states[:5, :, :256].numpy(), seen.features[22:30].swapaxes(0, 1))
    assert np.array_equal(after[:5].numpy(), seen.features[23:].swapaxes(0, 1))
    assert np.array_equal(frames.actions[0].numpy(), seen.actions[22:])


def test_inference_knows_nothing_of_what_follows_the_23_images() -> None:
    network, seen = PaperNetwork(SMALL).eval(), watched(steps=30)
    other = BoardSequence(**{name: value.copy() for name, value in seen.arrays.items()})
    other.features[23:], other.actions[22:], other.acted[22:] = 7, 7, 1
    first, second = (network(boards_of([each], SMALL), 23)[1].logits for each in (seen, other))
    assert torch.equal(first, second)


def test_a_step_is_predicted_from_its_own_frame_action_and_the_graph() -> None:
    network, boards = PaperNetwork(SMALL).eval(), boards_of([watched(steps=8)], SMALL)
    graph = network.infer(boards.edge_index, boards.observed(4))
    frames, _ = boards.predicted(4)
    before = network.predict(boards.edge_index, frames, graph)
    frames.states[:, 2, :256] += 1
    frames.actions[:, 3] += 1
    changed = (network.predict(boards.edge_index, frames, graph) - before).abs().amax((0, 2))
    assert changed[2] > 0 and changed[3] > 0 and not changed[[0, 1, 4]].any()


def test_no_message_passes_where_there_is_no_relation() -> None:
    network = PaperNetwork(SMALL.model_copy(update={"pairs": "candidates"})).eval()
    boards = boards_of([watched(triggers=1, responders=2)], network.config)
    frames, _ = boards.predicted(4)
    for noise, reached in zip(noises(boards.edge_index.shape[1]), (False, True), strict=True):
        graph = network.infer(boards.edge_index, boards.observed(4), noise)
        first = network.predict(boards.edge_index, frames, graph)
        frames.actions.add_(1)
        second = network.predict(boards.edge_index, frames, graph)
        responders = (first - second)[boards.responders].abs().max()
        assert (responders > 1e-6) == reached


def test_edge_types_are_drawn_by_gumbel_softmax() -> None:
    generator = torch.Generator().manual_seed(0)
    logits = torch.tensor([0.0, 1.0]).repeat(100_000, 1)
    noise = -torch.empty_like(logits).exponential_(generator=generator).log()
    types = drawn(logits, noise, 1.0)
    assert torch.allclose(types.sum(-1), torch.ones(len(types)))
    share = (types[:, 1] > 0.5).float().mean().item()
    assert share == pytest.approx(1 / (1 + np.exp(-1)), abs=0.005)  # the likelier of the two wins so often
    assert ((types > 0.01) & (types < 0.99)).any(-1).float().mean() > 0.9  # soft
    assert torch.equal(drawn(logits, None, 1.0), logits.softmax(-1))


def test_options_predict_changes_and_leave_out_pairs_that_cannot_be_related() -> None:
    torch.manual_seed(1)
    plain = PaperNetwork(SMALL).eval()
    change = PaperNetwork(SMALL.model_copy(update={"residual": True})).eval()
    change.load_state_dict(plain.state_dict())
    boards = boards_of([watched()], SMALL)
    before = boards.predicted(4)[0].states[..., :256]
    torch.testing.assert_close(change(boards, 4)[0], plain(boards, 4)[0] + before)
    few = boards_of([watched(1, 2, 3), watched(2, 3, 4)], SMALL.model_copy(update={"pairs": "candidates"}))
    assert few.sizes == (5, 7) and few.edge_index.shape[1] == 2 * 3 + 3 * 4
    assert few.responders[few.edge_index[1]].all() and not few.responders[few.edge_index[0]].any()
