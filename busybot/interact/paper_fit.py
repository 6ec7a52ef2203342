"""Training one network of the `paper` variant on what is recorded, epoch by epoch.

A sample is the paper's tuple of picture, position, direction and reward. Where it leaves room:

- The position network learns the reward at the one pixel that was acted on: binary cross entropy of the affordance.
  Where one direction was tried, not all, a good position with a wrong direction has no reward either.
- The direction network learns that the direction that worked did so (reward 1), or that those that were executed in
  vain, the proposed one and its opposite, did not (reward 0): the mean of their binary cross entropies.
- Half of a batch has reward and half has none; within each half samples are drawn uniformly, with replacement.

Every iteration draws from a generator of its own, so a training that was killed goes on from its last checkpoint and
ends in the same weights.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from busybot.interact.features import Inputs
from busybot.interact.networks import Kind
from busybot.interact.paper_config import LearnConfig
from busybot.interact.paper_inputs import recorded_pictures, with_positions
from busybot.interact.paper_networks import Size, make_paper_network
from busybot.interact.samples import Samples
from busybot.rng import generator
from busybot.training.checkpoint import restore_training, save_tensors, training_tensors
from busybot.training.device import device
from busybot.training.metrics_file import Metrics
from busybot.training.weights import initialise


@dataclass(frozen=True)
class PaperJob:
    """One network's training.

    Attributes:
        kind: which network.
        inputs: what it sees.
        size: rows and columns of the pictures.
        config: how it is trained.
        seed: of its first weights and of all batches.
        every: iterations between checkpoints.
        checkpoint, metrics: files that this training writes.
    """

    kind: Kind
    inputs: Inputs
    size: Size
    config: LearnConfig
    seed: int
    every: int
    checkpoint: Path
    metrics: Path


@dataclass
class Progress:
    """How far a training has come.

    Attributes:
        epoch: the next one to train in, or the one that was begun.
        done: iterations done in it.
        total: iterations done in all epochs.
    """

    epoch: int = 0
    done: int = 0
    total: int = 0


@dataclass
class Learner:
    """A network while it is trained."""

    job: PaperJob
    network: nn.Module
    optimizer: torch.optim.Optimizer
    progress: Progress = field(default_factory=Progress)

    def behind(self, epoch: int) -> bool:
        """Whether iterations of this epoch are left to do."""
        progress = self.progress
        return progress.epoch < epoch or (progress.epoch == epoch and progress.done < self.job.config.iterations)

    def train(self, samples: Samples, epoch: int) -> None:
        """All iterations of an epoch that are not done yet."""
        job, progress = self.job, self.progress
        if progress.epoch < epoch:
            self.progress = progress = Progress(epoch, 0, progress.total)
        if samples.reward.all() or not samples.reward.any():
            return
        iterations, start = job.config.iterations, progress.total - progress.done
        metrics = Metrics(
            job.metrics, f"epoch {epoch}: {job.kind} network", progress.total, start, start + iterations, every=1
        )
        while progress.done < iterations:
            rng = generator(job.seed, "train", epoch, f"paper/{job.kind}/{progress.done}")
            loss = self.iterate(samples, rng)
            progress.done, progress.total = progress.done + 1, progress.total + 1
            metrics.add(progress.total, loss, job.config.learning_rate)
            if progress.done % job.every == 0 or progress.done == iterations:
                metrics.write()
                self.save()

    def iterate(self, samples: Samples, rng: np.random.Generator) -> float:
        """Draw a batch and take one step of the optimizer; returns the loss."""
        self.network.train()
        chosen = draw_half(samples.reward, self.job.config.batch, rng)
        loss = batch_loss(self.network, self.job.kind, samples, chosen)
        self.optimizer.zero_grad()
        loss.backward()
        self.optimizer.step()
        return float(loss.detach())

    def save(self) -> None:
        """Write the checkpoint, whole or not at all."""
        tensors = training_tensors(self.network, self.optimizer)
        save_tensors(self.job.checkpoint, tensors, dict(vars(self.progress)))


def begin_learner(job: PaperJob) -> Learner:
    """New weights, or those of the last checkpoint."""
    network = make_paper_network(job.kind, job.inputs, job.size)
    draws = generator(job.seed, "train", 0, f"paper/initial weights/{job.kind}")
    initialise(network, torch.Generator().manual_seed(int(draws.integers(2**63))), biases=True)
    network.to(device())
    optimizer = torch.optim.Adam(network.parameters(), lr=job.config.learning_rate)
    learner = Learner(job, network, optimizer)
    if job.checkpoint.exists():
        saved = restore_training(job.checkpoint, network, optimizer)
        learner.progress = Progress(**{name: int(value) for name, value in saved.values.items()})
    return learner


def draw_half(reward: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Indices of a batch: `count` / 2 samples with reward, then as many without."""
    return np.concatenate([rng.choice(np.flatnonzero(reward == wanted), count // 2) for wanted in (True, False)])


def batch_loss(network: nn.Module, kind: Kind, samples: Samples, chosen: np.ndarray) -> Tensor:
    """The loss of a batch, a scalar on the network's device."""
    on = next(network.parameters()).device
    features = recorded_pictures(samples, chosen, on)
    pixels = torch.from_numpy(samples.pixels[chosen].astype(np.int64)).to(on)
    reward = torch.from_numpy(samples.reward[chosen]).to(on)
    if kind == "direction":
        features = with_positions(features, pixels)
    outputs = network(features.contiguous(memory_format=torch.channels_last))
    if kind == "position":
        at_pixel = outputs[torch.arange(len(chosen), device=on), :, pixels[:, 1], pixels[:, 0]]  # (B, 2)
        return functional.cross_entropy(at_pixel, reward.long())
    labels, known = (torch.from_numpy(values.astype(np.float32)).to(on) for values in paper_labels(samples, chosen))
    losses = functional.binary_cross_entropy_with_logits(outputs, labels, reduction="none") * known
    return (losses.sum(dim=1) / known.sum(dim=1)).mean()


def paper_labels(samples: Samples, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which directions worked, and which ones are learnt from, both bool (B, 18)."""
    worked, _ = samples.direction_labels(chosen)
    return worked, np.where(samples.reward[chosen, None], worked, samples.executed[chosen])
