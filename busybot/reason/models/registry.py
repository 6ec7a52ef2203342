"""Reasoners by name or folder, and inference from a recorded episode to a graph in one call.

`count` and `pc` read what was observed and infer a graph alone. The others are reasoners: they read features and
predict, too.
"""

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel
from busybot.episodes.episode import Episode
from busybot.reason.inputs.observation import ObservedEpisode, observe_episode
from busybot.reason.models.base import InferredGraph, Reasoner
from busybot.reason.models.counting import CountConfig, count
from busybot.reason.models.lookup import Lookup, LookupConfig
from busybot.reason.models.pc import PcConfig, discover
from busybot.reason.models.persistence import Persistence


class NoParameters(FrozenModel):
    """Of models that have none to set."""


def _persistence(_: NoParameters) -> Reasoner:
    return Persistence()


def _lookup(config: LookupConfig) -> Reasoner:
    return Lookup(config=config)


DEFAULT_REASONER = "event"
"""The shipped model that commands use when none is named."""
GRAPHS: dict[str, tuple[Callable[[ObservedEpisode, Any], InferredGraph], type[BaseModel]]] = {
    "count": (count, CountConfig),
    "pc": (discover, PcConfig),
}
"""What infers a graph from `ObservedEpisode` alone, with its parameters."""
REASONERS: dict[str, tuple[Callable[[Any], Reasoner], type[BaseModel]]] = {
    "lookup": (_lookup, LookupConfig),
    "persistence": (_persistence, NoParameters),
}
"""Reasoners without training, with their parameters."""


def config_class(model: str) -> type[BaseModel]:
    """The parameters that can be set of a model."""
    if model in GRAPHS:
        return GRAPHS[model][1]
    return REASONERS[model][1] if model in REASONERS else NoParameters


@lru_cache(maxsize=4)
def reasoner_of(model: str, config: BaseModel | None = None) -> Reasoner:
    """A reasoner by its name, or a trained model's name or folder; loaded once in a process.

    Args:
        config: its parameters, the defaults if None.

    Raises:
        BusybotError: there is no such model.
    """
    if model in REASONERS:
        make, parameters = REASONERS[model]
        return make(config or parameters())
    if model in GRAPHS:
        raise BusybotError(f"`{model}` predicts no states", f"choose {DEFAULT_REASONER}, lookup or a trained reasoner")
    from busybot.reason.models.model_folder import load_reasoner  # torch, which the others do without

    try:
        return load_reasoner(model)
    except BusybotError as error:
        if Path(model).exists():
            raise
        without = f"without training: {', '.join(REASONERS)}; for relations alone {', '.join(GRAPHS)}"
        raise BusybotError(error.what, f"{error.hint}; {without}") from None


def infer(episode: Episode | ObservedEpisode, model: str = "count", config: BaseModel | None = None) -> InferredGraph:
    """Which object controls which, after each step, from what a reasoner may read.

    Args:
        model: one of `GRAPHS`.
        config: parameters of the model, its defaults if None.

    Raises:
        BusybotError: there is no such model.
    """
    if model not in GRAPHS:
        what = f"there is no model {model!r} that infers relations without features"
        raise BusybotError(what, f"choose one of: {', '.join(GRAPHS)}")
    return GRAPHS[model][0](episode if isinstance(episode, ObservedEpisode) else observe_episode(episode), config)
