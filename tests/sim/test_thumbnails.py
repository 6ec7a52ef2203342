"""Portraits show what an object does, whatever its category."""

from pathlib import Path

from busybot.sim.thumbnails import thumbnails
from tests.objects.raw_objects import BOX_LAMP, library_of


def test_a_door_whose_effect_is_a_colour_is_lit(tmp_path: Path) -> None:
    effect = {"type": "color", "link": "shade", "states": ((0, 0, 0), (0, 0, 1))}
    turning = BOX_LAMP.replace('"j1" type="fixed"', '"j1" type="continuous"')
    library = library_of(tmp_path, turning, category="Door", effect=effect)
    (picture,) = thumbnails(library, ["Door/thing"], 48)
    red, _, blue = (picture[..., channel].astype(int) for channel in range(3))
    assert (blue - red > 100).any()
