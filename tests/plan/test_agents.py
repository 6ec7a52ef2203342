"""Agents on a board without pictures."""

import numpy as np
import pytest

from busybot.plan.agents.paper import (
    NO_CANDIDATE,
    REACHED,
    BusyBotAgent,
    NoopAgent,
    PredictiveAgent,
    RandomAgent,
    RelationAgent,
)
from busybot.plan.agents.search import SearchAgent
from busybot.plan.interfaces import Stop
from busybot.reason.models.lookup import Lookup
from tests.plan.toy import DOWN, RIGHT, UP, Link, World, two_buttons_and_a_lever

EVERYTHING = [(0, UP), (1, UP), (2, UP), (2, DOWN), (2, DOWN), (2, UP), (0, DOWN)]
EVERYONE = [RelationAgent, PredictiveAgent, BusyBotAgent, SearchAgent]


def test_search_needs_no_step_more_than_there_are_differences() -> None:
    world = two_buttons_and_a_lever()
    acts, stop = world.play(SearchAgent(Lookup()), world.briefing(EVERYTHING, goal=[1, 0, 0]))
    assert world.states() == [1, 0, 0]
    assert len(acts) == 3 and stop == Stop(REACHED)
    assert {act.responder for act in acts} == {2, 3, 4} and all("as in step" in act.why for act in acts)


def test_search_goes_through_the_middle() -> None:
    world = two_buttons_and_a_lever()
    world.links[2].state = 2
    acts, stop = world.play(SearchAgent(Lookup()), world.briefing([(2, DOWN), (2, DOWN), (2, UP)], goal=[0, 1, 0]))
    assert world.states() == [0, 1, 0] and len(acts) == 2 and stop is not None


def test_search_concludes_where_a_lever_goes_from_the_opposite_direction() -> None:
    """In the history the lever went up from the middle, and came to the middle from below: never down from it."""
    world = two_buttons_and_a_lever()
    world.links[2].state = 0
    briefing = world.briefing([(2, UP), (2, UP), (2, DOWN)], goal=[0, 1, 0])
    world.links[2].state = 1
    acts, _ = world.play(SearchAgent(Lookup()), briefing)
    assert world.states() == [0, 1, 0] and len(acts) == 1 and acts[0].direction == DOWN


def test_search_finds_a_look_that_it_never_saw() -> None:
    world = two_buttons_and_a_lever()
    acts, stop = world.play(SearchAgent(Lookup()), world.briefing([(2, UP), (2, DOWN)], goal=[0, 1, 0]))
    assert world.states() == [0, 1, 0] and stop == Stop(REACHED) and len(acts) <= 3


def test_search_tries_again_after_a_failure() -> None:
    world = two_buttons_and_a_lever()
    briefing = world.briefing(EVERYTHING, goal=[1, 1, 1])
    world.links[0].sticky = 2
    acts, stop = world.play(SearchAgent(Lookup()), briefing)
    assert world.states() == [1, 1, 1] and len(acts) == 3 and stop == Stop(REACHED)


def test_search_takes_another_contact_after_a_failure() -> None:
    world = two_buttons_and_a_lever()
    briefing = world.briefing(EVERYTHING, goal=[1, 1, 1])
    world.links[0].dead, world.links[0].other = True, (14, 10)
    acts, _ = world.play(SearchAgent(Lookup()), briefing)
    assert [act.contact.pixel for act in acts] == [(10, 10), (14, 10)] and world.states() == [1, 1, 1]


def test_search_tries_links_of_which_nothing_is_known() -> None:
    world = two_buttons_and_a_lever()
    acts, stop = world.play(SearchAgent(Lookup()), world.briefing([(0, UP), (0, DOWN)], goal=[0, 0, 1]))
    assert world.states() == [0, 0, 1] and stop == Stop(REACHED)


