"""Training one network of the `fast` variant on what is recorded, up to a given iteration.

Everything that an iteration draws comes from a generator of its own, so a training that was killed goes on from its
last checkpoint and ends in the same weights, bit by bit. One thread per network: sums have one order whatever the
number of cores, and the two networks are trained side by side. Where there is a GPU both are trained on it.
"""

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from busybot.interact.batches import Batch, cut_batch, draw_batch
from busybot.interact.features import Inputs
from busybot.interact.fit_config import FitConfig
from busybot.interact.networks import HIDDEN, DirectionNet, Kind, make_network
from busybot.interact.ranking import direction_figures, position_figures
from busybot.interact.replay import Priorities
from busybot.interact.samples import open_samples
from busybot.rng import generator
from busybot.training.checkpoint import restore_training, save_tensors, training_tensors
from busybot.training.device import device, multiplies_bfloat16, repeat_exactly
from busybot.training.metrics_file import Metrics
from busybot.training.weights import initialise

VALIDATION_BATCH = 128


@dataclass(frozen=True)
class FitJob:
    """What a worker process needs to train one network for one round; plain data.

    Attributes:
        name: for people.
        kind: which network.
        inputs: what it sees.
        config: how it is trained.
        seed: of its first weights and of all batches.
        caches: of the rounds recorded so far, the oldest first.
        validation: cache of the boards that are never trained on.
        window: only the last so many samples are used.
        start, until: iterations of this round; earlier rounds ended at `start`.
        checkpoint, metrics: files that this training writes.
    """

    name: str
    kind: Kind
    inputs: Inputs
    config: FitConfig
    seed: int
    caches: tuple[Path, ...]
    validation: Path | None
    window: int
    start: int
    until: int
    checkpoint: Path
    metrics: Path


@dataclass
class State:
    """What changes while training."""

    network: nn.Module
    optimizer: torch.optim.Optimizer
    priorities: Priorities
    iteration: int = 0


def begin(job: FitJob) -> State:
    """New weights, or those of the last checkpoint."""
    network, config = make_network(job.kind, job.inputs).to(device()), job.config
    optimizer = torch.optim.AdamW(network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay)
    state = State(network, optimizer, Priorities(config.replay))
    if not job.checkpoint.exists():
        draws = generator(job.seed, "train", 0, f"initial weights/{job.kind}")
        initialise(network.cpu(), torch.Generator().manual_seed(int(draws.integers(2**63))))
        network.to(device())
        return state
    saved = restore_training(job.checkpoint, network, optimizer)
    state.priorities = Priorities(config.replay, saved.tensors["priorities"].numpy())
    state.iteration = int(saved.values["iteration"])
    return state


def save_state(job: FitJob, state: State) -> None:
    """Write the checkpoint, whole or not at all."""
    tensors = training_tensors(state.network, state.optimizer)
    tensors["priorities"] = torch.from_numpy(state.priorities.values)
    save_tensors(job.checkpoint, tensors, {"iteration": state.iteration})


def fit(job: FitJob) -> dict[str, float | None]:
    """Train to the end of the round, from wherever the checkpoint is; returns the validation figures."""
    torch.set_num_threads(1)
    repeat_exactly()
    samples = open_samples(job.caches, job.inputs, job.window)
    state = begin(job)
    state.priorities.grow(samples.first + len(samples))
    metrics = Metrics(job.metrics, job.name, state.iteration, job.start, job.until, job.config.report)
    reward = samples.reward
    weights = np.where(samples.dataset > 0, job.config.replay.later_rounds, 1.0)
    while state.iteration < job.until:
        rng = generator(job.seed, "train", state.iteration, job.kind)
        chosen = state.priorities.draw(reward, weights, samples.first, job.config.batch, rng)
        batch = draw_batch(samples, chosen, job.config, rng)
        rate = learning_rate(job.config, state.iteration - job.start, job.until - job.start)
        loss, losses = learn(state, batch, job, rate, rng)
        state.priorities.update(samples.first + chosen, losses)
        state.iteration += 1
        metrics.add(state.iteration, loss, rate)
        if state.iteration % job.config.checkpoint == 0 or state.iteration == job.until:
            metrics.write()
            save_state(job, state)
    if not job.checkpoint.exists():  # a round without iterations
        save_state(job, state)
    figures = validate(job, state.network)
    metrics.end(state.iteration, figures)
    return figures


