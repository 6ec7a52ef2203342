"""Patches on a painted panel: which are found, and what is made of them as candidates."""

import numpy as np

from busybot.episodes.episode import Observation
from busybot.interact.policy.board_memory import BoardMemory, Failure
from busybot.interact.policy.candidates import PATCH, find_candidates
from busybot.interact.policy.colour_patches import LEAST, MOST, patches_of
from busybot.interact.policy.config import PolicyConfig
from tests.interact.scenes import BODY, RAYS, ButtonModel, picture

PANEL = (30, 20, 110, 90)
KEY, RIM, DOT, STRIPE = (46, 46, 52, 54), (60, 44, 72, 56), (42, 57, 45, 59), (54, 42, 56, 58)
INSIDE = (62, 46, 70, 54)


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
    seen = painted((KEY, 140), (RIM, 60), (INSIDE, 90), (DOT, 30), (STRIPE, 130))
    found = patches_of(seen.rgb, np.array([PANEL]), elevated(seen))
    assert LEAST > 6 and MOST < 80 * 70 - 500, "the dot is too small, and the panel too large"
    assert sorted(map(tuple, found.centres)) == [(48, 49), (54, 49), (65, 49)], (
        "key, stripe, and what the rim is around"
    )
    for number, (u, v) in enumerate(found.centres, start=1):
        assert found.labels[v, u] == number
    assert np.count_nonzero(found.labels) == 6 * 8 + 2 * 16 + 8 * 8


def test_a_shade_makes_no_patch_and_neither_does_what_nobody_can_hold() -> None:
    shaded = painted(*(((40 + 2 * k, 40, 42 + 2 * k, 60), 100 + 4 * k) for k in range(20)))
    assert not len(patches_of(shaded.rgb, np.array([PANEL]), elevated(shaded)).centres)
    seen = painted((KEY, 140))
    for boxes in ([[0, 0, 30, 30]], [[-1, -1, -1, -1]], np.zeros((0, 4), int)):
        assert not len(patches_of(seen.rgb, np.array(boxes), elevated(seen)).centres)
    beyond = np.array([[44, 44, 400, 300]])
    assert len(patches_of(seen.rgb, beyond, elevated(seen)).centres) == 1, "a box may reach out of the picture"


def test_a_key_that_only_colours_show_is_a_candidate_and_a_failure_beside_it_tells_nothing_of_it() -> None:
    seen, model, boxes = painted((KEY, 140)), ButtonModel(), np.array([PANEL])
    assert not len(find_candidates(model, seen, RAYS))
    found = find_candidates(model, seen, RAYS, triggers=boxes)
    [key] = found.pixels.tolist()
    assert KEY[0] <= key[0] < KEY[2] and KEY[1] <= key[1] < KEY[3] and (found.regions < 0).all()

    def belief(*failed: tuple[int, int]) -> float:
        memory = BoardMemory(RAYS.heights(seen.depth), PolicyConfig())
        for pixel in failed:
            memory.failed(Failure(pixel, dict.fromkeys(range(9), 0.9), weight=0.0))
        found = find_candidates(model, seen, RAYS, memory, triggers=boxes)
        return float(found.beliefs[(found.pixels == key).all(axis=1)][0])

    beside, on = (KEY[2] + 1, key[1]), (KEY[2] - 1, key[1])
    assert belief() == belief(beside) > 100 * belief(on) > 0
    logit = np.log(belief() / (1 - belief()))
    off = painted((KEY, 100))
    memory = BoardMemory(RAYS.heights(off.depth), PolicyConfig())
    within = np.zeros(off.depth.shape, bool)
    within[key[1], key[0]] = True
    [plain] = find_candidates(model, off, RAYS, memory, within=within).beliefs
    assert np.isclose(logit - np.log(plain / (1 - plain)), PATCH)
