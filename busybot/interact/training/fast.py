"""Training by rounds (paper section 3.1): collect with the current policy, then train on what is on disk.

A training is a folder:

train.json                    what was asked for; the same command continues, another one is refused
rounds/00, 01, ...            ordinary datasets, one per round; `busybot view` shows them
validation/                   boards that are never trained on
models/00, 01, ...            the model after each round
model/                        the last one, with provenance and figures
metrics/{position,direction}.jsonl, training.png
checkpoints/, cache/          to go on from where a killed training stopped; derived samples

The weights depend on the recorded steps, the seed and the kind of processor: on the same one, training again from a
copy of the datasets ends in the same ones (`--offline`), and so does a training that was killed and continued.

Training one network of the `fast` variant on what is recorded, up to a given iteration.

One thread per network: sums have one order whatever the number of cores, and the two networks are trained side by side.
Where there is a GPU both are trained on it.
"""

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from busybot.common.errors import BusybotError
from busybot.common.process_pool import machine, run_tasks
from busybot.common.rng import generator
from busybot.datasets.dataset import INFO_FILE, Dataset
from busybot.interact.affordance.fast import AffordanceInfo, AffordanceModel
from busybot.interact.affordance.fast_networks import HIDDEN, KINDS, DirectionNet, Kind, make_network
from busybot.interact.affordance.inputs import Inputs
from busybot.interact.affordance.load import load_model
from busybot.interact.metrics import direction_figures, position_figures
from busybot.interact.policy.config import STRICT_POLICY
from busybot.interact.training.augmentation import Batch, cut_batch, draw_batch
from busybot.interact.training.config import FitConfig, Round, TrainConfig
from busybot.interact.training.direction_prior import after_failure
from busybot.interact.training.prioritized_replay import Priorities
from busybot.interact.training.round_recorder import (
    BEFORE,
    ExplorerFactory,
    Recorder,
    RoundProgress,
    checked,
    finished,
    given,
    loss_panel,
)
from busybot.interact.training.sample_cache import cache_samples, open_samples
from busybot.objects.library import Library
from busybot.training.checkpoint import Checkpoint, load_tensors, load_weights, network_tensors
from busybot.training.device import device, multiplies_bfloat16, repeat_exactly
from busybot.training.loop import Learner, Loop, cosine_rate, descend
from busybot.training.metrics_file import read_metrics
from busybot.training.model_cards import INFO_FILE as MODEL_FILE
from busybot.training.plots import Panel, draw, judgements
from busybot.training.run_folder import begin_folder, learner_versions
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


class FastAffordanceLearner(Learner):
    """One round of a network of the `fast` variant.

    Attributes:
        samples: recorded so far.
        priorities: of all samples.
    """

    def __init__(self, job: FitJob):
        config = job.config
        self.job, self.name = job, job.kind
        self.samples = open_samples(job.caches, job.inputs, job.window)
        self.network = make_network(job.kind, job.inputs)
        draws = generator(job.seed, "train", 0, f"initial weights/{job.kind}")
        initialise(self.network, torch.Generator().manual_seed(int(draws.integers(2**63))))
        self.network.to(device())
        self.optimizer = torch.optim.AdamW(
            self.network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay
        )
        self.weights = np.where(self.samples.dataset > 0, config.replay.later_rounds, 1.0)
        self._prioritise(None)

    def _prioritise(self, known: np.ndarray | None) -> None:
        self.priorities = Priorities(self.job.config.replay, known)
        self.priorities.grow(self.samples.first + len(self.samples))

    def iterate(self, iteration: int) -> tuple[float, float]:
        """One step of the optimizer on a batch drawn by priority."""
        job = self.job
        rng = generator(job.seed, "train", iteration, job.kind)
        chosen, batch = self.draw(rng)
        config = job.config
        rate = cosine_rate(config.learning_rate, config.warm_up, iteration - job.start, job.until - job.start)
        loss, losses = self.learn(batch, rate, rng)
        self.priorities.update(self.samples.first + chosen, losses)
        return loss, rate

    def draw(self, rng: np.random.Generator) -> tuple[np.ndarray, Batch]:
        """Samples of the window, int (B,), and their batch."""
        samples, config = self.samples, self.job.config
        chosen = self.priorities.draw(samples.reward, self.weights, samples.first, config.batch, rng)
        return chosen, draw_batch(samples, chosen, config, rng)

    def learn(self, batch: Batch, rate: float, rng: np.random.Generator) -> tuple[float, np.ndarray]:
        """One step of the optimizer; returns the loss, and each sample's loss, float32 (B,)."""
        self.network.train()
        loss, losses = sample_losses(self.network, batch, self.job.kind, self.job.config, rng)
        descend(self.optimizer, loss, rate)
        return float(loss.detach()), losses.detach().cpu().numpy()

    def judge(self) -> dict[str, float | None]:
        """How well the network ranks what was tried on boards that it is never trained on (`interact.metrics`)."""
        return validate(self.job, self.network)

    def state(self) -> Checkpoint:
        """Priorities of all samples."""
        return Checkpoint({"priorities": torch.from_numpy(self.priorities.values)}, {})

    def restore(self, saved: Checkpoint) -> None:
        """Samples that were recorded since are new."""
        self._prioritise(saved.tensors["priorities"].numpy())


