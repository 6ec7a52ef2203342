"""Cameras, lights and surfaces that are drawn for each board: each term alone, always the same, the board in sight."""

import numpy as np
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardSpec
from busybot.episodes.camera import project
from busybot.episodes.episode import Image
from busybot.objects.resolve import find
from busybot.sim.scene.appearance import Randomise
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.render import RenderConfig, camera_model
from tests.sim.conftest import SMALL

BOARDS = list(generate_boards(BoardConfig(boards=12, group_size=12, seed=8), find("procedural")))


def view(**terms: float) -> RenderConfig:
    return SMALL.model_copy(update={"randomise": Randomise.model_validate(terms)})


def picture(config: RenderConfig, board: BoardSpec) -> Image:
    return Simulator(find("procedural"), config).board(board).observe()


def test_a_term_is_named_only_where_it_is() -> None:
    told = view(lights=0.5).model_dump(mode="json")
    assert told["randomise"] == {"lights": 0.5} and "randomise" not in SMALL.model_dump(mode="json")
    assert RenderConfig.model_validate(told) == view(lights=0.5) and SMALL.of_board(BOARDS[0]) is SMALL


@pytest.mark.parametrize("terms", [{"pose": 0.4}, {"fov": 0.2}, {"pose": 1.0, "fov": 0.5}])
def test_each_board_has_its_camera_and_shows_whole(terms: dict[str, float]) -> None:
    config, seen = view(**terms), set()
    for board in BOARDS:
        drawn = config.of_board(board)
        assert drawn == config.of_board(board)
        moved = np.linalg.norm(np.subtract(drawn.position, SMALL.position))
        assert moved <= terms.get("pose", 0) and (moved > 0) == ("pose" in terms)
        assert np.linalg.norm(np.subtract(drawn.target, SMALL.target)) <= terms.get("pose", 0) / 4
        corners = np.array([(x, y, 0.0) for x in (-2, 2) for y in (-2, 2)])
        pixels, _ = project(corners, camera_model(drawn))
        assert (pixels >= -1e-6).all() and (pixels <= np.array([SMALL.width, SMALL.height]) + 1e-6).all()
        seen.add((drawn.position, drawn.fov_deg))
    assert len(seen) > len(BOARDS) / 2  # those that would be too narrow are all just wide enough


def test_the_recorded_camera_is_the_one_that_looked() -> None:
    scene = Simulator(find("procedural"), view(pose=0.5, fov=0.1)).board(BOARDS[3])
    image, objects = scene.observe(), scene.spec.objects
    assert image.depth is not None
    for index, placed in enumerate(objects):
        u0, v0, u1, v1 = image.boxes[index]
        (u, v), depth = project(np.array(placed.position), scene.camera)
        assert u0 - 4 <= u <= u1 + 4 and v0 - 4 <= v <= v1 + 4 and 2 < depth < 6


@pytest.mark.long
@pytest.mark.parametrize("shader", ["busybot", "default"])
def test_lights_change_how_things_are_lit_and_nothing_else(shader: str) -> None:
    usual, lit = (config.model_copy(update={"shader": shader}) for config in (SMALL, view(lights=1.0)))
    plain = picture(usual, BOARDS[0])
    ratios = set()
    for index in range(3):
        board = BOARDS[0].model_copy(update={"index": index})  # other lights, and nothing else is another
        one, again = picture(lit, board), picture(lit, board)
        assert np.array_equal(one.rgb, again.rgb) and np.array_equal(one.depth, plain.depth)  # type: ignore[arg-type]
        assert np.array_equal(one.segmentation, plain.segmentation)  # type: ignore[arg-type]
        ratios.add(tuple((one.rgb.mean(axis=(0, 1)) / plain.rgb.mean(axis=(0, 1))).round(3)))
    assert len(ratios) == 3 and max(abs(value - 1) for ratio in ratios for value in ratio) > 0.05
    assert np.array_equal(picture(usual, BOARDS[0]).rgb, plain.rgb)  # the usual lights are there again


def test_surfaces_change_the_board_and_the_table_and_leave_the_objects() -> None:
    plain = picture(SMALL, BOARDS[0])
    first, second = (picture(view(textures=1.0), board) for board in BOARDS[:2])
    objects = plain.segmentation > 0  # type: ignore[operator]
    assert np.array_equal(first.depth, plain.depth) and np.array_equal(first.rgb[objects], plain.rgb[objects])  # type: ignore[arg-type]
    unlike = [(a.rgb[~objects] != b.rgb[~objects]).any(axis=-1).mean() for a, b in ((plain, first), (first, second))]
    assert min(unlike) > 0.9
