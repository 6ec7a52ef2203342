"""Chooses the device of networks: a GPU if there is one, and the number of threads on a CPU."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import torch

from busybot.common.process_pool import machine


def device() -> torch.device:
    """The first GPU, else the CPU."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


@cache
def multiplies_bfloat16() -> bool:
    """Does the device multiply bfloat16 itself? Elsewhere it is imitated, at thrice the cost of float32 or more."""
    if device().type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    return bool(machine()["bfloat16"])


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Let PyTorch use so many threads in a block or a decorated function, and as many as before after it."""
    before = torch.get_num_threads()
    if before == count:
        yield
        return
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def repeat_exactly() -> None:
    """Ask PyTorch for algorithms whose results do not change from run to run on a GPU; on a CPU nothing is needed.

    Where an operation has none, PyTorch warns and goes on.
    """
    if torch.cuda.is_available():
        os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # cuBLAS reads it when it is first used
        torch.backends.cudnn.benchmark = False
        torch.use_deterministic_algorithms(True, warn_only=True)
