"""What the agent remembers: neighbouring buttons stay apart, failures count near by, what worked can be repeated."""

from dataclasses import replace

import numpy as np
import pytest

from busybot.boards.directions import DIRECTIONS
from busybot.episodes.episode import Observation
from busybot.interact.policy.board_memory import BoardMemory, Failure, moved_region
from busybot.interact.policy.config import PolicyConfig
from busybot.interact.policy.direction_pairs import PAIR_OF
from busybot.interact.policy.noisy_pictures import is_noisy
from tests.interact.scenes import BODY, BUTTON, PRESSED, RAYS, picture

CONFIG = PolicyConfig()
SWITCH = ((40, 40, 80, 60), BODY)
LEFT, RIGHT = (45, 45, 55, 55), (56, 45, 66, 55)
UP = int(np.flatnonzero(DIRECTIONS[:, 2] > 0.9)[0])


BODY_MASK = np.zeros((120, 160), bool)
BODY_MASK[40:60, 40:80] = True


def shown(left: float, right: float) -> Observation:
    return picture(SWITCH, (LEFT, left), (RIGHT, right))


BOTH_UP, LEFT_DOWN, BOTH_DOWN = shown(BUTTON, BUTTON), shown(PRESSED, BUTTON), shown(PRESSED, PRESSED)


def fresh(**changed: object) -> BoardMemory:
    return BoardMemory(RAYS.heights(BOTH_UP.depth), CONFIG.model_copy(update=changed))


