"""Tiny trainings on synthetic datasets."""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from busybot.datasets.dataset import Dataset
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from tests.episodes.folders import make_dataset

ROUND = "{boards: 1, steps: 1, position: 8, direction: 8}"
SMALL = (
    f"rounds=[{ROUND}, {ROUND}]",
    "validation=0",
    "interaction.delta=20",
    "position.batch=4",
    "position.side=32",
    "position.report=2",
    "position.checkpoint=2",
    "direction.batch=4",
    "direction.report=2",
    "direction.checkpoint=2",
)
"""Two rounds of 8 iterations."""


def make_rounds(folder: Path, strict: bool = False) -> list[Path]:
    """Two recorded rounds, of 24 and 12 steps."""
    counts = {"00": 4, "01": 2}
    made = (make_dataset(folder / name, count, range(count), strict=strict) for name, count in counts.items())
    return [dataset.path for dataset in made]


def permute_privileged(dataset: Dataset) -> Dataset:
    """The dataset with other values of all that only the simulator knows of boards, pictures and actions."""
    boards = list(dataset.boards())
    for index in dataset.finished():
        path = dataset.episode_path(index)
        episode = read_episode(path)
        links = len(episode.links)
        order = np.concatenate([[0], 1 + np.roll(np.arange(links), 1)]).astype(np.uint16)
        episode.images = [
            replace(image, segmentation=order[image.segmentation], boxes=image.boxes[::-1].copy())
            for image in episode.images
        ]
        episode.steps = [
            replace(
                step,
                acted_object=-1,
                acted_link="",
                success=not step.success,
                trigger_states_before=tuple(1 - state for state in step.trigger_states_before),
                trigger_states_after=tuple(1 - state for state in step.trigger_states_after),
                joint_positions_before=tuple(-value for value in step.joint_positions_before),
                joint_positions_after=tuple(-value for value in step.joint_positions_after),
                responder_states_before=tuple(one if one < 0 else 1 - one for one in step.responder_states_before),
                responder_states_after=tuple(one if one < 0 else 1 - one for one in step.responder_states_after),
                vetoed=not step.vetoed,
            )
            for step in episode.steps
        ]
        episode.positions = episode.positions[::-1].copy()
        wired = [one.responder for one in episode.board.relations]
        relations = tuple(
            one.model_copy(update={"responder": other})
            for one, other in zip(episode.board.relations, wired[::-1], strict=True)
        )
        episode.board = episode.board.model_copy(update={"relations": relations})
        write_episode(path, episode)
        boards[index] = episode.board
    lines = "".join(board.model_dump_json() + "\n" for board in boards)
    (dataset.path / "boards" / "boards-00000.jsonl").write_text(lines, encoding="utf-8")
    changed = Dataset.open(dataset.path)
    changed.write_tables()
    return changed


def weights(out: Path) -> dict[str, str]:
    """Hash of every file of weights of a training."""
    files = sorted(out.glob("model*/**/*.safetensors"))
    return {str(file.relative_to(out)): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}
