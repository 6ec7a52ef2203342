"""Pictures of a camera that is not still, made comparable; those of one that is stay as they are."""

import warnings
from dataclasses import replace

import cv2
import numpy as np
import pytest

from busybot.common.errors import BusybotError
from busybot.episodes.episode import Image
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.inputs import trigger_views
from busybot.reason.inputs.object_masks import ObjectMasks
from busybot.reason.inputs.observation import NO_BOXES, ObservedEpisode
from busybot.reason.inputs.steady import Steady, _as_bright, steadied
from busybot.reason.inputs.trigger_links import LinkWatch
from busybot.reason.inputs.trigger_views import USUAL, _usual, median_of_seen
from tests.reason.inputs.test_trigger_links import MOVES, observe_links, played, pressed
from tests.reason.scenes import BOARD_DEPTH, Patch, Scene

LAMP = (60, 40, 90, 70)


def lamp_scene(colors: list[tuple[int, int, int]]) -> ObservedEpisode:
    """A lamp on a board with marks, as a still camera sees it."""
    marks = [
        Patch((10 * k, 7 * k % 100, 10 * k + 8, 7 * k % 100 + 9), (40 * k % 250, 90, 250 - 15 * k), 0)
        for k in range(1, 14)
    ]
    frames = [[*marks, Patch((50, 30, 100, 80), (150, 150, 150), 0), Patch(LAMP, color)] for color in colors]
    return Scene(("responder",), [LAMP], frames).observed()


def unsteady(observed: ObservedEpisode, shake: int = 3, seed: int = 0) -> ObservedEpisode:
    """The same seen by a camera that shakes, rustles and drifts."""
    rng, images = np.random.default_rng(seed), []
    for number, image in enumerate(observed.images):
        right, down = rng.integers(-shake, shake + 1, 2) if number else (0, 0)
        rgb, depth = (np.roll(one, (down, right), (0, 1)) for one in (image.rgb, image.depth))
        bright = rgb * (1 + 0.1 * np.sin(number)) + rng.normal(0, 5, rgb.shape)
        images.append(Image(bright.clip(0, 255).astype(np.uint8), depth, None, NO_BOXES))
    return replace(observed, images=images)


def test_pictures_of_a_still_camera_stay_as_they_are() -> None:
    observed = lamp_scene([(0, 0, 0), (250, 0, 250), (0, 0, 0)])
    assert steadied(observed) is observed and not Steady(observed).needed
    assert steadied(observed.first(1)) is not None


def test_looks_differ_by_what_the_board_does_and_not_by_what_the_camera_does() -> None:
    colors = [(0, 0, 0), (0, 0, 0), (250, 0, 250), (250, 0, 250), (0, 0, 0), (0, 0, 0)]
    seen = unsteady(lamp_scene(colors))
    assert Steady(seen).needed
    features = make_extractor("embedded").of(seen)[:, 0].astype(float)
    steps = np.linalg.norm(np.diff(features, axis=0), axis=-1)
    assert steps[[1, 3]].min() > 2 * steps[[0, 2, 4]].max()


@pytest.mark.parametrize("light", [0.6, 1.0, 1.5])
def test_a_picture_is_moved_back_under_any_exposure(light: float) -> None:
    """Bright and dark pictures differ everywhere, and still one of them lies where the other does."""
    observed, rng = lamp_scene([(250, 0, 250)] * 2), np.random.default_rng(0)
    size = observed.boxed.rgb.shape
    board = 0.3 * observed.boxed.rgb + 60 + cv2.GaussianBlur(rng.normal(0, 90, size), (0, 0), 2)
    seen = [np.roll(board, (-4, 6), (0, 1)) * light, board]
    images = [
        Image((one + rng.normal(0, 4, size)).clip(0, 255).astype(np.uint8), None, None, NO_BOXES)
        for one in reversed(seen)
    ]
    first, moved = (cv2.GaussianBlur(one.rgb, (0, 0), 1) for one in images)
    back = steadied(replace(observed, images=images)).frame(1).rgb
    middle = (slice(12, -12), slice(12, -12))
    alike = [np.corrcoef(one[middle].ravel(), first[middle].ravel())[0, 1] for one in (moved, back)]
    assert alike[0] < 0.8 < 0.95 < alike[1]


def test_a_window_keeps_the_picture_that_its_boxes_are_of() -> None:
    observed = lamp_scene([(0, 0, 0), (250, 0, 250), (9, 9, 9), (250, 0, 250)])
    window = observed.window(1, 2)
    assert len(window.actions) == 2 and len(window.image_of) == 3
    np.testing.assert_array_equal(window.boxed.rgb, observed.frame(0).rgb)
    np.testing.assert_array_equal(window.window(1, 1).frame(1).rgb, observed.frame(3).rgb)
    assert window.window(1, 1).boxed_in == window.boxed_in


@pytest.mark.parametrize("height", [1.5, None])
def test_a_hand_above_an_object_and_a_hole_in_the_depth_hide_it(height: float | None) -> None:
    observed = lamp_scene([(250, 0, 250)] * 2)
    depth = observed.images[1].depth
    assert depth is not None
    depth[40:55, 60:90] = 0 if height is None else BOARD_DEPTH - height
    own, hidden = ObjectMasks(observed).masks(0, 1)
    assert hidden[:15].all() and not hidden[15:].any() and not own[:15].any() and own[15:].all()


