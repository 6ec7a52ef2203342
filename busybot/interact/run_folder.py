"""What a training's folder says about itself: what was asked for, and where a model comes from."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from torch import nn

from busybot.episodes.dataset import Dataset
from busybot.errors import BusybotError
from busybot.interact.fit import FitJob
from busybot.interact.networks import make_network
from busybot.interact.samples import open_samples
from busybot.interact.train_config import Round, TrainConfig
from busybot.training.checkpoint import load_tensors, load_weights, network_tensors
from busybot.training.run_folder import learner_versions
from busybot.workers import machine

BEFORE = ("rounds", "validation")
"""What may lie in a folder in which a training begins: recorded rounds, to train on with `--offline`."""


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


def given(datasets: Sequence[Path]) -> dict[str, Any]:
    """For `train.json`, hashes of the contents of datasets that a training is given; of its own rounds, nothing."""
    return {"data": [Dataset.open(path).hashes().content for path in datasets]} if datasets else {}


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
