"""What all networks that pass messages have in common: sums repeat, names of weights stay, no file is written."""

import hashlib
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn

from busybot.reason.models.event.config import EventNetConfig
from busybot.reason.models.event.networks import EventNet
from busybot.reason.models.message_passing import GraphModule
from busybot.reason.models.paper.config import PaperNetworkConfig
from busybot.reason.models.paper.networks import PaperHistoryNetwork, PaperNetwork
from tests.reason.paper_scenes import SMALL


class Sum(GraphModule):
    """The sum of what the neighbours have."""

    def forward(self, edge_index: Tensor, x: Tensor) -> Tensor:
        return self.propagate(edge_index, x=x)


@pytest.fixture
def threads() -> Iterator[None]:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def test_messages_lead_from_the_first_row_to_the_second_and_are_summed() -> None:
    x = torch.arange(24.0).view(4, 3, 2)
    edge_index = torch.tensor([[3, 0, 1, 3], [1, 1, 2, 0]])
    expected = torch.stack([x[3], x[3] + x[0], x[1], torch.zeros(3, 2)])
    assert torch.equal(Sum()(edge_index, x), expected)
    assert torch.equal(Sum()(torch.empty(2, 0, dtype=torch.int64), x), torch.zeros_like(x))


@pytest.mark.parametrize("sort", [True, False])
def test_sums_are_equal_bit_by_bit_in_every_run(threads: None, sort: bool) -> None:
    generator = torch.Generator().manual_seed(0)
    edge_index = torch.randint(500, (2, 40_000), generator=generator)
    if sort:
        edge_index = edge_index[:, edge_index[1].argsort(stable=True)]
    x = torch.randn(500, 3, 16, generator=generator, requires_grad=True)
    results = []
    for count in (1, 1, 2, 2):
        torch.set_num_threads(count)
        x.grad = None
        out = Sum()(edge_index, x)
        out.square().sum().backward()
        assert x.grad is not None
        results.append((out.detach(), x.grad.clone()))
    for repeated, first in ((1, 0), (3, 2)):
        assert all(torch.equal(a, b) for a, b in zip(results[repeated], results[first], strict=True))


def test_no_source_is_generated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    PaperNetwork(SMALL)
    EventNet(EventNetConfig())
    Sum()(torch.zeros(2, 1, dtype=torch.int64), torch.ones(1, 1))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("network", "count", "digest"),
    [
        (lambda: EventNet(EventNetConfig()), 30, "caa9dc81c1b8cd3b"),
        (lambda: PaperNetwork(PaperNetworkConfig()), 348, "e608a0343168e024"),
        (lambda: PaperHistoryNetwork(PaperNetworkConfig()), 171, "0772006e89e20b6c"),
    ],
    ids=["event", "paper", "paper without inference"],
)
def test_names_shapes_and_order_of_weights_are_those_of_models_that_people_have(
    network: Callable[[], nn.Module], count: int, digest: str
) -> None:
    """Models are loaded by name; the optimizer of a stopped training goes by the order."""
    with torch.device("meta"):
        lines = [f"{name} {tuple(tensor.shape)}" for name, tensor in network().state_dict().items()]
    assert len(lines) == count
    assert hashlib.sha256("\n".join(lines).encode()).hexdigest().startswith(digest)
