"""From episodes to samples: the right labels, and nothing that a learner may not read."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from busybot.boards.directions import OPPOSITE
from busybot.common.errors import BusybotError
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.episodes.schema import UNKNOWN_PIXEL
from busybot.interact.training.config import RecordConfig
from busybot.interact.training.round_recorder import finished
from busybot.interact.training.sample_cache import SIDE, SQUARES, cache_samples, open_samples
from busybot.sim.interaction import InteractionConfig
from busybot.sim.scene.render import RenderConfig
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode
from tests.interact.trainings import permute_privileged


def test_privileged_columns_do_not_reach_the_samples(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "toys")
    first = cache_samples(dataset, tmp_path / "first", "depth")
    dataset = permute_privileged(dataset)
    second = cache_samples(dataset, tmp_path / "second", "depth")
    assert first.name != second.name  # the episodes did change
    assert (first / SQUARES).read_bytes() == (second / SQUARES).read_bytes()
    one, two = (open_samples([place], "depth", 1000) for place in (first, second))
    for name in ("pixels", "executed", "worked", "scale"):
        assert np.array_equal(getattr(one, name), getattr(two, name))


def test_labels_are_what_was_executed_and_rewarded(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "toys")
    samples = open_samples([cache_samples(dataset, tmp_path, "depth")], "depth", 1000)
    steps = [step for index in sorted(dataset.finished()) for step in read_episode(dataset.episode_path(index)).steps]
    assert len(samples) == len(steps) == 18
    labels, known = samples.direction_labels(np.arange(len(samples)))
    for row, step in enumerate(steps):
        assert samples.reward[row] == bool(step.reward)
        assert tuple(samples.pixels[row]) == step.pixel
        assert list(np.flatnonzero(known[row])) == (sorted(step.executed) if step.reward else [])
        assert list(np.flatnonzero(labels[row])) == ([step.executed[-1]] if step.reward else [])


def test_failed_directions_of_a_rewarded_action_are_negative_labels(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "toys", boards=1, finished=[0])
    path = dataset.episode_path(0)
    episode = read_episode(path)
    number = next(k for k, step in enumerate(episode.steps) if step.reward)
    worked = episode.steps[number].executed[-1]
    tried = tuple(d for d in (0, int(OPPOSITE[0]), 5) if d != worked)
    episode.steps[number] = replace(episode.steps[number], direction=tried[0], executed=(*tried, worked))
    write_episode(path, episode)
    samples = open_samples([cache_samples(dataset, tmp_path, "depth")], "depth", 1000)
    labels, known = samples.direction_labels(np.array([number]))
    assert known[0, list(tried)].all() and not labels[0, list(tried)].any()
    assert labels[0, worked] and known.sum() == len(tried) + 1


def test_where_nobody_says_what_was_executed_it_was_the_proposed_direction(tmp_path: Path) -> None:
    """An imported table may say so; a reward was learned as none, and the paper's loss of the other was no number."""
    dataset = make_dataset(tmp_path / "toys", boards=1, finished=[0])
    episode = read_episode(dataset.episode_path(0))
    episode.steps = [replace(step, executed=()) for step in episode.steps]
    write_episode(dataset.episode_path(0), episode)
    samples = open_samples([cache_samples(dataset, tmp_path, "depth")], "depth", 1000)
    assert {step.reward for step in episode.steps} == {0, 1}
    assert list(samples.worked) == [step.direction if step.reward else -1 for step in episode.steps]
    assert [list(np.flatnonzero(row)) for row in samples.executed] == [[step.direction] for step in episode.steps]


def test_actions_of_which_nobody_says_where_are_not_learned_from(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "toys", boards=1, finished=[0])
    episode = read_episode(dataset.episode_path(0))
    episode.steps[1] = replace(episode.steps[1], pixel=UNKNOWN_PIXEL)
    write_episode(dataset.episode_path(0), episode)
    with pytest.raises(BusybotError, match="nobody says at which pixel it acted"):
        cache_samples(dataset, tmp_path, "depth")


def test_rounds_of_another_camera_are_refused(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "toys", boards=1, finished=[0])
    clean, noisy = RenderConfig(), RenderConfig.model_validate({"camera": {"noise": 0.01, "blur": 0.8}})
    for recorded, asked, hint in (
        (noisy, clean, '--set \'render.camera={"blur": 0.8, "noise": 0.01}\''),
        (clean, noisy, "--set 'render.camera={}'"),
    ):
        render = dict(recorded.model_dump(mode="json"))
        if "camera" in render:
            render["camera"] = dict(sorted(render["camera"].items()))  # as it comes back from a file
        collect = dataset.info.collect
        assert collect is not None
        told = dataset.info.model_copy(update={"collect": collect.model_copy(update={"settings": {"render": render}})})
        dataset.info = told
        config = RecordConfig(interaction=InteractionConfig(delta=collect.delta), render=recorded)
        assert finished(dataset, config) is dataset
        with pytest.raises(BusybotError, match="recorded with render.camera") as refused:
            finished(dataset, config.model_copy(update={"render": asked}))
        assert hint in str(refused.value)


def test_squares_show_the_picture_before_the_step(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "toys", boards=1, finished=[0])
    samples = open_samples([cache_samples(dataset, tmp_path, "depth")], "depth", 1000)
    episode = read_episode(dataset.episode_path(0))
    for row, step in enumerate(episode.steps):
        depth = episode.image(row).depth
        assert depth is not None
        u, v = step.pixel
        stored = samples.squares[0][row, SIDE // 2, SIDE // 2]
        assert samples.scale[row] @ [1, stored] == pytest.approx(depth[v, u], abs=1e-4)


def test_the_window_keeps_the_last_samples_of_all_datasets(tmp_path: Path) -> None:
    caches = [
        cache_samples(make_dataset(tmp_path / name, boards=1 + k, finished=range(1 + k)), tmp_path / "c", "depth")
        for k, name in enumerate(("one", "two"))
    ]
    everything = open_samples(caches, "depth", 1000)
    some = open_samples(caches, "depth", 14)
    assert (everything.first, len(everything), some.first, len(some)) == (0, 18, 4, 14)
    assert np.array_equal(some.pixels, everything.pixels[4:])
    assert list(some.dataset) == [0, 0] + [1] * 12


def test_a_damaged_cache_is_refused(tmp_path: Path) -> None:
    place = cache_samples(make_dataset(tmp_path / "toys"), tmp_path, "depth")
    (place / SQUARES).write_bytes(b"short")
    with pytest.raises(BusybotError, match="damaged"):
        open_samples([place], "depth", 10)


def test_a_dataset_on_which_nobody_acted_teaches_nothing(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "toys", boards=1, finished=())
    write_episode(dataset.episode_path(0), make_episode(0, steps=0))
    place = cache_samples(dataset, tmp_path, "depth")
    with pytest.raises(BusybotError, match="no recorded action to learn from"):
        open_samples([place], "depth", 10)
