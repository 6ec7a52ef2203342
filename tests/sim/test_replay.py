"""Any recorded step goes back into the simulator, equal in every bit; recorded actions give the recording again."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.episodes.episode import Episode
from busybot.episodes.episode_diff import compare_episodes
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.sim.builtin_policies import builtin_factory
from busybot.sim.interaction import InteractionConfig
from busybot.sim.recorder import record_episode
from busybot.sim.replay import EpisodeReplay, act_again, render_config, shows_effects
from busybot.sim.scene.board_scene import Simulator
from tests.episodes.synthetic import make_episode, make_real_episode


def test_every_step_of_a_dataset_goes_back_exactly(recorded: Dataset, small_simulator: Simulator) -> None:
    moved = 0
    for index in sorted(recorded.finished()):
        episode = read_episode(recorded.episode_path(index), images="lazy")
        replay = EpisodeReplay(small_simulator, episode)
        forwards = list(range(len(episode.steps) + 1))
        for step in [*forwards, *np.random.default_rng(index).permutation(forwards).tolist()]:
            compared = replay.compare(step)
            assert compared.rule == "equal" and compared.states and compared.joints == 0, compared
            assert compared.image.equal and compared.holds, compared
        moved += sum(step.success for step in episode.steps)
    assert moved > 5


def record(simulator: Simulator, policy: str, seed: int, steps: int = 8) -> Episode:
    config = BoardConfig(boards=1, group_size=1, relations="one-to-many", seed=seed)
    board = next(iter(generate_boards(config, simulator.library)))
    return record_episode(simulator, board, builtin_factory(policy), steps, InteractionConfig(), seed)


@pytest.mark.parametrize("policy", ["scripted", "random"])
def test_pictures_are_equal_before_any_codec(small_simulator: Simulator, policy: str) -> None:
    episode = record(small_simulator, policy, seed=5)
    replay = EpisodeReplay(small_simulator, episode)
    for step in reversed(range(len(episode.steps) + 1)):
        assert replay.compare(step).image.equal


@pytest.mark.long
def test_real_objects_go_back_exactly(real_simulator: Simulator) -> None:
    for seed in range(3):
        episode = record(real_simulator, "scripted", seed)
        replay = EpisodeReplay(real_simulator, episode)
        assert all(replay.compare(step).image.equal for step in range(len(episode.steps) + 1))
        assert compare_episodes(episode, act_again(real_simulator, episode.board, episode)).nothing


@pytest.mark.parametrize("policy", ["scripted", "random"])
def test_recorded_actions_give_the_same_recording(small_simulator: Simulator, policy: str) -> None:
    episode = record(small_simulator, policy, seed=7)
    again = act_again(small_simulator, episode.board, episode)
    assert compare_episodes(episode, again).nothing
    assert again.renderer == episode.renderer and again.settings == episode.settings


def test_another_action_and_another_state_are_noticed(small_simulator: Simulator) -> None:
    episode = record(small_simulator, "scripted", seed=7)
    k = next(k for k, step in enumerate(episode.steps) if step.success)
    states = list(episode.steps[k].trigger_states_after)
    number = next(i for i, state in enumerate(episode.steps[k].trigger_states_before) if state != states[i])
    states[number] = episode.steps[k].trigger_states_before[number]
    episode.steps[k] = replace(episode.steps[k], trigger_states_after=tuple(states))
    compared = EpisodeReplay(small_simulator, episode).compare(k + 1)
    assert not compared.holds and not compared.image.equal and not compared.states
    difference = compare_episodes(episode, act_again(small_simulator, episode.board, episode))
    assert difference.state == k and not difference.same_states


def test_another_renderer_must_only_come_close(small_simulator: Simulator) -> None:
    episode = record(small_simulator, "scripted", seed=7, steps=2)
    foreign = replace(episode, renderer={**episode.renderer, "device": "another"})
    compared = EpisodeReplay(small_simulator, foreign).compare(1)
    assert compared.rule == "close" and compared.holds
    foreign.images = [replace(image, rgb=image.rgb // 2) for image in episode.images]
    assert not EpisodeReplay(small_simulator, foreign).compare(1).holds


def test_recordings_without_effects_are_recognised(small_simulator: Simulator) -> None:
    blind = Simulator(small_simulator.library, small_simulator.render, responders=False)
    episode = record(blind, "scripted", seed=7)
    library = small_simulator.library
    assert not shows_effects(episode, library)
    assert shows_effects(record(small_simulator, "scripted", seed=7), library)
    assert all(EpisodeReplay(blind, episode).compare(step).holds for step in range(9))


def test_what_cannot_be_put_back_is_said(small_simulator: Simulator, tmp_path: Path) -> None:
    episode = record(small_simulator, "scripted", seed=7, steps=2)
    replay = EpisodeReplay(small_simulator, episode)
    for step in (-1, 3):
        with pytest.raises(BusybotError, match="no step") as error:
            replay.put_back(step)
        assert "0 (the start) to 2" in str(error.value.hint)
    with pytest.raises(BusybotError, match="no states"):
        EpisodeReplay(small_simulator, make_real_episode())
    with pytest.raises(BusybotError, match="no object"):
        EpisodeReplay(small_simulator, make_episode())
    with pytest.raises(BusybotError, match="renderer"):
        render_config(make_episode())
    first, second = episode.steps
    links = len(first.trigger_states_after)
    for states in ((), (9,) * links, (-1,) * links):
        before = () if states == () else second.trigger_states_before
        strange = replace(second, trigger_states_after=states, trigger_states_before=before)
        with pytest.raises(BusybotError, match=r"step 2: states \[.*\] of trigger links that have \["):
            EpisodeReplay(small_simulator, replace(episode, steps=[first, strange]))
        with pytest.raises(BusybotError, match="step 2"):
            shows_effects(replace(episode, steps=[first, strange]), small_simulator.library)
    unmeasured = replace(second, joint_positions_before=(), joint_positions_after=())
    with pytest.raises(BusybotError, match="step 2: .* no positions of its joints"):
        EpisodeReplay(small_simulator, replace(episode, steps=[first, unmeasured])).compare(2)
    write_episode(tmp_path / "e.mcap", replace(episode, settings={}))
    for seed in ("7a", None, [1]):
        told = replace(episode, settings=episode.settings | {"seed": seed})
        with pytest.raises(BusybotError, match="seed: .* is no whole number"):
            EpisodeReplay(small_simulator, told).observe(0)
    with pytest.raises(BusybotError, match="interaction"):
        act_again(small_simulator, episode.board, read_episode(tmp_path / "e.mcap"))
