"""A trained model is a folder: weights, and `model.json`, which says what they are."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import BaseModel, ValidationError

from busybot.common.atomic_io import read_json, sha256_of, write_json
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel

INFO_FILE = "model.json"
WEIGHTS_FILE = "weights.safetensors"
"""Of models with one network."""

PACKAGE = Path(__file__).parents[1]
SHIPPED = {skill: PACKAGE / "pretrained" / skill for skill in ("interact", "reason")}
"""Where the package has the models that can be called by their names, by skill."""
CALLED = {"interact": "an interaction model", "reason": "a model of relations"}

Info = TypeVar("Info", bound=BaseModel)


class ModelCard(FrozenModel):
    """What `model.json` says of every model; each skill's has more.

    Attributes:
        training: provenance: datasets with hashes, seed, configuration, figures; JSON values.
        files: SHA-256 of the weights by name, written by saving; older folders have none.
    """

    format: Literal["1"] = "1"
    training: dict[str, Any] = {}
    files: dict[str, str] = {}


def find_folder(name_or_path: str | Path, *skills: str) -> Path:
    """The folder that a name or a path means; a training's folder stands for its final model.

    Args:
        skills: as in `busybot train SKILL`; their shipped models can be called by their names.

    Raises:
        BusybotError: there is none.
    """
    given = Path(name_or_path)
    for folder in (given, given / "model"):
        if (folder / INFO_FILE).is_file():
            return folder
    places = [SHIPPED[skill] for skill in skills if skill in SHIPPED]
    named = {path.parent.name: path.parent for place in places for path in place.glob(f"*/{INFO_FILE}")}
    if str(name_or_path) in named:
        return named[str(name_or_path)]
    _refuse_other(str(name_or_path), skills, sorted(named))
    known = f"the shipped models are {', '.join(sorted(named))}; " if named else ""
    raise BusybotError(
        f"{name_or_path}: no model of that name, and no folder with {INFO_FILE}",
        f"{known}`busybot train {'|'.join(skills)} --out DIR` makes one",
    )


def _refuse_other(name: str, skills: tuple[str, ...], named: list[str]) -> None:
    """Say so if the name is that of a shipped model of another skill."""
    skill = skills[0]
    for other, place in SHIPPED.items():
        if skill in CALLED and other not in skills and Path(name).name == name and (place / name / INFO_FILE).is_file():
            choice = ", ".join([*named, "or a folder of one"])
            raise BusybotError(
                f"`{name}` is {CALLED[other]}; here {CALLED[skill]} is needed",
                f"choose {choice}; `busybot models list` shows all",
            )


def read_info(folder: Path, kind: type[Info]) -> Info:
    """What `model.json` says; errors name the file and the place."""
    try:
        return kind.model_validate(read_json(folder / INFO_FILE))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise BusybotError(f"{folder / INFO_FILE}: {place}: {first['msg']}", "train the model again") from None


def write_info(folder: Path, info: BaseModel, weights: Iterable[Path]) -> None:
    """Write `model.json`, the last of a model's files, with the SHA-256 of its weights in `files`."""
    hashes = {file.name: sha256_of(file) for file in weights}
    write_json(folder / INFO_FILE, {**info.model_dump(mode="json"), "files": hashes}, folder.parent)


def file_hashes(folder: Path) -> dict[str, str]:
    """SHA-256 of every file of a model's folder, by name."""
    files = sorted(path for path in folder.iterdir() if path.is_file())
    return {path.name: sha256_of(path) for path in files}
