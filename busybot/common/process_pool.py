"""Spawned worker processes for long, independent tasks.

Why not `concurrent.futures`: a simulator process must be replaced after some hundred boards, a task that hangs must be
killed alone, and no worker may outlive its parent. Workers are spawned, never forked: no renderer survives a fork.
"""

import contextlib
import ctypes
import multiprocessing as mp
import os
import platform
import signal
import sys
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, TypeVar

from busybot.common.errors import BusybotError

TASK_SECONDS = 300.0
"""A task that takes longer is killed and tried again."""
TRIES = 3
PR_SET_PDEATHSIG = 1
PROCESSORS = Path("/proc/cpuinfo")

Engine = Callable[..., Iterator[tuple[int, Any]]]
"""`run_tasks`, or something that keeps its contract."""

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass
class _Worker:
    process: Any
    pipe: Connection
    task: int | None = None
    started: float = 0.0
    done: int = 0


def default_workers() -> int:
    """One worker per processor that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def machine() -> dict[str, Any]:
    """What commands run on, to be told beside results.

    `processor` is its name where Linux tells it, else its kind; `bfloat16`, whether it multiplies that, decides how
    fast networks are (None where nobody tells).
    """
    told = _processor()
    able = told.get("flags", told.get("Features", "")).split()
    return {
        "cores": os.cpu_count(),
        "system": platform.system(),
        "processor": told.get("model name", platform.machine()),
        "bfloat16": any(flag in able for flag in ("amx_bf16", "avx512_bf16", "bf16")) if able else None,
    }


def _processor() -> dict[str, str]:
    """The kernel's words on the first processor, by their names; none where there is no such file."""
    if not PROCESSORS.is_file():
        return {}
    lines = PROCESSORS.read_text(encoding="utf-8", errors="replace").split("\n\n")[0].splitlines()
    pairs = (line.partition(":") for line in lines)
    return {name.strip(): value.strip() for name, _, value in pairs}


def run_tasks(
    tasks: Iterable[int],
    make_work: Callable[..., Callable[[int], Any]],
    arguments: tuple[Any, ...],
    workers: int,
    recycle: int = 300,
    task_seconds: float = TASK_SECONDS,
) -> Iterator[tuple[int, Any]]:
    """Run `work = make_work(*arguments)` once per worker, then `work(task)` for every task; yields (task, result).

    Args:
        tasks: small integers, each given to one worker at a time.
        make_work: importable by name; heavy set-up belongs here.
        recycle: a worker is replaced after so many tasks.
        task_seconds: limit for one task, the worker's set-up included.

    Raises:
        BusybotError: a task was at fault (its message), or it killed its worker or ran out of time in every try.
    """
    waiting = deque(tasks)
    tries: dict[int, int] = {}
    context = mp.get_context("spawn")
    pool: list[_Worker] = []
    try:
        while waiting or any(worker.task is not None for worker in pool):
            pool = _staff(pool, min(workers, len(waiting) + _busy(pool)), context, make_work, arguments, recycle)
            for worker in pool:
                if worker.task is None and waiting:
                    _hand_out(worker, waiting.popleft())
            wait([worker.pipe for worker in pool], timeout=0.5)
            for worker in pool:
                outcome = _collect(worker, task_seconds)
                if outcome is None:
                    continue
                task, state, value = outcome
                if state == "done":
                    yield task, value
                elif state == "fault":
                    raise BusybotError(*value)
                else:
                    tries[task] = tries.get(task, 0) + 1
                    if tries[task] >= TRIES:
                        raise BusybotError(f"task {task} {value} in each of {TRIES} tries", "busybot doctor")
                    waiting.appendleft(task)
    finally:
        for worker in pool:
            _end(worker)


def share(function: Callable[[Task], Result], tasks: Iterable[Task], workers: int = 1) -> Iterator[Result]:
    """Results in the order of the tasks; with one worker they are computed here.

    Args:
        function: importable by name if workers > 1.
    """
    todo = list(tasks)
    if workers <= 1 or len(todo) < 2:
        yield from map(function, todo)
        return
    results: dict[int, Result] = {}
    awaited = 0
    for index, result in run_tasks(range(len(todo)), _apply, (function, todo), workers):
        results[index] = result
        while awaited in results:
            yield results.pop(awaited)
            awaited += 1


def _apply(function: Callable[[Task], Result], todo: list[Task]) -> Callable[[int], Result]:
    return lambda index: function(todo[index])


def _busy(pool: list[_Worker]) -> int:
    return sum(worker.task is not None for worker in pool)


def _staff(
    pool: list[_Worker],
    wanted: int,
    context: Any,
    make_work: Callable[..., Callable[[int], Any]],
    arguments: tuple[Any, ...],
    recycle: int,
) -> list[_Worker]:
    """Replace dead and worn out workers, and start missing ones."""
    kept = []
    for worker in pool:
        worn_out = worker.task is None and worker.done >= recycle
        if worn_out or not worker.process.is_alive() and worker.task is None:
            _end(worker)
        else:
            kept.append(worker)
    while len(kept) < wanted:
        here, there = context.Pipe()
        process = context.Process(target=_main, args=(there, os.getpid(), make_work, arguments), daemon=True)
        process.start()
        there.close()
        kept.append(_Worker(process, here))
    return kept


def _hand_out(worker: _Worker, task: int) -> None:
    worker.task, worker.started = task, time.monotonic()
    with contextlib.suppress(OSError):  # a dead worker is noticed when its result is collected
        worker.pipe.send(task)


def _collect(worker: _Worker, task_seconds: float) -> tuple[int, str, Any] | None:
    """(task, `done` | `fault` | `lost`, value), or None while there is nothing to tell."""
    task = worker.task
    if task is None:
        return None
    try:
        if worker.pipe.poll():
            state, value = worker.pipe.recv()
            worker.task, worker.done = None, worker.done + 1
            return task, state, value
        dead = not worker.process.is_alive()
    except (EOFError, OSError):
        dead = True
    late = time.monotonic() - worker.started > task_seconds
    if not dead and not late:
        return None
    _end(worker)
    worker.task = None
    return task, "lost", "killed its worker" if dead else f"took more than {task_seconds:.0f} s"


def _end(worker: _Worker) -> None:
    worker.pipe.close()
    if worker.process.is_alive():
        worker.process.kill()
    worker.process.join()


def end_with(parent: int) -> None:
    """Have this process killed when its parent ends, however that ends; for the first lines of a child process."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)


def _use_one_thread() -> None:
    """Let networks use one thread in this process: there are as many workers as cores, more would only wait."""
    os.environ["OMP_NUM_THREADS"] = "1"  # read by PyTorch when it is imported, which a task may do
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)


def _main(
    pipe: Connection, parent: int, make_work: Callable[..., Callable[[int], Any]], arguments: tuple[Any, ...]
) -> None:
    """A worker's life: set up, then one task after the other until the pipe closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what an interrupt means
    end_with(parent)
    _use_one_thread()
    work: Callable[[int], Any] | None = None
    while True:
        try:
            task = pipe.recv()
        except (EOFError, OSError):
            os._exit(0)
        try:
            work = work or make_work(*arguments)
            pipe.send(("done", work(task)))
        except BusybotError as error:
            pipe.send(("fault", (error.what, error.hint)))
        except Exception as error:  # told to the parent, which ends the work; trying again would not help
            traceback.print_exc()
            pipe.send(("fault", (f"task {task}: {type(error).__name__}: {error}", None)))
