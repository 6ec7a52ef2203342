"""Encodes learned agents' observations as arrays of one size (paper appendix "Planning module").

The paper gives its agents BC and PPO the present observation, the goal's, the action candidates, and the interaction
history through an LSTM, and asks for the index of an action. A rollout is therefore a row of observations: those of the
recorded history one after the other, then one for every decision. The LSTM reads them all in order; only decisions are
answered.

| key | shape | meaning |
|---|---|---|
| `looks` | (10, 256) | features of every object in the present picture; zeros for triggers and vacant places |
| `goal` | (10, 256) | the same in the goal picture |
| `objects` | (10, 8) | position / 2 (3); trigger; responder; how far from the goal, how far from the picture before, \
d / (d + threshold) each; acted on |
| `action` | (8,) | the action that led here: position / 2 (3), direction (3), whether it worked; 1 if there was one |
| `choices` | (25, 8) | per choice: position / 2 (3), direction (3), belief that it works, whether its link was seen \
moving; row 0 (stop) is zeros |
| `touched` | (25, 10) | the trigger at each choice's place, one-hot, as far as boxes tell |
| `allowed` | (25,) | 1 where there is such a choice. Stop always is; within the history it stands for looking on |

Choices are the candidates of the interaction model, those that the paper's agents of ours choose from
(`agents.paper.promising`), in the two directions of their best pair.

Departures: the paper's agents see whole pictures; these see the objects' features, as all other agents do, and two
distances made of them, because 45 minutes on two cores are too little to learn from pixels.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from busybot.boards.directions import DIRECTIONS
from busybot.common.errors import BusybotError
from busybot.plan.agents.paper import Choice, promising
from busybot.plan.interfaces import Contact, TaskContext
from busybot.reason.inputs.sequence import CHANNELS

OBJECTS = 10
"""Most objects on a board (appendix A.1)."""
CONTACTS = 12
"""Most candidates that are looked at, the most promising ones."""
CHOICES = 1 + 2 * CONTACTS
STOP = 0
"""The choice that ends a rollout."""
FACTS = 8
"""Numbers per object, action and choice."""
HALF_BOARD = 2.0
"""Board units."""

Observation = dict[str, np.ndarray]
SHAPES: dict[str, tuple[int, ...]] = {
    "looks": (OBJECTS, CHANNELS),
    "goal": (OBJECTS, CHANNELS),
    "objects": (OBJECTS, FACTS),
    "action": (FACTS,),
    "choices": (CHOICES, FACTS),
    "touched": (CHOICES, OBJECTS),
    "allowed": (CHOICES,),
}
"""All float32."""
_OF_OBJECTS = {"looks": -2, "goal": -2, "objects": -2, "touched": -1}
"""Which axis of what counts objects."""


@dataclass(frozen=True)
class CandidateArrays:
    """Choices at one decision.

    Attributes:
        facts: float32 (25, 8), rows of `choices`.
        touched: int64 (25,), trigger at each choice's place, -1 for none.
        count: of choices, stop included; those from there on are none.
    """

    facts: np.ndarray
    touched: np.ndarray
    count: int


@dataclass(frozen=True)
class ActionOutcome:
    """An action and what came of it.

    Attributes:
        position: (3,), board frame, board units.
        direction: (3,), the one that worked, else the one proposed.
        touched: the trigger there, -1 for none.
        worked: whether the picture changed.
    """

    position: np.ndarray
    direction: np.ndarray
    touched: int
    worked: bool


class ObservationEncoder:
    """Observations on one board.

    Raises:
        BusybotError: the board has too many objects.
    """

    def __init__(self, briefing: TaskContext):
        history = briefing.history
        count = len(history.triggers)
        if count > OBJECTS:
            raise BusybotError(f"a board with {count} objects", f"learned agents see {OBJECTS} at most")
        self._briefing, self._count = briefing, count
        self._fixed = np.zeros((OBJECTS, FACTS), np.float32)
        self._fixed[:count, :3] = history.positions / HALF_BOARD
        self._fixed[:count, 3], self._fixed[:count, 4] = history.triggers, history.responders
        self._goal = _vacant(briefing.goal)

    def history(self) -> Observation:
        """What was recorded: every array with a first axis of length T + 1."""
        seen, worked = self._briefing.history, self._briefing.worked
        rows = [self.seen(seen.features[0], seen.features[0], None)]
        for step in range(seen.steps):
            did = worked[step] >= 0
            direction = DIRECTIONS[worked[step]] if did else seen.actions[step, 3:]
            deed = ActionOutcome(seen.actions[step, :3], direction, int(seen.acted[step]), bool(did))
            rows.append(self.seen(seen.features[step + 1], seen.features[step], deed))
        return stacked(rows)

    def seen(
        self,
        features: np.ndarray,
        before: np.ndarray,
        deed: ActionOutcome | None,
        offered: CandidateArrays | None = None,
    ) -> Observation:
        """An observation.

        Args:
            features: (N, 256), now.
            before: (N, 256), before the action that led here.
            deed: that action, None for none.
            offered: choices; without any there is only stop.
        """
        objects, action = self._fixed.copy(), np.zeros(FACTS, np.float32)
        responders = self._briefing.history.responders
        objects[: self._count, 5] = self._apart(features, self._briefing.goal) * responders
        objects[: self._count, 6] = self._apart(features, before) * responders
        if deed is not None:
            action[:3], action[3:6], action[6:] = deed.position / HALF_BOARD, deed.direction, (deed.worked, 1)
            if deed.touched >= 0:
                objects[deed.touched, 7] = 1
        offered = offered or offer(())[0]
        touched, allowed = np.zeros((CHOICES, OBJECTS), np.float32), np.zeros(CHOICES, np.float32)
        there = np.flatnonzero(offered.touched >= 0)
        touched[there, offered.touched[there]] = 1
        allowed[: offered.count] = 1
        return {
            "looks": _vacant(features),
            "goal": self._goal,
            "objects": objects,
            "action": action,
            "choices": offered.facts,
            "touched": touched,
            "allowed": allowed,
        }

    def _apart(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Distance of features of each object, from 0 to 1; one half at the threshold of what looks different."""
        distance = np.linalg.norm(np.subtract(one, other, dtype=np.float32), axis=1)
        return distance / (distance + self._briefing.threshold)


