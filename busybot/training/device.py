"""Where networks run: on a GPU if there is one."""

import os

import torch


def device() -> torch.device:
    """The first GPU, else the CPU."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def repeat_exactly() -> None:
    """Ask PyTorch for algorithms whose results do not change from run to run on a GPU; on a CPU nothing is needed.

    Where an operation has none, PyTorch warns and goes on.
    """
    if torch.cuda.is_available():
        os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # cuBLAS reads it when it is first used
        torch.backends.cudnn.benchmark = False
        torch.use_deterministic_algorithms(True, warn_only=True)
