"""The paper's schedule, and one iteration of its training (protocol "Fidelity checklist" and "Reasoning")."""

import math

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from busybot.common.config import build
from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.reason.models.paper.config import PaperReasonConfig
from busybot.reason.models.paper.data import Boards, boards_of
from busybot.reason.models.paper.learner import (
    IterationOutcome,
    Network,
    batches,
    divergence_from,
    iterate,
    losses,
    make_network,
    make_optimizer,
)
from busybot.reason.models.paper.networks import PaperNetwork, Relations
from tests.reason.paper_scenes import SMALL, watched

PAPER = PaperReasonConfig()
QUICK = PaperReasonConfig(network=SMALL, images=5, learning_rate=1e-2)


def boards(count: int = 4, steps: int = 8) -> Boards:
    return boards_of([watched(seed, 2, 3, steps) for seed in range(count)], SMALL)


def weights(network: Network) -> dict[str, Tensor]:
    return {name: value.clone() for name, value in network.state_dict().items()}


def step(
    network: Network, config: PaperReasonConfig = QUICK, number: int = 0, last: float = math.inf
) -> IterationOutcome:
    optimizer = make_optimizer(network, config)
    return iterate(network, optimizer, boards(), config, generator(0, "train", number, "test"), last)


def test_the_defaults_are_the_papers() -> None:
    assert (PAPER.epochs, PAPER.batch, PAPER.learning_rate, PAPER.images) == (200, 64, 5e-4, 23)
    assert (PAPER.network.objects, PAPER.network.pairs, PAPER.network.embedding) == (10, "all", 128)
    assert (PAPER.network.edge_embedding, PAPER.network.edge_layers, PAPER.network.node_layers) == (32, 4, 2)
    assert not PAPER.network.residual and PAPER.prior_weight == 0 and not PAPER.bfloat16
    assert (PAPER.encoder, PAPER.observed, PAPER.steps, PAPER.prior) == ("resnet50", (), 0, 0.5)
    optimizer = make_optimizer(PaperNetwork(SMALL), PAPER)
    assert type(optimizer) is torch.optim.Adam
    assert {key: optimizer.defaults[key] for key in ("lr", "betas", "weight_decay")} == {
        "lr": 5e-4,
        "betas": (0.9, 0.999),
        "weight_decay": 0,
    }


def test_a_kernel_has_a_middle() -> None:
    with pytest.raises(BusybotError, match=r"network\.kernel: must be odd"):
        build(PaperReasonConfig, None, ["network.kernel=2"], {})


def test_an_epoch_sees_every_board_once_in_an_order_of_its_own() -> None:
    first, second = (batches(150, 64, 0, epoch) for epoch in (0, 1))
    assert [len(batch) for batch in first] == [64, 64, 22]
    assert sorted(np.concatenate(first)) == sorted(np.concatenate(second)) == list(range(150))
    assert not np.array_equal(first[0], second[0])
    assert np.array_equal(first[1], batches(150, 64, 0, 0)[1])


def test_the_loss_is_the_mean_squared_error_of_the_responders_in_all_predicted_steps() -> None:
    network, joined = make_network(QUICK, 0).eval(), boards()
    error, _ = losses(network, joined, QUICK)
    predicted = network(joined, 5)[0]
    expected = []
    for number in range(4):
        seen = watched(number, 2, 3, 8)
        for node in np.flatnonzero(seen.responders):
            expected.append(predicted[6 * number + node] - torch.from_numpy(seen.features[5:, node]))
    assert len(expected) == 4 * 3 and expected[0].shape == (4, 256)
    assert error.item() == pytest.approx((torch.stack(expected) ** 2).mean().item())


def test_both_networks_learn_from_the_error_of_the_prediction() -> None:
    network = make_network(QUICK, 0)
    before = weights(network)
    outcome = step(network)
    assert outcome.taken and outcome.loss == outcome.error > 0
    after = weights(network)
    inference = ("actions", "spatial", "node_time", "edge_time", "edge_types", "edge_embeddings")
    for part in (*inference, "dynamic", "node_recurrent", "edge_recurrent", "decode"):
        changed = [not torch.equal(after[name], value) for name, value in before.items() if name.startswith(part + ".")]
        assert any(changed), part


def test_the_error_falls() -> None:
    network = make_network(QUICK, 0)
    optimizer, joined, errors = make_optimizer(network, QUICK), boards(2), []
    for number in range(25):
        errors.append(iterate(network, optimizer, joined, QUICK, generator(0, "train", number, "test")).error)
    assert np.mean(errors[-3:]) < 0.7 * np.mean(errors[:3])


@pytest.mark.parametrize("change", [lambda x: x * 1e3, lambda x: x * math.nan])
def test_an_iteration_whose_loss_explodes_is_left_out(change: object) -> None:
    network = make_network(QUICK, 0)
    last = step(network).loss
    joined = boards()
    joined.features.copy_(change(joined.features))  # type: ignore[operator]
    optimizer = make_optimizer(network, QUICK)
    kept = {name: value.clone() for name, value in network.named_parameters()}
    outcome = iterate(network, optimizer, joined, QUICK, generator(0, "train", 1, "test"), last)
    assert not outcome.taken and not optimizer.state_dict()["state"]
    assert all(torch.equal(kept[name], value) for name, value in network.named_parameters())


