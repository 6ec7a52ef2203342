"""Training one network: it learns, and a training that was interrupted ends as if it had not been."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from busybot.common.errors import BusybotError
from busybot.interact.affordance.networks import KINDS, Kind
from busybot.interact.training import fast_learner
from busybot.interact.training.config import TrainConfig
from busybot.interact.training.fast_learner import FastAffordanceLearner, FitJob, fit
from busybot.interact.training.sample_cache import cache_samples, open_samples
from busybot.training.loop import files_of
from busybot.training.run_folder import read_metrics
from tests.episodes.folders import make_dataset
from tests.interact.trainings import permute_privileged


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rounds")
    return cache_samples(make_dataset(folder / "toys"), folder, "depth")


def job_for(kind: Kind, cache: Path, folder: Path, until: int = 8) -> FitJob:
    small = {"batch": 4, "report": 2, "checkpoint": 3} | ({"side": 32} if kind == "position" else {})
    config = TrainConfig.model_validate({"window": 1000, kind: small})
    return FitJob(folder, config, 0, kind, caches=(cache,), validation=cache, start=0, until=until)


def weights(job: FitJob) -> bytes:
    """All that the training has written beside its metrics."""
    return files_of(job.out, job.kind)[0].read_bytes()


@pytest.mark.parametrize("kind", KINDS)
def test_interrupted_and_resumed_ends_in_the_same_weights(
    kind: Kind, cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    straight = job_for(kind, cache, tmp_path / "straight")
    figures = fit(straight)
    broken = job_for(kind, cache, tmp_path / "broken")
    learn, calls = FastAffordanceLearner.learn, []

    def dies(*arguments):
        calls.append(1)
        if len(calls) == 6:
            raise KeyboardInterrupt
        return learn(*arguments)

    monkeypatch.setattr(FastAffordanceLearner, "learn", dies)
    with pytest.raises(KeyboardInterrupt):
        fit(broken)
    assert weights(broken) != weights(straight)
    assert fit(broken) == figures
    assert weights(broken) == weights(straight)
    told = [read_metrics(files_of(one.out, kind)[1]) for one in (broken, straight)]
    assert [line["iteration"] for line in told[0]] == [2, 4, 6, 8, 8]
    assert told[0] == told[1], "also the mean of the losses before and after"


def test_rounds_continue_from_one_another(cache: Path, tmp_path: Path) -> None:
    first = job_for("position", cache, tmp_path, until=4)
    fit(first)
    second = replace(first, caches=(cache, cache), start=4, until=8)
    fit(second)
    lines = read_metrics(files_of(tmp_path, "position")[1])
    assert [line["iteration"] for line in lines] == [2, 4, 4, 6, 8, 8]
    assert "position_ap" in lines[2]["validation"]
    for _ in range(2):  # a round without iterations, killed before its model was saved
        fit(replace(second, start=8))
        after = read_metrics(files_of(tmp_path, "position")[1])
        assert after[:-1] == lines and after[-1] == lines[-1], "its own figures stand behind those of the round before"


@pytest.mark.parametrize("kind", KINDS)
def test_what_only_the_simulator_knows_does_not_change_the_weights(kind: Kind, tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "toys")
    jobs = [job_for(kind, cache_samples(dataset, tmp_path / "cache", "depth"), tmp_path / "one", until=3)]
    dataset = permute_privileged(dataset)
    jobs += [job_for(kind, cache_samples(dataset, tmp_path / "cache", "depth"), tmp_path / "two", until=3)]
    assert jobs[0].caches != jobs[1].caches
    for job in jobs:
        fit(job)
    assert weights(jobs[0]) == weights(jobs[1])


def test_it_learns_where_synthetic_boards_react(cache: Path, tmp_path: Path) -> None:
    figures = fit(job_for("position", cache, tmp_path, until=180))
    assert figures["position_auc"] is not None and figures["position_auc"] > 0.75


@pytest.mark.long
def test_colours_alone_can_be_learned_from(tmp_path: Path) -> None:
    cache = cache_samples(make_dataset(tmp_path / "toys"), tmp_path, "rgb")
    for kind in KINDS:
        job = job_for(kind, cache, tmp_path, until=60)
        auc = fit(replace(job, config=job.config.model_copy(update={"inputs": "rgb"})))["position_auc"]
        assert auc is not None and auc > 0.7, kind


def test_where_nothing_succeeded_the_training_is_named(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    samples = open_samples((cache,), "depth", 1000)
    failures = replace(samples, worked=np.full_like(samples.worked, -1))
    monkeypatch.setattr(fast_learner, "open_samples", lambda *_: failures)
    with pytest.raises(BusybotError, match=rf"^{tmp_path}: no recorded action succeeded"):
        fit(job_for("direction", cache, tmp_path))


def test_a_round_without_iterations_leaves_the_weights_alone(cache: Path, tmp_path: Path) -> None:
    job = job_for("direction", cache, tmp_path, until=0)
    fit(job)
    before = weights(job)
    fit(job)
    assert weights(job) == before
