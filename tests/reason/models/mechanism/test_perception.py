"""What an action does to a link, by what the seen ones did."""

from dataclasses import replace

import numpy as np

from busybot.episodes.episode import Camera
from busybot.reason.inputs.trigger_links import ObservedLinks, directions_of
from busybot.reason.models.mechanism.contexts import Trace
from busybot.reason.models.mechanism.perception import Perceived

UP, DOWN, ASIDE = (0.0, 0, 1), (0.0, 0, -1), (1.0, 0, 0)
Push = tuple[float, tuple[float, float, float], int]
"""Where along x, in which direction, and on which link."""


def seen(states: list[tuple[int, ...]], pushes: list[Push], sizes: tuple[int, ...]) -> Perceived:
    """Object 0 has these links, which stood so before and after these actions on it."""
    links = np.array(states)
    actions = np.array([(place, 0, 0, *way) for place, way, _ in pushes])
    clusters = np.array([link for *_, link in pushes])
    count = links.shape[1]
    directions = tuple(
        directions_of(actions[:, 3:], links[:, link], np.flatnonzero(clusters == link)) for link in range(count)
    )
    known = ObservedLinks(clusters, links, np.zeros(count, int), np.zeros((count, 2)), directions)
    trace = Trace(links, np.zeros((len(links), 1), int), sizes)
    looks = (np.zeros((1, 256), np.float32),)
    return Perceived(trace, known, np.array([1]), looks, actions, np.zeros(len(actions), int))


def moved(
    perceived: Perceived, state: int, place: float, way: tuple[float, float, float], shown: int | None = None
) -> int:
    action = np.array([place, 0, 0, *way])
    return int(perceived.moved(np.array([state]), action, 0, None if shown is None else np.array([shown]))[0])


def test_a_rocker_goes_where_it_is_pressed() -> None:
    """Three states; it is pressed down at either end."""
    rocker = seen(
        [(0,), (1,), (2,), (1,), (0,)],
        [(0.05, DOWN, 0), (0.05, DOWN, 0), (-0.05, DOWN, 0), (-0.05, DOWN, 0)], (3,),
    )  # fmt: skip
    assert [moved(rocker, 1, place, DOWN) for place in (0.04, -0.04)] == [2, 0]


def test_a_way_that_was_not_gone_is_the_other_way_back() -> None:
    slider = seen([(0,), (1,), (2,)], [(0.0, UP, 0), (0.0, UP, 0)], (3,))
    assert [moved(slider, 1, 0.0, way) for way in (UP, DOWN)] == [2, 0]


def test_what_failed_fails_again() -> None:
    """Pushed aside, the button stayed where it was; so nothing is expected of that, unless it is known to have worked.
    Of the other state nothing like it was seen."""
    button = seen([(0,), (0,), (1,), (0,)], [(0.0, ASIDE, 0), (0.0, DOWN, 0), (0.0, UP, 0)], (2,))
    assert moved(button, 0, 0.0, ASIDE, shown=0) == 0
    assert moved(button, 0, 0.0, ASIDE) == 1
    assert moved(button, 1, 0.0, ASIDE, shown=0) == 0
    assert moved(button, 0, 0.01, DOWN, shown=0) == 1


def test_a_link_is_held_as_long_as_a_responder_shows_the_same() -> None:
    pushes: list[Push] = [(0.0, DOWN, 0), (0.0, DOWN, 0), (0.0, UP, 0), (0.0, DOWN, 0)]
    held = seen([(0,), (0,), (1,), (0,), (0,)], pushes, (2,))
    held = replace(held, trace=replace(held.trace, responders=np.array([[0], [1], [1], [0], [0]])))
    assert [moved(held, 0, 0.0, DOWN, shown=shown) for shown in (0, 1)] == [0, 1]


def pushed(perceived: Perceived, state: int, way: tuple[float, float, float]) -> int:
    action = np.array([0.0, 0, 0, *way])
    return int(perceived.moved(np.array([state]), action, 0, np.array([0]), beyond=True)[0])


def test_the_opposite_of_what_was_done_in_the_middle_leads_the_other_way() -> None:
    lever = seen([(0,), (1,), (2,), (1,)], [(0.0, UP, 0), (0.0, UP, 0), (0.0, DOWN, 0)], (3,))
    assert [moved(lever, 1, 0.0, way) for way in (UP, DOWN)] == [2, 0]
    turned = seen([(0,), (1,), (2,), (1,)], [(0.0, ASIDE, 0), (0.0, UP, 0), (0.0, UP, 0)], (3,))
    assert moved(turned, 1, 0.0, DOWN) == 0


