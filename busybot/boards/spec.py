"""The specification of a board as plain data: JSON in, JSON out, no simulator (paper section 3, protocol "Boards").

Units: board units (the board is 4 x 4), radians. Board frame: origin at the board's centre, x right and y up in the
picture, z towards the camera.
"""

import hashlib
import json
from typing import Annotated, Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from busybot.common.frozen_model import FrozenModel

SCHEMA_VERSION = "1.0"

Finite = Annotated[float, Field(allow_inf_nan=False, ge=-1e3, le=1e3)]
Unit = Annotated[float, Field(ge=0, le=1)]
Index = Annotated[int, Field(ge=0, le=255)]


class PlacedObject(FrozenModel):
    """An object on the board.

    Attributes:
        key: `Category/instance` in the asset library.
        position: x, y, z of the object's origin in the board frame.
        yaw: turn about z, counter-clockwise.
        scale: object units to board units.
        states: initial state of each trigger link, in the order of the object's links; empty for responders.
    """

    key: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}/[A-Za-z0-9_.-]{1,64}$")]
    role: Literal["trigger", "responder"]
    position: tuple[Finite, Finite, Finite]
    yaw: Finite
    scale: Annotated[float, Field(gt=0, le=100)]
    states: tuple[Annotated[int, Field(ge=0, le=15)], ...] = ()

    @property
    def category(self) -> str:
        return self.key.split("/")[0]

    @property
    def instance(self) -> str:
        return self.key.split("/")[1]


class LinkRef(FrozenModel):
    """A link of an object on the board: `object` indexes `BoardSpec.objects`."""

    object: Index
    link: Annotated[str, Field(min_length=1, max_length=64)]


class Relation(FrozenModel):
    """Triggers that together decide the state of one responder.

    The set of kinds is open: a reader keeps kinds that it does not know, a simulator refuses them by name. The paper's
    three kinds have one trigger and `states[s]` is the responder's state while the trigger rests in state s.

    Attributes:
        kind: `one-to-one`, `one-to-many-effects` or `one-to-many-objects`; later gates, delays, several triggers.
        triggers: the controlling links.
        responder: index of the controlled object.
        stage: whether the responder acts as a single-stage (2 states) or multi-stage (3 states) object.
        states: responder state for each trigger state.
        parameters: whatever a later kind needs.
    """

    kind: Annotated[str, Field(pattern=r"^[a-z0-9-]{1,64}$")]
    triggers: Annotated[tuple[LinkRef, ...], Field(min_length=1, max_length=64)]
    responder: Index
    stage: Literal["single", "multi"]
    states: Annotated[tuple[Annotated[int, Field(ge=0, le=15)], ...], Field(max_length=256)]
    parameters: dict[str, Any] = {}


class Task(FrozenModel):
    """What is to be reached on a board from its initial states (paper section 4.3): its responders are to look as they
    do while every trigger link rests in its goal state. `boards.task` says what follows from it.

    Attributes:
        kind: `one-to-one` or `one-to-many`, the paper's two kinds of tasks.
        links: the board's trigger links, object by object; `PlacedObject.states` one after the other are theirs.
        goal: goal state of each of `links`.
    """

    kind: Literal["one-to-one", "one-to-many"]
    links: Annotated[tuple[LinkRef, ...], Field(min_length=1, max_length=1024)]
    goal: Annotated[tuple[Annotated[int, Field(ge=0, le=15)], ...], Field(max_length=1024)]


class BoardSpec(FrozenModel):
    """A board: surface, objects, initial states and relations.

    Attributes:
        index: number of the board in its dataset; with `seed` and `split` it determines all else.
        appearance_group: boards of one group share everything but their relations.
        texture: name of one of `boards.textures.TEXTURES`.
        color: RGB tint of the texture, 0..1.
        task: a goal to be reached, or None. A board without one has no such key in JSON: it is written, and hashed, as
            before there were tasks.
    """

    schema_version: Annotated[str, Field(pattern=r"^\d+\.\d+$")] = SCHEMA_VERSION
    index: Annotated[int, Field(ge=0)]
    seed: Annotated[int, Field(ge=0)]
    split: Annotated[str, Field(min_length=1, max_length=64)]
    appearance_group: Annotated[int, Field(ge=0)]
    size: tuple[Annotated[float, Field(gt=0, le=100)], Annotated[float, Field(gt=0, le=100)]] = (4.0, 4.0)
    texture: Annotated[str, Field(pattern=r"^[a-z-]{1,32}$")]
    color: tuple[Unit, Unit, Unit]
    objects: Annotated[tuple[PlacedObject, ...], Field(max_length=64)]
    relations: Annotated[tuple[Relation, ...], Field(max_length=256)]
    task: Task | None = None

    @model_validator(mode="after")
    def _references_exist(self) -> "BoardSpec":
        for relation in self.relations:
            for index in (relation.responder, *(ref.object for ref in relation.triggers)):
                if index >= len(self.objects):
                    raise ValueError(f"a relation names object {index} of {len(self.objects)}")
            if self.objects[relation.responder].role != "responder":
                raise ValueError(f"the relation's responder {relation.responder} is a trigger")
        return self

    @model_validator(mode="after")
    def _task_fits(self) -> "BoardSpec":
        if self.task is None:
            return self
        owners = [index for index, placed in enumerate(self.objects) for _ in placed.states]
        if [link.object for link in self.task.links] != owners or len(self.task.goal) != len(owners):
            raise ValueError(f"the task's links and goal do not fit the board's {len(owners)} trigger links")
        named = {(link.object, link.link) for link in self.task.links}
        if len(named) != len(owners):
            raise ValueError("the task names a link twice")
        if any((t.object, t.link) not in named for relation in self.relations for t in relation.triggers):
            raise ValueError("a relation's trigger is none of the task's links")
        return self

    @model_serializer(mode="wrap")
    def _without_absent_task(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        values: dict[str, Any] = handler(self)
        if self.task is None:
            values.pop("task", None)
        return values

    def relation_matrix(self) -> list[list[int]]:
        """Object pairs: `[i][j]` is 1 when a link of object i controls object j (links collapsed)."""
        matrix = [[0] * len(self.objects) for _ in self.objects]
        for relation in self.relations:
            for trigger in relation.triggers:
                matrix[trigger.object][relation.responder] = 1
        return matrix

    def digest(self) -> str:
        """SHA-256 over the board's values, independent of formatting and file names."""
        values = self.model_dump(mode="json")
        return hashlib.sha256(json.dumps(values, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