def test_as_an_option_the_graph_is_inferred_from_one_of_several_numbers_of_frames() -> None:
    config = QUICK.model_copy(update={"observed": (4, 5)})
    seen: set[int] = set()
    network = make_network(config, 0)
    network.register_forward_pre_hook(lambda network, inputs: seen.add(inputs[1]))
    for number in range(8):
        step(network, config, number)
    assert seen == {4, 5}


def test_as_an_option_only_the_next_steps_are_predicted() -> None:
    network, joined = make_network(QUICK, 0).eval(), boards()
    error, _ = losses(network, joined, QUICK, images=4, steps=3)
    predicted = network(joined, 4, None, 3)[0]
    assert predicted.shape[1] == 3
    torch.testing.assert_close(predicted, network(joined, 4)[0][:, :3])
    assert network(joined, 4, None, 99)[0].shape == network(joined, 4)[0].shape, "no more than were recorded"
    expected = (predicted - joined.features[:, 4:7])[joined.responders].square().mean()
    assert error.item() == pytest.approx(expected.item())
    outcomes = [step(make_network(config, 0), config) for config in (QUICK, QUICK.model_copy(update={"steps": 3}))]
    assert outcomes[1].taken and outcomes[0].error != outcomes[1].error


def test_twice_the_last_loss_is_too_much() -> None:
    loss = step(make_network(QUICK, 0)).loss
    assert step(make_network(QUICK, 0), last=0.501 * loss).taken
    assert not step(make_network(QUICK, 0), last=0.499 * loss).taken


def test_what_is_drawn_depends_on_the_generator_alone() -> None:
    config = QUICK.model_copy(update={"network": SMALL.model_copy(update={"dropout": 0.3})})
    outcomes = []
    for disturbance in (0, 1):  # of PyTorch's own generator
        torch.manual_seed(disturbance)
        network = make_network(config, 5)
        outcomes.append([step(network, config, number) for number in range(2)])
        assert torch.rand(1) == torch.rand(1, generator=torch.Generator().manual_seed(disturbance))
    assert outcomes[0] == outcomes[1]
    assert outcomes[0][0] != step(make_network(config, 5), config, 1)
    assert outcomes[0][0] != step(make_network(config, 6), config, 0)


def test_the_divergence_is_that_from_the_prior() -> None:
    q, p = np.array([0.2, 0.7]), 0.2
    logits = torch.tensor(np.log(np.stack([1 - q, q], -1)), dtype=torch.float32)
    expected = np.mean(q * np.log(q / p) + (1 - q) * np.log((1 - q) / (1 - p)))
    assert divergence_from(Relations(logits, logits, logits), p).item() == pytest.approx(expected, rel=1e-5)
    likely = Relations(logits[:1], logits, logits)
    assert divergence_from(likely, p).item() == pytest.approx(0, abs=1e-6)


def test_actions_begin_with_xaviers_normal() -> None:
    for layer in make_network(PaperReasonConfig(), 0).actions.layers[2::2]:
        assert isinstance(layer, nn.Linear) and not layer.bias.any()
        assert layer.weight.std().item() == pytest.approx((2 / (256 + 256)) ** 0.5, rel=0.05)
        assert layer.weight.abs().max() > (6 / (256 + 256)) ** 0.5, "no uniform distribution of that width"


def test_the_prior_is_an_option_that_makes_edges_rarer() -> None:
    config = QUICK.model_copy(update={"prior": 0.05, "prior_weight": 10.0})
    network, joined = make_network(config, 0), boards(2)
    optimizer, outcomes = make_optimizer(network, config), []
    assert isinstance(network, PaperNetwork)
    before = network.infer(joined.edge_index, joined.observed(5)).probabilities.mean()
    for number in range(24):
        outcomes.append(iterate(network, optimizer, joined, config, generator(0, "train", number, "test")))
    assert outcomes[0].loss == pytest.approx(outcomes[0].error + 10 * outcomes[0].divergence, rel=1e-5)
    assert outcomes[-1].divergence < 0.7 * outcomes[0].divergence
    assert network.infer(joined.edge_index, joined.observed(5)).probabilities.mean() < 0.7 * before


def test_matrices_may_be_multiplied_in_bfloat16() -> None:
    network = make_network(QUICK, 0).eval()
    exact, rounded = (losses(network, boards(), QUICK.model_copy(update={"bfloat16": b}))[0] for b in (False, True))
    assert rounded.dtype == torch.float32 and exact != rounded
    assert rounded.item() == pytest.approx(exact.item(), rel=0.05)
    assert step(network, QUICK.model_copy(update={"bfloat16": True})).taken


def test_boards_with_fewer_steps_leave_one_to_predict() -> None:
    network = make_network(QUICK, 0)
    optimizer = make_optimizer(network, QUICK)
    for steps in (1, 2, 5):
        seen = boards_of([watched(steps=steps)], SMALL)
        assert iterate(network, optimizer, seen, QUICK, generator(0, "train", steps, "test")).error > 0
    with pytest.raises(BusybotError, match="nothing was done"):
        iterate(network, optimizer, boards_of([watched(steps=0)], SMALL), QUICK, generator(0, "train", 0, "test"))
    with pytest.raises(BusybotError, match="boards with 5, 6 steps in one batch"):
        boards_of([watched(steps=5), watched(steps=6)], SMALL)
