"""Trivial predictions that need no look at the board and stand beside every result: they say what a number is worth."""

import numpy as np

from busybot.boards.spec import BoardSpec
from busybot.common.rng import generator
from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.base import InferredGraph

NAMES = ("empty graph", "all-ones graph", "random trigger")


def trivial_graphs(board: BoardSpec, candidates: np.ndarray, seed: int) -> dict[str, np.ndarray]:
    """Edge probabilities (N, N) by name; candidates is bool (N, N).

    `random trigger` claims one trigger by chance for each responder. Its draws depend on (seed, split, board).
    """
    guess = np.zeros(candidates.shape)
    triggers, responders = np.flatnonzero(candidates.any(1)), np.flatnonzero(candidates.any(0))
    if len(triggers):
        rng = generator(seed, board.split, board.index, "reason/random-trigger")
        guess[rng.choice(triggers, size=len(responders)), responders] = 1.0
    return {
        "empty graph": np.zeros(candidates.shape),
        "all-ones graph": candidates.astype(float),
        "random trigger": guess,
    }


class Persistence:
    """A reasoner for which nothing controls anything and nothing ever changes."""

    name = "persistence"
    encoder = "embedded"

    def graph(self, seen: BoardSequence) -> InferredGraph:
        """No edges, float (max(T, 1), N, N)."""
        objects = len(seen.responders)
        return InferredGraph(self.name, np.zeros((max(seen.steps, 1), objects, objects)))

    def predict(self, seen: BoardSequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """The current features, (S, N, 256)."""
        return current.copy()