def hidden_at(observed: ObservedEpisode, frames: list[int]) -> ObservedEpisode:
    """A hand before the trigger in these frames."""
    images = list(observed.images)
    for number in frames:
        rgb, depth = images[number].rgb.copy(), np.array(images[number].depth)
        cv2.rectangle(rgb, (10, 0), (62, 70), (200, 150, 120), -1)
        depth[:71, 10:63] = BOARD_DEPTH - 2
        images[number] = Image(rgb, depth, None, NO_BOXES)
    return replace(observed, images=images)


def test_links_are_found_in_noise_and_a_hand_moves_none() -> None:
    observed, _ = played(MOVES)
    clear, noisy = observe_links(observed), observe_links(unsteady(observed, shake=0))
    assert noisy.steadied and not clear.steadied
    np.testing.assert_array_equal(noisy.states, clear.states)
    np.testing.assert_array_equal(noisy.clusters, clear.clusters)
    # after action 8, which moves nothing, nobody sees the trigger
    found = observe_links(hidden_at(unsteady(observed, shake=0), [9]))
    np.testing.assert_array_equal(found.states, clear.states)


def test_depth_shows_in_noise_what_colours_do_not_if_it_is_always_there() -> None:
    button = pressed()
    found = observe_links(unsteady(button, shake=0))
    assert found.steadied
    np.testing.assert_array_equal(found.states, observe_links(button).states)
    noisy = unsteady(button, shake=0)
    lost = [replace(image, depth=None) if number == 2 else image for number, image in enumerate(noisy.images)]
    assert not len(observe_links(replace(noisy, images=lost)).owners)


@pytest.mark.parametrize("lost", [None, 3])
def test_a_part_of_a_recording_shows_what_it_shows_alone(lost: int | None) -> None:
    """All pictures are looked at once, whatever part is asked about first; those without depth have none to tell."""
    whole = hidden_at(unsteady(played(MOVES)[0], shake=0), [9])
    images = [replace(one, depth=None) if number == lost else one for number, one in enumerate(whole.images)]
    whole = replace(whole, images=images)
    watches = LinkWatch(whole), LinkWatch(whole, steadied(whole))
    for steps in (len(MOVES), 2, 6):
        alone = LinkWatch(whole.first(steps + 1)).first(steps)
        for watch in watches:
            found = watch.first(steps)
            assert found.steadied and len(found.owners) == len(alone.owners)
            for name in ("clusters", "states", "owners", "places", "outlines"):
                np.testing.assert_array_equal(getattr(found, name), getattr(alone, name))


def test_noise_is_what_most_pictures_stay_within() -> None:
    """To the last bit what `nanquantile` tells, and none where nothing was seen."""
    rng = np.random.default_rng(0)
    away = rng.random((9, 5, 7, 2)).astype(np.float32)
    away[rng.random(away.shape) < 0.3] = np.nan
    away[:, 0, 0] = np.nan
    away[1:, 1, 1] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        expected = np.nan_to_num(np.nanquantile(away, USUAL, axis=0))
    np.testing.assert_array_equal(_usual(away), expected)
    assert not _usual(away)[0, 0].any() and _usual(away).dtype == np.float32


def test_what_is_too_bright_for_the_camera_does_not_darken_in_another_light() -> None:
    """A white switch on a board of which a brighter picture was taken looks white in the light of the first one; what
    covers it does not."""
    first = np.full((90, 120, 3), 120, np.uint8)
    first[30:60, 40:80] = 252
    brighter = np.minimum(first.astype(int) * 13 // 10, 255).astype(np.uint8)
    brighter[40:50, 50:60] = 60
    back = _as_bright(brighter, first)
    assert abs(back.astype(int)[:20] - 120).max() <= 2 and back[32:38, 42:78].min() >= 250
    assert back[42:48, 52:58].max() < 60


@pytest.mark.parametrize("pictures", [1, 2, 5, 30])
def test_the_median_of_what_was_seen_is_numpys(pictures: int) -> None:
    looks = np.random.default_rng(pictures).normal(size=(pictures, 9, 8, 4)).astype(np.float32)
    looks[np.random.default_rng(1).random(looks.shape[:3]) < 0.3] = np.nan
    looks[:, :2] = np.nan
    with pytest.warns(RuntimeWarning, match="All-NaN"):
        expected = np.nanmedian(looks, axis=0)
    told = median_of_seen(looks)
    assert told.dtype == expected.dtype and np.isnan(told[:2]).all()
    np.testing.assert_array_equal(told, expected)


def test_frames_without_end_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is kept of each frame is bounded, whatever a file says."""
    noisy = unsteady(played(MOVES)[0], shake=0)
    observe_links(noisy)
    monkeypatch.setattr(trigger_views, "MAX_WATCHED_PIXELS", 1000)
    with pytest.raises(BusybotError, match="frames before a camera that is not still.*at most 1,000"):
        observe_links(noisy)