def test_a_link_may_go_on_to_a_state_that_nobody_has_seen_and_comes_back_from_there() -> None:
    """Pushed down where pushing up led to the other state; but not where both ways led there, or none did."""
    lever = seen([(0,), (1,), (0,)], [(0.0, UP, 0), (0.0, DOWN, 0)], (2,))
    assert [pushed(lever, 0, way) for way in (UP, DOWN, ASIDE)] == [1, -1, 1]
    assert [pushed(lever, 1, way) for way in (UP, DOWN)] == [2, 0]
    assert [pushed(lever, beyond, way) for beyond in (-1, 2) for way in (UP, ASIDE)] == [0, 0, 1, 1]
    assert moved(lever, 0, 0.0, DOWN, shown=0) == 1
    button = seen([(0,), (1,), (0,), (1,)], [(0.0, UP, 0), (0.0, DOWN, 0), (0.0, DOWN, 0)], (2,))
    assert [pushed(button, 0, way) for way in (UP, DOWN)] == [1, 1]
    whole = seen([(0,), (1,), (2,)], [(0.0, UP, 0), (0.0, UP, 0)], (3,))
    assert [pushed(whole, end, way) for end in (0, 2) for way in (UP, DOWN)] == [1, 1, 1, 1]


def test_it_is_pushed_on_away_from_the_only_other_state_that_was_seen() -> None:
    def on(perceived: Perceived, *ways: tuple[float, float, float]) -> list[int | None]:
        return [perceived.pushed_on(np.array([0.0, 0, 0, *way]), 0) for way in ways]

    once = seen([(0,), (1,)], [(0.0, UP, 0)], (2,))
    assert on(once, UP, DOWN, ASIDE) == [0, None, None]
    back = seen([(0,), (1,), (0,)], [(0.0, UP, 0), (0.0, DOWN, 0)], (2,))
    assert on(back, UP, DOWN) == [None, 0]
    assert on(seen([(0,), (1,), (2,)], [(0.0, UP, 0), (0.0, UP, 0)], (3,)), UP, DOWN) == [None, None]
    far = np.array([0.9, 0, 0, *UP])
    assert once.pushed_on(far, 0) is None and once.pushed_on(np.array([0.0, 0, 0, *UP]), 1) is None


def test_a_link_is_held_where_its_pixels_are() -> None:
    """The camera looks down; .1 board units are ten pixels."""
    pose = np.diag([1.0, -1, -1, 1])
    pose[2, 3] = 1
    camera = Camera(100, 100, np.array([[100.0, 0, 0], [0, 100, 0], [0, 0, 1]]), pose)
    panel = seen([(0, 0), (1, 0), (1, 1)], [(0.1, DOWN, 0), (0.16, DOWN, 1)], (2, 2))
    pixels = (np.array([[0, 0], [12, 5], [11, 1]]), np.array([[10, 0], [14, 0]]))
    shown = replace(panel, links=replace(panel.links, pixels=pixels, camera=camera))
    places = [(0.14, 0.0, 0.0), (0.12, -0.05, 0.0), (0.1, 0.0, 0.0), (0.3, 0.0, 0.0)]
    assert [shown.link_at(np.array(place), 0) for place in places] == [1, 0, 0, None]
    assert panel.link_at(np.array(places[1]), 0) == 0 and panel.link_at(np.array((0.12, 0.0, 0.0)), 0) == 0
    assert shown.link_at(np.array(places[0]), 1) is None


def test_the_link_is_that_of_the_nearest_action() -> None:
    """Link 0 is long and was taken hold of at both ends, link 1 beside one of them; at .05 there is nothing."""
    pushes: list[Push] = [(0.0, DOWN, 0), (0.3, UP, 0), (0.36, DOWN, 1), (0.05, DOWN, -1)]
    panel = seen([(0, 0), (1, 0), (0, 0), (0, 1), (0, 1)], pushes, (2, 2))
    found = [panel.link_at(np.array([place, 0, 0, *DOWN]), 0) for place in (0.01, 0.31, 0.35, 0.05, 0.9)]
    assert found == [0, 0, 1, None, None]
    assert panel.link_at(np.array([0.0, 0, 0, *DOWN]), 1) is None and panel.link_at(np.zeros(6), -1) is None


def test_a_slider_is_told_from_the_one_beside_it_aside_of_its_way() -> None:
    """Both move along x, 0.08 apart; what is held lies nearer to where the other one was held, which its place says."""
    sliders = seen([(0, 0), (1, 0), (1, 1)], [(0.0, (1.0, 0.0, 0.0), 0), (0.1, (1.0, 0.0, 0.0), 1)], (2, 2))
    sliders.actions[1, 1] = 0.08
    place = (0.09, 0.02, 0.0)
    assert [sliders.link_at(np.array([*place, *way]), 0) for way in ((1.0, 0.0, 0.0), DOWN)] == [0, 1]
    assert sliders.link_at(np.array(place), 0) == 1
