"""Recording the data that a training learns from: one dataset per round, which can be browsed like any other."""

import json
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from busybot.boards.config import BoardConfig
from busybot.common.config import flat
from busybot.common.errors import BusybotError
from busybot.common.process_pool import Progress
from busybot.common.rng import generator
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import collect_command
from busybot.interact.training.config import RecordConfig
from busybot.objects.library import Library
from busybot.sim.collect import CollectConfig, collect
from busybot.sim.policy import PolicyFactory
from busybot.training.run_folder import Lines, Panel, losses

BEFORE = ("rounds", "validation")
"""What may lie in a folder in which a training begins: recorded rounds, to train on with `--offline`."""


class ExplorerFactory(PolicyFactory, Protocol):
    """Makes the policies that collect a round."""

    def provenance(self) -> dict[str, Any]:
        """All that decides the choices, JSON values."""


@dataclass(frozen=True)
class RoundProgress:
    """Who is told of the progress: a line of text, and a labelled count of episodes."""

    say: Callable[[str], None]
    count: Callable[[str], AbstractContextManager[Progress]]


@dataclass(frozen=True)
class Recorder:
    """Records rounds.

    Attributes:
        library: the objects on new boards; None to record nothing and take what is there.
        seed: of the training.
        workers: processes that share the work.
    """

    library: Library | None
    config: RecordConfig
    seed: int
    workers: int
    told: RoundProgress

    def dataset(
        self, path: Path, boards: int, steps: int, purpose: str, explorer: Callable[[], ExplorerFactory]
    ) -> Dataset:
        """The dataset in `path`, with an episode for each of its boards; what is missing is recorded.

        Args:
            purpose: names the round; with the seed it determines the boards.
            explorer: called only if something is to be recorded.

        Raises:
            BusybotError: something is missing, and there are no objects to record it with; or what is there was
                recorded otherwise.
        """
        library, config = self.library, self.config
        if library is not None:  # of a dataset that is there this asks whether it is the one
            seed = int(generator(self.seed, "train", 0, f"boards/{purpose}").integers(2**31))
            drawn = BoardConfig(
                split="train", boards=boards, seed=seed, group_size=config.group_size, uniform=config.uniform
            )
            create_dataset(path, drawn, library)
        dataset = Dataset.open(path)
        if library is None or len(dataset.finished()) == dataset.info.boards:
            return finished(dataset, config, offline=library is None)
        factory = explorer()
        settings = CollectConfig(
            policy=factory.name,
            steps=steps,
            images=config.images,
            responders=config.responders,
            interaction=config.interaction,
            render=config.render,
        )
        with self.told.count(f"{purpose}: collecting") as progress:
            collect(dataset, library, settings, self.workers, progress, factory, factory.provenance())
        return Dataset.open(path)


def checked(given: Sequence[Path], config: RecordConfig, told: RoundProgress) -> None:
    """Look at all given datasets before anything is written; of boards on which models are judged, it is said.

    Raises:
        BusybotError: see `finished`.
    """
    for path in given:
        split = finished(Dataset.open(path), config).info.split
        if split != "train":
            told.say(f"{path}: its boards are of the split {split}; the model cannot be judged on that split honestly")


def finished(dataset: Dataset, config: RecordConfig, offline: bool = False) -> Dataset:
    """The dataset, if all its episodes are recorded, and as the training says.

    Raises:
        BusybotError: how many episodes are missing, or which setting differs: it decides what is seen and rewarded,
            and the trained model's card would tell another one.
    """
    recorded = len(dataset.finished())
    if recorded < dataset.info.boards or not recorded:
        what = f"{dataset.path}: {recorded} of {dataset.info.boards} episodes are recorded"
        hint = collect_command(dataset.path, dataset.info)
        raise BusybotError(what, "record the others: the same command without --offline" if offline else hint)
    wanted = config.model_dump(mode="json", include={"responders", "interaction", "render"})
    collect, asked = dataset.info.collect, flat(wanted)
    assert collect is not None  # else nothing were recorded
    known = {"interaction.strict": collect.strict, "interaction.delta": collect.delta, **flat(collect.settings)}
    for name in sorted(asked.keys() & known.keys()):
        if known[name] != asked[name]:
            what = f"{dataset.path}: recorded with {name} {json.dumps(known[name])}, not {json.dumps(asked[name])}"
            vetoed = name == "interaction.strict" and asked[name]
            hint = "train without --strict" if vetoed else f"train with --set {name}={json.dumps(known[name])}"
            raise BusybotError(what, hint)
    return dataset


def given(datasets: Sequence[Path]) -> dict[str, Any]:
    """For `train.json`, hashes of the contents of datasets that a training is given; of its own rounds, nothing."""
    return {"data": [Dataset.open(path).hashes().content for path in datasets]} if datasets else {}


def loss_panel(kind: str, lines: Lines, batches: str) -> Panel:
    """The losses of a network's batches, for the picture of a training."""
    return Panel(f"{kind} network", {f"loss of {batches}": losses(lines)}, logarithmic=True)
