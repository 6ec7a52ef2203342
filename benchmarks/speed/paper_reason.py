"""Measures the paper's training of relations on this machine (`busybot train reason --model paper`).

    python -m benchmarks.speed.paper_reason [--iterations 3] [--boards 64] [--threads 1] [--out FILE]

Iterations of the paper's size (64 boards of 30 steps, 10 objects, 23 images to infer from) are timed in every form of
the networks: the plain one, which joins receiver, sender and edge for every pair of nodes in every frame; the fast one,
which multiplies nodes before, on the same pairs; the fast one on trigger-responder pairs; and that with matrices
multiplied in bfloat16. The boards are made up: their numbers do not matter to the cost. Forms that would take too long
are timed on fewer boards (`--dense-boards`) and scaled up.

The whole schedule (10,000 boards, 200 epochs of 157 iterations) is an extrapolation from the medians; nothing is said
about how good the trained model would be. Wall seconds grow with whatever else the machine does (its load is noted);
CPU seconds do so much less.
"""

import json
import math
import os
import resource
from itertools import count
from typing import Any

import numpy as np
import torch

from benchmarks.runner import finish, parser, timed
from busybot.common.rng import generator
from busybot.evaluation.results import package_versions
from busybot.reason.inputs.sequence import CHANNELS, BoardSequence
from busybot.reason.models.paper.config import PaperReasonConfig
from busybot.reason.models.paper.data import boards_of
from busybot.reason.models.paper.learner import iterate, make_network, make_optimizer
from busybot.reason.models.paper.parts import factor
from busybot.training.device import device

BOARDS = 10_000
STEPS = 30
FORMS: dict[str, dict[str, Any]] = {
    "plain, all pairs": {},
    "fast, all pairs": {},
    "fast, candidates": {"network": {"pairs": "candidates"}},
    "fast, candidates, bfloat16": {"network": {"pairs": "candidates"}, "bfloat16": True},
}
"""Forms of the networks: what differs from the paper's parameters."""


def made_up(rng: np.random.Generator) -> BoardSequence:
    """A board with as many triggers and responders as the paper's have, and random numbers."""
    triggers, responders = int(rng.integers(2, 4)), int(rng.integers(6, 8))
    is_trigger = np.arange(triggers + responders) < triggers
    features = rng.random((STEPS + 1, len(is_trigger), CHANNELS), np.float32) * ~is_trigger[None, :, None]
    positions = rng.random((len(is_trigger), 3), np.float32)
    actions = rng.random((STEPS, 6), np.float32)
    acted = rng.integers(triggers, size=STEPS)
    return BoardSequence(features.astype(np.float32), positions, actions, acted, is_trigger, ~is_trigger)


def measure(form: str, sequences: list[BoardSequence], iterations: int) -> dict[str, Any]:
    """Seconds per iteration of 64 boards."""
    config = PaperReasonConfig.model_validate(FORMS[form])
    network = make_network(config, 0).to(device())
    factor(network, not form.startswith("plain"))
    optimizer = make_optimizer(network, config)
    boards = boards_of(sequences, config.network).to(device())

    numbers = count()

    def once() -> None:
        iterate(network, optimizer, boards, config, generator(0, "", next(numbers), "benchmark"))
        if device().type == "cuda":
            torch.cuda.synchronize()

    wall, cpu = timed(once, iterations, label=form)
    scale = config.batch / len(sequences)
    hours = config.epochs * math.ceil(BOARDS / config.batch) * scale / 3600
    return {
        "boards": len(sequences),
        "pairs": boards.edge_index.shape[1],
        "iterations": iterations,
        "seconds": round(scale * float(np.median(wall)), 2),
        "cpu_seconds": round(scale * float(np.median(cpu)), 2),
        "schedule_hours": round(hours * float(np.median(wall)), 1),
        "schedule_cpu_hours": round(hours * float(np.median(cpu)), 1),
        "peak_mb_so_far": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3),
    }


def main() -> None:
    options = parser(__doc__, assets=False, out=False)
    options.add_argument("--iterations", type=int, default=3, help="of each form, after one that does not count")
    options.add_argument("--boards", type=int, default=64, help="per iteration")
    options.add_argument("--dense-boards", type=int, default=8, help="per iteration where all pairs are connected")
    options.add_argument("--forms", nargs="*", choices=list(FORMS), default=list(FORMS), help="all if not given")
    options.add_argument("--threads", type=int, default=os.cpu_count() or 1, help="of PyTorch")
    arguments = options.parse_args()
    torch.set_num_threads(arguments.threads)
    rng = generator(0, "", 0, "made-up boards")
    sequences = [made_up(rng) for _ in range(arguments.boards)]
    result = {
        "schedule_iterations": PaperReasonConfig().epochs * math.ceil(BOARDS / PaperReasonConfig().batch),
        "forms": {
            form: measure(
                form, sequences[: arguments.dense_boards] if "all" in form else sequences, arguments.iterations
            )
            for form in arguments.forms
        },
        "load_average": [round(load, 1) for load in os.getloadavg()],
    }
    used = {
        "threads": arguments.threads,
        "device": torch.cuda.get_device_name() if device().type == "cuda" else "cpu",
    }
    versions = package_versions(("torch", "torch-geometric"))
    print(json.dumps(finish("paper-reason-speed", arguments, result, versions, machine=used), indent=1))


if __name__ == "__main__":
    main()
