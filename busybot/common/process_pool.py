"""Long, independent tasks in worker processes: spawned on this machine, or actors of a Ray cluster.

Why not `concurrent.futures`: a simulator process must be replaced after some hundred boards, a task that hangs must be
killed alone, and no worker may outlive its parent. Workers are spawned, never forked: no renderer survives a fork.
Within `keeping_workers` one work after the other is done by the same workers, which wait in between.

Ray is for many machines that share a file system; on one, spawned processes are quicker to start and as fast. Without
`RAY_ADDRESS` in the environment Ray is started here, on the loopback interface alone and without its dashboard, and
ends with the work.
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
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, TypeVar

from busybot.common.device import CHOICE, WORKER
from busybot.common.errors import BusybotError, explained, needs_extra

TASK_SECONDS = 300.0
"""A task that takes longer is killed and tried again."""
RECYCLE = 300
"""A worker is replaced after so many tasks."""
TRIES = 3
NEVER_STARTED = "found no worker that starts"
TOO_LONG = "took more than"
PR_SET_PDEATHSIG = 1
PROCESSORS = Path("/proc/cpuinfo")
INTEL = "GenuineIntel"
LOOPBACK = "127.0.0.1"
ONLY_HERE = "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"

Engine = Callable[..., Iterator[tuple[int, Any]]]
"""`run_tasks` or `run_on_ray`."""
Progress = Callable[[int, int], None]
"""Told how many are done, of how many."""
MakeWork = Callable[..., Callable[[Any], Any]]
Outcome = tuple[int, str, Any]
"""(task, `done`, result), (task, `fault`, what and hint) or (task, `lost`, how)."""

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(frozen=True)
class _Given:
    """A task, and what is worked on."""

    task: int
    value: Any


@dataclass
class _Worker:
    process: Any
    pipe: Connection
    number: int
    of: int
    task: int | None = None
    started: float = 0.0
    done: int = 0


def default_workers() -> int:
    """One worker per processor that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def machine() -> dict[str, Any]:
    """What commands run on, to be told beside results.

    `processor` is its name where Linux tells it, else its kind; `bfloat16`, whether it multiplies that faster than
    float32, decides how fast networks are (None where nobody tells). Intel's vector units multiply it slower than
    float32 (seen on Emerald Rapids), only its matrix units (AMX) are faster.
    """
    told: dict[str, str] = {}
    if PROCESSORS.is_file():
        first = PROCESSORS.read_text(encoding="utf-8", errors="replace").split("\n\n")[0]
        pairs = (line.partition(":") for line in first.splitlines())
        told = {name.strip(): value.strip() for name, _, value in pairs}
    able = told.get("flags", told.get("Features", "")).split()
    fast = {"amx_bf16", "bf16"} | (set() if told.get("vendor_id") == INTEL else {"avx512_bf16"})
    return {
        "cores": os.cpu_count(),
        "system": platform.system(),
        "processor": told.get("model name", platform.machine()),
        "bfloat16": not fast.isdisjoint(able) if able else None,
    }


def run_tasks(
    tasks: Iterable[int],
    make_work: MakeWork,
    arguments: tuple[Any, ...],
    workers: int,
    recycle: int = RECYCLE,
    task_seconds: float = TASK_SECONDS,
    given: Sequence[Any] | None = None,
) -> Iterator[tuple[int, Any]]:
    """Run `work = make_work(*arguments)` once per worker, then `work(task)` for every task; yields (task, result).

    Args:
        tasks: small integers, each given to one worker at a time.
        make_work: importable by name; heavy set-up belongs here.
        recycle: a worker is replaced after so many tasks.
        task_seconds: limit for one task, the worker's set-up included.
        given: work gets `given[task]` in the task's place; a worker is sent what it works on, and nothing else.

    Raises:
        BusybotError: a task was at fault (its message), or it killed its worker or ran out of time in every try.
    """
    waiting, tries, workers = deque(tasks), Counter[int](), max(workers, 1)
    pool = _kept_for(make_work, arguments, workers)
    try:
        while waiting or any(worker.task is not None for worker in pool):
            pool = _staff(pool, workers, len(waiting), make_work, arguments, recycle)
            for worker in pool:
                if worker.task is None and waiting:
                    task = waiting.popleft()
                    _hand_out(worker, task, task if given is None else given[task])
            wait([worker.pipe for worker in pool], timeout=0.5)
            for worker in pool:
                outcome = _collect(worker, task_seconds)
                if outcome is not None:
                    yield from _settle(outcome, waiting, tries)
    finally:
        for worker in pool:
            if _kept is None or worker.task is not None:
                _end(worker)
            else:
                _kept.append(worker)


_kept: list[_Worker] | None = None
"""Workers that wait for this process's next work; None outside of `keeping_workers`."""


@contextlib.contextmanager
def keeping_workers() -> Iterator[None]:
    """Within the block the workers of `run_tasks` do not end with the work: the next one finds them started.

    It is for work in many small parts, each of which would start its workers anew. They keep what they have imported,
    and the renderer; nothing else.
    """
    global _kept
    if _kept is not None:
        yield
        return
    _kept = []
    try:
        yield
    finally:
        workers, _kept = _kept, None
        for worker in workers:
            _end(worker)


