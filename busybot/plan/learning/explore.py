"""Explores the boards of tasks datasets: every state that up to eight actions lead to, and what each choice does.

Two departures from how agents are measured: candidates of a state are those that the interaction model proposes after
the recorded history, whatever was tried since in the rollout; and a choice worked if a link changed its state, not if
enough pixels did, so that no picture is drawn for each.
"""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from busybot.boards.task import MAX_STEPS, reached
from busybot.common.errors import naming
from busybot.common.frozen_model import FrozenModel
from busybot.common.process_pool import Progress, run_tasks
from busybot.datasets.dataset import Dataset
from busybot.datasets.summary import origin_of
from busybot.episodes.mcap.reader import read_episode
from busybot.interact.policy.policy_factory import candidates_config, fingerprint, load_once
from busybot.objects.library import Library
from busybot.plan.learning.board_graph import BoardGraph, ExploredBoard, load_explored, save_explored
from busybot.plan.learning.encoding import CHOICES, STOP, offer
from busybot.plan.rollout import PreparedTask, RolloutRunner
from busybot.reason.inputs.feature_store import features_of
from busybot.reason.inputs.observation import Frame
from busybot.reason.models.lookup import Persistence
from busybot.sim.interaction import InteractionConfig, interact
from busybot.sim.recorder import grasp_at
from busybot.sim.scene.board_scene import BoardScene, BoardState, Simulator
from busybot.sim.scene.render import RenderConfig
from busybot.training.run_folder import begin_folder

BOARD_SECONDS = 3600.0
"""A board that takes longer is taken for one that hangs."""


class BoardGraphConfig(FrozenModel):
    """How boards are explored.

    Attributes:
        learned: constants of the interaction policy that take precedence over those on the model's card.
    """

    learned: dict[str, Any] = {}
    interaction: InteractionConfig = InteractionConfig()
    render: RenderConfig = RenderConfig()


def explored_boards(
    folder: Path,
    datasets: Sequence[tuple[Dataset, Library]],
    model: str,
    config: BoardGraphConfig,
    workers: int,
    told: Progress,
) -> list[ExploredBoard]:
    """The boards of several datasets, explored as far as they are not yet.

    Args:
        folder: where they are kept, a file for each board.
        model: interaction model, whose candidates agents choose from.

    Raises:
        BusybotError: the folder holds other boards, there is no such model, or a worker is at fault.
    """
    origin = [origin_of(dataset) for dataset, _ in datasets]
    begin_folder(folder, config, 0, data=origin, model=fingerprint(model))
    wanted = {
        (number, index): _file_of(folder, number, index)
        for number, (dataset, _) in enumerate(datasets)
        for index in sorted(dataset.finished())
    }
    done = sum(file.exists() for file in wanted.values())
    for number, (dataset, library) in enumerate(datasets):
        missing = [index for (other, index), file in wanted.items() if other == number and not file.exists()]
        if missing:
            features_of(dataset, Persistence.encoder, episodes=missing, workers=workers)
        arguments = (dataset.path, library, model, config, folder, number)
        for _ in run_tasks(missing, make_work, arguments, workers, task_seconds=BOARD_SECONDS):
            done += 1
            told(done, len(wanted))
    return [load_explored(file) for file in wanted.values()]


def make_work(
    path: Path, library: Library, model: str, config: BoardGraphConfig, folder: Path, number: int
) -> Callable[[int], None]:
    """What a worker does with a board's index: explore it and write what was found."""
    dataset, loaded, simulator = Dataset.open(path), load_once(model), Simulator(library, config.render)
    policy = candidates_config(loaded.info, config.learned)
    player = RolloutRunner(simulator, Persistence(), loaded, policy, config.interaction)

    def work(index: int) -> None:
        began = time.process_time()
        history = read_episode(dataset.episode_path(index), "lazy")
        features = features_of(dataset, Persistence.encoder, episodes=[index], workers=1)[index]
        with naming(dataset.board_place(index)):
            task = player.prepare(history, features)
            found = explore(player, task, simulator.board(history.board), config.interaction)
        group = f"{history.board.seed} {history.board.split} {history.board.appearance_group}"
        board = ExploredBoard(task.briefing, found, group, time.process_time() - began)
        save_explored(_file_of(folder, number, index), board)

    return work


def explore(player: RolloutRunner, task: PreparedTask, scene: BoardScene, config: InteractionConfig) -> BoardGraph:
    """What can happen on a board.

    Args:
        scene: as the task starts.
    """
    contacts, sight = player.contacts(task), player.sight(task)
    start, board = scene.trigger_states(), task.history.board
    rows: list[tuple[Any, ...]] = []
    away = {start: 0}  # actions that lead to each state; a state's number is its place
    while len(rows) < len(away):
        number, state = len(rows), list(away)[len(rows)]
        scene.rest(BoardState(state))
        share = np.mean(list(reached(board, scene.responder_states()).values()))
        image = scene.observe()
        features = sight.see(Frame(image.rgb, image.depth))
        last = away[state] >= MAX_STEPS
        offered, choices = offer(() if last else contacts.propose(image.observation(scene.camera)))
        leads, worked = np.full(CHOICES, -1), np.full(CHOICES, -1)
        leads[STOP] = number
        for row, (contact, direction) in enumerate(choices, start=1):
            step, _ = interact(scene, grasp_at(scene, image, task.rays, contact.pixel), direction, config, None)
            away.setdefault(step.trigger_states_after, away[state] + 1)
            leads[row] = list(away).index(step.trigger_states_after)
            if step.success:
                worked[row] = step.executed[-1]
                scene.rest(BoardState(state))
        rows.append((features.astype(np.float16), np.float32(share), offered.facts, offered.touched, leads, worked))
    scene.rest(BoardState(start))
    return BoardGraph(*(np.stack(column) for column in zip(*rows, strict=True)))


def _file_of(folder: Path, number: int, index: int) -> Path:
    """Where a board of the dataset with a number is kept."""
    return folder / f"{number:02d}-{index:06d}.safetensors"
