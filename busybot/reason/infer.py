"""From what was recorded to a graph, for whoever only wants the answer."""

from busybot.episodes.episode import Episode
from busybot.errors import BusybotError
from busybot.reason.count import CountConfig, count
from busybot.reason.observed import Observed, observe
from busybot.reason.result import InferredGraph

MODELS = ("count",)


def check_model(model: str) -> None:
    """Refuse the name of a model that does not exist."""
    if model not in MODELS:
        raise BusybotError(f"there is no model {model!r} of relations", f"choose one of: {', '.join(MODELS)}")


def infer(episode: Episode | Observed, model: str = "count", config: CountConfig | None = None) -> InferredGraph:
    """Which object controls which, after each step, from what a reasoner may read.

    Args:
        config: parameters of `count`, its defaults if None.

    Raises:
        BusybotError: there is no such model.
    """
    check_model(model)
    return count(episode if isinstance(episode, Observed) else observe(episode), config)
