"""Reasoners by name or folder, and inference from a recorded episode to a graph in one call.

`count` and `pc` read what was observed and infer a graph alone. The others are reasoners: they read features and
predict, too. A trained one is a folder with `weights.safetensors` and `model.json`, which says what it is.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import BaseModel, ValidationError

from busybot.boards.spec import PAPER
from busybot.boards.worlds import BUILT
from busybot.common import plugins
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel, first_fault
from busybot.datasets.dataset import Dataset
from busybot.episodes.episode import Episode
from busybot.reason.inputs.observation import ObservedEpisode, observe_episode
from busybot.reason.models.base import InferredGraph, Reasoner
from busybot.reason.models.counting import CountConfig, PcConfig, count, discover
from busybot.reason.models.lookup import Lookup, LookupConfig, Persistence
from busybot.training.model_cards import INFO_FILE, WEIGHTS_FILE, ModelCard, check_weights, find_folder, read_info

if TYPE_CHECKING:
    from torch import Tensor

    from busybot.reason.models.event.config import EventConfig
    from busybot.reason.models.mechanism.config import MechanismConfig
    from busybot.reason.models.paper.config import PaperReasonConfig


class ReasonerInfo(ModelCard):
    """What `model.json` says.

    Attributes:
        model: which kind.
        encoder: which features it reads.
        config: of the training; the networks' part tells their size.
    """

    model: Literal["event", "mechanism", "paper"]
    encoder: str
    config: dict[str, Any]


def load_reasoner(name_or_path: str | Path) -> Reasoner:
    """A shipped model by its name, or any by its folder (a training's folder stands for its final model).

    Raises:
        BusybotError: there is no such model, or its files are damaged or do not belong together.
    """
    from busybot.training.checkpoint import load_tensors  # torch only where it is needed

    folder = find_folder(name_or_path, "reason")
    info = read_info(folder, ReasonerInfo)
    tensors = load_tensors(folder / WEIGHTS_FILE).tensors
    check_weights(folder / WEIGHTS_FILE, info)
    try:
        return _trained(info, tensors, folder / WEIGHTS_FILE)
    except ValidationError as error:
        raise BusybotError(f"{folder / INFO_FILE}: config.{first_fault(error)}", "train the model again") from None


def _trained(info: ReasonerInfo, tensors: "dict[str, Tensor]", file: Path) -> Reasoner:
    from busybot.training.checkpoint import network_with

    if info.model == "event":
        from busybot.reason.models.event.config import EventConfig
        from busybot.reason.models.event.networks import EventReasoner

        event = EventConfig.model_validate(info.config)
        return EventReasoner(network_with(lambda: make_network(event), tensors, file), info.encoder, event.loss.blur)
    if info.model == "mechanism":
        from busybot.reason.models.mechanism.config import MechanismConfig
        from busybot.reason.models.mechanism.reasoner import MechanismReasoner

        mechanism = MechanismConfig.model_validate(info.config)
        return MechanismReasoner(network_with(lambda: make_network(mechanism), tensors, file), info.encoder)
    from busybot.reason.models.paper.config import PaperReasonConfig
    from busybot.reason.models.paper.networks import PaperReasoner
    from busybot.training.device import device

    config = PaperReasonConfig.model_validate(info.config)
    network = network_with(lambda: make_network(config), tensors, file)
    return PaperReasoner(network.to(device()), info.encoder)


def make_network(config: "EventConfig | MechanismConfig | PaperReasonConfig") -> Any:
    """The untrained network of a training with these parameters."""
    if config.model == "event":
        from busybot.reason.models.event.networks import EventNet

        return EventNet(config.net)
    if config.model == "mechanism":
        from busybot.reason.models.mechanism.networks import MechanismNet

        return MechanismNet(config.net)
    from busybot.reason.models.paper.networks import network_of

    return network_of(config)


def usual_reasoner(dataset: Dataset) -> str:
    """The shipped model that knows the mechanisms of a dataset's boards; of boards of other simulators, the paper's."""
    world = dataset.info.generator.config.get("world")
    return DEFAULT_REASONER if world in (None, PAPER, *BUILT) else WORLDS_REASONER


class NoParameters(FrozenModel):
    """Of models that have none to set."""


DEFAULT_REASONER, WORLDS_REASONER = "event", "mechanism"
"""The shipped models that commands use when none is named: on the paper's boards, and in worlds beyond."""
GRAPHS: dict[str, tuple[Callable[[ObservedEpisode, Any], InferredGraph], type[BaseModel]]] = {
    "count": (count, CountConfig),
    "pc": (discover, PcConfig),
}
"""What infers a graph from `ObservedEpisode` alone, with its parameters."""
REASONERS: dict[str, tuple[Callable[[Any], Reasoner], type[BaseModel]]] = {
    "lookup": (lambda config: Lookup(config=config), LookupConfig),
    "persistence": (lambda _: Persistence(), NoParameters),
}
"""Reasoners without training, with their parameters."""


def without_training() -> dict[str, tuple[Callable[[Any], Reasoner], type[BaseModel]]]:
    """`REASONERS`, and those of packages (entry-point group `busybot.reasoners`), which have no parameters to set."""
    brought = {name: (partial(_brought, name), NoParameters) for name in plugins.names("reasoners")}
    return {**brought, **REASONERS}


def _brought(name: str, config: BaseModel) -> Reasoner:
    reasoner: Reasoner = plugins.make("reasoners", name)
    return reasoner


def config_class(model: str) -> type[BaseModel]:
    """The parameters that can be set of a model."""
    if model in GRAPHS:
        return GRAPHS[model][1]
    return without_training()[model][1] if model in without_training() else NoParameters


@lru_cache(maxsize=32)
def reasoner_of(model: str, config: BaseModel | None = None) -> Reasoner:
    """A reasoner by its name, or a trained model's name or folder; loaded once in a process.

    Args:
        config: its parameters, the defaults if None.

    Raises:
        BusybotError: there is no such model.
    """
    if model in without_training():
        make, parameters = without_training()[model]
        return make(config or parameters())
    if model in GRAPHS:
        raise BusybotError(f"`{model}` predicts no states", f"choose {DEFAULT_REASONER}, lookup or a trained reasoner")
    try:
        return load_reasoner(model)
    except BusybotError as error:
        if Path(model).exists():
            raise
        without = f"without training: {', '.join(without_training())}; for relations alone {', '.join(GRAPHS)}"
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
