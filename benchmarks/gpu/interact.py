"""Trains the paper's interaction networks on a machine with a GPU, for as long as it may take.

    python -m benchmarks.gpu.interact --assets OBJECTS --row paper --work WORK --out BACK --minutes 20

The schedule collects every epoch's boards with the networks of the epoch before, so the simulator has to be there, as
a wheel (`benchmarks.gpu.pack --simulator`); the objects travel as they are. What runs is `busybot train interact
--variant paper` with the row's options of Table 1: networks on the GPU, pictures on the cores where Vulkan has a driver
for them. After `--minutes` it is interrupted, as by Ctrl-C; the same command goes on in `--work`, to the weights of one
that was not interrupted.

With `--epochs 21` it is interrupted after so many epochs, too, so that several rows have learned as long.

`--merge 4` makes one epoch of four, with as many boards and iterations as these have together: many workers finish an
epoch of 16 boards before they are all busy. Networks that collect are as many boards older then, and the buffer holds
as many steps. `--share 0.5` is half of the schedule, all its phases shortened alike.

`--out` gets what travels, as of `benchmarks.gpu.train`: the networks as they are after the last whole epoch, in files
of at most `--file-mb`, what each iteration lost and (every tenth epoch) epochs earned, and what is to be known of the
run. `python -m benchmarks.gpu.unpack --run BACK --out MODEL` makes a model of it, which `busybot eval interact DATASET
--model MODEL` judges.
"""

import argparse
import json
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from benchmarks import runner
from benchmarks.gpu.formats import RunInfo, write_run
from benchmarks.gpu.train import MB, where
from benchmarks.tables.table1 import PAPER, ROWS
from busybot.common.atomic_io import read_json, write_atomically, write_json
from busybot.common.device import choose
from busybot.common.errors import BusybotError
from busybot.evaluation.results import commit
from busybot.interact.affordance.load import load_model
from busybot.interact.affordance.networks import KINDS
from busybot.interact.training.config import PaperConfig
from busybot.training.loop import files_of
from busybot.training.run_folder import learner_versions, read_metrics

TRAINED = {name: row.train for name, row in ROWS.items() if row.train and row.train[:2] == PAPER}
"""Rows that train the paper's networks, with their options."""
PATIENCE_S, LOOK_S = 120, 1.0
"""For a training that was interrupted to end by itself; between two looks at how far it is."""


def train(command: tuple[str, ...], minutes: float, enough: Callable[[], bool] = lambda: False) -> int | None:
    """Run a training to its end, for so long, or until there is enough; returns its exit code, None if it was
    interrupted."""
    # scripts start what is in the background with interrupts ignored, and the training would inherit that
    signal.signal(signal.SIGINT, signal.default_int_handler)
    until = time.monotonic() + 60 * minutes
    with subprocess.Popen([*runner.BUSYBOT, *command]) as process:
        while (left := until - time.monotonic()) > 0:
            with suppress(subprocess.TimeoutExpired):
                return process.wait(min(LOOK_S, left))
            if enough():
                break
        process.send_signal(signal.SIGINT)
        try:
            process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
        return None


def scaled(share: float, merge: int) -> dict[str, Any]:
    """Parameters of a training that has this share of the paper's schedule, in epochs of `merge` epochs each.

    Raises:
        BusybotError: no epoch is left.
    """
    whole = PaperConfig()
    if not 0 < share <= 1 or not 1 <= merge <= share * whole.epochs:
        raise BusybotError(
            f"{share:g} of the schedule, {merge} epochs in one: no epoch is left", "--share to 1, --merge from 1 on"
        )

    def epochs(count: int) -> int:
        return max(1, round(share / merge * count))

    phases = ("epochs", "random_epochs", "all_directions_epochs", "joint_epochs")
    learning: dict[str, Any] = {
        kind: {
            "iterations": merge * whole.learn(kind).iterations,
            "rate_epochs": epochs(whole.learn(kind).rate_epochs),
            "epsilon_epochs": epochs(whole.learn(kind).epsilon_epochs),
        }
        for kind in KINDS
    }
    return {
        "boards": merge * whole.boards,
        "checkpoint": max(one["iterations"] for one in learning.values()),  # an epoch's end is one anyway
        **{name: epochs(getattr(whole, name)) for name in phases},
        **learning,
    }


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


def epochs_learned(work: Path) -> int:
    """Whole epochs behind the networks that collect the next one; 0 before any was asked where to act."""
    card = work / "current" / "model.json"
    return int(read_json(card)["training"]["epochs"]) if card.exists() else 0


