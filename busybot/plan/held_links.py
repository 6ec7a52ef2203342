"""What did not move may be a link that a responder holds: how often that is so on a board, and of which places.

A place where an action moved nothing has no link, or has one that is pushed otherwise, or one that is held as things
are. The more that promised much did not move at its first try, the more links a board holds: what share of its links
that is, is inferred (Bayes), where half of all boards hold none. A place that promised much is then more probably held
than empty, so that trying it again is of no use until something looks otherwise, and it tells less of other places.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SAME = 10
"""Places are one if they are so near to each other in rows and columns, pixels: most neighbouring links are farther
apart."""
SHARES = np.arange(10) / 10
"""Of a board's links so many may be held."""
LEAST = 1e-12
"""What is less probable is not told apart."""
NONE_HELD = 0.5
"""How probable it is that a board holds none; all other shares are alike."""


@dataclass
class Place:
    """Where an action moved nothing.

    Attributes:
        pixel: (u, v), of the first one.
        trigger: the object there.
        actions: which of the board's actions did not move it, from 0.
        promised: how probable it seemed at most that there is a link.
        empty: how probable all that is if nothing is held there.
        waited: how probable it is if a link is, that was held at first.
        moved: whether a link was seen moving there later.
    """

    pixel: tuple[int, int]
    trigger: int
    actions: list[int]
    promised: float = 0.0
    empty: float = 1.0
    waited: float = 1.0
    moved: bool = False


class HeldLinks:
    """What was tried on one board where no link was known.

    Attributes:
        places: where that was in vain.
    """

    def __init__(self) -> None:
        self.places: list[Place] = []
        self._free = 0

    def tried(
        self, action: int, pixel: tuple[int, int], trigger: int, chances: tuple[float, float], moved: bool | None
    ) -> None:
        """Remember an action.

        Args:
            action: its number, from 0.
            chances: how probable it was that something moves there if nothing is held, and if something was held when
                the place was tried before.
            moved: None if nobody can tell.
        """
        place = self.at(pixel, trigger)
        if moved:
            self._free += place is None
            if place is not None:
                place.moved = True
            return
        if place is None:
            self.places.append(place := Place(pixel, trigger, []))
        place.actions.append(action)
        promise, released = chances
        place.promised = max(place.promised, promise)
        if moved is not None:
            place.empty *= 1 - promise
            place.waited *= 1 - (released if len(place.actions) > 1 else 0)

    def at(self, pixel: Sequence[int], trigger: int) -> Place | None:
        """The nearest place there, None where nothing was tried in vain."""
        near = (one for one in self.places if one.trigger == trigger and _apart(one.pixel, pixel) <= SAME)
        return min(near, key=lambda one: _apart(one.pixel, pixel), default=None)

    @property
    def share(self) -> float:
        """How many of the links of the board are expected to be held at first."""
        return float(self._belief() @ SHARES)

    def held(self, place: Place) -> float:
        """How probable it is that a link there, if there is one, is held."""
        held = SHARES * place.waited
        return float(self._belief() @ (held / np.maximum(held + (1 - SHARES) * place.empty, LEAST)))

    def with_what_opens(
        self, told: np.ndarray, works: np.ndarray, worth: np.ndarray, held: Sequence[Place], opened: np.ndarray
    ) -> np.ndarray:
        """What moves are worth together with trying as many of the places that are held as it is best to try after
        each of them, by the action.

        Args:
            told: of each by itself, float (M,).
            works: how probably each does what is expected of it, (M,).
            worth: what a link is worth that is there and found at each of F places, (F,).
            held: the places.
            opened: how probably what is held there moves after each move, (M, F).

        Returns:
            float (M,), no less than by itself.
        """
        if not held:
            return told
        there = np.array([self.held(one) * one.promised for one in held])
        best = -np.sort(-worth * there * opened, axis=1)
        sums = told[:, None] + works[:, None] * np.cumsum(best, axis=1)
        return np.maximum(told, (sums / (2 + np.arange(len(held)))).max(axis=1))

    def _belief(self) -> np.ndarray:
        """How probable each of `SHARES` is."""
        rest = len(SHARES) - 1
        told = np.where(SHARES > 0, (1 - NONE_HELD) / rest, NONE_HELD) * (1 - SHARES) ** self._free
        for place in self.places:
            told = told * (SHARES * place.waited + (1 - SHARES) * place.empty)
        return np.asarray(told / told.sum())


def _apart(one: Sequence[int], other: Sequence[int]) -> int:
    """The greater of the distances in rows and columns, pixels."""
    return max(abs(a - b) for a, b in zip(one, other, strict=True))
