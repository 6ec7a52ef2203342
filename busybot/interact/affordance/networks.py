"""The networks of both variants: where to act, and in which direction.

Those of the `fast` variant do what the paper's do (section 4.1, appendix A.1) at a cost that a laptop's processor can
train and run: the position network sees the whole picture at full resolution, but works at half of it; the direction
network sees a crop around the position instead of the picture with a Gaussian at the position, because what moves how
is a local question. A trained position network's size is that of its weights.

Those of the `paper` variant are as the paper's appendix A.1 "Network detail" describes them. What it leaves open is as
its authors have it (docs/reference/departures.md), or else chosen here:

- Every convolution is followed by batch normalisation (the authors'), then by ReLU. They keep the size (zero padding).
- Order in a block: pooling (or interpolation) first, then the convolutions, as the text lists them. The U-Net goes from
  480 x 640 to 30 x 40 and back, and the direction network's last layer has 7 x 10 cells (480 / 64 = 7.5: odd sides lose
  a row).
- One convolution at full resolution comes before the first block down (the authors'): "U-Net" is all the text says.
- Every up block also gets what the network had at its resolution before.
- The last up block has two convolutions as the others do, and its 2 channels come from a third one of 1 x 1 (the
  authors'). They are logits: after a ReLU a pixel with two negative ones would have affordance 1/2 and no gradient.
- The blocks' widths are the text's, where the authors' differ.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from busybot.interact.affordance.inputs import CHANNELS
from busybot.interact.policy.config import Inputs

Kind = Literal["position", "direction"]
Networks = Literal["lean", "wide"]
KINDS: tuple[Kind, ...] = ("position", "direction")

DIRECTION_COUNT = 18
POSITION_STRIDE = 16
"""Sides of the position network's input are multiples of this."""
FOLD = 2
"""Side of the squares of pixels that become channels of the position network."""
CROP = 64
"""Side of the direction network's input, pixels; the position is pixel (CROP / 2, CROP / 2)."""
GAUSSIAN_SHARPNESS = 40.0
"""The position's Gaussian is exp(-40 r^2), r in half crops: standard deviation 3.6 pixels."""


@dataclass(frozen=True)
class PositionSize:
    """What a position network looks like inside.

    Attributes:
        widths: channels of each of the levels, the finest first.
        added: what comes from a coarser level is given the width of the finer one where it is coarse and is added to
            what is there; else both lie beside each other, and the finer level's convolution takes more channels.
    """

    widths: tuple[int, int, int, int]
    added: bool


POSITION_SIZES: dict[Networks, PositionSize] = {
    "lean": PositionSize((16, 32, 64, 96), added=True),
    "wide": PositionSize((24, 48, 64, 96), added=False),
}
"""Sizes by name; the lean one learns and judges in two fifths of the time that the wide one takes."""
DIRECTION_WIDTHS = (32, 48, 64, 96)
"""Channels of the direction network at 32 x 32 cells (two layers), 16 x 16 and 8 x 8."""
HIDDEN = 192
"""Width of its layer before the logits."""