def told_lines(work: Path) -> bytes:
    """What iterations lost, by network, and what epochs earned, a JSON object a line."""
    files = {str(name): files_of(work, name)[1] for name in KINDS} | {"epochs": work / "metrics" / "epochs.jsonl"}
    lines = [{"of": name, **line} for name, file in files.items() for line in read_metrics(file)]
    return "".join(f"{json.dumps(line)}\n" for line in lines).encode()


def bring_back(arguments: argparse.Namespace, seconds: float) -> RunInfo:
    """Write what travels.

    Args:
        seconds: that the training has had, collecting included.
    """
    model = load_model(networks(arguments.work))
    training = model.info.training
    return write_run(
        arguments.out,
        {f"{kind}/{name}": one for kind in KINDS for name, one in model.networks[kind].cpu().state_dict().items()},
        told_lines(arguments.work),
        int(arguments.file_mb * MB),
        pack=None,
        row=arguments.row,
        seed=arguments.seed,
        iterations=training.get("rounds", training)["epochs"],
        schedule=training["config"]["epochs"],
        seconds=round(seconds, 1),
        figures=model.info.model_dump(mode="json", exclude={"files"}),
        half=arguments.half,
        machine=where(),
        versions=learner_versions(),
        commit=commit(),
    )


def _latest(work: Path) -> int:
    """When a file of a training was written last, ns; 0 if there is none."""
    return max((one.stat().st_mtime_ns for one in work.rglob("*") if one.is_file()), default=0)


def spent(work: Path, more: float) -> float:
    """Seconds that the training in this folder has had through all of its interruptions, with so many more."""
    note = work.with_name(f"{work.name}.seconds.json")
    seconds = (float(read_json(note)["seconds"]) if note.exists() else 0.0) + more
    write_json(note, {"seconds": seconds})
    return seconds


def main(words: list[str]) -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--assets", required=True, help="folder of objects")
    options.add_argument("--row", default="paper", choices=sorted(TRAINED), help="of Table 1")
    options.add_argument("--work", type=Path, required=True, help="folder of the training; continued if it exists")
    options.add_argument("--out", type=Path, required=True, help="folder for what travels back")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--minutes", type=float, default=20.0, help="of this call")
    options.add_argument("--epochs", type=int, help="to stop after, of the whole training")
    options.add_argument("--share", type=float, default=1.0, help="of the schedule")
    options.add_argument("--merge", type=int, default=1, help="epochs that become one")
    options.add_argument("--config", type=Path, help="YAML file with parameters, in place of these two")
    options.add_argument("--workers", type=int, help="processes that collect; as many as cores by default")
    options.add_argument("--file-mb", type=float, default=15.0, help="of a file of weights")
    options.add_argument("--half", action="store_true", help="round matrices to float16")
    options.add_argument("--device", default="auto", help="auto, cpu, cuda or cuda:N")
    arguments = options.parse_args(words)
    choose(arguments.device)
    given = ("--assets", arguments.assets, "--seed", str(arguments.seed), "--device", arguments.device)
    config = arguments.config or arguments.work.with_name(f"{arguments.work.name}.yaml")
    if arguments.config is None:
        write_atomically(config, yaml.safe_dump(scaled(arguments.share, arguments.merge)).encode())
    more = ("--config", str(config), *runner.option("--workers", arguments.workers))
    if not arguments.work.exists():  # what another training there had is not this one's
        arguments.work.with_name(f"{arguments.work.name}.seconds.json").unlink(missing_ok=True)
    began, before = time.monotonic(), _latest(arguments.work)
    code = train(
        ("train", "interact", "--out", str(arguments.work), *TRAINED[arguments.row], *given, *more),
        arguments.minutes,
        lambda: arguments.epochs is not None and epochs_learned(arguments.work) >= arguments.epochs,
    )
    if code and _latest(arguments.work) == before:  # what is there may be another training's
        raise BusybotError(f"busybot train interact ended with code {code}, and learned nothing: it told why")
    seconds = spent(arguments.work, time.monotonic() - began)
    told = bring_back(arguments, seconds)
    print(f"{told.iterations} of {told.schedule} epochs in {told.seconds} s: {told.machine}")
    if code:
        raise BusybotError(f"busybot train interact ended with code {code}; what it had learned is in {arguments.out}")


if __name__ == "__main__":
    runner.one_of(main)
