"""Trained policies: a folder with `weights.safetensors` and `model.json`, which says what they are."""

from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict
from torch import Tensor

from busybot.errors import BusybotError
from busybot.plan.learned.network import NetConfig, PolicyNetwork
from busybot.reason.models import WEIGHTS_FILE
from busybot.training.checkpoint import load_tensors, load_weights, save_tensors
from busybot.training.model_folder import find_folder, read_info, write_info
from busybot.training.weights import drawing_nothing

Name = Literal["bc", "ppo"]


class PolicyInfo(BaseModel):
    """What `model.json` says.

    Attributes:
        agent: how it was trained.
        encoder: which features it reads.
        net: size of the network.
        training: provenance: configuration, datasets with hashes, seed, figures; JSON values.
        files: SHA-256 of the weights by name, written by saving.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal["1"] = "1"
    agent: Name
    encoder: str
    net: NetConfig = NetConfig()
    training: dict[str, Any] = {}
    files: dict[str, str] = {}


def save_policy(folder: Path, info: PolicyInfo, tensors: dict[str, Tensor]) -> None:
    """Write the folder, `model.json` last."""
    save_tensors(folder / WEIGHTS_FILE, tensors)
    write_info(folder, info, [folder / WEIGHTS_FILE])


def read_policy(name_or_path: str | Path, agent: Name) -> tuple[PolicyInfo, PolicyNetwork]:
    """A shipped policy by its name, or any by its folder (a training's folder stands for its final model).

    Args:
        agent: that it must be of.

    Raises:
        BusybotError: there is no such policy, or its files are damaged or do not belong together.
    """
    folder = find_folder(name_or_path, agent)
    info = read_info(folder, PolicyInfo)
    if info.agent != agent:
        raise BusybotError(f"{folder}: a policy of agent {info.agent}, not {agent}", f"name it as {info.agent}")
    with drawing_nothing():
        network = PolicyNetwork(info.net)
    load_weights(network, load_tensors(folder / WEIGHTS_FILE).tensors, folder / WEIGHTS_FILE)
    return info, network.eval()


load_policy = lru_cache(maxsize=4)(read_policy)
"""The same, read once in a process."""
