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
import multiprocessing
import os
import sys
import tempfile
import time
from collections import Counter
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import Any

from busybot.evaluation.results import KINDS, read_result, stamp, write_result
from tests.hostile import reading
from tests.hostile.reading import KINDS_OF_FILES

PROCESSES = multiprocessing.get_context("forkserver")
PROCESSES.set_forkserver_preload([reading.__name__])  # what all of them import, six seconds' work, is imported once


def cases_of(name: str, usual: int) -> int:
    """How many copies of a kind there are, where there are so many of the usual ones: fewer of what takes long."""
    return -(-usual // KINDS_OF_FILES[name].every)


def parent(name: str, cases: int) -> dict[str, Any]:
    """Run a kind's copies in a process of its own; if that dies or hangs it is a finding, and a new one goes on."""
    lines: list[dict[str, Any]] = []
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    with tempfile.TemporaryDirectory(prefix="busybot-hostile-") as scratch:
        while len(lines) < cases:
            receiver, sender = PROCESSES.Pipe(duplex=False)
            process = PROCESSES.Process(target=reading.child, args=(name, len(lines), cases, Path(scratch), sender))
            process.start()
            sender.close()
            with receiver:
                numbers, seconds = (len(lines), cases), KINDS_OF_FILES[name].seconds
                lines += _follow(process, receiver, Path(scratch) / "said", numbers, seconds)
            process.join(seconds)
            process.kill()
            process.join()
    findings = [line for line in lines if line["finding"]]
    return {"cases": cases, "results": dict(Counter(line["result"] for line in lines)), "findings": findings}


def _follow(
    process: ForkServerProcess, told: Connection, said: Path, numbers: tuple[int, int], seconds: float
) -> list[dict[str, Any]]:
    (done, cases), lines = numbers, list[dict[str, Any]]()
    patience = 4 * seconds  # for the start
    while done + len(lines) < cases:
        answered = _answers(process.pid or 0, told, patience)
        try:
            text = told.recv_bytes() if answered else b""
        except EOFError:
            text = b""
        if not text:
            process.kill()
            last = said.read_bytes().decode(errors="replace")[-300:] if said.exists() else ""
            finding = f"the process died: {last}" if answered else f"no end after {seconds:g} s"
            lines.append({"number": done + len(lines), "result": "lost", "finding": finding})
            return lines
        lines.append(json.loads(text))
        patience = seconds
    return lines


def _answers(process: int, told: Connection, seconds: float) -> bool:
    """Whether it says something, or ends, before it has run, or slept, so long."""
    start, before = time.monotonic(), _queued(process)
    while not told.poll(1.0):
        if time.monotonic() - start - max(0.0, _queued(process) - before) > seconds:
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
    arguments = parser.parse_args()
    there = arguments.out is not None and arguments.out.exists()
    before = read_result(arguments.out, "hostile") if there else {"kinds": {}}
    merged = bool(arguments.only and there)
    command = f"{KINDS['hostile']} --cases {arguments.cases}"
    command += f" --only {arguments.only}" if arguments.only and not merged else ""
    head = stamp("hostile", command=command)
    kinds: dict[str, Any] = {}
    for name in arguments.only.split(",") if arguments.only else list(KINDS_OF_FILES):
        kind, old = KINDS_OF_FILES[name], before["kinds"].get(name, {})
        cases = cases_of(name, arguments.cases)
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
