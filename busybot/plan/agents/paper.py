"""The paper's agents: relation, predictive and BusyBot (section 3.3, appendix "Planning module").

- `relation`: for each responder that differs between the initial and the goal picture, one action on the trigger that
  the inferred graph names (one of them at random if it names several). Open loop: it does not look again.
- `predictive`: the candidate after which the predicted features are nearest to the goal's (L2).
- `busybot`: the same, among the candidates on triggers that control a responder that differs.

The last two end when everything looks as in the goal. Candidates are those of the recording of the history: one per
region of affordance. A departure: both directions of a candidate's best pair are choices, because the agent executes
both anyway, and which comes first decides where a lever in the middle goes.
"""

import numpy as np

from busybot.boards.directions import DIRECTIONS
from busybot.plan.agents.simple import NO_CANDIDATE, REACHED, promising
from busybot.plan.interfaces import NOBODY, Act, Contact, DecisionState, Stop, TaskContext
from busybot.reason.models.base import Reasoner

Choice = tuple[Contact, int]
"""A contact and a direction."""


class RelationAgent:
    """Paper section 3.3, option 1."""

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
    """Paper section 3.3, option 2."""

    name = "predictive"

    def __init__(self, reasoner: Reasoner):
        self._reasoner = reasoner

    def start(self, briefing: TaskContext) -> None:
        self._briefing = briefing

    def decide(self, situation: DecisionState) -> Act | Stop:
        differing = self._briefing.differing(situation.features)
        if not len(differing):
            return Stop(REACHED)
        choices = [(contact, one) for contact in promising(situation.candidates) for one in contact.choices]
        choices = self._filtered(choices, differing)
        if not choices:
            return Stop(self._nothing())
        after = predicted(self._reasoner, self._briefing, situation.features, choices)
        apart = np.linalg.norm((after - self._briefing.goal).reshape(len(choices), -1), axis=1)
        # where several come equally near, the one that is likeliest to work: after a failure that is another one
        best = min(range(len(choices)), key=lambda i: (round(float(apart[i]), 3), -_worth(choices[i])))
        return Act(
            *choices[best], f"predicted to come within {apart[best]:.2f} of the goal", self._meant(choices[best])
        )

    def _filtered(self, choices: list[Choice], differing: np.ndarray) -> list[Choice]:
        return choices

    def _nothing(self) -> str:
        return NO_CANDIDATE

    def _meant(self, choice: Choice) -> int:
        return NOBODY


class BusyBotAgent(PredictiveAgent):
    """Paper section 3.3, option 3."""

    name = "busybot"

    def start(self, briefing: TaskContext) -> None:
        super().start(briefing)
        self._edges = self._reasoner.graph(briefing.history).claimed(briefing.history.steps)

    def _filtered(self, choices: list[Choice], differing: np.ndarray) -> list[Choice]:
        useful = np.asarray(self._edges[:, differing].any(axis=1))
        return [choice for choice in choices if choice[0].trigger != NOBODY and useful[choice[0].trigger]]

    def _nothing(self) -> str:
        return "no candidate is on a trigger that is known to control what differs"


def _worth(choice: Choice) -> float:
    contact, direction = choice
    return contact.belief * float(contact.directions[direction])


def predicted(reasoner: Reasoner, briefing: TaskContext, features: np.ndarray, choices: list[Choice]) -> np.ndarray:
    """Features float32 (S, N, 256) that are expected after each of S choices, from the present ones (N, 256)."""
    actions = np.array([(*contact.position, *DIRECTIONS[one]) for contact, one in choices], np.float32)
    acted = np.array([contact.trigger for contact, _ in choices], int)
    current = np.repeat(features[None], len(choices), axis=0)
    return reasoner.predict(briefing.history, current, actions, acted)
