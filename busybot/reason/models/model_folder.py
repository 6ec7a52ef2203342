"""Trained models of relations: a folder with `weights.safetensors` and `model.json`, which says what they are."""

from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError
from torch import Tensor

from busybot.common.errors import BusybotError
from busybot.reason.models.base import Reasoner
from busybot.training.checkpoint import load_tensors, load_weights
from busybot.training.model_cards import INFO_FILE, WEIGHTS_FILE, ModelCard, find_folder, read_info
from busybot.training.weights import drawing_nothing


class ReasonerInfo(ModelCard):
    """What `model.json` says.

    Attributes:
        model: which kind.
        encoder: which features it reads.
        config: of the training; the networks' part tells their size.
    """

    model: Literal["event", "paper"]
    encoder: str
    config: dict[str, Any]


def load_reasoner(name_or_path: str | Path) -> Reasoner:
    """A shipped model by its name, or any by its folder (a training's folder stands for its final model).

    Raises:
        BusybotError: there is no such model, or its files are damaged or do not belong together.
    """
    folder = find_folder(name_or_path, "reason")
    info = read_info(folder, ReasonerInfo)
    tensors = load_tensors(folder / WEIGHTS_FILE).tensors
    try:
        with drawing_nothing():
            return _MAKERS[info.model](info, tensors, folder / WEIGHTS_FILE)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(["config", *map(str, first["loc"])])
        raise BusybotError(f"{folder / INFO_FILE}: {place}: {first['msg']}", "train the model again") from None


def _event(info: ReasonerInfo, tensors: dict[str, Tensor], file: Path) -> Reasoner:
    from busybot.reason.models.event.config import EventConfig
    from busybot.reason.models.event.networks import EventNet
    from busybot.reason.models.event.reasoner import EventReasoner

    config = EventConfig.model_validate(info.config)
    network = EventNet(config.net)
    load_weights(network, tensors, file)
    return EventReasoner(network, info.encoder, config.loss.blur)


def _paper(info: ReasonerInfo, tensors: dict[str, Tensor], file: Path) -> Reasoner:
    from busybot.reason.models.paper.config import PaperReasonConfig
    from busybot.reason.models.paper.networks import PaperHistoryNetwork, PaperNetwork
    from busybot.reason.models.paper.reasoner import PaperHistoryReasoner, PaperReasoner

    config = PaperReasonConfig.model_validate(info.config)
    network = PaperNetwork(config.network) if config.inference else PaperHistoryNetwork(config.network)
    load_weights(network, tensors, file)
    if isinstance(network, PaperNetwork):
        return PaperReasoner(network, info.encoder)
    return PaperHistoryReasoner(network, info.encoder)


_MAKERS = {"event": _event, "paper": _paper}
