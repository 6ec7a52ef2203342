"""Measure agents on a dataset of tasks with recorded histories (protocol "Planning", Table 3).

The result of a task depends on the board, its history, the models and the seed. Processor times differ from run to run
and stand apart, under `timing`.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from busybot.boards.task import MAX_STEPS, least_steps, start_states, task_of
from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import CollectInfo, collect_command
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.evaluation.folder import BoardWork, EvaluationRecording, Progress, conclude, judge_boards, versions
from busybot.evaluation.results import stamp
from busybot.interact.policy.policy_factory import fingerprint, load_once, policy_config
from busybot.objects.library import Library
from busybot.plan import metrics as m
from busybot.plan.agents.registry import TRAINED, kind_of, name_of
from busybot.plan.rollout import PlanConfig, RolloutRunner
from busybot.reason.inputs.feature_store import features_of
from busybot.reason.models.registry import REASONERS, config_class, reasoner_of
from busybot.sim.scene.board_scene import Simulator
from busybot.training.model_cards import file_hashes, find_folder


def evaluate_agents(
    dataset: Dataset,
    library: Library,
    agents: Sequence[str],
    reasoner: str,
    policy_model: str,
    config: PlanConfig,
    seed: int = 0,
    workers: int = 1,
    progress: Progress | None = None,
    out: Path | None = None,
    record: Path | None = None,
) -> dict[str, Any]:
    """Let every agent play every task and compute the metrics; JSON values, see `metrics.summarise`.

    Args:
        dataset: with tasks and recorded histories.
        agents: as `plan.rollout.kind_of` takes them.
        reasoner: one without training by its name, or a trained model's name or folder.
        policy_model: interaction model, whose candidates agents choose from.
        seed: of the agents' draws.
        out: folder for the results, with which a stopped evaluation goes on.
        record: folder for the rollouts: in it a dataset for every agent.

    Raises:
        BusybotError: the dataset has no tasks or histories, there is no such agent or model, `out` or `record` hold
            something else, or a worker is at fault.
    """
    for agent in agents:
        kind_of(agent)
    names = [name_of(agent) for agent in agents]
    if len(set(names)) < len(names):
        raise BusybotError("an agent is named twice", "evaluate its models one after the other")
    tasks = _tasks(dataset, config)
    settings = _settings(dataset, agents, reasoner, policy_model, config, seed)
    features_of(dataset, reasoner_of(reasoner).encoder, episodes=tasks, workers=workers)
    arguments = (dataset.path, library, tuple(agents), reasoner, policy_model, config, seed, record)
    work = BoardWork(m.JudgedTask, make_work, arguments, workers)
    recordings = [
        EvaluationRecording(record / one, dataset, _collected(settings, one), record) for one in names if record
    ]
    found = judge_boards(tasks, work, settings, progress, out, recordings)
    rng = generator(seed, dataset.info.split, 0, "plan/bootstrap")
    figures = {**m.summarise(found, names, rng), **settings, "timing": m.timing(found, names)}
    return conclude(out, {**stamp("plan", hashes=_hashes(settings)), **figures})


def make_work(
    path: Path,
    library: Library,
    agents: tuple[str, ...],
    reasoner: str,
    policy_model: str,
    config: PlanConfig,
    seed: int,
    record: Path | None,
) -> Callable[[int], m.JudgedTask]:
    """What a worker does with a board's index: all agents play its task."""
    dataset, loaded, model = Dataset.open(path), reasoner_of(reasoner), load_once(policy_model)
    simulator = Simulator(library, config.render)
    policy = policy_config(model.info, config.learned)
    player = RolloutRunner(simulator, loaded, model, policy, config.interaction, seed)
    stored = {name: Dataset.open(record / name) for name in map(name_of, agents)} if record else {}

    def work(index: int) -> m.JudgedTask:
        history = read_episode(dataset.episode_path(index))
        task = player.prepare(history, features_of(dataset, loaded.encoder, episodes=[index], workers=1)[index])
        rollouts = []
        for agent in agents:
            played = player.play(task, agent)
            rollouts.append(played.judged)
            if (name := name_of(agent)) in stored:
                write_episode(stored[name].episode_path(index), played.episode, "jpeg", stored[name].path)
        board = history.board
        least = least_steps(start_states(board), task_of(board).goal)
        kind = task_of(board).kind
        return m.JudgedTask(board=index, kind=kind, least_steps=least, rollouts=tuple(rollouts))

    return work


