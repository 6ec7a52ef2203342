"""Measure agents on a dataset of tasks with recorded histories (paper section 5.3, Table 3).

The result of a task depends on the board, its history, the models and the seed. Processor times differ from run to run
and stand apart, under `timing`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from busybot.boards.task import shortest_plan, start_states, task_of
from busybot.common.errors import BusybotError, UsageError, naming
from busybot.common.process_pool import Progress
from busybot.common.rng import generator
from busybot.common.text import one_line
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import CollectInfo, collect_command
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.evaluation.folder import BoardWork, EvaluationRecording, conclude, judge_boards
from busybot.evaluation.judgements import log_judgement
from busybot.evaluation.results import stamp
from busybot.interact.policy.policy_factory import candidates_config, fingerprint, load_once
from busybot.objects.library import Library
from busybot.plan import metrics as m
from busybot.plan.agents.registry import TRAINED, kind_of, name_of
from busybot.plan.learning.network import load_policy
from busybot.plan.rollout import PlanConfig, RolloutRunner, check_settings
from busybot.reason.inputs.feature_store import features_of
from busybot.reason.models.registry import config_class, reasoner_of, without_training
from busybot.sim.collect import episode_seconds
from busybot.sim.scene.board_scene import Simulator
from busybot.training.model_cards import file_hashes, find_folder


@dataclass(frozen=True)
class PlanEvaluation:
    """Agents on tasks; plain data for worker processes.

    Attributes:
        dataset: with tasks and recorded histories.
        library: its objects.
        agents: as `agents.registry.kind_of` takes them.
        reasoner: one without training by its name, or a trained model's name or folder.
        policy_model: interaction model, whose candidates agents choose from.
        seed: of the agents' draws.
        record: folder for the rollouts: in it a dataset for every agent.
    """

    dataset: Dataset
    library: Library
    agents: Sequence[str]
    reasoner: str
    policy_model: str
    config: PlanConfig = PlanConfig()
    seed: int = 0
    record: Path | None = None


def evaluate_agents(
    evaluation: PlanEvaluation, workers: int = 1, progress: Progress | None = None, out: Path | None = None
) -> dict[str, Any]:
    """Let every agent play every task and compute the metrics; JSON values, see `metrics.summarise`.

    Args:
        out: folder for the results, with which a stopped evaluation goes on.

    Raises:
        BusybotError: the dataset has no tasks or histories, there is no such agent or model, `out` or `record` hold
            something else, or a worker is at fault.
    """
    dataset, seed, record = evaluation.dataset, evaluation.seed, evaluation.record
    reasoner = reasoner_of(evaluation.reasoner)
    for agent in evaluation.agents:
        if (make := kind_of(agent).make) is not None:
            make(reasoner)
    names = [name_of(agent) for agent in evaluation.agents]
    if len(set(names)) < len(names):
        raise UsageError("an agent is named twice", "evaluate its models one after the other")
    tasks = _tasks(dataset, evaluation.config)
    settings = _settings(evaluation)
    features_of(dataset, reasoner.encoder, episodes=tasks, workers=workers)
    seconds = episode_seconds(evaluation.config.steps * len(names))
    work = BoardWork(m.JudgedTask, make_work, (evaluation,), workers, seconds)
    recordings = [
        EvaluationRecording(record / one, dataset, _collected(settings, one), record) for one in names if record
    ]
    found = judge_boards(tasks, work, settings, progress, out, recordings)
    rng = generator(seed, dataset.info.split, 0, "plan/bootstrap")
    figures = {**m.summarise(found, names, rng), **settings, "timing": m.timing(found, names)}
    result = {**stamp("plan", hashes=_hashes(settings)), **figures}
    result["world"] = ", ".join(sorted({board.world for board in dataset.boards()[: len(tasks)]}))
    result["logged"] = log_judgement(dataset, tasks, f"{', '.join(names)} ({settings['reasoner']})", result)
    return conclude(out, result)


def trained_elsewhere(evaluation: PlanEvaluation) -> list[str]:
    """Sentences about trained agents that learned among the candidates of another interaction model."""
    told, here = [], fingerprint(evaluation.policy_model)
    for agent in evaluation.agents:
        kind_of(agent)  # or it says what is missing
        name, _, path = agent.partition("=")
        if kind := next((one for one in TRAINED if one == name), None):
            known = load_policy(path, kind)[0].training.get("model")
            if isinstance(known, dict) and known.get("sha256") != here["sha256"]:
                what = (
                    f"{path} learned among the candidates of the interaction model {one_line(str(known.get('name')))}"
                )
                told.append(f"{what}, and chooses here among those of {here['name']}; --policy-model names another")
    return told


def make_work(evaluation: PlanEvaluation) -> Callable[[int], m.JudgedTask]:
    """What a worker does with a board's index: all agents play its task."""
    dataset, record, config = evaluation.dataset, evaluation.record, evaluation.config
    loaded, model = reasoner_of(evaluation.reasoner), load_once(evaluation.policy_model)
    policy = candidates_config(model.info, config.learned)
    simulator = Simulator(evaluation.library, config.render)
    player = RolloutRunner(simulator, loaded, model, policy, config.interaction, evaluation.seed, config.steps)
    stored = {agent: Dataset.open(record / name_of(agent)) for agent in evaluation.agents} if record else {}

    def work(index: int) -> m.JudgedTask:
        history = read_episode(dataset.episode_path(index), "lazy")
        features = features_of(dataset, loaded.encoder, episodes=[index], workers=1)[index]
        with naming(dataset.board_place(index)):
            task = player.prepare(history, features)
        rollouts = []
        for agent in evaluation.agents:
            with naming(dataset.board_place(index)):
                played = player.play(task, agent)
            rollouts.append(played.judged)
            if agent in stored:
                write_episode(stored[agent].episode_path(index), played.episode, "jpeg", stored[agent].path)
        board = history.board
        return m.JudgedTask(
            board=index,
            kind=task_of(board).kind,
            least_steps=shortest_plan(board),
            locks=len(board.locks),
            unmoved=unmoved_links(history),
            rollouts=tuple(rollouts),
        )

    return work


