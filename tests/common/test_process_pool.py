"""Workers: every task is done once, faults are told, the dead and the slow are replaced, and none is left behind."""

import os
import platform
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from busybot.common.errors import BusybotError
from busybot.common.process_pool import RECYCLE, keeping_workers, machine, run_tasks, share


def squares(offset: int) -> Callable[[int], tuple[int, int]]:
    return lambda task: (task * task + offset, os.getpid())


def dying(folder: str) -> Callable[[int], int]:
    def work(task: int) -> int:
        marker = Path(folder) / str(task)
        if task % 3 == 0 and not marker.exists():
            marker.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return task

    return work


def faulty() -> Callable[[int], int]:
    def work(task: int) -> int:
        raise BusybotError(f"board {task} is broken", "mend it")

    return work


def slow() -> Callable[[int], int]:
    def work(task: int) -> int:
        time.sleep(600)
        return task

    return work


def test_without_a_number_of_workers_there_is_one() -> None:
    assert [(task, square) for task, (square, _) in run_tasks(range(2), squares, (1,), workers=0)] == [(0, 1), (1, 2)]


def test_a_script_without_a_guard_is_told_what_it_lacks(tmp_path: Path) -> None:
    """Its workers end when they import it, before they read what they are given, which is more than a pipe holds."""
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent("""
            from busybot.common.process_pool import run_tasks
            from tests.common.test_process_pool import squares
            list(run_tasks(range(3), squares, (1, b"x" * 1_000_000), 2))
        """)
    )
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join(filter(None, sys.path)))
    ended = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=100, env=environment)
    assert ended.returncode == 1 and "BusybotError: task" in ended.stderr
    assert "found no worker that starts" in ended.stderr and 'if __name__ == "__main__":' in ended.stderr


def test_every_task_once_whatever_the_number_of_workers() -> None:
    for workers in (1, 3):
        results = dict(run_tasks(range(20), squares, (1,), workers))
        assert {task: value for task, (value, _) in results.items()} == {task: task * task + 1 for task in range(20)}


def counting_threads(unpickled: object) -> Callable[[int], int]:
    def work(task: int) -> int:
        import torch

        return torch.get_num_threads()

    return work


@pytest.mark.long
def test_networks_use_one_thread_in_a_worker_whether_it_imports_them_early_or_late() -> None:
    import torch  # unpickling one of its types is what imports it early

    before = torch.get_num_threads()
    for unpickled in (None, torch.float32):
        assert dict(run_tasks([0], counting_threads, (unpickled,), 1)) == {0: 1}
    assert torch.get_num_threads() == before


def refuse(number: int) -> int:
    raise BusybotError(f"task {number} is refused")


@pytest.mark.parametrize("workers", [1, 2])
def test_shared_results_come_in_the_order_of_the_tasks(workers: int) -> None:
    assert list(share(abs, [-3, -1, -2, 4], workers)) == [3, 1, 2, 4]
    assert list(share(abs, [], workers)) == []


def test_shared_work_sends_what_is_worked_on_and_keeps_its_workers() -> None:
    results = list(share(process_and_negative, range(RECYCLE + 2), 2))
    assert [number for _, number in results] == [-number for number in range(RECYCLE + 2)]
    assert len({process for process, _ in results}) <= 2


def process_and_negative(number: int) -> tuple[int, int]:
    return os.getpid(), -number


def test_kept_workers_of_shared_works_are_not_replaced() -> None:
    with keeping_workers():
        processes = {process for _ in range(4) for process, _ in share(process_and_negative, range(2), 2)}
    assert len(processes) <= 2


@pytest.mark.parametrize("workers", [1, 2])
def test_faults_of_one_shared_task_reach_the_caller(workers: int) -> None:
    with pytest.raises(BusybotError, match="is refused"):
        list(share(refuse, [7, 8], workers))


def test_worn_out_workers_are_replaced() -> None:
    processes = {pid for _, (_, pid) in run_tasks(range(6), squares, (0,), 1, recycle=2)}
    assert len(processes) == 3 and os.getpid() not in processes


