"""Reading many episodes with several processes; they end when their parent does."""

import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context, parent_process
from typing import TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")

_TASKS_AT_ONCE = 4


def share(function: Callable[[Task], Result], tasks: Iterable[Task], workers: int = 1) -> Iterator[Result]:
    """Results in the order of the tasks. `function`, tasks and results must be picklable when workers > 1."""
    todo = list(tasks)
    if workers <= 1 or len(todo) < 2:
        yield from map(function, todo)
        return
    with ProcessPoolExecutor(min(workers, len(todo)), get_context("spawn"), _end_with_parent) as pool:
        yield from pool.map(function, todo, chunksize=_TASKS_AT_ONCE)


def _end_with_parent() -> None:
    """A killed parent cannot end its workers, and they would wait for tasks forever."""
    parent = parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
