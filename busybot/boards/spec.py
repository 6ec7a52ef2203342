"""The specification of a board as plain data: JSON in, JSON out, no simulator (paper section 3).

Units: board units (the board is 4 x 4), radians. Board frame: origin at the board's centre, x right and y up in the
picture, z towards the camera.
"""

import hashlib
import json
import math
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from busybot.common.frozen_model import FrozenModel, Values

SCHEMA_VERSION = "1.0"
"""Of the paper's boards."""
WORLDS_VERSION = "1.1"
"""Of boards of other worlds: relations have mechanisms with memories, links have locks, a relation may change."""
SCENES_VERSION = "1.2"
"""Of scenes: boards that say from where they are looked at."""
PAPER = "paper"
IMPORTED = "imported"
"""Split, and version of the generator, of boards that nobody generated; their recordings came from elsewhere."""

Finite = Annotated[float, Field(allow_inf_nan=False, ge=-1e3, le=1e3)]
Unit = Annotated[float, Field(ge=0, le=1)]
Index = Annotated[int, Field(ge=0, le=255)]


def without(values: dict[str, Any], absent: dict[str, Any]) -> dict[str, Any]:
    """The values but for those that are what `absent` says: JSON that has no keys that say nothing."""
    return {key: value for key, value in values.items() if key not in absent or value not in (absent[key], ())}


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


BODY = "body"
"""Name of the link that stands for a whole object: as an input, a responder's state before the action."""


class LinkRef(FrozenModel):
    """A link of an object on the board: `object` indexes `BoardSpec.objects`."""

    object: Index
    link: Annotated[str, Field(min_length=1, max_length=64)]


KIND_PATTERN = r"^[a-z0-9-]{1,64}$"
"""Of names of kinds."""


class Relation(FrozenModel):
    """What together decides the state of one responder.

    The set of kinds is open: a reader keeps kinds that it does not know, a simulator refuses them by name. The paper's
    three kinds have one trigger and `states[s]` is the responder's state while the trigger rests in state s.

    Attributes:
        kind: of its mechanism, one of `boards.mechanisms.available()`.
        triggers: the inputs, trigger links and responders (`BODY`); none of what moves by itself, or not at all.
        responder: index of the controlled object.
        stage: whether the responder acts as a single-stage (2 states) or multi-stage (3 states) object.
        states: the mechanism's table; of the paper's kinds the responder's state for each trigger state.
        parameters: of the mechanism; `stream` names the luck that several responders have in common.
    """

    kind: Annotated[str, Field(pattern=KIND_PATTERN)]
    triggers: Annotated[tuple[LinkRef, ...], Field(max_length=64)]
    responder: Index
    stage: Literal["single", "multi"]
    states: Annotated[tuple[Annotated[int, Field(ge=0, le=15)], ...], Field(max_length=256)]
    parameters: Values = {}


class Lock(FrozenModel):
    """A trigger link that yields only while a responder is in certain states; else its joint is held.

    Attributes:
        link: the held link.
        responder: index of the object that holds it.
        states: in which it does not.
    """

    link: LinkRef
    responder: Index
    states: Annotated[tuple[Annotated[int, Field(ge=0, le=15)], ...], Field(min_length=1, max_length=16)]


class Rewiring(FrozenModel):
    """A relation that takes the place of its responder's during an episode.

    Attributes:
        step: number of the first action, from 0, after which it holds.
        relation: that holds then; its mechanism starts anew.
    """

    step: Annotated[int, Field(ge=1)]
    relation: Relation


