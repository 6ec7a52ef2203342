"""Options, child commands, their cost, and result files: the parts that all benchmarks share."""

import argparse
import json
import os
import re
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import psutil

from busybot.common.atomic_io import read_json, write_json
from busybot.common.errors import BusybotError, UsageError, naming_extras
from busybot.evaluation.folder import OTHER_CODE
from busybot.evaluation.results import KINDS, of_this_code, read_result, stamp, write_result

BUSYBOT = (sys.executable, "-m", "busybot")
PRODUCT_SIDE = 1024
"""Of the matrices whose product tells how fast a processor is."""
Benchmark = Callable[[list[str]], None]
"""Runs with the words of a command line."""


def one_of(usual: Benchmark, **others: Benchmark) -> None:
    """Run the benchmark of a module that the first word of the command line names, else the usual one.

    Wrong input and wrong words are told as `busybot` tells them: the fault and a hint, exit code 1 or 2.
    """
    words = sys.argv[1:]
    named = others.get(words[0].replace("-", "_")) if words else None
    try:
        with naming_extras():
            if named:
                named(words[1:])
            else:
                usual(words)
    except BusybotError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2 if isinstance(error, UsageError) else 1)
    except KeyboardInterrupt:
        sys.exit(130)


def parser(description: str | None, assets: bool = True, out: bool | None = True) -> argparse.ArgumentParser:
    """A command line with the options that benchmarks have alike.

    Args:
        description: the module's docstring.
        assets: whether it takes objects, by default procedural ones.
        out: whether it has to be told a file for the result; otherwise the result is printed, too; None for no result.
    """
    made = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    if assets:
        made.add_argument("--assets", default="procedural", help="`procedural`, or a folder of objects")
    if out is not None:
        made.add_argument("--out", type=Path, required=out, help="file for the result")
    return made


def finish(
    kind: str,
    arguments: argparse.Namespace,
    figures: dict[str, Any],
    versions: dict[str, str] | None = None,
    hashes: dict[str, dict[str, Any]] | None = None,
    machine: dict[str, Any] | None = None,
    seed: int | None = None,
) -> dict[str, Any]:
    """Put what every result has before the figures, write it to `--out` if that is given, and return it.

    A file that gets its rows one after the other says of each by which commit and on which machine it was made, under
    `made`: rows that stand there already keep what was said of them.

    Args:
        machine: what is to be told of it beside what is told of all.
        seed: of what was drawn, if `--seed` does not tell it.
    """
    drawn = getattr(arguments, "seed", seed)
    told = stamp(kind, command=typed(kind, arguments), seed=drawn, versions=versions, hashes=hashes)
    told["machine"] |= machine or {}
    result = {**told, **figures}
    if arguments.out:
        if isinstance(figures.get("rows"), dict):
            before = read_result(arguments.out, kind) if arguments.out.exists() else {}
            result = {**told, "made": made(before, result), **figures}
        write_result(arguments.out, result)
    return result


def typed(kind: str, arguments: argparse.Namespace) -> str:
    """The command as it was typed, with names for places of this machine."""
    words = [KINDS[kind].split(" --")[0]]
    for name, value in vars(arguments).items():
        if value is None or value is False or value == [] or callable(value):
            continue
        values = value if isinstance(value, list | tuple) else [value]
        told = [] if value is True else [_without_place(name, one) for one in values]
        words.append(" ".join([f"--{name.replace('_', '-')}", *told]))
    return " ".join(words)


def _without_place(option: str, value: Any) -> str:
    """`event=/some/folder` is told as `event=FOLDER`, a file or folder by its option's name."""
    name, given, place = str(value).partition("=")
    if isinstance(value, Path) or "/" in name:
        return option.upper()
    return f"{name}=FOLDER" if given and "/" in place else str(value)


def timed(work: Callable[[], object], times: int, warm_up: int = 1, label: str = "") -> tuple[list[float], list[float]]:
    """Wall and CPU seconds of each time that the work is done; the first `warm_up` times do not count."""
    wall, cpu = [], []
    for number in range(warm_up + times):
        began, began_cpu = time.perf_counter(), time.process_time()
        work()
        wall.append(time.perf_counter() - began)
        cpu.append(time.process_time() - began_cpu)
        if label:
            print(f"{label}: {number + 1 - warm_up} of {times}, {wall[-1]:.2f} s", file=sys.stderr, flush=True)
    return wall[warm_up:], cpu[warm_up:]


