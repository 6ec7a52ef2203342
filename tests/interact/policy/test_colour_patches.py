"""Patches on a painted panel: which are found, and what is made of them as candidates."""

import numpy as np
import pytest

from busybot.episodes.episode import Observation
from busybot.interact.policy.board_memory import BoardMemory, Failure
from busybot.interact.policy.candidates import find_candidates
from busybot.interact.policy.colour_patches import LEAST, MOST, SIDE, from_patches, on_patches, patches_of
from busybot.interact.policy.config import PolicyConfig
from busybot.interact.policy.direction_pairs import logit
from tests.interact.scenes import BODY, RAYS, ButtonModel, picture

PANEL = (30, 20, 110, 90)
KEY, RIM, DOT = (46, 46, 52, 54), (60, 44, 72, 56), (42, 57, 45, 59)
INSIDE, STRIPE, LINE = (62, 46, 70, 54), (54, 42, 57, 58), (76, 30, 78, 80)


def painted(*boxes: tuple[tuple[int, int, int, int], int]) -> Observation:
    """A flat panel in grey values; depth shows no keys."""
    seen = picture((PANEL, BODY))
    rgb = seen.rgb.copy()
    for (u0, v0, u1, v1), grey in ((PANEL, 100), *boxes):
        rgb[v0:v1, u0:u1] = grey
    return Observation(rgb, seen.depth, seen.camera)


def elevated(seen: Observation) -> np.ndarray:
    return np.asarray(seen.depth < 4)


def test_a_patch_is_small_solid_and_of_one_colour() -> None:
    seen = painted((KEY, 140), (RIM, 60), (INSIDE, 90), (DOT, 30), (STRIPE, 130), (LINE, 30))
    found = patches_of(seen.rgb, np.array([PANEL]), elevated(seen))
    assert LEAST > 6 and MOST < 80 * 70 - 500, "the dot is too small, and the panel too large"
    expected = [(48, 49), (55, 49), (65, 49)]  # key, stripe, and what the rim is around
    assert SIDE == 3 and sorted(map(tuple, found.centres)) == expected
    for number, (u, v) in enumerate(found.centres, start=1):
        assert found.labels[v, u] == number
    assert np.count_nonzero(found.labels) == 6 * 8 + 3 * 16 + 8 * 8


def test_a_shade_makes_no_patch_and_neither_does_what_nobody_can_hold() -> None:
    shaded = painted(*(((40 + 2 * k, 40, 42 + 2 * k, 60), 100 + 4 * k) for k in range(20)))
    assert not len(patches_of(shaded.rgb, np.array([PANEL]), elevated(shaded)).centres)
    seen = painted((KEY, 140))
    for boxes in ([[0, 0, 30, 30]], [[-1, -1, -1, -1]], np.zeros((0, 4), int)):
        assert not len(patches_of(seen.rgb, np.array(boxes), elevated(seen)).centres)
    beyond = np.array([[44, 44, 400, 300]])
    found = patches_of(seen.rgb, beyond, elevated(seen) & (np.arange(160) < 80)).centres
    assert len(found) == 1, "a box may reach out of the picture"
    halves = np.array([[30, 20, 49, 90], [45, 20, 110, 90]])
    assert len(patches_of(seen.rgb, halves, elevated(seen)).centres) == 1, "boxes that overlap share their patches"


def test_a_key_that_only_colours_show_is_a_candidate_and_a_failure_beside_it_speaks_of_other_places() -> None:
    seen, model, boxes = painted((KEY, 140)), ButtonModel(), np.array([PANEL])
    assert not len(find_candidates(model, seen, RAYS))
    found = find_candidates(model, seen, RAYS, triggers=boxes)
    [key] = found.pixels.tolist()
    assert KEY[0] <= key[0] < KEY[2] and KEY[1] <= key[1] < KEY[3] and (found.regions < 0).all()
    within = np.zeros(seen.depth.shape, bool)
    within[key[1], key[0]] = True

    def belief(*failed: tuple[int, int], patches: bool = True, weight: float = 0.2) -> float:
        """In the key, after failures that were expected to succeed as `weight` says."""
        memory = BoardMemory(RAYS.heights(seen.depth), PolicyConfig())
        for pixel in failed:
            memory.failed(Failure(pixel, dict.fromkeys(range(9), 0.9), weight=weight))
        on = boxes if patches else boxes[:0]
        found = find_candidates(model, seen, RAYS, memory, within=within, triggers=on)
        return float(found.beliefs[(found.pixels == key).all(axis=1)][0])

    beside, far, on = (KEY[2] + 1, key[1]), (100, 80), (KEY[2] - 1, key[1])
    assert belief(beside, weight=0.0) == belief() and belief(beside) == pytest.approx(belief(far), rel=1e-3)
    assert belief(on) < belief(far) / 100 < belief() / 100
    assert logit(belief()) == pytest.approx(on_patches(logit(belief(patches=False))))
    assert from_patches(on_patches(0.7)) == pytest.approx(0.7)


def test_the_middle_of_a_small_key_stays_a_candidate_however_near_something_else_failed() -> None:
    small = (46, 46, 50, 50)
    seen, memory = painted((small, 140)), BoardMemory(np.ones((120, 160), np.float32), PolicyConfig())
    memory.failed(Failure((small[2], 48), {0: 0.5}))
    everywhere = elevated(seen)
    found = find_candidates(ButtonModel(), seen, RAYS, memory, within=everywhere, triggers=np.array([PANEL])).pixels
    on = (found >= small[:2]).all(axis=1) & (found < small[2:]).all(axis=1)
    assert on.sum() == 1 and [small[2], 48] in found.tolist()