class Task(FrozenModel):
    """What is to be reached on a board from its initial states (paper section 4.3): its responders are to look as they
    do while every trigger link rests in its goal state. `boards.task` says what follows from it.

    Attributes:
        kind: `one-to-one` or `one-to-many`, the paper's two kinds of tasks; `reach` in other worlds.
        links: the board's trigger links, object by object; `PlacedObject.states` one after the other are theirs.
        goal: goal state of each of `links`.
        responders: goal state of every object, -1 for triggers, where it does not follow from `goal` alone; else None.
        shortest: number of actions of the shortest plan, where a search found it; else None.
    """

    kind: Annotated[str, Field(pattern=KIND_PATTERN)]
    links: Annotated[tuple[LinkRef, ...], Field(min_length=1, max_length=1024)]
    goal: Annotated[tuple[Annotated[int, Field(ge=0, le=15)], ...], Field(max_length=1024)]
    responders: Annotated[tuple[Annotated[int, Field(ge=-1, le=15)], ...], Field(max_length=64)] | None = None
    shortest: Annotated[int, Field(ge=1)] | None = None

    @model_serializer(mode="wrap")
    def _without_absent(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return without(handler(self), {"responders": None, "shortest": None})


Place = Annotated[float, Field(allow_inf_nan=False, ge=-100, le=100)]
LEAST_VIEW = 1e-3
"""Distance of a camera from what it looks at, board units, below which nobody knows where it looks."""


class BoardCamera(FrozenModel):
    """From where a board is looked at, in place of the camera of the recording's configuration.

    Attributes:
        position, target: of the camera, board frame.
        fov_deg: horizontal field of view, degrees.
    """

    position: tuple[Place, Place, Annotated[float, Field(gt=0, le=100)]]
    target: tuple[Place, Place, Place]
    fov_deg: Annotated[float, Field(gt=1, lt=170)]

    @model_validator(mode="after")
    def _looks_somewhere(self) -> "BoardCamera":
        if math.dist(self.position, self.target) < LEAST_VIEW:
            raise ValueError("position and target are the same point")
        return self


class BoardSpec(FrozenModel):
    """A board: surface, objects, initial states and relations.

    Attributes:
        index: number of the board in its dataset; with `seed` and `split` it determines all else.
        appearance_group: boards of one group share everything but their relations.
        texture: name of one of `boards.textures.TEXTURES`.
        color: RGB tint of the texture, 0..1.
        task: a goal to be reached, or None.
        world: which world its relations are of (`boards.worlds`).
        locks: links that something holds.
        rewirings: relations that change during an episode.
        idle: trigger links that control nothing on purpose; every other one controls or unlocks something, as long as
            no rewiring takes that away.
        camera: of a scene; None where the recording's configuration alone says it.
        relations_known: whether `relations` are the truth; where nobody knows it, as of real boards, none are judged.

    Keys that say nothing (no task, the paper's world, no locks) are left out in JSON, so that a board is written, and
    hashed, as before there were such keys. A reader keeps keys that it does not know, which later versions may bring;
    a simulator refuses them by name.
    """

    model_config = ConfigDict(frozen=True, extra="allow")

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
    world: Annotated[str, Field(pattern=r"^[a-z0-9-]{1,64}$")] = PAPER
    locks: Annotated[tuple[Lock, ...], Field(max_length=256)] = ()
    rewirings: Annotated[tuple[Rewiring, ...], Field(max_length=64)] = ()
    idle: Annotated[tuple[LinkRef, ...], Field(max_length=256)] = ()
    relations_known: bool = True
    camera: BoardCamera | None = None

    @model_validator(mode="after")
    def _references_exist(self) -> "BoardSpec":
        relations = (*self.relations, *(rewiring.relation for rewiring in self.rewirings))
        named = [(one.responder, *(ref.object for ref in one.triggers)) for one in relations]
        named += [(lock.responder, lock.link.object) for lock in self.locks]
        for responder, *others in named:
            for index in (responder, *others):
                if index >= len(self.objects):
                    raise ValueError(f"a relation names object {index} of {len(self.objects)}")
            if self.objects[responder].role != "responder":
                raise ValueError(f"the relation's responder {responder} is a trigger")
        for link in self.idle:
            if link.object >= len(self.objects):
                raise ValueError(f"an idle link is of object {link.object} of {len(self.objects)}")
        return self

    @model_validator(mode="after")
    def _task_fits(self) -> "BoardSpec":
        if self.task is None:
            return self
        owners = [index for index, placed in enumerate(self.objects) for _ in placed.states]
        if [link.object for link in self.task.links] != owners or len(self.task.goal) != len(owners):
            raise ValueError(f"the task's links and goal do not fit the board's {len(owners)} trigger links")
        if self.task.responders is not None and len(self.task.responders) != len(self.objects):
            what = f"the task's responders are {len(self.task.responders)}"
            raise ValueError(f"{what}, one for each of {len(self.objects)} objects is needed")
        named = {(link.object, link.link) for link in self.task.links}
        if len(named) != len(owners):
            raise ValueError("the task names a link twice")
        inputs = [t for relation in self.relations for t in relation.triggers if t.link != BODY]
        if any((t.object, t.link) not in named for t in inputs):
            raise ValueError("a relation's trigger is none of the task's links")
        return self

    @model_serializer(mode="wrap")
    def _without_absent(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        absent: dict[str, Any] = {"task": None, "world": PAPER, "locks": [], "rewirings": [], "idle": []}
        return without(handler(self), absent | {"relations_known": True, "camera": None})

    @property
    def told_world(self) -> str:
        """In which world the board was drawn, as who reads a recording is told, and agents that plan; "" of what was
        imported, which nobody drew."""
        return self.world if self.relations_known and self.split != IMPORTED else ""

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