def _kept_for(make_work: MakeWork, arguments: tuple[Any, ...], workers: int) -> list[_Worker]:
    """The workers that wait, with their new work; those end that are too many, or that share a GPU with too few."""
    pool: dict[int, _Worker] = {}
    while _kept:
        worker = _kept.pop()
        if worker.number < workers <= worker.of and worker.number not in pool and worker.process.is_alive():
            _send_work(worker, make_work, arguments)
            pool[worker.number] = worker
        else:
            _end(worker)
    return list(pool.values())


def run_on_ray(
    tasks: Iterable[int],
    make_work: MakeWork,
    arguments: tuple[Any, ...],
    workers: int,
    recycle: int = RECYCLE,
    task_seconds: float = TASK_SECONDS,
) -> Iterator[tuple[int, Any]]:
    """As `run_tasks`; `workers` are actors with a processor each, wherever the cluster has room for them.

    Only actors that have started are given tasks: one for which there is no room yet, or no longer because its machine
    is gone, keeps nothing waiting, and takes part when a machine joins. What a lost machine was at is done again.
    Actors work in this process's folder, so that paths mean the same.

    Raises:
        BusybotError: as there, or Ray is not installed or its cluster cannot be reached.
    """
    waiting, tries = deque(tasks), Counter[int]()
    idle: list[tuple[Any, int]] = []
    starting: dict[Any, Any] = {}
    running: dict[Any, tuple[Any, int, int]] = {}
    with _cluster(workers) as ray:
        actor_class, here = ray.remote(num_cpus=1)(_Work), os.getcwd()
        while waiting or running:
            while waiting and idle:
                (actor, done), task = idle.pop(), waiting.popleft()
                running[actor.run.remote(task, task)] = actor, done, task
            while len(starting) < min(workers - len(running), len(waiting)):
                actor = actor_class.remote(_in_folder, (here, make_work, arguments))
                starting[actor.__ray_ready__.remote()] = actor
            calls = [*running, *starting]
            ready, _ = ray.wait(calls, num_returns=1, timeout=task_seconds)
            call = (ready or calls)[0]
            state, value = _answer(ray, call, bool(ready))
            if call in starting:
                actor, done = starting.pop(call), 0
                outcome = (waiting.popleft(), "lost", NEVER_STARTED) if waiting and state == "lost" else None
            else:
                actor, done, task = running.pop(call)
                done, outcome = done + 1, value if state == "done" else (task, state, value)
            if state != "lost" and done < recycle:
                idle.append((actor, done))
            else:
                ray.kill(actor)
            if outcome is not None:
                yield from _settle(outcome, waiting, tries)


def _answer(ray: Any, call: Any, ready: bool) -> tuple[str, Any]:
    """What came of a call of an actor: (`done`, its result), or a fault, or it was lost with its actor or machine."""
    try:
        return "done", ray.get(call, timeout=None if ready else 0)
    except ray.exceptions.RayTaskError as error:
        return "fault", (repr(error.cause), None)
    except ray.exceptions.RayError:
        return "lost", "killed its worker or took too long"


def _in_folder(folder: str, make_work: MakeWork, arguments: tuple[Any, ...]) -> Callable[[Any], Any]:
    os.chdir(folder)
    return make_work(*arguments)


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
    # no simulator is in these workers: none has to be replaced, also if they are kept for one work after the other
    for index, result in run_tasks(range(len(todo)), _apply, (function,), workers, recycle=sys.maxsize, given=todo):
        results[index] = result
        while awaited in results:
            yield results.pop(awaited)
            awaited += 1


def _apply(function: Callable[[Task], Result]) -> Callable[[Task], Result]:
    return function


def _settle(outcome: Outcome, waiting: deque[int], tries: Counter[int]) -> Iterator[tuple[int, Any]]:
    """Pass a result on, raise a fault, and let a task that was lost wait again, but not for ever."""
    task, state, value = outcome
    if state == "done":
        yield task, value
        return
    if state == "fault":
        raise BusybotError(*value)
    tries[task] += 1
    if tries[task] >= TRIES:
        hint = "busybot doctor"
        if value == NEVER_STARTED:
            hint = 'in a script, work with several processes stands under `if __name__ == "__main__":`'
        elif TOO_LONG in value:
            hint += "; a task that has less to do is quicker: fewer --steps, where it is an episode"
        raise BusybotError(f"task {task} {value} in each of {TRIES} tries", hint)
    waiting.appendleft(task)


class _Work:
    """What a worker does with its tasks; set up at the first one.

    Args:
        before: what it did before; it stays until a task is done, because it may hold a renderer that both can use.
    """

    def __init__(self, make_work: MakeWork, arguments: tuple[Any, ...], before: "_Work | None" = None):
        self._make_work, self._arguments = make_work, arguments
        self._work: Callable[[Any], Any] | None = None
        self._before = before and before._work

    def run(self, task: int, given: Any) -> Outcome:
        try:
            self._work = self._work or self._make_work(*self._arguments)
            result = self._work(given)
            self._before = None
            return task, "done", result
        except BusybotError as error:
            return task, "fault", (error.what, error.hint)
        except (OSError, MemoryError) as error:
            told = explained(error)
            return task, "fault", (told.what, told.hint)


