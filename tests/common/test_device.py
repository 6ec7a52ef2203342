"""Which device a process takes: by name, by what is there, and in turn among workers."""

import ctypes
import os
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from busybot.common import device
from busybot.common.device import CHOICE, WORKER, choose, chosen, gpu, gpus, place, sharers
from busybot.common.errors import BusybotError
from busybot.common.process_pool import run_tasks

SetUp = Callable[..., None]


@pytest.fixture
def there(monkeypatch: pytest.MonkeyPatch) -> SetUp:
    """So many GPUs, a chosen name, and a worker's place."""

    def set_up(count: int, name: str | None = None, worker: str | None = None) -> None:
        monkeypatch.setattr(device, "gpus", lambda: count)
        for variable, value in ((CHOICE, name), (WORKER, worker)):
            if value is None:
                monkeypatch.delenv(variable, raising=False)
            else:
                monkeypatch.setenv(variable, value)

    return set_up


def test_a_gpu_is_taken_where_there_is_one(there: SetUp) -> None:
    for count, name, expected in ((0, None, None), (0, "cpu", None), (1, None, 0), (2, "cpu", None), (3, "cuda:2", 2)):
        there(count, name)
        assert gpu() == expected, (count, name)


def test_workers_take_gpus_in_turn_unless_one_is_named(there: SetUp) -> None:
    for name, expected in (
        (None, [0, 1, 0, 1, 0]),
        ("cuda", [0, 1, 0, 1, 0]),
        ("cuda:1", [1] * 5),
        ("cpu", [None] * 5),
    ):
        found = []
        for number in range(5):
            there(2, name, f"{number}/5")
            found.append(gpu())
        assert found == expected, name


def test_how_many_share_a_gpu(there: SetUp) -> None:
    for count, name, worker, expected in ((2, None, "0/5", 3), (2, "cuda:1", "0/5", 5), (1, None, None, 1)):
        there(count, name, worker)
        assert sharers() == expected
    assert place() == (0, 1), "a process that is no worker is alone"


@pytest.mark.parametrize(
    ("name", "count", "words"),
    [
        ("cuda", 0, "no NVIDIA GPU is found"),
        ("cuda:2", 2, "the GPUs here are cuda:0 to cuda:1"),
        ("gpu", 2, "there is no device 'gpu'"),
        ("cuda:", 2, "there is no device 'cuda:'"),
        ("cuda:-1", 2, "there is no device"),
    ],
)
def test_what_is_not_there_is_refused(there: SetUp, name: str, count: int, words: str) -> None:
    there(count)
    with pytest.raises(BusybotError, match=words):
        choose(name)
    assert chosen() == "auto", "nothing was taken"
    there(count, name)
    with pytest.raises(BusybotError, match=words):
        gpu()


def test_a_choice_stands_in_the_environment(there: SetUp) -> None:
    there(2, "cpu")
    choose("cuda:1")
    assert os.environ[CHOICE] == chosen() == "cuda:1"
    choose("auto")
    assert chosen() == "auto", "an option has precedence over the environment"


class Driver:
    """As `libcuda.so.1` answers.

    Args:
        error: of its initialisation, 0 for none.
    """

    def __init__(self, count: int, error: int = 0):
        self._count, self._error = count, error

    def cuInit(self, flags: int) -> int:  # noqa: N802  # the driver's name
        assert flags == 0
        return self._error

    def cuDeviceGetCount(self, answer: Any) -> int:  # noqa: N802
        answer._obj.value = self._count
        return 0


@pytest.fixture
def counted_anew() -> Iterator[None]:
    gpus.cache_clear()
    yield
    gpus.cache_clear()


@pytest.mark.usefixtures("counted_anew")
@pytest.mark.parametrize(("driver", "expected"), [(Driver(3), 3), (Driver(3, error=100), 0), (None, 0)])
def test_gpus_are_counted_by_the_driver(monkeypatch: pytest.MonkeyPatch, driver: Driver | None, expected: int) -> None:
    def load(name: str) -> Driver:
        if driver is None or name != "libcuda.so.1":
            raise OSError(f"{name}: cannot open shared object file")
        return driver

    monkeypatch.setattr(ctypes, "CDLL", load)
    assert gpus() == expected


def make_telling(_: str) -> Callable[[int], tuple[str, str]]:
    return lambda task: (os.environ[WORKER], chosen())


def test_workers_have_places_and_inherit_the_choice(there: SetUp) -> None:
    there(0, "cpu")
    told = [answer for _, answer in run_tasks(range(12), make_telling, ("",), 3, recycle=2)]
    assert {place for place, _ in told} <= {"0/3", "1/3", "2/3"}
    assert len({place for place, _ in told}) > 1
    assert {name for _, name in told} == {"cpu"}
