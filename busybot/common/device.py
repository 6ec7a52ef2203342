"""Where networks are computed and pictures drawn: `--device auto|cpu|cuda|cuda:N`, which a command says once.

It stands in the environment, so that worker processes inherit it. Workers that may take any GPU (`auto`, `cuda`) are
spread over all of them in turn; several share one. Pictures are drawn there, too, but that `auto` leaves them to the
cores where it can (`sim.vulkan_check.render_device`). GPUs are NVIDIA's, numbered as CUDA does, and are counted by the
driver's own library: neither PyTorch nor SAPIEN need be imported to know.
"""

import ctypes
import os
import re
from functools import cache

from busybot.common.errors import BusybotError, UsageError

CHOICE = "BUSYBOT_DEVICE"
WORKER = "BUSYBOT_WORKER"
"""A worker's number and that of all workers beside it, `0/4`; absent in processes that are none."""
AUTO = "auto"
DRIVERS = ("libcuda.so.1", "nvcuda.dll")


@cache
def gpus() -> int:
    """How many GPUs this process may use (`CUDA_VISIBLE_DEVICES` hides some)."""
    count = ctypes.c_int()
    for name in DRIVERS:
        try:
            driver = ctypes.CDLL(name)
        except OSError:
            continue
        if driver.cuInit(0) == 0 and driver.cuDeviceGetCount(ctypes.byref(count)) == 0:
            return count.value
    return 0


def choose(name: str) -> None:
    """Take this device in this process and in those that it starts.

    Raises:
        BusybotError: it is not there, or no device's name.
    """
    check(name)
    if name != os.environ.get(CHOICE, AUTO):
        os.environ[CHOICE] = name


def chosen() -> str:
    """The device by its name, `auto` unless somebody chose; raises as `choose`."""
    name = os.environ.get(CHOICE) or AUTO
    check(name)
    return name


def check(name: str) -> None:
    """Raise as `choose` does."""
    if not re.fullmatch(r"auto|cpu|cuda|cuda:\d{1,3}", name):
        raise UsageError(f"there is no device {name!r}", "choose auto, cpu, cuda or cuda:N, the first being cuda:0")
    if name.startswith("cuda") and int(name.partition(":")[2] or 0) >= (count := gpus()):
        found = f"the GPUs here are cuda:0 to cuda:{count - 1}" if count else "no NVIDIA GPU is found"
        raise BusybotError(
            f"there is no device {name}: {found}", "busybot doctor shows what is there, or --device auto"
        )


def gpu() -> int | None:
    """The number of the GPU that this process uses, None for the CPU; raises as `choose`."""
    name, count = chosen(), gpus()
    if name == "cpu" or not count:
        return None
    _, named, number = name.partition(":")
    return int(number) if named else place()[0] % count


def place() -> tuple[int, int]:
    """This worker's number and how many work beside it, itself included: (0, 1) in a process that is no worker."""
    number, _, workers = os.environ.get(WORKER, "0/1").partition("/")
    return int(number), int(workers)


def sharers() -> int:
    """How many workers share a GPU at most."""
    return -(-place()[1] // (1 if ":" in chosen() else max(1, gpus())))
