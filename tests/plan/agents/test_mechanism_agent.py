"""The agent that plans with mechanisms, on boards without pictures whose laws it is told rightly."""

from collections.abc import Collection, Sequence
from functools import partial

import numpy as np
import pytest

from busybot.boards.directions import DIRECTIONS, OPPOSITE
from busybot.boards.dynamics import Dynamics
from busybot.boards.spec import Relation
from busybot.common.errors import BusybotError
from busybot.episodes.episode import Episode
from busybot.interact.policy.direction_pairs import pair_scores
from busybot.plan.agents.mechanism import Locks, MechanismAgent
from busybot.plan.agents.paper import REACHED
from busybot.plan.interfaces import Act, Contact, DecisionState, PastAction, Stop, TaskContext
from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.inputs.trigger_links import ObservedLinks
from busybot.reason.models.lookup import Lookup
from busybot.reason.models.mechanism.config import MechanismNetConfig
from busybot.reason.models.mechanism.contexts import MEMORIES, STATES
from busybot.reason.models.mechanism.laws import Laws
from busybot.reason.models.mechanism.networks import MechanismNet
from busybot.reason.models.mechanism.perception import Perceived, perceive
from busybot.reason.models.mechanism.reasoner import MechanismReasoner
from tests.reason.worlds import LINKS, PUSH, SWITCHES, looks_of, play, relation, sequence_of

AND, FOLLOWS = relation("gate", SWITCHES, 1, (0, 0, 0, 1), function="and"), relation("one-to-one", (3,), 2, (1, 0))
LATE = relation("delay", (0,), 1, (0, 1), actions=2)
PRESSES = [0, 3, 0, 3, 3, 0, 0, 3, 0, 3, 3, 0, 3, 0, 0, 3]
"""An even number of each: the board ends as it began."""
Told = dict[int, tuple[tuple[int, ...], str]]
"""Links that decide a responder, and what is remembered."""


class Knowing(MechanismReasoner):
    """Tells these laws of lamp, door and toy."""

    def __init__(self, told: Told):
        super().__init__(MechanismNet(MechanismNetConfig()), "embedded")
        self._told = told

    def laws(self, seen: BoardSequence) -> tuple[Perceived, Laws]:
        perceived, inputs, memory = perceive(seen, "embedded"), np.zeros((3, 5), bool), np.zeros(3, int)
        for number, (links, name) in self._told.items():
            inputs[number, list(links)], memory[number] = True, MEMORIES.index(name)
        trace = perceived.trace
        return perceived, Laws((2, 2), inputs, memory, np.eye(3), trace.links, trace.responders)


def briefing_of(
    episode: Episode, goal: Sequence[int], presses: Sequence[int], unseen: Collection[int] = ()
) -> TaskContext:
    """Of a recording in which no picture told of moves of the `unseen` switches."""
    seen, clusters = sequence_of(episode), np.array([SWITCHES.index(pressed) for pressed in presses])
    states = np.array([episode.steps[0].trigger_states_before, *(one.trigger_states_after for one in episode.steps)])
    directions = np.zeros((STATES, STATES, 3))
    directions[0, 1], directions[1, 0] = DIRECTIONS[PUSH], DIRECTIONS[OPPOSITE[PUSH]]
    places = np.array([seen.actions[clusters == link, :2].mean(0) for link in range(2)])

    def watch(steps: int) -> ObservedLinks:
        return ObservedLinks(clusters[:steps], states[: steps + 1], np.array(SWITCHES), places, (directions,) * 2)

    history = BoardSequence(**seen.arrays, watch=watch)
    worked = np.array([step.executed[-1] for step in episode.steps])
    worked[np.isin(presses, [*unseen])] = -1
    asked = looks_of(np.array(goal)) * seen.responders[:, None]
    return TaskContext(history, np.array([(10 * one, 0) for one in clusters]), worked, asked, 0.5, 8)


