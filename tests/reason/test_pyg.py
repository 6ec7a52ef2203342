"""PyTorch Geometric comes without PyTorch's compiler, and nobody who wants the compiler notices."""

import subprocess
import sys

import pytest

IMPORTED = """
import sys
import torch
from busybot.reason.pyg import MessagePassing
assert not [name for name in sys.modules if name.startswith("torch._dynamo")], "that alone takes seconds"
"""
USED = """
import torch_geometric
assert torch_geometric.is_torch_instance(torch.compile(torch.nn.Linear(1, 1)), torch.nn.Linear)
assert sys.modules["torch._dynamo"].OptimizedModule is torch._dynamo.OptimizedModule
assert torch.compile(torch.nn.ReLU(), backend="eager")(torch.tensor([-1.0, 2.0])).tolist() == [0, 2]
"""


@pytest.mark.parametrize("then", ["", pytest.param(USED, marks=pytest.mark.long)], ids=["imported", "used"])
def test_the_compiler_is_there_for_those_who_ask_and_for_nobody_else(then: str) -> None:
    done = subprocess.run([sys.executable, "-c", IMPORTED + then], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
