"""What is used of PyTorch Geometric, imported without PyTorch's compiler.

PyTorch Geometric imports `torch._dynamo` for one question (is a network compiled?), which takes three times as long as
all the rest of it and is paid by every command and worker. While it is imported here, an empty module stands in the
compiler's place; afterwards PyTorch finds the real one by itself when somebody asks for it.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

import torch

COMPILER = "torch._dynamo"


@contextmanager
def _without_compiler() -> Iterator[None]:
    if COMPILER in sys.modules or "_dynamo" in vars(torch):
        yield
        return
    sys.modules[COMPILER] = ModuleType(COMPILER)
    try:
        yield
    finally:
        del sys.modules[COMPILER]


with _without_compiler():
    from torch_geometric.data import Batch, Dataset, HeteroData
    from torch_geometric.loader import DataLoader
    from torch_geometric.nn import MessagePassing
    from torch_geometric.typing import OptTensor
    from torch_geometric.utils import scatter, softmax

__all__ = ["Batch", "DataLoader", "Dataset", "HeteroData", "MessagePassing", "OptTensor", "scatter", "softmax"]
