"""Toy boards explored without a simulator, for tests of the learned agents."""

import numpy as np

from busybot.plan.learning.board_graph import BoardGraph, ExploredBoard
from busybot.plan.learning.encoding import CHOICES, STOP, offer
from tests.plan.toy import DOWN, UP, Link, World, two_buttons_and_a_lever

ACTIONS = [(0, UP), (1, DOWN), (2, UP), (0, DOWN), (2, DOWN)]


def explore_toy(world: World, actions: list[tuple[int, int]], goal: list[int], group: str = "") -> ExploredBoard:
    """What `explore` finds on the world's board; success is the share of links in their goal state."""
    briefing = world.briefing(actions, goal)
    numbers = {tuple(world.states()): 0}
    rows: list[tuple[np.ndarray, ...]] = []
    while len(rows) < len(numbers):
        number, state = len(rows), list(numbers)[len(rows)]
        offered, choices = offer(tuple(world.contact(link) for link in range(len(world.links))))
        leads, worked = np.full(CHOICES, -1), np.full(CHOICES, -1)
        leads[STOP] = number
        for row, (contact, direction) in enumerate(choices, start=1):
            _put(world, state)
            executed, moved = world.pull(contact.pixel, direction)
            leads[row] = numbers.setdefault(tuple(world.states()), len(numbers))
            worked[row] = executed[-1] if moved else -1
        _put(world, state)
        success = np.mean([a == b for a, b in zip(state, goal, strict=True)], dtype=np.float32)
        rows.append((world.features().astype(np.float16), success, offered.facts, offered.touched, leads, worked))
    _put(world, list(numbers)[0])
    return ExploredBoard(briefing, BoardGraph(*(np.stack(column) for column in zip(*rows, strict=True))), group)


def _put(world: World, states: tuple[int, ...]) -> None:
    for link, state in zip(world.links, states, strict=True):
        link.state = state


def toys(count: int = 4) -> list[ExploredBoard]:
    """Tasks on one board, each of a group of its own."""
    goals = [[1, 0, 2], [0, 0, 1], [1, 1, 0], [1, 0, 0]]
    return [explore_toy(two_buttons_and_a_lever(), ACTIONS, goals[k % 4], str(k)) for k in range(count)]


def buttons(goals: tuple[list[int], ...] = ([1, 0], [0, 1])) -> list[ExploredBoard]:
    """Tasks with two buttons, each with a responder of its own."""
    actions = [(0, UP), (1, UP)]
    return [explore_toy(two_buttons(), actions, goal, str(number)) for number, goal in enumerate(goals)]


def two_buttons() -> World:
    """Object 0 controls object 2, object 1 controls object 3."""
    return World([Link(0, 2, (10, 10)), Link(1, 3, (90, 10))], 2, 2)