def product_seconds(times: int, bfloat16: bool = False) -> float:
    """Median processor seconds of one product of two matrices of `PRODUCT_SIDE`, by as many threads as PyTorch has."""
    import torch

    left, right = torch.randn(2, PRODUCT_SIDE, PRODUCT_SIDE, dtype=torch.bfloat16 if bfloat16 else torch.float32)
    return statistics.median(timed(lambda: left @ right, times)[1])


def cpu_seconds() -> float:
    """Of this process and of those that it started and that have ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def peak_mb() -> int:
    """The most memory that this process had."""
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6)  # the system tells KiB


def load_average() -> list[float]:
    """What else the machine does."""
    return [round(load, 1) for load in os.getloadavg()]


def torch_with(threads: int) -> dict[str, Any]:
    """Give PyTorch so many threads; what a result tells of them and of the device."""
    import torch

    from busybot.training.device import device

    torch.set_num_threads(threads)
    return {"threads": threads, "device": torch.cuda.get_device_name() if device().type == "cuda" else "cpu"}


def busybot(*arguments: str) -> dict[str, Any]:
    """Run a command with --json and return what it printed; its progress goes on being shown.

    Raises:
        BusybotError: the command failed; with the last lines of what it said.
    """
    command = [*BUSYBOT, *arguments, "--json"]
    said: deque[str] = deque(maxlen=5)
    with (
        tempfile.TemporaryFile("w+") as out,  # a pipe that nobody reads meanwhile would fill up
        subprocess.Popen(command, stdout=out, stderr=subprocess.PIPE, text=True) as process,
    ):
        assert process.stderr is not None
        for line in process.stderr:
            print(line, end="", file=sys.stderr, flush=True)
            said.append(line.strip())
        process.wait()
        out.seek(0)
        printed = out.read()
    if process.returncode:
        raise BusybotError(f"busybot {arguments[0]}: {' '.join(said)}")
    return dict(json.loads(printed))


def option(name: str, value: Any) -> tuple[str, ...]:
    """The words of an option, none if nothing was given for it."""
    return (name, str(value)) if value else ()


def settings(*values: str) -> tuple[str, ...]:
    """Options that set parameters."""
    return tuple(word for value in values for word in ("--set", value))


def generating(folder: Path, split: str, boards: int, seed: int, assets: str | Path) -> tuple[str, ...]:
    """The command that makes boards with an appearance each; it refuses others that are there already."""
    drawn = ("--split", split, "--boards", str(boards), "--seed", str(seed), "--group-size", "1")
    return ("generate", str(folder), *drawn, "--assets", str(assets))


def kill_when(process: subprocess.Popen[bytes], due: Callable[[], bool], every_seconds: float) -> bool:
    """Kill the leader of a session with all its processes as soon as that is due; False if it ended before."""
    while process.poll() is None and not due():
        time.sleep(every_seconds)
    if process.poll() is not None:
        return False
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    return True


def train(out: Path, *arguments: str) -> dict[str, Any]:
    """Run a training into `out`, or continue it, or find it done; returns what it tells.

    The key `cost` is added: wall time and memory, None if something interrupted the training.
    """
    fresh, note = not out.exists(), out.with_suffix(".cost.json")
    with Cost() as cost:
        told = busybot(*arguments)
    if fresh:
        write_json(note, {"seconds": round(cost.seconds), "megabytes": round(cost.megabytes)})
    told["cost"] = read_json(note) if note.exists() else None
    return told


class Cost:
    """Wall time and memory of the processes below this one, while it is entered."""

    def __enter__(self) -> "Cost":
        self.began, self.megabytes, self._over = time.monotonic(), 0.0, threading.Event()
        self._watch = threading.Thread(target=self._sample, daemon=True)
        self._watch.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._watch.join()
        self.seconds = time.monotonic() - self.began

    def _sample(self) -> None:
        while not self._over.wait(2):
            below = psutil.Process().children(recursive=True)
            self.megabytes = max(self.megabytes, sum(_private(process.pid) for process in below))


def _private(pid: int) -> float:
    """Memory that no file backs, MB (the system tells KiB); pages shared by processes are divided among them."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0.0  # it has just ended
    return sum(int(line.split()[1]) for line in lines if line.startswith(("Pss_Anon", "Pss_Shmem"))) * 1024 / 1e6


