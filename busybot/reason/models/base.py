"""The interface of reasoners: the graph that they infer and the predictions that they make.

What a reasoner says about one episode, as plain data: metrics, tables and pictures read it alike.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from busybot.reason.inputs.sequence import BoardSequence


@dataclass(frozen=True)
class InferredGraph:
    """Which object controls which, as believed after each step.

    Attributes:
        name: of the reasoner, e.g. "count".
        probabilities: float (T, N, N), T >= 1 steps, N objects; `[t, i, j]` is the probability, after step t (from 0),
            that object i (a trigger) controls object j (a responder). What is believed after step T - 1 stays.
        threshold: an edge is claimed when its probability exceeds this.
        prior: float (N, N), what is believed before the first step; zeros if None.
    """

    name: str
    probabilities: np.ndarray
    threshold: float = 0.5
    prior: np.ndarray | None = None

    def after(self, steps: int) -> np.ndarray:
        """Probabilities (N, N) after so many steps; the prior before the first."""
        if steps <= 0:
            return np.zeros(self.probabilities.shape[1:]) if self.prior is None else self.prior
        return self.probabilities[min(steps, len(self.probabilities)) - 1]

    def claimed(self, steps: int) -> np.ndarray:
        """Edges claimed after so many steps, bool (N, N)."""
        return np.asarray(self.after(steps) > self.threshold)


class Reasoner(Protocol):
    """Infers which trigger controls which responder and predicts what an action changes. N objects.

    Attributes:
        name: for tables.
        encoder: which features it reads (`busybot features --encoder`).
    """

    name: str
    encoder: str

    def graph(self, seen: BoardSequence) -> InferredGraph:
        """Edge probabilities after each of the T steps of `seen`; one entry, the prior, if there is none."""
        ...

    def predict(self, seen: BoardSequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """Features after each of S steps that are not part of what was seen; every step is judged on its own.

        Args:
            seen: the observed part of the episode (23 images in the paper).
            current: float32 (S, N, 256), true features before each step.
            actions: float32 (S, 6), position (board frame, board units) and direction.
            acted: int (S,), index of the trigger acted on, -1 for none.

        Returns:
            float32 (S, N, 256).
        """
        ...
