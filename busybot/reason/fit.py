"""Training a model of relations to its end, from wherever it was interrupted.

Everything that an iteration draws comes from a generator of its own, and a checkpoint holds all that the following
iterations depend on: a training that was killed goes on from there and ends in the same weights, bit by bit. The
weights that are kept are those with the least loss on held-out boards.
"""

import csv
import io
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

import torch
from torch import Tensor, nn

from busybot.files import write_atomically, write_json
from busybot.reason.loop_config import LoopConfig
from busybot.training.checkpoint import (
    load_weights,
    restore_training,
    save_tensors,
    training_tensors,
)
from busybot.training.metrics_file import Metrics, read_metrics

BEST = "best."


class Learner(Protocol):
    """What a kind of model brings to its training.

    Attributes:
        name: for people and file names.
        iterations: that it is trained for at most.
    """

    name: str
    iterations: int

    @property
    def network(self) -> nn.Module:
        """What is trained."""
        ...

    @property
    def optimizer(self) -> torch.optim.Optimizer:
        """What trains it."""
        ...

    def iterate(self, iteration: int) -> tuple[float, float]:
        """Train once; returns the loss and the learning rate. All it draws depends on the seed and `iteration`."""
        ...

    def judge(self) -> Mapping[str, float]:
        """Figures on held-out boards, `loss` among them; nothing where no board is held out."""
        ...

    def values(self) -> dict[str, Any]:
        """What later iterations depend on beside weights and optimizer, JSON values."""
        ...

    def restore(self, values: dict[str, Any]) -> None:
        """Put back what `values` returned."""
        ...


@dataclass
class Progress:
    """Where a training stands.

    Attributes:
        iteration: so many are done.
        best: iterations after which held-out boards had the least loss; the last ones where none is held out.
        best_loss: that loss.
        waited: judgements since.
    """

    iteration: int = 0
    best: int = 0
    best_loss: float | None = None
    waited: int = 0


def fit(learner: Learner, out: Path, config: LoopConfig) -> dict[str, Any]:
    """Train until the learner's iterations are done or nothing becomes better; the network then has the best weights.

    Writes checkpoints, `metrics/NAME.jsonl`, `metrics.csv` and `metrics.json` into the folder.

    Returns:
        what `metrics.json` holds: the figures on held-out boards of the best and of the last weights.
    """
    file = out / "checkpoints" / f"{learner.name}.safetensors"
    progress, best = _restore(learner, file)
    metrics = Metrics(
        out / "metrics" / f"{learner.name}.jsonl",
        learner.name,
        progress.iteration,
        0,
        learner.iterations,
        config.report,
    )
    while progress.iteration < learner.iterations and not _given_up(progress, config):
        loss, rate = learner.iterate(progress.iteration)
        progress.iteration += 1
        metrics.add(progress.iteration, loss, rate)
        if progress.iteration % config.judge == 0 or progress.iteration == learner.iterations:
            figures = dict(learner.judge())
            if _better(progress, figures.get("loss")):
                best = {name: tensor.detach().clone() for name, tensor in learner.network.state_dict().items()}
            if figures:
                metrics.end(progress.iteration, figures)
            metrics.write()
            _save(learner, file, progress, best)
    last = dict(learner.judge())
    if best:
        load_weights(learner.network, best, file)
    return _conclude(learner, out, progress, last)


def _better(progress: Progress, loss: float | None) -> bool:
    """Enter a judgement; returns whether these weights are the best so far. Without held-out boards the latest are."""
    if loss is not None and progress.best_loss is not None and loss >= progress.best_loss:
        progress.waited += 1
        return False
    progress.best, progress.best_loss, progress.waited = progress.iteration, loss, 0
    return True


def _given_up(progress: Progress, config: LoopConfig) -> bool:
    return bool(config.patience) and progress.waited >= config.patience


def _restore(learner: Learner, file: Path) -> tuple[Progress, dict[str, Tensor]]:
    if not file.exists():
        return Progress(), {}
    saved = restore_training(file, learner.network, learner.optimizer)
    learner.restore(saved.values["learner"])
    best = {name.removeprefix(BEST): value for name, value in saved.tensors.items() if name.startswith(BEST)}
    return Progress(**saved.values["progress"]), best


def _save(learner: Learner, file: Path, progress: Progress, best: dict[str, Tensor]) -> None:
    tensors = training_tensors(learner.network, learner.optimizer)
    tensors |= {BEST + name: tensor for name, tensor in best.items()}
    save_tensors(file, tensors, {"progress": asdict(progress), "learner": learner.values()})


def _conclude(learner: Learner, out: Path, progress: Progress, last: dict[str, float]) -> dict[str, Any]:
    """Tables for people and other programs."""
    lines = read_metrics(out / "metrics" / f"{learner.name}.jsonl")
    rows = [
        {"iteration": line["iteration"], **{k: v for k, v in line.items() if k in ("loss", "learning_rate")}}
        | {f"held_out_{name}": value for name, value in line.get("validation", {}).items()}
        for line in lines
    ]
    table = io.StringIO()
    columns = list(dict.fromkeys(name for row in rows for name in row))
    writer = csv.DictWriter(table, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_atomically(out / "metrics.csv", table.getvalue().encode())
    summary = {
        "iterations": progress.iteration,
        "best_iteration": progress.best,
        "held_out": dict(learner.judge()),
        "held_out_last": last,
    }
    write_json(out / "metrics.json", summary)
    return summary
