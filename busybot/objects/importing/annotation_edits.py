"""What an annotation decides about an object, and the reviewable YAML of it between the rules and a library.

A proposal is written, a person edits it, the import reads it:

    objects:
      "40147":
        category: Door
        scale: 0.49

Fields are those of `Choices`; a field that is absent (or null) is left to the rules of `auto_annotation`. Aliases are
refused: they let a short text stand for a monstrous one. Quaternions are (x, y, z, w) as in the annotation; the rest
has the units of `objects.model`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import Field, ValidationError, model_validator

from busybot.common.atomic_io import write_atomically
from busybot.common.config import DAMAGED_YAML, check_tokens, yaml_fault
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel
from busybot.common.text import one_line
from busybot.objects.partnet.annotation import Number, Value, Vector3, equal_values
from busybot.objects.partnet.urdf import Urdf

Kind = Literal["two-state", "multi-direction"]
Category = Literal["Switch", "Lamp", "Door", "Toy"]
LinkName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,64}$")]


class EffectChoice(FrozenModel):
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
        if alike := equal_values("states", self.states or ()) or equal_values("steps", self.steps or ()):
            raise ValueError(alike)
        return self


class Choices(FrozenModel):
    """The decisions; None leaves one to the rules.

    Attributes:
        use: false leaves the object out of the library.
        category: a Switch is a trigger, a Lamp, Door or Toy a responder.
        scale: object units to board units.
        orientation: upright pose, quaternion (x, y, z, w); afterwards z points to the camera.
        links: a trigger's movable links and their kinds.
        directions: effective directions of a trigger that is not turned, board frame; strict mode only.
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


MAX_BYTES = 1 << 20
_HINT = "compare with what `busybot assets import RAW --review FILE` writes"
_HEADER = """\
# How `busybot assets import` would annotate these objects. Edit, then import them with --overrides and this file.
# A field that you delete is left to the rules; `use: false` leaves an object out. Answer each QUESTION by its field.
# scale: object units to board units (the board is 4 x 4). orientation: quaternion x, y, z, w.
# links: two-state or multi-direction.
# effect: colours in 0..1, or joint positions: radians, of sliding joints board units.
"""


@dataclass(frozen=True)
class Overrides:
    """A reviewer's decisions.

    Attributes:
        path: the file, None when there is none.
        choices: by object id.
        lines: line number, from 1, by place in the document: (`objects`, `40147`, `scale`).
    """

    path: Path | None
    choices: dict[str, Choices]
    lines: dict[tuple[str, ...], int]

    def where(self, *place: str) -> str:
        """The file, the line of `place` or of what holds it, and `place`."""
        known = next((self.lines[place[:end]] for end in range(len(place), -1, -1) if place[:end] in self.lines), 1)
        return f"{self.path}, line {known}: {'.'.join(place) or 'the document'}"

    def check_names(self, instance: str, links: Sequence[str], urdf: Urdf) -> None:
        """Refuse links and joints that the object does not have."""
        given = self.choices[instance]
        place = ("objects", instance)
        for link in given.links or ():
            self._known("moving link", link, links, *place, "links", link)
        if given.effect is None:
            return
        if given.effect.link is not None:
            shown = [joint.child for joint in urdf.joints if urdf.visuals.get(joint.child)]
            self._known("link that shows something", given.effect.link, shown, *place, "effect", "link")
        movable = [joint.name for joint in urdf.joints if joint.type != "fixed"]
        for joint in given.effect.joints:
            self._known("movable joint", joint, movable, *place, "effect", "joints")

    def _known(self, what: str, name: str, known: Sequence[str], *place: str) -> None:
        if name not in known:
            hint = f"the object has {', '.join(known) or 'none'}"
            raise BusybotError(f"{self.where(*place)}: {name!r} is no {what}", hint)


def read_overrides(path: Path) -> Overrides:
    """Read a reviewed file.

    Raises:
        BusybotError: it cannot be read or is not of this form; names file, line and place.
    """
    try:
        if not path.is_file():
            raise BusybotError(f"{path}: there is no such file", "write one with `busybot assets import RAW --review`")
        if path.stat().st_size > MAX_BYTES:
            raise BusybotError(f"{path}: more than the {MAX_BYTES} bytes allowed", _HINT)
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise BusybotError(f"{path}: cannot be read as text: {error}", "make it readable, as UTF-8") from None
    try:
        check_tokens(str(path), text)
        loader = yaml.SafeLoader(text)
        node = loader.get_single_node()
        lines = _lines(path, node)
        value: Any = loader.construct_document(node) if node is not None else None
    except DAMAGED_YAML as error:
        raise BusybotError(f"{path}{yaml_fault(error)}", _HINT) from None
    found = Overrides(path, {}, lines)
    objects = value.get("objects") if isinstance(value, dict) else None
    if not isinstance(objects, dict) or set(value) != {"objects"}:
        raise BusybotError(f"{found.where()}: is not a mapping with the one key `objects`", _HINT)
    for instance, entry in objects.items():
        found.choices[str(instance)] = _choices(found, str(instance), entry)
    return found


def _choices(found: Overrides, instance: str, entry: Any) -> Choices:
    try:
        return Choices.model_validate(entry)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = ("objects", instance, *(str(part)[:64] for part in first["loc"]))
        message = first["msg"].removeprefix("Value error, ")[:300]
        raise BusybotError(f"{found.where(*place)}: {message}", _HINT) from None


def _lines(path: Path, root: yaml.Node | None) -> dict[tuple[str, ...], int]:
    """Line numbers by place; keys that stand twice are refused."""
    lines: dict[tuple[str, ...], int] = {}
    waiting: list[tuple[tuple[str, ...], Any]] = [((), root)]
    while waiting:
        place, node = waiting.pop()
        if isinstance(node, yaml.MappingNode):
            for key, inner in node.value:
                name, line = (*place, str(key.value)), key.start_mark.line + 1
                if name in lines:
                    raise BusybotError(f"{path}, line {line}: {'.'.join(name)} stands twice", "keep one of them")
                lines[name] = line
                waiting.append((name, inner))
        elif isinstance(node, yaml.SequenceNode):
            for index, inner in enumerate(node.value):
                lines[*place, str(index)] = inner.start_mark.line + 1
                waiting.append(((*place, str(index)), inner))
    return lines


def write_review(
    path: Path, proposals: Mapping[str, tuple[Choices, Sequence[str], Sequence[str]]], refused: Mapping[str, str]
) -> None:
    """Write a proposal: by object id the choices, with comments: why, and questions; refused objects are comments."""
    parts = [_HEADER, "objects:\n" if proposals else "objects: {}\n"]
    for instance, (choices, notes, questions) in proposals.items():
        parts += [f"  # {one_line(note)}\n" for note in notes]
        parts += [f"  # QUESTION: {one_line(question)}\n" for question in questions]
        value = choices.model_dump(mode="json", exclude_none=True)
        text = yaml.safe_dump({instance: value}, sort_keys=False, default_flow_style=None, width=110)
        parts += [f"  {line}\n" for line in text.splitlines()]
    parts += [f"# {one_line(instance)} is refused: {one_line(problem)}\n" for instance, problem in refused.items()]
    write_atomically(path, "".join(parts).encode())
