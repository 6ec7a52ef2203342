"""The Gymnasium environment keeps its contract."""

from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from busybot.boards.config import BoardConfig
from busybot.boards.spec import BoardCamera
from busybot.common.errors import BusybotError
from busybot.sim.builtin_policies import RandomFactory
from busybot.sim.env import BusyBoardEnv, PolicyAgent
from busybot.sim.scene.render import RenderConfig

SMALL = RenderConfig(width=160, height=120)


@pytest.fixture
def env() -> Iterator[BusyBoardEnv]:
    made = gymnasium.make("busybot.sim.registration:busybot/Board-v0", render=SMALL, max_steps=12)
    yield made.unwrapped  # type: ignore[misc]
    made.close()


def rollout(env: BusyBoardEnv, seed: int, steps: int = 12) -> list[object]:
    observation, info = env.reset(seed=seed)
    env.action_space.seed(seed)
    trace: list[object] = [observation["rgb"].tobytes(), observation["depth"].tobytes(), info["board"]]
    for _ in range(steps):
        action = env.action_space.sample()
        observation, reward, terminated, truncated, info = env.step(action)
        trace += [observation["rgb"].tobytes(), reward, terminated, truncated, info["trigger_states"]]
    return trace


def test_gymnasium_knows_it_and_its_checker_passes(env: BusyBoardEnv) -> None:
    assert "busybot/Board-v0" in gymnasium.registry
    check_env(env, skip_render_check=True)


@pytest.mark.parametrize("world", ["kitchen", "room"])
def test_scenes_are_larger_and_their_cameras_farther_away(world: str) -> None:
    env = BusyBoardEnv(boards={"world": world}, render=SMALL)
    for seed in range(3):
        observation, info = env.reset(seed=seed)
        assert env.observation_space.contains(observation)
        for placed in info["board"].objects:
            assert env.action_space["position"].contains(np.array(placed.position, np.float32))
    env.close()


def test_same_seed_same_rollout_other_seed_other_board(env: BusyBoardEnv) -> None:
    assert rollout(env, 5) == rollout(env, 5)
    assert env.reset(seed=5)[1]["board"] != env.reset(seed=6)[1]["board"]


def test_the_truth_is_in_info_alone(env: BusyBoardEnv) -> None:
    observation, info = env.reset(seed=0)
    assert set(observation) == {"rgb", "depth"}
    assert {"board", "trigger_states", "responder_states"} <= set(info)
    assert env.observation_space.contains(observation)


def test_truncation_after_max_steps(env: BusyBoardEnv) -> None:
    env.reset(seed=0)
    ends = [env.step(env.action_space.sample())[2:4] for _ in range(12)]
    assert ends == [(False, False)] * 11 + [(False, True)]


