"""How a board stands that was not watched for a while."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from busybot.reason.inputs.trigger_links import ObservedLinks
from busybot.reason.models.mechanism.contexts import MEMORIES, STATES, Trace, explanations_of
from busybot.reason.models.mechanism.perception import Perceived
from busybot.reason.models.mechanism.present import Past

UP, DOWN = np.array([0.0, 0, 1]), np.array([0.0, 0, -1])


def past(links: np.ndarray, shown: np.ndarray, inputs: list[int], memory: str) -> Past:
    """Two links of object 0, held at x = 0 and 1, and one responder with this explanation."""
    directions = np.zeros((STATES, STATES, 3))
    directions[0, 1], directions[1, 0] = UP, DOWN
    places = np.array([[0.0, 0], [1, 0]])
    seen = ObservedLinks(np.zeros(len(links) - 1, int), links, np.zeros(2, int), places, (directions,) * 2)
    trace = Trace(links, shown[:, None], (2, 2))
    found, wanted = explanations_of(trace), np.isin(np.arange(3), inputs)
    [row] = np.flatnonzero((found.inputs == wanted).all(1) & (found.memory == MEMORIES.index(memory)))
    shares = np.eye(len(found.own))[[row]]
    pushes = np.array([push(0, UP if late > early else DOWN) for early, late in pairwise(links[:, 0])])
    acted = np.zeros(len(pushes), int)
    perceived = Perceived(trace, seen, np.array([1]), (np.zeros((2, 256), np.float32),), pushes, acted)
    return Past(perceived, found, np.ones((1, len(links)), bool), shares)


def push(place: float, way: np.ndarray) -> np.ndarray:
    return np.array([place, 0, 0, *way])


def test_links_stand_as_the_action_and_the_responders_tell() -> None:
    links = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)])
    known = past(links, links[:, 0] & links[:, 1], [0, 1], "late 0")
    assert known.standing(np.array([1]), push(0, DOWN), 0).tolist() == [1, 1], "only both light it"
    assert known.standing(np.array([0]), push(0, UP), 0).tolist() == [0, 0], "as they were"
    assert known.standing(np.array([0]), push(0, DOWN), 0).tolist() == [1, 0], "it is pushed to where it is not"
    assert known.standing(np.array([0]), push(9, UP), -1).tolist() == [0, 0], "nothing was taken hold of"


def test_contexts_that_only_another_mechanism_met_are_not_known() -> None:
    """Parity 0 was met before the change alone: what shows 0 since is parity 1."""
    links = np.array([(0, 0), (0, 1), (1, 1), (0, 1)])
    known = past(links, np.array([0, 0, 0, 0]), [0], "odd presses up")
    late = replace(known, of=np.array([[False, False, True, True]]))
    [number] = np.flatnonzero(known.shares[0])
    rested = np.zeros(known.shares.shape[1], int)
    assert known.remembered(rested, rested, np.array([0]))[0, number] == 0
    assert late.remembered(rested, rested, np.array([0]))[0, number] == 1


def test_a_toggle_is_what_it_shows() -> None:
    links = np.array([(0, 0), (1, 0), (0, 0), (1, 0), (0, 0), (1, 0), (0, 0)])
    known = past(links, np.array([0, 1, 1, 0, 0, 1, 1]), [0], "odd presses up")
    [number] = np.flatnonzero(known.shares[0])
    rested = np.zeros(known.shares.shape[1], int)
    for shown in (0, 1):  # parity 0 was followed by look 0, 1 by 1
        assert known.remembered(rested, rested, np.array([shown]))[0, number] == shown, "nobody pressed"
        pressed = rested + 1
        assert known.remembered(rested, pressed, np.array([shown]))[0, number] == 1 - shown


def test_links_that_stand_in_more_ways_than_are_compared_stand_as_they_did() -> None:
    """Also where there are more of these than 64 bits count."""
    known = past(np.zeros((3, 2), int), np.zeros(3, int), [0], "late 0")
    links = np.arange(3)[:, None] * np.ones(64, int) % 2
    trace = replace(known.perceived.trace, links=links, sizes=(2,) * 64)
    many = replace(known, perceived=replace(known.perceived, trace=trace))
    assert many.standing(np.array([0]), push(0, UP), 0).tolist() == links[-1].tolist()
