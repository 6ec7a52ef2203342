"""What did not move may be a link that a responder holds: how often that is so on a board, and of which places.

A place where an action moved nothing has no link, or has one that is pushed otherwise, or one that is held as things
are. The more that promised much did not move at its first try, the more links a board holds: what share of its links
that is, is inferred (Bayes), where half of all boards hold none. A place that promised much is then more probably held
than empty, so that trying it again is of little use until something looks otherwise, and it tells less of others.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

SAME = 10
"""Places are one if they are so near to each other in rows and columns, pixels: most neighbouring links are farther
apart."""
SHARES = np.arange(10) / 10
"""Of a board's links so many may be held."""
LEAST = 1e-12
"""What is less probable is not told apart."""
SUREST = 0.95
"""Nothing promises more, nor is more surely let go: an action may fail for no reason."""
NONE_HELD = 0.5
"""How probable it is that a board holds none; all other shares are alike."""


@dataclass
class Place:
    """Where an action moved nothing, as far as anybody could tell.

    Attributes:
        pixel: (u, v), of the first one.
        trigger: the object there.
        actions: which of the board's actions took hold there without moving it, from 0.
        promised: how probable it seemed at most that there is a link.
        empty: how probable what came of the actions is if nothing was held there.
        waited: how probable that is if a link was, at first.
        moved: whether a link was seen moving there later.
    """

    pixel: tuple[int, int]
    trigger: int
    actions: list[int] = field(default_factory=list)
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
        self._belief = self._inferred()

    def tried(
        self, action: int, pixel: tuple[int, int], trigger: int, chances: tuple[float, float], moved: bool | None
    ) -> None:
        """Remember an action.

        Args:
            action: its number, from 0.
            pixel, trigger: where it took hold, (u, v), and on which object.
            chances: how probable it was that something moves there if nothing is held, and if something was held when
                the place was tried before.
            moved: None if nobody can tell.
        """
        promise, released = (min(one, SUREST) for one in chances)
        place = self.at(pixel, trigger)
        if place is None and moved:
            self._free += 1
        elif place is None:
            place, released = Place(pixel, trigger), 0.0
            self.places.append(place)
        if place is not None:
            self._outcome(place, action, promise, released, moved)
        self._belief = self._inferred()

    def _outcome(self, place: Place, action: int, promise: float, released: float, moved: bool | None) -> None:
        if moved:
            place.moved = True
        else:
            place.actions.append(action)
            place.promised = max(place.promised, promise)
        if moved is not None:
            place.empty = max(LEAST, place.empty * (promise if moved else 1 - promise))
            place.waited = max(LEAST, place.waited * (released if moved else 1 - released))

    def at(self, pixel: Sequence[int], trigger: int) -> Place | None:
        """The nearest place there of which no link was seen moving, None where nothing was tried in vain."""
        near = (
            one for one in self.places if one.trigger == trigger and not one.moved and _apart(one.pixel, pixel) <= SAME
        )
        return min(near, key=lambda one: _apart(one.pixel, pixel), default=None)

    @property
    def share(self) -> float:
        """How many of the links of the board are expected to be held at first."""
        return float(self._belief @ SHARES)

    def held(self, place: Place) -> float:
        """How probable it is that a link there, if there is one, is held."""
        held = SHARES * place.waited
        return float(self._belief @ (held / np.maximum(held + (1 - SHARES) * place.empty, LEAST)))

    def with_what_opens(
        self, told: np.ndarray, works: np.ndarray, worth: np.ndarray, held: Sequence[Place], opened: np.ndarray
    ) -> np.ndarray:
        """What moves are worth with what they open: after each of them as many of the places that are held are tried as
        it is best to try, and the mean over all these actions is what counts.

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

    def _inferred(self) -> np.ndarray:
        """How probable each of `SHARES` is."""
        rest = len(SHARES) - 1
        told = np.where(SHARES > 0, (1 - NONE_HELD) / rest, NONE_HELD) * (1 - SHARES) ** self._free
        for place in self.places:
            told = told * (SHARES * place.waited + (1 - SHARES) * place.empty)
            told = told / told.sum()
        return np.asarray(told / told.sum())


def _apart(one: Sequence[int], other: Sequence[int]) -> int:
    """The greater of the distances in rows and columns, pixels."""
    return max(abs(a - b) for a, b in zip(one, other, strict=True))
