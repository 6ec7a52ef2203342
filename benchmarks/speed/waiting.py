"""Measures what people wait for: commands, environments, boards and recorded actions, on several checkouts in one run.

    python -m benchmarks.speed.waiting --checkout before=FOLDER --checkout after=FOLDER [--repeat 3] [--out FILE]
    python -m benchmarks.speed.waiting reproduce [--profile smoke] [--out FILE]

Only the command line and `gymnasium.make` are used, so the checkouts may be of any version. They take turns, so that
what else the machine does meets all of them alike; figures are medians. A row is processor time, user and system, of a
command and of the processes that it starts. It is told as a ratio to one product of two 1024 x 1024 matrices of float32
by one thread, which is timed in the same run: that ratio says the same on a faster machine. Rows per board and per
action are differences of two commands, one of which does more, so that starting is not in them.

Everything is measured with warm caches: each checkout has made its procedural objects and has parsed them, if it keeps
that, Python has compiled its modules, and the operating system has its files in memory.

`reproduce` runs the whole pipeline of a profile in a copy of this checkout, as `make reproduce` does once everything is
set up, DVC included (`make dvc`): processor time of all processes, and of the stages, those of one kind together.
"""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.runner import (
    PRODUCT_SIDE,
    cpu_seconds,
    finish,
    load_average,
    named,
    one_of,
    parser,
    product_seconds,
    torch_with,
)
from busybot.evaluation.results import read_result

ROOT = Path(__file__).resolve().parents[2]
PIPELINE = ("busybot", "pipelines", "dvc.yaml", ".dvcignore", ".dvc/config")
"""What the pipeline consists of."""
DVC = ROOT / ".tools" / "dvc" / "bin" / "dvc"
SEED = "5"
ENVIRONMENT = "import gymnasium, busybot.sim.registration; gymnasium.make('busybot/Board-v0').reset(seed=0)"


@dataclass(frozen=True)
class Row:
    """What is measured.

    Attributes:
        more: words of `busybot`, or of Python. `{new}` is a folder that is not there, `{16}` a dataset with so many
            boards and no episodes, `{recorded}` one of 20 boards with 30 steps each.
        less: is subtracted; what `more` does beyond it is done `units` times.
    """

    more: str
    less: str | None = None
    units: int = 1


def acting(policy: str) -> Row:
    """An action, recorded."""
    few, many = (f"busybot collect {{16}} --policy {policy} --steps {steps} --workers 1" for steps in (4, 24))
    return Row(many, few, 16 * 20)


ROWS = {
    "busybot --help": Row("busybot --help"),
    "generate, 2 boards": Row("busybot generate {new} --boards 2"),
    "gymnasium.make and reset": Row(f"-c {shlex.quote(ENVIRONMENT)}"),
    "collect, to the first action": Row("busybot collect {1} --policy scripted --steps 1 --workers 1"),
    "eval reason, 20 boards": Row("busybot eval reason {recorded}"),
    "building and looking at a board": Row(
        "busybot collect {24} --policy random --steps 1 --workers 1",
        "busybot collect {8} --policy random --steps 1 --workers 1",
        16,
    ),
    "a recorded action, scripted": acting("scripted"),
    "a recorded action, learned": acting("learned"),
}


class Checkout:
    """A version of the project, and the datasets that it made.

    Args:
        source: the repository.
        work: folder for its datasets and its cache.
    """

    def __init__(self, source: Path, work: Path) -> None:
        self.work = work
        path = os.pathsep.join(filter(None, [str(source), os.environ.get("PYTHONPATH")]))
        self.environment = {
            **os.environ,
            "PYTHONPATH": path,
            "BUSYBOT_CACHE": str(work / "cache"),
            "PYTHONDONTWRITEBYTECODE": "",  # where it is set every process compiles the project anew
            "PYTHONPYCACHEPREFIX": str(work / "compiled"),
        }
        self.commit = subprocess.run(
            ["git", "-C", str(source), "rev-parse", "HEAD"], capture_output=True, text=True
        ).stdout.strip()

    def prepare(self) -> None:
        """All that commands find there."""
        for boards in (1, 8, 16, 24):
            self.run(f"busybot generate {boards} --boards {boards} --seed {SEED} --group-size 1")
        self.run(f"busybot generate recorded --boards 20 --seed {SEED}")
        self.run("busybot collect recorded --policy scripted --steps 30")
        self.run("busybot features recorded")

    def seconds(self, words: str) -> float:
        """Processor seconds of a command on datasets of its own."""
        used = self.work / "used"
        shutil.rmtree(used, ignore_errors=True)
        used.mkdir()
        for name in re.findall(r"{(\d+)}", words):
            shutil.copytree(self.work / name, used / name)
        places = re.sub(r"{(\d+|new)}", r"used/\1", words).replace("{recorded}", "recorded")
        before = os.times()
        self.run(places)
        after = os.times()
        return after.children_user + after.children_system - before.children_user - before.children_system

    def run(self, words: str) -> None:
        """Run it in the work folder.

        Raises:
            RuntimeError: it failed; with what it said.
        """
        given = shlex.split(words)
        command = [sys.executable, *(("-m", *given) if given[0] == "busybot" else given)]
        done = subprocess.run(command, cwd=self.work, env=self.environment, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"{words}: {done.stderr[-500:]}")


