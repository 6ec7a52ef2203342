"""The true causal graph over time, and the action that each change goes back to. Privileged: for pictures and tables.

Steps are counted as in a recording: step 0 shows the new board, step k what k actions have left. A trigger link acts
with its mechanism's lag, a responder that another one reads one step later still, because it is read as it was before
the action.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from busybot.boards.dynamics import Dynamics, DynamicState, Triggers
from busybot.boards.mechanisms import Mechanism
from busybot.boards.spec import BODY, BoardSpec, LinkRef, Relation


class VariableNames:
    """Names of a board's variables: `lamp_5` is a responder, `switch_2.link_0` a trigger link."""

    def __init__(self, board: BoardSpec):
        self._objects = [f"{placed.category.lower()}_{index}" for index, placed in enumerate(board.objects)]

    def body(self, index: int) -> str:
        """Of an object."""
        return self._objects[index]

    def of(self, reference: LinkRef) -> str:
        """Of a link, or of an object as a whole."""
        return self.link(reference.object, reference.link)

    def link(self, index: int, name: str) -> str:
        """Of an object's link by its name."""
        return self.body(index) if name == BODY else f"{self.body(index)}.{name}"


@dataclass(frozen=True)
class Period:
    """A relation, and the steps whose states it decides.

    Attributes:
        since: the first of them, 0 for what holds on the new board.
        until: the step with which another relation takes its place; None if none does.
    """

    relation: Relation
    since: int = 0
    until: int | None = None

    def holds(self, step: int) -> bool:
        return self.since <= step and (self.until is None or step < self.until)


def periods(board: BoardSpec) -> list[Period]:
    """All relations of a board, also those that come later, by responder and time.

    A file of somebody else's may have several of one responder: those that begin together end together.
    """
    begins = [(relation.responder, 0, relation) for relation in board.relations]
    begins += [(one.relation.responder, one.step + 1, one.relation) for one in board.rewirings]
    begins.sort(key=lambda begin: begin[:2])
    found = []
    for responder, since, relation in begins:
        later = [other for owner, other, _ in begins if owner == responder and other > since]
        found.append(Period(relation, since, min(later, default=None)))
    return found


def relations_at(board: BoardSpec, step: int) -> list[Relation]:
    """The relations that decide what shows at a step."""
    return [period.relation for period in periods(board) if period.holds(step)]


def lag(mechanism: Mechanism, parent: LinkRef) -> int:
    """After how many steps a change of a parent shows at the earliest, 0: at the same step."""
    return mechanism.lag + int(parent.link == BODY)


@dataclass(frozen=True)
class Change:
    """A responder that shows another state than a step before.

    Attributes:
        step: at which it does.
        cause: number of the action, from 1, that it goes back to: the last one without which, had no link moved from
            then on, it would not have changed so at this step. None if it changed by itself, or was rewired.
        link: number of the link that this action moved, None without one.
        rewired: whether its relation changed with this step.
    """

    responder: int
    step: int
    cause: int | None = None
    link: int | None = None
    rewired: bool = False

    @property
    def late(self) -> int:
        """How many actions lie between cause and effect."""
        return 0 if self.cause is None else self.step - self.cause


def changes(dynamics: Dynamics, triggers: Sequence[Triggers]) -> list[Change]:
    """All changes of responders in an episode, in order.

    Args:
        triggers: states of the trigger links on the new board and after each action.
    """
    states = dynamics.run(triggers)
    rewired = {(one.relation.responder, one.step + 1) for one in dynamics.board.rewirings}
    alone = [period for period in periods(dynamics.board) if not period.relation.triggers]
    found = []
    for step in range(1, len(states)):
        for responder, (before, after) in enumerate(zip(states[step - 1].shown, states[step].shown, strict=True)):
            if before == after:
                continue
            if (responder, step) in rewired:
                found.append(Change(responder, step, rewired=True))
            elif any(one.relation.responder == responder and one.holds(step) for one in alone):
                found.append(Change(responder, step))
            else:
                found.append(_explained(dynamics, triggers, states, responder, step))
    return found


def _explained(
    dynamics: Dynamics, triggers: Sequence[Triggers], states: Sequence[DynamicState], responder: int, step: int
) -> Change:
    """The change of a responder with the action that it goes back to; luck is the same in what might have been."""
    happened = (states[step - 1].shown[responder], states[step].shown[responder])
    for action in range(step, 0, -1):
        if triggers[action] == triggers[action - 1]:
            continue
        might = [states[action - 1]]
        while len(might) < step - action + 2:
            might.append(dynamics.step(triggers[action - 1], might[-1]))
        if (might[-2].shown[responder], might[-1].shown[responder]) != happened:
            moved = [n for n, now in enumerate(triggers[action]) if now != triggers[action - 1][n]]
            return Change(responder, step, action, moved[0])
    return Change(responder, step)