def _block(inputs: int, outputs: int, kernel: int = 3, stride: int = 1) -> nn.Sequential:
    """Convolution, batch normalisation, ReLU."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )


def _double(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(_block(inputs, outputs), _block(outputs, outputs))


class PositionNet(nn.Module):
    """Affordance of every pixel: a U-Net on pixels that were folded into channels; 0.27 M parameters, wide 0.4 M.

    Shapes:
        input: (B, C, H, W), H and W multiples of 16.
        output: (B, H, W), logit that acting here, in the right direction, changes something.
    """

    def __init__(self, channels: int, size: PositionSize | None = None):
        super().__init__()
        self.size = size or POSITION_SIZES["lean"]
        widths = self.size.widths
        for level, (above, width) in enumerate(zip((FOLD**2 * channels, *widths), widths, strict=False)):
            self.add_module(f"encode{level}", _double(above, width))
        for level in reversed(range(len(widths) - 1)):
            if self.size.added:
                self.add_module(f"lift{level}", _block(widths[level + 1], widths[level], kernel=1))
            beside = 0 if self.size.added else widths[level + 1]
            self.add_module(f"decode{level}", _block(widths[level] + beside, widths[level]))
        self.head = nn.Conv2d(widths[0], FOLD**2, 1)

    @property
    def encoders(self) -> list[nn.Sequential]:
        """By level, the finest first."""
        return [self.get_submodule(f"encode{level}") for level in range(len(self.size.widths))]  # type: ignore[misc]

    @property
    def decoders(self) -> list[nn.Sequential]:
        """By level, the finest first; the coarsest level has none."""
        return [self.get_submodule(f"decode{level}") for level in range(len(self.size.widths) - 1)]  # type: ignore[misc]

    @property
    def lifts(self) -> list[nn.Sequential]:
        """By level to which they lift the next coarser one, the finest first; none where levels lie beside another."""
        return [self.get_submodule(f"lift{level}") for level in range(len(self.decoders) * self.size.added)]  # type: ignore[misc]

    def joined(self, coarser: Tensor, finer: Tensor) -> Tensor:
        """What a decoder reads: the level below in its own size, and what its encoder made."""
        return coarser + finer if self.size.added else torch.cat([coarser, finer], dim=1)

    def forward(self, features: Tensor) -> Tensor:
        x = functional.pixel_unshuffle(features, FOLD)  # (B, 4 C, H / 2, W / 2)
        finer = []
        for level, encode in enumerate(self.encoders):
            x = encode(functional.max_pool2d(x, 2) if level else x)
            finer.append(x)
        for level in reversed(range(len(self.decoders))):
            lifted = self.lifts[level](x) if self.size.added else x
            x = self.decoders[level](self.joined(double_size(lifted), finer[level]))
        return functional.pixel_shuffle(self.head(x), FOLD)[:, 0]  # (B, H, W)


def double_size(x: Tensor) -> Tensor:
    """A coarser level, (B, C, H, W), as the next finer one reads it: interpolated to twice the rows and columns."""
    return functional.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)


class DirectionNet(nn.Module):
    """Which directions work at the centre of a crop; 0.5 M parameters.

    Three more channels tell where in the crop a pixel is: its row and column from -1 to 1, and a Gaussian at the
    centre.

    Shapes:
        input: (B, C, 64, 64).
        keep: (B, hidden) of 0 and 1 / (1 - dropout), multiplied to the hidden layer in training: dropout whose draws
            the caller makes, so that training can be resumed exactly.
        output: (B, 18) logits, one per direction, that this direction changes something; (B,) logit that any does.
    """

    places: Tensor

    def __init__(self, channels: int):
        super().__init__()
        a, b, c, d = DIRECTION_WIDTHS
        axis = (torch.arange(CROP, device="cpu") - CROP / 2 + 0.5) / (CROP / 2)
        rows, columns = torch.meshgrid(axis, axis, indexing="ij")
        gaussian = torch.exp(-(rows**2 + columns**2) * GAUSSIAN_SHARPNESS)
        self.register_buffer("places", torch.stack([rows, columns, gaussian]), persistent=False)
        self.convolutions = nn.Sequential(
            _block(channels + 3, a, kernel=5, stride=2),  # 32 x 32
            _block(a, b),
            nn.MaxPool2d(2),  # 16 x 16
            _double(b, c),
            nn.MaxPool2d(2),  # 8 x 8
            _double(c, d),
            nn.MaxPool2d(2),  # 4 x 4
            nn.Flatten(),
        )
        self.hidden = nn.Linear(d * (CROP // 16) ** 2, HIDDEN)
        self.head = nn.Linear(HIDDEN, DIRECTION_COUNT + 1)

    def forward(self, crops: Tensor, keep: Tensor | None = None) -> tuple[Tensor, Tensor]:
        places = self.places[None].expand(len(crops), -1, -1, -1)
        return self.answer(self.convolutions(torch.cat([crops, places.to(crops.dtype)], dim=1)), keep)

    def answer(self, embedded: Tensor, keep: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """What is told of what the convolutions made of crops, (B, 16 d)."""
        hidden = functional.relu(self.hidden(embedded))
        logits = self.head(hidden if keep is None else hidden * keep)  # (B, 19)
        return logits[:, :DIRECTION_COUNT], logits[:, DIRECTION_COUNT]


def make_network(
    kind: Kind, inputs: Inputs, tensors: dict[str, Tensor] | None = None, networks: Networks = "lean"
) -> nn.Module:
    """An untrained network, in the memory layout in which convolutions are fastest.

    Args:
        tensors: weights that it is to take, which tell its size; None for a network of the size that is named.
    """
    channels = CHANNELS[inputs]
    if kind == "direction":
        network: nn.Module = DirectionNet(channels)
    else:
        if tensors is not None:
            networks = "lean" if "lift0.0.weight" in tensors else "wide"
        network = PositionNet(channels, POSITION_SIZES[networks])
    return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's stubs lack it


STEM_WIDTH = 32
"""Channels at full resolution, before the first block down and within the last block up."""
DOWN_WIDTHS = (32, 64, 128, 256)
UP_WIDTHS = (128, 64, 32, 2)
PAPER_DIRECTION_WIDTHS = (32, 64, 128, 256, 512, 512, 512)
EMBEDDING_WIDTHS = (256, 256)
SCORE_WIDTHS = (1024, 1024, 1024, DIRECTION_COUNT)
SIZE = (480, 640)
"""Rows and columns of the paper's pictures."""
LEAST_SIDE = 2 ** (len(PAPER_DIRECTION_WIDTHS) - 1)
"""Of smaller pictures the direction network's poolings leave nothing, pixels."""

