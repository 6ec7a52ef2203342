"""Textures are our own, differ from each other, and are the same every time."""

import time

import numpy as np
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardSpec, PlacedObject
from busybot.boards.textures import COLORS, TEXTURES, contact_shadow, painted, texture
from busybot.common.errors import BusybotError
from busybot.objects.resolve import find


def test_five_textures_and_eight_colours() -> None:
    assert len(TEXTURES) == 5 and len(set(COLORS)) == 8
    reliefs = [texture(name, 128) for name in TEXTURES]
    for first in range(5):
        assert np.array_equal(reliefs[first], texture(TEXTURES[first], 128))
        for second in range(first):
            assert np.abs(reliefs[first] - reliefs[second]).mean() > 0.01


def test_paint_follows_the_colour() -> None:
    pixels = painted("felt", COLORS[3], 64)
    assert pixels.shape == (64, 64, 3) and pixels.dtype == np.uint8
    assert np.allclose(pixels.mean((0, 1)) / pixels.mean(), np.array(COLORS[3]) / np.mean(COLORS[3]), atol=0.02)


def test_unknown_names_are_refused() -> None:
    with pytest.raises(BusybotError, match="wood"):
        texture("marble")


def test_the_shadow_is_as_large_as_the_object_on_the_board() -> None:
    library = find("procedural")
    (board,) = generate_boards(BoardConfig(boards=1, seed=2), library)
    only, model = board.objects[0], library.get(board.objects[0].key)
    dark = [
        (contact_shadow(replaced(board, only, scale), [model]) < 0.75).sum() for scale in (only.scale, 2 * only.scale)
    ]
    assert 3 < dark[1] / dark[0] < 5  # twice as long and wide


def replaced(board: BoardSpec, placed: PlacedObject, scale: float) -> BoardSpec:
    alone = placed.model_copy(update={"position": (0.0, 0.0, 0.0), "scale": scale})
    return board.model_copy(update={"objects": (alone,)})


@pytest.mark.parametrize("side", [5e-324, 1e-9, 0.01])
def test_a_strangers_tiny_board_takes_no_longer(side: float) -> None:
    library = find("procedural")
    (board,) = generate_boards(BoardConfig(boards=1, seed=2), library)
    far = board.objects[0].model_copy(update={"position": (1000.0, -1000.0, 0.0)})
    tiny = board.model_copy(update={"size": (side, side), "objects": (board.objects[1], far)})
    began = time.process_time()
    shade = contact_shadow(tiny, [library.get(placed.key) for placed in tiny.objects])
    assert shade.shape == (512, 512) and np.isfinite(shade).all() and time.process_time() - began < 10
