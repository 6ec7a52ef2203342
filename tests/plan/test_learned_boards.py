"""What learned agents see, explored boards, and playing on them."""

from pathlib import Path

import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env

from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.plan.learning.board_graph import GoalEnv, PracticeRollout, load_explored, save_explored
from busybot.plan.learning.encoding import CHOICES, CONTACTS, OBJECTS, SHAPES, STOP, ObservationEncoder, offer, shuffled
from busybot.training.checkpoint import save_tensors
from tests.plan.practice import ACTIONS, explore_toy, toys
from tests.plan.toy import DOWN, UP, Link, World, two_buttons_and_a_lever


def test_the_history_tells_what_was_done_and_what_changed() -> None:
    world = two_buttons_and_a_lever()
    seen = ObservationEncoder(world.briefing(ACTIONS, [1, 0, 2])).history()
    assert {name: value.shape[1:] for name, value in seen.items()} == SHAPES
    assert len(seen["action"]) == len(ACTIONS) + 1
    assert not seen["action"][0].any() and seen["action"][1:, 6:].tolist() == [[1, 1]] * len(ACTIONS)
    changed = seen["objects"][:, :, 6] > 0.5
    assert [np.flatnonzero(row).tolist() for row in changed] == [[], [2], [3], [4], [2], [4]]
    assert seen["objects"][1:, :, 7].argmax(axis=1).tolist() == [0, 0, 1, 0, 1]
    assert (seen["objects"][0, :, 5] > 0.5).tolist() == [False, False, True, True, True] + [False] * 5
    assert (seen["allowed"].sum(axis=1) == 1).all() and seen["allowed"][:, STOP].all()


def test_an_action_that_failed_is_told_from_one_that_worked() -> None:
    world = World([Link(0, 1, (10, 10), dead=True)], 1, 1)
    seen = ObservationEncoder(world.briefing([(0, UP)], [1])).history()
    assert seen["action"][1, 6:].tolist() == [0, 1] and not (seen["objects"][1, :, 6] > 0).any()


def test_choices_are_candidates_in_two_directions_and_no_more_than_there_are_places() -> None:
    world = World([Link(0, 1, (10 + number, 10)) for number in range(CONTACTS + 3)], 1, 1)
    offered, choices = offer(tuple(world.contact(number) for number in range(len(world.links))))
    assert offered.count == CHOICES == 1 + len(choices)
    assert [direction for _, direction in choices[:2]] == [UP, DOWN]
    assert np.allclose(offered.facts[1, 6:], [0.81, 1]) and not offered.facts[STOP].any()
    assert offer(())[0].count == 1 and not offer(())[1]


def test_a_board_with_too_many_objects_is_refused() -> None:
    world = World([Link(0, 1, (10, 10))], 1, OBJECTS)
    with pytest.raises(BusybotError, match="11 objects"):
        ObservationEncoder(world.briefing([(0, UP)], [1]))


def test_in_another_order_objects_keep_what_belongs_to_them() -> None:
    seen = toys(1)[0].history
    order = generator(0, "", 0, "order").permutation(OBJECTS)
    mixed = shuffled(seen, order)
    for name in ("looks", "goal", "objects"):
        assert np.array_equal(mixed[name][:, 3], seen[name][:, order[3]])
    assert np.array_equal(mixed["touched"], seen["touched"][..., order])
    assert np.array_equal(mixed["choices"], seen["choices"])


def test_an_oracle_takes_a_shortest_way_and_stops_at_its_end() -> None:
    board = toys(1)[0]  # from states 0, 1, 1 to 1, 0, 2
    rollout, rng = PracticeRollout(board), generator(0, "", 0, "test")
    assert rollout.success == 0 and not rollout.right[STOP]
    for expected in (1 / 3, 2 / 3, 1):
        rollout.act(int(rng.choice(np.flatnonzero(rollout.right))))
        assert rollout.success == pytest.approx(expected)
    assert np.flatnonzero(rollout.right).tolist() == [STOP]
    rollout.act(STOP)
    assert rollout.over and rollout.steps == 3


def test_the_lever_is_moved_in_the_right_direction() -> None:
    board = toys(1)[0]
    right = board.graph.right[0]
    lever = [1 + 2 * 2, 2 + 2 * 2]  # up and down at the third candidate
    assert right[lever].tolist() == [True, False]
    assert right[1:5].all()  # two-state buttons move whichever direction comes first


def test_where_the_goal_is_out_of_reach_the_oracle_goes_as_near_as_it_can() -> None:
    stuck = World([Link(0, 2, (10, 10), dead=True), Link(1, 3, (90, 10))], 2, 2)
    rollout = PracticeRollout(explore_toy(stuck, [(1, UP)], [1, 1]))
    assert np.flatnonzero(rollout.right).tolist() == [3, 4]
    rollout.act(3)
    assert np.flatnonzero(rollout.right).tolist() == [STOP] and rollout.success == 0.5


def test_rollouts_end_after_eight_steps_and_at_what_is_no_choice() -> None:
    rollout = PracticeRollout(toys(1)[0])
    for _ in range(8):
        assert not rollout.over
        rollout.act(1)
    assert rollout.over and rollout.steps == 8
    other = PracticeRollout(toys(1)[0])
    other.act(CHOICES - 1)
    assert other.over and other.steps == 0


def test_explored_boards_are_stored_whole(tmp_path: Path) -> None:
    board, file = toys(1)[0], tmp_path / "board.safetensors"
    save_explored(file, board)
    again = load_explored(file)
    assert again.group == board.group and again.briefing.threshold == board.briefing.threshold
    for name, value in vars(board.graph).items():
        assert np.array_equal(getattr(again.graph, name), value), name
    for name, value in board.history.items():
        assert np.array_equal(again.history[name], value), name
    save_tensors(file, {"x": torch.zeros(1)}, {"group": 0})
    with pytest.raises(BusybotError, match=r"it is no explored board: KeyError.*\n.*explores the board again"):
        load_explored(file)
    save_explored(file, board)
    file.write_bytes(file.read_bytes()[:-9])
    with pytest.raises(BusybotError, match="damaged"):
        load_explored(file)


def test_the_environment_is_one() -> None:
    check_env(GoalEnv(toys(2), shuffle=True), skip_render_check=True)


def test_the_environment_shows_the_history_then_pays_for_success() -> None:
    env = GoalEnv(toys(2))
    seen, info = env.reset(options={"board": 0})
    waited = 0
    while not info["deciding"]:
        assert seen["allowed"].sum() == 1
        seen, reward, over, cut, info = env.step(np.int64(7))
        waited += 1
        assert (reward, over, cut) == (0, False, False)
    assert waited == len(ACTIONS) + 1
    rewards = []
    for choice in (1, 3, 5, STOP):
        assert seen["allowed"][choice]
        seen, reward, over, _, info = env.step(np.int64(choice))
        rewards.append(reward)
    assert over and info["success"] == 1 and rewards == pytest.approx([1 / 3] * 3 + [0])


def test_the_environment_depends_on_its_seed_alone() -> None:
    def played(seed: int) -> list[np.ndarray]:
        env = GoalEnv(toys(4), shuffle=True)
        seen, _ = env.reset(seed=seed)
        return [seen["goal"], *(env.step(np.int64(1))[0]["looks"] for _ in range(9))]

    first, again, other = played(3), played(3), played(4)
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first[0], other[0])
