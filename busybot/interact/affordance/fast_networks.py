"""The networks of the `fast` variant: where to act, and in which direction.

They do what the paper's do (section 3.1, appendix A.1) at a cost that a laptop's processor can train and run: the
position network sees the whole picture at full resolution, but works at half of it; the direction network sees a crop
around the position instead of the picture with a Gaussian at the position, because what moves how is a local question.
"""

from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from busybot.interact.affordance.inputs import CHANNELS, Inputs

Kind = Literal["position", "direction"]
KINDS: tuple[Kind, ...] = ("position", "direction")

DIRECTION_COUNT = 18
POSITION_STRIDE = 16
"""Sides of the position network's input are multiples of this."""
POSITION_WIDTHS = (24, 48, 64, 96)
DIRECTION_WIDTHS = (32, 48, 64, 96)
CROP = 64
"""Side of the direction network's input, pixels; the position is pixel (CROP / 2, CROP / 2)."""
HIDDEN = 192
GAUSSIAN_SHARPNESS = 40.0
"""The position's Gaussian is exp(-40 r^2), r in half crops: standard deviation 3.6 pixels."""


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
    """Affordance of every pixel: a U-Net on pixels that were folded two by two into channels; 0.4 M parameters.

    Shapes:
        input: (B, C, H, W), H and W multiples of 16.
        output: (B, H, W), logit that acting here, in the right direction, changes something.
    """

    def __init__(self, channels: int):
        super().__init__()
        a, b, c, d = POSITION_WIDTHS
        self.encode0 = _double(4 * channels, a)
        self.encode1 = _double(a, b)
        self.encode2 = _double(b, c)
        self.encode3 = _double(c, d)
        self.decode2 = _block(d + c, c)
        self.decode1 = _block(c + b, b)
        self.decode0 = _block(b + a, a)
        self.head = nn.Conv2d(a, 4, 1)

    def forward(self, features: Tensor) -> Tensor:
        folded = functional.pixel_unshuffle(features, 2)  # (B, 4C, H/2, W/2)
        x0 = self.encode0(folded)
        x1 = self.encode1(functional.max_pool2d(x0, 2))  # H/4
        x2 = self.encode2(functional.max_pool2d(x1, 2))  # H/8
        x3 = self.encode3(functional.max_pool2d(x2, 2))  # H/16
        x2 = self.decode2(torch.cat([_double_size(x3), x2], dim=1))
        x1 = self.decode1(torch.cat([_double_size(x2), x1], dim=1))
        x0 = self.decode0(torch.cat([_double_size(x1), x0], dim=1))
        return functional.pixel_shuffle(self.head(x0), 2)[:, 0]  # (B, 4, H/2, W/2) -> (B, H, W)


def _double_size(x: Tensor) -> Tensor:
    return functional.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)


class DirectionNet(nn.Module):
    """Which directions work at the centre of a crop; 0.5 M parameters.

    Three more channels tell where in the crop a pixel is: its row and column from -1 to 1, and a Gaussian at the
    centre.

    Shapes:
        input: (B, C, 64, 64).
        keep: (B, 192) of 0 and 1 / (1 - dropout), multiplied to the hidden layer in training: dropout whose draws the
            caller makes, so that training can be resumed exactly.
        output: (B, 18) logits, one per direction, that this direction changes something; (B,) logit that any does.
    """

    places: Tensor

    def __init__(self, channels: int):
        super().__init__()
        a, b, c, d = DIRECTION_WIDTHS
        axis = (torch.arange(CROP) - CROP / 2 + 0.5) / (CROP / 2)
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
        embedded = self.convolutions(torch.cat([crops, places.to(crops.dtype)], dim=1))  # (B, 1536)
        hidden = functional.relu(self.hidden(embedded))
        logits = self.head(hidden if keep is None else hidden * keep)  # (B, 19)
        return logits[:, :DIRECTION_COUNT], logits[:, DIRECTION_COUNT]


def make_network(kind: Kind, inputs: Inputs) -> nn.Module:
    """An untrained network, in the memory layout in which convolutions are fastest."""
    network: nn.Module = (PositionNet if kind == "position" else DirectionNet)(CHANNELS[inputs])
    return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's stubs lack it
