"""What a board is known to do, from features alone."""

import numpy as np

from busybot.plan.agents.effect_memory import EffectMemory, StateAppearances
from busybot.plan.interfaces import PastAction
from tests.plan.toy import DOWN, UP, two_buttons_and_a_lever

ALL = np.ones((6, 6), bool)
EVERYTHING = [(0, UP), (1, UP), (2, UP), (2, DOWN), (2, DOWN), (2, UP)]


def test_a_look_that_a_neighbour_hides_in_part_is_still_the_same() -> None:
    looks = StateAppearances(threshold=0.5)
    off, on = np.zeros(256), np.full(256, 1.0)  # 16 apart
    assert [looks.number(look) for look in (off, on, off)] == [0, 1, 0]
    assert looks.number(off + 0.1) == 0  # 1.6 apart
    assert looks.number(off + 0.5) == 2


def test_lessons_are_changes_with_place_direction_and_looks() -> None:
    world = two_buttons_and_a_lever()
    book = EffectMemory(world.briefing(EVERYTHING, goal=[1, 1, 1]), ALL)
    assert [lesson.responder for lesson in book.lessons] == [2, 3, 4, 4, 4, 4]
    assert [lesson.worked for lesson in book.lessons] == [UP, DOWN, UP, DOWN, DOWN, UP]
    middle = book.goal[4]
    assert len(book.moves(4)) == 4 and len(book.looks[4].known) == 3
    assert book.seen(world.contact(2), UP, 4, middle) is not None
    assert book.seen(world.contact(0), UP, 4, middle) is None


def test_changes_that_contradict_the_relations_are_left_out() -> None:
    edges = ALL.copy()
    edges[0, 2] = False
    book = EffectMemory(two_buttons_and_a_lever().briefing(EVERYTHING, goal=[1, 1, 1]), edges)
    assert {lesson.responder for lesson in book.lessons} == {3, 4}


def test_the_opposite_direction_leads_to_the_other_side() -> None:
    world = two_buttons_and_a_lever()
    book = EffectMemory(world.briefing([(2, UP), (2, DOWN), (2, DOWN), (2, UP)], goal=[0, 1, 0]), ALL)
    middle = book.looks[4].number(world.features()[4])
    up = book.seen(world.contact(2), UP, 4, middle)
    assert up is not None and book.turned(world.contact(2), DOWN, 4, middle) == book.goal[4] != up.after
    assert book.turned(world.contact(0), DOWN, 4, middle) is None


def test_attempts_are_lessons_or_failures() -> None:
    world = two_buttons_and_a_lever()
    book = EffectMemory(world.briefing([], goal=[1, 1, 1]), ALL)
    contact, before = world.contact(0), world.features()
    book.add(PastAction(contact, UP, (UP, DOWN), False, before, before), "action 1")
    look = book.looks[2].number(before[2])
    assert book.failed(contact, UP, 2, look) == 1 and book.failed(world.contact(1), UP, 2, look) == 0
    book.add(PastAction(contact, UP, (UP,), True, before, world.features([1, 1, 1])), "action 2")
    lesson = book.seen(contact, UP, 2, look)
    assert lesson is not None and lesson.after == book.goal[2]
    assert book.nearest(contact) == {2: 0.0}
