"""Remembers what actions on this board did, in the history and the rollout, told from features alone.

Every link of these boards drives one responder, so the place that was touched names the responder, and a responder's
look names the state of its link. Looks of a responder are numbered; a look that differs by less than the threshold, or
by much less than any two known looks do, is the same.
"""

from dataclasses import dataclass, replace

import numpy as np

from busybot.boards.directions import OPPOSITE
from busybot.plan.interfaces import NOBODY, Contact, PastAction, TaskContext

ALIKE = 0.4
"""A look that no other is like is taken for the nearest one within this share of the least distance of two looks: a
neighbour may hide a part of it."""
SAME_PLACE = 2.5
"""Pixels nearer than this are the same contact."""


class StateAppearances:
    """The numbered looks of one responder."""

    def __init__(self, threshold: float):
        self._threshold = threshold
        self.known: list[np.ndarray] = []

    def number(self, look: np.ndarray) -> int:
        """Of the look, float (256,); a new one gets the next number."""
        apart = [float(np.linalg.norm(look - other)) for other in self.known]
        if apart and min(apart) <= max(self._threshold, ALIKE * self._least()):
            return int(np.argmin(apart))
        self.known.append(look)
        return len(self.known) - 1

    def nearest(self, look: np.ndarray) -> int:
        """Number of the known look that is nearest to a predicted one."""
        return int(np.argmin([np.linalg.norm(look - other) for other in self.known]))

    def _least(self) -> float:
        """Least distance of two known looks, 0 if there are not two."""
        looks = np.array(self.known)
        apart = np.linalg.norm(looks[:, None] - looks[None], axis=-1)
        return float(apart[np.triu_indices(len(looks), 1)].min()) if len(looks) > 1 else 0.0


@dataclass(frozen=True)
class Transition:
    """An action that changed a responder.

    Attributes:
        pixel, position: where.
        proposed, worked: directions.
        name: for people.
        responder: what changed.
        before, after: numbers of its looks.
    """

    pixel: tuple[int, int]
    position: np.ndarray
    proposed: int
    worked: int
    name: str
    responder: int = NOBODY
    before: int = 0
    after: int = 0


@dataclass(frozen=True)
class FailedAction:
    """An action of the rollout that changed nothing, with all looks as they were."""

    pixel: tuple[int, int]
    directions: tuple[int, ...]
    looks: dict[int, int]


class EffectMemory:
    """All experiences on one board."""

    def __init__(self, briefing: TaskContext, edges: np.ndarray):
        """Read the history.

        Args:
            edges: bool (N, N), relations; changes of the history that contradict them are left out.
        """
        self._threshold = briefing.threshold
        self.looks = {int(j): StateAppearances(briefing.threshold) for j in np.flatnonzero(briefing.history.responders)}
        self.lessons: list[Transition] = []
        self.failures: list[FailedAction] = []
        history = briefing.history
        for features in history.features:
            self.numbers(features)
        self.goal = self.numbers(briefing.goal)
        for step in np.flatnonzero(briefing.worked >= 0):
            trigger, worked = int(history.acted[step]), int(briefing.worked[step])
            allowed = np.flatnonzero(edges[trigger]) if trigger >= 0 else np.zeros(0, int)
            u, v = briefing.pixels[step].tolist()
            # the history's action counts with the direction that worked: what was proposed may have failed before it
            action = Transition((u, v), history.actions[step, :3], worked, worked, f"step {step + 1}")
            self._learn(action, history.features[step], history.features[step + 1], allowed)

    def numbers(self, features: np.ndarray) -> dict[int, int]:
        """Number of each responder's look in features (N, 256)."""
        return {index: looks.number(features[index]) for index, looks in self.looks.items()}

    def add(self, attempt: PastAction, name: str) -> None:
        """Learn from an action of the rollout."""
        contact, worked = attempt.contact, attempt.executed[-1]
        action = Transition(contact.pixel, contact.position, attempt.direction, worked, name)
        if not self._learn(action, attempt.before, attempt.after, np.array(list(self.looks), int)):
            self.failures.append(FailedAction(contact.pixel, attempt.executed, self.numbers(attempt.before)))

    def _learn(self, action: Transition, before: np.ndarray, after: np.ndarray, allowed: np.ndarray) -> bool:
        """Remember which of the allowed objects an action changed most, if it changed any."""
        sizes = np.linalg.norm(after[allowed] - before[allowed], axis=1)
        if not sizes.max(initial=0) > self._threshold:
            return False
        responder = int(allowed[sizes.argmax()])
        looks = [self.looks[responder].number(features[responder]) for features in (before, after)]
        self.lessons.append(replace(action, responder=responder, before=looks[0], after=looks[1]))
        return True

    def nearest(self, contact: Contact) -> dict[int, float]:
        """Distance from a contact to the nearest experience with each responder, board units."""
        if not self.lessons:
            return {}
        places = np.array([lesson.position for lesson in self.lessons])
        apart = np.linalg.norm(places - contact.position, axis=1)
        near: dict[int, float] = {}
        for lesson, distance in zip(self.lessons, apart, strict=True):
            if lesson.pixel == contact.pixel and contact.step >= 0:
                distance = 0.0  # the place may have moved in depth with its link
            near[lesson.responder] = min(near.get(lesson.responder, np.inf), float(distance))
        return near

    def seen(self, contact: Contact, direction: int, responder: int, look: int) -> Transition | None:
        """The latest experience that says what this very action does to the responder in this look."""
        for lesson in reversed(self.lessons):
            if lesson.responder != responder or lesson.before != look or not same_place(lesson.pixel, contact.pixel):
                continue
            if direction in (lesson.proposed, lesson.worked):
                return lesson
        return None

    def turned(self, contact: Contact, direction: int, responder: int, look: int) -> int | None:
        """Where a direction leads of which only the opposite was seen here, if the look is one between two others.

        What one direction does from the middle, the opposite one does to the other side.
        """
        lesson = self.seen(contact, int(OPPOSITE[direction]), responder, look)
        if lesson is None:
            return None
        moves = self.moves(responder)
        sides = {b for a, b in moves if a == look} | {a for a, b in moves if b == look}
        others = sides - {lesson.after, look}
        return others.pop() if len(others) == 1 else None

    def failed(self, contact: Contact, direction: int, responder: int, look: int) -> int:
        """How often an action at about this place, with this direction among those tried, failed in this look."""
        return sum(
            same_place(one.pixel, contact.pixel) and direction in one.directions and one.looks.get(responder) == look
            for one in self.failures
        )

    def moves(self, responder: int) -> set[tuple[int, int]]:
        """Changes of look that were seen."""
        return {(lesson.before, lesson.after) for lesson in self.lessons if lesson.responder == responder}


def same_place(one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether two pixels are the same contact."""
    return float(np.hypot(one[0] - other[0], one[1] - other[1])) <= SAME_PLACE
