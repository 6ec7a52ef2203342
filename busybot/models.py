"""Trained models as files: which there are, what their folders say about them, and whether they are whole.

A model is a folder with `model.json` and weights as safetensors, whatever the skill; `interact.affordance.load` and
`reason.models.registry` load them. Here `load_model` and `verify` do, whatever the skill; nothing else needs torch.
"""

from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ConfigDict
from safetensors import SafetensorError, safe_open

from busybot.common.atomic_io import RESTORE, inside, open_regular, regular_files, sha256_of
from busybot.common.errors import BusybotError, without_name
from busybot.common.limits import MAX_WEIGHTS_BYTES
from busybot.training.model_cards import INFO_FILE, SHIPPED, Hashes, Training, find_folder, read_info, rounds_of

if TYPE_CHECKING:
    from busybot.interact.affordance.fast import AffordanceModel
    from busybot.plan.learning.network import PolicyNetwork
    from busybot.reason.models.base import Reasoner

CARD_FILE = "README.md"
WEIGHTS = ".safetensors"
NOT_FIGURES = ("seed", "config", "rounds", "data", "versions", "validation", "figures")
"""Keys of a card's `training` that say where a model comes from, not how good it is."""


class Card(BaseModel):
    """What the cards of all skills have in common; each has more, which its loader checks.

    Attributes:
        variant: which networks, of interaction models.
        model: which networks, of models of relations.
        agent: how it was trained, of policies that plan.
        files: SHA-256 by name; empty in folders from before hashes were recorded.
        training: provenance.
    """

    model_config = ConfigDict(frozen=True, extra="allow")

    variant: str | None = None
    model: str | None = None
    agent: str | None = None
    files: Hashes = {}
    training: Training = {}


@dataclass(frozen=True)
class ModelDescription:
    """What a model's folder tells.

    Attributes:
        name: by which commands know it: a shipped model's name, else its folder.
        skill: interact, reason or plan.
        kind: which networks, or how a policy that plans was trained.
        shipped: part of the package.
        folder: where it lies.
        bytes: of all its files.
        parameters: trained values.
        hashes: SHA-256 of the weights as `model.json` records them; empty if it records none.
        data: the datasets it was trained on, with their hashes.
        figures: what the training measured.
        licence: an SPDX identifier; None if nothing is recorded.
        card: the file for people.
    """

    name: str
    skill: str
    kind: str
    shipped: bool
    folder: Path
    bytes: int
    parameters: int
    hashes: dict[str, str]
    seed: int | None
    data: list[dict[str, Any]]
    figures: dict[str, Any]
    versions: dict[str, str]
    licence: str | None
    card: Path | None


@dataclass(frozen=True)
class ModelVerdict:
    """What `verify` found.

    Attributes:
        hashes: whether `model.json` records hashes to compare with.
        loads: whether the networks took the weights.
        problems: in words, each naming its file; empty if the model is whole.
    """

    name: str
    skill: str
    kind: str
    hashes: bool
    loads: bool
    problems: list[str]

    @property
    def ok(self) -> bool:
        return not self.problems


def shipped_models() -> list[Path]:
    """Folders of the models that are part of the package."""
    return sorted(path.parent for place in SHIPPED.values() for path in place.glob(f"*/{INFO_FILE}"))


def models_below(folder: Path) -> list[Path]:
    """Folders of models in a folder, itself included; no link is followed.

    Raises:
        BusybotError: there is no such folder, or it has no model.
    """
    if not folder.is_dir():
        raise BusybotError(f"{folder}: there is no such folder", "name one that models lie in, or leave it out")
    found = sorted(regular_files(folder, INFO_FILE.__eq__))
    if not found:
        raise BusybotError(f"{folder}: no {INFO_FILE} lies in it", "`busybot train interact --out DIR` makes a model")
    return [path.parent for path in found]


def find(name_or_path: str) -> Path:
    """The folder of a model of any skill, by its name or path; a training's folder stands for its final model."""
    return find_folder(name_or_path, *SHIPPED)


