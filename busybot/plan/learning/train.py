"""`busybot train bc` and `busybot train ppo`: the paper's learned agents, trained on training boards only.

A training is a folder:

train.json                  what was asked for; the same command continues, another one is refused
boards/                     the boards that were explored, unless another folder was named
model/                      the trained policy, with provenance and figures
metrics.csv, metrics.json   losses, and success on boards of appearance groups that were held out
training.png                the same as a picture
budget.json                 time and interactions that were used; differs from run to run
checkpoints/, metrics/      to go on from where a killed training stopped
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from busybot.boards.dynamics import Dynamics
from busybot.boards.worlds import links_of
from busybot.common.atomic_io import read_json, write_json
from busybot.common.errors import BusybotError, needs_extra
from busybot.common.process_pool import Progress
from busybot.datasets.bundled_assets import library_of
from busybot.datasets.dataset import Dataset
from busybot.datasets.summary import origin_of
from busybot.interact.policy.policy_factory import candidates_config, card_of, fingerprint
from busybot.objects.library import Library
from busybot.plan.learning.bc import BcLearner
from busybot.plan.learning.board_graph import ExploredBoard
from busybot.plan.learning.config import BcConfig, PpoConfig
from busybot.plan.learning.encoding import OBJECTS
from busybot.plan.learning.explore import BoardGraphConfig, explored_boards
from busybot.plan.learning.network import PolicyInfo
from busybot.plan.rollout import check_settings
from busybot.reason.models.lookup import Persistence
from busybot.training.checkpoint import save_model
from busybot.training.loop import LoopConfig, fit, groups_apart
from busybot.training.model_cards import INFO_FILE, read_info
from busybot.training.run_folder import Panel, begin_folder, draw, judgements, learner_versions, losses, read_metrics

if TYPE_CHECKING:
    from busybot.plan.learning.ppo import PpoLearner

BUDGET = "budget.json"

Config = BcConfig | PpoConfig
CONFIGS: dict[str, type[BcConfig] | type[PpoConfig]] = {"bc": BcConfig, "ppo": PpoConfig}
"""Parameters by agent."""
Told = Callable[[str], AbstractContextManager[Progress]]
"""Opens a progress display of this name."""


@dataclass(frozen=True)
class PracticeSource:
    """Where the boards come from on which agents practise.

    Attributes:
        data: datasets with tasks and recorded histories, of the training split.
        model: interaction model, whose candidates the agent chooses from.
        assets: objects, if they are not found by their hashes.
        explored: folder of explored boards that several trainings share; None for the training's own.
    """

    data: tuple[Path, ...]
    model: str
    assets: str | None = None
    explored: Path | None = None


def train_policy(
    out: Path, config: Config, source: PracticeSource, seed: int, workers: int, told: Told
) -> tuple[PolicyInfo, dict[str, Any]]:
    """Train, or continue a training that was interrupted.

    Returns:
        what the policy's `model.json` says, and what `budget.json` does.

    Raises:
        BusybotError: the folder holds another training, a dataset cannot be trained on, or sb3-contrib is missing.
    """
    if config.agent == "ppo" and find_spec("sb3_contrib") is None:
        raise needs_extra("sb3-contrib", "baselines")
    datasets = [_of_training(Dataset.open(path), config.explore) for path in source.data]
    done = (out / "model" / INFO_FILE).exists()
    pairs = [] if done else [(dataset, library_of(dataset, source.assets)) for dataset in datasets]
    for pair in pairs:
        _explorable(*pair)
    candidates_config(card_of(source.model), config.explore.learned)  # before anything is written
    provenance: dict[str, Any] = {
        "data": [origin_of(dataset) for dataset in datasets],
        "model": fingerprint(source.model),
    }
    begin_folder(out, config, seed, **provenance)
    if done:
        return read_info(out / "model", PolicyInfo), read_json(out / BUDGET)
    folder = source.explored or out / "boards"
    with told("exploring boards") as progress:
        found = explored_boards(folder, pairs, source.model, config.explore, workers, progress)
    boards, held_out = held_apart(found, config.loop, seed)
    learner = make_learner(config, boards, held_out, seed)
    figures = fit(learner, out, config.loop)
    _plot(out, config.agent)
    budget = _budget(found, learner, figures)
    write_json(out / BUDGET, budget)
    training = {
        "seed": seed,
        "config": config.model_dump(mode="json"),
        **provenance,
        "boards": len(boards),
        "boards_held_out": len(held_out),
        **figures,
        "versions": learner_versions(),
    }
    info = PolicyInfo(agent=config.agent, encoder=Persistence.encoder, net=config.net, training=training)
    save_model(out / "model", info, learner.policy.state_dict())
    return info, budget


def held_apart(
    found: Sequence[ExploredBoard], loop: LoopConfig, seed: int
) -> tuple[list[ExploredBoard], list[ExploredBoard]]:
    """Boards to train on, of each dataset alike many if fewer are asked for, and those of other groups to judge by."""
    held = groups_apart({board.group for board in found}, loop.held_out, seed, "plan/held out")
    boards, held_out = ([board for board in found if (board.group in held) == wanted] for wanted in (False, True))
    if loop.boards is None or loop.boards >= len(boards):
        return boards, held_out
    return [boards[number * len(boards) // loop.boards] for number in range(loop.boards)], held_out


def make_learner(
    config: Config, boards: Sequence[ExploredBoard], held_out: Sequence[ExploredBoard], seed: int
) -> "BcLearner | PpoLearner":
    """The learner of the agent whose parameters these are."""
    if isinstance(config, BcConfig):
        return BcLearner(config, boards, held_out, seed)
    from busybot.plan.learning.ppo import PpoLearner

    return PpoLearner(config, boards, held_out, seed)


def _of_training(dataset: Dataset, explore: BoardGraphConfig) -> Dataset:
    """The dataset, if agents may be trained on it."""
    hint = "busybot generate OUT --split train --tasks one-to-one"
    if dataset.info.split != "train":
        what = f"{dataset.path}: boards of split {dataset.info.split}, agents are trained on training boards only"
        raise BusybotError(what, hint)
    for board in dataset.boards():
        if board.task is None:
            raise BusybotError(f"{dataset.path}: its boards have no tasks", hint)
        if len(board.objects) > OBJECTS:
            what = f"{dataset.path}: board {board.index} has {len(board.objects)} objects"
            raise BusybotError(what, f"learned agents see {OBJECTS} at most: draw boards with fewer (max_objects)")
    if dataset.info.collect and dataset.info.collect.look().get("camera"):
        what = f"{dataset.path}: recorded with the real camera, boards are explored with the clean one"
        raise BusybotError(what, "record the histories without --camera real")
    check_settings(dataset, explore.render, explore.interaction, "explore.")
    return dataset


def _explorable(dataset: Dataset, library: Library) -> None:
    """Refuse boards on which more than the trigger links' states decides what shows: they are no `board_graph`."""
    for board in dataset.boards():
        links = links_of([library.get(placed.key) for placed in board.objects])
        if Dynamics(board, links).remembers:
            what = f"{dataset.path}: board {board.index} is of the world {board.world!r}, which cannot be explored"
            why = "what it shows does not follow from its links alone"
            raise BusybotError(f"{what}: {why}", "agents practise on boards of the paper's world, of gates, or of lock")


