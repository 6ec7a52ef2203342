"""Encoders `resnet50`, `resnet50keras`, `random`: a ResNet-50's first stage, averaged over an object or at its centre.

The paper's features are 256 channels "extracted from the 10th layer" of a ResNet-50 trained on ImageNet (appendix
"Network details"), read here as the output of the first stage: one convolution and three blocks of three. The text
calls them the object's, and does not say how the many cells of a stage become one object's:

- `resnet50` averages over the object's own pixels, its box scaled to 64 x 64 pixels (`resnet50-box`: over the box).
- `resnet50-centre` does as the paper's authors: the whole picture is scaled to 224 x 224 pixels, the stage's output
  interpolated back to that size, and the one pixel at the centre of the object's first-frame box is taken.

The weights of `resnet50` are torchvision's, from a file at hand, the cache, or their official place. `resnet50keras` is
the same network with the weights that He et al. published, which come from a package index (`keras_weights`). Both
learned ImageNet; `random` has weights that were drawn: what it lacks is what ImageNet taught.
"""

from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from busybot.common.atomic_io import sha256_of
from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.objects.cache import cache_folder
from busybot.reason.encoders.weight_files import KnownFile, download, is_there
from busybot.reason.inputs.appearances import Appearance, scaled
from busybot.reason.inputs.sequence import CHANNELS
from busybot.training.device import device, exactly, slices

OFFICIAL = KnownFile(
    "https://download.pytorch.org/models/resnet50-0676ba61.pth",
    "sha256",
    "0676ba61b6795bbe1773cffd859882e5e297624d384b6993f7c9e683e722fb8a",
    102_530_333,
)
"""Torchvision's first weights for ImageNet, of the paper's time."""
HINT = "name one that is there, or use `--encoder embedded`, which needs none"
INSTEAD = "use `--encoder resnet50keras`, whose weights are elsewhere, or `--encoder embedded`, which needs none"


def resnet50_file(file: Path | None) -> tuple[Path, str]:
    """A file with the weights and its SHA-256.

    Args:
        file: any with torchvision's layout; None for the official one, which is downloaded into the cache once.

    Raises:
        BusybotError: there is no such file; it cannot be downloaded; or what came is not what was to come.
    """
    if file is not None:
        if not file.is_file():
            raise BusybotError(f"{file}: there is no such file with weights", HINT)
        return file, sha256_of(file)
    place = official_place()
    if not is_there(OFFICIAL, place):
        download(OFFICIAL, place, INSTEAD)
    return place, OFFICIAL.digest


def official_place() -> Path:
    """Where the official file is kept."""
    return cache_folder() / "weights" / OFFICIAL.name


