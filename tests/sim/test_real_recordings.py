"""Recordings through the real camera: a photo after every action, equal when made again, the clean one behind it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardSpec
from busybot.common.errors import BusybotError
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.datasets.verify import verify
from busybot.episodes.camera import Rays, project
from busybot.episodes.episode import Episode
from busybot.episodes.episode_diff import compare_episodes
from busybot.episodes.mcap.reader import read_episode
from busybot.objects.resolve import find
from busybot.sim.builtin_policies import builtin_factory
from busybot.sim.collect import CollectConfig, collect
from busybot.sim.env import BusyBoardEnv
from busybot.sim.interaction import InteractionConfig, look
from busybot.sim.recorder import grasp_at, record_episode
from busybot.sim.regenerate import regenerate
from busybot.sim.replay import EpisodeReplay, act_again
from busybot.sim.scene.appearance import Randomise
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.real_camera import REACH, REAL, CameraConfig, Photo, true_depth
from busybot.sim.scene.render import RenderConfig
from tests.sim.conftest import SMALL

REAL_SMALL = SMALL.model_copy(update={"camera": CameraConfig.model_validate(REAL)})
RANDOMISED = Randomise(pose=0.3, fov=0.1, lights=0.6, textures=0.6)
ALL_SMALL = REAL_SMALL.model_copy(update={"randomise": RANDOMISED})
REAL_COLLECT = CollectConfig(policy="scripted", steps=4, render=ALL_SMALL)


def drawn(seed: int = 5, boards: int = 1, tasks: bool = False) -> list[BoardSpec]:
    relations = {"tasks": "one-to-many"} if tasks else {"relations": "one-to-many"}
    config = BoardConfig.model_validate({"boards": boards, "group_size": 1, "seed": seed, **relations})
    return list(generate_boards(config, find("procedural")))


def record(
    view: RenderConfig, policy: str = "scripted", steps: int = 10, config: InteractionConfig | None = None
) -> Episode:
    simulator = Simulator(find("procedural"), view)
    board = drawn(tasks=True)[0]
    return record_episode(simulator, board, builtin_factory(policy), steps, config or InteractionConfig(), 3)


@pytest.fixture(scope="module")
def real() -> Episode:
    return record(ALL_SMALL)


def test_every_action_has_a_photo_of_its_own(real: Episode) -> None:
    assert real.frame_of == list(range(11)) and len(real.images) == 11
    assert {step.success for step in real.steps} == {True, False}
    for before, after in zip(real.images, real.images[1:], strict=False):
        assert not np.array_equal(before.rgb, after.rgb)
    assert real.goal is not None and isinstance(real.goal, Photo) and real.goal.frame == -1


def test_all_photos_go_back_and_the_clean_pictures_behind_them_are_those_of_a_clean_recording(real: Episode) -> None:
    replay = EpisodeReplay(Simulator(find("procedural"), ALL_SMALL), real)
    steps = range(len(real.steps) + 1)
    for step in [*steps, *reversed(steps)]:
        compared = replay.compare(step)
        assert compared.rule == "equal" and compared.holds and compared.image.equal, step
    clean_view = ALL_SMALL.model_copy(update={"camera": CameraConfig()})
    clean = act_again(Simulator(find("procedural"), clean_view), real.board, real)
    assert [step.success for step in clean.steps] == [step.success for step in real.steps]
    assert len(clean.images) < len(real.images) and clean.images[0].depth is not None
    for step in steps:
        behind, told = replay.put_back(step).observe(), clean.image(step)
        assert np.array_equal(behind.rgb, told.rgb) and np.array_equal(behind.segmentation, told.segmentation)  # type: ignore[arg-type]
        assert behind.depth == pytest.approx(told.depth, abs=1e-4)
        assert np.array_equal(behind.segmentation, real.image(step).segmentation)  # type: ignore[arg-type]
        assert not np.array_equal(behind.rgb, real.image(step).rgb)


@pytest.mark.parametrize("stop", ["physics", "pixels"])
def test_recorded_actions_give_the_same_recording(stop: str) -> None:
    config = InteractionConfig.model_validate({"stop": stop})
    episode = record(REAL_SMALL, "random", 6, config)
    again = act_again(Simulator(find("procedural"), REAL_SMALL), episode.board, episode)
    assert compare_episodes(episode, again).nothing and again.renderer == episode.renderer
    assert len(again.images) == 7


def test_the_gripper_goes_where_the_photo_says_and_holds_what_is_there(small_simulator: Simulator) -> None:
    scene = Simulator(find("procedural"), REAL_SMALL).board(drawn()[0])
    photo = look(scene, 3, 1)
    assert isinstance(photo, Photo) and photo.depth is not None and photo.segmentation is not None
    rays, codes = (
        Rays(scene.camera),
        [code for code in np.unique(photo.segmentation) if scene.trigger_at(int(code)) is not None],
    )
    v, u = (int(value) for value in np.argwhere(photo.segmentation == codes[0])[3])
    for told, held in ((0.9 * REACH, True), (-0.9 * REACH, True), (1.1 * REACH, False), (None, False)):
        depth = true_depth(photo).copy()
        depth[v, u] = 0 if told is None else depth[v, u] + told
        grasp = grasp_at(scene, replace(photo, depth=depth), rays, (u, v))
        assert (grasp.trigger is not None) == held
        assert np.allclose(grasp.position, rays.point(depth, (u, v)))
        if told is not None:
            assert project(grasp.position, scene.camera)[1] == pytest.approx(true_depth(photo)[v, u] + told, abs=1e-4)


@pytest.mark.long
@pytest.mark.usefixtures("in_process")
def test_collected_stopped_continued_verified_and_made_again(tmp_path: Path) -> None:
    config = BoardConfig(boards=3, group_size=3, seed=2)
    dataset = create_dataset(tmp_path / "data", config, find("procedural"))
    collect(dataset, find("procedural"), REAL_COLLECT, 1)
    whole = dataset.hashes()
    assert verify(dataset.path).ok
    dataset.episode_path(1).unlink()
    assert collect(Dataset.open(dataset.path), find("procedural"), REAL_COLLECT, 1).new == 1
    assert dataset.hashes() == whole
    done = regenerate(dataset.path, tmp_path / "again", find("procedural"))
    assert done.ok and done.episodes == {"equal": 3, "close": 0} and Dataset.open(tmp_path / "again").hashes() == whole
    cameras = [read_episode(dataset.episode_path(index)).camera for index in range(3)]
    assert (
        len({camera.pose.tobytes() for camera in cameras}) == 3 == len({camera.matrix.tobytes() for camera in cameras})
    )
    assert len({str(read_episode(dataset.episode_path(index)).renderer) for index in range(3)}) == 1
    with pytest.raises(BusybotError, match="render"):
        collect(dataset, find("procedural"), REAL_COLLECT.model_copy(update={"render": SMALL}), 1)


def test_the_environment_looks_with_the_camera_and_goes_back_to_a_photo() -> None:
    environment = BusyBoardEnv(render=REAL_SMALL)
    first, _ = environment.reset(seed=4)
    act = {"position": np.zeros(3, np.float32), "direction": 2}
    second = environment.step(act)[0]
    saved = environment.save_state()
    third = environment.step(act)[0]
    assert not np.array_equal(first["rgb"], second["rgb"]) and not np.array_equal(second["rgb"], third["rgb"])
    back = environment.restore_state(saved)
    assert np.array_equal(back["rgb"], second["rgb"]) and np.array_equal(back["depth"], second["depth"])
    assert np.array_equal(environment.step(act)[0]["rgb"], third["rgb"])
    environment.reset(seed=8)
    assert np.array_equal(environment.restore_state(saved)["rgb"], second["rgb"]), "the seed belongs to the state"
    assert np.array_equal(environment.step(act)[0]["rgb"], third["rgb"]) and environment.save_state()[3] == saved[3]
    assert np.array_equal(environment.reset(seed=4)[0]["rgb"], first["rgb"])
    environment.step(act)
    assert np.array_equal(environment.restore_state(saved[:3])["rgb"], second["rgb"]), "as earlier versions saved it"
