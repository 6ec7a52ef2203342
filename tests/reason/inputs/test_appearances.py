"""What is taken for an object's look: its own pixels, without what reaches in, each look once."""

import numpy as np
import pytest

from busybot.common.errors import BusybotError
from busybot.reason.inputs.appearances import Appearances, appearances_of
from busybot.reason.inputs.object_masks import MaskConfig, ObjectMasks, OracleMasks
from busybot.reason.inputs.observation import ObservedEpisode, observe_episode
from tests.episodes.synthetic import make_episode, make_real_episode
from tests.reason.scenes import Patch, Scene

RED, GREEN, BROWN = (200, 20, 20), (20, 200, 20), (90, 60, 30)
LEFT, RIGHT = (30, 40, 60, 70), (90, 40, 120, 70)


def looks(observed: ObservedEpisode, depth: bool = True) -> Appearances:
    return appearances_of(observed, ObjectMasks(observed, MaskConfig(depth=depth)))


class Asked(ObjectMasks):
    """Notes which object was looked at in which frame."""

    def __init__(self, observed: ObservedEpisode):
        super().__init__(observed)
        self.asked: list[tuple[int, int]] = []

    def masks(self, index: int, number: int) -> tuple[np.ndarray, np.ndarray]:
        self.asked.append((index, number))
        return super().masks(index, number)


def two(left: tuple[int, int, int], right: tuple[int, int, int]) -> list[Patch]:
    return [Patch(LEFT, left), Patch(RIGHT, right)]


def test_every_look_is_there_once() -> None:
    """Also one that comes back after another."""
    frames = [two(RED, RED), two(GREEN, RED), two(RED, RED), two(RED, GREEN)]
    found = looks(Scene(("responder", "responder"), [LEFT, RIGHT], frames).observed())
    assert len(found.looks) == 4
    first, second = found.of.T
    assert first[0] == first[2] == first[3] != first[1]
    assert second[0] == second[1] == second[2] != second[3]
    assert (found.looks[first[1]].rgb[found.looks[first[1]].own] == GREEN).all()


def test_pictures_that_are_the_same_are_not_looked_at_again() -> None:
    scene = Scene(("responder",), [LEFT], [[Patch(LEFT, RED)], [Patch(LEFT, GREEN)]], pixels=[(0, 0)] * 3)
    observed = scene.observed()
    object.__setattr__(observed, "image_of", (0, 0, 1, 1))
    pixels = Asked(observed)
    assert appearances_of(observed, pixels).of[:, 0].tolist() == [0, 0, 1, 1]
    assert pixels.asked == [(0, 0), (0, 2)]


def test_boxes_in_which_nothing_changed_are_not_looked_at_again() -> None:
    observed = Scene(("responder", "responder"), [LEFT, RIGHT], [two(RED, RED), two(RED, GREEN)]).observed()
    pixels = Asked(observed)
    appearances_of(observed, pixels)
    assert pixels.asked == [(0, 0), (1, 0), (1, 1)]


def test_what_reaches_in_does_not_change_the_look() -> None:
    """A neighbour's leaf hides a part of the lamp: that part keeps what it showed."""
    leaf = Patch((75, 40, 93, 70), BROWN, 1.3)
    scene = Scene(("responder", "responder"), [LEFT, RIGHT], [two(RED, RED), [*two(RED, RED), leaf], two(RED, RED)])
    assert len(set(looks(scene.observed()).of[:, 1])) == 1
    assert len(set(looks(scene.observed(), depth=False).of[:, 1])) == 2, "without depth it cannot be told"


def test_a_change_behind_what_reaches_in_is_seen_where_it_shows() -> None:
    leaf = Patch((75, 40, 93, 70), BROWN, 1.3)
    frames = [two(RED, RED), [*two(RED, RED), leaf], [*two(RED, GREEN), leaf], two(RED, GREEN)]
    found = looks(Scene(("responder", "responder"), [LEFT, RIGHT], frames).observed())
    shares = [float((found.looks[number].rgb[..., 1] == 200).mean()) for number in found.of[:, 1]]
    assert shares == pytest.approx([0, 0, 0.9, 1])


def test_the_board_is_no_part_of_an_object() -> None:
    inner = (30, 40, 45, 70)
    found = looks(Scene(("responder",), [LEFT], [[Patch(inner, RED)]]).observed())
    assert found.looks[0].own[:, :15].all() and not found.looks[0].own[:, 15:].any()


def test_triggers_and_objects_without_a_box_have_no_looks() -> None:
    frames = [two(RED, RED), two(GREEN, GREEN)]
    scene = Scene(("trigger", "responder", "responder"), [LEFT, RIGHT, (-1, -1, -1, -1)], frames)
    assert looks(scene.observed()).of.tolist() == [[-1, 0, -1], [-1, 1, -1]]
    assert (looks(observe_episode(make_real_episode())).of == -1).all()


@pytest.mark.parametrize("box", [(200, 40, 230, 70), (30, 130, 60, 140), (60, 40, 30, 70), (-5, 40, 60, 70)])
def test_a_box_that_is_none_shows_nothing(box: tuple[int, int, int, int]) -> None:
    """Beyond the picture of 160 x 120 pixels, turned round, or half out of it on the left."""
    scene = Scene(("responder", "responder"), [box, RIGHT], [two(RED, RED), two(RED, GREEN)])
    assert looks(scene.observed()).of.tolist() == [[-1, 0], [-1, 1]]


def test_a_box_that_reaches_beyond_the_picture_ends_with_it() -> None:
    found = looks(Scene(("responder",), [(130, 90, 190, 150)], [[Patch((130, 90, 160, 120), RED)]]).observed())
    assert found.looks[0].own.shape == (30, 30) and found.looks[0].own.all()


def test_the_oracle_sees_what_segmentation_names() -> None:
    episode = make_episode(steps=6)
    found, pixels = looks(observe_episode(episode)), OracleMasks(episode)
    for number, look in enumerate(appearances_of(observe_episode(episode), pixels).looks):
        np.testing.assert_array_equal(look.own.shape, found.looks[number].own.shape)
    index = int(observe_episode(episode).responders[0])
    segmentation = episode.image(3).segmentation
    assert segmentation is not None
    region = pixels.regions[index]
    np.testing.assert_array_equal(pixels.masks(index, 3)[0], segmentation[region.rows, region.columns] == index + 1)


def test_the_oracle_needs_a_segmentation() -> None:
    episode = make_episode(steps=2)
    for image in episode.images:
        image.segmentation = None
    with pytest.raises(BusybotError, match="no segmentation"):
        OracleMasks(episode).masks(int(observe_episode(episode).responders[0]), 0)