def named(given: Iterable[str], option: str) -> dict[str, str]:
    """What words like `NAME=FOLDER` name, by name.

    Raises:
        UsageError: one has no name, or names nothing, or two have one name.
    """
    found: dict[str, str] = {}
    for word in given:
        name, _, value = word.partition("=")
        if not name or not value or name in found:
            fault = "a second one of this name" if name in found else "not of the form NAME=FOLDER"
            raise UsageError(f"{option} {word}: {fault}", "give each a name of its own, and what it is")
        found[name] = value
    return found


def chosen(names: str, known: Iterable[str]) -> list[str]:
    """Names from a comma-separated option; all are checked before hours are spent on the first.

    Raises:
        SystemExit: there is no such name.
    """
    listed, there = names.split(","), list(known)
    if unknown := [name for name in listed if name not in there]:
        raise SystemExit(f"there is no {', '.join(unknown)}; choose among {', '.join(there)}")
    return listed


def earlier(file: Path) -> dict[str, Any] | None:
    """What an evaluation wrote before, or None.

    Raises:
        BusybotError: another version of busybot wrote it; a table has figures of one.
    """
    known = read_json(file) if file.exists() else None
    if known is not None and not of_this_code(known):
        raise BusybotError(f"{file}: {OTHER_CODE}", "name another --work folder")
    return known


def assets_name(assets: str) -> str:
    """What a result calls the objects: never where they lie."""
    return "procedural" if assets == "procedural" else Path(assets).name


def made(before: dict[str, Any], result: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Commit and machine of every row by its name, of a part that came or changed later by `ROW/PART`.

    What stands in `before` is as old as that says; of files that do not say it, nothing is told of what they had.
    """
    old, rows = before.get("rows", {}), json.loads(json.dumps(result["rows"]))
    fresh = [place for name, row in rows.items() for place in _fresh(name, old.get(name), row)]
    kept = {
        place: told
        for place, told in before.get("made", {}).items()
        if any(within(place, row) for row in rows) and not any(within(place, one) for one in fresh)
    }
    return kept | dict.fromkeys(fresh, {key: result[key] for key in ("commit", "machine")})


def within(place: str, other: str) -> bool:
    """Whether it is that place or a part of it; names of rows may hold a slash, too."""
    return f"{place}/".startswith(f"{other}/")


def _fresh(name: str, old: Any, new: Any) -> list[str]:
    """Which parts of a row were not there before, or were others; the row itself if it lost one."""
    if old == new:
        return []
    if not (isinstance(old, dict) and isinstance(new, dict) and old.keys() <= new.keys()):
        return [name]
    return [f"{name}/{part}" for part, value in new.items() if part not in old or value != old[part]]


def told_rows(out: Path, kind: str, **about: Any) -> dict[str, Any]:
    """The rows that a result file has already.

    Args:
        about: what the file has to say of itself, where it says it: new rows stand beside the old ones.

    Raises:
        UsageError: it says something else.
    """
    told = read_result(out, kind) if out.exists() else {"rows": {}}
    if told["rows"] and (others := [name for name, value in about.items() if told.get(name, value) != value]):
        raise UsageError(f"{out}: its rows are about other {' and '.join(others)}", "name another file")
    return dict(told["rows"])


def hashes_beside(out: Path, kind: str, of: str, found: dict[str, Any]) -> dict[str, Any]:
    """Hashes of models or data by name, with those that rows of a result file are about that stay there.

    Raises:
        UsageError: there is another one of the same name.
    """
    earlier = read_result(out, kind)["hashes"][of] if out.exists() else {}
    if others := [name for name, one in found.items() if earlier.get(name, one) != one]:
        raise UsageError(f"{out}: it has rows about another {others[0]}", "name another file")
    return {**earlier, **found}


def as_typed(command: tuple[str, ...], places: dict[str, str]) -> str:
    """A command as a reader types it, with names for places of this machine; `procedural` is none, everybody has it."""
    line = "busybot " + " ".join(command)
    for place, name in places.items():
        if place != "procedural":  # a whole path or its beginning, and not an agent's name, as in bc=bc
            line = re.sub(rf"(?<![\w/.-]){re.escape(place)}(?![\w=.-])", name, line)
    return line
