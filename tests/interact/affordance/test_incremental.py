"""The networks as they are run say what they say as they were trained, the position network in parts, too."""

from typing import TypeVar

import numpy as np
import pytest
import torch

from busybot.interact.affordance.folding import FoldedBlock, FoldedDirectionNet, FoldedPositionNet
from busybot.interact.affordance.incremental import IncrementalPositionNet
from busybot.interact.affordance.networks import CROP, POSITION_SIZES, DirectionNet, PositionNet, PositionSize

N = TypeVar("N", bound=torch.nn.Module)


def network(inside: PositionSize | None = None) -> PositionNet:
    torch.manual_seed(0)
    return with_statistics(PositionNet(4, inside))


def with_statistics(made: N) -> N:
    """With statistics of batches that are not those of the beginning."""
    for module in made.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.running_mean.normal_(0, 0.1)
            module.running_var.uniform_(0.5, 2)
    return made.eval()


def unlike(one: torch.Tensor, other: torch.Tensor) -> np.ndarray:
    """Where a picture differs, uint8 (H, W)."""
    return np.asarray((one != other).any(dim=0).numpy(), np.uint8)


def changed_copy(features: torch.Tensor, rng: np.random.Generator) -> torch.Tensor:
    """A few rectangles anew, some of them at the border."""
    after, shape = features.clone(), features.shape[1:]
    for _ in range(int(rng.integers(0, 3))):
        height, width = (int(rng.integers(1, max(2, size // 5))) for size in shape)
        top, left = (int(rng.integers(0, size - n + 1)) for size, n in zip(shape, (height, width), strict=True))
        place = (slice(top, top + height), slice(left, left + width))
        after[:, *place] = torch.from_numpy(rng.normal(size=(4, height, width))).float()
    return after


@pytest.mark.parametrize("inside", POSITION_SIZES.values(), ids=POSITION_SIZES)
@pytest.mark.parametrize("size", [(48, 64), (160, 208), (32, 400)])
def test_it_is_equal_to_a_whole_pass(size: tuple[int, int], inside: PositionSize) -> None:
    whole, rng = network(inside), np.random.default_rng(7)
    parts = IncrementalPositionNet(FoldedPositionNet(whole), size)
    features = before = torch.from_numpy(rng.normal(size=(4, *size))).float()
    with torch.inference_mode():
        for _ in range(12):
            wanted = np.zeros(size, np.uint8)
            top, left = (int(rng.integers(0, side // 2)) for side in size)
            wanted[top : top + size[0] // 3, left : left + size[1] // 3] = 1
            logits, expected = parts(features, wanted, unlike(features, before)), whole(features[None])[0]
            torch.testing.assert_close(logits[wanted > 0], expected[wanted > 0], rtol=1e-5, atol=1e-5)
            before, features = features, changed_copy(features, rng)


@pytest.mark.parametrize("seed", range(6))
def test_another_part_of_the_picture_is_seen_as_if_it_were_the_first(seed: int) -> None:
    whole, rng = network(), np.random.default_rng(seed)
    picture = torch.from_numpy(rng.normal(size=(4, 240, 304))).float()

    def part() -> list[slice]:
        starts = [16 * int(rng.integers(0, 4)) for _ in range(2)]
        return [
            slice(first, side - 16 * int(rng.integers(0, 4))) for first, side in zip(starts, (240, 304), strict=True)
        ]

    before = part()
    features = picture[:, *before]
    parts = IncrementalPositionNet(FoldedPositionNet(whole), tuple(features.shape[1:]))
    with torch.inference_mode():
        parts(features, *np.ones((2, *features.shape[1:]), np.uint8))
        for _ in range(5):
            after = part()
            features = picture[:, *after]
            first = (after[0].start - before[0].start, after[1].start - before[1].start)
            parts = parts.moved(first, tuple(features.shape[1:]))
            wanted = np.ones(features.shape[1:], np.uint8)
            logits = parts(features, wanted, np.zeros_like(wanted))
            torch.testing.assert_close(logits, whole(features[None])[0], rtol=1e-5, atol=1e-5)
            before = after


@pytest.mark.parametrize("first", [(0, 64), (0, -96), (80, -16)])
def test_parts_of_a_picture_that_lie_apart_share_nothing(first: tuple[int, int]) -> None:
    whole, rng, size = network(), np.random.default_rng(2), (64, 64)
    one, two = torch.from_numpy(rng.normal(size=(2, 4, *size))).float()
    parts, wanted = IncrementalPositionNet(FoldedPositionNet(whole), size), np.ones(size, np.uint8)
    with torch.inference_mode():
        parts(one, wanted, wanted)
        logits = parts.moved(first, size)(two, wanted, np.zeros_like(wanted))
        torch.testing.assert_close(logits, whole(two[None])[0], rtol=1e-5, atol=1e-5)


def test_what_was_not_wanted_is_computed_when_it_is() -> None:
    whole, rng, size = network(), np.random.default_rng(1), (96, 96)
    parts, nothing = IncrementalPositionNet(FoldedPositionNet(whole), size), np.zeros((96, 96), np.uint8)
    features = torch.from_numpy(rng.normal(size=(4, *size))).float()
    with torch.inference_mode():
        everything = np.ones(size, np.uint8)
        parts(features, nothing, everything)
        after = features + 1
        assert not torch.allclose(parts(after, nothing, everything), whole(after[None])[0], atol=1e-2)
        logits = parts(after, everything, nothing)
        torch.testing.assert_close(logits, whole(after[None])[0], rtol=1e-5, atol=1e-5)


def test_a_small_change_costs_little(monkeypatch: pytest.MonkeyPatch) -> None:
    work: list[int] = []
    apply = FoldedBlock.__call__

    def counted(block: FoldedBlock, x: torch.Tensor, zeros: list[int] | None = None) -> torch.Tensor:
        if block.reach and zeros is not None and not any(zeros):  # of a part inside of the picture
            work.append(x.numel())
        return apply(block, x, zeros)

    monkeypatch.setattr(FoldedBlock, "__call__", counted)
    size = (480, 640)
    parts, features = IncrementalPositionNet(FoldedPositionNet(network()), size), torch.zeros(4, *size)
    wanted = np.zeros(size, np.uint8)
    wanted[190:240, 290:340] = 1
    with torch.inference_mode():
        parts(features, wanted, wanted)
        assert 0 < sum(work) < 8 * 240 * 320 * 4, "of the first picture what is wanted"
        work.clear()
        after = features.clone()
        after[:, 200:230, 300:330] = 1
        parts(after, wanted, unlike(after, features))
        assert 0 < sum(work) < 4 * 240 * 320 * 4, "less than reading the whole picture at the first layer"
        work.clear()
        parts(after, wanted, np.zeros_like(wanted))
        assert not work


def test_crops_are_seen_as_the_networks_own_layers_see_them() -> None:
    torch.manual_seed(0)
    network = with_statistics(DirectionNet(4))
    crops = torch.randn(5, 4, CROP, CROP)
    with torch.inference_mode():
        for given, wanted in zip(FoldedDirectionNet(network)(crops), network(crops), strict=True):
            torch.testing.assert_close(given, wanted, rtol=1e-4, atol=1e-5)