def fit(job: FitJob) -> dict[str, float | None]:
    """Train to the end of the round, from wherever the checkpoint is; returns the validation figures."""
    torch.set_num_threads(1)
    repeat_exactly()
    learner = FastAffordanceLearner(job)
    loop = Loop(learner, job.checkpoint, job.metrics, job.config.report, job.config.checkpoint)
    metrics = loop.run(job.name, job.start, job.until)
    if not job.checkpoint.exists():  # a round without iterations
        loop.save()
    figures = learner.judge()
    metrics.end(loop.progress.iteration, figures)
    return figures


def make_fit(jobs: list[FitJob]) -> Callable[[int], dict[str, float | None]]:
    """What a worker process does with a job's number."""
    return lambda index: fit(jobs[index])


def validate(job: FitJob, network: nn.Module) -> dict[str, float | None]:
    """How well the network ranks what was tried on boards that it is never trained on (`interact.metrics`)."""
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


FIT_SECONDS = 7 * 86400.0
"""One network may be trained for so long in one round."""


@dataclass(frozen=True)
class Source:
    """Where the recorded steps come from.

    Attributes:
        library: the objects with which new rounds are recorded; None to train on what is there.
        explore: from a model's folder (None: nothing is known yet) to who collects.
        datasets: the rounds, if they lie elsewhere; else they are in the training's own folder.
    """

    library: Library | None
    explore: Callable[[str | None], ExplorerFactory]
    datasets: tuple[Path, ...] = ()