def logits_of(memory: BoardMemory, *pixels: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    return memory.doubted(np.array(pixels), np.full(len(pixels), 2.0), np.full((len(pixels), 9), 0.5))


def test_the_region_is_what_moved_under_the_action() -> None:
    region = moved_region(BOTH_UP.depth, LEFT_DOWN.depth, (50, 50), BODY_MASK, CONFIG)
    assert region[45:55, 45:55].all() and region.sum() == 100


def test_motion_elsewhere_does_not_belong_to_the_link() -> None:
    after = shown(PRESSED, BUTTON).depth
    after[65:70, 50:55] -= 0.1  # another object within reach
    after[100:110, 50:60] -= 0.1  # a responder far away
    region = moved_region(BOTH_UP.depth, after, (50, 50), BODY_MASK, CONFIG)
    assert region.sum() == 100


def test_a_link_that_jumps_leaves_two_places_of_one_region() -> None:
    before, after = (picture(SWITCH, ((u, 45, u + 6, 55), BUTTON)).depth for u in (45, 65))
    region = moved_region(before, after, (47, 50), BODY_MASK, CONFIG)
    assert region[45:55, 45:51].all() and region[45:55, 65:71].all() and region.sum() == 120


def test_a_motion_without_visible_depth_leaves_a_small_region() -> None:
    region = moved_region(BOTH_UP.depth, BOTH_UP.depth, (50, 50), BODY_MASK, CONFIG)
    assert region[50, 50] and 5 <= region.sum() <= 25


def test_what_moves_where_an_action_took_hold_is_told_from_what_moves_elsewhere() -> None:
    assert fresh().moved_at((50, 50), BOTH_UP, LEFT_DOWN)
    assert not fresh().moved_at(
        (60, 50), BOTH_UP, picture(SWITCH, (LEFT, BUTTON), (RIGHT, BUTTON), ((100, 100, 110, 110), 0.1))
    )
    assert fresh().moved_at((50, 50), BOTH_UP, BOTH_UP) is False
    slightly = picture(SWITCH, (LEFT, BUTTON), (RIGHT, BUTTON), ((49, 49, 51, 51), PRESSED))
    assert not fresh().moved_at((50, 50), BOTH_UP, slightly), "four pixels"


def test_nobody_tells_moves_from_fraying_edges_before_a_noisy_camera() -> None:
    noisy = [replace(one, rgb=one.rgb.copy()) for one in (BOTH_UP, LEFT_DOWN)]
    for seed, one in enumerate(noisy):
        one.rgb[:] = np.clip(one.rgb + np.random.default_rng(seed).normal(0, 12, one.rgb.shape), 0, 255)
    assert is_noisy(noisy[0].rgb, noisy[1].rgb) and fresh().moved_at((50, 50), *noisy) is None


def test_neighbouring_buttons_are_two_links() -> None:
    memory = fresh()
    assert memory.succeeded((50, 50), UP, BOTH_UP, LEFT_DOWN) == 1
    assert memory.succeeded((56, 50), UP, LEFT_DOWN, BOTH_DOWN) == 2  # beside the first one's border
    assert (memory.links[45:55, 45:55] == 1).all() and (memory.links[45:55, 56:66] == 2).all()


def test_the_same_button_stays_one_link() -> None:
    memory = fresh()
    memory.succeeded((50, 50), UP, BOTH_UP, LEFT_DOWN)
    assert memory.succeeded((47, 47), UP, LEFT_DOWN, BOTH_UP) == 1
    assert memory.pairs == {1: int(PAIR_OF[UP])}


def test_a_failure_counts_most_where_it_was() -> None:
    memory = fresh()
    memory.failed(Failure((50, 50), {3: 0.9}))
    beliefs, pairs = logits_of(memory, (50, 50), (57, 50), (79, 41))
    assert beliefs[0] < beliefs[1] < beliefs[2] < 1 / (1 + np.exp(-2))
    assert pairs[0, 3] == 0 and 0 < pairs[1, 3] < 0.5 and pairs[2, 3] == 0.5


def test_where_a_pair_failed_others_are_believed_in_as_experience_says() -> None:
    gained = np.zeros((9, 9))
    gained[3, 0], gained[3, 1] = 2, -2
    memory = fresh(after_failure=tuple(map(tuple, gained.tolist())))
    memory.failed(Failure((50, 50), {3: 0.9}))
    _, pairs = logits_of(memory, (50, 50), (57, 50), (79, 41))
    assert pairs[0, :3] == pytest.approx(1 / (1 + np.exp([-2, 2, 0]))) and pairs[0, 3] == 0
    assert pairs[0, 0] > pairs[1, 0] > 0.5 == pairs[2, 0]


def test_a_sure_place_is_tried_again_and_an_unsure_one_is_left() -> None:
    memory = fresh()
    memory.failed(Failure((50, 50), {3: 0.9}))
    pixels, pairs = np.array([(50, 50), (50, 50)]), np.full((2, 9), 0.5)
    beliefs, _ = memory.doubted(pixels, np.array([5.0, 1.0]), pairs)
    assert beliefs[0] > 0.9 and beliefs[1] < 0.3


def test_a_failure_tells_less_of_other_places_and_ways_if_a_link_is_held_there() -> None:
    pixels, told, ways = ((50, 50), (79, 41)), [], []
    for held in (0.0, 0.5, 1.0):
        memory = fresh()
        memory.failed(Failure((50, 50), {3: 0.9}))
        memory.explain([held])
        beliefs, pairs = logits_of(memory, *pixels)
        told.append(beliefs)
        ways.append(pairs[0, 3])
    (here, never), (still, perhaps), (too, surely) = told
    assert here == still == too and never < perhaps < surely and ways == pytest.approx([0, 0.25, 0.5])
    assert surely == pytest.approx(1 / (1 + np.exp(-2))), "as if it had not been"


def test_where_an_action_failed_is_known_as_nearly_as_candidates_lie_apart() -> None:
    memory = fresh()
    memory.failed(Failure((50, 50), {3: 0.9}))
    assert memory.tried_here(np.array([(50, 51), (60, 50)])).tolist() == [True, False]


def test_a_later_success_explains_a_failure() -> None:
    memory = fresh()
    memory.failed(Failure((50, 50), {3: 0.9}))
    memory.succeeded((51, 51), UP, BOTH_UP, LEFT_DOWN)
    assert not memory.failures


def test_known_links_are_not_doubted_for_failures_elsewhere() -> None:
    memory = fresh()
    memory.succeeded((50, 50), UP, BOTH_UP, LEFT_DOWN)
    memory.failed(Failure((75, 57), {3: 0.9}))
    beliefs, pairs = logits_of(memory, (50, 50), (75, 42))
    assert beliefs[0] > 0.85 > 0.6 > beliefs[1]
    assert pairs[0, PAIR_OF[UP]] == CONFIG.known_pair


LAMP, BOX = (100, 40, 120, 60), (100, 80, 120, 100)
BESIDE = ((LAMP, BODY), (BOX, BODY))


def lit(left: float, box: tuple[int, int, int, int], level: int) -> Observation:
    """The switch with its left button, a lamp and a box, of which one shines."""
    image = picture(SWITCH, (LEFT, left), *BESIDE)
    u0, v0, u1, v1 = box
    image.rgb[v0:v1, u0:u1, 0] = level
    return image


def board() -> BoardMemory:
    return BoardMemory(RAYS.heights(lit(BUTTON, LAMP, 0).depth), CONFIG)


def test_what_changed_its_colour_by_an_action_elsewhere_is_hardly_a_trigger() -> None:
    memory = board()
    before, _ = logits_of(memory, (110, 50), (110, 90))
    memory.succeeded((50, 50), UP, lit(BUTTON, LAMP, 0), lit(PRESSED, LAMP, 200))
    lamp, box = logits_of(memory, (110, 50), (110, 90))[0]
    assert before[0] == before[1] == box
    assert lamp < 0.3 < box


@pytest.mark.parametrize(("box", "level"), [((100, 40, 110, 50), 200), (LAMP, 10)])
def test_few_pixels_and_small_differences_are_no_response(box: tuple[int, int, int, int], level: int) -> None:
    memory = board()
    memory.succeeded((50, 50), UP, lit(BUTTON, box, 0), lit(PRESSED, box, level))
    assert not memory.responders


def test_an_object_of_which_a_link_moved_is_a_trigger_whatever_it_looks_like() -> None:
    memory = board()
    memory.succeeded((50, 50), UP, lit(BUTTON, SWITCH[0], 0), lit(PRESSED, SWITCH[0], 200))
    assert not memory.responders
    memory.succeeded((110, 50), UP, lit(PRESSED, LAMP, 0), lit(PRESSED, LAMP, 200))
    memory.succeeded((50, 50), UP, lit(PRESSED, LAMP, 200), lit(BUTTON, LAMP, 0))
    assert not memory.responders


def test_a_trigger_is_likely_to_have_more_links_until_an_action_on_it_fails() -> None:
    memory = board()
    other_button, lamp = (61, 50), (110, 50)
    memory.succeeded((50, 50), UP, lit(BUTTON, LAMP, 0), lit(PRESSED, LAMP, 0))
    beliefs = logits_of(memory, other_button, lamp)[0]
    assert np.log(beliefs / (1 - beliefs)) == pytest.approx([2 + CONFIG.trigger_bonus, 2])
    memory.failed(Failure((42, 42), {3: 0.9}))  # too far away to say anything about the place itself
    less = CONFIG.failure_penalty + CONFIG.component_penalty
    beliefs = logits_of(memory, other_button, lamp)[0]
    assert np.log(beliefs / (1 - beliefs)) == pytest.approx([2 - less, 2 - CONFIG.failure_penalty], abs=1e-3)
