"""Who decides what on a board: parents link by link and object by object, mechanisms, lags, clocks, rewirings."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.dynamics import Dynamics, Links
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BODY, BoardSpec, LinkRef, PlacedObject, Relation, Rewiring
from busybot.boards.worlds import WORLDS, links_of
from busybot.episodes.episode import Episode
from busybot.objects.resolve import find
from busybot.reason.evaluation.ground_truth import causes_of, trace_of

LINKS = Links(((0, "a"), (0, "b"), (1, "c")), (2, 2, 2))


def placed(role: str, states: tuple[int, ...] = ()) -> PlacedObject:
    return PlacedObject.model_validate(
        {"key": "Any/one", "role": role, "position": (0, 0, 0), "yaw": 0, "scale": 1, "states": states}
    )


def relation(
    kind: str, responder: int, inputs: list[tuple[int, str]], states: tuple[int, ...], **more: Any
) -> Relation:
    triggers = tuple(LinkRef(object=index, link=name) for index, name in inputs)
    return Relation(
        kind=kind, triggers=triggers, responder=responder, stage="single", states=states, parameters=more
    )  # fmt: skip


def board() -> BoardSpec:
    """A box with two links, a switch, and five lamps: late by one, a follower of it, two of a clock, one of nothing."""
    objects = (placed("trigger", (0, 0)), placed("trigger", (0,)), *(placed("responder") for _ in range(5)))
    relations = (
        relation("delay", 2, [(0, "b"), (0, "a")], (0, 0, 0, 1), actions=1),
        relation("one-to-one", 3, [(2, BODY)], (0, 1)),
        relation("clock", 4, [], (0, 1), probability=0.1, stream="clock"),
        relation("clock", 5, [], (1, 0), probability=0.1, stream="clock"),
    )
    later = Rewiring(step=20, relation=relation("one-to-one", 2, [(1, "c")], (0, 1)))
    return BoardSpec(
        index=0, seed=0, split="train", appearance_group=0, texture="wood", color=(1, 1, 1), objects=objects,
        relations=relations, rewirings=(later,), world="mixed",
    )  # fmt: skip


def test_parents_link_by_link_and_object_by_object() -> None:
    causes = causes_of(board(), LINKS)
    names = [(one.object, one.link) for one in causes.inputs]
    assert names == [(0, "a"), (0, "b"), (1, "c"), *((index, BODY) for index in range(2, 7))]
    assert {(names[i], int(j)) for i, j in np.argwhere(causes.link_parents)} == {
        ((0, "a"), 2), ((0, "b"), 2), ((2, BODY), 3)
    }  # fmt: skip
    assert {tuple(map(int, pair)) for pair in np.argwhere(causes.object_parents)} == {(0, 2), (2, 3)}
    assert causes.read[2] == (1, 0), "in the mechanism's order"
    kinds = [one.kind if one else None for one in causes.mechanisms]
    assert kinds == [None, None, "delay", "one-to-one", "clock", "clock", None]


def test_a_responder_that_is_read_shows_one_action_late() -> None:
    causes = causes_of(board(), LINKS)
    assert (causes.lags[0, 2], causes.lags[1, 2], causes.lags[3, 3]) == (1, 1, 1)
    assert ((causes.lags >= 0) == causes.link_parents).all()


def test_responders_of_a_clock_have_their_luck_in_common() -> None:
    streams = {one.responder: one.stream for one in Dynamics(board(), LINKS).bound_at(0)}
    assert streams[4] == streams[5] and len({streams[2], streams[3], streams[4]}) == 3


def test_a_rewiring_holds_from_its_action_on() -> None:
    before, after = causes_of(board(), LINKS, 19), causes_of(board(), LINKS, 20)
    assert before.read[2] == (1, 0) and after.read[2] == (2,)
    assert after.object_parents[1, 2] and not after.object_parents[0, 2]


@pytest.mark.parametrize("world", WORLDS)
def test_a_link_without_a_part_in_anything_changes_nothing(world: str) -> None:
    """On drawn boards: what shows differs only where a moved link is a parent, or an ancestor."""
    library = find("procedural")
    for spec in generate_boards(BoardConfig(world=world, boards=2, group_size=1, seed=3), library):
        links = links_of([library.get(one.key) for one in spec.objects])
        causes, dynamics = causes_of(spec, links), Dynamics(spec, links, lucky=False)
        rest = tuple(state for one in spec.objects for state in one.states)
        still = dynamics.run([rest] * 6)
        reach = np.linalg.matrix_power(np.eye(len(spec.objects)) + causes.object_parents, 3) > 0
        for number, (index, _) in enumerate(links.names):
            moved = (*rest[:number], 1 if rest[number] != 1 else 0, *rest[number + 1 :])
            shown = dynamics.run([rest, *[moved] * 5])
            differ = {
                place for one, other in zip(still, shown, strict=True)
                for place in np.flatnonzero(np.array(one.shown) != other.shown)
            }  # fmt: skip
            assert all(reach[index, place] for place in differ)
            for place in np.flatnonzero(causes.link_parents[number]):
                mechanism = causes.mechanisms[place]
                assert mechanism is not None and number in causes.read[place]


def test_a_trace_is_what_the_steps_tell() -> None:
    steps = [
        SimpleNamespace(
            trigger_states_before=(0, 0, 0), trigger_states_after=(1, 0, 0),
            responder_states_before=(-1, -1, 0, 0, 0, 1, 0), responder_states_after=(-1, -1, 1, 0, 0, 1, 0),
        )
    ]  # fmt: skip
    episode = cast(Episode, SimpleNamespace(board=board(), steps=steps))
    found = trace_of(episode)
    assert found is not None
    assert found[0].tolist() == [[0, 0, 0], [1, 0, 0]] and found[1][:, 2].tolist() == [0, 1]
    untold = [SimpleNamespace(**{**vars(steps[0]), "responder_states_after": ()})]
    assert trace_of(cast(Episode, SimpleNamespace(board=board(), steps=untold))) is None
