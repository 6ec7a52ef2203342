"""Where networks are computed and how much at once. No GPU is needed: what PyTorch tells of one is made up here."""

from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from busybot.common import device as selection
from busybot.common.errors import BusybotError
from busybot.reason.inputs.board_dataset import BoardDataset, batches_of
from busybot.reason.inputs.sequence import CHANNELS, BoardSequence
from busybot.reason.models.event.config import EventConfig
from busybot.reason.models.event.data import board_graph, contacts_of, context_of, split
from busybot.reason.models.event.learner import divergence
from busybot.reason.models.event.networks import EventNet
from busybot.reason.models.paper.config import PaperReasonConfig
from busybot.reason.models.paper.data import boards_of
from busybot.reason.models.paper.learner import divergence_from, make_network
from busybot.training import device as networks
from busybot.training.device import device, mixed, multiplies_bfloat16, slices

GPU = torch.device("cuda", 0)
ELSEWHERE = torch.device("meta")
"""A device without numbers: what computes on it mixes nothing with tensors that lie on the CPU, or it is refused."""


def gpus(monkeypatch: pytest.MonkeyPatch, count: int, cuda: bool = True) -> None:
    monkeypatch.setattr(selection, "gpus", lambda: count)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: cuda)
    monkeypatch.delenv(selection.CHOICE, raising=False)


def test_networks_are_where_the_choice_says(monkeypatch: pytest.MonkeyPatch) -> None:
    gpus(monkeypatch, 0)
    assert device() == torch.device("cpu")
    gpus(monkeypatch, 2)
    assert device() == torch.device("cuda", 0)
    monkeypatch.setenv(selection.WORKER, "3/4")
    assert device() == torch.device("cuda", 1)
    monkeypatch.setenv(selection.CHOICE, "cpu")
    assert device() == torch.device("cpu")


def test_a_pytorch_without_cuda(monkeypatch: pytest.MonkeyPatch) -> None:
    gpus(monkeypatch, 1, cuda=False)
    assert device() == torch.device("cpu"), "auto takes what works"
    monkeypatch.setenv(selection.CHOICE, "cuda")
    with pytest.raises(BusybotError, match=r"PyTorch .* cannot use cuda"):
        device()


def test_numbers_are_mixed_on_a_gpu_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(networks, "multiplies_bfloat16", lambda: True)
    with mixed(torch.device("cpu")):
        assert not torch.is_autocast_enabled("cpu")
        assert (torch.ones(2, 2) @ torch.ones(2, 2)).dtype == torch.float32
    with pytest.warns(UserWarning, match="CUDA is not available"):
        made = mixed(GPU)
    assert isinstance(made, torch.autocast) and made.device == "cuda" and made.fast_dtype == torch.bfloat16
    monkeypatch.setattr(networks, "multiplies_bfloat16", lambda: False)
    assert not isinstance(mixed(GPU), torch.autocast)


def test_a_processor_tells_whether_it_multiplies_bfloat16(monkeypatch: pytest.MonkeyPatch) -> None:
    gpus(monkeypatch, 0)
    networks._multiplies_bfloat16.cache_clear()
    for able in (True, False, None):
        monkeypatch.setattr(networks, "machine", lambda able=able: {"bfloat16": able})
        assert multiplies_bfloat16() is bool(able)
        networks._multiplies_bfloat16.cache_clear()


def test_a_cpu_computes_the_usual_number_at_once() -> None:
    assert [(part.start, part.stop) for part in slices(70, 32, torch.device("cpu"))] == [(0, 32), (32, 64), (64, 70)]
    assert list(slices(0, 32, torch.device("cpu"))) == []


@pytest.fixture
def memory(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, int]]:
    """Bytes: what the first part took, what is free on the card, what PyTorch keeps and uses."""
    told = {"peak": 0, "free": 0, "reserved": 0, "allocated": 0}
    monkeypatch.setattr(torch.cuda, "reset_peak_memory_stats", lambda on: None)
    monkeypatch.setattr(torch.cuda, "max_memory_allocated", lambda on: told["peak"])
    monkeypatch.setattr(torch.cuda, "memory_allocated", lambda on: told["allocated"])
    monkeypatch.setattr(torch.cuda, "memory_reserved", lambda on: told["reserved"])
    monkeypatch.setattr(torch.cuda, "mem_get_info", lambda on: (told["free"], 0))
    yield told


