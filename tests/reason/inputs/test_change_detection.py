"""Whether an object looks different: its own pixels count, what reaches into its box does not."""

import cv2
import numpy as np
import pytest

from busybot.episodes.codec import decode_rgb, encode_rgb
from busybot.episodes.episode import Image
from busybot.reason.inputs.object_masks import ChangeConfig, changes, count_pixels
from busybot.reason.inputs.observation import NO_BOXES, observe_episode
from tests.episodes.synthetic import make_episode, make_real_episode
from tests.reason.scenes import Patch, Scene

RED, GREEN, BROWN = (200, 20, 20), (20, 200, 20), (90, 60, 30)
LEFT, RIGHT = (30, 40, 60, 70), (90, 40, 120, 70)
ROLES = ("responder", "responder")


def two_lamps(*colors: tuple[tuple[int, int, int], tuple[int, int, int]]) -> Scene:
    return Scene(ROLES, [LEFT, RIGHT], [[Patch(LEFT, left), Patch(RIGHT, right)] for left, right in colors])


@pytest.mark.parametrize("depth", [True, False])
def test_a_lamp_that_changes_colour_changes(depth: bool) -> None:
    scene = two_lamps((RED, RED), (GREEN, RED), (GREEN, RED), (GREEN, GREEN))
    observed = (scene if depth else scene.without_depth()).observed()
    assert changes(observed).tolist() == [[True, False], [False, False], [False, True]]
    assert count_pixels(observed, ChangeConfig())[0][0].tolist() == [900, 0]
    assert count_pixels(observed, ChangeConfig())[1].tolist() == [900, 900]


def test_colours_within_the_tolerance_are_equal() -> None:
    observed = two_lamps((RED, RED), ((210, 20, 20), (211, 20, 20))).observed()
    assert changes(observed).tolist() == [[False, True]]
    assert not changes(observed, ChangeConfig(tolerance=11)).any()


def test_a_small_part_that_moves_is_enough_noise_is_not() -> None:
    track = (20, 20, 80, 60)
    frames = [[Patch(track, BROWN), Patch((u, 30, u + 10, 50), RED, 0.3)] for u in (30, 45)]
    frames.append([*frames[1], Patch((70, 22, 79, 30), GREEN, 0.25)])
    observed = Scene(("responder",), [track], frames).observed()
    assert count_pixels(observed, ChangeConfig())[0][:, 0].tolist() == [400, 72]
    assert changes(observed)[:, 0].tolist() == [True, False]


def test_a_door_leaf_that_leaves_its_box_is_a_change_of_the_door_alone() -> None:
    """The leaf opens to the right and hides the neighbour's edge: it is so high that the camera sees it there."""
    closed = [Patch(LEFT, BROWN, 0.2), Patch(RIGHT, RED)]
    leaf = Patch((58, 40, 92, 70), BROWN, 1.3)
    opened = [Patch(LEFT, (10, 10, 10), 0.05), Patch(RIGHT, RED), leaf]
    scene = Scene(ROLES, [LEFT, RIGHT], [closed, opened, closed])
    assert changes(scene.observed()).tolist() == [[True, False], [True, False]]
    assert changes(scene.without_depth().observed()).all(), "without depth it cannot be told"


def test_a_lever_that_reaches_into_a_box_does_not_change_it() -> None:
    trigger = (60, 40, 80, 70)
    still = [Patch(LEFT, RED), Patch(trigger, BROWN)]
    reaching = [*still, Patch((55, 45, 75, 60), GREEN, 1.2)]
    scene = Scene(("responder", "trigger"), [LEFT, trigger], [still, reaching, still])
    assert count_pixels(scene.observed(), ChangeConfig())[0][:, 1].all()
    assert not changes(scene.observed())[:, 0].any()
    assert changes(scene.without_depth().observed())[:, 0].all(), "without depth it cannot be told"


def test_an_object_behind_a_tall_lamp_changes_by_itself() -> None:
    """The lamp's cord leans over the door in the picture, so that its box holds all of the door's."""
    door, bulb, lamp_box = (120, 64, 136, 78), (90, 62, 114, 84), (90, 62, 138, 84)
    sections = ((114, 119, 0.6), (119, 125, 1.1), (125, 132, 1.5), (132, 138, 1.75))
    cord = [Patch((u0, 76, u1, 79), BROWN, height) for u0, u1, height in sections]
    closed, opened = Patch(door, RED), Patch(door, (10, 10, 10), 0.15)
    frames = [[shown, Patch(bulb, color), *cord] for shown, color in ((closed, RED), (opened, RED), (opened, GREEN))]
    observed = Scene(ROLES, [door, lamp_box], frames).observed()
    assert changes(observed).tolist() == [[True, False], [False, True]]


def test_the_board_and_things_that_nobody_owns_do_not_count() -> None:
    box = (30, 40, 60, 70)
    inner = (30, 40, 45, 70)
    frames = [[Patch(inner, RED)], [Patch(inner, RED), Patch((50, 40, 60, 70), GREEN, 0.0)]]
    assert not changes(Scene(("responder",), [box], frames).observed()).any()


def test_a_flat_object_is_told_by_its_box() -> None:
    frames = [[Patch(LEFT, RED, 0.0)], [Patch(LEFT, GREEN, 0.0)]]
    assert changes(Scene(("responder",), [LEFT], frames).observed()).all()


def test_an_object_that_does_not_show_never_changes() -> None:
    scene = Scene(ROLES, [LEFT, (-1, -1, -1, -1)], [[Patch(LEFT, RED)], [Patch(LEFT, GREEN)]])
    assert changes(scene.observed()).tolist() == [[True, False]]


def test_a_recording_without_boxes_and_depth_shows_no_changes() -> None:
    assert not changes(observe_episode(make_real_episode())).any()


def test_no_steps_no_changes() -> None:
    assert changes(two_lamps((RED, RED)).observed()).shape == (0, 2)


def test_jpeg_of_the_default_quality_changes_nothing_else() -> None:
    """Beside a change, within a block of 8 x 8 pixels, JPEG disturbs what did not change."""
    scene = two_lamps((RED, RED), (GREEN, RED))
    left, right = (27, 40, 60, 70), (60, 40, 93, 70)
    frames = [[Patch(left, color), Patch(right, RED)] for color in (RED, GREEN)]
    observed = Scene(scene.roles, [left, right], frames).observed()
    jpeg = [
        Image(np.ascontiguousarray(decode_rgb(encode_rgb(image.rgb, "jpeg"), 160, 120)), image.depth, None, NO_BOXES)
        for image in observed.images
    ]
    assert cv2.absdiff(jpeg[0].rgb, jpeg[1].rgb)[40:70, 60:93].max() > 0, "the test disturbs nothing"
    object.__setattr__(observed, "images", jpeg)
    assert changes(observed).tolist() == [[True, False]]


def test_synthetic_episodes_change_where_they_say() -> None:
    episode = make_episode(steps=12)
    before, after = (
        np.array([getattr(s, f"responder_states_{when}") for s in episode.steps]) for when in ("before", "after")
    )
    responders = observe_episode(episode).responders
    np.testing.assert_array_equal(changes(observe_episode(episode))[:, responders], (before != after)[:, responders])
