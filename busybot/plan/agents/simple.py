"""Agents that need no reasoning: what doing nothing and acting at random come to."""

from busybot.plan.interfaces import Act, Contact, DecisionState, Stop, TaskContext

PROMISING = 0.5
"""Least expected success of a candidate that has not moved yet, as when data for reasoning are collected."""


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


REACHED = "everything looks as in the goal"
NO_CANDIDATE = "there is no candidate for an action"


def promising(candidates: tuple[Contact, ...]) -> tuple[Contact, ...]:
    """What paper section 3.2 calls action candidates: links that were seen moving, and likely new ones."""
    promise = [1.0 if contact.region > 0 else contact.score for contact in candidates]
    least = min(PROMISING, max(promise, default=0))
    return tuple(contact for contact, worth in zip(candidates, promise, strict=True) if worth >= least)
