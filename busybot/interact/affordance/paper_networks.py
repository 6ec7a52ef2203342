"""The networks of the `paper` variant, as the paper's appendix A.1 "Network detail" describes them.

What the paper leaves open, and what is chosen here:

- Order in a block: pooling (or interpolation) first, then the convolutions, as the text lists them. The U-Net then
  goes from 480 x 640 to 30 x 40 and back, and the direction network's last layer has 7 x 10 cells (480 / 64 = 7.5:
  odd sides lose a row).
- Skip connections: every up block also gets what the network had at its resolution before: the down blocks' outputs,
  and at full resolution the input itself.
- No activation after the last convolution and the last linear layer: these are logits. After a ReLU a pixel with two
  negative logits would have affordance 1/2 and no gradient.
- All convolutions keep the size (zero padding of 1), no normalisation layers, ReLU after all other layers.
- Weights and biases are drawn as torch does by default. Larger ones (He et al.) drove both channels of the last block
  to zero within a few iterations, in four trials of four: nothing was learnt any more.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from busybot.interact.affordance.fast_networks import DIRECTION_COUNT, Kind
from busybot.interact.affordance.inputs import CHANNELS, Inputs

DOWN_WIDTHS = (32, 64, 128, 256)
UP_WIDTHS = (128, 64, 32, 2)
PAPER_DIRECTION_WIDTHS = (32, 64, 128, 256, 512, 512, 512)
EMBEDDING_WIDTHS = (256, 256)
SCORE_WIDTHS = (1024, 1024, 1024, DIRECTION_COUNT)
SIZE = (480, 640)
"""Rows and columns of the paper's pictures."""

Size = tuple[int, int]


class PaperPositionNet(nn.Module):
    """A U-Net of 4 down and 4 up blocks; 1.95 M parameters.

    Shapes:
        input: (B, C, H, W); C is 4 (depth and normals) or 3 (colours).
        output: (B, 2, H, W), logits of "acting here changes nothing" and "... something". The affordance is the
            second channel of their softmax.
    """

    def __init__(self, channels: int):
        super().__init__()
        sources = (channels, *DOWN_WIDTHS)
        self.down = nn.ModuleList(_convolutions(a, b) for a, b in zip(sources, DOWN_WIDTHS, strict=False))
        below, beside = (DOWN_WIDTHS[-1], *UP_WIDTHS), sources[-2::-1]  # 256, 128, 64, 32 and 128, 64, 32, C
        blocks = [_convolutions(a + skip, b) for a, skip, b in zip(below, beside, UP_WIDTHS, strict=False)]
        self.up = nn.ModuleList([*blocks[:-1], blocks[-1][:-1]])  # no ReLU after the logits

    def forward(self, features: Tensor) -> Tensor:
        levels = [features]
        for block in self.down:
            levels.append(block(functional.max_pool2d(levels[-1], 2)))  # H/2, H/4, H/8, H/16
        x = levels.pop()
        for block in self.up:
            skip = levels.pop()
            larger = functional.interpolate(x, size=skip.shape[-2:], mode="bilinear", align_corners=False)
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
        for number, (a, b) in enumerate(zip((channels + 1, *PAPER_DIRECTION_WIDTHS), PAPER_DIRECTION_WIDTHS, strict=False)):
            layers += [nn.MaxPool2d(2)] if number else []
            layers += [nn.Conv2d(a, b, 3, padding=1), nn.ReLU(inplace=True)]
        self.convolutions = nn.Sequential(*layers)
        shrink = 2 ** (len(PAPER_DIRECTION_WIDTHS) - 1)
        cells = (size[0] // shrink) * (size[1] // shrink)
        self.embed = nn.Sequential(nn.Flatten(), *_perceptron(PAPER_DIRECTION_WIDTHS[-1] * cells, EMBEDDING_WIDTHS))
        self.score = nn.Sequential(*_perceptron(EMBEDDING_WIDTHS[-1], SCORE_WIDTHS)[:-1])  # the last are logits

    def forward(self, features: Tensor) -> Tensor:
        seen = self.convolutions(features)  # (B, 512, 7, 10)
        return self.score(self.embed(seen))


def _convolutions(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, padding=1),
        nn.ReLU(inplace=True),
        nn.Conv2d(outputs, outputs, 3, padding=1),
        nn.ReLU(inplace=True),
    )


def _perceptron(inputs: int, widths: tuple[int, ...]) -> list[nn.Module]:
    """A linear layer and a ReLU for each width."""
    pairs = zip((inputs, *widths), widths, strict=False)
    return [module for a, b in pairs for module in (nn.Linear(a, b), nn.ReLU(inplace=True))]


def make_paper_network(kind: Kind, inputs: Inputs, size: Size = SIZE) -> nn.Module:
    """An untrained network for pictures of `size` rows and columns."""
    channels = CHANNELS[inputs]
    network = PaperPositionNet(channels) if kind == "position" else PaperDirectionNet(channels, size)
    return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's stubs lack it
