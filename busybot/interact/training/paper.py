"""Training of the `paper` variant: collect an epoch's data, then train on the replay buffer (paper appendix A.1).

The folder is that of the `fast` variant (`interact.training.fast`), but for

rounds/000, 001, ...          an ordinary dataset for each epoch
current/                      the model with which the next epoch is collected; there is none per epoch
metrics/epochs.jsonl          what each epoch collected

The buffer is a window over the recorded steps. Pictures that have left it are no longer cached. Weights depend on the
recorded steps, the seed, whether the device multiplies bfloat16 and, in their last bits, on the device and the number
of threads: on one CPU, training again from copied rounds and going on after a kill end in the same ones.

A sample is the paper's tuple of picture, position, direction and reward. Where it leaves room:

- The position network learns the reward at the one pixel that was acted on: binary cross entropy of the affordance.
  Where one direction was tried, not all, a good position with a wrong direction has no reward either.
- The direction network learns that the direction that worked did so (reward 1), or that those that were executed in
  vain, the proposed one and its opposite, did not (reward 0): the mean of their binary cross entropies.
- Half of a batch has reward and half has none; within each half samples are drawn uniformly, with replacement.
"""

import hashlib
import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from busybot.common.atomic_io import remove, write_atomically
from busybot.common.errors import BusybotError
from busybot.common.process_pool import keeping_workers, machine
from busybot.common.rng import generator
from busybot.datasets.dataset import Dataset
from busybot.episodes.mcap.reader import read_episode
from busybot.interact.affordance.inputs import Pinhole, colour_features
from busybot.interact.affordance.networks import KINDS, Kind, Size, make_paper_network
from busybot.interact.affordance.paper import (
    PAPER_POLICY,
    PAPER_PRIOR,
    PaperModel,
    depth_and_normals,
    refuse_small,
    with_positions,
)
from busybot.interact.policy.config import AffordanceInfo
from busybot.interact.policy.policy_factory import ExplorePolicyFactory
from busybot.interact.training.config import PaperConfig
from busybot.interact.training.round_recorder import Recorder, draw_training, finished
from busybot.interact.training.sample_cache import Samples, cache_samples, open_samples
from busybot.training.checkpoint import Checkpoint, initialise
from busybot.training.device import device, keep_memory, rounds
from busybot.training.loop import Learner, Loop, descend
from busybot.training.run_folder import Lines, Panel, learner_versions

BETAS = (0.9, 0.95)
"""Of Adam, as the authors' program has them; the text names none."""
LEARNING_BYTES = 22 << 30
"""Memory from which on it may be kept: learning takes 17 GB then, at the paper's size, 11 otherwise, 9 in bfloat16."""
PLOT_EVERY = 10
"""Epochs between pictures of the training's course."""


class PaperAffordanceLearner(Learner):
    """A network of the `paper` variant, epoch by epoch; it begins with new weights, or those of the last checkpoint.

    Args:
        out: folder of the training.
        config: of the training.
        seed: of the network's first weights and of all batches.
        kind: which network.
        size: rows and columns of the pictures.

    Attributes:
        config: how it is trained.
        loop: its training.
        epoch: the next one to train in, or the one that was begun.
        done: iterations done in it.
    """

    def __init__(self, out: Path, config: PaperConfig, seed: int, kind: Kind, size: Size):
        self.name: Kind = kind
        self.config, self.seed, self._rate = config.learn(kind), seed, partial(config.rate, kind)
        self._rounded = rounds(config.bfloat16)
        self.network = make_paper_network(kind, config.inputs, size)
        draws = generator(seed, "train", 0, f"paper/initial weights/{kind}")
        first = torch.Generator().manual_seed(int(draws.integers(2**63)))
        initialise(self.network, first, biases=kind == "position", normal=kind == "direction")
        self.network.to(device())
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=self.config.learning_rate, betas=BETAS)
        self.epoch = self.done = 0
        self._samples: Samples | None = None
        self.loop = Loop(self, out, report=1, every=config.checkpoint)

    def behind(self, epoch: int) -> bool:
        """Whether iterations of this epoch are left to do."""
        return self.epoch < epoch or (self.epoch == epoch and self.done < self.config.iterations)

    def train(self, samples: Samples, epoch: int) -> None:
        """All iterations of an epoch that are not done yet."""
        if self.epoch < epoch:
            self.epoch, self.done = epoch, 0
        if samples.reward.all() or not samples.reward.any():
            return
        self._samples = samples
        start = self.loop.progress.iteration - self.done
        self.loop.run(f"epoch {epoch}: {self.name} network", start, start + self.config.iterations)

    def iterate(self, iteration: int) -> tuple[float, float]:
        """One step of the optimizer on the epoch's samples."""
        assert self._samples is not None, "`train` gives them"
        loss = self.learn(self._samples, generator(self.seed, "train", self.epoch, f"paper/{self.name}/{self.done}"))
        self.done += 1
        return loss, self._rate(self.epoch)

    def learn(self, samples: Samples, rng: np.random.Generator) -> float:
        """Draw a batch and take one step of the optimizer, at the epoch's learning rate; returns the loss."""
        self.network.train()
        chosen = draw_half(samples.reward, self.config.batch, rng)
        loss = batch_loss(self.network, self.name, samples, chosen, self._rounded)
        descend(self.optimizer, loss, self._rate(self.epoch))
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


