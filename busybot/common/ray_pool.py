"""Tasks on a Ray cluster, with the contract of `process_pool.run_tasks`: for many machines that share a file system.

On one machine the local engine is quicker to start and as fast. Without `RAY_ADDRESS` in the environment Ray is started
here, on the loopback interface alone and without its dashboard, and ends with the work.
"""

import os
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from busybot.common.errors import BusybotError
from busybot.common.process_pool import TASK_SECONDS, TRIES

LOOPBACK = "127.0.0.1"
ONLY_HERE = "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"


class _Actor:
    """A worker process on some machine: sets up at its first task."""

    def __init__(self, make_work: Callable[..., Callable[[int], Any]], arguments: tuple[Any, ...]):
        self._make_work, self._arguments = make_work, arguments
        self._work: Callable[[int], Any] | None = None

    def run(self, task: int) -> tuple[str, Any]:
        """(`done`, result) or (`fault`, what and hint)."""
        try:
            self._work = self._work or self._make_work(*self._arguments)
            return "done", self._work(task)
        except BusybotError as error:
            return "fault", (error.what, error.hint)


def run_on_ray(
    tasks: Iterable[int],
    make_work: Callable[..., Callable[[int], Any]],
    arguments: tuple[Any, ...],
    workers: int,
    recycle: int = 300,
    task_seconds: float = TASK_SECONDS,
) -> Iterator[tuple[int, Any]]:
    """As `process_pool.run_tasks`; `workers` are actors with a processor each, wherever the cluster has room for them.

    Raises:
        BusybotError: Ray is not installed or its cluster cannot be reached, a task was at fault, or it killed its actor
            or ran out of time in every try.
    """
    ray = _ray()
    begun = _connect(ray, workers)
    try:
        yield from _run(ray, deque(tasks), make_work, arguments, workers, recycle, task_seconds)
    finally:
        if begun:
            ray.shutdown()


def _ray() -> Any:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    if "RAY_ADDRESS" not in os.environ:
        # Ray replaces the loopback address by one that can be reached from outside, unless it believes that there are
        # no clusters on this system; it reads this when it is imported
        os.environ[ONLY_HERE] = "0"
    try:
        import ray
    except ImportError:
        raise BusybotError(
            "Ray is not installed", "pip install 'busybot[cluster]', or leave --engine ray out"
        ) from None
    return ray


def _connect(ray: Any, workers: int) -> bool:
    """Connect to the cluster that the environment names, or start one here; whether this was the beginning."""
    if ray.is_initialized():
        return False
    options: dict[str, Any] = {"log_to_driver": False, "logging_level": "error"}
    if "RAY_ADDRESS" in os.environ:
        options["runtime_env"] = {"env_vars": {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}}
    else:
        options |= {"address": "local", "include_dashboard": False, "_node_ip_address": LOOPBACK, "num_cpus": workers}
    try:
        ray.init(**options)
    except (ConnectionError, RuntimeError, ValueError) as error:
        what = f"the Ray cluster cannot be reached: {str(error).splitlines()[0]}"
        raise BusybotError(what, "see RAY_ADDRESS, or `ray status` on its machines") from None
    if "address" in options and not ray.util.get_node_ip_address().startswith("127."):
        ray.shutdown()
        raise BusybotError(
            f"Ray would listen to the network: {ONLY_HERE} came too late", "set it before Ray is imported"
        )
    return True


def _run(
    ray: Any,
    waiting: deque[int],
    make_work: Callable[..., Callable[[int], Any]],
    arguments: tuple[Any, ...],
    workers: int,
    recycle: int,
    task_seconds: float,
) -> Iterator[tuple[int, Any]]:
    tries: dict[int, int] = {}
    actor_class = ray.remote(num_cpus=1)(_Actor)
    idle: list[tuple[Any, int]] = []
    running: dict[Any, tuple[Any, int, int]] = {}
    while waiting or running:
        while waiting and len(running) < workers:
            actor, done = idle.pop() if idle else (actor_class.remote(make_work, arguments), 0)
            task = waiting.popleft()
            running[actor.run.remote(task)] = (actor, done, task)
        ready, _ = ray.wait(list(running), num_returns=1, timeout=task_seconds)
        for reference in ready or list(running)[:1]:
            actor, done, task = running.pop(reference)
            try:
                state, value = ray.get(reference, timeout=0 if not ready else None)
            except ray.exceptions.RayTaskError as error:
                raise BusybotError(f"task {task}: {error.cause!r}") from None
            except (ray.exceptions.RayActorError, ray.exceptions.GetTimeoutError):
                ray.kill(actor)
                tries[task] = tries.get(task, 0) + 1
                if tries[task] >= TRIES:
                    raise BusybotError(
                        f"task {task} killed its worker or took too long in each of {TRIES} tries"
                    ) from None
                waiting.appendleft(task)
                continue
            if state == "fault":
                raise BusybotError(*value)
            if done + 1 < recycle:
                idle.append((actor, done + 1))
            else:
                ray.kill(actor)
            yield task, value
