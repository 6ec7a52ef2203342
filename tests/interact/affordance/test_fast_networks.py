"""The fast variant's networks: sizes, shapes, and draws that the caller controls."""

from typing import get_args

import pytest
import torch

from busybot.interact.affordance.networks import CROP, HIDDEN, KINDS, Kind, Networks, make_network
from busybot.training.checkpoint import initialise, parameters_of


@pytest.mark.parametrize("inputs", ["depth", "rgb"])
def test_shapes(inputs) -> None:
    channels = {"depth": 4, "rgb": 3}[inputs]
    position, direction = (make_network(kind, inputs).eval() for kind in KINDS)
    assert position(torch.randn(2, channels, 32, 48)).shape == (2, 32, 48)
    directions, any_works = direction(torch.randn(3, channels, CROP, CROP))
    assert directions.shape == (3, 18) and any_works.shape == (3,)


@pytest.mark.parametrize(("networks", "megabytes"), [("wide", 4), ("lean", 3.2)])
def test_both_networks_are_small(networks: Networks, megabytes: float) -> None:
    sizes = {kind: parameters_of(make_network(kind, "depth", networks=networks)) for kind in KINDS}
    assert 0.9 * megabytes < 4e-6 * sum(sizes.values()) < megabytes


@pytest.mark.parametrize("networks", get_args(Networks))
@pytest.mark.parametrize("kind", KINDS)
def test_weights_tell_the_size_of_their_network(kind: Kind, networks: Networks) -> None:
    trained = make_network(kind, "depth", networks=networks).eval()
    network = make_network(kind, "depth", trained.state_dict()).eval()
    network.load_state_dict(trained.state_dict())
    seen = torch.randn(2, 4, CROP, CROP)
    for answer, expected in zip(network(seen), trained(seen), strict=True):
        assert torch.allclose(answer, expected, atol=1e-5)


def test_weights_of_something_else_ask_for_no_memory() -> None:
    wide = parameters_of(make_network("position", "depth", networks="wide"))
    tensors = {f"encode{level}.0.0.weight": torch.zeros(10**6, 1) for level in range(4)}
    assert parameters_of(make_network("position", "depth", tensors)) == wide
    assert parameters_of(make_network("position", "depth", {"head.weight": torch.zeros(())})) == wide


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
    everything, nothing = (
        network(crops, torch.ones(2, HIDDEN)),
        network(crops, torch.zeros(2, HIDDEN)),
    )
    assert torch.equal(everything[0], network(crops)[0])
    assert torch.allclose(nothing[0], network.head.bias[:18].expand(2, 18))
