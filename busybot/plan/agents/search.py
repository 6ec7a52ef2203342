"""`search`: our agent. Closed loop, over what the links of this board are known to do.

At every decision, for every responder that does not look as in the goal:

1. The contacts whose nearest effective experience changed this responder are taken for its link (the nearest is
   nearly always of the right link).
2. A contact and a direction that did something to this look before will do it again: the same look means the same
   state of the link, so the same pull has the same effect. Of what was never done, the reasoner says what follows.
3. The looks that follow are rated by how many steps lead from them to the look of the goal, over the changes that were
   seen and their reverses. A choice costs the tries that it takes (1 / its probability to work) and those steps.
4. The cheapest choice of all responders is executed. What came of it is an experience like those of the history; a
   failure lowers the probability of this place and direction, so another one comes up.

The interaction model is asked only where the history has no contact that surely works.
"""

from dataclasses import dataclass

import numpy as np

from busybot.common.frozen_model import FrozenModel
from busybot.interact.policy.direction_pairs import sigmoid
from busybot.plan.agents.effect_memory import EffectMemory, Transition
from busybot.plan.agents.paper import NO_CANDIDATE, REACHED, Choice, predicted
from busybot.plan.interfaces import Act, Contact, DecisionState, Stop, TaskContext
from busybot.reason.models.base import Reasoner


class SearchConfig(FrozenModel):
    """Constants of the search.

    Attributes:
        sure: a seen change repeats itself with this probability.
        moved: a contact of the history works with this probability when its link rests elsewhere than then.
        near: a contact so near to an experience is on its link in half of the cases, board units.
        rival: how much nearer the right link's experiences must be than another link's to tell them apart, board units.
        unknown: a contact so far from all experiences is on an unknown link in half of the cases, board units.
        steep: how sharply these two are told apart, board units.
        least_share: contacts that are less probably on a link are none of its contacts.
        after_failure: factor on the probability of what has failed.
        undo: extra cost of a step that was only seen in the other sense.
        untried: cost of what follows something untried where the look of the goal was never seen.
        lost: cost of a look from which no way to the goal is known.
        guess: extra cost of a try on a link of which nothing is known.
        give_up: nothing that costs more is tried.
    """

    sure: float = 0.98
    moved: float = 0.6
    near: float = 0.12
    rival: float = 0.02
    unknown: float = 0.08
    steep: float = 0.02
    least_share: float = 0.2
    after_failure: float = 0.1
    undo: float = 0.2
    untried: float = 2.0
    lost: float = 4.0
    guess: float = 5.0
    give_up: float = 1e5


@dataclass(frozen=True)
class Option:
    """Something to do, its cost in steps, and why."""

    contact: Contact
    direction: int
    responder: int
    belief: float
    cost: float
    why: str


@dataclass(frozen=True)
class _View:
    """What there is to choose from: features (N, 256), looks, contacts with the distances of `EffectMemory.nearest`."""

    features: np.ndarray
    looks: dict[int, int]
    contacts: list[tuple[Contact, dict[int, float]]]


