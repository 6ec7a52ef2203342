"""Measures the cost of learning to interact: an iteration of training, a decision, a recorded action.

    python -m benchmarks.speed.interact [--assets DIR] [--boards 12] [--iterations 30] [--models NAME,DIR] [--out FILE]
    python -m benchmarks.speed.interact paper [--assets DIR] [--iterations 50] [--threads 1] [--out FILE]

Figures are CPU seconds of one process with one thread, medians of one run. The limit of an iteration is the time that
the same processor needs for as many multiplications in one large matrix product, in bfloat16 if it has that, else in
float32; its ratio to the limit is what could still be gained. Decisions and actions are measured on the boards of one
dataset, 30 on each: the policies of trained models beside the scripted one, with everything that `busybot collect` does
for an action; where the processor multiplies bfloat16, networks are asked in it, as usual, and in float32. What a
decision costs depends on how often something moved, so that is told, too. What the dense position
network needs for a board's first picture, its features included, is told for each number of threads, by the clock.

With `paper` the paper's training is measured (`train interact --variant paper`). The data of the first epoch of every
phase are collected at the paper's size (16 boards of 10 actions), with untrained networks and as the schedule has it
there: random positions until the epsilon of positions falls, all directions until the last phase, whose first direction
is random. Then each network is trained for so many iterations on these data, with the paper's pictures, batches and
optimizer, and every iteration is timed, its batch included. The whole schedule's time is an extrapolation from the
medians; nothing is said about how good the trained policy would be. What is collected is a lower bound: later in each
phase a network is asked more often, and untrained networks mostly miss, and a miss need not be simulated. Wall seconds
grow with whatever else the machine does (its load is noted); CPU seconds, of all threads and of the collecting
processes, do so much less.
"""

import json
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.utils.flop_counter import FlopCounterMode

from benchmarks.runner import (
    PRODUCT_SIDE,
    cpu_seconds,
    finish,
    load_average,
    one_of,
    parser,
    peak_mb,
    product_seconds,
    timed,
    torch_with,
)
from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardSpec
from busybot.common.errors import UsageError
from busybot.common.rng import generator
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Observation
from busybot.episodes.mcap.writer import write_episode
from busybot.interact.affordance.load import load_model
from busybot.interact.affordance.networks import KINDS, POSITION_SIZES, Kind
from busybot.interact.policy.policy_factory import (
    DEFAULT_MODEL,
    ExplorePolicyFactory,
    LearnedPolicyFactory,
    fingerprint,
    load_once,
)
from busybot.interact.training.config import PaperConfig, TrainConfig
from busybot.interact.training.fast_learner import FastAffordanceLearner, FitJob
from busybot.interact.training.paper import PaperTraining
from busybot.interact.training.round_recorder import Recorder, RoundProgress
from busybot.interact.training.sample_cache import Samples, cache_samples
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.sim.builtin_policies import builtin_factory
from busybot.sim.collect import CollectConfig, collect
from busybot.sim.interaction import InteractionConfig
from busybot.sim.policy import Action
from busybot.sim.recorder import record_episode
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.render import RenderConfig
from busybot.training.checkpoint import parameters_of
from busybot.training.device import multiplies_bfloat16

SEED = 3
STEPS, EXPLORED = 30, 20
"""Actions on each board: of those that are timed, and of those that batches are drawn from."""
WARM_UP = 2
"""Iterations of the paper's networks that do not count."""


def seconds(work: Callable[[], Any], times: int) -> float:
    """Median CPU seconds."""
    return float(np.median(timed(work, times)[1]))


def record(folder: Path, library: Library, boards: int) -> Path:
    """A round of exploring without a network, and its cache."""
    dataset = create_dataset(folder / "round", BoardConfig(boards=boards, group_size=1, seed=SEED), library)
    factory = ExplorePolicyFactory(None)
    config = CollectConfig(policy=factory.name, steps=EXPLORED)
    collect(dataset, library, config, os.cpu_count() or 1, None, factory, factory.provenance())
    return cache_samples(Dataset.open(folder / "round"), folder / "cache", "depth")


