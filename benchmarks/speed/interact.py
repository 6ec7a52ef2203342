"""Measures the cost of learning to interact: an iteration of training, a decision, a recorded action.

    python -m benchmarks.speed.interact [--assets DIR] [--boards 12] [--iterations 30] [--out FILE]

Figures are CPU seconds of one process with one thread, medians of one run. The limit of an iteration is the time that
the same processor needs for as many multiplications in one large matrix product, in bfloat16 if it has that, else in
float32; its ratio to the limit is what could still be gained. Decisions and actions are measured on the boards of one
dataset: the policy of the shipped model beside the scripted one, with everything that `busybot collect` does for an
action. What the dense position network needs for a whole board, its features included, is told for each number of
threads, by the clock.
"""

import json
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.utils.flop_counter import FlopCounterMode

from benchmarks.runner import finish, parser, timed
from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardSpec
from busybot.common.rng import generator
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.episodes.camera import Rays
from busybot.episodes.mcap.writer import write_episode
from busybot.interact.affordance.load import load_model
from busybot.interact.affordance.networks import KINDS, Kind
from busybot.interact.policy.policy_factory import (
    DEFAULT_MODEL,
    ExplorePolicyFactory,
    LearnedPolicyFactory,
    fingerprint,
)
from busybot.interact.training.config import TrainConfig
from busybot.interact.training.fast_learner import FastAffordanceLearner, FitJob
from busybot.interact.training.sample_cache import cache_samples
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.sim.builtin_policies import builtin_factory
from busybot.sim.collect import CollectConfig, collect
from busybot.sim.interaction import InteractionConfig
from busybot.sim.policy import AnyPolicyFactory
from busybot.sim.recorder import record_episode
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.render import RenderConfig
from busybot.training.device import multiplies_bfloat16

SEED = 3
STEPS = 10
SIDE = 1024
"""Of the matrices whose product is the limit."""


def seconds(work: Callable[[], Any], times: int) -> float:
    """Median CPU seconds."""
    return float(np.median(timed(work, times)[1]))


def product_seconds(times: int) -> float:
    """CPU seconds per floating-point operation of a large matrix product."""
    left, right = torch.randn(2, SIDE, SIDE, dtype=torch.bfloat16 if multiplies_bfloat16() else torch.float32)
    return seconds(lambda: left @ right, times) / (2 * SIDE**3)


def record(folder: Path, library: Library, boards: int) -> Path:
    """A round of exploring without a network, and its cache."""
    dataset = create_dataset(folder / "round", BoardConfig(boards=boards, group_size=1, seed=SEED), library)
    factory = ExplorePolicyFactory(None)
    config = CollectConfig(policy=factory.name, steps=2 * STEPS)
    collect(dataset, library, config, os.cpu_count() or 1, None, factory, factory.provenance())
    return cache_samples(Dataset.open(folder / "round"), folder / "cache", "depth")


def iteration(kind: Kind, cache: Path, folder: Path, iterations: int) -> dict[str, float]:
    """One iteration of a network's training with the default configuration."""
    job = FitJob(folder / "unused", TrainConfig(), SEED, kind, (cache,), None, 0, 10**6)
    learner = FastAffordanceLearner(job)
    rng = generator(SEED, "train", 0, f"benchmark/{kind}")
    _, batch = learner.draw(rng)
    with FlopCounterMode(display=False) as counted:
        learner.learn(batch, 1e-4, rng)
    per_operation = product_seconds(iterations)
    drawing = seconds(lambda: learner.draw(rng), iterations)
    learning = seconds(lambda: learner.learn(batch, 1e-4, rng), iterations)
    limit = counted.get_total_flops() * per_operation
    return {
        "batch": learner.config.batch,
        "milliseconds": round(1000 * (drawing + learning), 1),
        "of_them_drawing_the_batch": round(1000 * drawing, 1),
        "gigaflop": round(counted.get_total_flops() / 1e9, 2),
        "ratio_to_limit": round((drawing + learning) / limit, 2),
    }


def acting(library: Library, boards: list[BoardSpec], folder: Path) -> dict[str, Any]:
    """CPU milliseconds of a recorded action and of a decision."""
    simulator, config = Simulator(library, RenderConfig()), InteractionConfig()
    factories: dict[str, AnyPolicyFactory] = {
        "scripted": builtin_factory("scripted"),
        "learned": LearnedPolicyFactory(DEFAULT_MODEL, "collect"),
    }
    spent: dict[str, list[float]] = {name: [] for name in factories}
    for board in boards:
        simulator.board(board)  # loads its objects, for whoever acts first
        for name, factory in factories.items():
            began = time.process_time()
            write_episode(folder / "episode.mcap", record_episode(simulator, board, factory, STEPS, config, SEED))
            spent[name].append((time.process_time() - began) / STEPS)
    per_action = {name: round(1000 * float(np.median(values[1:])), 1) for name, values in spent.items()}
    return {
        "milliseconds_per_recorded_action": per_action,
        "ratio_learned_to_scripted": round(per_action["learned"] / per_action["scripted"], 2),
        "milliseconds_per_decision": deciding(simulator, boards),
    }


def deciding(simulator: Simulator, boards: list[BoardSpec]) -> float:
    """CPU milliseconds from a new image to an action."""
    spent = []
    for board in boards:
        scene = simulator.board(board)
        seen, rng = scene.observe().observation(scene.camera), generator(SEED, "train", board.index, "benchmark/decide")
        policy = LearnedPolicyFactory(DEFAULT_MODEL, "evaluate").make_policy(Rays(scene.camera))
        began = time.process_time()
        policy.select_action(seen, rng)
        spent.append(time.process_time() - began)
    return round(1000 * float(np.median(spent[1:])), 1)


def looking(library: Library, boards: list[BoardSpec], threads: int) -> float:
    """Milliseconds by the clock from a new image to the affordance of all its pixels."""
    simulator, model, spent = Simulator(library, RenderConfig()), load_model(DEFAULT_MODEL), []
    torch.set_num_threads(threads)
    for board in boards:
        scene = simulator.board(board)
        seen, rays = scene.observe().observation(scene.camera), Rays(scene.camera)
        began = time.perf_counter()
        model.look(seen, rays)
        spent.append(time.perf_counter() - began)
    torch.set_num_threads(1)
    return round(1000 * float(np.median(spent[1:])), 1)


def main() -> None:
    options = parser(__doc__, out=False)
    options.add_argument("--boards", type=int, default=12)
    options.add_argument("--iterations", type=int, default=30)
    arguments = options.parse_args()
    torch.set_num_threads(1)
    library = find(arguments.assets)
    boards = list(generate_boards(BoardConfig(boards=arguments.boards, group_size=1, seed=SEED), library))
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        cache = record(folder, library, arguments.boards)
        iterations = {kind: iteration(kind, cache, folder, arguments.iterations) for kind in KINDS}
        looks = {str(threads): looking(library, boards, threads) for threads in range(1, (os.cpu_count() or 1) + 1)}
        result = {"iteration": iterations, "milliseconds_per_look": looks, **acting(library, boards, folder)}
    hashes = {"models": {DEFAULT_MODEL: fingerprint(DEFAULT_MODEL)["sha256"]}, "data": {"objects": library.sha256}}
    print(json.dumps(finish("interact-speed", arguments, result, hashes=hashes, seed=SEED), indent=1))


if __name__ == "__main__":
    main()
