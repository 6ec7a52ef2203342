"""The state of a training in one file: safetensors, tensors by name and a header of text. Nothing is unpickled.

Weights, AdamW's moments, replay priorities and the iteration: together with the seed they determine all that follows,
because every iteration draws from a generator of its own. What PyTorch draws (`drawing`), the weights before the first
iteration among it (`initialise`), comes from such a generator, too.
"""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn

from busybot.common.atomic_io import open_regular, write_atomically
from busybot.common.errors import BusybotError
from busybot.common.limits import MAX_WEIGHTS_BYTES
from busybot.training.device import device
from busybot.training.model_cards import WEIGHTS_FILE, ModelCard, write_info

Network = TypeVar("Network", bound=nn.Module)
NETWORK, OPTIMIZER = "network.", "optimizer."
PRECISIONS = (torch.float16, torch.bfloat16, torch.float32, torch.float64)
"""What weights that are no integers may be: of some narrower types PyTorch cannot tell whether they are finite."""


@dataclass
class Checkpoint:
    """Tensors and what is not a tensor (JSON values)."""

    tensors: dict[str, Tensor]
    values: dict[str, Any]


def save_tensors(path: Path, tensors: dict[str, Tensor], values: dict[str, Any] | None = None) -> None:
    """Write the file atomically; equal contents are equal files. Its folder may not be a link."""
    header = {"values": json.dumps(values, sort_keys=True)} if values is not None else None
    plain = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    write_atomically(path, save(plain, header), path.parent.parent)


def load_tensors(path: Path) -> Checkpoint:
    """Read what `save_tensors` wrote.

    Raises:
        BusybotError: the file is absent or damaged.
    """
    open_regular(path, MAX_WEIGHTS_BYTES).close()
    try:
        with safe_open(path, "pt") as file:
            header = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.offset_keys()}
        return Checkpoint(tensors, json.loads(header.get("values", "{}")))
    except (SafetensorError, OSError, ValueError, RecursionError) as error:
        raise BusybotError(f"{path}: damaged: {error}", "remove it, or copy it again") from None


def save_model(folder: Path, info: ModelCard, tensors: dict[str, Tensor]) -> None:
    """Write the folder of a model with one network, `model.json` last."""
    save_tensors(folder / WEIGHTS_FILE, tensors)
    write_info(folder, info, [folder / WEIGHTS_FILE])