def _budget(
    found: Sequence[ExploredBoard], learner: "BcLearner | PpoLearner", figures: dict[str, Any]
) -> dict[str, Any]:
    """What the training took, of how much it might."""
    config, done = learner.config, figures["iterations"]
    played = done * (config.batch if isinstance(config, BcConfig) else config.envs * config.steps)
    return {
        "minutes": round(learner.budget.seconds / 60, 2),
        "minutes_allowed": config.minutes,
        "iterations": done,
        "iterations_allowed": config.iterations,
        "rollouts" if isinstance(config, BcConfig) else "steps": played,
        "boards_explored": len(found),
        "states_explored": sum(len(board.graph.success) for board in found),
        "exploring_cpu_minutes": round(sum(board.cpu_s for board in found) / 60, 2),
    }


def _plot(out: Path, agent: str) -> None:
    """Draw `training.png`: the loss, and success on tasks."""
    lines = read_metrics(out / "metrics" / f"{agent}.jsonl")
    # what is to be least for ppo is no loss of the same kind
    held_out = judgements(lines, {"imitation": "held out"}) if agent == "bc" else {}
    success = judgements(lines, {"success_seen": "trained on", "success": "held out"})
    panels = [
        Panel(f"loss of {agent}", {"trained on": losses(lines), **held_out}),
        Panel("responders in their goal state at the end, share", success, shares=True),
    ]
    draw(out / "training.png", [panels])
