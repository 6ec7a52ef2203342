"""The descriptor: what it tells apart, and what it does not see."""

import cv2
import numpy as np
import pytest

from busybot.reason.encoders.descriptor import Descriptor, describe
from busybot.reason.inputs.appearances import Appearance

OFF, ON, BLUE = (60, 60, 60), (250, 240, 30), (30, 40, 250)


def disc(color: tuple[int, int, int], background: int = 0, size: int = 60) -> Appearance:
    """A lamp on a foot, on a background that is not its own."""
    rgb = np.full((size, size, 3), background, np.uint8)
    own = np.zeros((size, size), np.uint8)
    cv2.rectangle(own, (size // 2 - 5, size // 2), (size // 2 + 5, size - 3), 1, -1)
    rgb[own > 0] = (120, 100, 80)
    cv2.circle(own, (size // 2, size // 2), size // 4, 1, -1)
    cv2.circle(rgb, (size // 2, size // 2), size // 4, color, -1)
    return Appearance(rgb, own > 0)


def apart(one: Appearance, other: Appearance) -> float:
    return float(np.linalg.norm(describe(one) - describe(other)))


def test_256_finite_numbers_of_moderate_size() -> None:
    for look in (disc(OFF), disc(ON, 255), disc(BLUE, size=7)):
        values = describe(look)
        assert values.shape == (256,) and values.dtype == np.float32
        assert np.isfinite(values).all() and np.abs(values).max() <= 3


@pytest.mark.parametrize("color", [ON, BLUE, (90, 60, 60)])
def test_a_colour_changes_it_much_more_than_jpeg(color: tuple[int, int, int]) -> None:
    done, data = cv2.imencode(".jpg", disc(OFF).rgb, [cv2.IMWRITE_JPEG_QUALITY, 90])
    assert done
    jpeg = Appearance(np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR)), disc(OFF).own)
    assert apart(disc(OFF), disc(color)) > 5 * apart(disc(OFF), jpeg)


def test_what_is_not_the_object_makes_no_difference() -> None:
    np.testing.assert_array_equal(describe(disc(ON, 0)), describe(disc(ON, 255)))


def test_a_part_that_moves_changes_it() -> None:
    track = np.full((40, 120, 3), 150, np.uint8)
    own = np.ones((40, 120), bool)
    places = []
    for column in (5, 50, 95):
        rgb = track.copy()
        rgb[10:30, column : column + 20] = (200, 30, 30)
        places.append(Appearance(rgb, own))
    distances = [apart(places[0], places[1]), apart(places[0], places[2]), apart(places[1], places[2])]
    assert min(distances) > 0.5


def test_the_same_look_at_another_size_is_nearly_the_same() -> None:
    assert apart(disc(ON, size=60), disc(ON, size=90)) < 0.3 * apart(disc(ON), disc(OFF))


def test_of_nothing_it_is_zero() -> None:
    assert not describe(Appearance(np.full((20, 30, 3), 99, np.uint8), np.zeros((20, 30), bool))).any()


def test_many_are_encoded_one_by_one() -> None:
    both = [disc(ON), disc(OFF)]
    np.testing.assert_array_equal(Descriptor().encode(both), [describe(look) for look in both])
    assert Descriptor().encode([]).shape == (0, 256)
