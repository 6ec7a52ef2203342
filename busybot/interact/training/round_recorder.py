"""What trainings of both variants begin with: their folder, and the recorded data that they learn from.

There is one dataset per round (or epoch), which can be browsed like any other.
"""

import json
import shlex
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from busybot.boards.config import BoardConfig
from busybot.common.config import flat
from busybot.common.errors import BusybotError
from busybot.common.process_pool import Progress
from busybot.common.rng import generator
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import UNSAID, collect_command, with_unsaid
from busybot.datasets.summary import kept_to_judge
from busybot.interact.affordance.networks import KINDS, Kind
from busybot.interact.policy.policy_factory import ExplorePolicyFactory
from busybot.interact.training.config import RecordConfig
from busybot.objects.library import Library
from busybot.sim.collect import CollectConfig, collect
from busybot.training.loop import files_of
from busybot.training.run_folder import Lines, Panel, begin_folder, draw, losses, read_metrics

PICTURE = "training.png"
"""Of a training's course, in its folder."""
BEFORE = ("rounds", "validation")
"""What may lie in a folder in which a training begins: recorded rounds, to train on with `--offline`."""


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

    def begin(self, out: Path, datasets: Sequence[Path]) -> None:
        """Begin or continue the folder of a training that learns from these datasets, or from its own rounds.

        All datasets are looked at before anything is written; of boards on which models are judged, it is said.

        Raises:
            BusybotError: the folder holds another training; and see `finished`.
        """
        for path in datasets:
            if lost := kept_to_judge(finished(Dataset.open(path), self.config)):
                self.told.say(lost)
        given = {"data": [Dataset.open(path).hashes().content for path in datasets]} if datasets else {}
        begin_folder(out, self.config, self.seed, BEFORE, **given)

    def dataset(
        self, path: Path, boards: int, steps: int, purpose: str, explorer: Callable[[], ExplorePolicyFactory]
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
    collect, asked = dataset.info.collect, _named(wanted)
    assert collect is not None  # else nothing were recorded
    known = {"interaction.strict": collect.strict, "interaction.delta": collect.delta, **_named(collect.settings)}
    for name in sorted(asked.keys() & known.keys()):
        if known[name] != asked[name]:
            what = f"{dataset.path}: recorded with {name} {json.dumps(known[name])}, not {json.dumps(asked[name])}"
            vetoed = name == "interaction.strict" and asked[name]
            again = shlex.quote(f"{name}={json.dumps(known[name])}")
            hint = "train without --strict" if vetoed else f"train with --set {again}"
            raise BusybotError(what, hint)
    return dataset


def _named(settings: dict[str, Any]) -> dict[str, Any]:
    """Settings by dotted names; the groups that JSON leaves out where they say nothing are there, as wholes."""
    render = settings.get("render")
    groups = with_unsaid(render) if isinstance(render, dict) else {}
    return flat(settings) | {f"render.{name}": groups[name] for name in UNSAID if groups}


def draw_training(out: Path, batches: str, below: Callable[[Kind, Lines], Panel]) -> None:
    """Draw `training.png`: the losses of each network's batches, and below them what else is told of it."""
    lines = {kind: read_metrics(files_of(out, kind)[1]) for kind in KINDS}
    label = f"loss of {batches}"
    above = [Panel(f"{kind} network", {label: losses(lines[kind])}, logarithmic=True) for kind in KINDS]
    draw(out / PICTURE, [above, [below(kind, lines[kind]) for kind in KINDS]])
