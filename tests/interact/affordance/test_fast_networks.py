"""The fast variant's networks: sizes, shapes, and draws that the caller controls."""

import pytest
import torch

from busybot.interact.affordance.networks import CROP, HIDDEN, KINDS, Kind, make_network
from busybot.training.checkpoint import initialise, parameters_of


@pytest.mark.parametrize("inputs", ["depth", "rgb"])
def test_shapes(inputs) -> None:
    channels = {"depth": 4, "rgb": 3}[inputs]
    position, direction = (make_network(kind, inputs).eval() for kind in KINDS)
    assert position(torch.randn(2, channels, 32, 48)).shape == (2, 32, 48)
    directions, any_works = direction(torch.randn(3, channels, CROP, CROP))
    assert directions.shape == (3, 18) and any_works.shape == (3,)


def test_both_networks_fit_into_five_megabytes() -> None:
    sizes = {kind: parameters_of(make_network(kind, "depth")) for kind in KINDS}
    assert 350_000 < sizes["position"] < 450_000
    assert 4 * sum(sizes.values()) < 5e6


@pytest.mark.parametrize("kind", KINDS)
def test_initial_weights_depend_on_the_generator_alone(kind: Kind) -> None:
    first, second, other = (make_network(kind, "depth") for _ in range(3))
    for network, seed in ((first, 1), (second, 1), (other, 2)):
        initialise(network, torch.Generator().manual_seed(seed))
    weights = [torch.cat([value.flatten() for value in network.parameters()]) for network in (first, second, other)]
    assert torch.equal(weights[0], weights[1])
    assert not torch.equal(weights[0], weights[2])


def test_dropout_is_what_the_caller_drew() -> None:
    network = make_network("direction", "depth").eval()
    crops = torch.randn(2, 4, CROP, CROP)
    everything, nothing = network(crops, torch.ones(2, HIDDEN)), network(crops, torch.zeros(2, HIDDEN))
    assert torch.equal(everything[0], network(crops)[0])
    assert torch.allclose(nothing[0], network.head.bias[:18].expand(2, 18))
