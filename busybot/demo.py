"""`busybot demo`: the whole way from objects to an inferred scene graph, small enough to watch.

Procedural objects become boards, a policy that learned where and how to act records interactions with them, recordings
become relations, relations lead to a goal, and a report shows each of them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardSpec
from busybot.boards.task import least_steps, start_states, task_of
from busybot.common.atomic_io import make_folder, write_atomically, write_json
from busybot.common.errors import BusybotError
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.interact.policy.policy_factory import DEFAULT_MODEL, LearnedPolicyFactory, load_once, policy_config
from busybot.interact.policy.policy_trace import PolicyTrace, retrace
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.plan.evaluate import evaluate_agents
from busybot.plan.rollout import PlanConfig
from busybot.reason.evaluation.evaluate import ReasonEvaluation, evaluate_dataset
from busybot.reason.evaluation.explain import inferred_over_time
from busybot.reason.models.base import InferredGraph
from busybot.reason.models.registry import DEFAULT_REASONER
from busybot.sim.collect import CollectConfig, collect
from busybot.view.figures import episode as figures
from busybot.view.figures.affordance import affordance_figure
from busybot.view.figures.planning import sequence_figure
from busybot.view.report.demo import Story, demo_report
from busybot.view.rerun.recording import RecordingLayers, save_rrd
from busybot.view.screenshot import save_screenshot

BOARDS = 4
STEPS = 30
EARLY_STEP = 6
"""A second picture of the viewer shows how little is known after so many steps."""

AGENT = "search"
"""Reaches the goal."""
TASK_STEPS, TASKS_SEEN = 3, 20
"""The task takes so many actions at the least, if one of so many does."""

Say = Callable[[str], None]


@dataclass(frozen=True)
class Demo:
    """What the demo left behind.

    Attributes:
        out: the folder with everything in it.
        report: Markdown.
        recording: for Rerun.
        pictures: PNG files, figures and screenshots.
        result: of `busybot eval reason`.
        task_success: share of the task's affectable responders in their goal state.
    """

    out: Path
    report: Path
    recording: Path
    pictures: tuple[Path, ...]
    result: dict[str, Any]
    task_success: float


def run_demo(
    out: Path, seed: int, workers: int, say: Say, assets: str = "procedural", model: str = DEFAULT_MODEL
) -> Demo:
    """Run everything into an empty folder.

    Args:
        model: of the policy that acts: a shipped model's name, or a folder.

    Raises:
        BusybotError: the folder is not empty, there is no such model, or the environment is at fault.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise BusybotError(f"{out}: it exists and is not an empty folder", "name another with --out, or remove it")
    policy, library = policy_config(load_once(model).info, {}), find(assets)
    say(f"drawing {BOARDS} boards with {len(library.objects)} {library.name} objects to choose from")
    # levers with three positions and panels on every board: more to discover
    config = BoardConfig(boards=BOARDS, group_size=1, seed=seed, relations="one-to-many")
    dataset = _collect(out / "boards", config, library, workers, say, model)
    say("inferring which switch controls what, from pictures and actions alone")
    result = evaluate_dataset(dataset, ReasonEvaluation(DEFAULT_REASONER), seed=seed, workers=1)
    write_json(out / "relations.json", result)
    episodes = [read_episode(dataset.episode_path(index), "lazy") for index in range(BOARDS)]
    chosen = most_telling([episode.board for episode in episodes])
    inferred = inferred_over_time(episodes[chosen], DEFAULT_REASONER, STEPS + 1)
    rollout, planned = _reach_goal(out, library, seed, say, model)
    say("drawing figures")
    thoughts = list(retrace(episodes[chosen], load_once(model), policy))
    pictures = _figures(out / "figures", episodes, chosen, inferred, thoughts)
    pictures["sequence"] = sequence_figure(out / "figures" / "sequence.png", rollout)
    recording = out / f"board-{chosen}.rrd"
    save_rrd(recording, episodes[chosen], [inferred], layers=RecordingLayers(thoughts))
    say("taking pictures of the viewer")
    for step in (EARLY_STEP, STEPS):
        picture = out / "figures" / f"viewer-step-{step:02d}.png"
        save_screenshot(recording, picture, step)
        pictures[f"viewer_{step}"] = picture
    report = out / "report.md"
    story = Story(episodes, chosen, inferred, result, dataset.info, recording, pictures, EARLY_STEP, rollout, planned)
    write_atomically(report, demo_report(story, out).encode())
    return Demo(out, report, recording, tuple(pictures.values()), result, planned["success"])


def _collect(path: Path, config: BoardConfig, library: Library, workers: int, say: Say, model: str) -> Dataset:
    dataset = create_dataset(path, config, library)
    say(f"acting {STEPS} times on {'each' if config.boards > 1 else 'it'} and recording what happens")
    factory, acting = LearnedPolicyFactory(model, "collect"), CollectConfig(policy="learned", steps=STEPS)
    collect(dataset, library, acting, min(workers, config.boards), None, factory, factory.provenance())
    return dataset


def _reach_goal(out: Path, library: Library, seed: int, say: Say, model: str) -> tuple[Episode, dict[str, Any]]:
    """A board with a goal, and `search` on it: the rollout, and what `busybot eval plan` tells of the agent."""
    say("drawing a board with a goal")
    dataset = _collect(out / "task", _task(library, seed), library, 1, say, model)
    say("reaching the goal with what was learned")
    record = out / "rollouts"
    result = evaluate_agents(dataset, library, [AGENT], DEFAULT_REASONER, model, PlanConfig(), seed, record=record)
    rollout = read_episode(Dataset.open(record / AGENT).episode_path(0), "lazy")
    return rollout, result["agents"][AGENT]


def _task(library: Library, seed: int) -> BoardConfig:
    """A board with a goal: from the seed on, the first one that takes several actions."""
    for number in range(seed, seed + TASKS_SEEN):
        config = BoardConfig(boards=1, group_size=1, seed=number, tasks="one-to-many")
        board = next(iter(generate_boards(config, library)))
        if least_steps(start_states(board), task_of(board).goal) >= TASK_STEPS:
            break
    return config


def most_telling(boards: list[BoardSpec]) -> int:
    """The board with the most kinds of relations, then the most relations."""
    return max(range(len(boards)), key=lambda i: (len({r.kind for r in boards[i].relations}), len(boards[i].relations)))


def _figures(
    folder: Path, episodes: list[Episode], chosen: int, inferred: InferredGraph, thoughts: list[PolicyTrace]
) -> dict[str, Path]:
    make_folder(folder, folder.parent)
    episode = episodes[chosen]
    return {
        "boards": figures.boards_figure(folder / "boards.png", episodes, named=chosen),
        "affordance": affordance_figure(folder / "affordance.png", episode, thoughts),
        "episode": figures.episode_figure(folder / "episode.png", episode),
        "graph": figures.graph_figure(folder / "graph.png", episode, inferred),
        "refinement": figures.refinement_figure(folder / "refinement.png", episode, inferred),
        "changes": figures.changes_figure(folder / "changes.png", episode),
    }