def network_tensors(tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """The network's own tensors of a checkpoint."""
    return {name.removeprefix(NETWORK): value for name, value in tensors.items() if name.startswith(NETWORK)}


def network_with(make: Callable[[], Network], tensors: dict[str, Tensor], where: Path) -> Network:
    """The network that `make` makes, with these weights.

    What a stranger's card says of sizes is compared with the weights before anything is allocated. Networks are made
    without numbers for that: where they compute with some as they are made, those lie on the CPU, or PyTorch loads its
    compiler for it, two seconds in every process.

    Raises:
        BusybotError: naming `where`: the weights are those of another network, or no finite numbers.
    """
    with torch.random.fork_rng([]):  # they are made on the CPU, and by default every GPU would be started
        with torch.device("meta"):
            expected = {name: tuple(value.shape) for name, value in make().state_dict().items()}
        found = {name: tuple(value.shape) for name, value in tensors.items()}
        for name in sorted(expected.keys() | found.keys()):
            if expected.get(name) != found.get(name):
                what = f"{name} is {found.get(name, 'absent')}, expected {expected.get(name, 'nothing')}"
                raise BusybotError(f"{where}: not the weights of this network: {what}", "copy the model again")
        network = make()
    load_weights(network, tensors, where)
    return network


def load_weights(network: nn.Module, tensors: dict[str, Tensor], where: Path) -> None:
    """Give a network its weights; refuses those of another network, and what is no finite number."""
    for name, tensor in tensors.items():
        if (tensor.is_floating_point() or tensor.is_complex()) and tensor.dtype not in PRECISIONS:
            kind = str(tensor.dtype).removeprefix("torch.")
            raise BusybotError(f"{where}: {name} holds {kind}, which no weights are", "copy the model again")
        if tensor.is_floating_point() and not torch.isfinite(tensor).all():
            raise BusybotError(
                f"{where}: {name} holds NaN or infinite values", "copy the model again, or train it again"
            )
    try:
        network.load_state_dict(tensors)
    except RuntimeError as error:
        what = str(error).splitlines()[-1].strip()
        raise BusybotError(f"{where}: not the weights of this network: {what}", "copy the model again") from None


def training_tensors(network: nn.Module, optimizer: torch.optim.Optimizer) -> dict[str, Tensor]:
    """All that a network and its optimizer have learnt; the optimizer's states have a parameter's number and a name."""
    state = optimizer.state_dict()["state"]
    learnt = {f"{OPTIMIZER}{number}.{name}": value for number, entry in state.items() for name, value in entry.items()}
    return {NETWORK + name: value for name, value in network.state_dict().items()} | learnt


def restore_training(path: Path, network: nn.Module, optimizer: torch.optim.Optimizer) -> Checkpoint:
    """Put back what `training_tensors` returned from a file; returns all that the file holds.

    Raises:
        BusybotError: the file is damaged, or of another network.
    """
    saved = load_tensors(path)
    load_weights(network, network_tensors(saved.tensors), path)
    parameters = [one for group in optimizer.param_groups for one in group["params"]]
    shapes = {str(number): tuple(one.shape) for number, one in enumerate(parameters)}
    state: dict[int, dict[str, Tensor]] = {}
    for key, value in saved.tensors.items():
        if key.startswith(OPTIMIZER):
            number, _, name = key.removeprefix(OPTIMIZER).partition(".")
            if number not in shapes or (value.dim() and value.shape != shapes[number]):
                what = f"{path}: {key} is {tuple(value.shape)}, and its parameter {shapes.get(number)}"
                raise BusybotError(what, "train in another folder")
            state.setdefault(int(number), {})[name] = value
    optimizer.load_state_dict({"state": state, "param_groups": optimizer.state_dict()["param_groups"]})
    return saved


def initialise(network: nn.Module, generator: torch.Generator, biases: bool = False, normal: bool = False) -> None:
    """Draw all weights from the generator, uniform with variance 1 / (3 fan_in) as torch does; biases become zero.

    Normalisations stay as they are made, at 1 and 0.

    Args:
        biases: draw them, too, from the same distribution, as torch does.
        normal: draw the weights of convolutions from Kaiming's normal distribution, of variance 2 / fan_in, and those
            of linear layers from Xavier's, of variance 2 / (fan_in + fan_out).
    """
    for module in network.modules():
        if isinstance(module, nn.Conv2d | nn.Linear):
            if normal and isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, nonlinearity="relu", generator=generator)
            elif normal:
                nn.init.xavier_normal_(module.weight, generator=generator)
            else:
                nn.init.kaiming_uniform_(module.weight, a=5**0.5, generator=generator)
            if module.bias is not None and biases:
                limit = module.weight[0].numel() ** -0.5
                nn.init.uniform_(module.bias, -limit, limit, generator=generator)
            elif module.bias is not None:
                nn.init.zeros_(module.bias)


def parameters_of(network: nn.Module) -> int:
    """Number of trained values."""
    return sum(parameter.numel() for parameter in network.parameters())


@contextmanager
def drawing(rng: np.random.Generator) -> Iterator[None]:
    """PyTorch's random numbers within, on the CPU and the device of this process, come from this generator; those
    outside are as if nothing had been drawn."""
    on = device()
    with torch.random.fork_rng([on] if on.type == "cuda" else []):
        torch.manual_seed(int(rng.integers(2**63)))
        yield
