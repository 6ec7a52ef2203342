"""What did not move: a link that is held, the more probably the more promised much and did not move."""

import numpy as np
import pytest

from busybot.plan.held_links import NONE_HELD, SAME, SHARES, HeldLinks


def after(*tries: tuple[float, bool | None]) -> HeldLinks:
    """Places that promised so much, each tried once, and whether something moved."""
    held = HeldLinks()
    for action, (promise, moved) in enumerate(tries):
        held.tried(action, (50 * action, 10), action, (promise, 1.0), moved)
    return held


def test_how_many_links_are_held_is_inferred_from_what_promised_much_and_did_not_move() -> None:
    assert after().share == pytest.approx((1 - NONE_HELD) * SHARES[1:].mean())
    few, many = after(*[(0.9, True)] * 8, (0.9, False)), after(*[(0.9, False)] * 6, *[(0.9, True)] * 3)
    assert few.share < 0.15 < 0.5 < many.share < 0.8
    assert after(*[(0.0, False)] * 6).share == pytest.approx(after().share), "where nothing was promised"
    assert after((0.9, None)).share == after().share, "nobody can tell"
    again = after(*[(0.9, False)] * 4)
    before = again.share
    for action in range(4):
        again.tried(4 + action, (50 * action, 10), action, (0.5, 0.01), True)
    assert again.share < 0.2 < 0.5 < before, "nothing had changed: they had been pushed wrongly"
    let_go = after(*[(0.9, False)] * 4)
    for action in range(4):
        let_go.tried(4 + action, (50 * action, 10), action, (0.01, 0.5), True)
    assert let_go.share > before
    assert 0 < after(*[(1.0, False)] * 60).share < 1, "nothing is quite sure"
    long = after(*[(1.0, False)] * 60)
    for action in range(3000):
        long.tried(60 + action, (50 * (action % 60), 10), action % 60, (1.0, 1.0), False)
    assert 0 < long.share < 1, "however long it takes"


def test_what_promised_much_is_held_rather_than_empty() -> None:
    held = after((0.95, False), (0.95, False), (0.05, False), (0.95, True))
    sure, _, unsure = (held.held(place) for place in held.places)
    assert sure > 0.85 > unsure and len(held.places) == 3
    assert unsure == pytest.approx(held.share, abs=0.02), "of what promised nothing, nothing is learned"
    assert after(*[(0.5, True)] * 20, (0.5, False)).held(held.places[0]) < 0.4, "on a board where nothing else is held"


def test_what_was_let_go_and_did_not_move_is_not_held() -> None:
    held = after((0.9, False), (0.9, False))
    before = held.held(held.places[0])
    for action, released, moved in ((2, 0.5, None), (3, 0.5, False), (4, 0.9, False)):
        held.tried(action, (SAME, 10), 0, (0.1, released), moved)
        told = held.held(held.places[0])
        assert told == before if moved is None else told < before
        before = told
    assert held.places[0].actions == [0, 2, 3, 4] and held.places[0].promised == 0.9


def test_a_place_is_on_one_trigger_and_reaches_a_little_way() -> None:
    held = after((0.9, False))
    assert held.at((SAME, 10 - SAME), 0) is held.places[0]
    assert held.at((SAME + 1, 10), 0) is None and held.at((0, 10), 1) is None
    held.tried(1, (3, 12), 0, (0.9, 0.5), True)
    assert held.places[0].moved and held.places[0].actions == [0]
    assert held.at((0, 10), 0) is None, "what is left beside a link that moved is another place"
    held.tried(2, (SAME + 2, 10), 1, (0.9, 0.5), False)
    held.tried(3, (2 * SAME + 4, 10), 1, (0.9, 0.5), False)
    assert held.at((SAME + 4, 10), 1) is held.places[1] and held.at((2 * SAME, 10), 1) is held.places[2]


def test_what_is_opened_counts_as_far_as_it_is_worth_the_actions() -> None:
    """After the first move one of two links is let go for sure, and the other one hardly; the second opens nothing."""
    held = after((0.9, False), (0.9, False), (0.9, False))
    there = held.held(held.places[0]) * 0.9
    told, worth, opened = np.array([0.1, 0.2]), np.array([3.0, 3.0]), np.array([[0.01, 1.0], [0.0, 0.0]])
    best = held.with_what_opens(told, np.array([0.5, 1.0]), worth, held.places[:2], opened)
    assert best == pytest.approx([(0.1 + 0.5 * 3 * there) / 2, 0.2])
    every = held.with_what_opens(told, np.ones(2), worth, held.places[:2], np.ones((2, 2)))
    assert every == pytest.approx((told + 2 * 3 * there) / 3)
    assert held.with_what_opens(told, np.ones(2), worth, [], opened) is told
