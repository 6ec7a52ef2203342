"""From what was recorded to a graph, for whoever only wants the answer."""

from busybot.episodes.episode import Episode
from busybot.errors import BusybotError
from busybot.reason.count import count
from busybot.reason.observed import Observed, observe
from busybot.reason.result import InferredGraph

MODELS = ("count",)


def infer(episode: Episode | Observed, model: str = "count") -> InferredGraph:
    """Which object controls which, after each step, from what a reasoner may read.

    Raises:
        BusybotError: there is no such model.
    """
    if model not in MODELS:
        raise BusybotError(f"unknown model {model!r}", f"choose one of: {', '.join(MODELS)}")
    return count(episode if isinstance(episode, Observed) else observe(episode))
