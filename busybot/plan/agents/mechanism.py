"""Plans through the mechanisms that a `mechanism` model has understood: the agent for worlds whose causes are hard.

1. The laws of the board are those that it had at first, of the model after the recorded interactions
   (`MechanismReasoner.laws`). What the agent sees of its own actions teaches them further.
2. The shortest way to a board that looks as in the goal is searched through them, action by action: several links may
   have to be moved for one responder, some in a certain order, or back again, and an action may be waiting.
3. Where no known effect leads on, the shortest way to a situation that was never met is taken, in the hope that it
   does.
4. A link that failed to give may wait for any responder in any state; by what the responders showed when it gave and
   when it did not, it is told which, much as curiosity tells it (`curiosity.yields`).
5. Whether an action moved its link is not always seen: the picture may change by what an earlier action does late, and
   hardly by a small link. What responders show then and later tells which is more probable.

Each action is decided anew after looking. Links are moved by what moved them in the history, else by the interaction
model's candidate that is nearest.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from busybot.boards.directions import DIRECTIONS
from busybot.common.errors import BusybotError
from busybot.plan.agents.paper import NO_CANDIDATE, REACHED, promising
from busybot.plan.interfaces import NOBODY, Act, Contact, DecisionState, PastAction, Stop, TaskContext
from busybot.reason.models.base import Reasoner
from busybot.reason.models.mechanism.curiosity import LOCKED, yields
from busybot.reason.models.mechanism.laws import Links, Moment
from busybot.reason.models.mechanism.reasoner import MechanismReasoner

MOVED, SILENT, SEEN, WAITED, PROPOSED = 0.98, 0.95, 0.05, 0.05, 0.8
"""How probably an action moved its link if the picture changed; if it did not, as with this link before; if it did not,
though it did before; if it was meant to move none. What the interaction model proposes is so much less sure."""
BELIEFS = 8
"""So many beliefs of where links stand are kept, the most probable ones."""
UNKNOWN = -1
"""State of a responder whose look in the goal was never seen."""
NEAR = 0.02
"""What was taken hold of lies so near to where it was, board units."""


@dataclass
class Locks:
    """Which links are held while the responders look so, by how each gave and failed before.

    Attributes:
        shown: the responders' states, as often as they were seen.
        tries: by link, which of these showed when it was tried, and whether it moved.
    """

    shown: list[tuple[int, ...]]
    tries: dict[int, list[tuple[int, bool]]] = field(default_factory=dict)
    _told: dict[tuple[int, tuple[int, ...], int], bool] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def add(self, link: int, moved: bool, then: int = -1) -> None:
        """That a link moved or did not, as responders looked then, by default when they were seen last."""
        self.tries.setdefault(link, []).append((then % len(self.shown), moved))
        self._told.clear()

    def held(self, link: int, shown: tuple[int, ...]) -> bool:
        """Whether the link would rather not give if the responders showed this; False of one that never failed."""
        asked = link, shown, len(self.shown)  # a state that was not seen before may be what lets it go
        if asked not in self._told:
            self._told[asked] = self._failed(link) and self._yields(link, shown) < 0.5
        return self._told[asked]

    def _failed(self, link: int) -> bool:
        return any(not moved for _, moved in self.tries.get(link, []))

    def _yields(self, link: int, shown: tuple[int, ...]) -> float:
        """How probable it is that a link gives; of the links of this board the more are held the more ever failed."""
        tries = self.tries[link]
        known = any(moved for _, moved in tries)  # how to push it
        locked = (1 + sum(map(self._failed, self.tries))) / (1 / LOCKED + len(self.tries))
        return yields(np.array([*self.shown, shown], int), [(*one, known) for one in tries], locked)


class MechanismAgent:
    """See the module.

    Args:
        reasoner: of the variant `mechanism`.
    """

    name = "mechanism"

    def __init__(self, reasoner: Reasoner):
        if not isinstance(reasoner, MechanismReasoner):
            what = f"agent {self.name} plans with mechanisms, which the reasoner {reasoner.name} does not tell"
            raise BusybotError(what, "give --reasoner mechanism, or a model of that variant")
        self._reasoner = reasoner

    def start(self, briefing: TaskContext) -> None:
        self._briefing = briefing
        self._perceived, self._laws = self._reasoner.laws(briefing.history)
        self._locks, self._used = Locks(list(map(tuple, self._perceived.trace.responders.tolist()))), Counter[int]()
        self._failures: list[tuple[tuple[int, int], int | None, tuple[int, ...]]] = []
        start = self._laws.begin(self._perceived.trace.links[0], self._shown(briefing.history.features[0]))
        self._beliefs = [(0.0, start)]  # log probabilities, the most probable first
        self._read_history()
        self._known = 0
        self._meant: int | None = None  # the link that is to be moved, NOBODY for none

    def _read_history(self) -> None:
        """Which links gave, and which do so without anybody being rewarded: the picture hardly tells that they did."""
        trace, silent = self._perceived.trace, Counter[int]()
        for step, link in enumerate(self._perceived.links.clusters.tolist()):
            if link >= 0:
                moved = bool(trace.links[step, link] != trace.links[step + 1, link])
                self._locks.add(link, moved, step)
                if self._briefing.worked[step] < 0:
                    silent[link] += 1 if moved else -1
        self._silent = {link for link, count in silent.items() if count > 0}

    def decide(self, situation: DecisionState) -> Act | Stop:
        for attempt in situation.attempts[self._known :]:
            self._learn(attempt)
        self._known = len(situation.attempts)
        differing = self._briefing.differing(situation.features)
        if not len(differing):
            return Stop(REACHED)
        way, why = self._way(differing, self._briefing.steps - self._known)
        for links in way[:1]:
            words = f"{why} after {len(way)} action{'s' * (len(way) > 1)}"
            if (act := self._act(situation, links, words)) is not None:
                return act
        return self._anything(situation, differing)

    def _way(self, differing: np.ndarray, left: int) -> tuple[list[Links], str]:
        """The links after each of the actions that lead on, and where they lead."""
        known = self._wanted()
        wanted = dict.fromkeys(np.flatnonzero(np.isin(self._perceived.responders, differing)).tolist(), UNKNOWN) | known
        way = self._laws.plan(self._moment, wanted, self._moves, left)
        if way and self._laws.reaches(self._moment, way, wanted):
            return way, "the goal is expected"
        tried = self._laws.plan(self._moment, wanted, self._moves, left, hopeful=True)
        return (tried, "something new is met") if tried else (way, "more of the goal is expected")

    def _wanted(self) -> dict[int, int]:
        """Of the responders the state in the goal, by their numbers; a look that was never seen is no state."""
        goal, known = self._briefing.goal, self._perceived.looks
        states = self._perceived.states_of(goal)
        apart = [
            np.linalg.norm(looks[state] - goal[index])
            for index, looks, state in zip(self._perceived.responders, known, states, strict=True)
        ]
        fits = np.array(apart) <= self._briefing.threshold
        return {int(number): int(states[number]) for number in np.flatnonzero(fits)}

    def _moves(self, moment: Moment) -> Iterator[Links]:
        """What one action may do: nothing, or move a link into a state next to its own, if it is not held."""
        yield moment.links
        for link, (state, size) in enumerate(zip(moment.links, self._laws.sizes, strict=True)):
            if not self._locks.held(link, moment.shown):
                for other in (state - 1, state + 1):
                    if 0 <= other < size:
                        yield (*moment.links[:link], other, *moment.links[link + 1 :])

    @property
    def _moment(self) -> Moment:
        """What is most probable of the board."""
        return self._beliefs[0][1]

    def _learn(self, attempt: PastAction) -> None:
        """What came of an action: where its link stands now, and what the responders show."""
        meant, before = self._meant, self._moment
        self._locks.shown.append(before.shown)
        silent = not attempt.reward and meant in self._silent
        chance = MOVED if attempt.reward else SILENT if silent else SEEN
        chance *= 1.0 if attempt.contact.step >= 0 else PROPOSED
        moved = self._weigh(attempt, WAITED if meant == NOBODY else chance)
        if not attempt.reward:
            self._failures.append((attempt.contact.pixel, meant, before.shown))
        if meant is not None and meant != NOBODY:
            self._used[meant] += 1
            if not silent:
                self._locks.add(meant, moved)

    def _weigh(self, attempt: PastAction, chance: float) -> bool:
        """Each belief with a link moved and without, by how well it agrees with what shows; the laws learn from the
        most probable one.

        Returns:
            whether a link moved, by that one.
        """
        shown, direction = self._shown(attempt.after), attempt.executed[-1] if attempt.reward else attempt.direction
        action, found = np.array([*attempt.contact.position, *DIRECTIONS[direction]]), []
        for weight, moment in self._beliefs:
            led = tuple(self._perceived.moved(np.array(moment.links, int), action, attempt.contact.trigger).tolist())
            shares = {moment.links: 1 - chance}
            shares[led] = shares.get(led, 0.0) + chance
            for links, share in shares.items():
                told = weight + np.log(share) + self._laws.agreement(moment, links, shown)
                found.append((float(told), moment, links))
        found.sort(key=lambda one: -one[0])
        (most, before, links), *others = found[:BELIEFS]
        self._beliefs = [(0.0, self._laws.learn(before, links, shown))]
        for weight, moment, other in others:
            self._beliefs.append((weight - most, replace(moment.acted(other, self._laws.sizes), shown=shown)))
        return links != before.links

    def _act(self, situation: DecisionState, links: Links, why: str) -> Act | None:
        """The action that should leave the links so; None if nothing can be taken hold of."""
        now = self._moment.links
        moved = [number for number, (a, b) in enumerate(zip(now, links, strict=True)) if a != b]
        if not moved:
            return self._wait(situation, why)
        [link] = moved
        self._meant = link
        choice = self._choice(situation, link, links[link])
        return Act(*choice, why) if choice else None

    def _choice(self, situation: DecisionState, link: int, after: int) -> tuple[Contact, int] | None:
        """Where and in which direction to move a link: what failed least, is where it was, and did just this."""
        states, clusters = self._perceived.trace.links[:, link], self._perceived.links.clusters
        directions, before = self._perceived.links.directions[link], self._moment.links[link]
        way = directions[before, after] - directions[after, before]
        found: list[tuple[tuple[int, bool, int], Contact, int]] = []
        for one in (*situation.repeats, *situation.unrewarded):
            same = (states[one.step], states[one.step + 1]) == (before, after)
            if clusters[one.step] == link and (same or one.belief):
                direction = one.choices[0] if same else _nearest(way, one)
                found.append(((self._in_vain(one.pixel), not self._still_there(one), 1 - same), one, direction))
        if not found or min(rank for rank, *_ in found) > (0, False, 1):
            for one in situation.candidates:
                if self._perceived.link_at(np.asarray(one.position), one.trigger) == link:
                    found.append(((self._in_vain(one.pixel), False, 2), one, _nearest(way, one)))
        return min(found, key=lambda one: one[0])[1:] if found else None

    def _still_there(self, contact: Contact) -> bool:
        """Whether the picture shows at the pixel of an action what was taken hold of then."""
        held = self._briefing.history.actions[contact.step, :3]
        return float(np.linalg.norm(np.asarray(contact.position) - held)) < NEAR

    def _in_vain(self, pixel: tuple[int, int]) -> int:
        """How often what was done there failed although no lock held its link."""
        return sum(
            at == pixel and (link in (None, NOBODY) or not self._locks.held(link, shown))
            for at, link, shown in self._failures
        )

    def _wait(self, situation: DecisionState, why: str) -> Act | None:
        """An action that moves nothing: across all ways in which a link gave."""
        self._meant, found = NOBODY, []
        for one in situation.repeats:
            link, ways = int(self._perceived.links.clusters[one.step]), DIRECTIONS[[self._briefing.worked[one.step]]]
            if link >= 0:
                ways = np.vstack([ways, self._perceived.links.directions[link].reshape(-1, 3)])
            along = np.abs(DIRECTIONS @ ways.T).max(1)
            found.append((float(along.min()), one, int(along.argmin())))
        if not found:
            return None
        _, contact, across = min(found, key=lambda one: one[0])
        return Act(contact, across, f"waits: {why}")

    def _anything(self, situation: DecisionState, differing: np.ndarray) -> Act | Stop:
        """A candidate on something that was never moved, else on the link that was moved least."""
        links = [
            (one, self._perceived.link_at(np.asarray(one.position), one.trigger))
            for one in promising(situation.candidates)
        ]
        if not links:
            return Stop(NO_CANDIDATE)
        one, self._meant = min(
            links, key=lambda pair: (self._in_vain(pair[0].pixel), self._used[NOBODY if pair[1] is None else pair[1]])
        )
        self._used[NOBODY] += self._meant is None
        return Act(one, one.choices[0], "nothing known leads on: tries something else", int(differing[0]))

    def _shown(self, features: np.ndarray) -> tuple[int, ...]:
        return tuple(self._perceived.states_of(features).tolist())


def _nearest(way: np.ndarray, contact: Contact) -> int:
    """The direction that is most like a way (3,); if that is not known, the likeliest of the contact."""
    return int((DIRECTIONS @ way).argmax()) if way.any() else contact.choices[0]
