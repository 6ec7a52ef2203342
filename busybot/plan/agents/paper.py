"""The paper's agents: relation, predictive and BusyBot (section 4.3, appendix "Planning module"), and two trivial ones.

- `noop` and `random`: what doing nothing and acting at random come to.
- `relation`: for each responder that differs between the initial and the goal picture, one action on the trigger that
  the inferred graph names (one of them at random if it names several). Open loop: it does not look again.
- `predictive`: the candidate after which the predicted features are nearest to the goal's (L2).
- `busybot`: the same, among the candidates on triggers that control a responder that differs.

All but `noop` and `relation` end when everything looks as in the goal. Candidates are those of the recording of the
history: one per region of affordance. Both directions of a candidate's best pair are choices, as its authors have it:
both are executed anyway, and which comes first decides where a lever in the middle goes.
"""

import numpy as np

from busybot.boards.directions import DIRECTIONS
from busybot.plan.interfaces import NOBODY, Act, Contact, DecisionState, Stop, TaskContext
from busybot.reason.models.base import Reasoner

Choice = tuple[Contact, int]
"""A contact and a direction."""
PROMISING = 0.5
"""Least expected success of a candidate that has not moved yet, as when data for reasoning are collected."""
REACHED = "everything looks as in the goal"
NO_CANDIDATE = "there is no candidate for an action"


class NoopAgent:
    """Does nothing."""

    name = "noop"

    def start(self, briefing: TaskContext) -> None:
        pass

    def decide(self, situation: DecisionState) -> Act | Stop:
        return Stop("does nothing")


class RandomAgent:
    """Any candidate, as when the history was recorded; stops when everything looks as in the goal."""

    name = "random"

    def start(self, briefing: TaskContext) -> None:
        self._briefing = briefing

    def decide(self, situation: DecisionState) -> Act | Stop:
        if not len(self._briefing.differing(situation.features)):
            return Stop(REACHED)
        found = promising(situation.candidates)
        if not found:
            return Stop(NO_CANDIDATE)
        contact = found[int(situation.rng.integers(len(found)))]
        return Act(contact, contact.choices[int(situation.rng.integers(2))], "any candidate")


def promising(candidates: tuple[Contact, ...]) -> tuple[Contact, ...]:
    """What paper section 4.2 calls action candidates: links that were seen moving, and likely new ones."""
    promise = [1.0 if contact.region > 0 else contact.score for contact in candidates]
    least = min(PROMISING, max(promise, default=0))
    return tuple(contact for contact, worth in zip(candidates, promise, strict=True) if worth >= least)


class RelationAgent:
    """Paper section 4.3, option 1."""

    name = "relation"

    def __init__(self, reasoner: Reasoner):
        self._reasoner = reasoner

    def start(self, briefing: TaskContext) -> None:
        history = briefing.history
        self._edges = self._reasoner.graph(history).claimed(history.steps)
        self._left = [int(index) for index in briefing.differing(history.features[0])]

    def decide(self, situation: DecisionState) -> Act | Stop:
        rng = situation.rng
        while self._left:
            responder = self._left.pop(0)
            triggers = np.flatnonzero(self._edges[:, responder])
            if not len(triggers):
                continue  # no trigger was seen: the other responders may do
            trigger = int(rng.choice(triggers))
            found = [contact for contact in promising(situation.candidates) if contact.trigger == trigger]
            if found:
                contact = found[int(rng.integers(len(found)))]
                return Act(contact, contact.choices[0], f"object {trigger} controls object {responder}", responder)
        return Stop("every responder that differed had its action, if it had a known trigger with a candidate")


class PredictiveAgent:
    """Paper section 4.3, option 2."""

    name = "predictive"
    nothing = NO_CANDIDATE
    """Why it stops where there is nothing to choose from."""

    def __init__(self, reasoner: Reasoner):
        self._reasoner = reasoner

    def start(self, briefing: TaskContext) -> None:
        self._briefing = briefing

    def decide(self, situation: DecisionState) -> Act | Stop:
        differing = self._briefing.differing(situation.features)
        if not len(differing):
            return Stop(REACHED)
        found = self._useful(promising(situation.candidates), differing)
        choices = [(contact, direction) for contact in found for direction in contact.choices]
        if not choices:
            return Stop(self.nothing)
        after = predicted(self._reasoner, self._briefing, situation.features, choices)
        apart = np.linalg.norm((after - self._briefing.goal).reshape(len(choices), -1), axis=1)
        # where several come equally near, the one that is likeliest to work: after a failure that is another one
        works = [contact.expected(direction) for contact, direction in choices]
        best = min(range(len(choices)), key=lambda i: (round(float(apart[i]), 3), -works[i]))
        return Act(*choices[best], f"predicted to come within {apart[best]:.2f} of the goal")

    def _useful(self, candidates: tuple[Contact, ...], differing: np.ndarray) -> tuple[Contact, ...]:
        """The candidates that are thought about."""
        return candidates


class BusyBotAgent(PredictiveAgent):
    """Paper section 4.3, option 3."""

    name = "busybot"
    nothing = "no candidate is on a trigger that is known to control what differs"

    def start(self, briefing: TaskContext) -> None:
        super().start(briefing)
        self._edges = self._reasoner.graph(briefing.history).claimed(briefing.history.steps)

    def _useful(self, candidates: tuple[Contact, ...], differing: np.ndarray) -> tuple[Contact, ...]:
        controls = np.asarray(self._edges[:, differing].any(axis=1))
        return tuple(one for one in candidates if one.trigger != NOBODY and controls[one.trigger])


def predicted(reasoner: Reasoner, briefing: TaskContext, features: np.ndarray, choices: list[Choice]) -> np.ndarray:
    """Features float32 (S, N, 256) that are expected after each of S choices, from the present ones (N, 256)."""
    actions = np.array([(*contact.position, *DIRECTIONS[one]) for contact, one in choices], np.float32)
    acted = np.array([contact.trigger for contact, _ in choices], int)
    current = np.repeat(features[None], len(choices), axis=0)
    return reasoner.predict(briefing.history, current, actions, acted)
