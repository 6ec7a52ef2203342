"""Weights before the first iteration, and what else PyTorch draws."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import torch
from torch import nn


def initialise(network: nn.Module, generator: torch.Generator, biases: bool = False) -> None:
    """Draw all weights from the generator, uniform with variance 1 / (3 fan_in) as torch does; biases become zero.

    Args:
        biases: draw them, too, from the same distribution, as torch does.
    """
    for module in network.modules():
        if isinstance(module, nn.Conv2d | nn.Linear):
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
def drawing_nothing() -> Iterator[None]:
    """What PyTorch draws within is as if it had not been drawn: for networks that get other weights anyway."""
    with torch.random.fork_rng():
        yield


@contextmanager
def drawing(rng: np.random.Generator) -> Iterator[None]:
    """PyTorch's random numbers within come from this generator; those outside are as if nothing had been drawn."""
    with torch.random.fork_rng():
        torch.manual_seed(int(rng.integers(2**63)))
        yield