def played(
    relations: Sequence[Relation],
    told: Told,
    goal: Sequence[int],
    stuck: Collection[int] = (),
    presses: Sequence[int] = PRESSES,
    unseen: Collection[int] = (),
) -> tuple[list[Act], Stop | None, tuple[int, ...]]:
    """What was done, why it ended, and what shows then; the actions `stuck` fail, and no picture tells of moves of the
    `unseen` switches."""
    episode = play(relations, presses)
    briefing, law = briefing_of(episode, goal, presses, unseen), Dynamics(episode.board, LINKS)
    agent, now = MechanismAgent(Knowing(told)), [0, 0]
    agent.start(briefing)
    state, attempts, acts = law.start((0, 0)), [], []
    for number in range(briefing.steps):
        looks = looks_of(np.array(state.shown)) * briefing.history.responders[:, None]
        seen, not_seen = (
            tuple(contact(k, briefing) for k, one in enumerate(presses) if (one in unseen) == quiet)
            for quiet in (False, True)
        )
        rng = np.random.default_rng(0)
        answer = agent.decide(DecisionState(looks, tuple(attempts), seen, tuple, rng, partial(tuple, not_seen)))
        if isinstance(answer, Stop):
            return acts, answer, state.shown
        acts.append(answer)
        link, way = SWITCHES.index(answer.contact.trigger), answer.direction
        moves = way in (PUSH, OPPOSITE[PUSH]) and number not in stuck
        executed = (way, int(OPPOSITE[way]))
        if moves and (way == PUSH) == (now[link] == 0):
            executed = (way,)
        now[link] ^= moves
        before, state = state, law.step((now[0], now[1]), state)
        after = looks_of(np.array(state.shown)) * briefing.history.responders[:, None]
        changed = (moves and answer.contact.trigger not in unseen) or before.shown != state.shown
        attempts.append(PastAction(answer.contact, way, executed, changed, looks, after))
    return acts, None, state.shown


def contact(step: int, briefing: TaskContext) -> Contact:
    directions, worked = np.zeros(18), briefing.worked[step]
    directions[worked if worked >= 0 else int((DIRECTIONS @ briefing.history.actions[step, 3:]).argmax())] = 0.97
    place = np.array([*briefing.history.actions[step, :2], 0], np.float32)
    pixel = (int(briefing.pixels[step][0]), 0)
    trigger = int(briefing.history.acted[step])
    belief = 0.97 if worked >= 0 else 0.0
    return Contact(pixel, place, trigger, 1, belief, directions, pair_scores(directions), step)


RIGHT: Told = {0: ((0, 1), "late 0"), 1: ((1,), "late 0")}


def test_both_switches_of_an_and_are_moved_and_no_more() -> None:
    acts, stop, shown = played([AND, FOLLOWS], RIGHT, (-1, 1, 0, -1, 0))
    assert [act.contact.trigger for act in acts] in ([0, 3], [3, 0]) and stop == Stop(REACHED)
    assert shown[1:3] == (1, 0)
    assert "the goal is expected after 2 actions" in acts[0].why


def test_what_comes_late_is_waited_for() -> None:
    acts, stop, shown = played([LATE, FOLLOWS], {0: ((0,), "late 2"), 1: ((1,), "late 0")}, (-1, 1, 1, -1, 0))
    assert len(acts) == 3 and stop == Stop(REACHED) and shown[1] == 1
    assert acts[0].contact.trigger == 0 and all(act.why.startswith("waits") for act in acts[1:])


def test_what_was_never_met_is_tried() -> None:
    """Both switches were never on together: only an untried situation can light the lamp."""
    acts, stop, shown = played([AND, FOLLOWS], RIGHT, (-1, 1, 0, -1, 0), presses=[0, 0, 3, 3])
    assert stop == Stop(REACHED) and shown[1:3] == (1, 0) and len(acts) == 2
    assert "something new" in acts[0].why


