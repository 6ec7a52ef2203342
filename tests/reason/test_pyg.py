"""PyTorch Geometric comes without PyTorch's compiler and its own data sets; nobody who wants them notices."""

import subprocess
import sys

import pytest

IMPORTED = """
import sys
import torch
from busybot.reason.pyg import MessagePassing
assert not [name for name in sys.modules if name.startswith("torch._dynamo")], "that alone takes seconds"
assert not [name for name in sys.modules if name.startswith(("torch_geometric.datasets", "pandas"))], "so does that"
"""
DATA_SETS = """
import torch_geometric
assert torch_geometric.datasets.FakeDataset().num_classes == 10
from torch_geometric.datasets import FakeDataset
assert torch_geometric.datasets is sys.modules["torch_geometric.datasets"]
"""
FIRST = "import torch_geometric; theirs = torch_geometric.datasets"
NOTHING_CHANGES = "assert torch_geometric.datasets is theirs is sys.modules['torch_geometric.datasets']"
COMPILER = """
import torch_geometric
assert torch_geometric.is_torch_instance(torch.compile(torch.nn.Linear(1, 1)), torch.nn.Linear)
assert sys.modules["torch._dynamo"].OptimizedModule is torch._dynamo.OptimizedModule
assert torch.compile(torch.nn.ReLU(), backend="eager")(torch.tensor([-1.0, 2.0])).tolist() == [0, 2]
"""


@pytest.mark.parametrize(
    "code",
    [
        IMPORTED,
        IMPORTED + DATA_SETS,
        f"{FIRST}\nimport sys\nimport busybot.reason.pyg\n{NOTHING_CHANGES}",
        pytest.param(IMPORTED + COMPILER, marks=pytest.mark.long),
    ],
    ids=["imported", "data-sets", "after-all-of-it", "compiler"],
)
def test_what_takes_long_is_there_for_those_who_ask_and_for_nobody_else(code: str) -> None:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
