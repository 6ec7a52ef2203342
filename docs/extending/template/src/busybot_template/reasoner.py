"""Blames what was touched when a responder changed last."""

import numpy as np

from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.base import InferredGraph
from busybot_template.encoder import MeanColour


class LastCause:
    """The trigger that was acted on when a responder changed last controls it; the next action undoes that change."""

    name, encoder = "lastcause", "meancolour"

    def graph(self, seen: BoardSequence) -> InferredGraph:
        probabilities = np.zeros((max(1, seen.steps), *seen.candidates.shape))
        for step, (trigger, changed) in enumerate(zip(seen.acted, self._changes(seen), strict=True)):
            if step:
                probabilities[step] = probabilities[step - 1]
            if trigger >= 0:
                probabilities[step][:, changed] = 0
                probabilities[step][trigger, changed] = 1
        return InferredGraph(self.name, probabilities * seen.candidates)

    def predict(self, seen: BoardSequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        result, changes = current.copy(), self._changes(seen)
        controls = self.graph(seen).claimed(seen.steps)
        for step, trigger in enumerate(acted):
            for j in np.flatnonzero(controls[trigger]) if trigger >= 0 else ():
                last = np.flatnonzero(changes[:, j])[-1]
                before, after = seen.features[last : last + 2, j]
                now = np.linalg.norm(current[step, j] - after) < np.linalg.norm(current[step, j] - before)
                result[step, j] = before if now else after
        return result

    @staticmethod
    def _changes(seen: BoardSequence) -> np.ndarray:
        """bool (T, N): which responders looked different after each step."""
        moved = np.linalg.norm(np.diff(seen.features, axis=0), axis=-1) > MeanColour.threshold
        return moved & seen.responders
