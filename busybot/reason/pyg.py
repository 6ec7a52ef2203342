"""What is used of PyTorch Geometric, imported without PyTorch's compiler and without data sets of other people.

PyTorch Geometric imports `torch._dynamo` for one question (is a network compiled?), which takes three times as long as
all the rest of it and is paid by every command and worker; its own data sets, which bring pandas and what serves
language models, take half of the rest. While it is imported here, modules without content stand in their places.
Afterwards the real ones are found as soon as somebody asks for them: PyTorch does that by itself, and for the data sets
`Later` does. Another thread that imports one of both in the meantime gets the empty one.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any

import torch  # noqa: F401 - before anything stands in the place of its parts

COMPILER = "torch._dynamo"
DATA_SETS = "torch_geometric.datasets"


class Later(ModuleType):
    """A module that is imported when something of it is used."""

    def __getattr__(self, name: str) -> Any:
        return getattr(import_module(self.__name__), name)

    def __dir__(self) -> list[str]:
        return dir(import_module(self.__name__))


@contextmanager
def _without(name: str) -> Iterator[None]:
    if name in sys.modules:
        yield
        return
    sys.modules[name] = ModuleType(name)
    try:
        yield
    finally:
        del sys.modules[name]


with _without(COMPILER), _without(DATA_SETS):
    import torch_geometric
    from torch_geometric.data import Batch, Dataset, HeteroData
    from torch_geometric.loader import DataLoader
    from torch_geometric.nn import MessagePassing
    from torch_geometric.typing import OptTensor
    from torch_geometric.utils import scatter, softmax

if "datasets" not in vars(torch_geometric):
    torch_geometric.datasets = Later(DATA_SETS)  # importing the real one puts it here

__all__ = ["Batch", "DataLoader", "Dataset", "HeteroData", "MessagePassing", "OptTensor", "scatter", "softmax"]
