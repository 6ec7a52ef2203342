"""Measures the paper's training of the interaction policy on this machine (`train interact --model paper`).

    python -m benchmarks.speed.paper_interact [--iterations 50] [--assets procedural] [--threads 1] [--out FILE]

The data of the first epoch of every phase are collected at the paper's size (16 boards of 10 actions), with untrained
networks and as the schedule has it there: random positions until the epsilon of positions falls, all directions until
the last phase, whose first direction is random. Then each network is trained for so many iterations on these data, with
the paper's pictures, batches and optimizer, and every iteration is timed, its batch included. The whole schedule's time
is an extrapolation from the medians; nothing is said about how good the trained policy would be. What is collected is a
lower bound: later in each phase a network is asked more often, and untrained networks mostly miss, and a miss need not
be simulated. Wall seconds grow with whatever else the machine does (its load is noted); CPU seconds, of all threads and
of the collecting processes, do so much less.
"""

import json
import os
import resource
import tempfile
import time
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.runner import finish, parser, timed
from busybot.common.rng import generator
from busybot.interact.affordance.networks import KINDS, Kind
from busybot.interact.training.config import PaperConfig
from busybot.interact.training.paper import PaperTraining
from busybot.interact.training.round_recorder import Recorder, RoundProgress
from busybot.interact.training.sample_cache import Samples
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.training.checkpoint import parameters_of
from busybot.training.device import device

WARM_UP = 2


def collect(training: PaperTraining, folder: Path, epochs: tuple[int, ...]) -> dict[str, Any]:
    """Record the data of these epochs; seconds of each, the start of the worker processes included."""
    figures = {}
    config = training.config
    for epoch in epochs:
        began, began_cpu = time.perf_counter(), cpu_seconds()
        path = folder / f"{epoch:03d}"
        explorer = partial(training.factory, epoch)
        dataset = training.recorder.dataset(path, config.boards, config.steps, f"epoch {epoch}", explorer)
        seconds, cpu = time.perf_counter() - began, cpu_seconds() - began_cpu
        training.datasets.append(dataset)
        rewards = dataset.table("steps", ["reward"]).column("reward").to_pylist()
        figures[f"epoch {epoch}"] = {
            "actions": len(rewards),
            "rewarded": sum(rewards),
            "seconds": round(seconds, 1),
            "cpu_seconds": round(cpu, 1),
            "actions_per_second": round(len(rewards) / seconds, 2),
        }
    return figures


def phases(config: PaperConfig) -> tuple[int, int, int]:
    """The epochs from which data are collected in another way."""
    return 0, config.random_epochs, config.all_directions_epochs


def cpu_seconds() -> float:
    """Of this process and of those that it started and that have ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def measure(training: PaperTraining, kind: Kind, samples: Samples, iterations: int) -> dict[str, Any]:
    """Seconds per iteration of a network's training."""
    learner, batch = training.learners[kind], training.config.learn(kind).batch
    rng = generator(0, "", 0, "benchmark")
    wall, cpu = timed(lambda: learner.learn(samples, rng), iterations, WARM_UP, kind)
    quartiles = [round(float(value), 4) for value in np.quantile(wall, [0.25, 0.75])]
    return {
        "parameters": parameters_of(learner.network),
        "batch": batch,
        "iterations": iterations,
        "seconds_median": round(float(np.median(wall)), 4),
        "seconds_quartiles": quartiles,
        "cpu_seconds_median": round(float(np.median(cpu)), 4),
    }


def extrapolate(config: PaperConfig, networks: dict[str, Any], collecting: dict[str, Any]) -> dict[str, Any]:
    """The whole schedule from the medians: hours by the clock, and of CPU."""
    epochs = range(config.epochs)
    iterations = {k: sum(config.learn(k).iterations for e in epochs if k in config.trained(e)) for k in KINDS}
    result: dict[str, Any] = {"epochs": config.epochs, "iterations": iterations}
    for name in ("seconds", "cpu_seconds"):
        training = sum(iterations[kind] * networks[kind][f"{name}_median"] for kind in KINDS)
        lengths = np.diff([*phases(config), config.epochs])
        collected = float(sum(length * part[name] for length, part in zip(lengths, collecting.values(), strict=True)))
        hours = {"training": training / 3600, "collecting": collected / 3600, "both": (training + collected) / 3600}
        result[name.replace("seconds", "hours")] = {key: round(value, 2) for key, value in hours.items()}
    return result


def benchmark(library: Library, iterations: int, threads: int) -> dict[str, Any]:
    """All figures."""
    torch.set_num_threads(threads)
    config = PaperConfig(threads=threads)
    told = RoundProgress(lambda text: None, lambda label: nullcontext(lambda done, total: None))
    with tempfile.TemporaryDirectory() as folder:
        training = PaperTraining(Path(folder), config, Recorder(library, config, 0, threads, told))
        training.begin((config.render.height, config.render.width))
        collecting = collect(training, Path(folder) / "rounds", phases(config))
        samples = training.buffer(len(collecting) - 1)
        networks: dict[str, Any] = {kind: measure(training, kind, samples, iterations) for kind in KINDS}
    return {
        "networks": networks,
        "collecting": collecting,
        "extrapolated": extrapolate(config, networks, collecting),
        "peak_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3),
        "load_average": [round(load, 1) for load in os.getloadavg()],
    }


def main() -> None:
    options = parser(__doc__, out=False)
    options.add_argument("--iterations", type=int, default=50, help="of each network")
    options.add_argument("--threads", type=int, default=os.cpu_count() or 1, help="of PyTorch, and collecting workers")
    arguments = options.parse_args()
    library, on = find(arguments.assets), device()
    used = {"threads": arguments.threads, "device": torch.cuda.get_device_name(on) if on.type == "cuda" else "cpu"}
    figures, hashes = benchmark(library, arguments.iterations, arguments.threads), {"data": {"objects": library.sha256}}
    print(json.dumps(finish("paper-interact-speed", arguments, figures, hashes=hashes, machine=used), indent=1))


if __name__ == "__main__":
    main()
