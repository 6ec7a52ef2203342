"""What an annotation decides about an object, as a reviewer sees and edits it.

The rules of `objects.rules` fill in what is left out. Quaternions are (x, y, z, w) as in the annotation; the rest has
the units of `objects.model`.
"""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from busybot.objects.annotation import Number, Value, Vector3

Kind = Literal["two-state", "multi-direction"]
Category = Literal["Switch", "Lamp", "Door", "Toy"]
LinkName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,64}$")]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class EffectChoice(_Part):
    """What a responder shows.

    Attributes:
        type: `color` paints `link`, `joint` sets `joints`.
        states: values of a single-stage responder's two states; None if it cannot be one.
        steps: values of a multi-stage responder's steps 0, 1, 2; None if it cannot be one. A value is an RGB triple in
            0..1, or a position per joint: radians, for sliding joints board units.
    """

    type: Literal["color", "joint"]
    link: LinkName | None = None
    joints: Annotated[tuple[LinkName, ...], Field(max_length=64)] = ()
    states: tuple[Value, Value] | None = None
    steps: tuple[Value, Value, Value] | None = None

    @model_validator(mode="after")
    def _consistent(self) -> "EffectChoice":
        if (self.type == "color") != (self.link is not None) or (self.type == "joint") != bool(self.joints):
            raise ValueError("a color effect names its link, a joint effect its joints")
        if self.states is None and self.steps is None:
            raise ValueError("states or steps must be given")
        width = 3 if self.type == "color" else len(self.joints)
        if any(len(value) != width for value in (*(self.states or ()), *(self.steps or ()))):
            raise ValueError(f"every state and step needs {width} numbers")
        return self


class Choices(_Part):
    """The decisions; None leaves one to the rules.

    Attributes:
        use: false leaves the object out of the library.
        category: a Switch is a trigger, a Lamp, Door or Toy a responder.
        scale: object units to board units.
        orientation: upright pose, quaternion (x, y, z, w); afterwards z points to the camera.
        links: a trigger's movable links and their kinds.
        directions: effective directions of a trigger, board frame; strict mode only.
        effect: what a responder shows.
    """

    use: bool = True
    category: Category | None = None
    scale: Annotated[float, Field(gt=0, le=100, allow_inf_nan=False)] | None = None
    orientation: tuple[Number, Number, Number, Number] | None = None
    links: Annotated[dict[LinkName, Kind], Field(min_length=1, max_length=32)] | None = None
    directions: Annotated[tuple[Vector3, ...], Field(max_length=64)] | None = None
    effect: EffectChoice | None = None

    @model_validator(mode="after")
    def _consistent(self) -> "Choices":
        if self.orientation is not None and abs(sum(c * c for c in self.orientation) - 1) > 1e-3:
            raise ValueError("orientation is not a unit quaternion (x, y, z, w)")
        if self.category == "Switch" and self.effect is not None:
            raise ValueError("a Switch is a trigger and has no effect")
        if self.category not in (None, "Switch") and (self.links is not None or self.directions is not None):
            raise ValueError(f"a {self.category} is a responder: links and directions are a Switch's")
        return self
