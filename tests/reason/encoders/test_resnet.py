"""ResNet-50's first stage: torchvision's layout, read safely; and its weights, from where they are had."""

import hashlib
import io
import urllib.error
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from busybot.common.errors import BusybotError
from busybot.reason.encoders import resnet as weights
from busybot.reason.encoders.resnet import FirstStage, drawn, pretrained
from busybot.reason.inputs.appearances import Appearance

KEYS = {"conv1.weight", "bn1.running_var", "layer1.0.downsample.0.weight", "layer1.2.bn3.bias", "layer1.1.conv2.weight"}


def look(seed: int, size: int = 40) -> Appearance:
    rng = np.random.default_rng(seed)
    own = np.zeros((size, size), bool)
    own[5:30, 8:36] = True
    return Appearance(rng.integers(0, 256, (size, size, 3), np.uint8), own)


def stored(path: Path, **more: Any) -> Path:
    """A file like torchvision's, with what we do not need besides."""
    values = drawn()._network.state_dict() | {"fc.weight": torch.zeros(1000, 2048), "layer2.0.bn1.bias": torch.zeros(1)}
    torch.save(values | more, path)
    return path


def test_it_has_the_shape_and_names_of_the_original() -> None:
    network = FirstStage()
    assert network(torch.zeros(2, 3, 64, 64)).shape == (2, 256, 16, 16)
    assert set(network.state_dict()) >= KEYS
    convolutions = sum(value.numel() for name, value in network.state_dict().items() if value.ndim == 4)
    assert convolutions == 9408 + 73728 + 2 * 69632, "those of conv1 and of layer1 in the literature"


def test_weights_of_a_file_are_used(tmp_path: Path) -> None:
    encoder = pretrained(stored(tmp_path / "w.pth"))
    np.testing.assert_array_equal(encoder.encode([look(1), look(2)]), drawn().encode([look(1), look(2)]))
    changed = pretrained(stored(tmp_path / "v.pth", **{"conv1.weight": torch.ones(64, 3, 7, 7)}))
    assert changed.key != encoder.key
    assert not np.allclose(changed.encode([look(1)]), encoder.encode([look(1)]))


def test_an_encoding_does_not_depend_on_its_batch() -> None:
    encoder = drawn()
    many = encoder.encode([look(seed) for seed in range(40)])
    np.testing.assert_allclose(encoder.encode([look(35)])[0], many[35], rtol=1e-4, atol=1e-5)
    assert encoder.encode([]).shape == (0, 256)
    assert many.shape == (40, 256) and many.dtype == np.float32 and many.std(0).max() > 0


def test_where_nothing_shows_it_is_zero() -> None:
    assert not drawn().encode([Appearance(look(1).rgb, np.zeros((40, 40), bool))]).any()


def test_a_file_that_runs_code_is_refused_unread(tmp_path: Path) -> None:
    class Harmful:
        def __reduce__(self) -> tuple[Any, ...]:
            return (Path.touch, (tmp_path / "ran",))

    torch.save({"conv1.weight": Harmful()}, tmp_path / "w.pth")
    with pytest.raises(BusybotError, match="cannot be read as weights"):
        pretrained(tmp_path / "w.pth")
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("content", [b"", b"not weights"])
def test_a_file_that_holds_no_weights_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "w.pth").write_bytes(content)
    with pytest.raises(BusybotError, match="w.pth"):
        pretrained(tmp_path / "w.pth")


def test_a_file_of_another_network_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BusybotError, match="conv1.weight is missing or of another shape"):
        pretrained(stored(tmp_path / "w.pth", **{"conv1.weight": torch.ones(3)}))
    torch.save([1, 2], tmp_path / "list.pth")
    with pytest.raises(BusybotError, match="missing"):
        pretrained(tmp_path / "list.pth")
    with pytest.raises(BusybotError, match="no such file"):
        pretrained(tmp_path / "absent.pth")


def test_the_official_file_is_downloaded_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    content, asked = b"weights" * 1000, []
    digest = hashlib.sha256(content).hexdigest()

    def answer(address: str, timeout: float) -> io.BytesIO:
        asked.append(address)
        return io.BytesIO(content)

    monkeypatch.setenv("BUSYBOT_CACHE", str(tmp_path))
    monkeypatch.setattr(weights, "OFFICIAL", weights.OFFICIAL._replace(digest=digest, bytes=len(content)))
    monkeypatch.setattr("urllib.request.urlopen", answer)
    for _ in range(2):
        path, checksum = weights.resnet50_file(None)
        assert path.read_bytes() == content and checksum == digest
    assert asked == ["https://download.pytorch.org/models/resnet50-0676ba61.pth"]


def test_something_else_in_its_place_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUSYBOT_CACHE", str(tmp_path))
    monkeypatch.setattr(weights, "OFFICIAL", weights.OFFICIAL._replace(bytes=5000))
    monkeypatch.setattr("urllib.request.urlopen", lambda *_, **__: io.BytesIO(b"x" * 5000))
    with pytest.raises(BusybotError, match="another sha256"):
        weights.resnet50_file(None)
    assert not [file for file in tmp_path.rglob("*") if file.is_file()]


def test_without_a_network_it_is_told_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any, **__: Any) -> None:
        raise urllib.error.URLError("no route")

    monkeypatch.setenv("BUSYBOT_CACHE", str(tmp_path))
    monkeypatch.setattr("urllib.request.urlopen", refuse)
    with pytest.raises(BusybotError, match="cannot be downloaded") as caught:
        weights.resnet50_file(None)
    assert str(tmp_path / "weights" / "resnet50-0676ba61.pth") in str(caught.value)
    assert "--encoder embedded" in str(caught.value)


def test_a_place_is_one_pixel_of_the_stage_interpolated_to_224(tmp_path: Path) -> None:
    pictures = [look(seed, 448).rgb for seed in (1, 2)]
    found = drawn().encode_at(pictures, np.array([[0.25, 0.5], [0.999, 0.0], [1.2, 0.3]]))
    assert found.shape == (2, 3, 256) and found.dtype == np.float32
    small = np.stack([cv2.resize(one, (224, 224), interpolation=cv2.INTER_AREA) for one in pictures])
    colours = (torch.from_numpy(small) / 255 - torch.tensor(weights.MEAN)) / torch.tensor(weights.SPREAD)
    with torch.no_grad():
        stage = drawn()._network(colours.permute(0, 3, 1, 2).float())
        whole = torch.nn.functional.interpolate(stage, (224, 224), mode="bilinear").numpy()
    for place, (row, column) in enumerate([(112, 56), (0, 223), (67, 223)]):
        np.testing.assert_allclose(found[:, place], whole[:, :, row, column], rtol=1e-3, atol=1e-3)
    assert drawn().encode_at([], np.zeros((2, 2))).shape == (0, 2, 256)
