"""Files of tensors that come from strangers, or are damaged."""

from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save
from torch import nn

from busybot.common.errors import BusybotError
from busybot.training import checkpoint
from busybot.training.checkpoint import drawing, load_tensors, load_weights, network_with, save_tensors

NARROW = ("float8_e4m3fn", "float8_e5m2", "float8_e4m3fnuz", "float8_e8m0fnu", "complex64")


def network() -> nn.Linear:
    return nn.Linear(2, 1, bias=False)


@pytest.mark.parametrize("kind", NARROW)
def test_weights_of_other_kinds_of_numbers_are_refused_by_their_file(kind: str, tmp_path: Path) -> None:
    file = tmp_path / "m" / "weights.safetensors"
    save_tensors(file, {"weight": torch.ones(1, 2).to(getattr(torch, kind))})
    with pytest.raises(BusybotError, match=rf"weights\.safetensors: weight holds {kind}, which no weights are"):
        network_with(network, load_tensors(file).tensors, file)


@pytest.mark.parametrize("kind", [torch.float16, torch.bfloat16, torch.float64])
def test_weights_may_be_rounded(kind: torch.dtype) -> None:
    made = network()
    load_weights(made, {"weight": torch.tensor([[0.5, -2.0]], dtype=kind)}, Path("weights"))
    assert made.weight.tolist() == [[0.5, -2.0]] and made.weight.dtype == torch.float32


def test_values_that_are_nested_without_end_are_damage(tmp_path: Path) -> None:
    file = tmp_path / "weights.safetensors"
    file.write_bytes(save({"weight": torch.ones(1, 2)}, {"values": "[" * 100_000}))
    with pytest.raises(BusybotError, match=r"weights\.safetensors: damaged"):
        load_tensors(file)


def test_only_the_gpu_that_is_used_is_started(monkeypatch: pytest.MonkeyPatch) -> None:
    """What PyTorch tells of two GPUs is made up."""
    used = list[object]()
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    monkeypatch.setattr(torch.cuda, "get_rng_state", used.append)
    monkeypatch.setattr(torch.cuda, "set_rng_state", lambda state, device: None)
    network_with(network, {"weight": torch.ones(1, 2)}, Path("weights"))
    for one, gpus in (("cpu", []), ("cuda:1", [torch.device("cuda", 1)])):
        monkeypatch.setattr(checkpoint, "device", lambda one=one: torch.device(one))
        with drawing(np.random.default_rng(0)):
            drawn = torch.rand(1)
        with drawing(np.random.default_rng(0)):
            assert torch.equal(torch.rand(1), drawn)
        assert used == 2 * gpus