@pytest.mark.parametrize(
    ("free", "sharing", "expected"),
    [(8000, 1, [10, 40, 40, 10]), (8000, 2, [10, 20, 20, 20, 20, 10]), (100, 1, [10] * 10), (10**9, 1, [10, 90])],
)
def test_a_gpu_computes_as_many_as_fit(
    monkeypatch: pytest.MonkeyPatch, memory: dict[str, int], free: int, sharing: int, expected: list[int]
) -> None:
    monkeypatch.setattr(networks, "sharers", lambda: sharing)
    memory |= {"allocated": 500, "reserved": 700, "free": free - 200}
    parts = []
    for part in slices(100, 10, GPU):
        memory["peak"] = 500 + 1000  # 100 bytes each: half of what is free holds 40 of them
        parts.append(part)
    assert [part.stop - part.start for part in parts] == expected
    assert [index for part in parts for index in range(100)[part]] == list(range(100))
    assert [(part.start, part.stop) for part in slices(7, 10, GPU)] == [(0, 7)]
    assert list(slices(0, 10, GPU)) == []


def boards() -> list[BoardSequence]:
    rng, made = np.random.default_rng(0), []
    for objects in (5, 7):
        is_trigger = np.arange(objects) < 2
        features = rng.random((26, objects, CHANNELS), np.float32) * ~is_trigger[None, :, None]
        positions, actions = rng.random((objects, 3), np.float32), rng.random((25, 6), np.float32)
        made.append(BoardSequence(features, positions, actions, rng.integers(2, size=25), is_trigger, ~is_trigger))
    return made


def test_the_papers_graph_networks_stay_on_their_device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("torch.fx.experimental._config.meta_nonzero_assume_all_nonzero", True)
    config = PaperReasonConfig()
    seen, network = boards_of(boards(), config.network).to(ELSEWHERE), make_network(config, 0).to(ELSEWHERE)
    predicted, relations = network(seen, 23, None)
    assert relations is not None
    assert predicted.device == divergence_from(relations, config.prior).device == ELSEWHERE


def test_the_event_network_stays_on_its_device() -> None:
    config = EventConfig()
    graphs = BoardDataset([board_graph(board) for board in boards()])
    network = EventNet(config.net).to(ELSEWHERE)
    everything = context_of(next(batches_of(graphs, [[0, 1]])).to(ELSEWHERE), network.scale)
    seen, asked, _ = split(everything, 20, 4)
    assert contacts_of(seen, asked.actions, asked.acted).facts.device == ELSEWHERE
    for exclusive in (True, False):
        network.exclusive = exclusive
        edges, none = network.log_edges(seen)
        assert divergence(edges, none, seen.edge_index[1], 0.1, exclusive).device == ELSEWHERE
    network.inference = False
    assert network.log_edges(seen)[0].device == ELSEWHERE


@pytest.mark.parametrize(
    ("library", "bytes_there", "count", "kept"),
    [
        ("glibc", 23 << 30, 0, True),
        ("glibc", 16 << 30, 0, False),
        ("", 23 << 30, 0, False),
        ("glibc", 23 << 30, 1, False),
    ],
)
def test_memory_is_kept_on_a_cpu_with_much_of_it(
    monkeypatch: pytest.MonkeyPatch, library: str, bytes_there: int, count: int, kept: bool
) -> None:
    asked: list[tuple[int, int]] = []
    glibc = SimpleNamespace(mallopt=lambda *words: asked.append(words))
    gpus(monkeypatch, count)
    monkeypatch.setattr(networks.platform, "libc_ver", lambda: (library, "2.36"))
    monkeypatch.setattr(networks, "memory_limit", lambda: bytes_there)
    monkeypatch.setattr(networks.ctypes, "CDLL", lambda name: glibc)
    networks.keep_memory.cache_clear()
    networks.keep_memory(22 << 30)
    networks.keep_memory.cache_clear()
    assert asked == [(networks.M_MMAP_MAX, 0), (networks.M_TRIM_THRESHOLD, -1)] * kept
