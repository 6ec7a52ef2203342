"""Measures what a machine makes of its GPUs, or of its CPU: pictures, interactions and training iterations a second.

    python -m benchmarks.speed.hardware [--device auto] [--workers 1 2 4] [--seconds 5] [--assets DIR] [--out FILE]

One command for any machine. Figures are by the clock, on whatever else the machine does (its load is noted); on a CPU
that is shared those per second of processor time say more.

Pictures: workers show one board each in another state every time; a frame is drawn, read back and converted to RGB,
depth and segmentation, as it is recorded. Our shader pack and SAPIEN's `minimal` one, at the usual size and at a tenth
of it. Interactions: workers build their board, act on it ten times, encode and write the episode, again and again; the
`learned` policy is the shipped one. All workers of a row begin together, when each has done it once.

Training: iterations of the interaction networks (ours and the paper's) and of the models of relations, after one that
does not count, each in one process, batches included. On a CPU the paper's networks get a few samples or boards, and
are scaled up to its batches. Relations of the paper's sizes are learned from made-up numbers.

`paper` profile: minutes of its stages, **extrapolated** from these figures and the profile's sizes; nobody ran it. Made
up of what dominates a stage; what it starts and imports is left out. `interact` acts at the scripted policy's rate and
looks at the board with both networks before every action, one worker at a time. In the stages after it the paper's
policy is taken to decide as fast as ours. For `plan` and `rollouts` every agent is taken to act eight times on every
task; what its reasoner infers is left out.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import count, takewhile
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.runner import finish, load_average, one_of, parser, product_seconds, timed, torch_with
from benchmarks.speed.interact import SEED, record
from benchmarks.speed.reason import made_up, measure
from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardSpec
from busybot.common.device import choose, gpus
from busybot.common.process_pool import default_workers, run_tasks
from busybot.common.rng import generator
from busybot.datasets.dataset import Dataset
from busybot.episodes.camera import Rays
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.interact.affordance.networks import KINDS, SIZE, Kind
from busybot.interact.affordance.paper import CHUNK, PaperModel
from busybot.interact.policy.config import AffordanceInfo
from busybot.interact.policy.policy_factory import DEFAULT_MODEL, LearnedPolicyFactory, fingerprint
from busybot.interact.training.config import PaperConfig, TrainConfig
from busybot.interact.training.fast_learner import FastAffordanceLearner, FitJob
from busybot.interact.training.paper import PaperAffordanceLearner
from busybot.interact.training.sample_cache import cache_samples, open_samples
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.reason.evaluation.evaluate import CURVE, IMAGES
from busybot.reason.inputs.feature_store import features_of
from busybot.reason.models.event.config import EventConfig
from busybot.reason.models.event.learner import EventLearner
from busybot.reason.models.paper.config import PaperReasonConfig
from busybot.reason.models.paper.learner import make_network
from busybot.reason.models.paper.networks import PaperReasoner
from busybot.sim import vulkan_check
from busybot.sim.builtin_policies import builtin_factory
from busybot.sim.interaction import InteractionConfig
from busybot.sim.policy import AnyPolicyFactory
from busybot.sim.recorder import record_episode
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.render import RenderConfig
from busybot.training.device import device
from pipelines.profile import Profile, read_profile

PACKS = ("busybot", "minimal")
SIZES = ((640, 480), (64, 48))
POLICIES = ("scripted", "learned")
STEPS, PLAN_STEPS = 10, 8
ROUND = 12
"""Boards of the round that networks are trained on here."""


@dataclass(frozen=True)
class Load:
    """What workers do for a while; plain data.

    Attributes:
        does: `frames`, or the policy that acts.
        folder: where workers meet, and write.
    """

    does: str
    library: Library
    render: RenderConfig
    workers: int
    seconds: float
    folder: Path


def make_work(load: Load) -> Callable[[int], tuple[float, float]]:
    """What a worker does with its number; it returns how many a second it managed, by clock and by processor."""
    config = BoardConfig(boards=load.workers, group_size=1, seed=SEED)
    boards = list(generate_boards(config, load.library))
    simulator = Simulator(load.library, load.render)

    def work(number: int) -> tuple[float, float]:
        once = (showing if load.does == "frames" else acting)(load, simulator, boards[number])
        once()
        (load.folder / f"ready-{number}").touch()
        while len(list(load.folder.glob("ready-*"))) < load.workers:
            time.sleep(0.01)
        began, began_cpu, done = time.monotonic(), time.process_time(), 0
        while time.monotonic() - began < load.seconds:
            done += once()
        return done / (time.monotonic() - began), done / (time.process_time() - began_cpu)

    return work


def showing(load: Load, simulator: Simulator, board: BoardSpec) -> Callable[[], int]:
    """A frame of the board with another link moved."""
    scene, numbers = simulator.board(board), count()

    def once() -> int:
        number = next(numbers)
        trigger = number % len(scene.triggers)
        scene.set_trigger(trigger, number // len(scene.triggers) % scene.triggers[trigger].link.states)
        scene.observe()
        return 1

    return once


def acting(load: Load, simulator: Simulator, board: BoardSpec) -> Callable[[], int]:
    """An episode, written."""
    learned = load.does == "learned"
    factory: AnyPolicyFactory = (
        LearnedPolicyFactory(DEFAULT_MODEL, "collect") if learned else builtin_factory(load.does)
    )

    def once() -> int:
        episode = record_episode(simulator, board, factory, STEPS, InteractionConfig(), SEED)
        write_episode(load.folder / f"{board.index}.mcap", episode)
        return STEPS

    return once


def per_second(library: Library, does: str, workers: int, seconds: float, render: RenderConfig) -> dict[str, float]:
    """How many a second all workers manage together by the clock, and each of them per second of its processor."""
    with tempfile.TemporaryDirectory() as folder:
        load = Load(does, library, render, workers, seconds, Path(folder))
        rates = np.array([rate for _, rate in run_tasks(range(workers), make_work, (load,), workers)])
    by_clock, by_processor = float(rates[:, 0].sum()), float(rates[:, 1].mean())
    return {"per_second": round(by_clock, 2), "per_processor_second": round(by_processor, 2)}


def rendering(library: Library, workers: list[int], seconds: float) -> dict[str, Any]:
    """Frames and megapixels a second by shader pack and size, then by number of workers."""
    found: dict[str, Any] = {}
    for pack in PACKS:
        for width, height in SIZES:
            row = found.setdefault(f"{pack}, {width} x {height}", {})
            for number in workers:
                config = RenderConfig.model_validate({"shader": pack, "width": width, "height": height})
                told = per_second(library, "frames", number, seconds, config)
                row[str(number)] = {**told, "megapixels": round(told["per_second"] * width * height / 1e6, 2)}
    return found


def interacting(library: Library, workers: list[int], seconds: float) -> dict[str, Any]:
    """Interactions a second by policy, then by number of workers."""
    return {
        policy: {str(number): per_second(library, policy, number, seconds, RenderConfig()) for number in workers}
        for policy in POLICIES
    }


def seconds_each(work: Callable[[], object], times: int) -> float:
    """Median by the clock, of a GPU's work, too."""

    def finished() -> None:
        work()
        if device().type == "cuda":
            torch.cuda.synchronize(device())

    return float(np.median(timed(finished, times)[0]))


