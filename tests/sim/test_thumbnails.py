"""Portraits show what an object does, whatever its category."""

from pathlib import Path

import pytest

from busybot.common.errors import BusybotError
from busybot.sim.thumbnails import thumbnails
from tests.objects.raw_objects import BOX_LAMP, library_of


def test_a_door_whose_effect_is_a_colour_is_lit(tmp_path: Path) -> None:
    effect = {"type": "color", "link": "shade", "states": ((0, 0, 0), (0, 0, 1))}
    turning = BOX_LAMP.replace('"j1" type="fixed"', '"j1" type="continuous"')
    library = library_of(tmp_path, turning, category="Door", effect=effect)
    (picture,) = thumbnails(library, ["Door/thing"], 48)
    red, _, blue = (picture[..., channel].astype(int) for channel in range(3))
    assert (blue - red > 100).any()


def test_what_is_too_large_for_a_portrait_is_named(tmp_path: Path) -> None:
    effect = {"type": "color", "link": "shade", "states": ((0, 0, 0), (0, 0, 1))}
    library = library_of(tmp_path, BOX_LAMP, category="Lamp", effect=effect, scale=100.0)
    with pytest.raises(BusybotError, match="Lamp/thing: with its Scale 100 it is .* board units across, too large"):
        list(thumbnails(library, ["Lamp/thing"], 48))
