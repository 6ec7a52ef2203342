"""The paper variant's networks, layer by layer (protocol "Fidelity checklist"), and what they see."""

import re
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter1d
from torch import nn

from busybot.common.rng import generator
from busybot.interact.affordance.inputs import Pinhole
from busybot.interact.affordance.networks import (
    KINDS,
    LEAST_SIDE,
    PaperDirectionNet,
    PaperPositionNet,
    make_paper_network,
)
from busybot.interact.affordance.paper import PaperModel, depth_and_normals, with_positions
from busybot.interact.policy.config import AffordanceInfo, Inputs
from busybot.models import verify
from busybot.training.checkpoint import initialise, parameters_of
from tests.interact.scenes import BODY, HEIGHT, RAYS, WIDTH, picture


def convolutions(network: nn.Module) -> list[tuple[int, int]]:
    """Channels of all 3 x 3 convolutions in their order; they keep the size, normalisation and ReLU follow them."""
    found = []
    for block in network.modules():
        if isinstance(block, nn.Sequential) and isinstance(block[0], nn.Conv2d):
            one, norm, relu = block
            assert (one.kernel_size, one.stride, one.padding) == ((3, 3), (1, 1), (1, 1))
            assert isinstance(norm, nn.BatchNorm2d) and isinstance(relu, nn.ReLU)
            found.append((one.in_channels, one.out_channels))
    return found


def test_the_position_network_is_a_u_net_of_four_blocks_down_and_four_up() -> None:
    network = PaperPositionNet(4)
    down = [(32, 32), (32, 32), (32, 64), (64, 64), (64, 128), (128, 128), (128, 256), (256, 256)]
    assert convolutions(network.down) == down
    *up, last = [
        (256 + 128, 128),
        (128, 128),
        (128 + 64, 64),
        (64, 64),
        (64 + 32, 32),
        (32, 32),
        (32 + 32, 32),
        (32, 32),
    ]
    assert convolutions(network.up) == [*up, last]
    assert parameters_of(network) == 1_985_666


def test_as_the_authors_have_it_a_convolution_comes_first_and_one_of_1_by_1_last() -> None:
    network = PaperPositionNet(4)
    assert convolutions(nn.Sequential(network.stem)) == [(4, 32)]
    head = network.up[-1][-1]  # type: ignore[index]
    assert (head.kernel_size, head.in_channels, head.out_channels) == ((1, 1), 32, 2)
    every = [module for module in network.modules() if isinstance(module, nn.Conv2d)]
    assert len(every) == len(convolutions(network)) + 1  # normalisation and ReLU follow all others


def test_levels_are_interpolated_corner_on_corner() -> None:
    network, seen = PaperPositionNet(4).eval(), []
    network.down[-1].register_forward_hook(lambda _, given, made: seen.append(made))
    network.up[0].register_forward_pre_hook(lambda _, given: seen.append(given[0]))
    with torch.no_grad():
        network(torch.randn(1, 4, 64, 96, generator=torch.Generator().manual_seed(0)))
    coarse, joined = seen
    larger = joined[:, : coarse.shape[1]]
    assert larger.shape[-2:] == (8, 12) and coarse.shape[-2:] == (4, 6)
    assert torch.allclose(larger[..., ::7, ::11], coarse[..., ::3, ::5], atol=1e-5)


def test_the_position_network_halves_the_picture_four_times() -> None:
    with torch.device("meta"):
        network, picture = PaperPositionNet(4), torch.empty(1, 4, 480, 640)
    sides: list[tuple[int, ...]] = []
    for block in (network.stem, *network.down, *network.up):
        block.register_forward_hook(lambda block, inputs, output: sides.append(tuple(output.shape[1:])))
    assert network(picture).shape == (1, 2, 480, 640)
    down = [(32, 480, 640), (32, 240, 320), (64, 120, 160), (128, 60, 80), (256, 30, 40)]
    assert sides == [*down, (128, 60, 80), (64, 120, 160), (32, 240, 320), (2, 480, 640)]


def test_the_direction_network_has_seven_convolutions_and_two_perceptrons() -> None:
    with torch.device("meta"):
        network, seen = PaperDirectionNet(4), torch.empty(2, 5, 480, 640)
    widths = [5, 32, 64, 128, 256, 512, 512, 512]
    assert convolutions(network) == list(zip(widths[:-1], widths[1:], strict=True))
    pools = [number for number, part in enumerate(network.convolutions) if isinstance(part, nn.MaxPool2d)]
    assert pools == [1, 3, 5, 7, 9, 11]  # before every layer but the first
    assert network.convolutions(seen).shape == (2, 512, 7, 10)
    linear = [(part.in_features, part.out_features) for part in network.modules() if isinstance(part, nn.Linear)]
    assert linear == [(512 * 7 * 10, 256), (256, 256), (256, 1024), (1024, 1024), (1024, 1024), (1024, 18)]
    assert isinstance(network.score[-1], nn.Linear)
    assert network(seen).shape == (2, 18)
    assert parameters_of(network) == 17_912_690


@pytest.mark.parametrize(("inputs", "channels"), [("depth", 4), ("rgb", 3)])
def test_both_see_depth_and_normals_or_colours(inputs: Inputs, channels: int) -> None:
    with torch.device("meta"):
        position, direction = (make_paper_network(kind, inputs, (120, 160)) for kind in KINDS)
        assert position(torch.empty(2, channels, 120, 160)).shape == (2, 2, 120, 160)
        assert direction(torch.empty(2, channels + 1, 120, 160)).shape == (2, 18)