SIDE, CELLS = 64, 16
WHOLE = 224
"""Side of the square that whole pictures are scaled to."""
BATCH = 32
"""Looks that are encoded together, on a GPU more."""
MEAN, SPREAD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Of the colour channels of ImageNet, to which the network is used."""


class Bottleneck(nn.Module):
    """y = relu(x' + conv1x1(relu(conv3x3(relu(conv1x1(x)))))), each convolution normalised; x' is x with its channels.

    Args:
        width: of the first two convolutions; the last has four times as many channels.
        stride: of the first, as in Caffe.

    Shapes:
        x: (B, inputs, h, w).
        returns: (B, 4 width, h / stride, w / stride).
    """

    def __init__(self, inputs: int, width: int = 64, stride: int = 1):
        super().__init__()
        out = 4 * width
        self.conv1, self.bn1 = nn.Conv2d(inputs, width, 1, stride, bias=False), nn.BatchNorm2d(width)
        self.conv2, self.bn2 = nn.Conv2d(width, width, 3, padding=1, bias=False), nn.BatchNorm2d(width)
        self.conv3, self.bn3 = nn.Conv2d(width, out, 1, bias=False), nn.BatchNorm2d(out)
        self.downsample: nn.Module | None = None
        if inputs != out:
            self.downsample = nn.Sequential(nn.Conv2d(inputs, out, 1, stride, bias=False), nn.BatchNorm2d(out))

    def forward(self, x: Tensor) -> Tensor:
        y = functional.relu(self.bn1(self.conv1(x)))
        y = functional.relu(self.bn2(self.conv2(y)))
        y = self.bn3(self.conv3(y))
        return functional.relu(y + (x if self.downsample is None else self.downsample(x)))


class FirstStage(nn.Module):
    """The beginning of a ResNet-50, its parts named as torchvision's files name them.

    Shapes:
        x: (B, 3, h, w), colours normalised by `MEAN` and `SPREAD`.
        returns: (B, 256, h / 4, w / 4).
    """

    def __init__(self) -> None:
        super().__init__()
        self.conv1, self.bn1 = nn.Conv2d(3, 64, 7, stride=2, padding=3, bias=False), nn.BatchNorm2d(64)
        self.layer1 = nn.Sequential(Bottleneck(64), Bottleneck(CHANNELS), Bottleneck(CHANNELS))

    def forward(self, x: Tensor) -> Tensor:
        x = functional.relu(self.bn1(self.conv1(x)))
        out: Tensor = self.layer1(functional.max_pool2d(x, 3, stride=2, padding=1))
        return out


class ResNetEncoder:
    """The encoders `resnet50`, `resnet50keras` and `random`.

    Attributes:
        key: the beginning of the SHA-256 of the file with the weights, or the version of how they are drawn.
    """

    def __init__(self, network: FirstStage, key: str):
        self.key, self._on = key, device()
        self._network = network.eval().requires_grad_(False).to(self._on)

    @torch.inference_mode()
    def encode(self, looks: list[Appearance]) -> np.ndarray:
        """float32 (n, 256); zeros where nothing shows the object. Nothing is rounded more, whatever the device."""
        rows = [np.zeros((0, CHANNELS), np.float32)]
        with exactly():
            rows += [self._encode(looks[part]) for part in slices(len(looks), BATCH, self._on)]
        return np.concatenate(rows)

    @torch.inference_mode()
    def encode_at(self, pictures: list[np.ndarray], places: np.ndarray) -> np.ndarray:
        """Places of whole pictures, uint8 (H, W, 3) each; places (K, 2) are u and v in shares of width and height.

        Returns:
            float32 (n, K, 256).
        """
        pixels = np.floor(np.asarray(places, np.float32) * WHOLE).clip(0, WHOLE - 1)
        grid = torch.from_numpy(2 * (pixels + 0.5) / WHOLE - 1).to(self._on)
        rows = [np.zeros((0, len(places), CHANNELS), np.float32)]
        with exactly():
            for part in slices(len(pictures), BATCH, self._on):
                channels = self._channels([scaled(picture, WHOLE) for picture in pictures[part]])
                where = grid.expand(len(channels), 1, -1, -1)
                # the same as interpolating all of it and taking these pixels
                taken = functional.grid_sample(channels, where, padding_mode="border", align_corners=False)
                rows.append(taken[:, :, 0].transpose(1, 2).cpu().numpy())
        return np.concatenate(rows)

    def _encode(self, looks: list[Appearance]) -> np.ndarray:
        weight = torch.from_numpy(np.stack([scaled(look.own.astype(np.float32), CELLS) for look in looks])).to(self._on)
        channels = self._channels([scaled(look.rgb, SIDE) for look in looks])
        total = weight.sum((1, 2)).clamp(min=1e-6)
        encoded: np.ndarray = (torch.einsum("bcij,bij->bc", channels, weight) / total[:, None]).cpu().numpy()
        return encoded

    def _channels(self, pictures: list[np.ndarray]) -> Tensor:
        """The first stage of pictures of one size, (B, 256, h / 4, w / 4)."""
        rgb = torch.from_numpy(np.stack(pictures)).to(self._on).float() / 255
        colours = (rgb - rgb.new_tensor(MEAN)) / rgb.new_tensor(SPREAD)
        channels: Tensor = self._network(colours.permute(0, 3, 1, 2))
        return channels


def pretrained(file: Path | None) -> ResNetEncoder:
    """The encoder `resnet50`.

    Args:
        file: with weights as torchvision stores them; None for the official ones, downloaded once.

    Raises:
        BusybotError: the file is not such a file, or the official one cannot be had.
    """
    path, checksum = resnet50_file(file)
    hint = "name a file with the weights of torchvision's ResNet-50 (`--weights FILE`)"
    try:
        stored = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # whatever a file that is none makes the reader raise
        raise BusybotError(f"{path}: cannot be read as weights: {type(error).__name__}", hint) from None
    return ResNetEncoder(with_weights(stored, path, hint), checksum[:8])


def with_weights(stored: Any, path: Path, hint: str) -> FirstStage:
    """The first stage with its part of what a file holds, by name.

    Raises:
        BusybotError: the file holds something else.
    """
    network = FirstStage()
    expected = network.state_dict()
    given = {name: stored[name] for name in expected if name in stored} if isinstance(stored, dict) else {}
    unlike = [name for name, value in expected.items() if getattr(given.get(name), "shape", None) != value.shape]
    if unlike:
        raise BusybotError(f"{path}: no weights of a ResNet-50: {unlike[0]} is missing or of another shape", hint)
    network.load_state_dict(given)
    return network


def drawn() -> ResNetEncoder:
    """The encoder `random`: He's initialisation, always the same numbers."""
    rng = generator(0, "", 0, "reason/random-encoder")
    network = FirstStage()
    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            shape = module.weight.shape
            values = rng.normal(0, np.sqrt(2 / np.prod(shape[1:])), shape)
            module.weight = nn.Parameter(torch.from_numpy(values.astype(np.float32)))
    return ResNetEncoder(network, "1")
