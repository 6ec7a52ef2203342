"""The training loop of all networks. A training that was killed goes on and ends in the same weights, bit by bit.

A skill hands it a `Learner`, which says what one iteration does. Everything that an iteration draws comes from a random
generator of its own, and a checkpoint holds all that the following iterations depend on. `fit` is a whole training with
judgements on held-out boards; `Loop` alone is for trainings in rounds or epochs, with new data in between.

Files of a network NAME in the folder of `fit`:

checkpoints/NAME.safetensors   weights, optimizer, the best weights so far; and where the training stands (`Progress`)
metrics/NAME.jsonl             see `run_folder.Metrics`
metrics.csv, metrics.json      the same as a table, and the figures on held-out boards
"""

import csv
import io
import math
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import torch
from pydantic import Field, TypeAdapter, ValidationError
from torch import Tensor, nn

from busybot.common.atomic_io import write_atomically, write_json
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel, first_fault
from busybot.common.rng import generator
from busybot.training.checkpoint import Checkpoint, load_weights, restore_training, save_tensors, training_tensors
from busybot.training.run_folder import Metrics, read_metrics, told


def groups_apart(groups: set[Any], share: float, seed: int, purpose: str) -> set[Any]:
    """The groups that are held out: boards of one appearance group look alike, so it is held out as a whole.

    Args:
        share: of them, rounded up; 0 for none. One at least stays.
        purpose: of the draw.
    """
    known = sorted(groups)
    order = generator(seed, "train", 0, purpose).permutation(len(known))
    count = min(math.ceil(share * len(known)), len(known) - 1)
    return {known[place] for place in order[:count]}


BEST = "best."
"""Begins the names of the best weights in a checkpoint."""


class LoopConfig(FrozenModel):
    """How long a network is trained, and on which boards it is judged meanwhile (`fit`).

    Attributes:
        boards: train on the first so many that are not held out; None for all.
        held_out: share of the appearance groups that is never trained on.
        report: a line of metrics every so many iterations.
        judge: held-out boards are judged, and a checkpoint is written, every so many iterations.
        patience: the training ends when so many judgements in a row brought no better loss; 0 for never.
    """

    boards: Annotated[int, Field(ge=1)] | None = None
    held_out: Annotated[float, Field(ge=0, lt=1)] = 0.1
    report: Annotated[int, Field(ge=1)] = 25
    judge: Annotated[int, Field(ge=1)] = 50
    patience: Annotated[int, Field(ge=0)] = 10


class Budget:
    """The time that a training may have; `seconds` are what it has had, through all of its interruptions.

    Args:
        minutes: through all of its interruptions, too, or `this_call`: since it went on last.
    """

    def __init__(self, minutes: float, this_call: bool = False):
        self._limit, self.seconds, self._last = 60 * minutes, 0.0, time.monotonic()
        self._this_call = this_call

    def go_on(self, seconds: float) -> None:
        """Go on where it had had so many."""
        self.seconds = seconds
        self._limit += seconds if self._this_call else 0

    def count(self) -> None:
        """Count until now."""
        before, self._last = self._last, time.monotonic()
        self.seconds += self._last - before

    @property
    def spent(self) -> bool:
        return self.seconds >= self._limit


class Learner:
    """What a kind of network brings to its training; a subclass says what one iteration does.

    Attributes:
        name: for people and file names.
        network: what is trained.
        optimizer: what trains it.
        iterations: of the whole training, for `fit`.
        budget: ends the training; None for one that ends with its iterations.
        leaves_out: whether it takes no step itself where the loss is no number; others end there.
        learned_beside: names of weights begin with these that are not learned by iterations, and always anew.
    """

    name: str
    network: nn.Module
    optimizer: torch.optim.Optimizer
    iterations: int
    budget: Budget | None = None
    leaves_out = False
    learned_beside: tuple[str, ...] = ()

    def iterate(self, iteration: int) -> tuple[float, float]:
        """Train once; returns the loss and the learning rate. All it draws depends on the seed and `iteration`."""
        raise NotImplementedError

    def judge(self) -> Mapping[str, float | None]:
        """Figures on held-out boards, for `fit` with `loss` among them; nothing where no board is held out."""
        return {}

    def conclude(self) -> None:
        """What is learned at the end, with the best weights in the network, in one go."""

    def state(self) -> Checkpoint:
        """What later iterations depend on beside weights and optimizer."""
        return Checkpoint({}, {})

    def restore(self, saved: Checkpoint) -> None:
        """Put back what `state` returned; there are other tensors in it, too."""