def test_search_asks_the_interaction_model_only_where_it_has_to() -> None:
    world = two_buttons_and_a_lever()
    agent, briefing = SearchAgent(Lookup()), world.briefing(EVERYTHING, goal=[1, 1, 1])
    agent.start(briefing)
    situation = world.situation(briefing, [])
    agent.decide(situation)
    assert "candidates" not in situation.__dict__
    unknown = world.briefing([(1, UP)], goal=[1, 1, 1])
    agent.start(unknown)
    situation = world.situation(unknown, [])
    agent.decide(situation)
    assert "candidates" in situation.__dict__


@pytest.mark.parametrize("make", EVERYONE)
def test_one_button_is_pressed_by_everyone(make: type) -> None:
    world = World([Link(0, 2, (10, 10)), Link(1, 3, (90, 10))], 2, 2)
    acts, _ = world.play(make(Lookup()), world.briefing([(0, UP), (1, UP), (0, UP)], goal=[1, 0]))
    assert world.states() == [1, 0] and len(acts) == 1


@pytest.mark.parametrize("make", EVERYONE)
def test_who_cannot_go_on_says_so(make: type) -> None:
    """Nothing was seen, and what differs is nothing that a trigger controls."""
    world = World([Link(0, 2, (10, 10))], 1, 2)
    briefing = world.briefing([], goal=[0])
    briefing.goal[1, 9] = 5
    world.links = []
    acts, stop = world.play(make(Lookup()), briefing)
    assert not acts and stop is not None and stop.why


@pytest.mark.parametrize("make", EVERYONE)
def test_a_board_without_objects_is_no_crash(make: type) -> None:
    world = World([], 0, 0)
    _, stop = world.play(make(Lookup()), world.briefing([], goal=[]))
    assert stop is not None


def test_nothing_can_be_changed_and_the_search_gives_up() -> None:
    world = World([Link(0, 1, (10, 10), direction=RIGHT)], 1, 1)
    briefing = world.briefing([(0, RIGHT)], goal=[1])
    world.links[0].sticky = 100
    acts, stop = world.play(SearchAgent(Lookup()), briefing)
    assert stop is None or "failed" in stop.why
    assert len(acts) >= 2 and len({(act.contact.step, act.direction) for act in acts}) > 1


def test_relation_is_open_loop() -> None:
    """One step for every responder that differs, even where it fails."""
    world = two_buttons_and_a_lever()
    briefing = world.briefing(EVERYTHING, goal=[1, 1, 2])
    for link in world.links:
        link.sticky = 100
    acts, stop = world.play(RelationAgent(Lookup()), briefing)
    assert len(acts) == 2 and stop is not None and {act.responder for act in acts} == {2, 4}
    assert {act.contact.trigger for act in acts} == {0, 1}


def test_busybot_acts_only_on_triggers_that_matter_and_stops() -> None:
    world = two_buttons_and_a_lever()
    acts, stop = world.play(BusyBotAgent(Lookup()), world.briefing(EVERYTHING, goal=[0, 1, 2]))
    assert {act.contact.trigger for act in acts} == {1} and world.states() == [0, 1, 2]
    assert stop == Stop(REACHED)


def test_noop_and_random() -> None:
    world = two_buttons_and_a_lever()
    briefing = world.briefing([], goal=[1, 1, 1])
    assert world.play(NoopAgent(), briefing)[0] == []
    acts, _ = world.play(RandomAgent(), briefing)
    assert acts
    done = world.briefing([], goal=world.states())
    assert world.play(RandomAgent(), done) == ([], Stop(REACHED))
    world.links = []
    assert world.play(RandomAgent(), briefing) == ([], Stop(NO_CANDIDATE))


def test_what_differs_is_told_by_features_of_responders() -> None:
    world = two_buttons_and_a_lever()
    briefing = world.briefing([], goal=[1, 1, 1])
    assert briefing.differing(world.features()).tolist() == [2]
    noisy = world.features() + np.float32(0.01)
    noisy[0] += 9  # a trigger
    assert briefing.differing(noisy).tolist() == [2]
