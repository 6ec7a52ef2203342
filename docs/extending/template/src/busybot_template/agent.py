"""Repeats what changed a differing responder in the history, until nothing differs."""

from busybot.plan.interfaces import Act, DecisionState, Stop, TaskContext
from busybot.reason.models.base import Reasoner


class Repeater:
    """Needs neither relations nor predictions."""

    name = "repeater"

    def __init__(self, reasoner: Reasoner):
        pass

    def start(self, briefing: TaskContext) -> None:
        self.briefing = briefing

    def decide(self, situation: DecisionState) -> Act | Stop:
        differing = self.briefing.differing(situation.features)
        if not len(differing):
            return Stop("the goal is reached")
        tried = {attempt.contact.step for attempt in situation.attempts}
        frames = self.briefing.history.features
        for contact in situation.repeats:
            before, after = frames[contact.step], frames[contact.step + 1]
            if (before[differing] != after[differing]).any() and contact.step not in tried:
                direction = int(self.briefing.worked[contact.step])
                return Act(contact, direction, f"step {contact.step} changed what differs")
        return Stop("nothing that changed what differs is left to repeat")
