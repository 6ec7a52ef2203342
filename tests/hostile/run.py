"""Damaged and malicious copies of every kind of file, each read with limited memory and time.

    python -m tests.hostile.run [--cases 500] [--only mcap,urdf] [--out benchmarks/results/hostile.json]

With `--only`, a result that is there keeps the rows of other kinds; each row tells the commit that it was made at.

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
from tests.hostile.targets import NOTICED, TARGETS, Target, exchange

KINDS_OF_FILES = TARGETS | DOORS | CONTAINERS | LEROBOT
SECONDS = 30.0
"""One copy may take so long."""
MEGABYTES = 1500
"""And so much more memory than the process had before."""


def child(name: str, first: int, cases: int, scratch: Path) -> None:
    """Read the copies from `first` on, one line of JSON each."""
    target, pristine, outside = KINDS_OF_FILES[name], scratch / "pristine", scratch / "work"
    if not pristine.exists():
        pristine.mkdir(parents=True)
        target.make(pristine)
    outside.mkdir(exist_ok=True)
    os.chdir(outside)
    expected = target.read(pristine)
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    limit = used + MEGABYTES * 1_000_000
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
        (file, what), unchanged = exchange(folder, rng), False
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


def parent(name: str, cases: int, seconds: float) -> dict[str, Any]:
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
                lines += _follow(process, said, (len(lines), cases), seconds)
    findings = [line for line in lines if line["finding"]]
    return {"cases": cases, "results": dict(Counter(line["result"] for line in lines)), "findings": findings}


def _follow(process: Any, said: Any, numbers: tuple[int, int], seconds: float) -> list[dict[str, Any]]:
    (done, cases), lines = numbers, list[dict[str, Any]]()
    patience = 4 * seconds  # for the start
    while done + len(lines) < cases:
        ready, _, _ = select.select([process.stdout], [], [], patience)
        text = process.stdout.readline() if ready else b""
        if not text:
            process.kill()
            process.wait()
            said.seek(0)
            last = said.read().decode(errors="replace")[-300:]
            finding = f"the process died: {last}" if ready else f"no end after {seconds:g} s"
            lines.append({"number": done + len(lines), "result": "lost", "finding": finding})
            return lines
        lines.append(json.loads(text))
        patience = seconds
    return lines


def with_others(before: dict[str, Any], kinds: dict[str, Any]) -> dict[str, Any]:
    """These kinds and those of an earlier result, in the order of all kinds."""
    others = {name: {"commit": before["commit"], **kind} for name, kind in before["kinds"].items()}
    return {name: (others | kinds)[name] for name in KINDS_OF_FILES if name in others | kinds}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=500, help="of each kind")
    parser.add_argument("--only", help="kinds, separated by commas")
    parser.add_argument("--out", type=Path)
    for hidden in ("--child", "--first", "--scratch"):
        parser.add_argument(hidden, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        child(arguments.child, int(arguments.first), arguments.cases, Path(arguments.scratch))
        return 0
    names = arguments.only.split(",") if arguments.only else list(KINDS_OF_FILES)
    kinds = {}
    for name in names:
        kind = KINDS_OF_FILES[name]
        kinds[name] = {"class": kind.line, **parent(name, -(-arguments.cases // kind.every), SECONDS)}
        print(name, kinds[name]["results"], f"{len(kinds[name]['findings'])} findings", file=sys.stderr, flush=True)
    command = f"{KINDS['hostile']} --cases {arguments.cases}"
    merged = arguments.only and arguments.out and arguments.out.exists()
    command += f" --only {arguments.only}" if arguments.only and not merged else ""
    head = stamp("hostile", command=command)
    kinds = {name: {**kind, "commit": head["commit"]} for name, kind in kinds.items()}
    if merged:
        kinds = with_others(read_result(arguments.out, "hostile"), kinds)
    result = {**head, "cases": arguments.cases, "kinds": kinds}
    if arguments.out:
        write_result(arguments.out, result)
    else:
        print(json.dumps(result, indent=1))
    return int(any(kind["findings"] for kind in kinds.values()))


if __name__ == "__main__":
    sys.exit(main())
