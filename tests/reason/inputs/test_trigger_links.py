"""Links that pictures show: which there are, which action moved which, and how they stand."""

from dataclasses import replace

import numpy as np
import pytest

from busybot.episodes.episode import Image
from busybot.reason.inputs.observation import ObservedEpisode
from busybot.reason.inputs.trigger_links import LinkWatch, ObservedLinks, _Link, _together, _tries, _whole
from busybot.reason.inputs.trigger_views import Move, StillTriggers
from tests.reason.scenes import Patch, Scene

PLATE = Patch((20, 20, 60, 60), (200, 200, 200))
TWO = ((22, 22, 28, 32), (22, 34, 28, 44))
"""Where a lever with two states stands."""
THREE = ((40, 24, 48, 30), (40, 34, 48, 40), (40, 44, 48, 50))
CONTACTS = {"two": (0.1, 0.1, 0.0), "three": (0.6, 0.1, 0.0)}


def played(
    moves: list[str], contacts: dict[str, tuple[float, float, float]] = CONTACTS
) -> tuple[ObservedEpisode, np.ndarray]:
    """A plate with two levers; `two` or `three` moves one of them, with `-` it is only touched. True states beside."""
    states = [[0, 0]]
    up = True
    for move in moves:
        now = list(states[-1])
        if move == "two":
            now[0] = 1 - now[0]
        elif move == "three":
            up = now[1] == 0 or (up and now[1] < 2)
            now[1] += 1 if up else -1
        states.append(now)
    frames = [[PLATE, Patch(TWO[a], (200, 20, 20), 0.3), Patch(THREE[b], (20, 20, 200), 0.3)] for a, b in states]
    lamp = Patch((100, 60, 130, 90), (250, 250, 0))
    scene = Scene(
        ("trigger", "responder"), [(20, 20, 60, 60), (100, 60, 130, 90)], [[*one, lamp] for one in frames],
        pixels=[(25, 30) if "two" in move else (44, 35) for move in moves],
    )  # fmt: skip
    observed = scene.observed()
    actions = tuple(
        replace(one, position=contacts[move.strip("-")]) for one, move in zip(observed.actions, moves, strict=True)
    )
    return replace(observed, actions=actions), np.array(states)


def observe_links(observed: ObservedEpisode) -> ObservedLinks:
    return LinkWatch(observed).first(len(observed.actions))


MOVES = ["two", "three", "two", "three", "-two", "three", "three", "two", "-three", "three", "two", "two", "three"]


def test_moves_that_change_the_same_pixels_are_those_of_one_link() -> None:
    observed, states = played(MOVES)
    found = observe_links(observed)
    assert found.owners.tolist() == [0, 0] and found.sizes == (2, 3)
    two = int(found.clusters[0])
    assert found.clusters.tolist() == [two if "two" in move else 1 - two for move in MOVES]
    np.testing.assert_array_equal(found.states[:, two], states[:, 0])
    three = found.states[:, 1 - two]
    assert three.tolist() in (states[:, 1].tolist(), (2 - states[:, 1]).tolist()), "either end is the first"
    np.testing.assert_allclose(found.places[two], CONTACTS["two"][:2])
    for link, boxes in ((two, TWO), (1 - two, THREE)):
        shown = found.pixels[link]
        inside = [((shown >= box[:2]) & (shown < box[2:])).all(1) for box in boxes]
        assert len(shown) > 20 and np.any(inside, axis=0).all(), "(u, v) in the whole picture"


def test_two_links_side_by_side_are_two_and_a_long_one_is_one() -> None:
    """Pixels tell, however near or far they are taken hold of, where these are of one kind of move."""
    beside, _ = played(["two", "three", "-two"], CONTACTS | {"two": (0.57, 0.1, 0.0)})
    assert observe_links(beside).sizes == (2, 2)
    moves = ["three", "three", "three", "three"]
    observed, states = played(moves)
    ends = [(0.6, 0.1 + 0.2 * (high == 2), 0.0) for high in np.maximum(states[1:, 1], states[:-1, 1])]
    actions = [replace(one, position=end) for one, end in zip(observed.actions, ends, strict=True)]
    long = observe_links(replace(observed, actions=tuple(actions)))
    assert long.sizes == (3,) and long.clusters.tolist() == [0] * 4