Done = Annotated[int, Field(ge=0)]


@dataclass
class Progress:
    """Where a training stands.

    Attributes:
        iteration: so many are done.
        best: iterations after which held-out boards had the least loss; the last ones where none is held out.
        best_loss: that loss.
        waited: judgements since.
    """

    iteration: Done = 0
    best: Done = 0
    best_loss: float | None = None
    waited: Done = 0

    def better(self, loss: float | None) -> bool:
        """Enter a judgement; returns whether it is the best so far: never one that is no number. Without held-out
        boards the latest is."""
        worse = loss is not None and self.best_loss is not None and loss >= self.best_loss
        if worse or (loss is not None and not math.isfinite(loss)):
            self.waited += 1
            return False
        self.best, self.best_loss, self.waited = self.iteration, loss, 0
        return True


PROGRESS = TypeAdapter(Progress)
"""Reads it from a file."""


def files_of(out: Path, name: str) -> tuple[Path, Path]:
    """Where a training's folder has the checkpoint and the metrics of a network."""
    return out / "checkpoints" / f"{name}.safetensors", out / "metrics" / f"{name}.jsonl"


class Loop:
    """The training of one network, from wherever its last checkpoint is.

    Args:
        learner: what is trained; it is put into the state of the checkpoint, if there is one.
        out: folder of the training, in which a checkpoint and metrics are written.
        report: a line of metrics every so many iterations.
        every: a checkpoint every so many iterations, counted from where a run begins.

    Attributes:
        checkpoint, metrics: the files, see `files_of`.
        progress: how far the training has come.
        best: the best weights so far, of trainings that are judged.
    """

    def __init__(self, learner: Learner, out: Path, report: int, every: int):
        self.learner, self._report, self._every = learner, report, every
        self.checkpoint, self.metrics = files_of(out, learner.name)
        self.progress = Progress()
        self._untold: list[float] = []
        self.best: dict[str, Tensor] = {}
        if self.checkpoint.exists():
            try:
                self._restore()
            except (AttributeError, KeyError, TypeError, ValueError, ArithmeticError) as error:
                why = first_fault(error) if isinstance(error, ValidationError) else f"{type(error).__name__}: {error}"
                what = f"{self.checkpoint}: not where this training stands: {why}"
                raise BusybotError(what, "train in another folder") from error

    def run(self, name: str, start: int, until: int, judged: bool = False, patience: int = 0) -> Metrics:
        """Train until so many iterations are done or the learner's time is spent.

        Args:
            name: of what begins at iteration `start`: the training, or a round or epoch of it.
            judged: judge held-out boards before every checkpoint, and keep the best weights.
            patience: end, too, when so many judgements in a row brought no better loss; 0 for never.

        Returns:
            the metrics, to which the figures at the end of a round can be added.
        """
        progress = self.progress
        metrics = Metrics(self.metrics, name, progress.iteration, start, until, self._report, self._untold)
        while not self._over(until) and not (patience and progress.waited >= patience):
            loss, rate = self.learner.iterate(progress.iteration)
            if not math.isfinite(loss) and not self.learner.leaves_out:
                what = f"{self.metrics.parent.parent}: {self.learner.name}, iteration {progress.iteration + 1}"
                raise BusybotError(
                    f"{what}: the loss is no number", "train in another folder, at a lower learning rate"
                )
            progress.iteration += 1
            metrics.add(progress.iteration, loss, rate)
            if self.learner.budget is not None:
                self.learner.budget.count()
            if (progress.iteration - start) % self._every == 0 or self._over(until):
                if judged and (figures := self._judge()):
                    metrics.end(progress.iteration, figures)
                metrics.write()
                self.save()
        return metrics

    def _judge(self) -> Mapping[str, float | None]:
        """Figures on held-out boards; the weights are kept if they are the best."""
        figures = self.learner.judge()
        if self.progress.better(figures.get("loss")):
            self.best = {name: one.detach().clone() for name, one in self.learner.network.state_dict().items()}
        return figures

    def _over(self, until: int) -> bool:
        budget = self.learner.budget
        return self.progress.iteration >= until or (budget is not None and budget.spent)

    def save(self) -> None:
        """Write the checkpoint, whole or not at all."""
        learner, state = self.learner, self.learner.state()
        tensors = training_tensors(learner.network, learner.optimizer) | state.tensors
        tensors |= {BEST + name: tensor for name, tensor in self.best.items()}
        time_used = {} if learner.budget is None else {"seconds": learner.budget.seconds}
        untold = [loss if math.isfinite(loss) else None for loss in self._untold]
        values = {"progress": asdict(self.progress), "learner": state.values | time_used, "untold": untold}
        save_tensors(self.checkpoint, tensors, values)

    def _restore(self) -> None:
        learner = self.learner
        saved = restore_training(self.checkpoint, learner.network, learner.optimizer)
        self.best = {name.removeprefix(BEST): one for name, one in saved.tensors.items() if name.startswith(BEST)}
        values: dict[str, Any] = saved.values
        if "progress" in values:
            self._untold = [math.nan if loss is None else float(loss) for loss in values.get("untold", ())]
            self.progress, values = PROGRESS.validate_python(values["progress"]), values["learner"]
        else:  # networks that are trained in rounds or epochs once wrote how far they were among their own values
            self.progress = PROGRESS.validate_python({"iteration": values.get("iteration", values.get("total", 0))})
        if learner.budget is not None:
            learner.budget.go_on(values["seconds"])
        learner.restore(Checkpoint(saved.tensors, values))