def unmoved_links(history: Episode) -> int:
    """How many links stand elsewhere in the goal and moved in no action of the history."""
    moved = {
        link
        for step in history.steps
        for link, (before, after) in enumerate(zip(step.trigger_states_before, step.trigger_states_after, strict=True))
        if before != after
    }
    start, goal = start_states(history.board), task_of(history.board).goal
    return sum(a != b and link not in moved for link, (a, b) in enumerate(zip(start, goal, strict=True)))


def _tasks(dataset: Dataset, config: PlanConfig) -> list[int]:
    """Numbers of the boards, all of which must have a task and a history, seen as the rollouts will be."""
    check_settings(dataset, config.render, config.interaction)
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


def _provenance(model: str, skill: str) -> dict[str, Any]:
    """What decides what a model does, without where it lies; `skill` is as of `find_folder`."""
    if skill == "reason" and model in without_training():
        return {"name": model, "config": config_class(model)().model_dump(mode="json")}
    folder = find_folder(model, skill)
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


def _settings(evaluation: PlanEvaluation) -> dict[str, Any]:
    """What is measured; two results are comparable as far as these agree."""
    dataset, agents, config = evaluation.dataset, evaluation.agents, evaluation.config
    info, hashes = dataset.info, dataset.hashes()
    origin = {"name": info.name, "split": info.split, "boards": info.boards, "seed": info.seed}
    policy = candidates_config(load_once(evaluation.policy_model).info, config.learned)
    trained = [agent.partition("=") for agent in agents if name_of(agent) in TRAINED]
    return {
        "names": [name_of(agent) for agent in agents],
        "oracles": [agent for agent in agents if kind_of(agent).oracle],
        "steps": config.steps,
        "reasoner": reasoner_of(evaluation.reasoner).name,
        "provenance": {
            "reasoner": _provenance(evaluation.reasoner, "reason"),
            "agents": {name: _provenance(model, name) for name, _, model in trained},
            "interaction": {"model": fingerprint(evaluation.policy_model), "policy": policy.provenance()},
        },
        "config": config.model_dump(mode="json"),
        "dataset": origin | {"assets": info.assets.name, "board_hash": hashes.board, "content_hash": hashes.content},
        "seed": evaluation.seed,
    }
