"""Measures what learning from recordings costs: the paper's training of relations, features, pictures for PyTorch.

    python -m benchmarks.speed.reason [--iterations 3] [--boards 64] [--threads 1] [--out FILE]
    python -m benchmarks.speed.reason message-passing [--iterations 3] [--boards 8] [--out FILE]
    python -m benchmarks.speed.reason features --data DATASET [--encoder NAME] [--workers 2] [--out FILE]
    python -m benchmarks.speed.reason frames --data DATASET [--out FILE]

Iterations of the paper's size (64 boards of 30 steps, 10 objects, 23 images to infer from) are timed in every form of
the networks: the plain one, which joins receiver, sender and edge for every pair of nodes in every frame; the fast one,
which multiplies nodes before, on the same pairs; the fast one on trigger-responder pairs; and that with matrices
multiplied in bfloat16. The boards are made up: their numbers do not matter to the cost. Forms that would take too long
are timed on fewer boards (`--dense-boards`) and scaled up.

The whole schedule (10,000 boards, 200 epochs of 157 iterations) is an extrapolation from the medians; nothing is said
about how good the trained model would be. Wall seconds grow with whatever else the machine does (its load is noted);
CPU seconds do so much less.

`message-passing` measures the gain of multiplying nodes before they are joined to edges. The edge functions of the
paper's networks have two forms that compute the same (`parts.EdgeFunction`): the one that the paper writes, and a
factored one. Iterations of both take turns; what is reported is the least processor time of one and their ratio. The
factored form is worth having if it is 1.5 times as fast for the paper's graph, which connects all pairs; it then serves
the smaller graph, too.

`features` measures how many frames a second are turned into features, by the clock and by processor time, into a new
store.

`frames` measures how many pictures a second come in random order from `load_dataset(DATASET).frames()` through a
`DataLoader` in batches of 32, by the clock and by processor time, of its worker, too, where it has one. The first pass
reads the recordings, later ones have them in memory; `nothing kept` reads a recording for every picture.
"""

import argparse
import json
import math
import os
import tempfile
import time
from itertools import count
from pathlib import Path
from typing import Any, Literal
from unittest import mock

import cv2
import numpy as np
import psutil
import torch
from torch.utils.data import DataLoader

from benchmarks.runner import cpu_seconds, finish, load_average, one_of, parser, peak_mb, timed, torch_with
from busybot.api import load_dataset
from busybot.common.rng import generator
from busybot.datasets.dataset import Dataset
from busybot.episodes.mcap import pictures
from busybot.episodes.mcap.reader import read_episode
from busybot.evaluation.results import package_versions
from busybot.frames import Frames
from busybot.reason.inputs.feature_store import features_of
from busybot.reason.inputs.sequence import CHANNELS, BoardSequence
from busybot.reason.models.paper.config import PaperNetworkConfig, PaperReasonConfig
from busybot.reason.models.paper.data import boards_of
from busybot.reason.models.paper.learner import iterate, make_network, make_optimizer
from busybot.reason.models.paper.parts import factor
from busybot.training.device import device
from busybot.training.run_folder import learner_versions

BOARDS = 10_000
STEPS = 30
FORMS: dict[str, dict[str, Any]] = {
    "plain, all pairs": {},
    "fast, all pairs": {},
    "fast, candidates": {"network": {"pairs": "candidates"}},
    "fast, candidates, bfloat16": {"network": {"pairs": "candidates"}, "bfloat16": True},
}
"""Forms of the networks: what differs from the paper's parameters."""


GATE = 1.5
"""Least ratio for which a second form of message passing is worth having."""
EDGES = {"joined": False, "factored": True}
"""Forms of the edge functions: whether they are factored."""


def made_up(number: int) -> list[BoardSequence]:
    """Boards with as many triggers and responders as the paper's have, and random numbers."""
    rng = generator(0, "", 0, "made-up boards")
    return [_made_up(rng) for _ in range(number)]


def _made_up(rng: np.random.Generator) -> BoardSequence:
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
        "peak_mb_so_far": peak_mb(),
    }


def main(words: list[str]) -> None:
    options = parser(__doc__, assets=False, out=False)
    options.add_argument("--iterations", type=int, default=3, help="of each form, after one that does not count")
    options.add_argument("--boards", type=int, default=64, help="per iteration")
    options.add_argument("--dense-boards", type=int, default=8, help="per iteration where all pairs are connected")
    options.add_argument("--forms", nargs="*", choices=list(FORMS), default=list(FORMS), help="all if not given")
    options.add_argument("--threads", type=int, default=os.cpu_count() or 1, help="of PyTorch")
    arguments = options.parse_args(words)
    used, sequences, config = torch_with(arguments.threads), made_up(arguments.boards), PaperReasonConfig()
    sizes = {form: arguments.dense_boards if "all" in form else arguments.boards for form in arguments.forms}
    result = {
        "schedule_iterations": config.epochs * math.ceil(BOARDS / config.batch),
        "forms": {form: measure(form, sequences[:size], arguments.iterations) for form, size in sizes.items()},
        "load_average": load_average(),
    }
    versions = package_versions(("torch", "torch-geometric"))
    print(json.dumps(finish("paper-reason-speed", arguments, result, versions, machine=used), indent=1))