def fit(learner: Learner, out: Path, config: LoopConfig) -> dict[str, Any]:
    """Train to the end, judging held-out boards on the way; the network then has the weights that they liked best.

    Returns:
        what `metrics.json` holds: the figures on held-out boards of the best and of the last weights.
    """
    loop = Loop(learner, out, config.report, config.judge)
    loop.run(learner.name, 0, learner.iterations, judged=True, patience=config.patience)
    last = told(learner.judge())
    if loop.progress.waited and not loop.best:
        raise BusybotError(
            f"{out}: no loss of {learner.name} on held-out boards was a number", "lower the learning rate"
        )
    if loop.best:
        load_weights(learner.network, loop.best, loop.checkpoint)
    learner.conclude()
    write_atomically(out / "metrics.csv", _table(read_metrics(loop.metrics)).encode())
    summary = {
        "iterations": loop.progress.iteration,
        "best_iteration": loop.progress.best,
        "held_out": told(learner.judge()),
        "held_out_last": last,
    }
    write_json(out / "metrics.json", summary)
    return summary


def _table(lines: list[dict[str, Any]]) -> str:
    """Lines of metrics as CSV, for people and other programs."""
    rows = [
        {name: value for name, value in line.items() if name in ("iteration", "learning_rate", "loss")}
        | {f"held_out_{name}": value for name, value in line.get("validation", {}).items()}
        for line in lines
    ]
    table = io.StringIO()
    writer = csv.DictWriter(table, list(dict.fromkeys(name for row in rows for name in row)), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return table.getvalue()


def descend(
    optimizer: torch.optim.Optimizer, loss: Tensor, rate: float | None = None, clip: float | None = None
) -> None:
    """One step of the optimizer against the gradient of the loss, a scalar.

    Args:
        rate: learning rate of this step; None for the optimizer's own.
        clip: greatest norm of the gradient over all parameters; None for any.
    """
    parameters = []
    for group in optimizer.param_groups:
        parameters += group["params"]
        if rate is not None:
            group["lr"] = rate
    optimizer.zero_grad()
    loss.backward()
    if clip is not None:
        torch.nn.utils.clip_grad_norm_(parameters, clip)
    optimizer.step()


def cosine_rate(highest: float, warm_up: int, iteration: int, iterations: int) -> float:
    """Learning rate of an iteration: it rises linearly over `warm_up` of them and falls as a cosine to zero."""
    cosine = 0.5 + 0.5 * math.cos(math.pi * iteration / iterations)
    return highest * min(1.0, (iteration + 1) / warm_up) * cosine
