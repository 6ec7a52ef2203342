"""Scenes in the simulator: recorded, verified, made again, put back and frozen like any board."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.scenes import SCENES
from busybot.boards.spec import BoardSpec
from busybot.common.errors import BusybotError
from busybot.datasets.create import create_dataset
from busybot.datasets.dataset import Dataset
from busybot.datasets.freeze import freeze
from busybot.datasets.verify import verify
from busybot.episodes.mcap.reader import read_episode
from busybot.objects.resolve import find
from busybot.sim.collect import CollectConfig, collect
from busybot.sim.regenerate import regenerate
from busybot.sim.replay import EpisodeReplay
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.render import RenderConfig
from tests.sim.conftest import SMALL, Once

STEPS = 6


@pytest.fixture(params=SCENES)
def recorded(
    request: pytest.FixtureRequest, once: Once, work_here: Callable[[], AbstractContextManager[None]]
) -> Dataset:
    """Two boards of a scene and what the scripted policy did on them; not to be changed."""

    def record(path: Path) -> None:
        dataset = create_dataset(path, BoardConfig(world=request.param, boards=2, seed=3), find("procedural"))
        with work_here():
            collect(
                dataset,
                find("procedural"),
                CollectConfig(policy="scripted", steps=STEPS, render=SMALL, images="png"),
                1,
            )

    return Dataset.open(once(f"scene-{request.param}", record))


@pytest.mark.long
@pytest.mark.usefixtures("in_process")
def test_a_scene_is_recorded_verified_made_again_and_frozen(recorded: Dataset, tmp_path: Path) -> None:
    assert verify(recorded.path).ok
    done = regenerate(recorded.path, tmp_path / "again", find("procedural"))
    assert done.ok and done.boards_from == "configuration" and done.image.equal
    assert Dataset.open(tmp_path / "again").hashes() == recorded.hashes()
    assert freeze(tmp_path / "again", find("procedural")).new and verify(tmp_path / "again").ok


def test_its_camera_is_the_boards_and_every_step_goes_back(recorded: Dataset, small_simulator: Simulator) -> None:
    episode = read_episode(recorded.episode_path(1), "lazy")
    board = episode.board
    assert board.camera is not None and episode.camera.pose[:3, 3] == pytest.approx(board.camera.position)
    assert sum(step.success for step in episode.steps) == STEPS
    assert (episode.image(0).boxes >= 0).all(), "everything shows"
    replay = EpisodeReplay(small_simulator, episode)
    assert all(replay.compare(step).image.equal for step in range(STEPS + 1))


def test_depth_and_the_camera_agree_however_far_it_stands(recorded: Dataset) -> None:
    """The board's surface lies at height 0 wherever it shows, which is what policies reckon with."""
    from busybot.episodes.camera import Rays

    episode = read_episode(recorded.episode_path(0))
    image = episode.image(0)
    assert image.depth is not None and image.segmentation is not None and image.depth.max() > 6
    points = Rays(episode.camera).points(image.depth)
    width, height = episode.board.size
    on_board = (np.abs(points[..., 0]) < 0.95 * width / 2) & (np.abs(points[..., 1]) < 0.95 * height / 2)
    bare = on_board & (image.segmentation == 0)
    assert bare.sum() > 2000 and np.abs(points[bare][:, 2]).max() < 0.01


def test_a_camera_drawn_beside_is_drawn_about_the_boards(recorded: Dataset) -> None:
    board = recorded.board(0)
    assert board.camera is not None
    moved = RenderConfig.model_validate({"randomise": {"pose": 0.3}}).of_board(board)
    apart = np.linalg.norm(np.subtract(moved.position, board.camera.position))
    assert 0 < apart <= 0.3


def test_a_boards_camera_that_sees_nothing_is_named() -> None:
    library, camera = find("procedural"), {"position": [0, 0, 0.5], "target": [0, 0, 0], "fov_deg": 60}
    [board, *_] = generate_boards(BoardConfig(world="kitchen", boards=1), library)
    values = board.model_dump(mode="json")
    with pytest.raises(BusybotError, match="board 0: its camera"):
        RenderConfig().of_board(BoardSpec.model_validate({**values, "camera": camera}))
    for changed, why in (({"position": [0, 0, -4]}, "camera"), ({"target": [0, 0, 0.5]}, "the same point")):
        with pytest.raises(ValueError, match=why):
            BoardSpec.model_validate({**values, "camera": {**camera, **changed}})
