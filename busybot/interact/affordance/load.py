"""Loads interaction models of every variant: what `model.json` says decides which networks the weights belong to."""

from pathlib import Path

from busybot.interact.affordance.fast import AffordanceInfo, AffordanceModel, weights_file
from busybot.interact.affordance.networks import KINDS
from busybot.interact.affordance.paper import PaperModel
from busybot.training.checkpoint import drawing_nothing, load_tensors, load_weights
from busybot.training.model_cards import find_folder, read_info

VARIANTS: dict[str, type[AffordanceModel]] = {"fast": AffordanceModel, "paper": PaperModel}


def find_model(name_or_path: str | Path) -> Path:
    """The folder that a name or a path means."""
    return find_folder(name_or_path, "interact")


def load_model(name_or_path: str | Path) -> AffordanceModel:
    """A shipped model by its name, or any by its folder (a training's folder stands for its final model).

    Raises:
        BusybotError: there is no such model, or its files are damaged or do not belong together.
    """
    folder = find_model(name_or_path)
    info = read_info(folder, AffordanceInfo)
    variant, networks = VARIANTS[info.variant], {}
    for kind in KINDS:
        file = weights_file(folder, kind)
        tensors = load_tensors(file).tensors
        with drawing_nothing():
            networks[kind] = variant.make_network(kind, info.inputs, tensors)
        load_weights(networks[kind], tensors, file)
    return variant(info, networks)
