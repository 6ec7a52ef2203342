"""The interface of an agent: its inputs and its answers (paper section 4.3).

An agent gets a `TaskContext` before it starts and a `DecisionState` at every decision, and answers with an `Act` or a
`Stop`. Nothing in them is the simulator's: no segmentation, no states, no relations.
What an oracle is told beside has its own hook, `agents.oracle`. How to write an agent:
`docs/extending/write-an-agent.md`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from busybot.boards.directions import OPPOSITE
from busybot.interact.policy.direction_pairs import PAIRS
from busybot.reason.inputs.sequence import BoardSequence

NOBODY = -1
"""In place of an object's index: none in particular."""


@dataclass(frozen=True)
class TaskContext:
    """What is known before the first action: the recorded interactions on this board, and the goal. N objects, T steps.

    Attributes:
        history: features, actions and positions of the recorded interactions; `history.triggers` and
            `history.responders` are the objects' roles. Frame 0 shows the board as it is at the start of the task.
        pixels: int (T, 2), (u, v) of the history's actions.
        worked: int (T,), the direction with which each of them changed the picture, -1 for none.
        goal: float32 (N, 256), features in the goal picture; zeros for triggers.
        threshold: features of one object that lie farther apart than this show different states.
        steps: so many actions are allowed.
    """

    history: BoardSequence
    pixels: np.ndarray
    worked: np.ndarray
    goal: np.ndarray
    threshold: float
    steps: int

    def differing(self, features: np.ndarray) -> np.ndarray:
        """Indices of the responders that do not look as in the goal; features are (N, 256)."""
        apart = np.linalg.norm(features - self.goal, axis=1)
        return np.flatnonzero(self.history.responders & (apart > self.threshold))


@dataclass(frozen=True, eq=False)
class Contact:
    """A place where something may be taken hold of.

    Attributes:
        pixel: (u, v).
        position: float32 (3,), board frame, board units.
        trigger: index of the trigger there as far as boxes tell, `NOBODY` for none.
        region: positive: number of a link that was seen moving there; negative: affordance of which nothing has moved.
        belief: probability that something can be moved there.
        directions: float (18,), probability that each direction works where something can be moved.
        pairs: float (9,), the same of direction pairs (`interact.policy.direction_pairs.PAIRS`).
        step: the step of the history that held this pixel and worked, -1 if the interaction model proposes the contact.
    """

    pixel: tuple[int, int]
    position: np.ndarray
    trigger: int
    region: int
    belief: float
    directions: np.ndarray
    pairs: np.ndarray
    step: int = -1

    @property
    def score(self) -> float:
        """Expected success of the best direction pair."""
        return self.belief * float(self.pairs.max())

    def expected(self, direction: int) -> float:
        """Expected success of one direction."""
        return self.belief * float(self.directions[direction])

    @property
    def choices(self) -> tuple[int, int]:
        """The two directions of the best pair, the likelier one first."""
        first = int(PAIRS[int(self.pairs.argmax())])
        two = (first, int(OPPOSITE[first]))
        return two if self.directions[two[0]] >= self.directions[two[1]] else two[::-1]


@dataclass(frozen=True, eq=False)
class PastAction:
    """An action of this rollout and what came of it.

    Attributes:
        direction: the one proposed.
        executed: those tried, in order; the last one worked if `reward`.
        reward: whether the picture changed.
        before, after: float32 (N, 256), features.
    """

    contact: Contact
    direction: int
    executed: tuple[int, ...]
    reward: bool
    before: np.ndarray
    after: np.ndarray


@dataclass
class DecisionState:
    """What is known at a decision.

    Attributes:
        features: float32 (N, 256), the board as it looks now.
        attempts: the rollout so far.
        repeats: where actions of the history worked, as the picture shows these pixels now; they cost nothing.
        propose: asks the interaction model; use `candidates`.
        rng: of all draws.
        look_again: looks where actions of the history changed no picture; use `unrewarded`.
    """

    features: np.ndarray
    attempts: tuple[PastAction, ...]
    repeats: tuple[Contact, ...]
    propose: Callable[[], tuple[Contact, ...]] = field(repr=False)
    rng: np.random.Generator = field(repr=False)
    look_again: Callable[[], tuple[Contact, ...]] = field(default=tuple, repr=False)

    @cached_property
    def candidates(self) -> tuple[Contact, ...]:
        """The interaction model's candidates on the current picture, one per region; asked for when first read."""
        return self.propose()

    @cached_property
    def unrewarded(self) -> tuple[Contact, ...]:
        """As `repeats`, where actions of the history changed no picture: some may have moved something small."""
        return self.look_again()


@dataclass(frozen=True)
class Act:
    """Take hold of an offered contact and move it.

    Attributes:
        contact: one of `repeats`, `unrewarded` or `candidates`.
        direction: index into DIRECTIONS; its opposite is tried where it changes nothing.
        why: for people.
        responder: the object that is meant to change, `NOBODY` for none in particular.
    """

    contact: Contact
    direction: int
    why: str = ""
    responder: int = NOBODY


@dataclass(frozen=True)
class Stop:
    """End the rollout: the goal is reached, or the agent cannot go on."""

    why: str


class Agent(Protocol):
    """Decides on one board. It is made anew for every rollout.

    Attributes:
        name: in tables.
    """

    name: str

    def start(self, briefing: TaskContext) -> None:
        """Called once, before the first decision."""
        ...

    def decide(self, situation: DecisionState) -> Act | Stop:
        """The next action. Called at most `TaskContext.steps` times."""
        ...