def recorded_pictures(samples: Samples, chosen: np.ndarray, on: torch.device) -> Tensor:
    """What the camera saw before the chosen samples' actions, (B, C, H, W), computed where it is used."""
    stored = np.stack([samples.picture(index) for index in chosen])
    if samples.inputs == "rgb":
        return colour_features(stored).to(on)
    return depth_and_normals(samples.depths(chosen, stored, on), Pinhole(samples.camera))


def batch_loss(network: nn.Module, kind: Kind, samples: Samples, chosen: np.ndarray, rounded: bool = False) -> Tensor:
    """The loss of a batch, a scalar on the network's device; `rounded` multiplies in bfloat16."""
    on = next(network.parameters()).device
    features = recorded_pictures(samples, chosen, on)
    pixels = torch.from_numpy(samples.pixels[chosen].astype(np.int64)).to(on)
    reward = torch.from_numpy(samples.reward[chosen]).to(on)
    if kind == "direction":
        features = with_positions(features, pixels)
    with torch.autocast(on.type, torch.bfloat16, enabled=rounded):
        outputs = network(features.contiguous(memory_format=torch.channels_last))
    outputs = outputs.float()
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


class PaperTraining:
    """One training in its folder.

    Args:
        recorder: of the epochs' data.
        datasets: the epochs, if they lie elsewhere; else they are in the training's own folder.

    Raises:
        BusybotError: there are more or fewer datasets than epochs.
    """

    def __init__(self, out: Path, config: PaperConfig, recorder: Recorder, datasets: tuple[Path, ...] = ()):
        if datasets and len(datasets) != config.epochs:
            what = f"{len(datasets)} datasets for {config.epochs} epochs of training"
            raise BusybotError(what, f"--set epochs={len(datasets)}")
        self.out, self.config, self.recorder, self.given = out, config, recorder, datasets
        self.datasets: list[Dataset] = []
        self.caches: dict[int, Path] = {}
        self.collected: dict[int, dict[str, int]] = {}
        self.learners: dict[Kind, PaperAffordanceLearner] = {}

    def run(self) -> PaperModel:
        """All epochs that are not done yet; returns the final model.

        Raises:
            BusybotError: the folder holds another training, or recorded epochs are missing or unfinished.
        """
        self.recorder.begin(self.out, self.given)
        torch.set_num_threads(self.config.threads)
        # nothing is asked to repeat exactly on a GPU: pictures would be interpolated by sorting, many times slower
        with keeping_workers():  # hundreds of epochs, each of seconds
            self._run_epochs()
        if not any(learner.loop.progress.iteration for learner in self.learners.values()):
            what = f"{self.out}: of each epoch no recorded action succeeded, or none failed: nothing was learned"
            raise BusybotError(what, "record more boards, or more actions on each")
        model = self._model({"rounds": self._origin(), "versions": learner_versions(), "machine": machine()})
        model.save(self.out / "model")
        return model

    def _run_epochs(self) -> None:
        for epoch in range(self.config.epochs):
            self.datasets.append(self._recorded(epoch))
            if not self.learners:
                first = self.datasets[0]
                camera = read_episode(first.episode_path(min(first.finished())), "lazy").camera
                self.begin((camera.height, camera.width))
            self._train(epoch)
            gone_by = any(learner.epoch > epoch for learner in self.learners.values())  # told of before an interruption
            if ((epoch + 1) % PLOT_EVERY == 0 and not gone_by) or epoch + 1 == self.config.epochs:
                self._report()

    def begin(self, size: Size) -> None:
        """New networks for pictures of this size, or those of the last checkpoints.

        Raises:
            BusybotError: they are too small: recordings may come from elsewhere.
        """
        refuse_small(size)
        keep_memory(LEARNING_BYTES)
        seed = self.recorder.seed
        self.learners = {kind: PaperAffordanceLearner(self.out, self.config, seed, kind, size) for kind in KINDS}

    def _recorded(self, epoch: int) -> Dataset:
        """The data of an epoch; what is missing is collected with the networks of the epoch before."""
        if self.given:
            return finished(Dataset.open(self.given[epoch]), self.config)
        path, config = self.out / "rounds" / f"{epoch:03d}", self.config
        return self.recorder.dataset(path, config.boards, config.steps, f"epoch {epoch}", lambda: self.factory(epoch))

    def factory(self, epoch: int) -> ExplorePolicyFactory:
        """Who collects an epoch's data, with the networks as they are now."""
        rules, current = self.config.rules(epoch), self.out / "current"
        if not rules.needs_model():
            return ExplorePolicyFactory(None, rules)
        self._model({"epochs": epoch}).save(current)
        return ExplorePolicyFactory(str(current), rules)

    def _train(self, epoch: int) -> None:
        """Train the networks whose turn it is on the buffer."""
        behind = [self.learners[kind] for kind in self.config.trained(epoch) if self.learners[kind].behind(epoch)]
        if behind:
            samples = self.buffer(epoch)
            for learner in behind:
                learner.train(samples, epoch)

    def buffer(self, epoch: int) -> Samples:
        """The last steps recorded until an epoch, with whole pictures; caches that hold none of them are removed."""
        config, folder, first, steps = self.config, self.out / "cache", epoch + 1, 0
        while first and steps < config.buffer:
            first -= 1
            steps += self._collected(first)["steps"]
        self.caches = {
            number: self.caches.get(number) or cache_samples(self.datasets[number], folder, config.inputs, whole=True)
            for number in range(first, epoch + 1)
        }
        for left in set(folder.iterdir()) - set(self.caches.values()):
            remove(left, self.out)
        return open_samples(list(self.caches.values()), config.inputs, config.buffer, whole=True)

    def _collected(self, epoch: int) -> dict[str, int]:
        """What was recorded in an epoch: fewer steps than its episodes may have, where some ended early."""
        if epoch not in self.collected:
            dataset = self.datasets[epoch]
            rewards = dataset.table("steps", ["reward"]).column("reward").to_pylist()
            told = {"boards": dataset.info.boards, "steps": len(rewards), "rewarded": int(sum(rewards))}
            self.collected[epoch] = told
        return self.collected[epoch]

    def _model(self, training: dict[str, Any]) -> PaperModel:
        config = self.config
        info = AffordanceInfo(
            variant=config.variant,
            inputs=config.inputs,
            prior=PAPER_PRIOR,
            thresholds=PAPER_POLICY,
            training={"seed": self.recorder.seed, "config": config.model_dump(mode="json"), **training},
        )
        return PaperModel(info, {kind: learner.network for kind, learner in self.learners.items()})

    def _origin(self) -> dict[str, Any]:
        """What was learnt from: totals, and a hash over the contents of all epochs in their order."""
        content = hashlib.sha256("".join(dataset.hashes().content for dataset in self.datasets).encode())
        epochs = [self._collected(epoch) for epoch in range(len(self.datasets))]
        totals = {name: sum(epoch[name] for epoch in epochs) for name in ("boards", "steps", "rewarded")}
        return {"epochs": len(epochs), "content_sha256": content.hexdigest(), **totals}

    def _report(self) -> None:
        """Bring the metrics of the epochs and the picture up to date."""
        lines = []
        for epoch in range(len(self.datasets)):
            epsilons = {f"epsilon_{kind}": self.config.epsilon(kind, epoch) for kind in KINDS}
            lines.append({"epoch": epoch, **self._collected(epoch), **epsilons})
        text = "".join(json.dumps(line, sort_keys=True) + "\n" for line in lines)
        write_atomically(self.out / "metrics" / "epochs.jsonl", text.encode(), self.out)
        draw_training(self.out, "half-positive batches", lambda kind, _: _epochs_panel(kind, lines))


def _epochs_panel(kind: Kind, epochs: Lines) -> Panel:
    """What each epoch's actions earned."""
    rewarded = [(line["epoch"], line["rewarded"] / max(line["steps"], 1)) for line in epochs]
    by_chance = [(line["epoch"], line[f"epsilon_{kind}"]) for line in epochs]
    curves = {"actions with reward": rewarded, f"random {kind}s": by_chance}
    return Panel("share of an epoch's actions", curves, along="epoch", shares=True)
