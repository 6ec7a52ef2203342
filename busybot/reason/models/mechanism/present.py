"""How a board stands that was not watched for a while: told by what it shows now, and by what is done to it.

A single step is asked about with nothing but its picture and its action. The action tells how its link stands, for a
link is pushed to where it is not. The others are taken to stand so that the responders show what they do, with as few
of them moved since the end of what was seen as possible. A memory (a toggle's, a latch's) is what such a responder
shows.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from busybot.reason.models.mechanism.contexts import (
    DELAYS,
    LONGEST,
    NOW,
    STATES,
    UNRELIABLE,
    Explanations,
    memories,
)
from busybot.reason.models.mechanism.perception import Perceived

MOST = 4096
"""So many combinations of the links' states are compared at most; with more, the links stand as they did."""
MOVED = 0.5
"""Cost, as a negative log probability, of a link that moved since it was seen."""
AGAINST = 3.0
"""Cost of a link that stands where the action cannot take it further, at worst."""
RARE = 0.05
"""Pseudo-count of what never followed a context."""
REST = LONGEST + DELAYS
"""After so many actions in which nothing moved no press is remembered, and nothing comes late."""
LEAST = -1
"""The contexts of what remembers presses lie between this and `LONGEST`."""


@dataclass(frozen=True)
class Past:
    """What explained a recording; T actions, L links, R responders, H explanations.

    Attributes:
        of: bool (R, T + 1), the moments that tell of these explanations.
        shares: float (R, H), probability of each explanation.
    """

    perceived: Perceived
    found: Explanations
    of: np.ndarray
    shares: np.ndarray

    def standing(self, shown: np.ndarray, action: np.ndarray, acted: int) -> np.ndarray:
        """States of the links before an action, int (L,).

        Args:
            shown: int (R,), states of the responders before it.
            action: float (6,), position and direction.
            acted: the object that is acted on, -1 for none.
        """
        trace = self.perceived.trace
        last = trace.links[-1]
        if not len(last) or math.prod(trace.sizes) > MOST:  # numpy's integers would begin anew beyond 2 ** 63
            return last
        ways = np.array(list(product(*map(range, trace.sizes))), int)
        score = -MOVED * (ways != last).sum(1) + self._likely(ways, shown)
        if (link := self.perceived.link_at(action, acted)) is not None:
            score += AGAINST * self.perceived.pushed_from(link, action)[ways[:, link]]
        return ways[score.argmax()]

    def _likely(self, ways: np.ndarray, shown: np.ndarray) -> np.ndarray:
        """Log probability of what is shown, by each responder's likeliest explanation, if that remembers nothing."""
        trace, told = self.perceived.trace, np.zeros(len(ways))
        links = trace.links.shape[1]
        for responder, best in enumerate(self.shares.argmax(1)):
            inputs = np.flatnonzero(self.found.inputs[best])
            if self.found.memory[best] not in (NOW, UNRELIABLE) or not len(inputs) or inputs.max() >= links:
                continue
            weights = STATES ** np.arange(len(inputs))
            equal = trace.links[:, inputs] @ weights == (ways[:, inputs] @ weights)[:, None]  # (ways, T + 1)
            counts = equal[:, self.of[responder]] @ np.eye(STATES)[trace.responders[self.of[responder], responder]]
            share = (counts[:, shown[responder]] + RARE) / (counts.sum(1) + STATES * RARE)
            told += np.where(counts.sum(1) > 0, np.log(share), -np.log(2))
        return told

    def remembered(self, rested: np.ndarray, after: np.ndarray, shown: np.ndarray) -> np.ndarray:
        """Contexts after an action, int (R, H), where what is remembered is what the responders showed before it.

        Args:
            rested: int (H,), contexts before it, if nothing had been pressed for long.
            after: int (H,), contexts after it.
            shown: int (R,), states before it.
        """
        contexts = np.tile(after, (len(shown), 1))
        odd, pressed = np.isin(self.found.memory[self._presses], memories("odd")), (rested != after)[self._presses]
        met, usual = self._usual
        fitting = met & (usual == shown)  # (P, V, R)
        rests = fitting[np.arange(len(odd)), rested[self._presses] - LEAST]
        latest = fitting.shape[1] - 1 - fitting[:, ::-1].argmax(1) + LEAST
        told = np.where((odd & pressed)[:, None], latest ^ 1, latest)
        other = fitting.any(1) & ~rests & ~(pressed & ~odd)[:, None]
        contexts[:, self._presses] = np.where(other.T, told.T, contexts[:, self._presses])
        return contexts

    @cached_property
    def _presses(self) -> np.ndarray:
        """int (P,), the explanations that remember presses."""
        return np.flatnonzero(np.isin(self.found.memory, memories("odd", "since", "last")))

    @cached_property
    def _usual(self) -> tuple[np.ndarray, np.ndarray]:
        """Of each context from `LEAST` on, whether it was met, bool (P, V), and what each responder mostly showed in
        it, int (P, V, R)."""
        equal = self.found.contexts[:, self._presses, None] == np.arange(LEAST, LONGEST + 1)  # (T + 1, P, V)
        shown = np.eye(STATES)[self.perceived.trace.responders] * self.of.T[..., None]
        counts = np.tensordot(equal.astype(float), shown, (0, 0))  # (P, V, R, S)
        return counts.sum(-1) > 0, counts.argmax(-1)