def trainings() -> dict[str, TrainConfig]:
    """With either position network."""
    return {name: TrainConfig(networks=name) for name in POSITION_SIZES}


def iteration(kind: Kind, config: TrainConfig, cache: Path, folder: Path, iterations: int) -> dict[str, float]:
    """One iteration of a network's training, and how many there are."""
    job = FitJob(folder / "unused", config, SEED, kind, (cache,), None, 0, 10**6)
    learner = FastAffordanceLearner(job)
    rng = generator(SEED, "train", 0, f"benchmark/{kind}")
    _, batch = learner.draw(rng)
    with FlopCounterMode(display=False) as counted:
        learner.learn(batch, 1e-4, rng)
    per_operation = product_seconds(iterations, multiplies_bfloat16()) / (2 * PRODUCT_SIDE**3)
    drawing = seconds(lambda: learner.draw(rng), iterations)
    learning = seconds(lambda: learner.learn(batch, 1e-4, rng), iterations)
    limit = counted.get_total_flops() * per_operation
    return {
        "batch": learner.config.batch,
        "of_a_training": sum(getattr(one, kind) for one in config.rounds),
        "milliseconds": round(1000 * (drawing + learning), 1),
        "of_them_drawing_the_batch": round(1000 * drawing, 1),
        "gigaflop": round(counted.get_total_flops() / 1e9, 2),
        "ratio_to_limit": round((drawing + learning) / limit, 2),
    }


@dataclass
class Timed:
    """A factory of policies, and the one that it made last: `spent` CPU seconds went into each of its decisions.

    Attributes:
        bfloat16: whether networks multiply in it.
    """

    factory: LearnedPolicyFactory
    bfloat16: bool
    spent: list[float] = field(default_factory=list)

    @property
    def name(self) -> str:
        return self.factory.name

    def make_policy(self, rays: Rays) -> "Timed":
        load_once(self.factory.model).bfloat16 = self.bfloat16
        self._policy, self.spent = self.factory.make_policy(rays), []
        return self

    def select_action(self, observation: Observation, rng: np.random.Generator) -> Action | None:
        began = time.process_time()
        action = self._policy.select_action(observation, rng)
        self.spent.append(time.process_time() - began)
        return action

    def observe(self, action: Action, executed: tuple[int, ...], reward: int, after: Observation) -> None:
        began = time.process_time()
        self._policy.observe(action, executed, reward, after)
        self.spent[-1] += time.process_time() - began


def acting(library: Library, models: Sequence[str], boards: list[BoardSpec], folder: Path) -> dict[str, Any]:
    """CPU milliseconds of a recorded action, and of decisions by models, which also tell how often something moved."""
    simulator, config = Simulator(library, RenderConfig()), InteractionConfig()
    numbers = ["bfloat16", "float32"] if multiplies_bfloat16() else ["float32"]
    learned = {
        f"`{Path(model).name}`, {number}": Timed(LearnedPolicyFactory(model, "collect"), number == "bfloat16")
        for model in models
        for number in numbers
    }
    factories: dict[str, Any] = {"scripted": builtin_factory("scripted"), **learned}
    spent: dict[str, list[list[float]]] = {name: [] for name in factories}
    for board in boards:
        simulator.board(board)  # loads its objects, for whoever acts first
        for name, factory in factories.items():
            began = time.process_time()
            episode = record_episode(simulator, board, factory, STEPS, config, SEED)
            write_episode(folder / "episode.mcap", episode)
            took = [(time.process_time() - began) / STEPS]
            if name in learned:
                decisions = learned[name].spent
                took += [decisions[0], float(np.mean(decisions)), float(np.mean([s.reward for s in episode.steps]))]
            spent[name].append(took)
    told = {name: (1000 * np.median(values[1:], axis=0)).tolist() for name, values in spent.items()}
    rewarded = {name: float(np.mean(spent[name][1:], axis=0)[-1]) for name in learned}
    action = told.pop("scripted")[0]
    return {
        "steps": STEPS,
        "scripted": {"action": round(action, 1)},
        "learned": {
            name: {
                "action": round(one[0], 1),
                "to_scripted": round(one[0] / action, 2),
                "first_decision": round(one[1], 1),
                "decision": round(one[2], 1),
                "rewarded": round(rewarded[name], 2),
            }
            for name, one in told.items()
        },
    }


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


