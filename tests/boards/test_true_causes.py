"""Which relation holds when, and which action each change goes back to."""

from collections.abc import Sequence

import pytest

from busybot.boards.dynamics import Dynamics, Links
from busybot.boards.spec import BODY, BoardSpec, LinkRef, PlacedObject, Relation, Rewiring
from busybot.boards.true_causes import changes, lag, periods, relations_at

A, B = LinkRef(object=0, link="a"), LinkRef(object=1, link="b")
LINKS = Links(((0, "a"), (1, "b")), (2, 2))


def relation(
    kind: str, *triggers: LinkRef, responder: int = 2, states: Sequence[int] = (0, 1), **told: object
) -> Relation:
    return Relation(
        kind=kind, triggers=triggers, responder=responder, stage="single", states=tuple(states), parameters=told
    )


def board(*relations: Relation, rewirings: tuple[Rewiring, ...] = ()) -> BoardSpec:
    """Switches 0 and 1, lamps 2 and 3."""
    objects = tuple(
        PlacedObject(
            key=f"{'Switch' if role == 'trigger' else 'Lamp'}/x",
            role=role,
            position=(0, 0, 0),
            yaw=0,
            scale=1,
            states=(0,) if role == "trigger" else (),
        )
        for role in ("trigger", "trigger", "responder", "responder")
    )
    return BoardSpec(
        index=0, seed=0, split="train", appearance_group=0, texture="oak", color=(1, 1, 1), objects=objects,
        relations=relations, rewirings=rewirings, world="mixed",
    )  # fmt: skip


def causes(spec: BoardSpec, a: str, b: str) -> list[tuple[int, int, int | None, int | None]]:
    """Responder, step, cause and link of each change; `a` and `b` are the links' states from the new board on."""
    found = changes(Dynamics(spec, LINKS), [(int(x), int(y)) for x, y in zip(a, b, strict=True)])
    return [(one.responder, one.step, one.cause, one.link) for one in found]


def test_what_follows_at_once_goes_back_to_the_move() -> None:
    assert causes(board(relation("one-to-one", A)), "01101", "00011") == [(2, 1, 1, 0), (2, 3, 3, 0), (2, 4, 4, 0)]


def test_of_two_moves_that_a_gate_needs_the_last_one_is_the_cause() -> None:
    both = relation("gate", A, B, states=(0, 0, 0, 1), function="and")
    assert causes(board(both), "011110", "000111") == [(2, 3, 3, 1), (2, 5, 5, 0)]


def test_what_comes_late_goes_back_to_the_move_and_not_to_what_was_done_meanwhile() -> None:
    assert causes(board(relation("delay", A, actions=2)), "0111111", "0010111") == [(2, 3, 1, 0)]


def test_a_timer_goes_out_because_of_the_press_that_started_it() -> None:
    assert causes(board(relation("timer", A, actions=3)), "0110000", "0001111") == [(2, 1, 1, 0), (2, 4, 1, 0)]


def test_the_root_of_a_chain_is_found_a_step_back() -> None:
    chain = board(
        relation("one-to-one", A), relation("one-to-one", LinkRef(object=2, link=BODY), responder=3, states=(1, 0))
    )
    assert causes(chain, "0111", "0011") == [(2, 1, 1, 0), (3, 2, 1, 0)]


def test_luck_that_failed_at_first_leaves_the_cause_where_it_was() -> None:
    lucky = relation("unreliable", A, probability=0.2)
    found = causes(board(lucky), "0" + "1" * 30, "0" + "01" * 15)
    assert len(found) == 1 and found[0][1] > 1 and found[0][2:] == (1, 0)


def test_what_moves_by_itself_has_no_cause() -> None:
    alone = board(relation("flicker", probability=0.5), relation("one-to-one", A, responder=3))
    found = causes(alone, "01" * 10, "00" * 10)
    assert {one[2:] for one in found if one[0] == 2} == {(None, None)}
    assert all(one[2] == one[1] for one in found if one[0] == 3)


def test_what_moves_by_itself_until_it_is_rewired_has_causes_from_then_on() -> None:
    driven, alone = relation("one-to-one", A), relation("flicker", probability=0.9)
    spec = board(alone, rewirings=(Rewiring(step=2, relation=driven),))
    assert [one for one in causes(spec, "000010", "000000") if one[1] > 3] == [(2, 4, 4, 0), (2, 5, 5, 0)]
    spec = board(driven, rewirings=(Rewiring(step=2, relation=alone),))
    found = [one for one in causes(spec, "01" * 10, "00" * 10) if one[1] > 3]
    assert len(found) > 5 and {one[2:] for one in found} == {(None, None)}


def rewired() -> BoardSpec:
    other = relation("one-to-one", B, states=(1, 0))
    return board(relation("one-to-one", A), rewirings=(Rewiring(step=2, relation=other),))


def test_a_rewiring_ends_one_period_and_begins_the_next() -> None:
    spec = rewired()
    assert [(one.since, one.until) for one in periods(spec)] == [(0, 3), (3, None)]
    triggers = [one.relation.triggers for one in periods(spec)]
    assert triggers == [(A,), (B,)]
    assert [relations_at(spec, step)[0].triggers for step in (0, 2, 3, 9)] == [(A,), (A,), (B,), (B,)]


def test_several_relations_of_a_responder_hold_together_until_it_is_rewired() -> None:
    first, second = relation("one-to-one", A), relation("one-to-one", B)
    spec = board(first, second, rewirings=(Rewiring(step=2, relation=first),))
    assert [relations_at(spec, step) for step in (0, 2, 3)] == [[first, second], [first, second], [first]]


def test_a_change_that_the_rewiring_made_has_no_move_as_its_cause() -> None:
    found = changes(Dynamics(rewired(), LINKS), [(0, 0)] * 4 + [(0, 1)])
    assert [(one.step, one.cause, one.rewired) for one in found] == [(3, None, True), (4, 4, False)]


@pytest.mark.parametrize(("kind", "told", "late"), [("one-to-one", {}, 0), ("delay", {"actions": 3}, 3)])
def test_a_responder_that_is_read_acts_a_step_later_than_a_link(kind: str, told: dict, late: int) -> None:
    mechanism = Dynamics(board(relation(kind, A, **told)), LINKS).mechanism(2)
    assert mechanism is not None
    assert (lag(mechanism, A), lag(mechanism, LinkRef(object=3, link=BODY))) == (late, late + 1)
