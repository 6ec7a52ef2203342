"""Metrics of boards written by hand."""

import numpy as np
import pytest

from busybot.common.rng import generator
from busybot.interact import metrics as m

LINKS = (
    m.JudgedLink(object=0, key="Switch/a", link="link_0", pixels=40),
    m.JudgedLink(object=0, key="Switch/a", link="link_1", pixels=30),
    m.JudgedLink(object=2, key="Switch/b", link="link_0", pixels=8),
)


def action(on: m.Target, link: int = -1, success: bool = False, **changes: object) -> m.JudgedAction:
    """By default the pixels agree with the truth, and what works is along the annotated axis."""
    keys = {"link": "Switch/a", "trigger": "Switch/a", "responder": "Lamp/x", "board": ""}
    key = LINKS[link].key if link >= 0 else keys[on]
    values = {
        "pixel": (3, 4), "direction": 0, "executed": (0, 17), "on": on, "key": key, "link": link, "success": success,
        "reward": success, "changed_pixels": 900 * success, "off_axis": False if success else None, "vetoed": False,
    }  # fmt: skip
    return m.JudgedAction.model_validate(values | changes)


def board(*actions: m.JudgedAction) -> m.JudgedBoard:
    return m.JudgedBoard(board=0, links=LINKS, actions=actions)


# One link is moved twice, then a lamp is tried, then a link in a direction that does not move it.
FIRST = board(
    action("link", 0, True),
    action("link", 0, True, off_axis=True),
    action("responder"),
    action("link", 2, executed=(3, 14)),
)
# The pixels show something that the joints do not; the board itself is tried.
SECOND = board(action("trigger", reward=True, changed_pixels=700), action("board"), action("link", 1, True))


def test_precision_counts_every_proposed_action() -> None:
    assert m.micro([FIRST])["precision"] == 2 / 4
    assert m.micro([FIRST, SECOND])["precision"] == 3 / 7
    assert m.macro([FIRST, SECOND])["precision"] == pytest.approx((2 / 4 + 1 / 3) / 2)


def test_recall_counts_distinct_links_and_objects() -> None:
    assert m.micro([FIRST])["recall"] == 1 / 3
    assert m.micro([FIRST])["recall_objects"] == 1 / 2
    assert m.micro([board(action("link", 0, True), action("link", 1, True))])["recall"] == 2 / 3


def test_repeating_a_known_link_is_not_exploring() -> None:
    assert m.micro([FIRST])["precision_exploring"] == 1 / 3  # the second action repeats
    failed_then_moved = board(action("link", 0), action("link", 0, True), action("link", 0))
    assert m.micro([failed_then_moved])["precision_exploring"] == 1 / 2


def test_what_the_pixels_say_stands_beside_the_truth() -> None:
    values = m.micro([SECOND])
    assert values["precision_reward"] == 2 / 3 and values["reward_agreement"] == 2 / 3


def test_successes_off_the_annotated_axes() -> None:
    assert m.micro([FIRST])["off_axis_share"] == 1 / 2
    assert m.micro([board(action("board"))])["off_axis_share"] is None


def test_causes_and_places_of_failures() -> None:
    vetoed = board(action("link", 1, vetoed=True, executed=()))
    assert m.failures_by_cause([FIRST, SECOND, vetoed]) == {
        "direction": 1,
        "direction vetoed": 1,
        "position: trigger body": 1,
        "position: responder": 1,
        "position: board": 1,
    }
    by_object = m.failures_by_object([FIRST, SECOND])
    assert by_object["Switch/b"] == {"position": 0, "direction": 1, "actions": 1}
    assert by_object["Lamp/x"] == {"position": 1, "direction": 0, "actions": 1}
    assert by_object["Switch/a"] == {"position": 1, "direction": 0, "actions": 4}


def test_missed_links_by_object() -> None:
    missed = m.missed_links([FIRST, SECOND])
    assert missed["Switch/b/link_0"] == {"missed": 2, "boards": 2, "fewest_pixels": 8}
    assert missed["Switch/a/link_0"] == {"missed": 1, "boards": 2, "fewest_pixels": 40}


def test_precision_and_recall_along_the_way() -> None:
    rows = m.by_step([FIRST, SECOND])
    assert [row["precision"] for row in rows] == [1 / 2, 1 / 2, 1 / 2, 0]
    assert [row["recall"] for row in rows] == [1 / 6, 1 / 6, 2 / 6, 2 / 6]


def test_what_was_counted_on_each_board() -> None:
    told = m.by_board([FIRST, SECOND])
    assert told.keys() == set(m.OVER_BOARDS)
    for name, (part, whole) in m.counts([FIRST, SECOND]).items():
        if name in told:
            assert (sum(told[name]["part"]), sum(told[name]["whole"])) == (part, whole)
    assert told["recall"] == {"part": [len(FIRST.moved()), len(SECOND.moved())], "whole": [3, 3]}
    assert m.by_board([])["precision"] == {"part": [], "whole": []}


def test_intervals_hold_the_value_and_shrink_with_more_boards() -> None:
    few, many = [FIRST, SECOND] * 5, [FIRST, SECOND] * 200
    for boards in (few, many):
        low, high = m.intervals(boards, generator(0, "", 0, "test"))["precision"] or (1, 0)
        assert low <= 3 / 7 <= high
    found = [m.intervals(boards, generator(0, "", 0, "test"))["precision"] for boards in (few, many)]
    spans = [np.ptp(interval or (0, 0)) for interval in found]
    assert spans[1] < spans[0] / 3
    assert m.intervals(few, generator(1, "", 0, "a")) == m.intervals(few, generator(1, "", 0, "a"))


def test_intervals_over_objects_are_as_wide_as_objects_are_few() -> None:
    """One of two switches never moves: among other switches none might, or all."""
    links, outcomes = (LINKS[0], LINKS[2]), (action("link", 0, True), action("link", 2))
    boards = [m.JudgedBoard(board=number, links=links, actions=outcomes) for number in range(100)]
    rng = generator(0, "", 0, "test")
    assert m.object_intervals(boards, rng) == dict.fromkeys(m.OVER_OBJECTS, (0, 1))
    assert m.intervals(boards, rng)["precision"] == (0.5, 0.5), "boards are all alike"
    works = [one.model_copy(update={"actions": outcomes[:1], "links": links[:1]}) for one in boards]
    assert m.object_intervals(works, rng)["precision"] == pytest.approx((0.025, 1)), "one object is one trial"
    assert m.object_intervals([], rng) == dict.fromkeys(m.OVER_OBJECTS)


def test_failures_on_the_board_itself_belong_to_no_object() -> None:
    boards = [m.JudgedBoard(board=number, links=LINKS, actions=(action("board"),) * 2) for number in range(10)]
    assert m.object_intervals(boards, generator(0, "", 0, "test"))["precision"] == pytest.approx((0, 0.308), abs=1e-3)


def test_nothing_has_no_metrics() -> None:
    assert m.micro([]) == m.macro([]) == dict.fromkeys(m.SHARES)
    assert m.intervals([], generator(0, "", 0, "test")) == dict.fromkeys(m.SHARES)
    assert m.by_step([]) == []
