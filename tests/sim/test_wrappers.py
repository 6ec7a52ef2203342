"""Wrapped environments keep Gymnasium's contract and mean the same as the core one."""

from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from busybot.common.errors import BusybotError
from busybot.sim.env import BusyBoardEnv, ImageObservations, PixelActions
from busybot.sim.scene.render import RenderConfig

NAME = "busybot.sim.registration:busybot/Board-v0"
SMALL = RenderConfig(width=160, height=120)


@pytest.fixture(scope="module")
def env() -> Iterator[gymnasium.Env[Any, Any]]:
    made = gymnasium.make(NAME, render=SMALL, disable_env_checker=True)
    yield made
    made.close()


@pytest.mark.parametrize("kind", ["rgb", "depth", "rgbd"])
def test_gymnasiums_checker_passes(env: gymnasium.Env[Any, Any], kind: str) -> None:
    check_env(ImageObservations(PixelActions(env), kind), skip_render_check=True)


def test_a_pixel_means_what_is_seen_there(env: gymnasium.Env[Any, Any]) -> None:
    wrapped, core = PixelActions(env), env.unwrapped
    assert isinstance(core, BusyBoardEnv)
    wrapped.reset(seed=2)
    scene, segmentation = core._scene, core._image.segmentation
    assert scene is not None and segmentation is not None
    seen = 0
    for code, link in enumerate(scene.links, start=1):
        for row, column in np.argwhere(segmentation == code)[:3]:
            grasp = core.grasp(wrapped.action(np.array([row, column, 0]))["position"])
            assert grasp.pixel == (column, row)
            assert grasp.trigger == scene.trigger_at(code)
            seen += link.trigger
    assert seen


def test_actions_outside_of_the_picture_are_refused(env: gymnasium.Env[Any, Any]) -> None:
    wrapped = PixelActions(env)
    wrapped.reset(seed=0)
    for action in ([120, 0, 0], [0, 160, 0], [0, 0, 18], [-1, 0, 0]):
        with pytest.raises(BusybotError, match="not one"):
            wrapped.action(np.array(action))


@pytest.mark.parametrize("action", [None, "abc", {"row": 1}, [1.7, 2, 3], [np.nan, 1, 1], [1e30, 1, 1], [2**70, 1, 1]])
def test_what_is_no_pixel_with_a_direction_is_refused_by_name(env: gymnasium.Env[Any, Any], action: Any) -> None:
    env.reset(seed=0)
    with pytest.raises(BusybotError, match="is not one"):
        PixelActions(env).action(action)


def test_one_array_holds_what_the_dictionary_holds(env: gymnasium.Env[Any, Any]) -> None:
    plain, _ = env.reset(seed=1)
    both = ImageObservations(env, "rgbd").observation(plain)
    assert both.shape == (4, 120, 160) and both.dtype == np.float32
    assert np.array_equal(np.round(both[:3] * 255).astype(np.uint8), np.moveaxis(plain["rgb"], -1, 0))
    assert np.array_equal(both[3], plain["depth"])
    with pytest.raises(BusybotError, match="rgbd"):
        ImageObservations(env, "colour")


@pytest.mark.parametrize("mode", ["sync", pytest.param("async", marks=pytest.mark.long)])
def test_vector_environments_play_as_single_ones_do(mode: str) -> None:
    options = {"context": "spawn"} if mode == "async" else {}
    envs = gymnasium.make_vec(NAME, 2, mode, vector_kwargs=options, render=SMALL, max_steps=2)
    first, _ = envs.reset(seed=7)
    action = envs.action_space.sample()
    after, reward, _, truncated, info = envs.step(action)
    assert not truncated.any() and set(reward) <= {0.0, 1.0}
    assert envs.step(action)[3].all(), "truncated after two steps"
    envs.close()
    single = gymnasium.make(NAME, render=SMALL)
    for number in range(2):
        observation, _ = single.reset(seed=7 + number)
        assert np.array_equal(observation["rgb"], first["rgb"][number])
        moved = {"position": action["position"][number], "direction": action["direction"][number]}
        observation, _, _, _, alone = single.step(moved)
        assert np.array_equal(observation["depth"], after["depth"][number])
        assert info["success"][number] == alone["success"]
    single.close()
