"""What a reasoner says about one episode, as plain data: metrics, tables and pictures read it alike."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class InferredGraph:
    """Which object controls which, as believed after each step.

    Attributes:
        name: of the reasoner, e.g. "count".
        probabilities: float (T, N, N), T >= 1 steps, N objects; `[t, i, j]` is the probability, after step t (from 0),
            that object i (a trigger) controls object j (a responder). What is believed after step T - 1 stays.
        threshold: an edge is claimed when its probability is at least this.
    """

    name: str
    probabilities: np.ndarray
    threshold: float = 0.5

    def after(self, steps: int) -> np.ndarray:
        """Probabilities (N, N) after so many steps; zeros before the first."""
        if steps <= 0:
            return np.zeros(self.probabilities.shape[1:])
        return self.probabilities[min(steps, len(self.probabilities)) - 1]
