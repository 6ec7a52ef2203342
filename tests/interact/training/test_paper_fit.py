"""Training one network of the paper variant: batches, labels, optimizer, and going on after a kill."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from busybot.boards.directions import OPPOSITE
from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.episodes.mcap.reader import read_episode
from busybot.interact.affordance.networks import KINDS, Kind
from busybot.interact.policy.config import Inputs
from busybot.interact.training.config import PaperConfig
from busybot.interact.training.paper import PaperAffordanceLearner, batch_loss, draw_half, paper_labels
from busybot.interact.training.sample_cache import SQUARES, Samples, cache_samples, open_samples
from busybot.training.run_folder import read_metrics
from tests.episodes.folders import make_dataset
from tests.interact.trainings import permute_privileged

LONG = pytest.param("direction", marks=pytest.mark.long)
"""The other network goes the same way through the same code, and takes three times as long."""


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> Samples:
    folder = tmp_path_factory.mktemp("rounds")
    return open_samples(
        [cache_samples(make_dataset(folder / "toys"), folder, "depth", whole=True)], "depth", 1000, True
    )


def learner_for(
    kind: Kind, folder: Path, inputs: Inputs = "depth", bfloat16: bool | None = None, **changes: float
) -> PaperAffordanceLearner:
    small = {"batch": 2, "iterations": 3} | changes
    config = PaperConfig.model_validate({"inputs": inputs, "checkpoint": 2, "bfloat16": bfloat16, kind: small})
    return PaperAffordanceLearner(folder, config, 0, kind, size=(120, 160))


@pytest.fixture(autouse=True)
def one_thread() -> None:
    torch.set_num_threads(1)


def test_half_of_a_batch_has_reward() -> None:
    reward = np.arange(100) % 10 == 0
    chosen = draw_half(reward, 32, generator(0, "", 0, "test"))
    assert len(chosen) == 32 and reward[chosen].sum() == 16
    many = np.concatenate([draw_half(reward, 32, generator(seed, "", 0, "test")) for seed in range(100)])
    assert np.bincount(many, minlength=100)[::10].min() > 100  # all alike: 160 of 1,600 each


def test_a_sample_teaches_what_worked_or_what_was_tried_in_vain(samples: Samples) -> None:
    labels, known = paper_labels(samples, np.arange(len(samples)))
    for row in range(len(samples)):
        if samples.reward[row]:
            assert list(np.flatnonzero(labels[row])) == list(np.flatnonzero(known[row])) == [samples.worked[row]]
        else:
            first, second = np.flatnonzero(known[row])
            assert not labels[row].any() and OPPOSITE[first] == second


def test_whole_pictures_are_cached_once(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "toys", boards=2, finished=range(2))
    samples = open_samples([cache_samples(dataset, tmp_path, "depth", whole=True)], "depth", 1000, whole=True)
    episodes = [read_episode(dataset.episode_path(index)) for index in range(2)]
    seen = [(index, number) for index, episode in enumerate(episodes) for number in episode.frame_of[:-1]]
    assert len(samples.squares[0]) == len(set(seen)) < len(samples)
    for row, (index, number) in enumerate(seen):
        stored = samples.squares[0][samples.row[row]].astype(np.float32)
        depth = np.where(stored > 0, samples.scale[row, 0] + stored * samples.scale[row, 1], 0)
        assert np.allclose(depth, episodes[index].images[number].depth, atol=1e-4)


def test_a_damaged_cache_of_pictures_is_refused(tmp_path: Path) -> None:
    place = cache_samples(make_dataset(tmp_path / "toys"), tmp_path, "depth", whole=True)
    (place / SQUARES).write_bytes(b"short")
    with pytest.raises(BusybotError, match="damaged"):
        open_samples([place], "depth", 10, whole=True)


def test_adam_with_the_papers_learning_rates(tmp_path: Path) -> None:
    for kind, rate in zip(KINDS, (5e-4, 1e-4), strict=True):
        optimizer = learner_for(kind, tmp_path).optimizer
        assert type(optimizer) is torch.optim.Adam
        (group,) = optimizer.param_groups
        assert (group["lr"], group["betas"], group["weight_decay"]) == (rate, (0.9, 0.95), 0)


def test_an_epoch_has_its_learning_rate(samples: Samples, tmp_path: Path) -> None:
    learner = learner_for("position", tmp_path, iterations=1)
    for epoch, rate in ((10, 5e-4), (120, 1e-6)):
        learner.train(samples, epoch)
        assert learner.optimizer.param_groups[0]["lr"] == pytest.approx(rate)
    assert [line["learning_rate"] for line in read_metrics(learner.loop.metrics)] == pytest.approx([5e-4, 1e-6])


@pytest.mark.parametrize("able", [False, True])
def test_it_multiplies_in_bfloat16_where_the_device_can_unless_it_is_told(
    able: bool, samples: Samples, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("busybot.training.device.multiplies_bfloat16", lambda: able)
    losses = [
        learner_for("position", tmp_path / str(told), bfloat16=told).learn(samples, generator(0, "", 0, "test"))
        for told in (None, False, True)
    ]
    assert losses[0] == losses[2 if able else 1] and losses[1] != losses[2]
    assert losses[1] == pytest.approx(losses[2], rel=0.05)


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_both_networks_learn_from_their_first_weights(kind: Kind, samples: Samples, tmp_path: Path) -> None:
    learner = learner_for(kind, tmp_path, batch=4)
    for module in learner.network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.momentum = 0.3  # with 0.1 an eighth of what it begins with is left after so few iterations
    # One batch again and again. Half of its pixels worked and failed, so the position's loss ends at half of ln 2: some
    # first weights are there after ten iterations and others, by how a processor rounds, after 25.
    losses = [learner.learn(samples, generator(0, "", 0, "test")) for _ in range(30)]
    assert np.mean(losses[-5:]) < 0.7 * np.mean(losses[:5])
    learner.network.eval()  # what is learnt does not hang on the batch's own means
    with torch.no_grad():
        chosen = draw_half(samples.reward, 4, generator(0, "", 0, "test"))
        assert batch_loss(learner.network, kind, samples, chosen) < 0.7 * np.mean(losses[:5])


@pytest.mark.long
@pytest.mark.parametrize("kind", ["position", LONG])
def test_interrupted_and_resumed_ends_in_the_same_weights(
    kind: Kind, samples: Samples, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    straight = learner_for(kind, tmp_path / "straight")
    for epoch in (4, 5):
        straight.train(samples, epoch)
    learn, calls = PaperAffordanceLearner.learn, []

    def dies(self: PaperAffordanceLearner, samples: Samples, rng: np.random.Generator) -> float:
        calls.append(1)
        if len(calls) == 6:
            raise KeyboardInterrupt
        return learn(self, samples, rng)

    monkeypatch.setattr(PaperAffordanceLearner, "learn", dies)
    interrupted = learner_for(kind, tmp_path / "broken")
    interrupted.train(samples, 4)
    with pytest.raises(KeyboardInterrupt):
        interrupted.train(samples, 5)
    resumed = learner_for(kind, tmp_path / "broken")
    assert not resumed.behind(4) and resumed.behind(5) and resumed.done == 2
    resumed.train(samples, 5)
    assert resumed.loop.checkpoint.read_bytes() == straight.loop.checkpoint.read_bytes()
    assert read_metrics(resumed.loop.metrics) == read_metrics(straight.loop.metrics)
    assert [line["iteration"] for line in read_metrics(resumed.loop.metrics)] == [1, 2, 3, 4, 5, 6]


def test_without_successes_an_epoch_is_left_out(samples: Samples, tmp_path: Path) -> None:
    learner = learner_for("position", tmp_path)
    learner.train(replace(samples, worked=np.full(len(samples), -1)), 0)
    assert learner.loop.progress.iteration == 0 and not learner.loop.checkpoint.exists()
    assert not learner.loop.metrics.exists()


@pytest.mark.long
@pytest.mark.parametrize("kind", ["position", LONG])
def test_what_only_the_simulator_knows_does_not_change_the_weights(kind: Kind, tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "toys")
    weights = []
    for name in ("one", "two"):
        cache = cache_samples(dataset, tmp_path / "cache", "depth", whole=True)
        learner = learner_for(kind, tmp_path / name)
        learner.train(open_samples([cache], "depth", 1000, whole=True), 0)
        weights.append((cache, learner.loop.checkpoint.read_bytes()))
        dataset = permute_privileged(dataset)
    assert weights[0][0] != weights[1][0] and weights[0][1] == weights[1][1]


@pytest.mark.long
def test_colours_alone_can_be_learned_from(tmp_path: Path) -> None:
    cache = cache_samples(make_dataset(tmp_path / "toys"), tmp_path, "rgb", whole=True)
    colours = open_samples([cache], "rgb", 1000, whole=True)
    learner = learner_for("direction", tmp_path, "rgb", learning_rate=1e-3)
    losses = [learner.learn(colours, generator(0, "", 0, "test")) for _ in range(20)]  # one batch again and again
    assert losses[-1] < 0.5 * losses[0]
