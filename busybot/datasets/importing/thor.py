"""Events of AI2-THOR, saved as JSON with their pictures, to recordings. It was written to the documented format; no
binary of AI2-THOR was run.

    events/000000.json, 000000.png    what `controller.step` returned at first, and after every action, by number

A file has `metadata` (`event.metadata`), `instance_detections2D` (object to left, top, right, bottom; needs
`renderInstanceSegmentation`) and `action` (`controller.last_action`: what was asked for, with its `objectId`). A folder
with several folders with `events` is several recordings.

- **Objects** are those with a box in the first event. Acted on, or with something in `controlledObjects`: triggers.
  Others are responders where they are controlled, can be toggled or opened, or are receptacles that stand in others (a
  burner on a stove, not the counter under everything). The rest is scenery.
- **Actions** are toggling, opening and closing. They have no direction there: switching on and closing are told as
  pushes, switching off and opening as pulls; the pixel is the middle of the object's box before.
- **States** are `isToggled`, else `isOpen`, of what can be toggled or opened. **Relations** are `controlledObjects`;
  without this key nobody knows them.
- **Pass** and **Done** let things come to rest: their picture takes the place of the one before.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import ConfigDict, Field, ValidationError
from pydantic.alias_generators import to_camel

from busybot.boards.directions import direction_named
from busybot.common.atomic_io import folders_with, inside, read_json
from busybot.common.errors import BusybotError, UsageError, naming
from busybot.common.frozen_model import FrozenModel, first_fault
from busybot.datasets.importing.camera_folder import ImportOptions, narrowed, pictures_of
from busybot.datasets.importing.camera_pictures import PICTURES, Shot, first_size, in_order
from busybot.datasets.importing.proposals import MAX_OBJECTS
from busybot.datasets.importing.recording import KnownAction, KnownObject, Recording

EVENTS = "events"
DIRECTIONS = {"ToggleObjectOn": "press", "ToggleObjectOff": "pull", "OpenObject": "pull", "CloseObject": "press"}
IDLE = ("Pass", "Done")
STILL = 1e-3
"""An agent that moved less than this, metres or degrees, has not."""
HINT = 'save {"metadata": event.metadata, "instance_detections2D": ..., "action": controller.last_action}'
Name = Annotated[str, Field(min_length=1, max_length=200)]
Names = Annotated[tuple[Name, ...], Field(max_length=10_000)]
Side = Annotated[int, Field(ge=-(10**9), le=10**9)]
Box = tuple[Side, Side, Side, Side]
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]


class _Told(FrozenModel):
    """Keys that nobody reads here are many, and let be."""

    model_config = ConfigDict(frozen=True, extra="ignore", alias_generator=to_camel)


class _Object(_Told):
    object_id: Name
    toggleable: bool = False
    is_toggled: bool = False
    openable: bool = False
    is_open: bool = False
    receptacle: bool = False
    parent_receptacles: Names | None = None
    controlled_objects: Names | None = None

    @property
    def state(self) -> int:
        """1 for on or open, 0 for off or closed, -1 for what is neither."""
        if self.toggleable:
            return int(self.is_toggled)
        return int(self.is_open) if self.openable else -1


class _Agent(_Told):
    position: dict[str, Number] = {}
    rotation: dict[str, Number] = {}
    camera_horizon: Number = 0.0

    def stays(self, other: "_Agent") -> bool:
        """Whether the other pose is the same, in whatever order its axes are told."""
        pairs = [(self.position, other.position), (self.rotation, other.rotation)]
        pairs += [({"": self.camera_horizon}, {"": other.camera_horizon})]
        return all(a.keys() == b.keys() and all(abs(a[axis] - b[axis]) <= STILL for axis in a) for a, b in pairs)


class _Metadata(_Told):
    last_action_success: bool = True
    last_action: str | None = None
    scene_name: str | None = None
    screen_width: Annotated[int, Field(ge=1)] | None = None
    screen_height: Annotated[int, Field(ge=1)] | None = None
    agent: _Agent = _Agent()
    objects: Annotated[tuple[_Object, ...], Field(max_length=10_000)]


class _Action(_Told):
    action: str
    object_id: Name | None = None


class _Event(_Told):
    metadata: _Metadata
    action: _Action | None = None
    boxes: dict[str, Box] | None = Field(None, alias="instance_detections2D")


@dataclass(frozen=True)
class _Read:
    file: Path
    picture: str
    event: _Event

    @cached_property
    def objects(self) -> dict[str, _Object]:
        return {one.object_id: one for one in self.event.metadata.objects}

    @property
    def kind(self) -> str:
        """Of the action that led here."""
        told = self.event.action
        return told.action if told else self.event.metadata.last_action or ""


def event_folders(source: Path) -> list[Path]:
    """The folder itself, or those in it, that have events."""
    if (source / EVENTS).is_dir():
        return [source]
    return folders_with(source, EVENTS)


def read_events(folder: Path, options: ImportOptions) -> Recording:
    """Read a recording; its pictures are decoded later.

    Raises:
        BusybotError: naming the file, if something is missing, contradicts itself, or cannot be told in our terms.
    """
    if options != ImportOptions(width=options.width):
        raise UsageError(f"{folder}: events tell all of it themselves", "leave out all options but --width")
    frames = _frames(_read_all(folder))
    first = frames[0]
    shots = [Shot(f"{EVENTS}/{one.picture}", -1, None, None, str(one.file)) for one in frames]
    size = first_size(folder, shots)
    told = first.event.metadata
    if (told.screen_width or size[0], told.screen_height or size[1]) != size:
        what = f"{first.file}: screenWidth and screenHeight are {told.screen_width} x {told.screen_height}"
        raise BusybotError(f"{what}, the picture has {size[0]} x {size[1]} pixels", "save event.frame as it is")
    names, objects = _objects(frames)
    recording = Recording(
        place=folder,
        size=size,
        pictures=partial(pictures_of, folder, shots, size, None),
        shown=[shot.name for shot in shots],
        actions=[_action(before, after) for before, after in zip(frames, frames[1:], strict=False)],
        objects=objects,
        relations=_relations(frames, objects),
        states=np.array([[_state(one, name) for name in names] for one in frames]),
        facts={
            "scene": told.scene_name or "",
            "failed": str(sum(not one.event.metadata.last_action_success for one in frames[1:])),
        },
    )
    return recording if options.width is None else narrowed(recording, options.width)


def _read_all(folder: Path) -> list[_Read]:
    place = inside(folder, EVENTS)
    found = []
    names = in_order(place, sorted(file.name for file in place.glob("*.json")), "divide the recording there")
    for file in (place / name for name in names):
        try:
            event = _Event.model_validate(read_json(inside(folder, f"{EVENTS}/{file.name}")))
        except ValidationError as error:
            raise BusybotError(f"{file}: {first_fault(error)}", HINT) from None
        pictures = [file.stem + end for end in PICTURES if os.path.lexists(place / (file.stem + end))]
        if len(pictures) != 1:
            what = f"{file}: {'no picture' if not pictures else 'several pictures'} of that name beside it"
            raise BusybotError(what, f"save event.frame as {file.stem}.png")
        found.append(_Read(file, pictures[0], event))
    if not found:
        raise BusybotError(f"{place}: it has no events", HINT)
    return found


def _frames(events: Sequence[_Read]) -> list[_Read]:
    """The first event and one for each action; later pictures of the same rest in place of earlier ones.

    Raises:
        BusybotError: naming an event whose agent, and with it the camera, has moved, or an action of another kind.
    """
    found = [events[0]]
    for one in events[1:]:
        if one.event.metadata.scene_name != events[0].event.metadata.scene_name:
            what = f"{one.file}: another scene than in {events[0].file.name}"
            raise BusybotError(what, "a recording is of one scene: divide it")
        if not events[0].event.metadata.agent.stays(one.event.metadata.agent):
            what = f"{one.file}: the agent moved, and so the camera, since {events[0].file.name}"
            raise BusybotError(what, "divide the recording there")
        if one.kind in IDLE:
            kept = found[-1].event
            facts = one.event.metadata.model_copy(update={"last_action_success": kept.metadata.last_action_success})
            rested = one.event.model_copy(update={"action": kept.action, "metadata": facts})
            found[-1] = _Read(one.file, one.picture, rested)
        elif one.kind in DIRECTIONS:
            found.append(one)
        else:
            what = f"{one.file}: the action {one.kind[:40]!r}"
            raise BusybotError(what, f"it reads {', '.join((*DIRECTIONS, *IDLE))}: divide the recording there")
    return found


def _acted(one: _Read) -> str:
    told = one.event.action
    if told is None or told.object_id is None:
        raise BusybotError(f"{one.file}: on which object? `action` has no objectId", HINT)
    if told.object_id not in one.objects:
        raise BusybotError(f"{one.file}: the action's {told.object_id[:80]!r} is none of the objects", HINT)
    return told.object_id


def _objects(frames: Sequence[_Read]) -> tuple[list[str], list[KnownObject]]:
    """Triggers and responders, in the order of the metadata."""
    first = frames[0]
    boxes = first.event.boxes
    if boxes is None:
        what = f"{first.file}: no instance_detections2D, so nobody knows where objects are"
        raise BusybotError(what, "Controller(renderInstanceSegmentation=True) gives them; save them beside metadata")
    acted, listed = {_acted(one): one for one in frames[:0:-1]}, first.event.metadata.objects
    controlled = {name for one in listed for name in one.controlled_objects or ()}
    found: dict[str, KnownObject] = {}
    for one in listed:
        name, where = one.object_id, f"{first.file}: {one.object_id}"
        responds = name in controlled or one.toggleable or one.openable or (one.receptacle and one.parent_receptacles)
        role = "trigger" if name in acted or one.controlled_objects else "responder" if responds else ""
        if name in found:
            raise BusybotError(f"{where}: it stands there twice", "an object has one objectId")
        if role and name in boxes:
            found[name] = KnownObject(name, role, boxes[name], None, where)
    for name, one_event in acted.items():
        if name not in found:
            what = f"{one_event.file}: it acts on {name[:80]!r}, which {first.file.name} does not show"
            raise BusybotError(what, "look where all that is acted on shows, and start there")
    if len(found) > MAX_OBJECTS:
        what = f"{first.file}: {len(found)} objects to act on or that respond show in its picture"
        raise BusybotError(what, f"at most {MAX_OBJECTS} stand on a board: keep the boxes of those that matter")
    return list(found), list(found.values())


def _action(before: _Read, after: _Read) -> KnownAction:
    name = _acted(after)
    u0, v0, u1, v1 = (before.event.boxes or {}).get(name, (-1,) * 4)
    if u1 <= u0:
        raise BusybotError(f"{before.file}: no box of {name[:80]!r}, which is acted on next", HINT)
    with naming(str(after.file)):
        direction = direction_named(DIRECTIONS[after.kind])
    return KnownAction(((u0 + u1) // 2, (v0 + v1) // 2), None, direction, str(after.file))


def _state(one: _Read, name: str) -> int:
    found = one.objects.get(name)
    if found is None:
        raise BusybotError(f"{one.file}: {name[:80]!r}, which was there before, is gone", "divide the recording there")
    return found.state


def _relations(frames: Sequence[_Read], objects: Sequence[KnownObject]) -> tuple[tuple[int, int], ...] | None:
    listed = frames[0].event.metadata.objects
    if all(one.controlled_objects is None for one in listed):
        return None
    number = {one.name: place for place, one in enumerate(objects)}
    pairs = [(one.object_id, other) for one in listed for other in one.controlled_objects or ()]
    known = [(number[a], number[b]) for a, b in pairs if a in number and b in number]
    for cause, effect in known:
        if objects[effect].role == "trigger":
            name = objects[effect].name
            acted = next((one for one in frames[1:] if _acted(one) == name), None)
            does = "is acted on" if acted else "controls others"
            what = f"{(acted or frames[0]).file}: {name[:80]!r} {does}, and {objects[cause].name[:80]!r} controls it"
            raise BusybotError(what, "what is controlled is a responder, and no trigger: act on what controls it alone")
    return tuple(known)