def fast_iteration(kind: Kind, cache: Path, folder: Path, iterations: int) -> float:
    """Seconds of an iteration of one of our interaction networks."""
    learner = FastAffordanceLearner(FitJob(folder / "unused", TrainConfig(), SEED, kind, (cache,), None, 0, 10**6))
    rng = generator(SEED, "train", 0, f"benchmark/{kind}")
    return seconds_each(lambda: learner.learn(learner.draw(rng)[1], 1e-4, rng), iterations)


def paper_networks(round_: Dataset, folder: Path, iterations: int) -> tuple[dict[Kind, float], float]:
    """Seconds of an iteration of the paper's interaction networks, and of a look with both at 640 x 480 pixels."""
    batch = {"batch": 2} if device().type == "cpu" else {}
    config, whole = PaperConfig.model_validate({"position": batch, "direction": batch}), PaperConfig()
    samples = open_samples([cache_samples(round_, folder / "whole", "depth", whole=True)], "depth", 10**6, whole=True)
    learners = {kind: PaperAffordanceLearner(folder / "unused", config, SEED, kind, SIZE) for kind in KINDS}
    rng = generator(SEED, "train", 0, "benchmark/paper")
    found: dict[Kind, float] = {}
    for kind, learner in learners.items():
        seconds = seconds_each(partial(learner.learn, samples, rng), iterations)
        found[kind] = seconds * whole.learn(kind).batch / config.learn(kind).batch
    model = PaperModel(AffordanceInfo(variant="paper"), {kind: one.network for kind, one in learners.items()})
    episode = read_episode(round_.episode_path(min(round_.finished())))
    seen, rays = episode.observation(0), Rays(episode.camera)
    return found, seconds_each(lambda: model.directions(model.look(seen, rays), np.zeros((CHUNK, 2), int)), iterations)


def event_iteration(iterations: int) -> float:
    """Seconds of an iteration of the `event` model."""
    learner, numbers = EventLearner(EventConfig(), made_up(2 * EventConfig().batch), [], SEED), count()
    return seconds_each(lambda: learner.iterate(next(numbers)), iterations)


def judged_board(iterations: int) -> float:
    """Seconds that the `paper` model of relations takes to judge a board."""
    [made] = made_up(1)
    reasoner = PaperReasoner(make_network(PaperReasonConfig(), SEED).to(device()), "random")
    first = IMAGES - 1

    def judge() -> None:
        board = replace(made)  # of which nothing was inferred yet
        reasoner.graph(board.first(IMAGES))
        for images in CURVE:
            asked = (board.features[first:-1], board.actions[first:], board.acted[first:])
            reasoner.predict(board.first(images), *asked)

    return seconds_each(judge, iterations)


