"""The reasoners without training: `lookup`, and `persistence`, for which nothing ever changes.

`lookup` asks what happened when something close by was touched before. The graph is counted from the steps in which
features changed. To predict a step, the nearest past contact on the same trigger that changed something names the
responder; what it changes to is copied from the past change of that responder that began nearest to its present look. A
past change can also be undone: then the look *before* it is copied.
"""

import numpy as np
from pydantic import NonNegativeFloat, PositiveFloat

from busybot.common.frozen_model import FrozenModel
from busybot.reason.inputs.sequence import THRESHOLDS, BoardSequence, threshold_of
from busybot.reason.models.base import InferredGraph
from busybot.reason.models.counting import CountConfig, count_changes


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


class LookupConfig(FrozenModel):
    """Constants of the lookup.

    Attributes:
        changed: features that lie farther apart than this show a change.
        reach: contacts farther apart than this have nothing to do with each other, board units.
        fit: the present look may lie so far from the beginning of a past change, as a share of that change's size.
        direction: worth of an equal direction, as a share of a change's size: it decides between changes that began
            equally near.
        counting: priors of the graph.
    """

    changed: PositiveFloat = THRESHOLDS["embedded"]
    reach: PositiveFloat = 0.2
    fit: PositiveFloat = 0.5
    direction: NonNegativeFloat = 0.1
    counting: CountConfig = CountConfig()


class Lookup:
    """The reasoner without training.

    Args:
        encoder: whose features it is given.
        config: its `changed` belongs to the encoder; by default the threshold that was fixed for it.
    """

    name = "lookup"

    def __init__(self, encoder: str = "embedded", config: LookupConfig | None = None):
        self.encoder, self.config = encoder, config or LookupConfig(changed=threshold_of(encoder))

    def graph(self, seen: BoardSequence) -> InferredGraph:
        """Counted, as `count` does it, with changes told by features."""
        triggers, responders = np.flatnonzero(seen.triggers), np.flatnonzero(seen.responders)
        changed = change_sizes(seen) > self.config.changed
        probabilities = count_changes(changed, seen.acted, triggers, responders, self.config.counting)
        prior = seen.candidates * self.config.counting.controlled / max(1, len(triggers))
        return InferredGraph(self.name, probabilities, self.config.counting.claimed, prior)

    def predict(self, seen: BoardSequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """See `Reasoner`."""
        sizes = change_sizes(seen)
        edges = self.graph(seen).claimed(seen.steps)
        result = np.array(current, np.float32)
        for step, (action, trigger) in enumerate(zip(actions, acted, strict=True)):
            if trigger < 0:
                continue
            effective = np.where(edges[trigger] & (seen.acted == trigger)[:, None], sizes, 0)  # (T, N)
            effective[effective <= self.config.changed] = 0
            responder = self._responder(seen, effective, action)
            if responder is not None:
                look = self._target(seen, effective[:, responder], responder, current[step, responder], action)
                if look is not None:
                    result[step, responder] = look
        return result

    def _responder(self, seen: BoardSequence, effective: np.ndarray, action: np.ndarray) -> int | None:
        """What changed most when the nearest effective contact was made; effective is (T, N)."""
        steps = np.flatnonzero(effective.any(axis=1))
        if not len(steps):
            return None
        apart = np.linalg.norm(seen.actions[steps, :3] - action[:3], axis=1)
        nearest = int(apart.argmin())
        return int(effective[steps[nearest]].argmax()) if apart[nearest] <= self.config.reach else None

    def _target(
        self, seen: BoardSequence, sizes: np.ndarray, responder: int, look: np.ndarray, action: np.ndarray
    ) -> np.ndarray | None:
        """The copied look, (256,); sizes is (T,), 0 where the responder did not change."""
        steps = np.flatnonzero(sizes)
        before, after = seen.features[steps, responder], seen.features[steps + 1, responder]
        starts, ends = np.concatenate([before, after]), np.concatenate([after, before])
        alike = seen.actions[steps, 3:] @ action[3:]
        apart = np.linalg.norm(starts - look, axis=1) / np.tile(sizes[steps], 2)
        # repeating what was done is a better guess than undoing something else
        worth = -apart + self.config.direction * np.concatenate([alike, -alike - 0.1])
        best = int(worth.argmax())
        return np.asarray(ends[best]) if apart[best] <= self.config.fit else None


def change_sizes(seen: BoardSequence) -> np.ndarray:
    """How far each object's features move in each step, float (T, N)."""
    return np.asarray(np.linalg.norm(np.diff(seen.features, axis=0), axis=-1))
