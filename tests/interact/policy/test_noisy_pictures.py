"""A camera that has noise, shakes and hangs in changing light: what moved is told from what the camera does."""

from itertools import pairwise

import numpy as np
import pytest

from busybot.episodes.episode import Image, Observation
from busybot.interact.policy.board_memory import BoardMemory
from busybot.interact.policy.config import PolicyConfig
from busybot.interact.policy.noisy_pictures import is_noisy, least_depth, looks_otherwise, settled_depth
from busybot.sim.scene.real_camera import REAL, CameraConfig, take_photo
from tests.interact.scenes import BODY, BUTTON, PRESSED, RAYS, picture

SWITCH, LEFT, RIGHT = ((40, 40, 80, 60), BODY), (42, 43, 56, 57), (62, 43, 76, 57)
LAMP, PASSIVE = ((100, 20, 130, 50), BODY), ((100, 80, 130, 110), BODY)
CALM = CameraConfig.model_validate({**REAL, "hand": 0})
CHANGE = PolicyConfig().change
UP = 0
FRAMES = range(1, 30)


def scene(left: float = BUTTON, lit: bool = False) -> Image:
    """A switch with two buttons, a lamp and something else, each with a texture."""
    seen = picture(SWITCH, (LEFT, left), (RIGHT, BUTTON), LAMP, PASSIVE)
    rgb = np.full(seen.rgb.shape, 150, np.uint8)
    for (u0, v0, u1, v1), level in ((SWITCH[0], 90), (LAMP[0], 60), (PASSIVE[0], 110)):
        rgb[v0:v1, u0:u1] = level + 20 * (np.indices((v1 - v0, u1 - u0)).sum(0)[..., None] // 6 % 2)
    if lit:
        rgb[20:50, 100:130] = (250, 240, 120)
    return Image(rgb, seen.depth, np.zeros(seen.depth.shape, np.uint16), np.full((1, 4), -1, np.int16))


def photo(image: Image, frame: int, camera: CameraConfig = CALM) -> Observation:
    taken = take_photo(image, camera, (3, "train", 0), frame)
    assert taken.depth is not None
    return Observation(taken.rgb, taken.depth, RAYS.camera)


def test_a_camera_that_repeats_itself_is_clean() -> None:
    assert not is_noisy(scene().rgb, scene(PRESSED, lit=True).rgb)
    assert not is_noisy(scene().rgb, photo(scene(), 1, CameraConfig(jpeg=90)).rgb), "compressed pictures, too"
    assert all(is_noisy(photo(scene(), frame).rgb, photo(scene(), frame + 1).rgb) for frame in FRAMES)


def test_nothing_has_moved_before_a_camera_that_shakes() -> None:
    for frame in FRAMES:
        before, after = photo(scene(), frame), photo(scene(), frame + 1)
        assert (before.depth != after.depth).mean() > 0.02
        assert (settled_depth(before.depth, after.depth, CHANGE, 0) != before.depth).mean() < 2e-3


def test_a_button_that_went_down_shows_where_it_was_and_nowhere_else() -> None:
    for frame in FRAMES:
        before, after = photo(scene(), frame), photo(scene(PRESSED), frame + 1)
        moved = settled_depth(before.depth, after.depth, CHANGE, 0) != before.depth
        u0, v0, u1, v1 = LEFT
        assert moved[v0:v1, u0:u1].mean() > 0.3
        moved[v0 - 4 : v1 + 4, u0 - 4 : u1 + 4] = False
        assert moved.mean() < 2e-3


@pytest.mark.parametrize("frame", FRAMES)
def test_a_lamp_responds_and_changing_light_does_not(frame: int) -> None:
    config = PolicyConfig()
    memory = BoardMemory(RAYS.heights(scene().depth), config.model_copy(update={"reach": 20}))
    memory.succeeded((49, 50), UP, photo(scene(), frame), photo(scene(PRESSED, lit=True), frame + 1))
    lamp, passive = memory._components[35, 115], memory._components[95, 115]
    assert memory.responders == {lamp} and passive not in memory.responders
    assert memory.links[50, 49] == 1 and memory.links[50, 69] == 0, "the other button is another link"


HANDS = CameraConfig.model_validate({**REAL, "hand": 0.25, "shadow": 0})  # in so small a picture one hides the other


def has_hand(seen: Observation) -> bool:
    return bool(seen.depth[seen.depth > 0].min() < 3.5)


def test_a_hand_that_comes_stays_and_goes_has_moved_nothing() -> None:
    nearest, passed = least_depth(scene().depth), set()
    for frame in range(1, 80):
        before, after = photo(scene(), frame, HANDS), photo(scene(), frame + 1, HANDS)
        hands = has_hand(before), has_hand(after)
        if any(hands):
            passed.add(hands)
            assert looks_otherwise(before, after, nearest).sum() < 50
            assert (settled_depth(before.depth, after.depth, CHANGE, nearest) != before.depth).mean() < 2e-3
    assert passed == {(True, False), (False, True), (True, True)}


def test_a_hand_is_told_from_what_was_seen_without_it() -> None:
    """Also where nobody says how near the board's objects are; one picture without the hand is enough."""
    frame = next(
        n for n in range(1, 80) if not has_hand(photo(scene(), n, HANDS)) and has_hand(photo(scene(), n + 1, HANDS))
    )
    pictures = [photo(scene(), frame + more, HANDS) for more in range(3)]
    memory = BoardMemory(RAYS.heights(scene().depth), PolicyConfig())
    for before, after in pairwise(pictures):
        memory.succeeded((49, 50), UP, before, after)
    assert not memory.responders


def test_a_faint_lamp_and_a_wide_shake_are_still_told_apart() -> None:
    bright = scene()
    bright.rgb[20:50, 100:130] += 45
    far = [pair for pair in ((n, n + 1) for n in FRAMES) if np.hypot(*np.subtract(*map(shake, pair))) > 3]
    assert len(far) > 2
    for one, other in far:
        before, after = photo(scene(), one), photo(bright, other)
        differs = looks_otherwise(before, after, 0)
        assert differs[22:48, 102:128].mean() > 0.5 and not differs[80:110, 100:130].any()
        assert (settled_depth(before.depth, after.depth, CHANGE, 0) != before.depth).mean() < 2e-3


def shake(frame: int) -> tuple[float, float]:
    """Rows and columns by which a photo lies beside the clean picture."""
    wide = CameraConfig(shake=REAL["shake"])
    depth = take_photo(scene(), wide, (3, "train", 0), frame).depth
    clean = scene().depth
    assert depth is not None and clean is not None
    rows, columns = (np.flatnonzero((one < 3.9).any(axis))[0] for one in (depth,) for axis in (1, 0))
    return rows - np.flatnonzero((clean < 3.9).any(1))[0], columns - np.flatnonzero((clean < 3.9).any(0))[0]


def test_a_board_without_edges_or_depth_has_not_shaken() -> None:
    flat, nothing = np.full((40, 60), 4, np.float32), np.zeros((40, 60), np.float32)
    assert np.array_equal(settled_depth(flat, flat, CHANGE, 0), flat)
    assert np.array_equal(settled_depth(nothing, flat, CHANGE, 0), nothing)
    assert np.array_equal(settled_depth(flat, nothing, CHANGE, 0), flat)
