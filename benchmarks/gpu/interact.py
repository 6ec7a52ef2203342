"""Trains the paper's interaction networks on a machine with a GPU, for as long as it may take.

    python -m benchmarks.gpu.interact --assets OBJECTS --row paper --work WORK --out BACK --minutes 20

The schedule collects every epoch's boards with the networks of the epoch before, so the simulator has to be there, as
a wheel (`benchmarks.gpu.pack --simulator`); the objects travel as they are. What runs is `busybot train interact
--variant paper` with the row's options of Table 1: networks on the GPU, pictures on the cores. After `--minutes` it is
interrupted, as by Ctrl-C; the same command goes on in `--work`, to the weights of one that was not interrupted.

`--out` gets what travels, as of `benchmarks.gpu.train`: the networks as they are after the last whole epoch, in files
of at most `--file-mb`, what each iteration lost and each epoch earned, and what is to be known of the run. `python -m
benchmarks.gpu.unpack --run BACK --out MODEL` makes a model of it, which `busybot eval interact DATASET --model MODEL`
judges.
"""

import argparse
import json
import signal
import subprocess
import time
from itertools import pairwise
from pathlib import Path

from benchmarks import runner
from benchmarks.gpu.formats import RunInfo, write_run
from benchmarks.gpu.train import MB, used
from benchmarks.tables.table1 import ROWS
from busybot.common.atomic_io import read_json, write_json
from busybot.common.config import build
from busybot.common.device import choose
from busybot.common.errors import BusybotError
from busybot.evaluation.results import commit
from busybot.interact.affordance.fast import weights_file
from busybot.interact.affordance.networks import KINDS
from busybot.interact.policy.config import AffordanceInfo
from busybot.interact.training.config import PaperConfig
from busybot.training.checkpoint import load_tensors
from busybot.training.model_cards import read_info
from busybot.training.run_folder import learner_versions

PATIENCE_S = 120
"""For a training that was interrupted to end."""


def train(command: tuple[str, ...], minutes: float) -> None:
    """Run a training to its end, or for so long and interrupt it.

    Raises:
        BusybotError: it failed.
    """
    process = subprocess.Popen([*runner.BUSYBOT, *command])
    try:
        code = process.wait(60 * minutes)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGINT)
        process.wait(PATIENCE_S)
        return
    if code:
        raise BusybotError(f"busybot {' '.join(command[:2])} failed with code {code}; it has said why")


def networks(work: Path) -> Path:
    """The folder with the networks after the last whole epoch.

    Raises:
        BusybotError: nothing was learned yet.
    """
    for folder in (work / "model", work / "current"):
        if (folder / "model.json").exists():
            return folder
    raise BusybotError(
        f"{work}: no network was asked yet where to act, so there is none to bring back", "the same command goes on"
    )


def course(work: Path) -> bytes:
    """What iterations lost, with the network's name, and what epochs earned, a JSON object a line."""
    lines = []
    for name in (*KINDS, "epochs"):
        file = work / "metrics" / f"{name}.jsonl"
        if file.exists():
            lines += [{"of": name, **json.loads(line)} for line in file.read_text(encoding="utf-8").splitlines()]
    return "".join(f"{json.dumps(line)}\n" for line in lines).encode()


def bring_back(arguments: argparse.Namespace, config: PaperConfig, seconds: float) -> RunInfo:
    """Write what travels."""
    folder = networks(arguments.work)
    info = read_info(folder, AffordanceInfo)
    tensors = {
        f"{kind}/{name}": value
        for kind in KINDS
        for name, value in load_tensors(weights_file(folder, kind)).tensors.items()
    }
    card = info.model_dump(mode="json", exclude={"files"})
    done = info.training.get("rounds", info.training)["epochs"]
    return write_run(
        arguments.out,
        tensors,
        course(arguments.work),
        int(arguments.file_mb * MB),
        pack=None,
        row=arguments.row,
        seed=arguments.seed,
        iterations=done,
        schedule=config.epochs,
        seconds=round(seconds, 1),
        figures=card,
        half=arguments.half,
        machine=used(),
        versions=learner_versions(),
        commit=commit(),
    )


def spent(work: Path, more: float) -> float:
    """Seconds that the training has had through all of its interruptions, with so many more."""
    note = work.with_suffix(".seconds.json")
    seconds = (float(read_json(note)["seconds"]) if note.exists() else 0.0) + more
    write_json(note, {"seconds": seconds})
    return seconds


def main(words: list[str]) -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--assets", required=True, help="folder of objects")
    options.add_argument("--row", default="paper", help="of Table 1")
    options.add_argument("--work", type=Path, required=True, help="folder of the training; continued if it exists")
    options.add_argument("--out", type=Path, required=True, help="folder for what travels back")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--minutes", type=float, default=20.0, help="of this call")
    options.add_argument("--config", type=Path, help="YAML file with parameters")
    options.add_argument("--workers", type=int, help="processes that collect; as many as cores by default")
    options.add_argument("--file-mb", type=float, default=15.0, help="of a file of weights")
    options.add_argument("--half", action="store_true", help="round matrices to float16")
    options.add_argument("--device", default="auto", help="auto, cpu, cuda or cuda:N")
    arguments = options.parse_args(words)
    choose(arguments.device)
    row = ROWS[runner.chosen(arguments.row, ROWS)[0]].train or ()
    if row[:2] != ("--variant", "paper"):
        raise BusybotError(f"the row {arguments.row} trains none of the paper's networks", "choose paper...")
    settings = [value for word, value in pairwise(row) if word == "--set"]
    config = build(PaperConfig, arguments.config, settings, {})
    given = ("--assets", arguments.assets, "--seed", str(arguments.seed), "--device", arguments.device)
    more = (*runner.option("--config", arguments.config), *runner.option("--workers", arguments.workers))
    began = time.monotonic()
    train(("train", "interact", "--out", str(arguments.work), *row, *given, *more), arguments.minutes)
    told = bring_back(arguments, config, spent(arguments.work, time.monotonic() - began))
    print(f"{told.iterations} of {told.schedule} epochs in {told.seconds} s: {told.machine}")


if __name__ == "__main__":
    runner.one_of(main)