def test_initial_weights_of_the_direction_network_are_kaimings_and_xaviers_normal() -> None:
    first, second = (make_paper_network("direction", "depth", (120, 160)) for _ in range(2))
    for network in (first, second):
        initialise(network, torch.Generator().manual_seed(1), normal=True)
    assert all(torch.equal(a, b) for a, b in zip(first.parameters(), second.parameters(), strict=True))
    for module in first.modules():
        if isinstance(module, nn.Conv2d):
            inputs = 9 * module.in_channels
            assert module.weight.std().item() == pytest.approx((2 / inputs) ** 0.5, rel=0.1)
            assert module.weight.abs().max() > (6 / inputs) ** 0.5  # no uniform distribution of that width
        elif isinstance(module, nn.BatchNorm2d):
            assert (module.weight == 1).all() and not module.bias.any()
        elif isinstance(module, nn.Linear):
            both = module.in_features + module.out_features
            assert module.weight.std().item() == pytest.approx((2 / both) ** 0.5, rel=0.1) and not module.bias.any()


def test_the_picture_is_depth_and_normals() -> None:
    image = picture(((40, 30, 100, 80), BODY))
    image.depth[0, 0] = 0
    features = depth_and_normals(torch.from_numpy(image.depth)[None], Pinhole(RAYS.camera))[0].numpy()
    assert features.shape == (4, HEIGHT, WIDTH)
    assert np.allclose(features[0], np.where(image.depth > 0, image.depth - 4, 0))
    level = features[1:, 45:65, 55:85]  # on top of the box
    assert np.allclose(level, np.array([0, 0, 1])[:, None, None], atol=1e-5)
    edges = features[1:, 55, [40, 100]]
    assert edges[0, 0] < -0.5 < 0.5 < edges[0, 1]  # its sides look away from it


def test_normals_cross_the_derivatives_of_a_gaussian_of_the_points() -> None:
    depth = 4 - 0.3 * generator(0, "", 0, "test").random((HEIGHT, WIDTH)).astype(np.float32)
    found = depth_and_normals(torch.from_numpy(depth)[None], Pinhole(RAYS.camera))[0, 1:].numpy()
    points = RAYS.points(depth).astype(float)
    down, across = (gaussian_filter1d(points, 2, axis=axis, order=1, mode="nearest") for axis in (0, 1))
    down, across = (one / np.linalg.norm(one, axis=-1, keepdims=True) for one in (down, across))
    assert np.allclose(found.transpose(1, 2, 0), np.cross(down, across), atol=1e-4)


def test_a_plane_has_one_normal_up_to_the_border() -> None:
    found = depth_and_normals(torch.full((2, 60, 80), 3.5), Pinhole(RAYS.camera))
    assert torch.allclose(found[:, 1:], torch.tensor([0.0, 0.0, 1.0])[:, None, None], atol=1e-5)


def test_a_gaussian_marks_the_position() -> None:
    seen = with_positions(torch.zeros(2, 4, 50, 60), torch.tensor([[20, 10], [59, 49]]))
    assert seen.shape == (2, 5, 50, 60) and not seen[:, :4].any()
    for mark, (column, row) in zip(seen[:, 4], ((20, 10), (59, 49)), strict=True):
        assert mark[row, column] == 1 and mark.max() == 1
    assert seen[0, 4, 13, 24] == pytest.approx(np.exp(-(3**2 + 4**2) / (2 * 10**2)))


SIZES = {
    "no number": torch.tensor([float("nan"), 160.0]),
    "infinite": torch.tensor([float("inf"), 160.0]),
    "complex": torch.tensor([120 + 1j, 160]),
    "narrower": torch.tensor([120, 160], dtype=torch.int32),
    "below nothing": torch.tensor([-120, 160]),
    "nothing": torch.tensor([0, 160]),
    "too large": torch.tensor([2**40, 160]),
    "too large together": torch.tensor([4000, 4000]),
}


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
def test_weights_for_pictures_that_cannot_be_are_refused_by_their_file(size: torch.Tensor, tmp_path: Path) -> None:
    """What a stranger's file says of its pictures is looked at before anything is computed with it."""
    networks = {kind: make_paper_network(kind, "depth", (64, 64)) for kind in KINDS}
    networks["direction"].register_buffer("size", size)
    PaperModel(AffordanceInfo(variant="paper"), networks).save(tmp_path / "m")
    verdict = verify(tmp_path / "m")
    assert not verdict.loads and re.match(r".*direction\.safetensors: size is \[.*no picture has", verdict.problems[0])


def test_the_smallest_pictures_leave_the_direction_network_a_cell(tmp_path: Path) -> None:
    smallest = make_paper_network("direction", "depth", (LEAST_SIDE, LEAST_SIDE))
    assert smallest(torch.zeros(2, 5, LEAST_SIDE, LEAST_SIDE)).shape == (2, 18)
    networks = {kind: make_paper_network(kind, "depth", (LEAST_SIDE, LEAST_SIDE)) for kind in KINDS}
    networks["direction"].register_buffer("size", torch.tensor([LEAST_SIDE - 1, LEAST_SIDE]))
    PaperModel(AffordanceInfo(variant="paper"), networks).save(tmp_path / "m")
    assert "pictures of 64 x 63 pixels" in verify(tmp_path / "m").problems[0]
