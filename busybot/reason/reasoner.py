"""What a model of relations can do."""

from typing import Protocol

import numpy as np

from busybot.reason.result import InferredGraph
from busybot.reason.sequence import Sequence


class Reasoner(Protocol):
    """Infers relations from what was observed on a board, and predicts what further actions do there.

    Attributes:
        name: for results.
        encoder: name of the features that it reads.
    """

    name: str
    encoder: str

    def graph(self, seen: Sequence) -> InferredGraph:
        """Probabilities (T, N, N) after each step of `seen`."""
        ...

    def predict(self, seen: Sequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """Features after each of S single steps, float32 (S, N, 256).

        Args:
            seen: what was observed before.
            current: float32 (S, N, 256), true features before each step.
            actions: float32 (S, 6), position and direction.
            acted: int (S,), index of the trigger acted on as far as boxes tell, -1 for none.
        """
        ...
