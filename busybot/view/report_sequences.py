"""The part of a report that shows how agents went to their goals: a planning sequence of every folder of rollouts."""

from collections.abc import Iterable
from pathlib import Path

from busybot.episodes.dataset import INFO_FILE, Dataset
from busybot.episodes.episode import Episode
from busybot.episodes.mcap_reader import read_episode
from busybot.files import scan
from busybot.plan.notes import is_rollout
from busybot.view.report_page import Block, Heading, Picture, Text
from busybot.view.sequence_figure import sequence_figure

HEAD = "Planning sequences"
MISSING = "**Missing**: planning sequences. `busybot eval plan DATASET --record DIR` records rollouts; name DIR, too."
MOST = 8
"""Folders of rollouts that are shown."""
LOOKED_AT = 20
"""Among so many rollouts of a folder the first of at least `TELLING` actions is shown, else the first."""
TELLING = 2


def sequence_blocks(paths: Iterable[Path], figures: Path) -> list[Block]:
    """Draw a rollout of every dataset of rollouts in the given folders into `figures`.

    Raises:
        BusybotError: a dataset in them is damaged.
    """
    blocks: list[Block] = [Heading(HEAD)]
    for folder in _datasets(paths):
        if len(blocks) > MOST:
            break
        if (episode := _telling(Dataset.open(folder))) is None:
            continue
        picture = sequence_figure(figures / f"sequence-{len(blocks) - 1:02d}.png", episode, figures.parent)
        kind = "" if episode.board.task is None else f", {episode.board.task.kind}"
        caption = f"{episode.policy} on board {episode.board.index} ({episode.board.split}{kind})"
        blocks.append(Picture(picture, caption))
    return blocks if len(blocks) > 1 else [*blocks, Text(MISSING)]


def _datasets(paths: Iterable[Path]) -> list[Path]:
    """Folders that are datasets, in the given folders and at any depth below."""
    names = [(path, name) for path in paths if path.is_dir() for name in scan(path).files]
    return [(path / name).parent for path, name in names if Path(name).name == INFO_FILE]


def _telling(dataset: Dataset) -> Episode | None:
    """The rollout to be shown; None if these are no rollouts."""
    first = None
    for number in sorted(dataset.finished())[:LOOKED_AT]:
        episode = read_episode(dataset.episode_path(number), "lazy")
        if not is_rollout(episode) or episode.goal is None:
            return None
        if len(episode.steps) >= TELLING:
            return episode
        first = first or episode
    return first