@pytest.mark.parametrize(("shared", "apart", "links"), [(2, 0.0, 2), (4, 0.0, 1), (4, 0.1, 2), (9, 0.1, 1)], ids=str)
def test_a_link_with_three_states_is_held_at_one_place_in_the_middle(shared: int, apart: float, links: int) -> None:
    """Moves of 10 pixels each, so many of them in common; from the middle, one way so far beside the other."""
    low, high = np.arange(30) < 10, (np.arange(30) >= 10 - shared) & (np.arange(30) < 20 - shared)
    states = np.array([[0, 0], [1, 0], [1, 1], [1, 0], [0, 0]])
    found = [
        _Link(np.array(steps), states[:, k], one[None], one[None])
        for k, steps, one in ((0, [0, 3], low), (1, [1, 2], high))
    ]
    places = np.array([[0.0, 0.0], [0.0, apart], [0.5, 0.5], [0.0, 0.0]])
    whole = _whole(found, places)
    assert len(whole) == links and (links == 2 or whole[0].states.tolist() == [0, 1, 2, 1, 0])


def pressed(rng: np.random.Generator | None = None, lost: bool = False) -> ObservedEpisode:
    """A plate with two buttons of its colour, which are pressed in turn by four thousandths of a board unit.

    Args:
        rng: of the noise of depth, as much as a button moves.
        lost: the depth of one picture was not recorded, and lies in a hole in another.
    """
    states = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0], [1, 0], [1, 1]])
    buttons = ((22, 22, 28, 32), (40, 34, 48, 40))
    frames = [
        [PLATE, *(Patch(box, PLATE.color, 0.3 - 0.004 * int(up)) for box, up in zip(buttons, own, strict=True))]
        for own in states
    ]
    scene = Scene(("trigger",), [(20, 20, 60, 60)], frames, pixels=[(25, 30), (44, 36)] * 3)
    observed = scene.observed()
    images = list(observed.images)
    for number, image in enumerate(images):
        assert image.depth is not None
        noise = 0 if rng is None else rng.normal(0, 0.004, image.depth.shape).astype(np.float32)
        images[number] = replace(image, depth=image.depth + noise)
    if lost:
        images[5] = replace(images[5], depth=None)
        images[6].depth[30:50, 20:60] = 0
    places = [(0.1, 0.1, 0.0), (0.5, 0.3, 0.0)] * 3
    actions = [replace(one, position=place) for one, place in zip(observed.actions, places, strict=True)]
    return replace(observed, actions=tuple(actions), images=images)


def test_a_button_that_colours_do_not_show_is_seen_by_depth() -> None:
    found = observe_links(pressed())
    assert found.clusters.tolist() == [0, 1] * 3 and found.sizes == (2, 2)
    assert found.states.T.tolist() == [[0, 1, 1, 0, 0, 1, 1], [0, 0, 1, 1, 0, 0, 1]]
    images = [replace(image, depth=None) for image in pressed().images]
    assert not observe_links(replace(pressed(), images=images)).owners.size, "but not without depth"


def test_neither_lost_nor_noisy_depth_moves_anything() -> None:
    lost = observe_links(pressed(lost=True))
    assert lost.states[:, lost.clusters[0]].tolist() == [0, 1, 1, 0, 0, 0, 1], "seen when it is there again"
    views = StillTriggers(pressed(np.random.default_rng(0))).views
    assert not views[0].moves(np.arange(6)), "colours alone are looked at where depth does not rest"


def test_before_a_camera_that_is_not_still_places_tell_links_where_pixels_do_not() -> None:
    """Two moves that have few changed pixels in common are of one link where it was taken hold of at one place."""
    moves = []
    for step, change in enumerate(((1.0, 0.0), (0.2, 0.96))):
        difference = np.zeros((1, 2, 3), np.float32)
        difference[0, :, 0] = change
        moves.append(Move(step, difference.any(axis=-1), difference))
    near, far = np.zeros((2, 3)), np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])
    assert [len(_together(moves, contacts)) for contacts in (None, near, far)] == [2, 1, 2]


def test_before_such_a_camera_a_passing_shadow_makes_no_other_link() -> None:
    """The same two pixels, back; and a shadow on forty more, as dark."""
    moves = []
    for step, change in enumerate(([1, -1, *[0] * 40], [-1, 1, *[1] * 40])):
        difference = np.array(change, np.float32).reshape(1, 42, 1)
        moves.append(Move(step, difference.any(axis=-1), difference))
    assert [len(_together(moves, contacts)) for contacts in (None, np.array([[0, 0, 0], [0.05, 0, 0]]))] == [2, 1]


