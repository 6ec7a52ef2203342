"""The truth beside every action: what the pixel showed, which link moved, and how far off the axis."""

from dataclasses import replace

import numpy as np
import pytest

from busybot.boards.directions import DIRECTIONS, annotated_directions
from busybot.episodes.episode import Episode, Step
from busybot.interact.evaluate import judge_episode, off_axis
from tests.episodes.synthetic import DELTA, make_episode

ALONG_X = {"Switch/s1": [[3.0, 0, 0]], "Switch/s2": [[3.0, 0, 0]]}


def direction(*vector: float) -> int:
    """The number of one of the 18 directions."""
    wanted = np.array(vector) / np.linalg.norm(vector)
    return int(np.flatnonzero(np.isclose(DIRECTIONS @ wanted, 1))[0])


@pytest.mark.parametrize(
    ("executed", "annotated", "off"),
    [
        ((1, 0, 0), [[2, 0, 0]], False),
        ((-1, 0, 0), [[2, 0, 0]], True),
        ((1, 0, 0), [[np.cos(0.5), np.sin(0.5), 0]], False),  # 29 degrees
        ((1, 0, 0), [[np.cos(0.55), np.sin(0.55), 0]], True),  # 32 degrees
        ((1, 1, 0), [[1, 0, 0], [0, 0, -1]], True),
        ((0, 0, -1), [[1, 0, 0], [0, 0, -1]], False),
        ((1, 0, 0), [], True),
    ],
)
def test_more_than_thirty_degrees_from_every_annotated_direction_is_off_the_axis(
    executed: tuple[float, ...], annotated: list[list[float]], off: bool
) -> None:
    assert off_axis(direction(*executed), annotated_directions(annotated, 0)) is off
    quarter = annotated_directions(annotated, np.pi / 2)
    assert off_axis(direction(-executed[1], executed[0], executed[2]), quarter) is off, "of an object that is turned"


def acting_on(episode: Episode, step: Step, code: int) -> Episode:
    """The episode with this step alone, at a pixel that shows what has this code in the segmentation."""
    segmentation = episode.image(0).segmentation
    assert segmentation is not None
    row, column = np.argwhere(segmentation == code)[0]
    return replace(episode, steps=[replace(step, pixel=(int(column), int(row)))], frame_of=[0, 1])


def test_what_the_chosen_pixel_showed_is_told_apart() -> None:
    episode = make_episode(0)
    still = replace(episode.links[0], trigger=False)
    cases = (
        (0, episode, "board", ""),
        (1, episode, "link", "Switch/s1"),
        (1, replace(episode, links=(still, *episode.links[1:])), "trigger", "Switch/s1"),  # a part that does not move
        (2, episode, "responder", "Lamp/l1"),
    )
    for code, shown, on, key in cases:
        action = judge_episode(acting_on(shown, episode.steps[2], code), ALONG_X, DELTA).actions[0]
        assert (action.on, action.key, action.success, action.off_axis) == (on, key, False, None)


def test_a_success_counts_for_its_link_and_has_an_axis() -> None:
    episode = make_episode(0)
    straight = tuple(one.model_copy(update={"yaw": 0.0}) for one in episode.board.objects)
    episode = replace(episode, board=episode.board.model_copy(update={"objects": straight}))
    moved = next(step for step in episode.steps if step.success)
    number = [0, 3].index(moved.acted_object)
    for executed, off in ((direction(1, 0, 0), False), (direction(0, 1, 0), True)):
        step = replace(moved, executed=(direction(0, 0, 1), executed))
        judged = judge_episode(acting_on(episode, step, 1), ALONG_X, DELTA)
        assert [link.key for link in judged.links] == ["Switch/s1", "Switch/s2"]
        assert all(link.pixels > 0 for link in judged.links)
        assert (judged.actions[0].link, judged.actions[0].success, judged.actions[0].off_axis) == (number, True, off)
    strict = judge_episode(acting_on(episode, moved, 1), ALONG_X, delta=10**6).actions[0]
    assert strict.success and not strict.reward, "the pixels' verdict stands beside the truth"
