"""Objects that can stand on a board, as plain data, and the catalogue of the paper's 58: no simulator, no meshes.

An object is a folder in PartNet-Mobility's layout with an annotation (`object_meta_info.json`). This module holds the
types; `partnet` reads them defensively, `library` keeps many of them, `procedural` makes new ones.

Units are board units (the board is 4 x 4), angles radians, quaternions (w, x, y, z). Frames: *object* is the URDF's,
*upright* is after the annotated orientation and scale, z pointing to the camera.

The catalogue's split is the authors' `Reason` split, which is used for all skills; repeated ids in their
lists are the weights.
"""

import json
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Literal

Role = Literal["trigger", "responder"]
Vector = tuple[float, float, float]
Color = tuple[float, float, float]

CATEGORIES = ("Switch", "Lamp", "Door", "Toy")


@dataclass(frozen=True)
class TriggerLink:
    """A movable link of a trigger object.

    Attributes:
        name: the URDF's link name.
        joint: the URDF's joint name whose child the link is.
        kind: `two-state` rests at either end, `multi-direction` at either end or in the middle.
        lower, upper: joint limits, radians (revolute) or unscaled object units (prismatic).
    """

    name: str
    joint: str
    joint_type: Literal["revolute", "prismatic"]
    kind: Literal["two-state", "multi-direction"]
    lower: float
    upper: float

    @property
    def states(self) -> int:
        """Number of discrete states: 2 (low, high) or 3 (low, middle, high)."""
        return 2 if self.kind == "two-state" else 3


@dataclass(frozen=True)
class Effect:
    """What a responder can show.

    Attributes:
        type: `color` paints a link, `joint` sets joints.
        link: the painted link (type `color`).
        joints: the joints that are set (type `joint`).
        single: values of the two states of a single-stage responder, or None if it cannot be one.
        multi: values of the steps 0, 1, 2 of a multi-stage responder, or None if it cannot be one.
            A value is an RGB triple in 0..1 (`color`) or one joint position per joint (`joint`; radians, or for
            prismatic joints board units: as in the original annotation, *after* scaling, and the URDF's limits do not
            bind it).
    """

    type: Literal["color", "joint"]
    link: str | None
    joints: tuple[str, ...]
    single: tuple[tuple[float, ...], tuple[float, ...]] | None
    multi: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]] | None


@dataclass(frozen=True)
class ObjectModel:
    """One object: annotation, URDF facts and where its files are.

    Attributes:
        category: one of `CATEGORIES`.
        instance: the id within the category, e.g. "100366".
        orientation: upright orientation, quaternion (w, x, y, z).
        scale: object units to board units.
        bounds_min, bounds_max: box in the upright frame *before* scaling, from the meshes over all states that the
            object can show (the annotated boxes are mirrored or too small on many objects).
        offset_z: height of the object's origin above the board, after scaling.
        trigger_links: movable links; empty for responders.
        directions: annotated effective directions in the board frame of an object that is not turned (not normalised);
            strict mode only.
        effect: what a responder shows; None for triggers.
        folder: where the files are; `urdf` is inside it.
        sha256: hash over the folder's relative file names and bytes.
    """

    category: str
    instance: str
    role: Role
    scale: float
    orientation: tuple[float, float, float, float]
    bounds_min: Vector
    bounds_max: Vector
    offset_z: float
    trigger_links: tuple[TriggerLink, ...]
    directions: tuple[Vector, ...]
    effect: Effect | None
    folder: Path
    sha256: str

    @property
    def key(self) -> str:
        """`Category/instance`, the name by which boards refer to the object."""
        return f"{self.category}/{self.instance}"

    @property
    def urdf(self) -> Path:
        return self.folder / "mobility.urdf"


Split = Literal["train", "novel"]
SPLITS: tuple[Split, ...] = ("train", "novel")


@dataclass(frozen=True)
class CatalogueEntry:
    """One object of the paper.

    Attributes:
        kinds: of a trigger one per movable link (`two-state`, `multi-direction`); of a responder the stages that it can
            take (`single-stage`, `multi-stage`).
        split: `train` or `novel`.
        weight: how many times the authors list it.
    """

    category: str
    instance: str
    role: Role
    kinds: tuple[str, ...]
    split: Split
    weight: int

    @property
    def key(self) -> str:
        return f"{self.category}/{self.instance}"


@cache
def catalogue() -> dict[str, CatalogueEntry]:
    """The paper's 58 objects by `Category/instance`."""
    text = resources.files("busybot.objects").joinpath("catalogue.json").read_text(encoding="utf-8")
    entries = (CatalogueEntry(**{**row, "kinds": tuple(row["kinds"])}) for row in json.loads(text)["objects"])
    return {entry.key: entry for entry in entries}


def kinds(model: ObjectModel) -> tuple[str, ...]:
    """What `CatalogueEntry.kinds` says, for any object."""
    if model.effect is None:
        return tuple(link.kind for link in model.trigger_links)
    stages = (("single-stage", model.effect.single), ("multi-stage", model.effect.multi))
    return tuple(name for name, values in stages if values is not None)