def training(library: Library, arguments: argparse.Namespace, threads: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Seconds of iterations by network, and what else the extrapolation needs."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        cache = record(folder, library, ROUND)
        found = {
            f"interaction, {kind} (fast)": fast_iteration(kind, cache, folder, arguments.iterations) for kind in KINDS
        }
        began = time.monotonic()
        features = features_of(Dataset.open(folder / "round"), "random", store=folder / "store", workers=threads)
        frames = sum(len(values) for values in features.values())
        frame_seconds = (time.monotonic() - began) / frames
        papers, look = paper_networks(Dataset.open(folder / "round"), folder, arguments.iterations)
    found |= {f"interaction, {kind} (paper)": seconds for kind, seconds in papers.items()}
    found["relations (event)"] = event_iteration(arguments.iterations)
    boards = PaperReasonConfig().batch if device().type == "cuda" else 8
    found["relations (paper)"] = measure("fast, all pairs", made_up(boards), arguments.iterations)["seconds"]
    needed = {
        "look_seconds": round(look, 4),
        "feature_frame_seconds": round(frame_seconds, 5),
        "judged_board_seconds": round(judged_board(arguments.iterations), 3),
    }
    return {name: {"seconds": round(one, 4), "per_second": round(1 / one, 3)} for name, one in found.items()}, needed


def extrapolated(
    profile: Profile, rates: dict[str, float], seconds_of: dict[str, float], needed: dict[str, float]
) -> dict[str, float]:
    """Minutes of the profile's stages.

    Args:
        rates: interactions a second by policy, and boards judged a second (`relations`).
        seconds_of: of an iteration by network.
        needed: of `training`.
    """
    judged = len(profile.judge.splits) * profile.judge.boards * STEPS
    boards = {name: one.boards for name, one in profile.data.sets.items()}
    cells = len(profile.tasks.splits) * len(profile.tasks.kinds)
    played = cells * PLAN_STEPS / rates["learned"]
    config, acting = PaperReasonConfig(), PaperConfig()
    iterations = config.epochs * -(-boards["train"] // config.batch)
    trained = [kind for epoch in range(acting.epochs) for kind in acting.trained(epoch)]
    learned = sum(acting.learn(kind).iterations * seconds_of[f"interaction, {kind} (paper)"] for kind in trained)
    acted = acting.epochs * acting.boards * acting.steps
    seconds = {
        "interact": learned + acted * (1 / rates["scripted"] + needed["look_seconds"]),
        "judge": judged / rates["learned"],
        "chance": judged / rates["scripted"],
        "data": sum(boards.values()) * profile.data.steps / rates["learned"],
        "features": sum(boards.values()) * (profile.data.steps + 1) * needed["feature_frame_seconds"],
        "reason": iterations * seconds_of["relations (paper)"],
        "relations": sum(boards[name] for name in profile.relations.sets) / rates["relations"],
        "tasks": cells * profile.tasks.boards * profile.tasks.steps / rates["learned"],
        "plan": profile.tasks.boards * len(profile.tasks.agents.split(",")) * played,
        "rollouts": profile.tasks.recorded * len(profile.tasks.shown.split(",")) * played,
    }
    return {name: round(one / 60, 1) for name, one in {**seconds, "all": sum(seconds.values())}.items()}


def main(words: list[str] | None = None) -> None:
    options = parser(__doc__, out=False)
    options.add_argument("--device", default="auto", help="auto, cpu, cuda or cuda:N")
    options.add_argument("--workers", type=int, nargs="+", help="by default doubled up to one per core")
    options.add_argument("--seconds", type=float, default=5.0, help="of each figure of pictures and interactions")
    options.add_argument("--iterations", type=int, default=3, help="of each network")
    arguments = options.parse_args(words)
    choose(arguments.device)
    most, library = default_workers(), find(arguments.assets)
    workers = arguments.workers or sorted({*takewhile(lambda number: number < most, (2**k for k in count())), most})
    used = {"gpus": gpus(), "renderer": vulkan_check.run()["device"], **torch_with(most)}
    before = load_average()
    frames = rendering(library, workers, arguments.seconds)
    interactions = interacting(library, workers, arguments.seconds)
    iterations, needed = training(library, arguments, most)
    rates = {policy: max(one["per_second"] for one in row.values()) for policy, row in interactions.items()}
    rates["relations"] = max(workers) / needed["judged_board_seconds"]
    seconds_of = {name: one["seconds"] for name, one in iterations.items()}
    figures = {
        "frames": frames,
        "interactions_per_second": interactions,
        "iterations": iterations,
        "paper_profile": {**needed, "minutes": extrapolated(read_profile("paper"), rates, seconds_of, needed)},
        "product_milliseconds": round(1000 * product_seconds(20), 2),
        "load_average": {"before": before, "after": load_average()},
    }
    hashes = {"models": {DEFAULT_MODEL: fingerprint(DEFAULT_MODEL)["sha256"]}, "data": {"objects": library.sha256}}
    print(json.dumps(finish("hardware", arguments, figures, hashes=hashes, machine=used, seed=SEED), indent=1))


if __name__ == "__main__":
    one_of(main)
