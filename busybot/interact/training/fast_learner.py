"""Training one network of the `fast` variant on recorded samples, up to a given iteration.

One thread per network: sums have one order whatever the number of cores, and the two networks are trained side by side.
Where there is a GPU both are trained on it.

Replay is prioritised: rare successes and hard failures are shown more often than what is known. Each sample's priority
is a running mean of its loss. A batch holds a fixed share of successes, drawn by priority; the others are failures,
drawn by priority times a weight for those of later rounds. The paper draws half and half, uniformly (appendix A.1).
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from busybot.common.errors import BusybotError, naming
from busybot.common.rng import generator
from busybot.interact.affordance.networks import HIDDEN, DirectionNet, Kind, make_network
from busybot.interact.metrics import direction_figures, position_figures
from busybot.interact.training.augmentation import Batch, cut_batch, draw_batch
from busybot.interact.training.config import ReplayConfig, TrainConfig
from busybot.interact.training.sample_cache import open_samples
from busybot.training.checkpoint import Checkpoint, initialise
from busybot.training.device import device, repeat_exactly, rounds, slices
from busybot.training.loop import Learner, Loop, cosine_rate, descend

VALIDATION_BATCH = 128
"""On a GPU more."""
HINT = {
    "succeeded": "or lower the reward's threshold: --set interaction.delta=500",
    "failed": "with a policy that fails, too: both kinds are learned from",
}


class Priorities:
    """Running mean losses of `count` samples, float32 (N,); of the first ones they may be known."""

    def __init__(self, config: ReplayConfig, count: int, known: np.ndarray | None = None):
        old = np.empty(0, np.float32) if known is None else known.astype(np.float32)
        new = np.full(max(0, count - len(old)), config.initial, np.float32)
        self.config, self.values = config, np.concatenate([old, new])

    def draw(
        self, reward: np.ndarray, weights: np.ndarray, first: int, count: int, rng: np.random.Generator
    ) -> np.ndarray:
        """Indices of a batch's samples among those of the window.

        Args:
            reward: bool (N,), of the window's samples.
            weights: float (N,), of the failures among them.
            first: number of the window's first sample.
        """
        config = self.config
        priority = np.clip(self.values[first : first + len(reward)], config.lowest, config.highest).astype(float)
        positives = round(count * config.positives)
        succeeded = _draw(np.where(reward, priority, 0), positives, rng, "succeeded")
        failed = _draw(np.where(reward, 0, priority * weights), count - positives, rng, "failed")
        return np.concatenate([succeeded, failed])

    def update(self, numbers: np.ndarray, losses: np.ndarray) -> None:
        """Enter the losses (B,) of the samples with these numbers (B,); of one that was drawn twice the last counts."""
        config = self.config
        old = self.values[numbers]
        self.values[numbers] = config.memory * old + (1 - config.memory) * np.minimum(losses, config.highest_loss)


def _draw(weights: np.ndarray, count: int, rng: np.random.Generator, kind: str) -> np.ndarray:
    """`count` indices, with replacement, by weight."""
    total = np.cumsum(weights)
    if not len(total) or total[-1] <= 0:
        raise BusybotError(f"no recorded action {kind}", f"record more boards, {HINT[kind]}")
    drawn = np.searchsorted(total, rng.random(count) * total[-1], side="right")
    return np.minimum(drawn, np.flatnonzero(weights)[-1])


@dataclass(frozen=True)
class FitJob:
    """What a worker process needs to train one network for one round; plain data.

    Attributes:
        out: folder of the training.
        config: of the training.
        seed: of the network's first weights and of all batches.
        kind: which network.
        caches: of the rounds recorded so far, the oldest first.
        validation: cache of the boards that are never trained on.
        start, until: iterations of this round; earlier rounds ended at `start`.
    """

    out: Path
    config: TrainConfig
    seed: int
    kind: Kind
    caches: tuple[Path, ...]
    validation: Path | None
    start: int
    until: int


class FastAffordanceLearner(Learner):
    """One round of a network of the `fast` variant.

    Attributes:
        config: how it is trained.
        samples: recorded so far.
        priorities: of all samples.
    """

    def __init__(self, job: FitJob):
        self.job, self.name = job, job.kind
        self.config = config = job.config.learn(job.kind)
        self.samples = open_samples(job.caches, job.config.inputs, job.config.window)
        self.network = make_network(job.kind, job.config.inputs, networks=job.config.networks)
        draws = generator(job.seed, "train", 0, f"initial weights/{job.kind}")
        initialise(self.network, torch.Generator().manual_seed(int(draws.integers(2**63))))
        self.network.to(device())
        self.optimizer = torch.optim.AdamW(
            self.network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay
        )
        self.weights = np.where(self.samples.dataset > 0, config.replay.later_rounds, 1.0)
        self.priorities = Priorities(config.replay, self.samples.first + len(self.samples))

    def iterate(self, iteration: int) -> tuple[float, float]:
        """One step of the optimizer on a batch drawn by priority."""
        job, config = self.job, self.config
        rng = generator(job.seed, "train", iteration, job.kind)
        chosen, batch = self.draw(rng)
        rate = cosine_rate(config.learning_rate, config.warm_up, iteration - job.start, job.until - job.start)
        loss, losses = self.learn(batch, rate, rng)
        self.priorities.update(self.samples.first + chosen, losses)
        return loss, rate

    def draw(self, rng: np.random.Generator) -> tuple[np.ndarray, Batch]:
        """Samples of the window, int (B,), and their batch."""
        samples, config = self.samples, self.config
        chosen = self.priorities.draw(samples.reward, self.weights, samples.first, config.batch, rng)
        return chosen, draw_batch(samples, chosen, config, rng)

    def learn(self, batch: Batch, rate: float, rng: np.random.Generator) -> tuple[float, np.ndarray]:
        """One step of the optimizer; returns the loss, and what each sample adds to its priority, float32 (B,).

        Position: binary cross entropy of the affordance at the one pixel that was tried. Direction: the mean over all
        directions whose outcome is known, plus the cross entropy of "any direction works".
        """
        weight, entropy = self.config.direction_weight, functional.binary_cross_entropy_with_logits
        self.network.train()
        *directions, works = self._outputs(batch, rng)
        losses = entropy(works, batch.reward, reduction="none")
        loss = losses.mean()
        if directions:
            by_direction = (entropy(directions[0], batch.labels, reduction="none") * batch.known).sum(dim=1)
            known = batch.known.sum(dim=1)
            loss = weight * by_direction.sum() / known.sum().clamp(min=1) + loss
            losses = weight * by_direction / known.clamp(min=1) + losses
        descend(self.optimizer, loss, rate)
        return float(loss.detach()), losses.detach().numpy()

    def judge(self) -> dict[str, float | None]:
        """How well the network ranks what was tried on boards that it is never trained on (`interact.metrics`)."""
        job = self.job
        if job.validation is None:
            return {}
        samples = open_samples((job.validation,), job.config.inputs, sys.maxsize)
        everything = np.arange(len(samples))
        self.network.eval()
        parts = []
        for part in slices(len(samples), VALIDATION_BATCH, device()):
            batch = cut_batch(samples, everything[part], self.config.side)
            with torch.no_grad():
                parts.append(self._outputs(batch))
        *directions, works = (torch.cat(outputs).numpy() for outputs in zip(*parts, strict=True))
        figures = position_figures(works, samples.reward)
        if directions:
            figures |= direction_figures(directions[0], *samples.direction_labels(everything))
        return figures

    def _outputs(self, batch: Batch, rng: np.random.Generator | None = None) -> tuple[Tensor, ...]:
        """Logits that the directions work, if the network knows, (B, 18), and that acting at the pixels does, (B,).

        They are float32 and on the CPU: a batch of them is small. `rng` draws the dropout.
        """
        network, config, on = self.network, self.config, next(self.network.parameters()).device
        arguments = [batch.features.to(on).contiguous(memory_format=torch.channels_last)]
        if rng is not None and config.dropout and isinstance(network, DirectionNet):
            keep = (rng.random((len(batch.rows), HIDDEN), np.float32) >= config.dropout) / (1 - config.dropout)
            arguments.append(torch.from_numpy(keep.astype(np.float32)).to(on))
        with torch.autocast(on.type, torch.bfloat16, enabled=rounds(config.bfloat16)):
            outputs = network(*arguments)
        if isinstance(outputs, tuple):
            return tuple(output.float().cpu() for output in outputs)
        return (outputs.float().cpu()[torch.arange(len(batch.rows)), batch.rows, batch.columns],)

    def state(self) -> Checkpoint:
        """Priorities of all samples."""
        return Checkpoint({"priorities": torch.from_numpy(self.priorities.values)}, {})

    def restore(self, saved: Checkpoint) -> None:
        """Samples that were recorded since are new."""
        known = saved.tensors["priorities"].numpy()
        self.priorities = Priorities(self.config.replay, len(self.priorities.values), known)


def fit(job: FitJob) -> dict[str, float | None]:
    """Train to the end of the round, from wherever the checkpoint is; returns the validation figures."""
    torch.set_num_threads(1)
    repeat_exactly()
    learner = FastAffordanceLearner(job)
    loop = Loop(learner, job.out, learner.config.report, learner.config.checkpoint)
    with naming(job.out):
        metrics = loop.run(f"round {len(job.caches) - 1}: {job.kind} network", job.start, job.until)
    if not loop.checkpoint.exists():  # a round without iterations
        loop.save()
    figures = learner.judge()
    metrics.end(loop.progress.iteration, figures)
    return figures


def make_fit(jobs: list[FitJob]) -> Callable[[int], dict[str, float | None]]:
    """What a worker process does with a job's number."""
    return lambda index: fit(jobs[index])
