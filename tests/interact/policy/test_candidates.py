"""Candidates on boxes: one per button, with a place in space, a direction and a score."""

import numpy as np
import pytest

from busybot.boards.directions import DIRECTIONS
from busybot.episodes.episode import Observation
from busybot.interact.policy.board_memory import BoardMemory, Failure
from busybot.interact.policy.candidates import ASIDE, _peaks, find_candidates
from busybot.interact.policy.config import PolicyConfig
from busybot.interact.policy.direction_pairs import PAIR_OF, PAIRS, pair_scores
from tests.interact.scenes import BODY, BUTTON, PRESSED, RAYS, ButtonModel, picture

SWITCHES = (((40, 40, 80, 60), BODY), ((100, 80, 140, 100), BODY))
BUTTONS = [(45, 45, 53, 53), (60, 45, 68, 53), (110, 85, 118, 93)]
MODEL = ButtonModel()


def board(*heights: float) -> Observation:
    return picture(*SWITCHES, *zip(BUTTONS, heights, strict=True))


def button_at(pixel: np.ndarray) -> int:
    inside = [u0 <= pixel[0] < u1 and v0 <= pixel[1] < v1 for u0, v0, u1, v1 in BUTTONS]
    return inside.index(True) if any(inside) else -1


def test_every_button_is_a_region_with_a_candidate() -> None:
    found = find_candidates(MODEL, board(BUTTON, BUTTON, BUTTON), RAYS).best_of_regions()
    promising = found.take(found.scores > 0.5)
    assert sorted(button_at(pixel) for pixel in promising.pixels) == [0, 1, 2]
    assert (promising.regions < 0).all() and len(set(promising.regions)) == 3


def test_a_candidate_says_where_and_in_which_direction() -> None:
    found = find_candidates(MODEL, board(BUTTON, BUTTON, BUTTON), RAYS)
    best = int(found.scores.argmax())
    column, row = found.pixels[best]
    assert found.positions[best, 2] == pytest.approx(BUTTON, abs=1e-4)
    expected = RAYS.point(board(BUTTON, BUTTON, BUTTON).depth, (int(column), int(row)))
    assert np.allclose(found.positions[best], expected)
    assert abs(DIRECTIONS[found.best_directions[best], 2]) == 1
    assert found.scores[best] == pytest.approx(found.beliefs[best] * found.pairs[best].max())


def test_a_pair_fails_only_when_both_directions_do() -> None:
    assert len(PAIRS) == 9 and all(PAIR_OF[PAIRS] == np.arange(9))
    directions = np.zeros(18)
    directions[PAIRS[4]] = 0.5
    directions[np.flatnonzero(PAIR_OF == 4)[1]] = 0.5
    assert pair_scores(directions)[4] == 0.75 and pair_scores(directions).sum() == 0.75


def test_a_moved_link_is_a_region_of_its_own() -> None:
    before, after = board(BUTTON, BUTTON, BUTTON), board(PRESSED, BUTTON, BUTTON)
    memory = BoardMemory(RAYS.heights(before.depth), PolicyConfig())
    memory.succeeded((49, 49), 12, before, after)
    found = find_candidates(MODEL, after, RAYS, memory)
    for pixel, region in zip(found.pixels, found.regions, strict=True):
        assert (region == 1) == (button_at(pixel) == 0)


def test_where_something_moves_for_sure_there_are_candidates_though_the_model_sees_none_and_beside_failures() -> None:
    """Of two switches the model sees nothing on the second, whose button is pressed, and is wrong on the first's."""
    seen, within = board(BUTTON, BUTTON, PRESSED / 2), np.zeros(RAYS.directions.shape[:2], bool)
    second = (slice(80, 100), slice(100, 140))
    usual = find_candidates(MODEL, seen, RAYS)
    assert not any(100 <= u < 140 and 80 <= v < 100 for u, v in usual.pixels)
    within[second] = True
    found = find_candidates(MODEL, seen, RAYS, within=within)
    there = found.pixels[:, 1] >= 80
    assert there.sum() >= 1 and sorted(map(tuple, found.pixels[~there])) == sorted(map(tuple, usual.pixels))
    memory = BoardMemory(RAYS.heights(seen.depth), PolicyConfig())
    tried = found.pixels[there][0]
    memory.failed(Failure((int(tried[0]), int(tried[1])), {0: 0.5}))
    beside = find_candidates(MODEL, seen, RAYS, memory, within=within)
    away = np.hypot(*(beside.pixels[beside.pixels[:, 1] >= 80] - tried).T)
    assert sorted(away)[0] == 0 and (np.array(sorted(away)[1:]) > ASIDE).all() and len(away) > 1
    apart = np.abs(beside.pixels[:, None] - beside.pixels).max(axis=2) + 99 * np.eye(len(beside), dtype=int)
    assert apart.min() > PolicyConfig().peak_radius


def test_kmeans_candidates_are_the_tops_of_clusters() -> None:
    config = PolicyConfig(candidates="kmeans", clusters=3)
    found = find_candidates(MODEL, board(BUTTON, BUTTON, BUTTON), RAYS, config=config)
    assert sorted(button_at(pixel) for pixel in found.pixels) == [0, 1, 2]
    again = find_candidates(MODEL, board(BUTTON, BUTTON, BUTTON), RAYS, config=config)
    assert np.array_equal(found.pixels, again.pixels)


@pytest.mark.parametrize("kind", ["peaks", "kmeans"])
def test_an_empty_board_has_no_candidates(kind: str) -> None:
    config = PolicyConfig.model_validate({"candidates": kind})
    found = find_candidates(MODEL, picture(), RAYS, config=config)
    assert len(found) == len(found.best_of_regions()) == len(found.scores) == 0


def test_a_plateau_has_its_peak_in_the_middle_however_large_it_is() -> None:
    smooth = np.zeros((481, 641), np.float32)
    smooth[1:-1, 1:-1] = 1
    smooth[100, 40] = 2
    found = _peaks(smooth, smooth > 0, PolicyConfig())
    assert found[0].tolist() == [40, 100]
    assert len(found) == 2 and np.abs(found[1] - (320, 240)).max() <= 2  # a few pixels around the highest are missing
