"""Trains one of the paper's graph networks on a pack, for as long as it may take; runs where the simulator does not.

    python -m benchmarks.gpu.train --pack PACK --row paper --work WORK --out OUT --minutes 9

The learner, its loop and its checkpoints are those of `busybot train reason --variant paper`; only the boards come from
the pack, and all of them lie in the GPU's memory, where batches are gathered. On a GPU that can, networks multiply in
bfloat16. On a CPU the weights are, bit by bit, those of that command on the datasets that were packed.

`--work` is the training's folder. Killed at any time, or out of minutes, the same command goes on there from the last
checkpoint and ends in the weights of one that was not stopped. `--minutes` are those of the training through all of its
interruptions: to go on when they are spent, ask for more, or for so many in `--this-call`. A checkpoint has three
numbers for each weight, 220 MB, so it is not meant to travel.

`--inexact` takes algorithms on a GPU that do not repeat exactly: what is gathered for edges is added up in any order,
not sorted first.

`--out` gets what travels: weights in files of at most `--file-mb`, losses, and what is to be known of the run. With
`--half` matrices are rounded to float16, 37 MB in all, and lose nothing that a network multiplied in bfloat16 has used.

Nothing but torch, torch-geometric, numpy, pydantic and safetensors is imported.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import torch

from benchmarks.gpu.formats import RunInfo, config_of, read_pack, read_pack_info, write_run
from busybot.common.device import choose
from busybot.common.errors import BusybotError
from busybot.common.process_pool import machine
from busybot.evaluation.results import commit
from busybot.reason.models.paper.learner import PaperLearner
from busybot.training.device import device, multiplies_bfloat16
from busybot.training.loop import Budget, files_of, fit
from busybot.training.run_folder import begin_folder, learner_versions

MB = 1_000_000


def train(arguments: argparse.Namespace) -> RunInfo:
    """Train until the end or until the minutes are spent; returns what is told of it."""
    info, boards = read_pack(arguments.pack)
    _, pack = read_pack_info(arguments.pack)
    config = config_of(info, arguments.row, arguments.pack)
    begin_folder(arguments.work, config, arguments.seed, pack=pack)
    learner = PaperLearner(config, boards, [], arguments.seed, resident=True)
    if arguments.inexact:
        torch.use_deterministic_algorithms(False)
    budget = learner.budget = Budget(arguments.minutes, arguments.this_call)
    # no board is held out, so that judgements are checkpoints and nothing else
    figures = fit(learner, arguments.work, config.loop.model_copy(update={"judge": arguments.checkpoint}))
    if not figures["iterations"]:
        raise BusybotError(f"{arguments.work}: nothing was learned in these minutes", "give it more --minutes")
    return write_run(
        arguments.out,
        learner.network.state_dict(),
        files_of(arguments.work, learner.name)[1].read_bytes(),
        int(arguments.file_mb * MB),
        pack=pack,
        row=arguments.row,
        seed=arguments.seed,
        iterations=figures["iterations"],
        schedule=learner.iterations,
        seconds=round(budget.seconds, 1),
        figures=figures,
        half=arguments.half,
        machine=used(),
        versions=learner_versions(),
        commit=commit(),
    )


def where() -> dict[str, Any]:
    """The machine, and its GPU."""
    on = device()
    return {**machine(), "gpu": torch.cuda.get_device_name(on) if on.type == "cuda" else None}


def used() -> dict[str, Any]:
    """The machine, and what of its GPU this process used."""
    on = device()
    if on.type != "cuda":
        return where()
    return {
        **where(),
        "gpu_peak_bytes": torch.cuda.max_memory_allocated(on),
        "gpu_multiplies": "bfloat16" if multiplies_bfloat16() else "float32",
        "gpu_repeats_exactly": torch.are_deterministic_algorithms_enabled(),
    }


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--pack", type=Path, required=True, help="folder of benchmarks.gpu.pack")
    options.add_argument("--row", required=True, help="which of its trainings")
    options.add_argument("--work", type=Path, required=True, help="folder of the training; continued if it exists")
    options.add_argument("--out", type=Path, required=True, help="folder for what travels back")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--minutes", type=float, default=9.0, help="of training, through all interruptions")
    options.add_argument("--this-call", action="store_true", help="count the minutes from this call on")
    options.add_argument("--checkpoint", type=int, default=1000, help="iterations between checkpoints")
    options.add_argument("--file-mb", type=float, default=15.0, help="of a file of weights")
    options.add_argument("--half", action="store_true", help="round matrices to float16")
    options.add_argument("--inexact", action="store_true", help="do not ask a GPU to repeat exactly")
    options.add_argument("--device", default="auto", help="auto, cpu, cuda or cuda:N")
    arguments = options.parse_args()
    if arguments.seed < 0 or arguments.checkpoint < 1:  # else it is told when the minutes are spent, or never
        options.error("--seed counts from 0, --checkpoint from 1")
    choose(arguments.device)
    told = train(arguments)
    each = told.seconds / told.iterations
    print(f"{told.iterations} of {told.schedule} iterations in {told.seconds} s, {each:.4f} s each: {told.machine}")


if __name__ == "__main__":
    try:
        main()
    except BusybotError as error:
        sys.exit(f"error: {error}")
