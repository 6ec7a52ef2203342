"""Regenerates a dataset: boards from the recorded configuration, actions executed again, hashes compared.

Boards and discrete states must be equal, joints within 1e-5, images equal where the renderer's fingerprint is the
recorded one, else close (`episodes.episode_diff`). The result is a dataset of its own; a stopped call continues: what
an earlier one replayed is believed as far as today's packages and renderer made it, and counted apart.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from busybot.common.errors import BusybotError, naming
from busybot.common.process_pool import Progress, run_tasks
from busybot.datasets.create import boards_again, continue_or_create
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import CollectInfo, collect_command
from busybot.episodes.episode_diff import Difference, ImageDifference, Rule, compare_episodes, rule_for
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.episodes.tables import Rows, episode_rows
from busybot.objects.library import Library
from busybot.sim.collect import episode_seconds, store_tables
from busybot.sim.recorder import recorded_versions, renderer_fingerprint
from busybot.sim.replay import act_again, render_config
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.render import RenderConfig


@dataclass
class Regenerated:
    """How the dataset made again compares with the recorded one.

    Attributes:
        boards: how many there are.
        boards_from: `configuration`, or `dataset` where another generator made them and they were taken as they are.
        boards_unlike: boards that came out otherwise; their episodes were not replayed.
        episodes: how many were compared, by the rule that applied to their images.
        replayed: how many of them this call replayed; the others were in `out`, made by today's versions and renderer.
        failed: those that do not hold, and how they differ.
        joints: the largest difference of a joint's position; `image`: the worst of all images.
    """

    out: Path
    boards: int
    boards_from: str
    boards_unlike: list[int]
    episodes: dict[Rule, int] = field(default_factory=lambda: {"equal": 0, "close": 0})
    replayed: int = 0
    failed: dict[int, Difference] = field(default_factory=dict)
    joints: float = 0.0
    image: ImageDifference = field(default_factory=ImageDifference)

    @property
    def ok(self) -> bool:
        return self.boards_from == "configuration" and not self.boards_unlike and not self.failed

    def add(self, index: int, difference: Difference, rule: Rule, replayed: bool) -> None:
        """Count in how an episode compares."""
        self.episodes[rule] += 1
        self.replayed += replayed
        if not difference.holds(rule):
            self.failed[index] = difference
        self.joints, self.image = max(self.joints, difference.joints), self.image.worst(difference.image)


def regenerate(
    path: Path, out: Path, library: Library, workers: int = 1, progress: Progress | None = None
) -> Regenerated:
    """Make the dataset again in folder `out` and compare.

    Args:
        library: with all objects from which the boards were drawn, not only those that stand on them.

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
    if out.resolve().is_relative_to(path.resolve()):
        raise BusybotError(f"{out}: it lies within the recorded dataset", "name a folder elsewhere")
    target = continue_or_create(out, dataset.info, boards)
    indices = [index for index in indices if index not in set(unlike)]
    found = Regenerated(out, len(boards), origin, unlike)

    def compared() -> Iterator[tuple[int, Rows]]:
        arguments, seconds = (path, out, library, collect), episode_seconds(collect.steps)
        results = run_tasks(indices, _make_work, arguments, workers, task_seconds=seconds)
        for index, (rows, difference, rule, replayed) in results:
            found.add(index, difference, rule, replayed)
            yield index, rows

    with target.locked():
        target.remove_leftovers()
        store_tables(target, compared(), progress, 0, len(indices))
    found.failed = dict(sorted(found.failed.items()))
    return found


def _make_work(path: Path, out: Path, library: Library, collect: CollectInfo) -> Callable[[int], Any]:
    """What a worker does with an episode's index: replay and write it, unless today's is there, and compare."""
    source, target = Dataset.open(path), Dataset.open(out)

    @cache
    def simulator(config: RenderConfig) -> Simulator:
        return Simulator(library, config, bool(collect.settings.get("responders", True)))

    @cache
    def renderer(config: RenderConfig) -> dict[str, Any]:
        """Today's, which is the same for all boards."""
        return renderer_fingerprint(simulator(config).board(target.board(0)))

    def of_today(file: Path, config: RenderConfig) -> bool:
        if not file.exists():
            return False
        there = read_episode(file, images="lazy")
        return there.versions == recorded_versions() and there.renderer == renderer(config)

    def work(index: int) -> tuple[Rows, Difference, Rule, bool]:
        file, recorded = target.episode_path(index), read_episode(source.episode_path(index), images="lazy")
        with naming(source.episode_path(index)):
            config = render_config(recorded)
        replayed = not of_today(file, config)
        if replayed:
            with naming(source.episode_path(index)):
                episode = act_again(simulator(config), target.board(index), recorded)
                write_episode(file, episode, collect.images, out)
        again = read_episode(file, images="lazy")
        return episode_rows(file, index), compare_episodes(recorded, again), rule_for(recorded, again), replayed

    return work