def _tasks(dataset: Dataset, config: PlanConfig) -> list[int]:
    """Numbers of the boards, all of which must have a task and a history."""
    count = min(config.boards or dataset.info.boards, dataset.info.boards)
    boards, recorded = dataset.boards(), dataset.finished()
    for index in range(count):
        if boards[index].task is None:
            hint = "make a dataset with tasks: busybot generate OUT --tasks one-to-one"
            raise BusybotError(f"{dataset.path}: board {index} has no task", hint)
        if index not in recorded:
            what = f"{dataset.path}: board {index} has no recorded interactions"
            raise BusybotError(what, collect_command(dataset.path, dataset.info))
    return list(range(count))


def _reasoner_provenance(reasoner: str) -> dict[str, Any]:
    """What decides what a reasoner says, without where it lies."""
    if reasoner in REASONERS:
        return {"name": reasoner, "config": config_class(reasoner)().model_dump(mode="json")}
    folder = find_folder(reasoner, "reason")
    return {"name": folder.name, "sha256": file_hashes(folder)}


def _policy_provenance(agent: str) -> dict[str, Any]:
    """What decides what a trained agent does, without where it lies."""
    name, _, model = agent.partition("=")
    folder = find_folder(model, name)
    return {"name": folder.name, "sha256": file_hashes(folder)}


def _hashes(settings: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Of the tasks, their histories and the files of all models; who learned nothing has none."""
    told, origin = settings["provenance"], settings["dataset"]
    models = {"reasoner": told["reasoner"], "interaction": told["interaction"]["model"], **told["agents"]}
    return {
        "models": {name: model["sha256"] for name, model in models.items() if "sha256" in model},
        "tasks": {origin["name"]: origin["board_hash"]},
        "histories": {origin["name"]: origin["content_hash"]},
    }


def _collected(settings: dict[str, Any], agent: str) -> CollectInfo:
    """How an agent's rollouts are recorded."""
    config = settings["config"]
    return CollectInfo(
        policy=agent,
        steps=settings["steps"],
        strict=config["interaction"]["strict"],
        delta=config["interaction"]["delta"],
        seed=settings["seed"],
        settings={name: config[name] for name in ("interaction", "render")} | {"models": settings["provenance"]},
    )


def _settings(
    dataset: Dataset, agents: Sequence[str], reasoner: str, policy_model: str, config: PlanConfig, seed: int
) -> dict[str, Any]:
    """What is measured; two results are comparable as far as these agree."""
    info, hashes = dataset.info, dataset.hashes()
    origin = {"name": info.name, "split": info.split, "boards": info.boards, "seed": info.seed}
    policy = policy_config(load_once(policy_model).info, config.learned)
    return {
        "names": [name_of(agent) for agent in agents],
        "oracles": [agent for agent in agents if kind_of(agent).oracle],
        "steps": MAX_STEPS,
        "reasoner": reasoner_of(reasoner).name,
        "provenance": {
            "reasoner": _reasoner_provenance(reasoner),
            "agents": {name_of(agent): _policy_provenance(agent) for agent in agents if name_of(agent) in TRAINED},
            "interaction": {"model": fingerprint(policy_model), "policy": policy.provenance()},
        },
        "config": config.model_dump(mode="json"),
        "dataset": origin | {"assets": info.assets.name, "board_hash": hashes.board, "content_hash": hashes.content},
        "seed": seed,
        "versions": versions(),
    }