def test_acting_on_a_visible_trigger_works_and_can_be_undone_by_restoring(env: BusyBoardEnv) -> None:
    env.reset(seed=1)
    scene, image = env._scene, env._image
    assert scene is not None and image.segmentation is not None and image.depth is not None
    successes = 0
    for code, link in enumerate(scene.links, start=1):
        spots = np.argwhere(image.segmentation == code)
        if not link.trigger or not len(spots):
            continue
        row, column = (int(value) for value in spots[len(spots) // 2])
        position = env._rays.point(image.depth, (column, row))
        assert env.grasp(position).trigger == scene.trigger_at(code)
        assert env.grasp(position + np.float32([0, 0, 0.5])).trigger is None
        for direction in range(18):
            state = env.save_state()
            before = env.restore_state(state)
            first = env.step({"position": position, "direction": direction})
            again = env.restore_state(state)
            assert np.array_equal(before["rgb"], again["rgb"])
            second = env.step({"position": position, "direction": direction})
            assert np.array_equal(first[0]["rgb"], second[0]["rgb"]) and first[1] == second[1]
            assert first[4]["success"] == second[4]["success"]
            successes += first[4]["success"]
            env.restore_state(state)
    assert successes


def test_boards_can_be_given_or_numbered(env: BusyBoardEnv) -> None:
    _, info = env.reset(seed=3, options={"index": 4})
    assert env.reset(seed=3, options={"index": 4})[1]["board"] == info["board"]
    assert env.reset(seed=9, options={"board": info["board"]})[1]["board"] == info["board"]
    fresh = BusyBoardEnv(render=SMALL)
    first = fresh.reset(options={"index": 4})[1]["board"]
    fresh.reset()
    assert fresh.reset(options={"index": 4})[1]["board"] == first != info["board"], "whatever was played before"
    assert fresh.reset(seed=0, options={"index": 4})[1]["board"] == first
    fresh.close()


def test_a_given_board_that_leaves_the_spaces_is_refused(env: BusyBoardEnv) -> None:
    kitchens = BusyBoardEnv(boards={"world": "kitchen"}, render=SMALL)
    board = kitchens.reset(seed=1)[1]["board"]
    observation, info = kitchens.reset(options={"board": board})
    assert info["board"] == board and kitchens.observation_space.contains(observation)
    kitchens.close()
    with pytest.raises(BusybotError, match=r"6 x 4\.4 .*spaces are for 4 x 4(.|\n)*boards=\{\"world\": \"kitchen\"\}"):
        env.reset(options={"board": board})
    plain = env.reset(seed=1)[1]["board"]
    far = plain.model_copy(update={"camera": BoardCamera(position=(0, -3, 5), target=(0, 0, 0), fov_deg=60)})
    with pytest.raises(BusybotError, match=r"seen as far as 23\.3(.|\n)*render=\{\"far\": 24\}"):
        env.reset(options={"board": far})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bord": 3}, "no option 'bord'"),
        ({"index": 2.5}, "option index: 2.5"),
        ({"index": True}, "option index: True"),
        ({"index": -1}, "option index: -1"),
        ({"board": {"index": 0}}, "option board: dict is no BoardSpec"),
    ],
)
def test_options_of_reset_are_checked(options: dict[str, Any], message: str) -> None:
    with pytest.raises(BusybotError, match=message) as error:
        BusyBoardEnv(render=SMALL).reset(options=options)
    assert error.value.hint


def test_a_board_and_an_index_exclude_each_other(env: BusyBoardEnv) -> None:
    board = env.reset(seed=3, options={"board": None, "index": np.int64(4)})[1]["board"]
    with pytest.raises(BusybotError, match="exclude each other"):
        env.reset(options={"board": board, "index": 5})


def test_board_options_are_honoured() -> None:
    env = BusyBoardEnv(boards=BoardConfig(relations="one-to-one", switches=(1, 1)), render=SMALL)
    for seed in range(5):
        board = env.reset(seed=seed)[1]["board"]
        assert [relation.kind for relation in board.relations] == ["one-to-one"]
    env.close()


def test_relations_of_a_real_board_differ_from_seed_to_seed() -> None:
    env = BusyBoardEnv(boards={"world": "real-board"}, render=SMALL)
    boards = [env.reset(seed=seed)[1]["board"] for seed in range(8)]
    assert len({str(board.relation_matrix()) for board in boards}) > 1
    assert env.reset(seed=3)[1]["board"] == boards[3]
    env.close()


@pytest.mark.parametrize(
    "action",
    [
        *((0, 0, 7), np.zeros(4), {"position": np.zeros(3)}, {"position": "x", "direction": 1}),
        *({"position": np.zeros(3), "direction": direction} for direction in (1.7, np.inf)),
    ],
)
def test_what_is_no_action_is_refused_by_name(env: BusyBoardEnv, action: Any) -> None:
    env.reset(seed=0)
    with pytest.raises(BusybotError, match="is not one") as error:
        env.step(action)
    assert error.value.hint == "see `env.action_space`"


def test_acting_and_looking_before_reset_is_refused() -> None:
    env = BusyBoardEnv(render=SMALL, render_mode="rgb_array")
    for too_early in (lambda: env.step({"position": np.zeros(3), "direction": 0}), env.render):
        with pytest.raises(BusybotError, match="reset"):
            too_early()


