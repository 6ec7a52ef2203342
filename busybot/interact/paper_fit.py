"""Training one network of the `paper` variant on what is recorded, epoch by epoch.

A sample is the paper's tuple of picture, position, direction and reward. Where it leaves room:

- The position network learns the reward at the one pixel that was acted on: binary cross entropy of the affordance.
  Where one direction was tried, not all, a good position with a wrong direction has no reward either.
- The direction network learns that the direction that worked did so (reward 1), or that those that were executed in
  vain, the proposed one and its opposite, did not (reward 0): the mean of their binary cross entropies.
- Half of a batch has reward and half has none; within each half samples are drawn uniformly, with replacement.
"""

from dataclasses import dataclass
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
from busybot.training.checkpoint import Checkpoint
from busybot.training.device import device
from busybot.training.loop import Learner, Loop, descend
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


class PaperAffordanceLearner(Learner):
    """A network of the `paper` variant, epoch by epoch; it begins with new weights, or those of the last checkpoint.

    Attributes:
        loop: its training.
        epoch: the next one to train in, or the one that was begun.
        done: iterations done in it.
    """

    def __init__(self, job: PaperJob):
        self.job, self.name = job, job.kind
        self.network = make_paper_network(job.kind, job.inputs, job.size)
        draws = generator(job.seed, "train", 0, f"paper/initial weights/{job.kind}")
        initialise(self.network, torch.Generator().manual_seed(int(draws.integers(2**63))), biases=True)
        self.network.to(device())
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=job.config.learning_rate)
        self.epoch = self.done = 0
        self._samples: Samples | None = None
        self.loop = Loop(self, job.checkpoint, job.metrics, report=1, every=job.every)

    def behind(self, epoch: int) -> bool:
        """Whether iterations of this epoch are left to do."""
        return self.epoch < epoch or (self.epoch == epoch and self.done < self.job.config.iterations)

    def train(self, samples: Samples, epoch: int) -> None:
        """All iterations of an epoch that are not done yet."""
        if self.epoch < epoch:
            self.epoch, self.done = epoch, 0
        if samples.reward.all() or not samples.reward.any():
            return
        self._samples = samples
        start = self.loop.progress.iteration - self.done
        self.loop.run(f"epoch {epoch}: {self.job.kind} network", start, start + self.job.config.iterations)

    def iterate(self, iteration: int) -> tuple[float, float]:
        """One step of the optimizer on the epoch's samples."""
        assert self._samples is not None, "`train` gives them"
        job = self.job
        loss = self.learn(self._samples, generator(job.seed, "train", self.epoch, f"paper/{job.kind}/{self.done}"))
        self.done += 1
        return loss, job.config.learning_rate

    def learn(self, samples: Samples, rng: np.random.Generator) -> float:
        """Draw a batch and take one step of the optimizer; returns the loss."""
        self.network.train()
        chosen = draw_half(samples.reward, self.job.config.batch, rng)
        loss = batch_loss(self.network, self.job.kind, samples, chosen)
        descend(self.optimizer, loss)
        return float(loss.detach())

    def state(self) -> Checkpoint:
        """The place in the epochs: those without successes have no iterations."""
        return Checkpoint({}, {"epoch": self.epoch, "done": self.done})

    def restore(self, saved: Checkpoint) -> None:
        """Go on in that epoch."""
        self.epoch, self.done = int(saved.values["epoch"]), int(saved.values["done"])


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