def make_fit(jobs: list[FitJob]) -> Callable[[int], dict[str, float | None]]:
    """What a worker process does with a job's number."""
    return lambda index: fit(jobs[index])


def validate(job: FitJob, network: nn.Module) -> dict[str, float | None]:
    """How well the network ranks what was tried on boards that it is never trained on (`interact.ranking`)."""
    if job.validation is None:
        return {}
    samples = open_samples((job.validation,), job.inputs, sys.maxsize)
    network.eval()
    parts: list[tuple[np.ndarray, ...]] = []
    for start in range(0, len(samples), VALIDATION_BATCH):
        batch = cut_batch(samples, np.arange(start, min(start + VALIDATION_BATCH, len(samples))), job.config.side)
        with torch.no_grad():
            outputs = forward(network, batch.features, job.config)
        if job.kind == "position":
            parts.append((outputs[torch.arange(len(batch.rows)), batch.rows, batch.columns].numpy(),))
        else:
            parts.append(tuple(output.numpy() for output in outputs))
    scores = [np.concatenate(columns) for columns in zip(*parts, strict=True)]
    figures = position_figures(scores[-1], samples.reward)
    if job.kind == "direction":
        figures |= direction_figures(scores[0], *samples.direction_labels(np.arange(len(samples))))
    return figures


def learn(state: State, batch: Batch, job: FitJob, rate: float, rng: np.random.Generator) -> tuple[float, np.ndarray]:
    """One step of the optimizer; returns the loss, and each sample's loss, float32 (B,)."""
    for group in state.optimizer.param_groups:
        group["lr"] = rate
    state.network.train()
    loss, losses = sample_losses(state.network, batch, job.kind, job.config, rng)
    state.optimizer.zero_grad()
    loss.backward()
    state.optimizer.step()
    return float(loss.detach()), losses.detach().cpu().numpy()


def learning_rate(config: FitConfig, iteration: int, iterations: int) -> float:
    """Linear warm-up and cosine, over the iterations of one round."""
    cosine = 0.5 + 0.5 * math.cos(math.pi * iteration / iterations)
    return config.learning_rate * min(1.0, (iteration + 1) / config.warm_up) * cosine


def sample_losses(
    network: nn.Module, batch: Batch, kind: Kind, config: FitConfig, rng: np.random.Generator | None = None
) -> tuple[Tensor, Tensor]:
    """The loss, a scalar, and what each sample adds to its priority, (B,), on the CPU; `rng` draws the dropout.

    Position: binary cross entropy of the affordance at the one pixel that was tried. Direction: the mean over all
    directions whose outcome is known, plus the cross entropy of "any direction works".
    """
    entropy = functional.binary_cross_entropy_with_logits
    outputs = forward(network, batch.features, config, rng)
    if kind == "position":
        logits = outputs[torch.arange(len(batch.rows)), batch.rows, batch.columns]
        losses = entropy(logits, batch.reward, reduction="none")
        return losses.mean(), losses
    directions, any_works = outputs
    by_direction = (entropy(directions, batch.labels, reduction="none") * batch.known).sum(dim=1)
    position = entropy(any_works, batch.reward, reduction="none")
    known = batch.known.sum(dim=1)
    loss = config.direction_weight * by_direction.sum() / known.sum().clamp(min=1) + position.mean()
    return loss, config.direction_weight * by_direction / known.clamp(min=1) + position


def forward(network: nn.Module, features: Tensor, config: FitConfig, rng: np.random.Generator | None = None) -> Any:
    """The network's outputs in float32, on the CPU: a batch of them is small."""
    on = next(network.parameters()).device
    arguments = [features.to(on).contiguous(memory_format=torch.channels_last)]
    if rng is not None and config.dropout and isinstance(network, DirectionNet):
        keep = (rng.random((len(features), HIDDEN), np.float32) >= config.dropout) / (1 - config.dropout)
        arguments.append(torch.from_numpy(keep.astype(np.float32)).to(on))
    rounded = multiplies_bfloat16() if config.bfloat16 is None else config.bfloat16
    with torch.autocast(on.type, torch.bfloat16, enabled=rounded):
        outputs = network(*arguments)
    return tuple(output.float().cpu() for output in outputs) if isinstance(outputs, tuple) else outputs.float().cpu()
