"""Goal images: what acting would lead to, and no trace of them in the history."""

from dataclasses import replace

import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardSpec, Task
from busybot.boards.task import goal_responders, responder_states, start_states
from busybot.common.errors import BusybotError
from busybot.episodes.episode import Episode
from busybot.episodes.episode_diff import compare_episodes, compare_images
from busybot.sim.builtin_policies import ScriptedFactory
from busybot.sim.interaction import InteractionConfig
from busybot.sim.recorder import picture_goal, record_episode
from busybot.sim.replay import act_again
from busybot.sim.scene.board_scene import BoardState, Simulator


def board(simulator: Simulator, seed: int = 3) -> BoardSpec:
    return next(iter(generate_boards(BoardConfig(tasks="one-to-many", boards=1, seed=seed), simulator.library)))


def record(simulator: Simulator, spec: BoardSpec, steps: int = 8) -> Episode:
    return record_episode(simulator, spec, ScriptedFactory(), steps, InteractionConfig(), 3)


def with_goal(spec: BoardSpec, goal: tuple[int, ...]) -> BoardSpec:
    assert spec.task is not None
    task = Task(kind=spec.task.kind, links=spec.task.links, goal=goal)
    return BoardSpec.model_validate({**dict(spec), "task": task})


def test_the_history_is_that_of_the_same_board_without_a_task(small_simulator: Simulator) -> None:
    spec = board(small_simulator)
    plain = record(small_simulator, spec.model_copy(update={"task": None}))
    episode = record(small_simulator, spec)
    assert plain.goal is None and episode.goal is not None
    again = replace(episode, board=plain.board, goals=[])
    assert compare_episodes(plain, again).nothing and any(step.success for step in plain.steps)


def test_the_goal_looks_as_after_acting(small_simulator: Simulator) -> None:
    spec = board(small_simulator)
    episode = record(small_simulator, spec)
    assert len({step.trigger_states_after for step in episode.steps}) > 2
    for k, step in enumerate(episode.steps):
        scene = small_simulator.board(with_goal(spec, step.trigger_states_after))
        before = scene.observe()
        [goal] = picture_goal(scene)
        assert compare_images(goal, episode.image(k + 1)).equal
        assert compare_images(scene.observe(), before).equal and scene.trigger_states() == start_states(spec)


def test_the_simulators_responders_are_those_that_the_task_foretells(small_simulator: Simulator) -> None:
    for seed in range(4):
        spec = board(small_simulator, seed)
        assert spec.task is not None
        scene = small_simulator.board(spec)
        assert scene.responder_states() == responder_states(spec, start_states(spec))
        scene.restore(BoardState(spec.task.goal))
        assert scene.responder_states() == goal_responders(spec)


def test_acting_again_pictures_the_goal_again(small_simulator: Simulator) -> None:
    episode = record(small_simulator, board(small_simulator), steps=2)
    again = act_again(small_simulator, episode.board, episode)
    assert compare_episodes(episode, again).nothing
    assert not compare_episodes(episode, replace(again, goals=[])).holds("close")
    other = replace(again, goals=[replace(episode.images[0], rgb=episode.images[0].rgb // 2)])
    assert not compare_episodes(episode, other).goal and not compare_episodes(episode, other).holds("close")


def test_links_that_the_objects_do_not_have_are_refused(small_simulator: Simulator) -> None:
    spec = board(small_simulator)
    assert spec.task is not None
    links = tuple(link.model_copy(update={"link": f"no_{number}"}) for number, link in enumerate(spec.task.links))
    task = spec.task.model_copy(update={"links": links})
    scene = small_simulator.board(spec.model_copy(update={"task": task}))
    with pytest.raises(BusybotError, match="other links"):
        picture_goal(scene)