def test_an_action_that_changed_nothing_may_have_moved_the_link_that_it_was_nearest_to() -> None:
    """Of two links .1 apart; the action after them lies nearer to the second, the last one near to neither."""
    contacts = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.055, 0, 0], [0.3, 0, 0]])
    nothing = np.zeros((1, 1, 3), np.float32)
    groups = [[Move(step, nothing[..., 0] > 0, nothing)] for step in (0, 1)]
    assert [one.tolist() for one in _tries(groups, np.arange(4), contacts)] == [[0], [1, 2]]
    assert _tries([], np.arange(4), contacts) == []


def test_what_was_never_moved_is_no_link_and_nothing_is_known_before_the_first_action() -> None:
    observed, _ = played(["-two", "three", "three"])
    found = observe_links(observed)
    assert len(found.owners) == 1 and found.clusters[1:].tolist() == [0, 0]
    nothing = observe_links(observed.first(1))
    assert nothing.states.shape == (1, 0) and nothing.sizes == () and not len(nothing.clusters)


def test_a_responder_that_changes_moves_no_link() -> None:
    observed, _ = played(["two", "two"])
    frames = [image.rgb.copy() for image in observed.images]
    frames[1][60:90, 100:130] = 0
    changed = replace(observed, images=[replace(i, rgb=f) for i, f in zip(observed.images, frames, strict=True)])
    one, other = observe_links(observed), observe_links(changed)
    assert one.clusters.tolist() == other.clusters.tolist() and np.array_equal(one.states, other.states)


def test_what_was_watched_further_shows_of_the_first_actions_what_they_alone_show() -> None:
    observed, _ = played(MOVES)
    watch = LinkWatch(observed)
    for steps in (len(MOVES), *range(len(MOVES))):
        assert_alike(watch.first(steps), observe_links(observed.first(steps + 1)))


def test_who_watches_on_sees_what_is_seen_at_once_and_looks_at_no_picture_again() -> None:
    """Also where the camera turns out not to be still."""
    scene = played(MOVES)[0]
    stirred = [*scene.images[:4], *(replace(one, rgb=255 - one.rgb) for one in scene.images[4:])]
    for observed in (scene, replace(scene, images=stirred), pressed(), pressed(lost=True)):
        watch: LinkWatch | None = None
        for steps in range(len(observed.actions) + 1):
            part = observed.first(steps + 1)
            watch = LinkWatch(part, shorter=watch)
            assert_alike(watch.first(steps), observe_links(part))
            assert_alike(watch.first(steps // 2), observe_links(observed.first(steps // 2 + 1)))
        assert watch is not None


def test_what_is_asked_late_of_a_part_changes_nothing_for_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    observed, looks = played(MOVES)[0], list[int]()
    expected = {steps: observe_links(observed.first(steps + 1)) for steps in (1, 3, len(MOVES) - 1, len(MOVES))}
    look = StillTriggers._look

    def counted(self: StillTriggers, number: int, image: Image) -> None:
        looks.append(number)
        look(self, number, image)

    monkeypatch.setattr(StillTriggers, "_look", counted)
    first = LinkWatch(observed.first(2))
    first.first(1)
    second = LinkWatch(observed.first(4), shorter=first)
    whole = LinkWatch(observed, shorter=second)
    for watch, steps in ((whole, len(MOVES)), (second, 3), (whole, len(MOVES) - 1), (first, 1)):
        assert_alike(watch.first(steps), expected[steps])
    assert sorted(looks) == sorted(set(observed.image_of)), "each picture once"


def assert_alike(one: ObservedLinks, other: ObservedLinks) -> None:
    assert one.camera is other.camera
    for name, value in vars(one).items():
        told = getattr(other, name)
        if name != "camera":
            for own, alone in zip(value, told, strict=True) if isinstance(value, tuple) else [(value, told)]:
                np.testing.assert_array_equal(own, alone, err_msg=name)


def test_outlines_tell_where_in_its_box_a_link_is_and_how_large() -> None:
    observed, _ = played(MOVES)
    found = observe_links(observed)
    two = int(found.clusters[0])
    width, height, own_width, own_height, right, down = found.outlines[two] * observed.frame(0).rgb.shape[1]
    assert (width, height) == (40, 40) and own_width <= 6 and 15 <= own_height <= 22
    np.testing.assert_allclose([right, down], [25 - 40, 33 - 40], atol=1)