def test_pixels_beside_the_picture_show_nothing(env: BusyBoardEnv) -> None:
    env.reset(seed=0)
    for row, column in ((-1, 0), (0, 160), (120, 0)):
        with pytest.raises(BusybotError, match="there is no pixel"):
            env.position_at(row, column)


def test_a_position_at_the_camera_or_behind_it_holds_nothing(env: BusyBoardEnv) -> None:
    env.reset(seed=0)
    assert env._scene is not None
    camera = env._scene.camera.pose[:3, 3]
    for position in (camera, camera + np.float32([0, 0, 1])):
        assert env.grasp(position).trigger is None
    assert env.step({"position": camera, "direction": 0})[1] == 0


def test_configurations_may_be_plain_dictionaries() -> None:
    boards = {"relations": "one-to-one", "switches": (1, 1)}
    env = gymnasium.make("busybot/Board-v0", boards=boards, render={"width": 160, "height": 120}, max_steps=1)
    plain = env.reset(seed=3)[1]["board"]
    same = BusyBoardEnv(boards=BoardConfig(relations="one-to-one", switches=(1, 1)), render=SMALL)
    assert plain == same.reset(seed=3)[1]["board"]
    assert (
        gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(env.spec.to_json())).reset(seed=3)[1] is not None
    )
    for name, value in (("boards", {"split": "none"}), ("render", {"size": 3}), ("interaction", {"delta": "much"})):
        with pytest.raises(BusybotError, match=name) as error:
            BusyBoardEnv(**{name: value})
        assert error.value.hint


def test_pixels_are_flat_spaces_that_stable_baselines_takes() -> None:
    env: gymnasium.Env[Any, Any] = gymnasium.make("busybot/BoardPixels-v0", max_steps=3)
    assert env.action_space == gymnasium.spaces.MultiDiscrete([120, 160, 18])
    assert env.observation_space == gymnasium.spaces.Box(0, 255, (3, 120, 160), np.uint8)
    observation, _ = env.reset(seed=0)
    assert observation.any() and env.step(env.action_space.sample())[0].shape == (3, 120, 160)
    larger = gymnasium.make("busybot/BoardPixels-v0", render={"width": 64, "height": 48})
    assert larger.observation_space.shape == (3, 48, 64)


@pytest.mark.long
def test_ppo_learns_on_pixels_without_wrappers(recwarn: pytest.WarningsRecorder) -> None:
    pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed: `make extras`")
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_checker import check_env

    env = gymnasium.make("busybot/BoardPixels-v0", render={"width": 64, "height": 48}, max_steps=4)
    recwarn.clear()
    check_env(env)
    assert [str(one.message) for one in recwarn] == []
    model = PPO("CnnPolicy", env, n_steps=8, batch_size=8, n_epochs=1, seed=0).learn(16)
    assert model.num_timesteps == 16 and env.action_space.contains(model.predict(env.reset(seed=0)[0])[0])


def test_a_policy_plays_as_an_agent(env: BusyBoardEnv) -> None:
    def play() -> list[tuple[object, float]]:
        observation, _ = env.reset(seed=2)
        agent, trace = PolicyAgent(env, RandomFactory(), seed=5), []
        for _ in range(4):
            action = agent.act(observation)
            assert action is not None
            before = observation["rgb"]
            observation, reward, _, _, info = env.step(action)
            agent.observe(observation, reward, info["executed"])
            trace.append((action["position"].tolist(), reward))
            assert agent._seen is not None and np.array_equal(agent._seen.rgb, observation["rgb"])
            assert not np.array_equal(before, observation["rgb"]) or not reward
        return trace

    assert play() == play()


@pytest.mark.long
def test_the_shipped_policy_earns_as_an_agent() -> None:
    from busybot.interact.policy.policy_factory import LearnedPolicyFactory

    env = gymnasium.make("busybot/Board-v0", max_steps=8)
    observation, _ = env.reset(seed=1)
    agent, earned = PolicyAgent(env, LearnedPolicyFactory("procedural")), 0.0
    for _ in range(8):
        observation, reward, _, _, info = env.step(agent.act(observation))
        agent.observe(observation, float(reward), info["executed"])
        earned += float(reward)
    env.close()
    assert earned >= 6
