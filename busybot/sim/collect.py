"""From boards to recorded episodes: many workers, one dataset, safe to stop at any moment.

An episode depends on its board and the collection's seed alone. It appears under its final name when it is whole, its
table rows are read back from the finished file, and collecting again continues with the boards that have no episode.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from busybot.common.errors import naming
from busybot.common.frozen_model import FrozenModel
from busybot.common.process_pool import TASK_SECONDS, Engine, Progress, run_tasks
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import CollectInfo
from busybot.episodes.mcap.writer import write_episode
from busybot.episodes.tables import EPISODES_PER_SHARD, Rows, episode_rows
from busybot.objects.library import Library
from busybot.sim.builtin_policies import builtin_factory
from busybot.sim.interaction import InteractionConfig
from busybot.sim.policy import AnyPolicyFactory
from busybot.sim.recorder import record_episode
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.render import RenderConfig

STEP_SECONDS = 2.0
"""More than a step takes where many workers share a machine."""


class CollectConfig(FrozenModel):
    """How episodes are collected.

    Attributes:
        policy: `random` or `scripted`, or the name of the policy factory that `collect` is given.
        steps: proposed actions per episode.
        images: encoding of RGB; `png` is lossless and about five times as large.
        seed: None takes the dataset's.
        responders: whether effects show; without, a trigger's own motion is all there is to see (Table 1, row "w/o
            responder").
        learned: constants of the learned policy that take precedence over those on the model's card.
    """

    policy: Annotated[str, Field(pattern=r"^[a-z-]{1,32}$")] = "random"
    steps: Annotated[int, Field(ge=0, le=100_000)] = 30
    images: Literal["jpeg", "png"] = "jpeg"
    seed: Annotated[int, Field(ge=0, lt=2**63)] | None = None
    responders: bool = True
    learned: dict[str, Any] = {}
    interaction: InteractionConfig = InteractionConfig()
    render: RenderConfig = RenderConfig()


@dataclass(frozen=True)
class Collected:
    """What one call of `collect` did.

    Attributes:
        done: episodes that are there now, of `boards`.
        new: those recorded by this call.
    """

    boards: int
    done: int
    new: int


def collect(
    dataset: Dataset,
    library: Library,
    config: CollectConfig,
    workers: int,
    progress: Progress | None = None,
    factory: AnyPolicyFactory | None = None,
    provenance: dict[str, Any] | None = None,
    engine: Engine = run_tasks,
) -> Collected:
    """Record an episode for every board that has none.

    Args:
        progress: told after each episode: episodes that are there, and boards.
        factory: makes the policies; by default the built-in one that the configuration names.
        provenance: what else decides the policies' actions, JSON values; recorded, and another is refused later.
        engine: runs the workers: `run_tasks` on this machine, `run_on_ray` on many.

    Raises:
        BusybotError: the dataset's episodes were begun with other settings, the policy is unknown, or a worker is at
            fault.
    """
    factory = factory or builtin_factory(config.policy)  # refuses an unknown name before anything is written
    with dataset.locked():
        dataset.begin_collecting(_collect_info(config, dataset.info.seed, provenance))
        dataset.remove_leftovers()
        before = dataset.finished()
        missing = [index for index in range(dataset.info.boards) if index not in before]
        seed = dataset.info.seed if config.seed is None else config.seed
        arguments = (dataset.path, library, config, seed, factory)
        results = engine(missing, _make_work, arguments, workers, task_seconds=episode_seconds(config.steps))
        new = store_tables(dataset, results, progress, len(before), dataset.info.boards)
    return Collected(dataset.info.boards, len(before) + new, new)


def episode_seconds(steps: int) -> float:
    """How long a worker may be at an episode before it is taken for one that hangs."""
    return max(TASK_SECONDS, STEP_SECONDS * steps)


def store_tables(
    dataset: Dataset, results: Iterator[tuple[int, Rows]], progress: Progress | None, done: int, total: int
) -> int:
    """Write the tables of the episodes that come, also when they end early; returns how many came.

    Args:
        done: how many of the `total` were there before.
    """
    rows: dict[int, Rows] = {}
    try:
        new = 0
        for new, (index, result) in enumerate(results, start=1):
            rows[index] = result
            if progress:
                progress(done + new, total)
            if len(rows) >= EPISODES_PER_SHARD:
                dataset.store_rows(rows)
                rows = {}
        return new
    finally:
        dataset.remove_leftovers()
        dataset.write_tables(rows)


def _collect_info(config: CollectConfig, dataset_seed: int, provenance: dict[str, Any] | None) -> CollectInfo:
    return CollectInfo(
        policy=config.policy,
        steps=config.steps,
        images=config.images,
        strict=config.interaction.strict,
        delta=config.interaction.delta,
        seed=dataset_seed if config.seed is None else config.seed,
        settings={
            "responders": config.responders,
            "interaction": config.interaction.model_dump(mode="json"),
            "render": config.render.model_dump(mode="json"),
            **({"chooser": provenance} if provenance else {}),
        },
    )


def _make_work(
    path: Path, library: Library, config: CollectConfig, seed: int, factory: AnyPolicyFactory
) -> Callable[[int], Any]:
    """What a worker does with a board's index: record, write, and read back the rows of its tables."""
    dataset = Dataset.open(path)
    simulator = Simulator(library, config.render, config.responders)

    def work(index: int) -> Rows:
        board = dataset.board(index)
        with naming(dataset.board_place(index)):
            episode = record_episode(simulator, board, factory, config.steps, config.interaction, seed)
        file = dataset.episode_path(index)
        write_episode(file, episode, config.images, path)
        return episode_rows(file, index)

    return work
