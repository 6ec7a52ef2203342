"""Protobuf messages of a recording that no Foxglove schema covers, and their classes.

Descriptors are built from the list of messages below and `schema.STEP_FIELDS`; there is no generated code, which would
be tied to the protobuf version that generated it. `busybot.proto` says the same for other programs.
"""

from functools import cache
from typing import Any, NamedTuple

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from busybot.episodes.schema import STEP_FIELDS

PACKAGE = "busybot.v1"
FILE_NAME = "busybot/episodes/busybot.proto"
"""Stands in every recording: it stays as it is, wherever the file lies."""

_Field = descriptor_pb2.FieldDescriptorProto
_SCALARS = {
    "bool": _Field.TYPE_BOOL,
    "double": _Field.TYPE_DOUBLE,
    "float": _Field.TYPE_FLOAT,
    "sint32": _Field.TYPE_SINT32,
    "string": _Field.TYPE_STRING,
    "uint32": _Field.TYPE_UINT32,
}
_HEAD = f"""\
// Messages of an episode that no Foxglove schema covers. Numbers and types of fields never change their meaning;
// new fields get new numbers. Units: board units, radians, pixels. Frames: see episodes/episode.py.
syntax = "proto3";

package {PACKAGE};
"""


class Field(NamedTuple):
    """A field of a message; `type` is a scalar type or the name of another message."""

    name: str
    type: str
    number: int
    repeated: bool


class Message(NamedTuple):
    """A message; `comment` says what it holds."""

    name: str
    comment: str
    fields: tuple[Field, ...]


def _numbered(**types: str | list[str]) -> tuple[Field, ...]:
    """Fields with numbers in their order, from 1: new ones come last. The type of a repeated one stands in a list."""
    return tuple(
        Field(name, kind[0] if isinstance(kind, list) else kind, number, isinstance(kind, list))
        for number, (name, kind) in enumerate(types.items(), start=1)
    )


def _of_step(privileged: bool) -> tuple[Field, ...]:
    """The fields of a step that everybody may read, or those of its truth; both have the index."""
    fields = [
        Field(name, field.wire.type, field.wire.number + i, bool(field.shape) and not field.wire.each)
        for field in STEP_FIELDS
        if field.wire and (field.privileged == privileged or field.name == "index")
        for i, name in enumerate(field.wire_names)
    ]
    return tuple(sorted(fields, key=lambda field: field.number))


MESSAGES = (
    Message(
        "Step",
        "One proposed action and what everybody could see of its outcome. Topic /step, at the time of the frame "
        "before.",
        _of_step(privileged=False),
    ),
    Message("StepTruth", "What only the simulator knows about a step. Topic /truth/step.", _of_step(privileged=True)),
    Message(
        "Object",
        "An object as the first image shows it; NaN and -1 where it is not visible.",
        _numbered(role="string", position=["float"], box=["sint32"]),
    ),
    Message("Objects", "All objects in the board's order. Topic /objects, once.", _numbered(objects=["Object"])),
    Message(
        "Boxes",
        "Boxes of all objects in one stored image: u0, v0, u1, v1 for each. Topic /truth/boxes.",
        _numbered(image="uint32", frame="uint32", corners=["sint32"]),
    ),
    Message(
        "Link",
        "A link that the segmentation names by 1 + its position in the list.",
        _numbered(object="uint32", name="string", trigger="bool"),
    ),
    Message("Links", "Topic /truth/links, once.", _numbered(links=["Link"])),
    Message("Trigger", "A trigger of a relation.", _numbered(object="uint32", link="string")),
    Message(
        "Relation",
        "What controls what; see boards/spec.py. `parameters` is JSON.",
        _numbered(
            kind="string",
            triggers=["Trigger"],
            responder="uint32",
            stage="string",
            states=["uint32"],
            parameters="string",
        ),
    ),
    Message("Relations", "Topic /truth/relations, once.", _numbered(relations=["Relation"])),
)
"""In the order in which they are declared: a message after those it is made of."""


@cache
def message_schema(name: str) -> bytes:
    """A serialized FileDescriptorSet with one of our messages and those it is made of: its schema in MCAP."""
    wanted = {name}
    for message in reversed(MESSAGES):
        if message.name in wanted:
            wanted |= {field.type for field in message.fields}
    file = descriptor_pb2.FileDescriptorProto(name=FILE_NAME, package=PACKAGE, syntax="proto3")
    file.message_type.extend(_descriptor(message) for message in MESSAGES if message.name in wanted)
    return descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString(deterministic=True)


def _descriptor(message: Message) -> descriptor_pb2.DescriptorProto:
    described = descriptor_pb2.DescriptorProto(name=message.name)
    for name, kind, number, repeated in message.fields:
        head, *tail = name.split("_")
        field = described.field.add(name=name, number=number, json_name=head + "".join(map(str.capitalize, tail)))
        field.label = _Field.LABEL_REPEATED if repeated else _Field.LABEL_OPTIONAL
        field.type = _SCALARS.get(kind, _Field.TYPE_MESSAGE)
        if kind not in _SCALARS:
            field.type_name = f".{PACKAGE}.{kind}"
    return described


def proto_text() -> str:
    """The text of `busybot.proto`."""
    parts = [_HEAD]
    for message in MESSAGES:
        fields = [f"  {'repeated ' * f.repeated}{f.type} {f.name} = {f.number};\n" for f in message.fields]
        parts.append(f"\n// {message.comment}\nmessage {message.name} {{\n{''.join(fields)}}}\n")
    return "".join(parts)


@cache
def message_class(name: str) -> Any:
    """The class of one of our messages, e.g. "Step"."""
    return _classes(message_schema(name))[f"{PACKAGE}.{name}"]


@cache
def compressed_image_class() -> Any:
    """The class of Foxglove's CompressedImage, from the schema that foxglove-sdk writes."""
    from foxglove.messages import CompressedImage

    return _classes(CompressedImage.get_schema().data)["foxglove.CompressedImage"]


@cache
def _classes(descriptors: bytes) -> dict[str, Any]:
    pool = descriptor_pool.DescriptorPool()
    found = {}
    for file in descriptor_pb2.FileDescriptorSet.FromString(descriptors).file:
        pool.Add(file)
        for message in file.message_type:
            name = f"{file.package}.{message.name}"
            found[name] = message_factory.GetMessageClass(pool.FindMessageTypeByName(name))
    return found
