"""Metrics of a running training: lines of JSON in a file, lines of text on standard error."""

import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from busybot.common.atomic_io import write_atomically

PROGRESS_SECONDS = 15.0


class Metrics:
    """The metrics file of one network: one JSON object per line, in the order of iterations.

    Lines with `loss` hold its mean since the line before, lines with `validation` the figures at a round's end.

    Args:
        resumed: lines after this iteration are dropped: the training repeats them.
    """

    def __init__(self, path: Path, name: str, resumed: int, start: int, until: int, every: int):
        self._path, self._name, self._start, self._until, self._every = path, name, start, until, every
        kept = (line for line in read_metrics(path) if line["iteration"] <= resumed)
        self._lines: list[dict[str, Any]] = [line for line in kept if "loss" in line or line["iteration"] < until]
        self._losses: list[float] = []
        self._began, self._first, self._told = time.monotonic(), resumed, time.monotonic()

    def add(self, iteration: int, loss: float, rate: float) -> None:
        """Enter an iteration's loss and learning rate."""
        self._losses.append(loss)
        if iteration % self._every == 0 or iteration == self._until:
            mean = sum(self._losses) / len(self._losses)
            self._lines.append({"iteration": iteration, "loss": mean, "learning_rate": rate})
            self._losses = []
            now = time.monotonic()
            if now - self._told >= PROGRESS_SECONDS or iteration == self._until:
                self._told = now
                self._tell(iteration, mean, (now - self._began) / (iteration - self._first))

    def _tell(self, iteration: int, loss: float, seconds: float) -> None:
        done, total = iteration - self._start, self._until - self._start
        left = seconds * (self._until - iteration)
        text = f"{self._name}: {done} of {total}, loss {loss:.3f}, {1e3 * seconds:.0f} ms each, {left:.0f} s left"
        print(text, file=sys.stderr, flush=True)

    def end(self, iteration: int, figures: Mapping[str, float | None]) -> None:
        """Enter the figures of a round's end."""
        self._lines.append({"iteration": iteration, "validation": dict(figures)})
        self.write()
        shown = ", ".join(f"{name} {value:.4f}" for name, value in figures.items() if value is not None)
        print(f"{self._name}: {shown}", file=sys.stderr, flush=True)

    def write(self) -> None:
        """Bring the file up to date."""
        text = "".join(json.dumps(line, sort_keys=True) + "\n" for line in self._lines)
        write_atomically(self._path, text.encode(), self._path.parent.parent)


def read_metrics(path: Path) -> list[dict[str, Any]]:
    """The lines of a metrics file, none if it does not exist."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
