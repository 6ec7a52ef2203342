"""Small made-up boards and networks for the tests of the `paper` model."""

import numpy as np

from busybot.reason.inputs.sequence import CHANNELS, BoardSequence
from busybot.reason.models.paper.config import PaperNetworkConfig

SMALL = PaperNetworkConfig(
    objects=6, embedding=7, edge_embedding=3, action=5, hidden=8, convolution=9, recurrent=6, dropout=0.0
)


def watched(seed: int = 0, triggers: int = 2, responders: int = 3, steps: int = 6) -> BoardSequence:
    """A board whose last responder takes turns between two looks whenever the first trigger is acted on."""
    rng = np.random.default_rng(seed)
    count = triggers + responders
    is_trigger = np.arange(count) < triggers
    acted = rng.integers(0, triggers, steps)
    looks = rng.normal(size=(2, count, CHANNELS)).astype(np.float32)
    state = np.concatenate([[0], np.cumsum(acted == 0) % 2])
    features = np.repeat(looks[:1], steps + 1, 0)
    features[:, -1] = looks[state, -1]
    features[:, is_trigger] = 0
    return BoardSequence(
        features=features,
        positions=rng.normal(size=(count, 3)).astype(np.float32),
        actions=rng.normal(size=(steps, 6)).astype(np.float32),
        acted=acted.astype(np.int64),
        triggers=is_trigger,
        responders=~is_trigger,
    )
