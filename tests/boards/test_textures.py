"""Textures are our own, differ from each other, and are the same every time."""

import numpy as np
import pytest

from busybot.boards.textures import COLORS, TEXTURES, painted, texture


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
    with pytest.raises(ValueError, match="wood"):
        texture("marble")
