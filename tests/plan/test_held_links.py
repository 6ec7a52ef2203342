"""What did not move: a link that is held, the more probably the more promised much and did not move."""

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
