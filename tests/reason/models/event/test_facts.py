"""Column by column, what the event model's networks read is what its tables say."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from busybot.reason.models.event import data as event_facts
from busybot.reason.models.event.data import (
    Contacts,
    Context,
    Queries,
    change_facts,
    changed,
    contacts_of,
    count_facts,
    look_facts,
    past_facts,
    reversed_facts,
    trigger_rows,
)


def row(facts: Tensor) -> list[float]:
    return [float(value) for value in facts.flatten()]


def test_every_vector_is_as_long_as_its_constant() -> None:
    one = torch.ones(1, 1)
    seen, contacts = board()[0], compared()
    found = (
        change_facts(seen),
        count_facts(one, one, one),
        contacts.facts,
        past_facts(torch.ones(1, 2), torch.ones(1, 2)),
        look_facts(one, one, one, one),
        contacts.step,
    )
    names = ("CHANGE", "COUNT", "CONTACT", "PAST", "LOOK", "STEP")
    assert [facts.shape[-1] for facts in found] == [getattr(event_facts, f"{name}_FACTS") for name in names]


def test_what_a_step_did() -> None:
    seen = board()[0]
    apart = torch.tensor([[[0.0, size, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] for size in (0.45, 0.95)])
    two = replace(seen, distances=apart, shown=seen.shown.repeat(2, 1), board=torch.tensor([0, 0]))
    assert row(change_facts(two)[0, 0]) == pytest.approx([math.log(0.5), float(changed(torch.tensor(0.45))), 0.45, 0.5])
    assert row(change_facts(replace(two, shown=~two.shown))[0, 0]) == pytest.approx(
        [math.log(0.05), float(changed(torch.tensor(0.0))), 0, float(changed(torch.tensor(0.0)))], abs=1e-6
    )
    assert changed(torch.tensor([0.0, 0.95, 100.0])).tolist() == pytest.approx([0, 0.5, 1], abs=1e-4)


def test_how_often_a_pair_was_tried() -> None:
    masks = [torch.tensor([[True] * number + [False] * (5 - number)]) for number in (3, 2, 0)]
    assert row(count_facts(*masks)) == pytest.approx([math.log(4), math.log(3), 0])


def test_a_past_change_seen_from_now() -> None:
    facts = past_facts(torch.tensor([0.5, 0.75]), torch.tensor([math.log(2), math.log(4)]))
    assert row(facts) == pytest.approx([0.5, 0.75, 0.5, 0.25, 0.25])


def test_what_copying_a_look_would_mean() -> None:
    near, away = torch.tensor([[[0.95, 0.45]]]), torch.tensor([[[0.15, 3.95]]])
    facts = look_facts(near, away, torch.tensor([[[2.0, 0.5]]]), torch.tensor([0.0, 1.0]))
    assert row(facts[0, 0, 0]) == pytest.approx([0, 0.475, math.log(0.2), 0.075, math.log(2), 0])
    assert row(facts[0, 0, 1]) == pytest.approx([math.log(0.5), 0.9, math.log(4), 7.9, math.log(0.5), 1])


def board() -> tuple[Context, Queries]:
    """Two known contacts, one on either of two triggers; asked is one 0.05 beside the first, and a miss."""
    up, aside = [0.0, 0.0, 1.0], [0.6, 0.0, -0.8]
    actions = torch.tensor([[[1.05, 0.0, 0.2, *up], [1.0, 5.0, 0.2, *up]]])
    asked = torch.tensor([[[1.0, 0.0, 0.2, *aside], [1.0, 0.0, 0.2, *aside]]])
    seen = Context(
        distances=torch.zeros(1, 3, 3),
        actions=actions,
        acted=torch.tensor([[1, 0]]),
        known=torch.ones(1, 2, dtype=torch.bool),
        shown=torch.ones(1, 2, dtype=torch.bool),
        board=torch.tensor([0]),
        edge_index=torch.tensor([[0, 1], [0, 0]]),
        pos=torch.tensor([[9.0, 9.0, 9.0], [0.5, 0.0, 0.1]]),
        owner=torch.tensor([0, 0]),
    )
    return seen, Queries(torch.zeros(1, 2, 3), asked, torch.tensor([[1, -1]]))


def compared() -> Contacts:
    seen, asked = board()
    return contacts_of(seen, asked.actions, asked.acted)


def test_contacts_seen_from_another() -> None:
    contacts = compared()
    near, far = contacts.facts[0, 0]
    assert row(near) == pytest.approx(
        [math.exp(-6.25), math.exp(-1), math.exp(-((5 / 12) ** 2)), 5 / 12, -0.8, 0.8, 0.6, 1], rel=1e-4
    )
    assert row(far)[:4] == pytest.approx([0, 0, 0, 0.5 / 0.12]) and row(far)[7] == 0
    assert not contacts.same[0, 1].any(), "a miss is on no trigger"
    assert row(contacts.distance[0, 0]) == pytest.approx([0.05, 5])
    assert torch.equal(contacts.part(slice(1, None)).facts, contacts.facts[:, 1:])
    turned = near.clone()
    turned[4] *= -1
    assert torch.equal(reversed_facts(near), turned)


def test_an_action_by_itself() -> None:
    step = compared().step[0]
    outward = 0.5 * 0.6 / (0.5 + 0.05)
    assert row(step[0]) == pytest.approx([-0.8, 0.8, outward, outward, 0.1, 5 / 12, math.log(2)], rel=1e-5)
    assert row(step[1])[5:] == pytest.approx([0.5 / 0.12, 0])


def test_objects_as_places_among_the_triggers() -> None:
    triggers = np.array([False, True, False, True])
    assert trigger_rows(triggers, np.array([3, 1, -1, 0])).tolist() == [1, 0, -1, -1]
    assert trigger_rows(np.zeros(0, bool), np.array([-1])).tolist() == [-1]
