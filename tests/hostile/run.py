"""Damaged and malicious copies of every kind of file, each read with limited memory and time.

    python -m tests.hostile.run [--cases 500] [--only mcap,urdf] [--out benchmarks/results/hostile.json]

The result is written after each kind. One that is there keeps the rows of kinds that are not asked for; each row tells
the commit that it was made at. What was stopped goes on with `--resume`: rows of this commit with as many cases stay.

A copy passes if reading it ends in an error of ours that names the file, or if the answer is the same as for the
undamaged file (or, where a change can be valid, is another valid one). Anything else is a finding: a traceback, a
crash, a hang, too much memory, a file written elsewhere, a wrong answer.
"""

import argparse
import json
import os
import resource
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.evaluation.results import KINDS, read_result, stamp, write_result
from tests.hostile.containers import CONTAINERS
from tests.hostile.damage import damage
from tests.hostile.doors import DOORS
from tests.hostile.lerobot import LEROBOT
from tests.hostile.places import PLACES
from tests.hostile.targets import NOTICED, TARGETS, Target, exchange

KINDS_OF_FILES = TARGETS | DOORS | CONTAINERS | LEROBOT | PLACES
MEGABYTES = 1500
"""So much more memory than the process had before may the reading of a copy take."""


def child(name: str, first: int, cases: int, scratch: Path) -> None:
    """Read the copies from `first` on, one line of JSON each."""
    target, pristine, outside = KINDS_OF_FILES[name], scratch / "pristine", scratch / "work"
    if not pristine.exists():
        pristine.mkdir(parents=True)
        target.make(pristine)
    outside.mkdir(exist_ok=True)
    os.chdir(outside)
    expected = target.read(pristine)
    status = dict(line.split(":\t", 1) for line in Path("/proc/self/status").read_text().splitlines())
    limit = int(status["VmData"].split()[0]) * 1024 + MEGABYTES * 1_000_000
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
    for number in range(first, cases):
        print(json.dumps(one(name, target, number, pristine, outside, expected)), flush=True)


def one(name: str, target: Target, number: int, pristine: Path, outside: Path, expected: Any) -> dict[str, Any]:
    """One damaged copy; `finding` is None if it passes."""
    folder = outside / "copy"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(pristine, folder)
    rng = generator(0, "hostile", number, name)
    if target.ways:
        files = sorted(path for path in folder.glob(target.files) if path.is_file())
        file = files[int(rng.integers(len(files)))]
        before = file.read_bytes()
        what = damage(file, target.ways, rng)
        unchanged = (
            file.is_file() and not file.is_symlink() and file.stat().st_size < 1e9 and file.read_bytes() == before
        )
    else:
        (file, what), unchanged = (target.spoil or exchange)(folder, rng), False
    result, finding = read(target, folder, file, expected, unchanged)
    if {path.name for path in outside.iterdir()} != {"copy"}:
        finding = f"it wrote elsewhere: {sorted(path.name for path in outside.iterdir())}"
        shutil.rmtree(outside / "pickle-was-run", ignore_errors=True)
    return {"number": number, "damage": what, "file": file.name, "result": result, "finding": finding}


def read(target: Target, folder: Path, file: Path, expected: Any, unchanged: bool) -> tuple[str, str | None]:
    """How reading ended, and what is wrong with that."""
    try:
        answer = target.read(folder)
    except BusybotError as error:
        if file.name not in error.what:
            said = error.what.replace(str(folder), folder.name)
            return "refused", f"the error does not name {file.name}: {said[:200]}"
        return "refused", None if len(error.what) < 2000 else "an endless message"
    except BaseException as error:
        return "raised", f"{type(error).__name__}: {str(error)[:200]}"
    if isinstance(answer, str) and answer == NOTICED:
        return "noticed", None
    same = bool(answer == expected)
    if same:
        return "same answer", None
    return "another answer", "a wrong answer" if target.strict and not unchanged else None


