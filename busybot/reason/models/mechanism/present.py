"""How a board stands that was not watched for a while: told by what it shows now, and by what is done to it.

A single step is asked about with nothing but its picture and its action. The action tells how its link stands, for a
link is pushed to where it is not. The others are taken to stand so that the responders show what they do, with as few
of them moved since the end of what was seen as possible. A memory (a toggle's, a latch's) is what such a responder
shows.
"""

from dataclasses import dataclass, field
from itertools import product

import numpy as np

from busybot.reason.models.mechanism.contexts import DELAYS, LONGEST, MEMORIES, STATES, Explanations
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
_STATELESS = [MEMORIES.index(name) for name in ("none", "late 0", "own and now")]
_ODD = [number for number, name in enumerate(MEMORIES) if name.startswith("odd")]
_PRESSED = [number for number, name in enumerate(MEMORIES) if name.startswith(("odd", "since", "last"))]


@dataclass(frozen=True)
class Past:
    """What explained a recording; T actions, L links, R responders, H explanations.

    Attributes:
        shares: float (R, H), probability of each explanation.
    """

    perceived: Perceived
    found: Explanations
    shares: np.ndarray
    _shown: dict[int, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    def standing(self, shown: np.ndarray, action: np.ndarray, acted: int) -> np.ndarray:
        """States of the links before an action, int (L,).

        Args:
            shown: int (R,), states of the responders before it.
            action: float (6,), position and direction.
            acted: the object that is acted on, -1 for none.
        """
        trace = self.perceived.trace
        last = trace.links[-1]
        if not len(last) or np.prod(trace.sizes) > MOST:
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
            if self.found.memory[best] not in _STATELESS or not len(inputs) or inputs.max() >= links:
                continue
            weights = STATES ** np.arange(len(inputs))
            equal = trace.links[:, inputs] @ weights == (ways[:, inputs] @ weights)[:, None]  # (ways, T + 1)
            counts = equal @ np.eye(STATES)[trace.responders[:, responder]]
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
        for number in np.flatnonzero(np.isin(self.found.memory, _PRESSED)):
            odd, pressed = self.found.memory[number] in _ODD, rested[number] != after[number]
            if pressed and not odd:
                continue
            values, usual = self._usual(int(number))
            for responder, states in enumerate(usual):
                [fitting] = np.nonzero(states == shown[responder])
                if len(fitting) and rested[number] not in values[fitting]:
                    context = int(values[fitting[-1]])
                    contexts[responder, number] = context ^ 1 if odd and pressed else context
        return contexts

    def _usual(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """The contexts of an explanation that were met, (V,), and what each responder mostly showed in them, (R, V)."""
        if number not in self._shown:
            values, which = np.unique(self.found.contexts[:, number], return_inverse=True)
            counts = np.zeros((len(values), STATES, self.perceived.trace.responders.shape[1]), int)
            for context, states in zip(which, self.perceived.trace.responders, strict=True):
                counts[context, states, np.arange(len(states))] += 1
            self._shown[number] = values, counts.argmax(1).T
        return self._shown[number]
