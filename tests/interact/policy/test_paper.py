"""The paper's policy: affordance with a bonus, the direction network's best, and chance."""

import numpy as np
import pytest

from busybot.boards.directions import DIRECTIONS
from busybot.common.rng import generator
from busybot.interact.affordance.paper import PAPER_POLICY
from busybot.interact.policy.candidates import is_likely
from busybot.interact.policy.direction_pairs import PAIR_OF
from busybot.interact.policy.paper import PaperPolicy, PaperRules
from tests.interact.scenes import BODY, BUTTON, RAYS, ButtonModel, HeightView, picture

LARGE, KNOBS = (40, 30, 140, 110), ((60, 60, 66, 66), (100, 60, 106, 66))
BOARD = picture((LARGE, BODY), *((knob, BUTTON) for knob in KNOBS))


def rng(seed: int = 0) -> np.random.Generator:
    return generator(seed, "", 0, "test")


def on_knob(pixel: tuple[int, int]) -> int:
    """The knob that a pixel shows, -1 for none."""
    inside = [u0 <= pixel[0] < u1 and v0 <= pixel[1] < v1 for u0, v0, u1, v1 in KNOBS]
    return inside.index(True) if any(inside) else -1


def policy(**rules: float) -> PaperPolicy[HeightView]:
    return PaperPolicy(ButtonModel(), RAYS, PaperRules.model_validate(rules), "test")


def test_without_chance_it_takes_the_best_position_and_the_best_direction() -> None:
    action = policy().select_action(BOARD, rng())
    assert on_knob(action.pixel) >= 0
    assert len(action.directions) == 1 and abs(DIRECTIONS[action.directions[0], 2]) == 1


def test_the_bonus_leads_to_the_other_knob_and_without_it_nothing_does() -> None:
    for c, expected in ((0.5, {0, 1}), (0, {0})):
        agent, draws = policy(ucb_c=c), rng()
        assert {on_knob(agent.select_action(BOARD, draws).pixel) for _ in range(4)} == expected


def test_data_to_reason_from_are_a_draw_among_the_tops_of_clusters_with_their_best_direction() -> None:
    agent, draws = policy(ucb_c=0, clusters=2), rng()
    actions = [agent.select_action(BOARD, draws) for _ in range(40)]
    places = [action.pixel for action in actions]
    assert len(set(places)) == 2 and {on_knob(pixel) for pixel in places} == {0, 1}  # whatever was tried before
    assert min(places.count(pixel) for pixel in set(places)) > 10
    assert all(abs(DIRECTIONS[action.directions[0], 2]) == 1 for action in actions)


def test_clusters_are_of_what_lies_above_the_middle() -> None:
    """Of a picture whose highest affordance is low, too; not of what lies above a half."""
    belief = np.array([[0.0, 0.1, 0.25, 0.4]])
    assert is_likely(belief, "middle").tolist() == [[False, False, True, True]]
    assert not is_likely(belief, 0.5).any() and is_likely(belief, 0.2).sum() == 2
    assert PaperRules().cluster_belief == "middle" == PAPER_POLICY["cluster_belief"], "on the card of every paper model"


def test_where_no_place_is_likely_enough_for_a_cluster_the_best_is_taken() -> None:
    agent = policy(ucb_c=0, clusters=2, cluster_belief=1)
    assert on_knob(agent.select_action(BOARD, rng()).pixel) >= 0


def test_all_directions_are_tried_each_once() -> None:
    agent, draws = policy(all_directions=True), rng()
    first, second = (agent.select_action(BOARD, draws).directions for _ in range(2))
    assert sorted(first) == sorted(second) == list(range(18)) and first != second


def test_epsilon_is_the_share_of_chance() -> None:
    agent, draws = policy(epsilon_position=0.5, epsilon_direction=0.25, ucb_c=0), rng()
    actions = [agent.select_action(BOARD, draws) for _ in range(400)]
    assert np.mean([on_knob(action.pixel) < 0 for action in actions]) == pytest.approx(0.5, abs=0.08)
    z = PAIR_OF[np.abs(DIRECTIONS[:, 2]).argmax()]
    other = np.mean([PAIR_OF[action.directions[0]] != z for action in actions])
    assert other == pytest.approx(0.25 * 8 / 9, abs=0.06)


def test_chance_alone_needs_no_model_and_stays_on_objects() -> None:
    rules = PaperRules(epsilon_position=1, all_directions=True)
    assert not rules.needs_model()
    agent, draws = PaperPolicy(None, RAYS, rules, "test"), rng()
    for _ in range(50):
        column, row = agent.select_action(BOARD, draws).pixel
        assert LARGE[0] <= column < LARGE[2] and LARGE[1] <= row < LARGE[3]


def test_an_empty_board_is_acted_on_anyway() -> None:
    assert len(policy().select_action(picture(), rng()).directions) == 1
