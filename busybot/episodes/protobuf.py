"""Protobuf classes of the recording's messages, made at run time from their one definition, `busybot.proto`.

No generated code: that is tied to the protobuf version that generated it. The parser knows what `busybot.proto` uses:
top-level messages whose fields are scalars, repeated scalars or messages of the same file.
"""

import re
from functools import cache
from importlib.resources import files
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

PACKAGE = "busybot.v1"

_FIELD = re.compile(r"^(?P<repeated>repeated )?(?P<type>\w+) (?P<name>\w+) = (?P<number>\d+);$")
_MESSAGE = re.compile(r"^message (\w+) \{$")
_Field = descriptor_pb2.FieldDescriptorProto
_SCALARS = {
    "bool": _Field.TYPE_BOOL,
    "bytes": _Field.TYPE_BYTES,
    "double": _Field.TYPE_DOUBLE,
    "float": _Field.TYPE_FLOAT,
    "sint32": _Field.TYPE_SINT32,
    "string": _Field.TYPE_STRING,
    "uint32": _Field.TYPE_UINT32,
}


@cache
def message_schema(name: str) -> bytes:
    """A serialized FileDescriptorSet with one of our messages and those it is made of: its schema in MCAP."""
    file = _definition()
    wanted, names = [name], set()
    while wanted:
        names.add(wanted.pop())
        fields = [field for message in file.message_type if message.name in names for field in message.field]
        wanted = [n for n in (field.type_name.rsplit(".")[-1] for field in fields) if n and n not in names]
    part = descriptor_pb2.FileDescriptorProto(name=file.name, package=file.package, syntax=file.syntax)
    part.message_type.extend(message for message in file.message_type if message.name in names)
    return descriptor_pb2.FileDescriptorSet(file=[part]).SerializeToString(deterministic=True)


@cache
def _definition() -> descriptor_pb2.FileDescriptorProto:
    return parse_proto(files("busybot.episodes").joinpath("busybot.proto").read_text(encoding="utf-8"))


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


def parse_proto(text: str) -> descriptor_pb2.FileDescriptorProto:
    """The descriptor of a proto3 file; ValueError on anything that the parser does not know."""
    file = descriptor_pb2.FileDescriptorProto(name="busybot/episodes/busybot.proto", package=PACKAGE, syntax="proto3")
    message: Any = None
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.split("//")[0].strip()
        if line in ("", 'syntax = "proto3";', f"package {PACKAGE};"):
            continue
        if message is None and (match := _MESSAGE.match(line)):
            message = file.message_type.add(name=match[1])
        elif message is not None and line == "}":
            message = None
        elif message is not None and (match := _FIELD.match(line)):
            _add_field(message, match)
        else:
            raise ValueError(f"busybot.proto:{number}: cannot parse {line!r}")
    return file


def _add_field(message: Any, match: re.Match[str]) -> None:
    field = message.field.add(name=match["name"], number=int(match["number"]))
    field.label = _Field.LABEL_REPEATED if match["repeated"] else _Field.LABEL_OPTIONAL
    field.json_name = re.sub(r"_(\w)", lambda m: m[1].upper(), match["name"])
    if match["type"] in _SCALARS:
        field.type = _SCALARS[match["type"]]
    else:
        field.type = _Field.TYPE_MESSAGE
        field.type_name = f".{PACKAGE}.{match['type']}"
