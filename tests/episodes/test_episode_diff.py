"""What counts as equal, as close, and as different."""

from dataclasses import replace

import numpy as np
import pytest

from busybot.episodes.episode import Episode, Image
from busybot.episodes.episode_diff import compare_episodes, compare_images, rule_for
from tests.episodes.synthetic import make_episode, make_task_episode


def first_image() -> Image:
    return make_episode().images[0]


def brighter(image: Image, by: int, pixels: int) -> Image:
    rgb = image.rgb.copy()
    rgb.reshape(-1, 3)[:pixels, 1] += np.uint8(by)
    return replace(image, rgb=rgb)


@pytest.mark.parametrize(
    ("by", "pixels", "close"),
    [(2, 160 * 120, True), (3, 19, True), (3, 20, False), (200, 19, True)],
)
def test_close_pictures_have_at_most_a_thousandth_of_pixels_beyond_2(by: int, pixels: int, close: bool) -> None:
    image = first_image()
    image.rgb[image.rgb > 50] = 50  # room to become brighter
    difference = compare_images(image, brighter(image, by, pixels))
    assert not difference.equal and not difference.holds("equal")
    assert difference.holds("close") == close
    assert difference.colour == pytest.approx(pixels / (160 * 120) if by > 2 else 0)


def test_equal_pictures_are_equal_in_depth_links_and_boxes_too() -> None:
    image = first_image()
    assert compare_images(image, first_image()).equal
    assert image.depth is not None and image.segmentation is not None
    deeper = compare_images(image, replace(image, depth=image.depth + np.float32(2e-3)))
    assert (deeper.equal, deeper.depth, deeper.holds("close")) == (False, 1.0, False)
    little = compare_images(image, replace(image, depth=image.depth + np.float32(1e-4)))
    assert not little.equal and little.holds("close")
    assert compare_images(image, replace(image, segmentation=image.segmentation + 1)).links == 1.0
    assert not compare_images(image, replace(image, boxes=image.boxes + 1)).equal
    assert not compare_images(image, replace(image, depth=None)).holds("close")


def test_equal_episodes_have_no_difference() -> None:
    difference = compare_episodes(make_episode(), make_episode())
    assert difference.nothing and difference.frames == [] and difference.holds("equal")


def test_goals_are_compared_too() -> None:
    episode = make_task_episode()
    assert episode.goal is not None
    assert compare_episodes(episode, make_task_episode()).nothing
    for goals in ([], [brighter(episode.goal, 100, 160 * 120)]):
        difference = compare_episodes(episode, replace(episode, goals=goals))
        assert not difference.goal and difference.frames == [] and not difference.holds("close")


def changed(**values: object) -> Episode:
    episode = make_episode()
    episode.steps[2] = replace(episode.steps[2], **values)
    return episode


@pytest.mark.parametrize(
    ("values", "name"),
    [
        ({"direction": 17}, "action"),
        ({"pixel": (0, 0)}, "action"),
        ({"executed": (1, 2, 3)}, "action"),
        ({"trigger_states_after": (1, 1)}, "state"),
        ({"vetoed": True}, "state"),
        ({"joint_positions_after": ()}, "state"),
        ({"changed_pixels": 12345}, "reward"),
    ],
)
def test_the_first_differing_step_is_named(values: dict[str, object], name: str) -> None:
    episode = changed(**values)
    if name == "state" and "trigger_states_after" in values and episode.steps[2] == make_episode().steps[2]:
        pytest.skip("the board happens to be in these states")
    difference = compare_episodes(make_episode(), episode)
    assert getattr(difference, name) == 2
    others = {"action", "state", "reward"} - {name}
    assert all(getattr(difference, other) is None for other in others)
    assert difference.holds("close") == (name == "reward")
    assert not difference.holds("equal")


def test_joints_have_a_tolerance() -> None:
    joints = make_episode().steps[2].joint_positions_after
    for by, same in ((9e-6, True), (2e-5, False)):
        difference = compare_episodes(make_episode(), changed(joint_positions_after=(joints[0], joints[1] + by)))
        assert difference.joints == pytest.approx(by) and difference.same_states == same
        assert not difference.nothing


def test_other_boards_lengths_and_sizes_differ() -> None:
    assert not compare_episodes(make_episode(0), make_episode(1)).board
    shorter = compare_episodes(make_episode(), make_episode(steps=3))
    assert shorter.steps == (6, 3) and not shorter.same_states
    larger = compare_episodes(make_episode(), make_episode(width=320, height=240))
    assert not larger.scene and not larger.image.holds("close")


def test_only_one_renderer_and_codec_must_give_equal_pictures() -> None:
    episode = make_episode()
    assert rule_for(episode, make_episode()) == "equal"
    assert rule_for(episode, replace(make_episode(), renderer={"device": "another"})) == "close"
    assert rule_for(episode, replace(make_episode(), versions={"opencv-python": "6"})) == "close"