def compare(pairs: Literal["all", "candidates"], boards: int, iterations: int) -> dict[str, Any]:
    """Processor seconds of an iteration in each form, and how many times as fast the factored one is."""
    config = PaperReasonConfig(network=PaperNetworkConfig(pairs=pairs))
    batch = boards_of(made_up(boards), config.network)
    networks = {form: make_network(config, 0) for form in EDGES}
    optimizers = {form: make_optimizer(network, config) for form, network in networks.items()}
    seconds: dict[str, list[float]] = {form: [] for form in EDGES}
    for number in range(iterations + 1):
        for form, network in networks.items():
            factor(network, EDGES[form])
            began = time.process_time()
            iterate(network, optimizers[form], batch, config, generator(0, "", number, "benchmark"))
            seconds[form].append(time.process_time() - began)
    least = {form: min(times[1:]) for form, times in seconds.items()}  # whatever else the machine does only adds to it
    ratio = least["joined"] / least["factored"]
    return {
        "edges": batch.edge_index.shape[1],
        **{f"{form}_cpu_seconds": round(each, 3) for form, each in least.items()},
        "ratio": round(ratio, 2),
        "reached": ratio >= GATE,
    }


def message_passing(words: list[str]) -> None:
    options = parser(__doc__, assets=False, out=False)
    options.add_argument("--iterations", type=int, default=3, help="of each form, after one that does not count")
    options.add_argument("--boards", type=int, default=8, help="per iteration")
    arguments = options.parse_args(words)
    torch.set_num_threads(1)
    names: tuple[Literal["all", "candidates"], ...] = ("all", "candidates")
    pairs = {name: compare(name, arguments.boards, arguments.iterations) for name in names}
    figures = {"gate_ratio": GATE, "pairs": pairs}
    result = finish("message-passing", arguments, figures, learner_versions(), machine={"threads": 1})
    print(json.dumps(result, indent=2))


def encoded(arguments: argparse.Namespace) -> dict[str, Any]:
    """How fast the features of a dataset are computed."""
    dataset = Dataset.open(arguments.data)
    dataset.hashes()  # so that the tables, not the first encoder, pay for reading what they need
    with tempfile.TemporaryDirectory() as store:
        load, before, began = os.getloadavg()[0], cpu_seconds(), time.monotonic()
        found = features_of(dataset, arguments.encoder, store=Path(store), workers=arguments.workers)
        seconds, used = time.monotonic() - began, cpu_seconds() - before
        frames = sum(len(values) for values in found.values())
    pictures = sum(len(read_episode(dataset.episode_path(i), "lazy").images) for i in found)
    return {
        "encoder": arguments.encoder,
        "workers": arguments.workers,
        "episodes": len(found),
        "frames": frames,
        "pictures": pictures,
        "seconds": round(seconds, 2),
        "cpu_seconds": round(used, 2),
        "frames_per_second": round(frames / seconds, 1),
        "frames_per_cpu_second": round(frames / used, 1),
        "pictures_per_cpu_second": round(pictures / used, 1),
        "load_before": round(load, 2),
        "cores": os.cpu_count(),
    }


def features(words: list[str]) -> None:
    options = parser(__doc__, assets=False, out=False)
    options.add_argument("--data", type=Path, required=True, help="recorded dataset")
    options.add_argument("--encoder", default="embedded")
    options.add_argument("--workers", type=int, default=2)
    arguments = options.parse_args(words)
    data = {arguments.data.name: {"content_hash": Dataset.open(arguments.data).hashes().content}}
    print(json.dumps(finish("features-speed", arguments, encoded(arguments), hashes={"data": data}), indent=1))


def rates(
    frames: Frames, passes: int, workers: int = 0, kept: int = pictures.KEPT_BYTES, collate: Any = None
) -> list[dict[str, int]]:
    """Pictures a second of each pass over all frames, by the clock and by processor time; nothing is kept before."""
    batches = DataLoader(
        frames, 32, shuffle=True, num_workers=workers, persistent_workers=workers > 0, collate_fn=collate
    )
    found, own = [], psutil.Process()
    with mock.patch.object(pictures, "_KEPT", pictures.Kept(kept)):
        for _ in range(passes):
            began, before = time.monotonic(), _used(own)
            number = sum(len(frames.pictures) * len(batch["step"]) for batch in batches)
            seconds, used = time.monotonic() - began, _used(own) - before
            found.append({"per_second": round(number / seconds), "per_cpu_second": round(number / used)})
    return found


def median(passes: list[dict[str, int]]) -> dict[str, int]:
    """The pass in the middle by processor time."""
    return sorted(passes, key=lambda row: row["per_cpu_second"])[len(passes) // 2]


def _used(process: psutil.Process) -> float:
    """Processor seconds of a process and of those below it that run."""
    times = [one.cpu_times() for one in (process, *process.children(recursive=True))]
    return sum(one.user + one.system for one in times)


def frames(words: list[str]) -> None:
    options = parser(__doc__, assets=False, out=False)
    options.add_argument("--data", type=Path, required=True, help="recorded dataset")
    arguments = options.parse_args(words)
    cv2.setNumThreads(1)
    load, machine = os.getloadavg()[0], torch_with(1)
    data = load_dataset(arguments.data)
    first, *later = rates(data.frames(), 6)
    rows = {
        "RGB, first pass": first,
        "RGB": median(later),
        "RGB, one worker": median(rates(data.frames(), 6, workers=1)[1:]),
        "RGB, one worker, frames.collate": median(rates(shared := data.frames(), 6, 1, collate=shared.collate)[1:]),
        "depth": rates(data.frames("depth"), 3)[-1],
        "RGB, nothing kept": rates(data.frames(), 1, kept=0)[0],
    }
    info = data.to_pandas("episodes")
    size = {"width": int(info.width[0]), "height": int(info.height[0])}
    figures = {"episodes": len(data), "frames": len(data.frames()), **size, "rows": rows, "load_before": round(load, 2)}
    hashes = {"data": {arguments.data.name: {"content_hash": data.hashes().content}}}
    print(json.dumps(finish("frames-speed", arguments, figures, hashes=hashes, machine=machine), indent=1))


if __name__ == "__main__":
    one_of(main, message_passing=message_passing, features=features, frames=frames)