def test_a_failure_is_tried_again() -> None:
    acts, stop, _ = played([AND, FOLLOWS], RIGHT, (-1, 0, 0, -1, 0), stuck=[0])
    assert [act.contact.trigger for act in acts] == [3, 3] and stop == Stop(REACHED)


def test_what_an_earlier_action_does_late_is_no_sign_of_a_move() -> None:
    """The lamp lights while the second switch sticks: the door would have followed that one."""
    late, goal = relation("delay", (0,), 1, (0, 1), actions=1), (-1, 1, 0, -1, 0)
    acts, stop, shown = played([late, FOLLOWS], {0: ((0,), "late 1"), 1: ((1,), "late 0")}, goal, stuck=[1])
    assert [act.contact.trigger for act in acts] == [0, 3, 3] and stop == Stop(REACHED)
    assert shown[1:3] == (1, 0)


def test_a_switch_that_no_picture_tells_of_is_moved_as_it_was() -> None:
    acts, stop, shown = played([AND, FOLLOWS], RIGHT, (-1, 1, 0, -1, 0), unseen=[0])
    assert sorted(act.contact.trigger for act in acts) == [0, 3] and stop == Stop(REACHED)
    assert shown[1:3] == (1, 0)


def locks_of(*tries: tuple[int, tuple[int, ...], bool], met: tuple[int, ...] = (0, 0)) -> Locks:
    """After tries of links, with what the responders showed then."""
    locks = Locks([met])
    for link, shown, moved in tries:
        locks.shown.append(shown)
        locks.add(link, moved)
    return locks


def test_links_are_held_as_experience_says() -> None:
    tries = [(0, (0, 0), False), (0, (0, 1), False)]
    for so_far in (tries[:1], tries):
        assert not locks_of(*so_far).held(0, (1, 0)), "nothing ever moved it"
    locks = locks_of(*tries, (0, (1, 1), True), (1, (0, 0), False), (1, (0, 0), False))
    assert locks.held(0, (0, 1)) and not locks.held(0, (1, 0)), "the first responder lets it go"
    assert locks.held(1, (0, 0)) and not locks.held(1, (0, 1))
    tries = [(2, (0, 1), True), (2, (0, 1), True), (2, (0, 0), False)]
    assert locks_of(*tries).held(2, (0, 0)), "one failure of a link that gave with the second responder lit is enough"
    assert not locks_of(*tries, (2, (0, 0), True)).held(2, (0, 0)), "it gave after all: the failure was seen wrongly"


def test_a_link_may_wait_for_a_state_that_others_were_tried_in() -> None:
    tries = [(0, (state,), False) for state in (0, 1) * 3]
    assert locks_of(*tries, met=(2,)).held(0, (0,)), "the responder has a third state, which may let it go"
    assert not locks_of(*tries, met=(2,)).held(0, (2,)) and not locks_of(*tries, met=(1,)).held(0, (0,))


def test_what_was_said_of_a_link_is_thought_over_when_another_state_was_seen() -> None:
    locks = Locks([(1,), (0,)], {1: [(0, False), (1, False), (1, False), (1, True)]})
    assert not locks.held(1, (1,))
    locks.shown.append((2,))
    assert locks.held(1, (1,)) == Locks(locks.shown, locks.tries).held(1, (1,)) is True


def test_a_link_that_never_failed_is_not_held() -> None:
    locks = locks_of(*((link, (0, 0), False) for link in range(4)), (4, (0, 0), True))
    assert not locks.held(4, (1, 1)) and not locks.held(5, (0, 0))
    assert not locks_of((0, (0, 0), True), (0, (1, 0), False)).held(0, (-1, 0)), "what is not known tells nothing"


def test_it_wants_a_reasoner_that_tells_mechanisms() -> None:
    with pytest.raises(BusybotError, match="lookup does not tell"):
        MechanismAgent(Lookup())
