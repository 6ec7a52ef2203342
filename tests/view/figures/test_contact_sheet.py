"""Contact sheets: every object once, by category and split, and the same picture every time."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from busybot.common.errors import BusybotError
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.sim.thumbnails import GROUND, thumbnails
from busybot.view.figures.contact_sheet import _fitting, _font, groups, sheet

KEYS = ("Door/hatch-01", "Lamp/star-01", "Lamp/tulip-01", "Switch/bolt-01", "Switch/fader-01", "Switch/slider-01")


@pytest.fixture(scope="module")
def few() -> Library:
    """A library of six."""
    library = find("procedural")
    return replace(library, objects={key: library.get(key) for key in KEYS})


def test_objects_stand_by_category_and_split(few: Library) -> None:
    assert groups(few) == [
        ("Switch", "train", ["Switch/fader-01", "Switch/slider-01"]),
        ("Switch", "novel", ["Switch/bolt-01"]),
        ("Lamp", "novel", ["Lamp/star-01", "Lamp/tulip-01"]),
        ("Door", "novel", ["Door/hatch-01"]),
    ]
    unsplit = replace(few, splits={"train": {}, "novel": {}})
    assert [split for _, split, _ in groups(unsplit)] == ["", "", ""], "objects of no split are shown, too"
    assert {split for _, split, _ in groups(find("procedural"))} == {"train", "novel", "other"}


def test_every_object_of_a_whole_library_is_in_one_group() -> None:
    library = find("procedural")
    assert sorted(key for _, _, keys in groups(library) for key in keys) == sorted(library.objects)


def test_portraits_hold_the_whole_object_on_a_plain_ground(few: Library) -> None:
    for key, picture in zip(KEYS, thumbnails(few, KEYS, 64), strict=True):
        assert picture.shape == (64, 64, 3) and picture.dtype == np.uint8
        differs = np.abs(picture.astype(int) - GROUND).max(axis=2) > 40
        assert 0.05 < differs.mean() < 0.7, key
        border = np.concatenate([differs[0], differs[-1], differs[:, 0], differs[:, -1]])
        assert not border.any(), f"{key} is cut off"


def test_lamps_are_lit(few: Library) -> None:
    (picture,) = thumbnails(few, ["Lamp/star-01"], 64)
    saturation = picture.max(axis=2).astype(int) - picture.min(axis=2)
    assert (saturation > 150).mean() > 0.03


def test_the_same_library_gives_the_same_sheet(few: Library, tmp_path: Path) -> None:
    assert sheet(tmp_path / "a.png", few, cell=64, columns=3) == len(KEYS)
    assert sheet(tmp_path / "b.png", few, cell=64, columns=3) == len(KEYS)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    with Image.open(tmp_path / "a.png") as image:
        assert image.width == 3 * 64 + 2 * round(0.22 * 64) and image.height > 4 * 32


@pytest.mark.parametrize(("name", "kind"), [("a.jpg", "JPEG"), ("a.JPEG", "JPEG"), ("a.webp", "WEBP")])
def test_the_ending_decides_the_format(few: Library, tmp_path: Path, name: str, kind: str) -> None:
    one = replace(few, objects={"Switch/bolt-01": few.get("Switch/bolt-01")})
    sheet(tmp_path / name, one, cell=48)
    with Image.open(tmp_path / name) as image:
        assert image.format == kind


def test_a_sheet_with_no_room_in_its_format_is_refused(few: Library, tmp_path: Path) -> None:
    one = replace(few, objects={"Switch/bolt-01": few.get("Switch/bolt-01")})
    with pytest.raises(BusybotError, match="has room for 16383 a side") as error:
        sheet(tmp_path / "a.webp", one, cell=64, columns=300)
    assert "--cell 150" in str(error.value.hint) and not (tmp_path / "a.webp").exists()


def test_long_names_stay_below_their_portraits() -> None:
    font = _font(12.75)
    assert _fitting("bolt-01", font, 144) == "bolt-01"
    long, other = (f"door-handle-with-two-buttons-and-a-key-{number}" for number in (1, 2))
    assert font.getlength(_fitting(long, font, 144)) <= 144 < font.getlength(long)
    assert _fitting(long, font, 144) != _fitting(other, font, 144)


def test_other_endings_and_places_are_refused(few: Library, tmp_path: Path) -> None:
    with pytest.raises(BusybotError, match=r"cannot be written as \.gif"):
        sheet(tmp_path / "a.gif", few)
    (tmp_path / "file").write_text("")
    one = replace(few, objects={"Switch/bolt-01": few.get("Switch/bolt-01")})
    with pytest.raises(BusybotError, match="cannot be written"):
        sheet(tmp_path / "file" / "a.png", one, cell=48)
