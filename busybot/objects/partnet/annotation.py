"""The annotation of an object, `object_meta_info.json`, as plain checked data.

The format is that of the BusyBot authors' PartNet-Mobility annotation. What they left implicit:
- `Orientation` is (x, y, z, w); boxes are in the upright frame before scaling.
- `JointId` and `LinkId` count joints (or their child links) from 0, fixed ones included, depth first from the root,
  children in the document's order: the numbering of PyBullet.
- A `joint` effect without `States` opens from the joint limit at which the object is flatter to the other one.
- Colours have an alpha that means nothing.
"""

from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from busybot.common.errors import BusybotError
from busybot.objects.model import CATEGORIES
from busybot.objects.partnet.folder_snapshot import Snapshot

FILE_NAME = "object_meta_info.json"
MAX_BYTES = 1 << 20
MAX_FAULTS = 20
_HINT = "compare with an annotated object of PartNet-Mobility, or annotate the object again"

Number = Annotated[float, Field(allow_inf_nan=False, ge=-1e4, le=1e4, strict=True)]
Vector3 = tuple[Number, Number, Number]
Flag = Annotated[int, Field(ge=0, le=1, strict=True)]
Id = Annotated[int, Field(ge=0, le=255, strict=True)]
Value = Annotated[tuple[Number, ...], Field(min_length=1, max_length=64)]


def equal_values(name: str, values: Sequence[tuple[float, ...]]) -> str | None:
    """What is wrong with states or steps of an effect, colours or joint positions, of which two look alike."""
    places = ((values.index(value), place) for place, value in enumerate(values) if value in values[:place])
    return next((f"{name} {one} and {other} are equal: nobody could tell them apart" for one, other in places), None)


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")


class CauseEntry(_Part):
    """A trigger's movable link: `JointId` is the joint that moves it."""

    JointId: Id
    IsSmallCause: Flag
    IsLargeCause: Flag

    @model_validator(mode="after")
    def _one_kind(self) -> "CauseEntry":
        if self.IsSmallCause == self.IsLargeCause:
            raise ValueError("exactly one of IsSmallCause and IsLargeCause must be 1")
        return self


class EffectEntry(_Part):
    """What a responder shows: a painted link (`Type` link) or joints that are set (`Type` joint)."""

    Type: Literal["link", "joint"]
    JointId: Id | Annotated[list[Id], Field(min_length=1, max_length=64)] | None = None
    LinkId: Id | None = None
    IsSingleEffect: Flag
    IsMultiEffect: Flag
    States: tuple[Value, Value] | None = None
    Steps: tuple[Value, Value, Value] | None = None

    @property
    def joint_ids(self) -> list[int]:
        return [] if self.JointId is None else self.JointId if isinstance(self.JointId, list) else [self.JointId]

    @model_validator(mode="after")
    def _consistent(self) -> "EffectEntry":
        if not (self.IsSingleEffect or self.IsMultiEffect):
            raise ValueError("at least one of IsSingleEffect and IsMultiEffect must be 1")
        if self.IsMultiEffect and self.Steps is None:
            raise ValueError("IsMultiEffect is 1 but Steps is missing")
        if self.Type == "link" and self.LinkId is None:
            raise ValueError("a link effect needs LinkId")
        if self.Type == "link" and self.IsSingleEffect and self.States is None:
            raise ValueError("a single-stage link effect needs States")
        if self.Type == "joint" and not self.joint_ids:
            raise ValueError("a joint effect needs JointId")
        if self.Type == "joint" and self.IsSingleEffect and self.States is None and len(self.joint_ids) != 1:
            raise ValueError("a single-stage effect on several joints needs States")
        for value in (*(self.States or ()), *(self.Steps or ())):
            if self.Type == "joint" and len(value) != len(self.joint_ids):
                raise ValueError(f"a state has {len(value)} values for {len(self.joint_ids)} joints")
            if self.Type == "link" and (len(value) not in (3, 4) or not all(0 <= channel <= 1 for channel in value)):
                raise ValueError("a colour must be 3 or 4 numbers between 0 and 1")
        return self


class ObjectAnnotation(_Part):
    """`object_meta_info.json`; field names are the file's."""

    Category: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
    InstanceId: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-][A-Za-z0-9_.-]{0,63}$")]
    Scale: Annotated[float, Field(gt=0, le=100, allow_inf_nan=False, strict=True)]
    Movable_link: dict[Annotated[str, Field(max_length=64)], Any] = {}
    Orientation: tuple[Number, Number, Number, Number]
    MaxBBox: Vector3
    MinBBox: Vector3
    Offset_z: Number
    Direction: Annotated[tuple[Vector3, ...], Field(max_length=64)] | None = None
    Effect: Annotated[tuple[EffectEntry, ...], Field(max_length=1)] = ()
    Cause: Annotated[tuple[CauseEntry, ...], Field(max_length=32)] = ()

    @model_validator(mode="after")
    def _consistent(self) -> "ObjectAnnotation":
        if self.Category not in CATEGORIES:
            raise ValueError(f"Category {self.Category!r} is none of {', '.join(CATEGORIES)}")
        if abs(sum(c * c for c in self.Orientation) - 1) > 1e-3:
            raise ValueError("Orientation is not a unit quaternion (x, y, z, w)")
        sizes = [(high - low) * self.Scale for low, high in zip(self.MinBBox, self.MaxBBox, strict=True)]
        if min(sizes) < 1e-4 or max(sizes) > 100:
            raise ValueError(f"the bounding box has sizes {sizes} board units; each must be between 0.0001 and 100")
        if bool(self.Cause) == bool(self.Effect):
            raise ValueError("exactly one of Cause and Effect must be filled")
        if self.Cause and len({cause.JointId for cause in self.Cause}) < len(self.Cause):
            raise ValueError("a joint is named twice in Cause")
        if any(max(abs(c) for c in direction) == 0 for direction in self.Direction or ()):
            raise ValueError("a Direction is the zero vector")
        return self


def parse_annotation(snapshot: Snapshot) -> ObjectAnnotation:
    """Read and check the annotation; errors name the file, the field and the hint."""
    value = annotation_values(snapshot)
    try:
        return ObjectAnnotation.model_validate(value)
    except ValidationError as error:
        raise _described(snapshot, error)[0] from None


def annotation_faults(snapshot: Snapshot) -> list[BusybotError]:
    """Everything that is wrong with the annotation, field by field; empty when nothing is."""
    try:
        ObjectAnnotation.model_validate(annotation_values(snapshot))
    except ValidationError as error:
        return _described(snapshot, error)
    except BusybotError as error:
        return [error]
    return []


def annotation_values(snapshot: Snapshot) -> Any:
    """The annotation's JSON as it is, unchecked."""
    return snapshot.parse_json(FILE_NAME, snapshot.require(FILE_NAME, MAX_BYTES, _HINT), _HINT)


def _described(snapshot: Snapshot, error: ValidationError) -> list[BusybotError]:
    """An error for each fault, at least one, at most `MAX_FAULTS`."""
    faults = []
    for fault in error.errors(include_url=False, include_input=False)[:MAX_FAULTS]:
        place = ".".join(str(part)[:40] for part in fault["loc"]) or "the object"
        faults.append(BusybotError(f"{snapshot.folder / FILE_NAME}: {place}: {fault['msg'][:300]}", _HINT))
    return faults
