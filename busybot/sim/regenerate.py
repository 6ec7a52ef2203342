"""Regenerates a dataset: boards from the recorded configuration, actions executed again, hashes compared.

Boards and discrete states must be equal, joints within 1e-5, images equal where the renderer's fingerprint is the
recorded one, else close (`episodes.episode_diff`). The result is a dataset of its own; a stopped call continues.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from busybot.common.errors import BusybotError, naming
from busybot.common.process_pool import Progress, run_tasks
from busybot.datasets.create import boards_again, continue_or_create
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import CollectInfo, collect_command
from busybot.episodes.episode import Episode
from busybot.episodes.episode_diff import Difference, ImageDifference, Rule, compare_episodes, rule_for
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.episodes.tables import Rows, episode_rows
from busybot.objects.library import Library
from busybot.sim.replay import act_again, render_config
from busybot.sim.scene.board_scene import Simulator


@dataclass(frozen=True)
class Regenerated:
    """How the dataset made again compares with the recorded one.

    Attributes:
        boards: how many there are.
        boards_from: `configuration`, or `dataset` where another generator made them and they were taken as they are.
        boards_unlike: boards that came out otherwise; their episodes were not replayed.
        episodes: how many were replayed and compared, by the rule that applied to their images.
        failed: those that do not hold, and how they differ.
        joints: the largest difference of a joint's position; `image`: the worst of all images.
    """

    out: Path
    boards: int
    boards_from: str
    boards_unlike: list[int]
    episodes: dict[Rule, int] = field(default_factory=lambda: {"equal": 0, "close": 0})
    failed: dict[int, Difference] = field(default_factory=dict)
    joints: float = 0.0
    image: ImageDifference = field(default_factory=ImageDifference)

    @property
    def ok(self) -> bool:
        return self.boards_from == "configuration" and not self.boards_unlike and not self.failed


def regenerate(
    path: Path, out: Path, library: Library, workers: int = 1, progress: Progress | None = None
) -> Regenerated:
    """Make the dataset again in folder `out` and compare.

    Args:
        library: with all objects from which the boards were drawn, not only those that stand on them.
        workers: processes that share the work; 0 does it in this one.

    Raises:
        BusybotError: the dataset has no episodes or no configuration, an object is missing, or `out` holds something
            else.
    """
    dataset = Dataset.open(path)
    collect, indices = dataset.info.collect, sorted(dataset.finished())
    if collect is None or not indices:
        raise BusybotError(f"{path}: the dataset has no episodes", collect_command(path, dataset.info))
    recorded = dataset.boards()
    boards, origin = boards_again(dataset.info.generator, library, recorded)
    unlike = [old.index for old, new in zip(recorded, boards, strict=True) if old.digest() != new.digest()]
    if out.resolve() == path.resolve():
        raise BusybotError(f"{out}: it is the recorded dataset itself", "name another folder")
    target = continue_or_create(out, dataset.info, boards)
    indices = [index for index in indices if index not in set(unlike)]
    with target.locked():
        target.remove_leftovers()
        compared = _run(indices, (path, out, library, collect), workers)
        told = (lambda done: progress(done, len(indices))) if progress else None
        return _judge(Regenerated(out, len(boards), origin, unlike), target, compared, told)


def _judge(
    found: Regenerated,
    target: Dataset,
    compared: Iterator[tuple[int, tuple[Rows, Difference, Rule]]],
    progress: Callable[[int], None] | None,
) -> Regenerated:
    """Sum up the episodes that come; the target's tables are written also when they end early."""
    counts, failed, joints, worst = dict(found.episodes), {}, found.joints, found.image
    rows: dict[int, Rows] = {}
    try:
        for index, (derived, difference, rule) in compared:
            rows[index] = derived
            counts[rule] += 1
            if not difference.holds(rule):
                failed[index] = difference
            worst, joints = worst.worst(difference.image), max(joints, difference.joints)
            if progress:
                progress(len(rows))
    finally:
        target.write_tables(rows)
    return replace(found, episodes=counts, failed=dict(sorted(failed.items())), joints=joints, image=worst)


def _run(indices: list[int], arguments: tuple, workers: int) -> Iterator[tuple[int, Any]]:
    """Index and outcome of each episode; without workers all is done here."""
    if workers:
        yield from run_tasks(indices, _make_work, arguments, workers)
    else:
        work = _make_work(*arguments)
        yield from ((index, work(index)) for index in indices)


def _make_work(path: Path, out: Path, library: Library, collect: CollectInfo) -> Callable[[int], Any]:
    """What a worker does with an episode's index: replay and write it, unless it is there, and compare."""
    source, target = Dataset.open(path), Dataset.open(out)
    simulators: dict[str, Simulator] = {}

    def play(index: int, recorded: Episode) -> Episode:
        config = render_config(recorded)
        if config.model_dump_json() not in simulators:
            responders = bool(collect.settings.get("responders", True))
            simulators[config.model_dump_json()] = Simulator(library, config, responders)
        return act_again(simulators[config.model_dump_json()], target.board(index), recorded)

    def work(index: int) -> tuple[Rows, Difference, Rule]:
        file, recorded = target.episode_path(index), read_episode(source.episode_path(index), images="lazy")
        if not file.exists():
            with naming(source.episode_path(index)):
                write_episode(file, play(index, recorded), collect.images, out)
        again = read_episode(file, images="lazy")
        return episode_rows(file, index), compare_episodes(recorded, again), rule_for(recorded, again)

    return work