def main(words: list[str]) -> None:
    options = parser(__doc__, out=False)
    options.add_argument("--boards", type=int, default=12)
    options.add_argument("--iterations", type=int, default=30)
    options.add_argument("--models", default=DEFAULT_MODEL, help="shipped models' names and folders, comma-separated")
    arguments = options.parse_args(words)
    if arguments.boards < 2:
        raise UsageError("--boards: the first board, which warms caches, does not count", "ask for two at least")
    torch.set_num_threads(1)
    library, models = find(arguments.assets), arguments.models.split(",")
    boards = list(generate_boards(BoardConfig(boards=arguments.boards, group_size=1, seed=SEED), library))
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        cache = record(folder, library, arguments.boards)
        iterations = {
            size: {kind: iteration(kind, config, cache, folder, arguments.iterations) for kind in KINDS}
            for size, config in trainings().items()
        }
        looks = {str(threads): looking(library, boards, threads) for threads in range(1, (os.cpu_count() or 1) + 1)}
        acted = acting(library, models, boards, folder)
    result = {"iteration": iterations, "milliseconds_per_look": looks, "milliseconds": acted}
    hashes = {
        "models": {Path(model).name: fingerprint(model)["sha256"] for model in models},
        "data": {"objects": library.sha256},
    }
    print(json.dumps(finish("interact-speed", arguments, result, hashes=hashes, seed=SEED), indent=1))


def collect_phases(training: PaperTraining, folder: Path, epochs: tuple[int, ...]) -> dict[str, Any]:
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


def measure_training(training: PaperTraining, kind: Kind, samples: Samples, iterations: int) -> dict[str, Any]:
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


def whole_schedule(library: Library, iterations: int, threads: int) -> dict[str, Any]:
    """All figures of the paper's training."""
    config = PaperConfig(threads=threads)
    told = RoundProgress(lambda text: None, lambda label: nullcontext(lambda done, total: None))
    with tempfile.TemporaryDirectory() as folder:
        training = PaperTraining(Path(folder), config, Recorder(library, config, 0, threads, told))
        training.begin((config.render.height, config.render.width))
        collecting = collect_phases(training, Path(folder) / "rounds", phases(config))
        samples = training.buffer(len(collecting) - 1)
        networks: dict[str, Any] = {kind: measure_training(training, kind, samples, iterations) for kind in KINDS}
    return {
        "networks": networks,
        "collecting": collecting,
        "extrapolated": extrapolate(config, networks, collecting),
        "peak_mb": peak_mb(),
        "load_average": load_average(),
    }


def paper(words: list[str]) -> None:
    options = parser(__doc__, out=False)
    options.add_argument("--iterations", type=int, default=50, help="of each network")
    options.add_argument("--threads", type=int, default=os.cpu_count() or 1, help="of PyTorch, and collecting workers")
    arguments = options.parse_args(words)
    library = find(arguments.assets)
    used = torch_with(arguments.threads)
    figures = whole_schedule(library, arguments.iterations, arguments.threads)
    hashes = {"data": {"objects": library.sha256}}
    print(json.dumps(finish("paper-interact-speed", arguments, figures, hashes=hashes, machine=used), indent=1))


if __name__ == "__main__":
    one_of(main, paper=paper)