class Training:
    """One training in its folder."""

    def __init__(self, out: Path, config: TrainConfig, source: Source, seed: int, workers: int, told: RoundProgress):
        self.out, self.config, self.source = out, config, source
        self.seed, self.workers = seed, workers
        self.recorder = Recorder(source.library, config, seed, workers, told)
        self.schedule = schedule_for(config, len(source.datasets))

    def run(self) -> AffordanceModel:
        """All rounds that are not done yet; returns the final model.

        Raises:
            BusybotError: the folder holds another training, or recorded rounds are missing or unfinished.
        """
        checked(self.source.datasets, self.config, self.recorder.told)
        begin_folder(self.out, self.config, self.seed, BEFORE, **given(self.source.datasets))
        validation = self._validation()
        datasets: list[Dataset] = []
        for number in range(len(self.schedule)):
            datasets.append(self._recorded(number))
            if not (self._model_folder(number) / MODEL_FILE).exists():
                self._train(number, datasets, validation)
                self._plot()
        final = load_model(self._model_folder(len(self.schedule) - 1))
        final.save(self.out / "model")
        return final

    def _model_folder(self, number: int) -> Path:
        return self.out / "models" / f"{number:02d}"

    def _recorded(self, number: int) -> Dataset:
        """The dataset of a round, with an episode for each of its boards."""
        if self.source.datasets:
            return finished(Dataset.open(self.source.datasets[number]), self.config)
        model = str(self._model_folder(number - 1)) if number else None
        path, plan = self.out / "rounds" / f"{number:02d}", self.schedule[number]
        return self._collect(path, plan.boards, plan.steps, model, f"round {number}")

    def _validation(self) -> Dataset | None:
        """The boards that are never trained on."""
        config, path = self.config, self.out / "validation"
        absent = not (path / INFO_FILE).exists() and self.source.library is None
        if config.validation and absent:
            self.recorder.told.say("no boards are held out to watch the training on: none are recorded")
        if not config.validation or absent:
            return None
        return self._collect(path, config.validation, config.validation_steps, None, "validation")

    def _collect(self, path: Path, boards: int, steps: int, model: str | None, purpose: str) -> Dataset:
        return self.recorder.dataset(path, boards, steps, purpose, lambda: self.source.explore(model))

    def _train(self, number: int, datasets: list[Dataset], validation: Dataset | None) -> None:
        """Train both networks on all that is recorded, side by side, and save the round's model."""
        inputs, cache = self.config.inputs, self.out / "cache"
        caches = tuple(cache_samples(dataset, cache, inputs) for dataset in datasets)
        held_out = cache_samples(validation, cache, inputs) if validation else None
        jobs = [self._job(kind, number, caches, held_out) for kind in KINDS]
        results = dict(run_tasks(range(len(jobs)), make_fit, (jobs,), self.workers, task_seconds=FIT_SECONDS))
        figures: dict[str, Any] = {job.kind: results[place] for place, job in enumerate(jobs)}
        samples = open_samples(caches, inputs, self.config.window)
        info = AffordanceInfo(
            variant=self.config.variant,
            inputs=inputs,
            after_failure=after_failure(samples.executed, samples.worked),
            thresholds=STRICT_POLICY if self.config.interaction.strict else {},
            training=describe(self.config, self.seed, datasets, caches, figures),
        )
        AffordanceModel(info, {job.kind: network_of(job) for job in jobs}).save(self._model_folder(number))

    def _job(self, kind: Kind, number: int, caches: tuple[Path, ...], validation: Path | None) -> FitJob:
        ends = [0]
        for plan in self.schedule:
            ends.append(ends[-1] + getattr(plan, kind))
        return FitJob(
            name=f"round {number}: {kind} network",
            kind=kind,
            inputs=self.config.inputs,
            config=getattr(self.config, kind),
            seed=self.seed,
            caches=caches,
            validation=validation,
            window=self.config.window,
            start=ends[number],
            until=ends[number + 1],
            checkpoint=self.out / "checkpoints" / f"{kind}.safetensors",
            metrics=self.out / "metrics" / f"{kind}.jsonl",
        )

    def _plot(self) -> None:
        """Draw `training.png`: losses, and figures on boards that were never trained on."""
        lines = {kind: read_metrics(self.out / "metrics" / f"{kind}.jsonl") for kind in KINDS}
        above = [loss_panel(kind, lines[kind], "prioritised batches") for kind in KINDS]
        below = [Panel("held-out boards, end of round", judgements(lines[kind])) for kind in KINDS]
        draw(self.out / "training.png", [above, below])


def schedule_for(config: TrainConfig, datasets: int) -> tuple[Round, ...]:
    """The rounds; for n given datasets the first n - 1 of them and the last one."""
    if not datasets or datasets == len(config.rounds):
        return config.rounds
    if datasets > len(config.rounds):
        raise BusybotError(
            f"{datasets} datasets for {len(config.rounds)} rounds of training",
            "set as many rounds: --set 'rounds=[{boards: 1, steps: 1, position: 1500, direction: 2000}, ...]'",
        )
    return (*config.rounds[: datasets - 1], config.rounds[-1])


def network_of(job: FitJob) -> nn.Module:
    """The network with the weights of the job's checkpoint."""
    network = make_network(job.kind, job.inputs)
    load_weights(network, network_tensors(load_tensors(job.checkpoint).tensors), job.checkpoint)
    return network


def describe(
    config: TrainConfig,
    seed: int,
    datasets: Sequence[Dataset],
    caches: Sequence[Path],
    figures: Mapping[str, Mapping[str, float | None]],
) -> dict[str, Any]:
    """A model's provenance, JSON values."""
    samples = open_samples(caches, config.inputs, config.window)
    rounds = []
    for number, dataset in enumerate(datasets):
        of_round = samples.dataset == number
        hashes, collect = dataset.hashes(), dataset.info.collect
        assert collect is not None  # it has samples
        rounds.append(
            {
                "boards": dataset.info.boards,
                "split": dataset.info.split,
                "seed": dataset.info.seed,
                "assets": dataset.info.assets.name,
                "policy": collect.policy,
                "board_hash": hashes.board,
                "content_hash": hashes.content,
                "samples": int(of_round.sum()),
                "rewarded": int(np.count_nonzero(samples.reward & of_round)),
            }
        )
    return {
        "seed": seed,
        "config": config.model_dump(mode="json"),
        "rounds": rounds,
        "validation": {kind: dict(values) for kind, values in figures.items()},
        "versions": learner_versions(),
        "machine": machine(),
    }
