"""Where networks are computed, with which numbers, how much at once, and with how many threads on a CPU."""

import ctypes
import os
import platform
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cache
from pathlib import Path
from typing import Any

import torch

from busybot.common.device import AUTO, chosen, gpu, sharers
from busybot.common.errors import BusybotError
from busybot.common.process_pool import machine

SHARE = 0.5
"""Of a GPU's free memory, what batches may take: memory is not handed out without gaps."""
M_TRIM_THRESHOLD, M_MMAP_MAX = -1, -4
"""Of glibc's `mallopt`: when memory goes back to the system, and how many blocks are mapped each by itself."""


def device() -> torch.device:
    """The GPU of this process, or the CPU, as `common.device` decides.

    Raises:
        BusybotError: a GPU was asked for that is not there, or that this PyTorch cannot use.
    """
    number = gpu()
    if number is None:
        return torch.device("cpu")
    if torch.cuda.is_available():
        return torch.device("cuda", number)
    if chosen() == AUTO:
        return torch.device("cpu")
    raise BusybotError(f"PyTorch {torch.__version__} cannot use {chosen()}", "make setup, or --device cpu")


def multiplies_bfloat16() -> bool:
    """Does the device multiply bfloat16 itself, faster than float32? Where it is imitated it costs thrice as much."""
    return _multiplies_bfloat16(device())


def rounds(asked: bool | None) -> bool:
    """Whether to multiply in bfloat16: as it was asked for, or else where the device does so itself."""
    return multiplies_bfloat16() if asked is None else asked


@cache
def _multiplies_bfloat16(on: torch.device) -> bool:
    if on.type == "cuda":
        with torch.cuda.device(on):
            return torch.cuda.is_bf16_supported(including_emulation=False)
    return bool(machine()["bfloat16"])


def mixed(on: torch.device) -> AbstractContextManager[Any]:
    """Around a network's pass: on a GPU that multiplies bfloat16 it does so; on a CPU nothing changes."""
    on_gpu = on.type == "cuda" and multiplies_bfloat16()
    return torch.autocast(on.type, torch.bfloat16) if on_gpu else nullcontext()


def exactly() -> AbstractContextManager[Any]:
    """Around convolutions that are to have all digits of float32, and the same ones again, on a GPU, too."""
    return torch.backends.cudnn.flags(enabled=True, deterministic=True, allow_tf32=False)


def slices(count: int, usual: int, on: torch.device) -> Iterator[slice]:
    """The parts in which to compute so many rows.

    On a CPU each has the usual number. On a GPU only the first has: what it takes tells how many of the others fit into
    the memory that is free, divided among the workers that share the GPU.
    """
    if on.type != "cuda":
        yield from (slice(first, min(first + usual, count)) for first in range(0, count, usual))
        return
    if not count:
        return
    torch.cuda.reset_peak_memory_stats(on)
    before, first = torch.cuda.memory_allocated(on), min(usual, count)
    yield slice(0, first)
    if first < count:
        each = max(1, torch.cuda.max_memory_allocated(on) - before) / first
        free = torch.cuda.mem_get_info(on)[0] + torch.cuda.memory_reserved(on) - torch.cuda.memory_allocated(on)
        many = max(usual, int(SHARE * free / sharers() / each))
        yield from (slice(start, min(start + many, count)) for start in range(first, count, many))


@cache
def keep_memory(needed: int = 0) -> None:
    """Let the C library keep what tensors leave for the next ones, until the process ends; on a CPU, with glibc.

    By default it gives large blocks back to the system at once, which clears every page again when it is touched:
    for networks over whole pictures that costs as much as their convolutions. In return up to twice as much memory is
    held, for what is left between the blocks.

    Args:
        needed: bytes of memory; where there are less all is as ever.
    """
    if device().type == "cpu" and platform.libc_ver()[0] == "glibc" and memory_limit() >= needed:
        c_library = ctypes.CDLL(None)
        c_library.mallopt(M_MMAP_MAX, 0)
        c_library.mallopt(M_TRIM_THRESHOLD, -1)


def memory_limit() -> int:
    """Bytes that this process may have: of the machine, or of the container that it runs in."""
    limits = [Path("/sys/fs/cgroup", name) for name in ("memory.max", "memory/memory.limit_in_bytes")]
    told = [file.read_text().strip() for file in limits if file.is_file()]
    whole = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return min([whole, *(int(limit) for limit in told if limit.isdigit())])


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
    if device().type == "cuda":
        os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # cuBLAS reads it when it is first used
        torch.backends.cudnn.benchmark = False
        torch.use_deterministic_algorithms(True, warn_only=True)
