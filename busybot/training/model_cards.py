"""A trained model is a folder: weights, and `model.json`, which says what they are."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from busybot.common.atomic_io import read_json, sha256_of, write_json
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel, first_fault

INFO_FILE = "model.json"
MAX_DEPTH = 16
WEIGHTS_FILE = "weights.safetensors"
"""Of models with one network."""

PACKAGE = Path(__file__).parents[1]
SHIPPED = {skill: PACKAGE / "pretrained" / skill for skill in ("interact", "reason")}
"""Where the package has the models that can be called by their names, by skill."""
CALLED = {"interact": "an interaction model", "reason": "a model of relations", "plan": "a policy that plans"}
SKILL_OF = {"variant": "interact", "model": "reason", "agent": "plan"}
"""Skill by the key with which a card tells the kind of its networks."""

Info = TypeVar("Info", bound=BaseModel)


class Provenance(BaseModel):
    """Where a model comes from; everything else in a card's `training` are figures.

    Attributes:
        rounds, data: the datasets it was trained on, with their hashes.
        versions: of packages.
        validation: figures on boards that were held out.
        licence: SPDX identifier.
    """

    model_config = ConfigDict(frozen=True, extra="allow", strict=True)

    seed: Annotated[int, Field(ge=0)] | None = None
    config: dict[str, Any] = {}
    rounds: list[dict[str, Any]] | dict[str, Any] = []
    data: list[dict[str, Any]] = []
    versions: dict[str, str] = {}
    validation: dict[str, Any] = {}
    licence: Annotated[str, Field(max_length=500)] | None = None


def _checked(training: dict[str, Any]) -> dict[str, Any]:
    Provenance.model_validate(training)
    _refuse_beyond(training, MAX_DEPTH)
    return training


def _refuse_beyond(value: Any, depth: int) -> None:
    """Figures are finite numbers, in groups that somebody can read."""
    if depth == 0:
        raise ValueError(f"nested more than {MAX_DEPTH} deep")
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError("a figure is no finite number")
    for inner in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        _refuse_beyond(inner, depth - 1)


Training = Annotated[dict[str, Any], AfterValidator(_checked)]
FileName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,199}$")]
Hashes = dict[FileName, Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]]


class ModelCard(FrozenModel):
    """What `model.json` says of every model; each skill's has more.

    Attributes:
        training: provenance (`Provenance`) and figures; JSON values.
        files: SHA-256 of the weights by name, written by saving; older folders have none.
    """

    format: Literal["1"] = "1"
    training: Training = {}
    files: Hashes = {}


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
    values = read_json(folder / INFO_FILE)
    try:
        return kind.model_validate(values)
    except ValidationError as error:
        _refuse_other_skill(folder, values, kind)
        raise BusybotError(f"{folder / INFO_FILE}: {first_fault(error)}", "train the model again") from None


def _refuse_other_skill(folder: Path, values: Any, kind: type[BaseModel]) -> None:
    """Say so if a card is of another skill than is needed: its faults are none."""
    told = [skill for key, skill in SKILL_OF.items() if isinstance(values, dict) and key in values]
    needed = [skill for key, skill in SKILL_OF.items() if key in kind.model_fields]
    if told and len(needed) == 1 and needed[0] not in told:
        raise BusybotError(
            f"{folder} is {CALLED[told[0]]}; here {CALLED[needed[0]]} is needed",
            "name a folder of one; `busybot models list` shows the shipped ones",
        )


def check_weights(file: Path, card: ModelCard) -> None:
    """Compare a file of weights with the hash that the card records, if it records one.

    Raises:
        BusybotError: it is another file.
    """
    known = card.files.get(file.name)
    if known is not None and (found := sha256_of(file)) != known:
        what = f"{file}: its SHA-256 is {found[:12]}..., {INFO_FILE} records {known[:12]}..."
        raise BusybotError(what, "copy the model again, or train it again")


def write_info(folder: Path, info: BaseModel, weights: Iterable[Path]) -> None:
    """Write `model.json`, the last of a model's files, with the SHA-256 of its weights in `files`."""
    hashes = {file.name: sha256_of(file) for file in weights}
    write_json(folder / INFO_FILE, {**info.model_dump(mode="json"), "files": hashes}, folder.parent)


def rounds_of(value: Any) -> Any:
    """What a training tells of its rounds, one by one; the paper's tells of all together, with one hash for them."""
    return [value | {"content_hash": value.get("content_sha256")}] if isinstance(value, dict) else value


def file_hashes(folder: Path) -> dict[str, str]:
    """SHA-256 of every file of a model's folder, by name."""
    files = sorted(path for path in folder.iterdir() if path.is_file())
    return {path.name: sha256_of(path) for path in files}