class SearchAgent:
    """See the module."""

    name = "search"

    def __init__(self, reasoner: Reasoner, config: SearchConfig | None = None):
        self._reasoner, self._config = reasoner, config or SearchConfig()

    def start(self, briefing: TaskContext) -> None:
        self._briefing = briefing
        self._edges = self._reasoner.graph(briefing.history).claimed(briefing.history.steps)
        self._book = EffectMemory(briefing, self._edges)
        self._known = 0

    def decide(self, situation: DecisionState) -> Act | Stop:
        for attempt in situation.attempts[self._known :]:
            self._known += 1
            self._book.add(attempt, f"action {self._known} of this task")
        looks = self._book.numbers(situation.features)
        differing = [index for index, look in looks.items() if look != self._book.goal[index]]
        if not differing:
            return Stop(REACHED)
        best = self._best(situation, situation.repeats, differing, looks)
        if best is None or best.belief < self._config.sure:
            best = self._best(situation, situation.repeats + situation.candidates, differing, looks)
        if best is None:
            return Stop(f"{NO_CANDIDATE} that may change {_names(differing)}")
        if best.cost > self._config.give_up:
            return Stop(f"what might change {_names(differing)} has failed")
        return Act(
            best.contact,
            best.direction,
            f"{_names(differing)} differ{'s' * (len(differing) == 1)}: {best.why}",
            best.responder,
        )

    def _best(
        self, situation: DecisionState, contacts: tuple[Contact, ...], differing: list[int], looks: dict[int, int]
    ) -> Option | None:
        """The cheapest choice for any of the responders."""
        nears = [(contact, self._book.nearest(contact)) for contact in contacts]
        view, found = _View(situation.features, looks, nears), []
        for responder in differing:
            known = any(lesson.responder == responder for lesson in self._book.lessons)
            found += self._on_its_link(view, responder) if known else self._on_unknown_links(view, responder)
        return min(found, key=lambda option: option.cost, default=None)

    def _on_its_link(self, view: _View, responder: int) -> list[Option]:
        """Choices at contacts that are probably on the link of a responder."""
        config, goal, costs = self._config, self._book.goal[responder], self._costs(responder)
        shares = [
            (contact, direction, share)
            for contact, near in view.contacts
            if (share := self._share(near, responder)) > config.least_share
            for direction in contact.choices
        ]
        pairs, look, found = [(contact, direction) for contact, direction, _ in shares], view.looks[responder], []
        lessons = [self._book.seen(*pair, responder, look) for pair in pairs]
        expected = self._expected(view, pairs, lessons, responder)
        for (contact, direction, share), lesson, after in zip(shares, lessons, expected, strict=True):
            if lesson is not None:
                belief, why = config.sure, f"as in {lesson.name}"
            else:
                belief = share * (config.moved if contact.step >= 0 else contact.score)
                why = f"expected to work with {belief:.0%}"
            ahead = costs.get(after, config.lost)
            if after == look:
                ahead += 1  # it is not even expected to change anything
            if lesson is None and len(costs) == 1:
                ahead = min(ahead, config.untried)
            outcome = "look as in the goal" if after == goal else f"take look {after}, the goal is {goal}"
            text = f"object {responder} should then {outcome}, {why}"
            found.append(self._option((contact, direction), responder, look, belief, ahead, text))
        return found

    def _option(self, pair: Choice, responder: int, look: int, belief: float, ahead: float, why: str) -> Option:
        """A choice; `belief` is before its failures in this look count, `ahead` the steps that follow it."""
        belief *= self._config.after_failure ** self._book.failed(*pair, responder, look)
        return Option(*pair, responder, belief, 1 / max(belief, 1e-6) + ahead, why)

    def _expected(
        self, view: _View, pairs: list[Choice], lessons: list[Transition | None], responder: int
    ) -> list[int]:
        """The look that follows each choice: seen, else concluded from the opposite direction, else predicted."""
        look = view.looks[responder]
        known = [
            self._book.turned(*pair, responder, look) if lesson is None else lesson.after
            for pair, lesson in zip(pairs, lessons, strict=True)
        ]
        asked = [pair for pair, after in zip(pairs, known, strict=True) if after is None]
        rows = iter(predicted(self._reasoner, self._briefing, view.features, asked)[:, responder] if asked else ())
        return [self._book.looks[responder].nearest(next(rows)) if after is None else after for after in known]

    def _share(self, near: dict[int, float], responder: int) -> float:
        """Probability that a contact is on the link of a responder, from the distances to what is known."""
        own = near.get(responder, np.inf)
        other = min((distance for index, distance in near.items() if index != responder), default=np.inf)
        if not np.isfinite(own):
            return 0.0
        close = _sigmoid(4 * (1 - own / self._config.near))
        return close * _sigmoid((other - own) / self._config.rival)

    def _costs(self, responder: int) -> dict[int, float]:
        """Steps from each look of a responder to the one of the goal, over known changes and their reverses."""
        moves = self._book.moves(responder)
        steps = {(b, a): 1 + self._config.undo for a, b in moves} | dict.fromkeys(moves, 1.0)
        costs = {self._book.goal[responder]: 0.0}
        for _ in range(len(self._book.looks[responder].known)):
            for (start, end), cost in steps.items():
                if end in costs:
                    costs[start] = min(costs.get(start, np.inf), cost + costs[end])
        return costs

    def _on_unknown_links(self, view: _View, responder: int) -> list[Option]:
        """Choices at contacts far from all experiences, if nothing is known to change the responder."""
        config, triggers, look, found = (
            self._config,
            np.flatnonzero(self._edges[:, responder]),
            view.looks[responder],
            [],
        )
        why = f"nothing is known to change object {responder}; a link of which nothing is known"
        for contact, near in view.contacts:
            if contact.step >= 0 or (len(triggers) and contact.trigger not in triggers):
                continue
            belief = _sigmoid((min(near.values(), default=np.inf) - config.unknown) / config.steep) * contact.score
            for direction in contact.choices:
                found.append(self._option((contact, direction), responder, look, belief, config.guess, why))
        return found


def _sigmoid(value: float) -> float:
    return float(sigmoid(np.asarray(value)))


def _names(objects: list[int]) -> str:
    return f"object{'s' * (len(objects) > 1)} {', '.join(map(str, objects))}"
