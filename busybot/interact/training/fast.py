"""Training by rounds (paper section 4.1): collect with the current policy, then train on what is on disk.

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

Which direction pairs to try after one failed is learnt by counting (`after_failure`). The direction network has an
opinion on every pair by itself; that some are right or wrong together (what is not pressed is pulled sideways) it
cannot say. Recorded training does: where pair i failed and another one was rewarded afterwards, it was pair j in a
share T_ij of the cases, and in a share b_j of all cases. By Bayes' rule the odds of pair j change by the ratio of the
odds of T_ij and of b_j.
"""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from torch import nn

from busybot.boards.directions import OPPOSITE
from busybot.common.errors import BusybotError
from busybot.common.process_pool import machine, run_tasks
from busybot.datasets.dataset import INFO_FILE, Dataset
from busybot.interact.affordance.fast import AffordanceModel
from busybot.interact.affordance.load import load_model
from busybot.interact.affordance.networks import KINDS, Kind, make_network
from busybot.interact.policy.config import STRICT_POLICY, AffordanceInfo
from busybot.interact.policy.direction_pairs import PAIR_OF, PAIRS, logit
from busybot.interact.policy.policy_factory import ExplorePolicyFactory
from busybot.interact.training.config import Round, TrainConfig
from busybot.interact.training.fast_learner import FitJob, make_fit
from busybot.interact.training.round_recorder import PICTURE, Recorder, draw_training, finished
from busybot.interact.training.sample_cache import Samples, cache_samples, open_samples
from busybot.training.checkpoint import load_tensors, load_weights, network_tensors
from busybot.training.loop import files_of
from busybot.training.model_cards import INFO_FILE as MODEL_FILE
from busybot.training.run_folder import Lines, Panel, judgements, learner_versions

HALF = 0.5
"""Added to every count of the base rates."""
SHRINK = 10.0
"""As so many cases with the base rates count in every T_i."""
DIGITS = 3
FIT_SECONDS = 7 * 86400.0
"""One network may be trained for so long in one round."""