def offer(candidates: tuple[Contact, ...]) -> tuple[CandidateArrays, list[Choice]]:
    """What a learned agent chooses from: the arrays, and choice k + 1 as item k of the list."""
    found = [(contact, one) for contact in promising(candidates)[:CONTACTS] for one in contact.choices]
    facts, touched = np.zeros((CHOICES, FACTS), np.float32), np.full(CHOICES, -1)
    for row, (contact, direction) in enumerate(found, start=1):
        facts[row, :3], facts[row, 3:6] = contact.position / HALF_BOARD, DIRECTIONS[direction]
        facts[row, 6:] = contact.expected(direction), contact.region > 0
        touched[row] = contact.trigger
    return CandidateArrays(facts, touched, 1 + len(found)), found


def stacked(rows: Sequence[Observation]) -> Observation:
    """Observations one after the other, a new first axis."""
    return {name: np.stack([row[name] for row in rows]) for name in SHAPES}


def shuffled(observation: Observation, order: np.ndarray) -> Observation:
    """The same with the objects in another order, int (10,)."""
    return {
        name: np.take(value, order, axis=_OF_OBJECTS[name]) if name in _OF_OBJECTS else value
        for name, value in observation.items()
    }


def _vacant(features: np.ndarray) -> np.ndarray:
    """Features with vacant places filled up, float32 (10, 256)."""
    padded = np.zeros((OBJECTS, CHANNELS), np.float32)
    padded[: len(features)] = features
    return padded
