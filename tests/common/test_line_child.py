"""Programs that are asked by lines: they end with who asks, however that ends, and keep nobody waiting."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from busybot.common import line_child
from busybot.common.line_child import Child
from busybot.common.process_pool import run_tasks

WRAPPER = ("/bin/sh", "-c", 'sleep 600 & echo "$$ $!"; wait')
"""Starts another program, as `uv run` and `npx` do, and tells the numbers of both."""
ASKER = f"""
import signal, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where the tests run in the background of a script
from busybot.common.line_child import Child
print(Child({WRAPPER}, 60).ask({{}}).decode(), flush=True)
time.sleep(600)
"""


def run(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def all_end(pids: list[int]) -> bool:
    until = time.monotonic() + 20
    while any(map(run, pids)) and time.monotonic() < until:
        time.sleep(0.01)
    left = [pid for pid in pids if run(pid)]
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    return not left


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_what_a_wrapper_started_ends_with_who_asked(how: signal.Signals) -> None:
    asker = subprocess.Popen([sys.executable, "-c", ASKER], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    assert asker.stdout is not None
    pids = [int(word) for word in asker.stdout.readline().split()]
    watchers = [one.pid for one in psutil.Process(asker.pid).children() if one.pid not in pids]
    assert len(pids) == 2 and all(map(run, pids)) and len(watchers) == 1
    asker.send_signal(how)
    asker.wait()
    assert all_end(pids) and all_end(watchers)


def asking() -> Callable[[int], list[int]]:
    def work(task: int) -> list[int]:
        kept.append(Child(WRAPPER, 60))
        pids = [int(word) for word in kept[-1].ask({}).split()]
        time.sleep(600 * task)
        return pids

    return work


kept: list[Child] = []
"""Of a worker: nobody closes them."""


def test_what_a_worker_asks_ends_when_the_work_is_given_up() -> None:
    begun = run_tasks([0, 1], asking, (), 1)
    _, pids = next(begun)
    assert all(map(run, pids))
    begun.close()
    assert all_end(pids)


def test_a_child_that_is_closed_leaves_nobody() -> None:
    before = {one.pid for one in psutil.Process().children()}
    child = Child(WRAPPER, 60)
    pids = [int(word) for word in child.ask({}).split()]
    assert child.close() == "" and all_end(pids)
    with pytest.raises(OSError):
        Child(("no-such-program-here",), 60)
    assert {one.pid for one in psutil.Process().children()} <= before


def test_who_may_not_be_killed_is_waited_for_only_a_while(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """As a program that `sudo` started: it hears that its input ends."""

    def refuse(group: int, number: int) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "killpg", refuse)
    last = tmp_path / "last"
    polite = Child((sys.executable, "-ISc", f"import sys; sys.stdin.read(); open({str(last)!r}, 'w')"), 60)
    assert polite.close() == "" and last.exists()
    monkeypatch.setattr(line_child, "END_SECONDS", 0.3)
    deaf = Child((sys.executable, "-ISc", "import os, time; print(os.getpid(), flush=True); time.sleep(30)"), 60)
    pid, began = int(deaf.ask({})), time.monotonic()
    try:
        assert deaf.close() == "" and time.monotonic() - began < 10 and run(pid)
    finally:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
