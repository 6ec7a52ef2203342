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
