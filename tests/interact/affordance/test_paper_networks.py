"""The paper variant's networks, layer by layer (protocol "Fidelity checklist"), and what they see."""

import numpy as np
import pytest
import torch
from torch import nn

from busybot.episodes.camera import normals
from busybot.interact.affordance.inputs import Pinhole
from busybot.interact.affordance.networks import KINDS, PaperDirectionNet, PaperPositionNet, make_paper_network
from busybot.interact.affordance.paper import depth_and_normals, with_positions
from busybot.interact.policy.config import Inputs
from busybot.training.checkpoint import initialise, parameters_of
from tests.interact.scenes import BODY, HEIGHT, RAYS, WIDTH, picture


def convolutions(network: nn.Module) -> list[tuple[int, int]]:
    """Channels of all convolutions in their order, all of which are 3 x 3 and keep the size."""
    found = [module for module in network.modules() if isinstance(module, nn.Conv2d)]
    assert all((one.kernel_size, one.stride, one.padding) == ((3, 3), (1, 1), (1, 1)) for one in found)
    return [(one.in_channels, one.out_channels) for one in found]


def test_the_position_network_is_a_u_net_of_four_blocks_down_and_four_up() -> None:
    network = PaperPositionNet(4)
    assert convolutions(network.down) == [
        (4, 32),
        (32, 32),
        (32, 64),
        (64, 64),
        (64, 128),
        (128, 128),
        (128, 256),
        (256, 256),
    ]
    up = [(256 + 128, 128), (128, 128), (128 + 64, 64), (64, 64), (64 + 32, 32), (32, 32), (32 + 4, 2), (2, 2)]
    assert convolutions(network.up) == up
    relus = [sum(isinstance(part, nn.ReLU) for part in block) for block in (*network.down, *network.up)]
    assert relus == [2] * 7 + [1]  # the last convolution gives logits
    assert parameters_of(network) == 1_947_824


def test_the_position_network_halves_the_picture_four_times() -> None:
    with torch.device("meta"):
        network, picture = PaperPositionNet(4), torch.empty(1, 4, 480, 640)
    sides: list[tuple[int, ...]] = []
    for block in (*network.down, *network.up):
        block.register_forward_hook(lambda block, inputs, output: sides.append(tuple(output.shape[1:])))
    assert network(picture).shape == (1, 2, 480, 640)
    down = [(32, 240, 320), (64, 120, 160), (128, 60, 80), (256, 30, 40)]
    assert sides == [*down, (128, 60, 80), (64, 120, 160), (32, 240, 320), (2, 480, 640)]


def test_the_direction_network_has_seven_convolutions_and_two_perceptrons() -> None:
    with torch.device("meta"):
        network, seen = PaperDirectionNet(4), torch.empty(2, 5, 480, 640)
    widths = [5, 32, 64, 128, 256, 512, 512, 512]
    assert convolutions(network) == list(zip(widths[:-1], widths[1:], strict=True))
    pools = [number for number, part in enumerate(network.convolutions) if isinstance(part, nn.MaxPool2d)]
    assert len(pools) == 6 and pools[0] > 1  # none belongs to the first layer
    assert network.convolutions(seen).shape == (2, 512, 7, 10)
    linear = [(part.in_features, part.out_features) for part in network.modules() if isinstance(part, nn.Linear)]
    assert linear == [(512 * 7 * 10, 256), (256, 256), (256, 1024), (1024, 1024), (1024, 1024), (1024, 18)]
    assert isinstance(network.score[-1], nn.Linear)
    assert network(seen).shape == (2, 18)
    assert parameters_of(network) == 17_910_674


@pytest.mark.parametrize(("inputs", "channels"), [("depth", 4), ("rgb", 3)])
def test_both_see_depth_and_normals_or_colours(inputs: Inputs, channels: int) -> None:
    with torch.device("meta"):
        position, direction = (make_paper_network(kind, inputs, (120, 160)) for kind in KINDS)
        assert position(torch.empty(2, channels, 120, 160)).shape == (2, 2, 120, 160)
        assert direction(torch.empty(2, channels + 1, 120, 160)).shape == (2, 18)


def test_initial_weights_are_drawn_within_torchs_limits_biases_too() -> None:
    first, second = (make_paper_network("position", "depth") for _ in range(2))
    for network in (first, second):
        initialise(network, torch.Generator().manual_seed(1), biases=True)
    for one, other in zip(first.parameters(), second.parameters(), strict=True):
        assert torch.equal(one, other) and one.abs().max() > 0
    for module in first.modules():
        if isinstance(module, nn.Conv2d):
            assert max(value.abs().max() for value in module.parameters()) <= (9 * module.in_channels) ** -0.5


def test_the_picture_is_depth_and_normals() -> None:
    image = picture(((40, 30, 100, 80), BODY))
    assert image.depth is not None
    image.depth[0, 0] = 0
    features = depth_and_normals(torch.from_numpy(image.depth)[None], Pinhole(RAYS.camera))[0].numpy()
    assert features.shape == (4, HEIGHT, WIDTH)
    assert np.allclose(features[0], np.where(image.depth > 0, image.depth - 4, 0))
    inside = (slice(2, -2), slice(2, -2))
    expected = normals(RAYS.points(image.depth))[inside]
    assert np.allclose(features[1:, *inside].transpose(1, 2, 0), expected, atol=1e-3)


def test_a_gaussian_marks_the_position() -> None:
    seen = with_positions(torch.zeros(2, 4, 50, 60), torch.tensor([[20, 10], [59, 49]]))
    assert seen.shape == (2, 5, 50, 60) and not seen[:, :4].any()
    for mark, (column, row) in zip(seen[:, 4], ((20, 10), (59, 49)), strict=True):
        assert mark[row, column] == 1 and mark.max() == 1
    assert seen[0, 4, 13, 24] == pytest.approx(np.exp(-(3**2 + 4**2) / (2 * 10**2)))