def load_model(name_or_path: str | Path) -> "AffordanceModel | Reasoner | PolicyNetwork":
    """A trained model of any skill, ready for use.

    Args:
        name_or_path: a shipped model's name (`procedural` acts, `event` infers relations), or a model's folder; a
            training's folder stands for its final model.

    Raises:
        BusybotError: there is no such model, or its files are damaged or do not belong together.
    """
    folder = find(str(name_or_path))
    _, skill, kind = _card(folder)
    return _loaded(folder, skill, kind)


def describe_model(folder: Path) -> ModelDescription:
    """Read what a model's folder says about it.

    Raises:
        BusybotError: `model.json` or a file of weights cannot be read.
    """
    card, skill, kind = _card(folder)
    training, shipped, readme = card.training, folder.parent in SHIPPED.values(), folder / CARD_FILE
    told = {key: value for key, value in training.items() if key not in NOT_FIGURES}
    return ModelDescription(
        name=_name(folder),
        skill=skill,
        kind=kind,
        shipped=shipped,
        folder=folder,
        bytes=sum(path.stat().st_size for path in folder.iterdir() if path.is_file()),
        parameters=sum(_values(path) for path in sorted(folder.glob(f"*{WEIGHTS}"))),
        hashes=card.files,
        seed=training.get("seed"),
        data=[*rounds_of(training.get("rounds", [])), *training.get("data", [])],
        figures={**training.get("validation", {}), **told},
        versions=training.get("versions", {}),
        licence=training.get("licence") or ("MIT" if shipped else None),
        card=readme if readme.is_file() else None,
    )


def verify(folder: Path) -> ModelVerdict:
    """Compare a model's files with what `model.json` records, and load its weights into the networks.

    Raises:
        BusybotError: `model.json` cannot be read.
    """
    card, skill, kind = _card(folder)
    problems = [problem for name, known in card.files.items() if (problem := _compared(folder, name, known))]
    if card.files:
        strangers = sorted(path.name for path in folder.glob(f"*{WEIGHTS}") if path.name not in card.files)
        problems += [f"{folder / name}: {INFO_FILE} does not record it" for name in strangers]
    loads = True
    try:
        _loaded(folder, skill, kind)
    except BusybotError as error:
        loads = False
        if not any(problem.startswith(error.what.split(": ")[0]) for problem in problems):
            problems.append(error.what)
    return ModelVerdict(_name(folder), skill, kind, bool(card.files), loads, problems)


def _name(folder: Path) -> str:
    return folder.name if folder.parent in SHIPPED.values() else str(folder)


def _card(folder: Path) -> tuple[Card, str, str]:
    """The card, the skill that it belongs to, and the kind of networks."""
    card = read_info(folder, Card)
    for skill, kind in (("interact", card.variant), ("reason", card.model), ("plan", card.agent)):
        if kind is not None:
            return card, skill, kind
    raise BusybotError(f"{folder / INFO_FILE}: not a model's card: it has no `variant`, `model` or `agent`", RESTORE)


def _compared(folder: Path, name: str, known: str) -> str | None:
    """What is wrong with a recorded file, if anything is."""
    try:
        file = inside(folder, name)
        if not file.is_file():
            return f"{folder / name}: it is missing"
        found = sha256_of(file)
    except BusybotError as error:
        return f"{folder / INFO_FILE}: {without_name(error, folder)}"
    return None if found == known else f"{file}: its SHA-256 is {found[:12]}..., recorded is {known[:12]}..."


def _values(file: Path) -> int:
    """Number of values in a file of weights."""
    open_regular(file, MAX_WEIGHTS_BYTES, "copy the model again").close()
    try:
        with safe_open(file, "numpy") as tensors:
            return sum(prod(tensors.get_slice(name).get_shape()) for name in tensors.offset_keys())
    except (SafetensorError, OSError) as error:
        raise BusybotError(f"{file}: damaged: {error}", "copy the model again") from None


def _loaded(folder: Path, skill: str, kind: Any) -> Any:
    """The model with its weights in the networks."""
    if skill == "interact":
        from busybot.interact.affordance.load import load_model

        return load_model(folder)
    if skill == "reason":
        from busybot.reason.models.registry import load_reasoner

        return load_reasoner(folder)
    from busybot.plan.learning.network import read_policy

    return read_policy(folder, kind)[1]
