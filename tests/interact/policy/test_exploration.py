"""Collecting for training: places without and with a network, pairs in order, all told from depth alone."""

from dataclasses import replace

import numpy as np

from busybot.boards.directions import DIRECTIONS, OPPOSITE
from busybot.common.rng import generator
from busybot.episodes.episode import Observation
from busybot.interact.policy.direction_pairs import PAIR_OF
from busybot.interact.policy.exploration import ExplorationConfig, GuidedExplorer, UnguidedExplorer
from busybot.sim.policy import Action
from tests.interact.scenes import BODY, BUTTON, PRESSED, RAYS, ButtonModel, picture

SMALL, LARGE = (10, 10, 18, 18), (40, 30, 140, 110)
KNOB = (60, 60, 66, 66)
BOARD = picture((SMALL, 0.1), (LARGE, BODY), (KNOB, BUTTON))
PRESSED_BOARD = picture((SMALL, 0.1), (LARGE, BODY), (KNOB, PRESSED))


def within(pixel: tuple[int, int], box: tuple[int, int, int, int]) -> bool:
    return box[0] <= pixel[0] < box[2] and box[1] <= pixel[1] < box[3]


def rng(seed: int = 0) -> np.random.Generator:
    return generator(seed, "", 0, "test")


def test_small_things_are_visited_as_often_as_large_ones() -> None:
    policy, draws = UnguidedExplorer(RAYS), rng()
    pixels = [policy.select_action(BOARD, draws).pixel for _ in range(200)]
    small = sum(within(pixel, SMALL) for pixel in pixels)
    assert 70 <= small <= 130 and small + sum(within(pixel, LARGE) for pixel in pixels) == 200


def test_rare_heights_of_a_component_are_preferred() -> None:
    shares = []
    for stratified in (0.0, 1.0):
        policy, draws = UnguidedExplorer(RAYS, ExplorationConfig(stratified=stratified)), rng()
        pixels = [policy.select_action(BOARD, draws).pixel for _ in range(200)]
        shares.append(np.mean([within(pixel, KNOB) for pixel in pixels]))
    assert shares[0] < 0.03 and shares[1] > 0.1


def test_every_pair_is_tried_once_in_an_order_of_its_own() -> None:
    policy, draws = UnguidedExplorer(RAYS), rng()
    first, second = (policy.select_action(BOARD, draws).directions for _ in range(2))
    assert sorted(PAIR_OF[list(first)]) == list(range(9)) and first != second
    few = UnguidedExplorer(RAYS, ExplorationConfig(pairs=2)).select_action(BOARD, rng()).directions
    assert len(few) == 2 and OPPOSITE[few[0]] != few[1]


def test_an_empty_board_is_acted_on_anyway() -> None:
    assert len(UnguidedExplorer(RAYS).select_action(picture(), rng()).directions) == 9
    assert len(GuidedExplorer(ButtonModel(), RAYS).select_action(picture(), rng()).directions) == 9


def test_the_network_leads_to_the_knob_and_names_the_pair() -> None:
    policy = GuidedExplorer(ButtonModel(), RAYS, ExplorationConfig(best=1, by_network=1))
    action = policy.select_action(BOARD, rng())
    assert within(action.pixel, KNOB)
    assert abs(DIRECTIONS[action.directions[0], 2]) == 1


def test_what_moved_and_what_failed_attract_less() -> None:
    other = (100, 60, 106, 66)
    boards = [picture((LARGE, BODY), (KNOB, height), (other, BUTTON)) for height in (BUTTON, PRESSED)]
    policy, draws = GuidedExplorer(ButtonModel(), RAYS, ExplorationConfig(best=1)), rng()
    policy.select_action(boards[0], draws)
    policy.observe(Action((62, 62), (0,)), (0, 17), 1, boards[1])
    assert all(within(policy.select_action(boards[1], draws).pixel, other) for _ in range(10))
    for _ in range(60):
        pixel = policy.select_action(boards[1], draws).pixel
        policy.observe(Action(pixel, (0,)), (0, 17), 0, boards[1])
    assert not within(policy.select_action(boards[1], draws).pixel, other)


def test_only_depth_is_read() -> None:
    """The same depth in other colours: the same actions."""
    recoloured = [replace(board, rgb=255 - board.rgb[::-1]) for board in (BOARD, PRESSED_BOARD)]
    for make in (lambda: UnguidedExplorer(RAYS), lambda: GuidedExplorer(ButtonModel(), RAYS)):
        chosen = []
        for before, after in ((BOARD, PRESSED_BOARD), recoloured):
            policy, draws = make(), rng()
            action = policy.select_action(before, draws)
            policy.observe(action, action.directions[:1], 1, after)
            chosen.append((action, policy.select_action(after, draws)))
        assert chosen[0] == chosen[1]


def test_before_a_noisy_camera_too_what_moved_and_what_failed_attract_less() -> None:
    """No picture repeats itself there."""
    draws, noise = rng(), np.random.default_rng(0)
    other = (100, 60, 106, 66)

    def photo(height: float) -> Observation:
        board = picture((LARGE, BODY), (KNOB, height), (other, BUTTON))
        rgb = np.clip(board.rgb + noise.normal(0, 12, board.rgb.shape), 0, 255).astype(np.uint8)
        frayed = board.depth + noise.normal(0, 3e-4, board.depth.shape).astype(np.float32)
        return replace(board, rgb=rgb, depth=frayed.astype(np.float32))

    policy = GuidedExplorer(ButtonModel(), RAYS, ExplorationConfig(best=1, change=2e-3))
    policy.select_action(photo(BUTTON), draws)
    policy.observe(Action((62, 62), (0,)), (0, 17), 1, photo(PRESSED))
    assert policy._moved is not None and 0 < policy._moved.sum() < 400
    assert all(within(policy.select_action(photo(PRESSED), draws).pixel, other) for _ in range(10))
    for _ in range(60):
        pixel = policy.select_action(photo(PRESSED), draws).pixel
        policy.observe(Action(pixel, (0,)), (0, 17), 0, photo(PRESSED))
    assert not within(policy.select_action(photo(PRESSED), draws).pixel, other)
