"""What the relations of a board have in common where each responder follows one link or none, for evaluators only.

In worlds whose mechanisms are drawn responder by responder, what is seen of one says nothing of another. On the paper's
boards, on the twin of its real board and in scenes it does: a link that controls one responder controls no other, and
every link that is not idle controls one. Of scenes that is all that is taken into account: not which things are
targets, nor that a group's first board has its controls and targets in one order (`boards.scenes`).

Nothing that infers, predicts, explores or plans may import this module.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

MOST = 16
"""So many responders are weighed together; on boards with more of them each is believed in by itself."""


class Wiring(Protocol):
    """Which assignments of L links to R responders a board may have, and how probable each is."""

    def shares(self, likely: np.ndarray) -> np.ndarray:
        """How probable it is that each responder follows each link, and in the last row that it follows none, float
        (L + 1, R); all are 0 if no assignment explains what was seen.

        Args:
            likely: float (L + 1, R), how probable it is to show what was seen for what follows each link, or none.
        """
        ...


@dataclass(frozen=True)
class Listed:
    """One of several wirings, equally probable.

    Attributes:
        wirings: the link that each responder follows, L for none.
    """

    wirings: tuple[tuple[int, ...], ...]

    def shares(self, likely: np.ndarray) -> np.ndarray:
        """See `Wiring`."""
        found, columns = np.zeros(likely.shape), np.arange(likely.shape[1])
        for wiring in map(list, self.wirings):
            found[wiring, columns] += likely[wiring, columns].prod()
        return np.asarray(found / max(found[:, 0].sum(), np.finfo(float).tiny))


@dataclass(frozen=True)
class Drawn:
    """One link after the other takes a responder that suits it and is free, as `boards.relations` draws it.

    Attributes:
        suits: for each link that chooses, in their order, which responders it may control.
        places: the numbers of these links on the board.
    """

    suits: tuple[tuple[bool, ...], ...]
    places: tuple[int, ...]

    def shares(self, likely: np.ndarray) -> np.ndarray:
        """See `Wiring`: exact; of more than `MOST` responders each by itself."""
        likely = likely / np.maximum(likely.max(0), np.finfo(float).tiny)
        suits = np.array(self.suits, bool).reshape(len(self.places), likely.shape[1])
        told = np.concatenate([np.where(suits, likely[list(self.places)], 0.0), likely[-1:]])
        found = np.zeros(likely.shape)
        found[[*self.places, -1]] = self._together(told) if likely.shape[1] <= MOST else _by_itself(suits, told)
        return found

    def _together(self, told: np.ndarray) -> np.ndarray:
        """Shares of all assignments: forward and backward over the links, by which responders are taken already.

        Args:
            told: float (links that choose + 1, R), as `likely` of `shares`.
        """
        taken = np.arange(2 ** told.shape[1])  # sets of responders, a bit for each
        frees = [(responder, taken[(taken >> responder) & 1 == 0]) for responder in range(told.shape[1])]
        each = [self._each(number, taken) for number in range(len(self.places))]
        before = [(taken == 0).astype(float)]  # how probable it is that these are taken, and what they showed
        for one, choice in zip(told, each, strict=False):
            chosen, later = before[-1] * choice, np.zeros(len(taken))
            for responder, free in frees:
                later[free | 1 << responder] += chosen[free] * one[responder]
            before.append(later)
        after = np.ones(len(taken))  # what is shown by those that are not taken then, whoever takes them
        for responder, free in frees:
            after[free] *= told[-1, responder]
        total, found = float(before[-1] @ after), np.zeros(told.shape)
        for number in reversed(range(len(each))):
            earlier = np.zeros(len(taken))
            for responder, free in frees:
                follows = told[number, responder] * each[number][free] * after[free | 1 << responder]
                found[number, responder] = before[number][free] @ follows
                earlier[free] += follows
            after = earlier
        found = found / max(total, np.finfo(float).tiny)
        found[-1] = (1 - found.sum(0)).clip(0) * (told[-1] > 0) * (total > 0)
        return found

    def _each(self, number: int, taken: np.ndarray) -> np.ndarray:
        """How probable each choice of a link is, by what is taken; 0 where none is left."""
        suits = sum(1 << responder for responder, suited in enumerate(self.suits[number]) if suited)
        left = np.bitwise_count(suits & ~taken)
        return np.divide(1.0, left, out=np.zeros(len(taken)), where=left > 0)


def _by_itself(suits: np.ndarray, told: np.ndarray) -> np.ndarray:
    """Shares of each responder alone, as if what one link takes were taken from all that suit it alike.

    Args:
        suits: bool (links that choose, R).
        told: float (links that choose + 1, R), as `likely` of `Drawn.shares`.
    """
    drawn = np.zeros(told.shape)
    for number, suited in enumerate(suits):
        left = suited * (1 - drawn[:number].sum(0))
        drawn[number] = left / max(left.sum(), np.finfo(float).tiny)
    drawn[-1] = (1 - drawn[:-1].sum(0)).clip(0)
    found = drawn * told
    return np.asarray(found / np.maximum(found.sum(0), np.finfo(float).tiny))