def measure(row: Row, checkouts: dict[str, Checkout], repeat: int) -> dict[str, float]:
    """Median seconds of each checkout."""
    spent: dict[str, list[float]] = {name: [] for name in checkouts}
    for _ in range(repeat):
        for name, checkout in checkouts.items():
            more, less = (0.0 if words is None else checkout.seconds(words) for words in (row.more, row.less))
            spent[name].append((more - less) / row.units)
    return {name: float(np.median(values)) for name, values in spent.items()}


def reproduce(words: list[str]) -> None:
    options = parser(__doc__, assets=False, out=False)
    options.add_argument("--profile", default="smoke")
    arguments = options.parse_args(words)
    if not DVC.exists():
        raise SystemExit("DVC is not installed: make dvc")
    with tempfile.TemporaryDirectory() as temporary:
        copy, before, began, load = Path(temporary), cpu_seconds(), time.monotonic(), load_average()
        for part in PIPELINE:
            (copy / part).parent.mkdir(parents=True, exist_ok=True)
            shutil.copytree(ROOT / part, copy / part) if (ROOT / part).is_dir() else shutil.copy(
                ROOT / part, copy / part
            )
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        environment = {**os.environ, "PYTHONPATH": temporary, "PATH": path}
        for command in ([sys.executable, "-m", "pipelines.profile", arguments.profile], [str(DVC), "repro"]):
            subprocess.run(command, cwd=copy, env=environment, check=True, stdout=sys.stderr)
        stages = read_result(copy / "runs" / arguments.profile / "tables" / "stages.json", "stages")["stages"]
    figures = {
        "profile": arguments.profile,
        "cpu_seconds": round(cpu_seconds() - before),
        "seconds": round(time.monotonic() - began),
        "commands": len(stages),
        "stages": in_kinds({name: stage["cpu_seconds"] for name, stage in stages.items()}),
        "load_average_before": load,
    }
    print(json.dumps(finish("reproduce", arguments, figures, seed=0), indent=1))


def in_kinds(stages: dict[str, float]) -> dict[str, float]:
    """Seconds of stages by the folder that they write into."""
    kinds: dict[str, float] = {}
    for name, seconds in stages.items():
        kind = "features" if name.endswith(".features") else name.split("/")[0]
        kinds[kind] = round(kinds.get(kind, 0) + seconds, 1)
    return kinds


def main(words: list[str]) -> None:
    options = parser(__doc__, assets=False, out=False)
    options.add_argument("--checkout", action="append", required=True, help="NAME=FOLDER of a repository; repeatable")
    options.add_argument("--repeat", type=int, default=3)
    arguments = options.parse_args(words)
    pairs = list(named(arguments.checkout, "--checkout").items())
    rows: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as temporary:
        checkouts = {name: Checkout(Path(folder).resolve(), Path(temporary) / name) for name, folder in pairs}
        for checkout in checkouts.values():
            checkout.work.mkdir()
            checkout.prepare()
        torch_with(1)
        product = product_seconds(20)
        for name, row in ROWS.items():
            seconds = measure(row, checkouts, arguments.repeat)
            products = {checkout: round(spent / product, 2) for checkout, spent in seconds.items()}
            first, last = seconds[pairs[0][0]], seconds[pairs[-1][0]]
            rows[name] = {**products, "ratio": round(last / first, 3)}
            print(f"{name}: {rows[name]}", file=sys.stderr, flush=True)
    figures: dict[str, Any] = {
        "unit": f"products of two {PRODUCT_SIDE} x {PRODUCT_SIDE} matrices of float32, one thread",
        "product_milliseconds": round(1000 * product, 2),
        "commits": {name: checkout.commit for name, checkout in checkouts.items()},
        "rows": rows,
    }
    print(json.dumps(finish("waiting", arguments, figures, seed=int(SEED)), indent=1))


if __name__ == "__main__":
    one_of(main, reproduce=reproduce)
