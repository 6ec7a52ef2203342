"""Measures what the checks of files of strangers cost: the same data, opened by another version and by this one.

    git worktree add ../before 4e95f0f
    python -m benchmarks.speed.opening --before ../before [--rounds 7] --out FILE

`--before` is a checkout of this repository, by default meant as the last version without budgets and checksums. Both
open copies of `datasets/tiny`, whose tables each version has written itself, in turn and in processes of their own.
Told is the median of processor time over rounds, and the ratio of both.
"""

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.runner import finish, one_of, parser

ROOT = Path(__file__).resolve().parents[2]
REPEATS = 10
MEASURE = """
import json, sys, time
from pathlib import Path
from busybot.datasets.dataset import Dataset
from busybot.datasets.summary import summarise
from busybot.episodes.mcap.reader import read_episode

loose, frozen = map(Path, sys.argv[1:3])
if not (loose / "tables").exists():
    Dataset.open(loose).write_tables()
files = sorted((loose / "episodes").glob("*.mcap"))
ways = {
    "recording": lambda: [read_episode(file, "lazy") for file in files],
    "recording with its pictures": lambda: [read_episode(file) for file in files],
    "table of steps": lambda: Dataset.open(loose).table("steps"),
    "info": lambda: summarise(loose),
    "info, frozen": lambda: summarise(frozen),
}
told = {}
for name, way in ways.items():
    way()
    began = time.process_time()
    for _ in range(REPEATS):
        way()
    told[name] = (time.process_time() - began) / REPEATS / (len(files) if name.startswith("recording") else 1)
print(json.dumps(told))
"""
"""Run by each version; both have had these names since before the checks."""


def main(words: list[str] | None = None) -> None:
    options = parser(__doc__, assets=False)
    options.add_argument("--before", type=Path, required=True, help="a checkout of the other version")
    options.add_argument("--rounds", type=int, default=7)
    arguments = options.parse_args(words)
    with tempfile.TemporaryDirectory(prefix="busybot-opening-") as scratch:
        figures = measured(arguments, Path(scratch))
    finish("opening", arguments, figures)
    print(json.dumps(figures, indent=1))


def measured(arguments: argparse.Namespace, scratch: Path) -> dict[str, Any]:
    """Seconds of each way to open, before and after, and their ratio."""
    trees = {"before": arguments.before.resolve(), "after": ROOT}
    rounds: dict[str, list[dict[str, float]]] = {name: [] for name in trees}
    for name in trees:
        for copy in ("loose", "frozen"):
            shutil.copytree(ROOT / "datasets" / "tiny", scratch / name / copy, copy_function=shutil.copyfile)
        shutil.rmtree(scratch / name / "loose" / "tables")
        (scratch / name / "loose" / "manifest.json").unlink()
    for _ in range(arguments.rounds):
        for name, tree in trees.items():
            places = [str(scratch / name / copy) for copy in ("loose", "frozen")]
            command = [sys.executable, "-c", MEASURE.replace("REPEATS", str(REPEATS)), *places]
            environment = dict(os.environ, PYTHONPATH=str(tree), OMP_NUM_THREADS="1")
            done = subprocess.run(command, check=True, capture_output=True, text=True, cwd=tree, env=environment)
            rounds[name].append(json.loads(done.stdout))
    ways = {}
    for way in rounds["after"][0]:
        before, after = (statistics.median(told[way] for told in rounds[name]) for name in trees)
        ways[way] = {"before": before, "after": after, "ratio": after / before}
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=trees["before"], check=True, capture_output=True, text=True
    )
    return {"before": commit.stdout.strip(), "rounds": arguments.rounds, "ways": ways}


if __name__ == "__main__":
    one_of(main)