def test_kept_workers_do_what_comes_next_and_end_with_the_block() -> None:
    with keeping_workers():
        first = {pid for _, (_, pid) in run_tasks(range(4), squares, (0,), 2)}
        again = dict(run_tasks(range(4), squares, (5,), 2))
        assert {value for value, _ in again.values()} == {5, 6, 9, 14}
        assert {pid for _, pid in again.values()} <= first
        [(_, (_, alone))] = run_tasks([0], squares, (0,), 1)
        assert alone in first and [pid for pid in first if _runs(pid)] == [alone]
        more = {pid for _, (_, pid) in run_tasks(range(9), squares, (0,), 3)}  # each has another share of the GPUs
        assert more and not more & first and not _runs(alone)
    assert not any(_runs(pid) for pid in more)


def test_kept_workers_are_no_longer_at_what_was_given_up(tmp_path: Path) -> None:
    with keeping_workers():
        with pytest.raises(BusybotError, match="is broken"):
            list(run_tasks(range(3), faulty, (), 2))
        begun = run_tasks([0, 1], slow_but_for_the_first, (), 2)
        assert next(begun) == (0, 0)
        begun.close()
        assert sorted(task for task, _ in run_tasks(range(7), dying, (str(tmp_path),), 2)) == list(range(7))


def slow_but_for_the_first() -> Callable[[int], int]:
    def work(task: int) -> int:
        time.sleep(600 * task)
        return task

    return work


def test_a_task_that_kills_its_worker_is_tried_again(tmp_path: Path) -> None:
    assert sorted(task for task, _ in run_tasks(range(7), dying, (str(tmp_path),), 2)) == list(range(7))


def test_faults_stop_the_work_with_their_message() -> None:
    with pytest.raises(BusybotError, match="is broken"):
        list(run_tasks(range(3), faulty, (), 2))


def test_a_hanging_task_is_killed_and_named() -> None:
    began = time.monotonic()
    with pytest.raises(BusybotError, match=r"task 7 took more than 0 s in each of 3 tries(.|\n)*fewer --steps"):
        list(run_tasks([7], slow, (), 1, task_seconds=0.4))
    assert time.monotonic() - began < 300


def test_workers_end_when_their_parent_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(
        textwrap.dedent(
            """
            import os, sys, time
            from busybot.common.process_pool import run_tasks
            def slow():
                os.write(1, b"worker %d\\n" % os.getpid())  # in one piece
                return lambda task: time.sleep(60)
            if __name__ == "__main__":
                list(run_tasks(range(2), slow, (), 2))
            """
        )
    )
    parent = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    workers = [int(parent.stdout.readline().split()[1]) for _ in range(2)]
    assert all(psutil.pid_exists(pid) for pid in workers)
    parent.kill()
    parent.wait()
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and any(_runs(pid) for pid in workers):
        time.sleep(0.05)
    assert not any(_runs(pid) for pid in workers)


def _runs(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def crashing() -> Callable[[int], int]:
    return lambda task: 1 // 0


def test_an_error_of_the_program_is_told_at_once_and_not_tried_again(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(BusybotError, match="task 5: ZeroDivisionError"):
        list(run_tasks([5], crashing, (), 1))
    assert capfd.readouterr().err.count("Traceback") == 1


@pytest.mark.parametrize(
    ("told", "processor", "able"),
    [
        ("model name\t: A new one\nflags\t\t: avx512_bf16\n\nmodel name\t: The next\nflags\t: \n", "A new one", True),
        ("vendor_id\t: AuthenticAMD\nmodel name\t: Zen\nflags\t\t: avx2 avx512_bf16\n", "Zen", True),
        ("vendor_id\t: GenuineIntel\nmodel name\t: Xeon\nflags\t\t: avx2 avx512_bf16\n", "Xeon", False),
        ("vendor_id\t: GenuineIntel\nmodel name\t: Max\nflags\t\t: avx512_bf16 amx_bf16\n", "Max", True),
        ("model name\t: An old one\nflags\t\t: sse4_2 avx2\n", "An old one", False),
        ("processor\t: 0\nFeatures\t: fp asimd bf16\n", platform.machine(), True),
        (None, platform.machine(), None),
    ],
)
def test_what_a_machine_is_told_as(
    told: str | None, processor: str, able: bool | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if told is not None:
        (tmp_path / "cpuinfo").write_text(told)
    monkeypatch.setattr("busybot.common.process_pool.PROCESSORS", tmp_path / "cpuinfo")
    found = machine()
    assert (found["processor"], found["bfloat16"]) == (processor, able)
    assert found["cores"] == os.cpu_count()
