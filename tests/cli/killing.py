"""Commands that are killed while they work."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from busybot.training.run_folder import read_metrics


def kill_once_it_learns(arguments: list[str], metrics: Path, seconds: float = 300) -> None:
    """Start `busybot ARGUMENTS` and kill it when its metrics file has lines."""
    kill_once(arguments, lambda: len(read_metrics(metrics)) >= 2, seconds)
    assert metrics.exists()


def kill_once(arguments: list[str], so_far: Callable[[], bool], seconds: float = 300) -> None:
    """Start `busybot ARGUMENTS` and kill it when it has come so far."""
    command = [sys.executable, "-m", "busybot", *arguments]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL, start_new_session=True)
    deadline = time.monotonic() + seconds
    while process.poll() is None and not so_far() and time.monotonic() < deadline:
        time.sleep(0.005)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert so_far(), f"busybot {' '.join(arguments)} ended before it could be killed"
