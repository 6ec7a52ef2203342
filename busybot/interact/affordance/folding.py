"""Trained networks as they are run: a normalisation becomes a part of the convolution before it."""

from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn
from torch.nn import functional

from busybot.interact.affordance.networks import DirectionNet, PositionNet


@dataclass(frozen=True)
class FoldedBlock:
    """A convolution of which the normalisation behind it has become a part, and ReLU or none.

    Attributes:
        reach: cells that it sees beyond its own.
        stride: cells from one output to the next.
    """

    weight: Tensor
    bias: Tensor | None
    bends: bool
    reach: int
    stride: int = 1

    @staticmethod
    def of(block: nn.Module, dtype: torch.dtype = torch.float32) -> "FoldedBlock":
        """Of a convolution, or of one with what comes after it, for numbers of this type."""
        convolution, *rest = block if isinstance(block, nn.Sequential) else [block]
        assert isinstance(convolution, nn.Conv2d)
        weight, bias = convolution.weight.detach(), convolution.bias
        for norm in rest:
            if isinstance(norm, nn.BatchNorm2d):
                assert norm.running_mean is not None and norm.running_var is not None and bias is None
                gain = norm.weight.detach() * (norm.running_var + norm.eps).rsqrt()
                weight, bias = weight * gain[:, None, None, None], norm.bias.detach() - norm.running_mean * gain
        weight = weight.to(dtype).contiguous(memory_format=torch.channels_last)
        bias = None if bias is None else bias.detach().to(dtype)
        bends = any(isinstance(one, nn.ReLU) for one in rest)
        return FoldedBlock(weight, bias, bends, convolution.kernel_size[0] // 2, convolution.stride[0])

    def __call__(self, x: Tensor, zeros: Sequence[int] | None = None) -> Tensor:
        """(B, C, H, W), with so many zeros before and after its columns and rows; by default as many as it reaches."""
        zeros = [self.reach] * 4 if zeros is None else zeros
        if len(set(zeros)) == 1:
            x = functional.conv2d(x, self.weight, self.bias, self.stride, zeros[0])
        else:
            x = functional.conv2d(functional.pad(x, zeros), self.weight, self.bias, self.stride)
        return x.relu_() if self.bends else x


class FoldedPositionNet:
    """The layers of a `PositionNet` as they are run, the finest level first.

    Args:
        network: in evaluation mode; what it learns afterwards is not heard of.
        dtype: of the numbers that it is given.
    """

    def __init__(self, network: PositionNet, dtype: torch.dtype = torch.float32):
        self.dtype, self.joined = dtype, network.joined
        self.encoders = [[FoldedBlock.of(block, dtype) for block in encode] for encode in network.encoders]
        self.decoders = [FoldedBlock.of(block, dtype) for block in network.decoders]
        self.head, *self.lifts = (FoldedBlock.of(block, dtype) for block in (network.head, *network.lifts))


class FoldedDirectionNet:
    """`DirectionNet` as it is run: what its first convolution makes of the places is the same for all crops.

    Args:
        network: in evaluation mode; what it learns afterwards is not heard of.
        dtype: of the numbers that it is given.
    """

    def __init__(self, network: DirectionNet, dtype: torch.dtype = torch.float32):
        self._network = deepcopy(network).to(dtype).requires_grad_(False)
        first, *rest = (_folded(layer, dtype) for layer in _layers(network.convolutions))
        assert isinstance(first, FoldedBlock)
        channels = first.weight.shape[1] - len(network.places)
        of_crops, of_places = first.weight.split([channels, len(network.places)], dim=1)
        self._first = replace(
            first, weight=of_crops.contiguous(memory_format=torch.channels_last), bias=None, bends=False
        )
        self._places = replace(first, weight=of_places, bends=False)(network.places[None].to(dtype))
        self._rest = rest

    def __call__(self, crops: Tensor) -> tuple[Tensor, Tensor]:
        """See `DirectionNet`."""
        x = (self._first(crops) + self._places).relu_()
        for layer in self._rest:
            x = layer(x)
        return self._network.answer(x)


def _layers(nested: nn.Sequential) -> Iterator[nn.Module]:
    """Its layers, each convolution with what belongs to it."""
    for layer in nested:
        if isinstance(layer, nn.Sequential) and isinstance(layer[0], nn.Sequential):
            yield from _layers(layer)
        else:
            yield layer


def _folded(layer: nn.Module, dtype: torch.dtype) -> Callable[[Tensor], Tensor]:
    return FoldedBlock.of(layer, dtype) if isinstance(layer, nn.Sequential) else layer
