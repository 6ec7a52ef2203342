"""What a model of relations and effects has to offer, whatever is inside."""

from typing import Protocol

import numpy as np

from busybot.reason.result import InferredGraph
from busybot.reason.sequence import Sequence


class Reasoner(Protocol):
    """Infers which trigger controls which responder and predicts what an action changes. N objects.

    Attributes:
        name: for tables.
        encoder: which features it reads (`busybot features --encoder`).
    """

    name: str
    encoder: str

    def graph(self, seen: Sequence) -> InferredGraph:
        """Edge probabilities after each of the T steps of `seen`; one entry, the prior, if there is none."""
        ...

    def predict(self, seen: Sequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
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