def _staff(
    pool: list[_Worker], workers: int, waiting: int, make_work: MakeWork, arguments: tuple[Any, ...], recycle: int
) -> list[_Worker]:
    """Replace dead and worn out workers, and start missing ones, no more than there are tasks for."""
    kept = []
    for worker in pool:
        if worker.task is None and (worker.done >= recycle or not worker.process.is_alive()):
            _end(worker)
        else:
            kept.append(worker)
    busy = sum(worker.task is not None for worker in pool)
    context = mp.get_context("spawn")
    while len(kept) < min(workers, waiting + busy):
        here, there = context.Pipe()
        number = min(set(range(workers)) - {worker.number for worker in kept})
        process = context.Process(target=_main, args=(there, os.getpid(), f"{number}/{workers}"), daemon=True)
        process.start()
        there.close()
        worker = _Worker(process, here, number, workers)
        # not among the process's own arguments: Python would wait for ever for one that ends before it reads them
        _send_work(worker, make_work, arguments)
        kept.append(worker)
    return kept


def _send_work(worker: _Worker, make_work: MakeWork, arguments: tuple[Any, ...]) -> None:
    with contextlib.suppress(OSError):  # a dead worker is noticed when it is staffed, or its result collected
        worker.pipe.send((make_work, arguments))


def _hand_out(worker: _Worker, task: int, given: Any) -> None:
    worker.task, worker.started = task, time.monotonic()
    with contextlib.suppress(OSError):  # a dead worker is noticed when its result is collected
        worker.pipe.send(_Given(task, given))


def _collect(worker: _Worker, task_seconds: float) -> Outcome | None:
    """What came of the worker's task; None while there is nothing to tell."""
    task = worker.task
    if task is None:
        return None
    try:
        if worker.pipe.poll():
            outcome: Outcome = worker.pipe.recv()
            worker.task, worker.done = None, worker.done + 1
            return outcome
        dead = not worker.process.is_alive()
    except (EOFError, OSError):
        dead = True
    late = time.monotonic() - worker.started > task_seconds
    if not dead and not late:
        return None
    _end(worker)
    worker.task = None
    if dead:
        return task, "lost", NEVER_STARTED if worker.process.exitcode == 1 and not worker.done else "killed its worker"
    return task, "lost", f"{TOO_LONG} {task_seconds:.0f} s"


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


def _main(pipe: Connection, parent: int, place: str) -> None:
    """A worker's life: set up, then one task after the other until the pipe closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what an interrupt means
    end_with(parent)
    os.environ[WORKER] = place
    # there are as many workers as cores: networks that use more than one thread would only wait
    os.environ["OMP_NUM_THREADS"] = "1"  # read by PyTorch when it is imported, which a task may do
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)
    work: _Work | None = None
    while True:
        try:
            asked = pipe.recv()
        except (EOFError, OSError):
            os._exit(0)
        if not isinstance(asked, _Given):
            make_work, arguments = asked
            work = _Work(make_work, arguments, work)
            continue
        assert work is not None, "what to do comes before the first task"
        try:
            pipe.send(work.run(asked.task, asked.value))
        except Exception as error:  # told to the parent, which ends the work; trying again would not help
            traceback.print_exc()
            pipe.send((asked.task, "fault", (f"task {asked.task}: {type(error).__name__}: {error}", None)))


@contextlib.contextmanager
def _cluster(workers: int) -> Iterator[Any]:
    """Ray, connected to the cluster that the environment names, or to one that is started here and ends again."""
    ray = _imported_ray()
    if ray.is_initialized():
        yield ray
        return
    options: dict[str, Any] = {"log_to_driver": False, "logging_level": "error"}
    if "RAY_ADDRESS" in os.environ:
        told = {name: os.environ[name] for name in (CHOICE,) if name in os.environ}
        options["runtime_env"] = {"env_vars": {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), **told}}
    else:
        options |= {"address": "local", "include_dashboard": False, "_node_ip_address": LOOPBACK, "num_cpus": workers}
    try:
        ray.init(**options)
    except (ConnectionError, RuntimeError, ValueError) as error:
        what = f"the Ray cluster cannot be reached: {str(error).splitlines()[0]}"
        raise BusybotError(what, "see RAY_ADDRESS, or `ray status` on its machines") from None
    try:
        if "address" in options and not ray.util.get_node_ip_address().startswith("127."):
            what = f"Ray would listen to the network: {ONLY_HERE} came too late"
            raise BusybotError(what, "set it before Ray is imported")
        yield ray
    finally:
        ray.shutdown()


def _imported_ray() -> Any:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    if "RAY_ADDRESS" not in os.environ:
        # Ray replaces the loopback address by one that can be reached from outside, unless it believes that there are
        # no clusters on this system; it reads this when it is imported
        os.environ[ONLY_HERE] = "0"
    try:
        import ray
    except ImportError:
        raise needs_extra("Ray", "cluster") from None
    return ray