def pair_outcomes(executed: np.ndarray, worked: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which pairs failed and which one worked, both bool (n, 9), in the n rewarded of N recorded actions.

    Args:
        executed: bool (N, 18), directions that were tried.
        worked: int (N,), the direction that was rewarded, -1 for none.
    """
    rewarded = worked >= 0
    right = PAIR_OF[worked[rewarded]][:, None] == np.arange(len(PAIRS))
    tried = executed[rewarded]
    return (tried[:, PAIRS] | tried[:, OPPOSITE[PAIRS]]) & ~right, right


def after_failure(executed: np.ndarray, worked: np.ndarray) -> tuple[tuple[float, ...], ...]:
    """Logits (9, 9) that pair j gains where pair i failed; arguments as of `pair_outcomes`."""
    failed, right = pair_outcomes(executed, worked)
    counted = right.sum(0) + HALF
    base = counted / counted.sum()  # (9,)
    counts = failed.T.astype(int) @ right.astype(int)  # (9, 9)
    shares = (counts + SHRINK * base) / (counts.sum(1, keepdims=True) + SHRINK)
    gained = np.round(logit(shares) - logit(base), DIGITS)
    return tuple(tuple(float(value) for value in row) for row in gained)


class Training:
    """One training in its folder.

    Args:
        recorder: of the rounds' data.
        datasets: the rounds, if they lie elsewhere; else they are in the training's own folder.
    """

    def __init__(self, out: Path, config: TrainConfig, recorder: Recorder, datasets: tuple[Path, ...] = ()):
        self.out, self.config, self.recorder, self.given = out, config, recorder, datasets
        self.schedule = schedule_for(config, len(datasets))

    def run(self) -> AffordanceModel:
        """All rounds that are not done yet; returns the final model.

        Raises:
            BusybotError: the folder holds another training, or recorded rounds are missing or unfinished.
        """
        self.recorder.begin(self.out, self.given)
        validation = self._validation()
        datasets: list[Dataset] = []
        for number in range(len(self.schedule)):
            datasets.append(self._recorded(number))
            if not (self._model_folder(number) / MODEL_FILE).exists():
                self._train(number, datasets, validation)
                self._draw()
        last = self._model_folder(len(self.schedule) - 1)
        if self._undrawn(last):
            self._draw()
        final = load_model(last)
        final.save(self.out / "model")
        return final

    def _draw(self) -> None:
        draw_training(self.out, "prioritised batches", _held_out_panel)

    def _undrawn(self, model: Path) -> bool:
        """Whether the training was killed between the model of a round and the picture of its course."""
        picture = self.out / PICTURE
        return not picture.exists() or picture.stat().st_mtime_ns < (model / MODEL_FILE).stat().st_mtime_ns

    def _model_folder(self, number: int) -> Path:
        return self.out / "models" / f"{number:02d}"

    def _recorded(self, number: int) -> Dataset:
        """The dataset of a round, with an episode for each of its boards."""
        if self.given:
            return finished(Dataset.open(self.given[number]), self.config)
        path, plan = self.out / "rounds" / f"{number:02d}", self.schedule[number]
        model = str(self._model_folder(number - 1)) if number else None
        return self._collect(path, plan.boards, plan.steps, model, f"round {number}")

    def _validation(self) -> Dataset | None:
        """The boards that are never trained on."""
        config, path = self.config, self.out / "validation"
        absent = not (path / INFO_FILE).exists() and self.recorder.library is None
        if config.validation and absent:
            self.recorder.told.say("no boards are held out to watch the training on: none are recorded")
        if not config.validation or absent:
            return None
        return self._collect(path, config.validation, config.validation_steps, None, "validation")

    def _collect(self, path: Path, boards: int, steps: int, model: str | None, purpose: str) -> Dataset:
        explorer = partial(ExplorePolicyFactory, model, self.config.explore)
        return self.recorder.dataset(path, boards, steps, purpose, explorer)

    def _train(self, number: int, datasets: list[Dataset], validation: Dataset | None) -> None:
        """Train both networks on all that is recorded, side by side, and save the round's model."""
        config, cache, workers = self.config, self.out / "cache", self.recorder.workers
        caches = tuple(cache_samples(dataset, cache, config.inputs) for dataset in datasets)
        held_out = cache_samples(validation, cache, config.inputs) if validation else None
        jobs = [self._job(kind, number, caches, held_out) for kind in KINDS]
        results = dict(run_tasks(range(len(jobs)), make_fit, (jobs,), workers, task_seconds=FIT_SECONDS))
        samples = open_samples(caches, config.inputs, config.window)
        info = AffordanceInfo(
            variant=config.variant,
            inputs=config.inputs,
            after_failure=after_failure(samples.executed, samples.worked),
            thresholds=STRICT_POLICY if config.interaction.strict else {},
            training={
                "seed": self.recorder.seed,
                "config": config.model_dump(mode="json"),
                "rounds": [_learnt_from(dataset, samples, number) for number, dataset in enumerate(datasets)],
                "validation": {job.kind: results[place] for place, job in enumerate(jobs)},
                "versions": learner_versions(),
                "machine": machine(),
            },
        )
        AffordanceModel(info, {job.kind: network_of(job) for job in jobs}).save(self._model_folder(number))

    def _job(self, kind: Kind, number: int, caches: tuple[Path, ...], validation: Path | None) -> FitJob:
        iterations = [getattr(plan, kind) for plan in self.schedule[: number + 1]]
        start, until = sum(iterations[:-1]), sum(iterations)
        return FitJob(self.out, self.config, self.recorder.seed, kind, caches, validation, start, until)


def _held_out_panel(kind: Kind, lines: Lines) -> Panel:
    """Figures on boards that were never trained on."""
    return Panel("held-out boards, end of round", judgements(lines))


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
    checkpoint, _ = files_of(job.out, job.kind)
    tensors = network_tensors(load_tensors(checkpoint).tensors)
    network = make_network(job.kind, job.config.inputs, tensors)
    load_weights(network, tensors, checkpoint)
    return network


def _learnt_from(dataset: Dataset, samples: Samples, number: int) -> dict[str, Any]:
    """For a model's provenance, the dataset of a round and its share of the samples; JSON values."""
    info, hashes, of_round = dataset.info, dataset.hashes(), samples.dataset == number
    assert info.collect is not None  # it has samples
    return {
        "boards": info.boards,
        "split": info.split,
        "seed": info.seed,
        "assets": info.assets.name,
        "policy": info.collect.policy,
        "board_hash": hashes.board,
        "content_hash": hashes.content,
        "samples": int(of_round.sum()),
        "rewarded": int(np.count_nonzero(samples.reward & of_round)),
    }
