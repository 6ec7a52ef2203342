"""Goes the way of a training on a machine with a GPU, at a small size on this one: so that only the GPU is missing.

    python -m benchmarks.gpu.rehearse --data TRAIN... --judge SET... --config FILE --work FOLDER --out FILE

The commands of `benchmarks.gpu` run as they are typed: `pack` with the recorded boards of `--data`; `train`, in calls
of so many minutes, so that it is cut off and goes on; `unpack`. The model that comes out is judged by `busybot eval
reason` on the datasets of `--judge`. What is told is what travels, how long an iteration takes, and what so short a
training is good for. The same command goes on where it was stopped.
"""

import argparse
import subprocess
import sys
from pathlib import Path
from typing import Any

from benchmarks import runner
from benchmarks.gpu.formats import METRICS, PACK, RUN, RunInfo, read_pack_info
from benchmarks.tables.table2 import DETAILS, SCORES, SLOW
from busybot.common.atomic_io import read_json, sha256_of, write_json
from busybot.common.errors import BusybotError
from busybot.training.run_folder import losses, read_metrics

LOSSES = 20
"""How many are told of the whole course."""


def call(module: str, *words: str) -> None:
    """Run a command of this package.

    Raises:
        SystemExit: it failed; it has said why.
    """
    if code := subprocess.run([sys.executable, "-m", f"benchmarks.gpu.{module}", *words]).returncode:
        sys.exit(code)


def trained(pack: Path, back: Path, arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Train to the end; what is told after each call, of earlier runs of this command, too."""
    note = arguments.work / "calls.json"
    there = ("--pack", str(pack), "--row", arguments.row, "--work", str(arguments.work / "there"), "--out", str(back))
    calls: list[dict[str, Any]] = read_json(note) if note.exists() else []
    while not calls or calls[-1]["iterations"] < calls[-1]["schedule"]:
        minutes = arguments.minutes * (len(calls) + 1)
        call("train", *there, "--minutes", str(minutes), "--checkpoint", "20", "--half", "--device", "cpu")
        told = RunInfo.model_validate(read_json(back / RUN))
        calls.append({"minutes": minutes, **{key: getattr(told, key) for key in ("iterations", "schedule", "seconds")}})
        write_json(note, calls)
    return calls


def course(file: Path) -> list[dict[str, float]]:
    """Means of the losses over equal parts of the iterations, in their order."""
    found = [(iteration, loss) for iteration, loss in losses(read_metrics(file)) if loss is not None]
    each = -(-len(found) // LOSSES)
    parts = [found[start : start + each] for start in range(0, len(found), each)]
    return [{"until": part[-1][0], "loss": sum(loss for _, loss in part) / len(part)} for part in parts]


def bytes_of(folder: Path) -> dict[str, int]:
    """Sizes of what travels, by file."""
    return {str(file.relative_to(folder)): file.stat().st_size for file in sorted(folder.rglob("*")) if file.is_file()}


def main(words: list[str]) -> None:
    options = runner.parser(__doc__, assets=False)
    options.add_argument("--data", type=Path, nargs="+", required=True, help="recorded datasets to train on")
    options.add_argument("--judge", type=Path, nargs="+", default=[], help="recorded datasets to judge the model on")
    options.add_argument("--assets", help="objects, if they are not found by their hashes")
    options.add_argument("--row", default="paper", help="of Table 2")
    options.add_argument("--config", type=Path, required=True, help="YAML file that makes the training small")
    options.add_argument("--minutes", type=float, default=9.0, help="of training in one call")
    options.add_argument("--work", type=Path, required=True, help="for everything; continued if it exists")
    arguments = options.parse_args(words)
    asked = {
        "data": [str(path) for path in arguments.data],
        "row": arguments.row,
        "config": sha256_of(arguments.config),
    }
    note = arguments.work / "asked.json"
    if note.exists() and read_json(note) != asked:
        raise BusybotError(f"{arguments.work}: another rehearsal was begun there", "name another folder")
    write_json(note, asked)
    pack, back, model = (arguments.work / name for name in ("pack", "back", "model"))
    if not (pack / PACK).exists():
        data = [str(path) for path in arguments.data]
        call("pack", "--data", *data, "--rows", arguments.row, "--config", str(arguments.config), "--out", str(pack))
    calls = trained(pack, back, arguments)
    if not model.exists():
        call("unpack", "--pack", str(pack), "--run", str(back), "--out", str(model))
    told, digest = read_pack_info(pack)
    run = RunInfo.model_validate(read_json(back / RUN))
    judged = {}
    for dataset in arguments.judge:
        found = ("--assets", arguments.assets) if arguments.assets else ()
        answer = runner.busybot("eval", "reason", str(dataset), "--reasoner", str(model), *SLOW, *found)
        judged[answer["dataset"]["split"]] = {key: answer[key] for key in (*SCORES, *DETAILS)}
    figures = {
        "pack": {**told.model_dump(mode="json"), "sha256": digest, "bytes": bytes_of(pack)},
        "run": {**run.model_dump(mode="json"), "bytes": bytes_of(back)},
        "calls": calls,
        "losses": course(back / METRICS),
        "judged": judged,
    }
    origins = {f"{number}: {one.get('name')}": one for number, one in enumerate(told.data)}
    runner.finish("gpu-rehearsal", arguments, figures, seed=run.seed, hashes={"models": run.files, "data": origins})


if __name__ == "__main__":
    runner.one_of(main)
