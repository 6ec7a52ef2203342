"""Prioritised replay: rare successes and hard failures are shown more often than what is known.

Each sample's priority is a running mean of its loss. A batch holds a fixed share of successes, drawn by priority; the
others are failures, drawn by priority times a weight for those of later rounds. The paper draws half and half,
uniformly (appendix A.1).
"""

import numpy as np

from busybot.common.errors import BusybotError
from busybot.interact.training.config import ReplayConfig

HINT = {
    "succeeded": "or lower the reward's threshold: --set interaction.delta=500",
    "failed": "with a policy that fails, too: both kinds are learned from",
}


class Priorities:
    """Running mean losses of all samples, float32 (N,), which grow with the samples."""

    def __init__(self, config: ReplayConfig, values: np.ndarray | None = None):
        self.config = config
        self.values = np.empty(0, np.float32) if values is None else values.astype(np.float32)

    def grow(self, count: int) -> None:
        """Make room for samples that were recorded since."""
        new = np.full(max(0, count - len(self.values)), self.config.initial, np.float32)
        self.values = np.concatenate([self.values, new])

    def draw(
        self, reward: np.ndarray, weights: np.ndarray, first: int, count: int, rng: np.random.Generator
    ) -> np.ndarray:
        """Indices of a batch's samples among those of the window.

        Args:
            reward: bool (N,), of the window's samples.
            weights: float (N,), of the failures among them.
            first: number of the window's first sample.
        """
        config = self.config
        priority = np.clip(self.values[first : first + len(reward)], config.lowest, config.highest).astype(float)
        positives = round(count * config.positives)
        return np.concatenate(
            [
                _draw(np.where(reward, priority, 0), positives, rng, "succeeded"),
                _draw(np.where(reward, 0, priority * weights), count - positives, rng, "failed"),
            ]
        )

    def update(self, numbers: np.ndarray, losses: np.ndarray) -> None:
        """Enter the losses (B,) of the samples with these numbers (B,); of one that was drawn twice the last counts."""
        config = self.config
        old = self.values[numbers]
        self.values[numbers] = config.memory * old + (1 - config.memory) * np.minimum(losses, config.highest_loss)


def _draw(weights: np.ndarray, count: int, rng: np.random.Generator, kind: str) -> np.ndarray:
    """`count` indices, with replacement, by weight."""
    total = np.cumsum(weights)
    if not len(total) or total[-1] <= 0:
        raise BusybotError(f"no recorded action {kind}", f"record more boards, {HINT[kind]}")
    drawn = np.searchsorted(total, rng.random(count) * total[-1], side="right")
    return np.minimum(drawn, np.flatnonzero(weights)[-1])
