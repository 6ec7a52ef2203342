"""The cluster engine: the same datasets as the local one, faults told, the dead replaced, nobody listens outside."""

import contextlib
import ipaddress
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from busybot.common.errors import BusybotError
from busybot.common.process_pool import ONLY_HERE, run_on_ray

os.environ[ONLY_HERE] = "0"  # Ray reads it when it is imported

ray = pytest.importorskip("ray", reason="Ray is not installed: `make extras`")
pytestmark = pytest.mark.long


@pytest.fixture(scope="module", autouse=True)
def no_cluster_of_others() -> Iterator[None]:
    assert "RAY_ADDRESS" not in os.environ, "these tests start a cluster of their own"
    yield


def is_local(address: str) -> bool:
    parsed = ipaddress.ip_address(address)
    inner = getattr(parsed, "ipv4_mapped", None)
    return (inner or parsed).is_loopback


def squares(offset: int) -> Callable[[int], int]:
    return lambda task: task * task + offset


def dying(folder: str) -> Callable[[int], int]:
    def work(task: int) -> int:
        marker = Path(folder) / str(task)
        if task == 1 and not marker.exists():
            marker.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return task

    return work


def faulty() -> Callable[[int], int]:
    def work(task: int) -> int:
        raise BusybotError(f"board {task} is broken", "mend it")

    return work


def test_every_task_is_done_once_and_nobody_listens_outside() -> None:
    results, open_to_all = {}, set()
    for task, result in run_on_ray(range(20), squares, (7,), workers=2, recycle=6):
        results[task] = result
        for process in psutil.Process().children(recursive=True):
            with contextlib.suppress(psutil.NoSuchProcess):
                listening = [one for one in process.net_connections("inet") if one.status == psutil.CONN_LISTEN]
                open_to_all |= {(process.name(), one.laddr) for one in listening if not is_local(one.laddr.ip)}
    assert results == {task: task * task + 7 for task in range(20)}
    assert not open_to_all
    assert not ray.is_initialized(), "it ends with the work"


def test_a_worker_that_dies_is_replaced(tmp_path: Path) -> None:
    assert dict(run_on_ray(range(4), dying, (str(tmp_path),), workers=2)) == {task: task for task in range(4)}


def test_faults_are_told_as_they_are() -> None:
    with pytest.raises(BusybotError, match="is broken") as error:
        list(run_on_ray(range(2), faulty, (), workers=1))
    assert error.value.hint == "mend it"


def test_it_records_what_the_local_engine_records(tmp_path: Path) -> None:
    from tests.cli.commands import busybot
    from tests.cli.test_generate_collect import SMALL

    hashes = []
    for engine in ("local", "ray"):
        folder = str(tmp_path / engine)
        assert busybot("generate", folder, "--boards", "3", "--seed", "2").returncode == 0
        done = busybot("collect", folder, "--engine", engine, *SMALL)
        assert done.returncode == 0, done.stderr
        hashes.append(busybot("dataset", "info", folder, "--json").stdout.split('"content_hash": ')[1][:70])
    assert hashes[0] == hashes[1]