def parent(name: str, cases: int) -> dict[str, Any]:
    """Run a kind's copies in a process of its own; if that dies or hangs it is a finding, and a new one goes on."""
    lines: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(prefix="busybot-hostile-") as scratch:
        while len(lines) < cases:
            command = [sys.executable, "-m", "tests.hostile.run", "--child", name, "--first", str(len(lines))]
            command += ["--cases", str(cases), "--scratch", scratch]
            environment = dict(os.environ, OMP_NUM_THREADS="1")
            with (
                tempfile.TemporaryFile() as said,  # a pipe that nobody empties would stop who writes much
                subprocess.Popen(command, stdout=subprocess.PIPE, stderr=said, env=environment) as process,
            ):
                lines += _follow(process, said, (len(lines), cases), KINDS_OF_FILES[name].seconds)
    findings = [line for line in lines if line["finding"]]
    return {"cases": cases, "results": dict(Counter(line["result"] for line in lines)), "findings": findings}


def _follow(process: Any, said: Any, numbers: tuple[int, int], seconds: float) -> list[dict[str, Any]]:
    (done, cases), lines = numbers, list[dict[str, Any]]()
    patience = 4 * seconds  # for the start
    while done + len(lines) < cases:
        answered = _answers(process, patience)
        text = process.stdout.readline() if answered else b""
        if not text:
            process.kill()
            process.wait()
            said.seek(0)
            last = said.read().decode(errors="replace")[-300:]
            finding = f"the process died: {last}" if answered else f"no end after {seconds:g} s"
            lines.append({"number": done + len(lines), "result": "lost", "finding": finding})
            return lines
        lines.append(json.loads(text))
        patience = seconds
    return lines


def _answers(process: Any, seconds: float) -> bool:
    """Whether it says something before it has run, or slept, so long."""
    start, before = time.monotonic(), _queued(process.pid)
    while not select.select([process.stdout], [], [], 1.0)[0]:
        if time.monotonic() - start - max(0.0, _queued(process.pid) - before) > seconds:
            return False
    return True


def _queued(process: int) -> float:
    """Seconds that a process and its children have waited for a processor."""
    try:
        children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
        own = int(Path(f"/proc/{process}/schedstat").read_text().split()[1]) / 1e9
    except OSError:  # it has ended
        return 0.0
    return own + sum(_queued(int(child)) for child in children)


def with_others(before: dict[str, Any], kinds: dict[str, Any]) -> dict[str, Any]:
    """These kinds and those of an earlier result, in the order of all kinds."""
    others = {name: {"commit": before["commit"], **kind} for name, kind in before["kinds"].items()}
    return {name: (others | kinds)[name] for name in KINDS_OF_FILES if name in others | kinds}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=500, help="of each kind")
    parser.add_argument("--only", help="kinds, separated by commas")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--resume", action="store_true", help="keep rows of --out that this command has made")
    for hidden in ("--child", "--first", "--scratch"):
        parser.add_argument(hidden, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        child(arguments.child, int(arguments.first), arguments.cases, Path(arguments.scratch))
        return 0
    there = arguments.out is not None and arguments.out.exists()
    before = read_result(arguments.out, "hostile") if there else {"kinds": {}}
    merged = bool(arguments.only and there)
    command = f"{KINDS['hostile']} --cases {arguments.cases}"
    command += f" --only {arguments.only}" if arguments.only and not merged else ""
    head = stamp("hostile", command=command)
    kinds: dict[str, Any] = {}
    for name in arguments.only.split(",") if arguments.only else list(KINDS_OF_FILES):
        kind, old = KINDS_OF_FILES[name], before["kinds"].get(name, {})
        cases = -(-arguments.cases // kind.every)
        made = {"class": kind.line, "commit": head["commit"], "cases": cases}
        if arguments.resume and old.items() >= made.items():
            kinds[name] = old
            continue
        start = time.monotonic()
        kinds[name] = made | parent(name, cases)
        told = f"{kinds[name]['results']} {len(kinds[name]['findings'])} findings, {time.monotonic() - start:.0f} s"
        print(name, told, file=sys.stderr, flush=True)
        if arguments.out:
            told_kinds = with_others(before, kinds) if merged or arguments.resume else kinds
            write_result(arguments.out, {**head, "cases": arguments.cases, "kinds": told_kinds})
    if not arguments.out:
        print(json.dumps({**head, "cases": arguments.cases, "kinds": kinds}, indent=1))
    return int(any(kind["findings"] for kind in kinds.values()))


if __name__ == "__main__":
    sys.exit(main())
