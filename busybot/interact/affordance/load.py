"""Loads interaction models of every variant: what `model.json` says decides which networks the weights belong to."""

from functools import partial
from pathlib import Path

from busybot.common.errors import naming
from busybot.interact.affordance.fast import AffordanceModel, weights_file
from busybot.interact.affordance.networks import KINDS
from busybot.interact.affordance.paper import PaperModel, refuse_former
from busybot.interact.policy.config import AffordanceInfo
from busybot.training.checkpoint import load_tensors, network_with
from busybot.training.model_cards import check_weights, find_folder, read_info

VARIANTS: dict[str, type[AffordanceModel]] = {"fast": AffordanceModel, "paper": PaperModel}


def find_model(name_or_path: str | Path) -> Path:
    """The folder that a name or a path means."""
    return find_folder(name_or_path, "interact")


def load_model(name_or_path: str | Path) -> AffordanceModel:
    """A shipped model by its name, or any by its folder (a training's folder stands for its final model).

    Raises:
        BusybotError: there is no such model, or its files are damaged, of a former version, or do not
            belong together.
    """
    folder = find_model(name_or_path)
    info = read_info(folder, AffordanceInfo)
    variant, networks = VARIANTS[info.variant], {}
    for kind in KINDS:
        file = weights_file(folder, kind)
        tensors = load_tensors(file).tensors
        check_weights(file, info)
        if info.variant == "paper":
            refuse_former(file, tensors)
        with naming(file):
            networks[kind] = network_with(partial(variant.make_network, kind, info.inputs, tensors), tensors, file)
    return variant(info, networks)
