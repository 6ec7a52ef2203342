"""What a seed of the `mechanism` model costs from nothing: recordings, training, its row in the table of worlds.

    python -m benchmarks.speed.world_row --assets DIR --policy MODEL --reasoner MODEL --work FOLDER
        --out benchmarks/results/world-row.json [--only gates,time] [--boards 60] [--iterations 5000] [--drawn 600]
        [--seed 0]

Three commands, each told with its time by the clock, its processor time and its memory: boards of each world are
generated and acted on, to train on and to judge on; the model is trained as the one that ships was; it is judged, once
told the world and once not. Features of pictures are computed once, by the first that reads them. Of three boards that
are trained on, the interaction policy acts on one, and an earlier model of relations chooses among its candidates on
another; both are trainings' folders that all seeds share, and their own trainings are not counted.

A command that was interrupted goes on, and is not timed; one that is done is not run again.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks import runner
from benchmarks.tables.worlds import NAMES
from busybot.common.atomic_io import read_json, sha256_of, write_json
from busybot.training.model_cards import WEIGHTS_FILE

KIND = "world-row"
TABLE = "benchmarks.tables.worlds"
SETS = ("training", "explored", "chosen")
"""Recordings that are trained on, as the model that ships was."""


def commands(options: argparse.Namespace) -> dict[str, list[str]]:
    """Words for Python, by what they do."""
    data, model = options.work / "data", options.work / "model"
    worlds = runner.chosen(options.only, NAMES) if options.only else list(NAMES)
    boards = ["--data", data, "--assets", options.assets, "--only", ",".join(worlds)]
    sets = [data / world / name for world in worlds for name in SETS]
    told = [word for folder in sets for word in ("--data", folder)]
    train = ["busybot", "train", "reason", "--variant", "mechanism", *told, "--seed", options.seed, "--out", model]
    row = ["--parts", "learned", "--boards", options.boards, "--model", model, "--out", options.work / "row.json"]
    made = {
        "record": [
            *(TABLE, "record", *boards, "--sets", ",".join((*SETS, "validation")), "--most", options.boards),
            *("--policy", options.policy, "--reasoner", options.reasoner),
        ],
        "train": [*train, *runner.settings(f"iterations={options.iterations}", f"drawn={options.drawn}")],
        "judge": [TABLE, *boards, *row],
    }
    return {name: [str(word) for word in words] for name, words in made.items()}


def cost(name: str, words: list[str], work: Path) -> dict[str, Any] | None:
    """Run a command, or find it done; what it cost, None if something interrupted it.

    Raises:
        SystemExit: it failed, or another one was begun there.
    """
    begun, note = work / f"{name}.begun.json", work / f"{name}.cost.json"
    fresh = not begun.exists()
    if fresh:
        write_json(begun, words)
    elif read_json(begun) != words:
        raise SystemExit(f"{begun}: another command was begun here; name another folder with --work")
    if note.exists():
        return dict(read_json(note)) or None
    before = runner.cpu_seconds()
    with runner.Cost() as spent:
        code = subprocess.run([sys.executable, "-m", *words], check=False).returncode
    if code:
        raise SystemExit(f"{name}: exit code {code}")
    told = {
        "minutes": round(spent.seconds / 60, 1),
        "cpu_minutes": round((runner.cpu_seconds() - before) / 60, 1),
        "megabytes": round(spent.megabytes),
    }
    write_json(note, told if fresh else {})
    return told if fresh else None


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """All of them in their order."""
    options.work.mkdir(parents=True, exist_ok=True)
    rows = {name: cost(name, words, options.work) for name, words in commands(options).items()}
    weights = sha256_of(options.work / "model" / "model" / WEIGHTS_FILE)
    cores = len(os.sched_getaffinity(0))
    return {"cores": cores, "load": runner.load_average(), "weights_sha256": weights, "rows": rows}


def main(words: Sequence[str] | None = None) -> None:
    options = runner.parser(__doc__)
    options.add_argument("--work", type=Path, required=True, help="of all that is made; continued if it exists")
    options.add_argument("--policy", required=True, help="a training of the interaction policy")
    options.add_argument("--reasoner", required=True, help="one of the model of relations, which chooses actions")
    options.add_argument("--only", help="names of worlds, comma-separated; all by default")
    options.add_argument("--boards", type=int, default=60, help="of each world, to train on and to judge on")
    options.add_argument("--iterations", type=int, default=5000)
    options.add_argument("--drawn", type=int, default=600, help="boards of each world that are drawn to train on")
    options.add_argument("--seed", type=int, default=0, help="of the training")
    arguments = options.parse_args(words)
    runner.finish(KIND, arguments, measure(arguments))


if __name__ == "__main__":
    runner.one_of(main)