Size = tuple[int, int]


class PaperPositionNet(nn.Module):
    """A U-Net of 4 down and 4 up blocks; 1.99 M parameters.

    Shapes:
        input: (B, C, H, W); C is 4 (depth and normals) or 3 (colours).
        output: (B, 2, H, W), logits of "acting here changes nothing" and "... something". The affordance is the
            second channel of their softmax.
    """

    def __init__(self, channels: int):
        super().__init__()
        levels = (STEM_WIDTH, *DOWN_WIDTHS)
        self.stem = _block(channels, STEM_WIDTH)
        self.down = nn.ModuleList(_double(a, b) for a, b in pairwise(levels))
        *widths, classes = UP_WIDTHS
        below, beside = pairwise((DOWN_WIDTHS[-1], *widths, STEM_WIDTH)), levels[-2::-1]
        blocks = [_double(a + skip, b) for (a, b), skip in zip(below, beside, strict=True)]
        blocks[-1].append(nn.Conv2d(STEM_WIDTH, classes, 1))
        self.up = nn.ModuleList(blocks)

    def forward(self, features: Tensor) -> Tensor:
        levels = [self.stem(features)]  # H, W
        for block in self.down:
            levels.append(block(functional.max_pool2d(levels[-1], 2)))  # H/2, H/4, H/8, H/16
        x = levels.pop()
        for block in self.up:
            skip = levels.pop()
            larger = functional.interpolate(x, size=skip.shape[-2:], mode="bilinear", align_corners=True)
            x = block(torch.cat([larger, skip], dim=1))
        return x


class PaperDirectionNet(nn.Module):
    """Seven convolutions, then two perceptrons; 17.9 M parameters for pictures of 480 x 640.

    Args:
        size: rows and columns of the pictures; saved with the weights.

    Shapes:
        input: (B, C + 1, H, W): depth and normals, or colours, and a Gaussian at the selected position.
        output: (B, 18), logits that the directions change something.
    """

    size: Tensor

    def __init__(self, channels: int, size: Size = SIZE):
        super().__init__()
        self.register_buffer("size", torch.tensor(size))
        layers: list[nn.Module] = []
        for a, b in pairwise((channels + 1, *PAPER_DIRECTION_WIDTHS)):
            layers += [_block(a, b), nn.MaxPool2d(2)]
        self.convolutions = nn.Sequential(*layers[:-1])
        cells = (size[0] // LEAST_SIDE) * (size[1] // LEAST_SIDE)
        self.embed = nn.Sequential(nn.Flatten(), *_perceptron(PAPER_DIRECTION_WIDTHS[-1] * cells, EMBEDDING_WIDTHS))
        self.score = nn.Sequential(*_perceptron(EMBEDDING_WIDTHS[-1], SCORE_WIDTHS)[:-1])  # the last are logits

    def forward(self, features: Tensor) -> Tensor:
        return self.score(self.embed(self.convolutions(features)))  # of (B, 512, 7, 10)


def _perceptron(inputs: int, widths: tuple[int, ...]) -> list[nn.Module]:
    """A linear layer and a ReLU for each width."""
    return [module for a, b in pairwise((inputs, *widths)) for module in (nn.Linear(a, b), nn.ReLU(inplace=True))]


def make_paper_network(kind: Kind, inputs: Inputs, size: Size = SIZE) -> nn.Module:
    """An untrained network for pictures of `size` rows and columns."""
    channels = CHANNELS[inputs]
    network = PaperPositionNet(channels) if kind == "position" else PaperDirectionNet(channels, size)
    return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's stubs lack it
