"""Protobuf messages of a recording that no Foxglove schema covers, and their classes.

Descriptors are built from the list of messages below and `schema.STEP_FIELDS`; there is no generated code, which would
be tied to the protobuf version that generated it. `busybot.proto` says the same for people and other programs; a test
compares.

The channels of a recording: topics, schemas and what may be known from each.

Everything under /truth is privileged: what no camera shows, or what the simulator alone knows exactly.
"""

from functools import cache
from typing import Any, NamedTuple

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from busybot.episodes.schema import STEP_FIELDS

RGB = "/camera/rgb"
DEPTH = "/camera/depth"
CALIBRATION = "/camera/calibration"
TRANSFORMS = "/tf"
OBJECTS = "/objects"
SCENE = "/scene"
STEP = "/step"
LOG = "/log"
SEGMENTATION = "/truth/segmentation"
BOXES = "/truth/boxes"
LINKS = "/truth/links"
RELATIONS = "/truth/relations"
JOINTS = "/truth/joints"
STEP_TRUTH = "/truth/step"
GOAL_RGB = "/goal/rgb"
GOAL_DEPTH = "/goal/depth"
GOAL_SEGMENTATION = "/truth/goal/segmentation"
GOAL_BOXES = "/truth/goal/boxes"


class Pictures(NamedTuple):
    """Where the parts of an image go."""

    rgb: str
    depth: str
    segmentation: str
    boxes: str


CAMERA = Pictures(RGB, DEPTH, SEGMENTATION, BOXES)
GOAL = Pictures(GOAL_RGB, GOAL_DEPTH, GOAL_SEGMENTATION, GOAL_BOXES)

FOXGLOVE = {
    RGB: "CompressedImage",
    DEPTH: "CompressedImage",
    CALIBRATION: "CameraCalibration",
    TRANSFORMS: "FrameTransforms",
    SCENE: "SceneUpdate",
    LOG: "Log",
    SEGMENTATION: "CompressedImage",
    JOINTS: "JointStates",
    GOAL_RGB: "CompressedImage",
    GOAL_DEPTH: "CompressedImage",
    GOAL_SEGMENTATION: "CompressedImage",
}
OWN = {
    OBJECTS: "Objects",
    STEP: "Step",
    BOXES: "Boxes",
    LINKS: "Links",
    RELATIONS: "Relations",
    STEP_TRUTH: "StepTruth",
    GOAL_BOXES: "Boxes",
}

BOARD_FRAME, CAMERA_FRAME = "board", "camera"
METADATA = "busybot"
BOARD_FILE, RECORDING_FILE = "board.json", "recording.json"

SECOND = 1_000_000_000
"""Simulation time in ns between two frames: frame k is at k seconds, and so is step k, which starts from it."""


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


class Field(NamedTuple):
    """A field of a message; `type` is a scalar type or the name of another message."""

    name: str
    type: str
    number: int
    repeated: bool


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


MESSAGES = {
    "Step": _of_step(privileged=False),
    "StepTruth": _of_step(privileged=True),
    "Object": _numbered(role="string", position=["float"], box=["sint32"]),
    "Objects": _numbered(objects=["Object"]),
    "Boxes": _numbered(image="uint32", frame="uint32", corners=["sint32"]),
    "Link": _numbered(object="uint32", name="string", trigger="bool"),
    "Links": _numbered(links=["Link"]),
    "Trigger": _numbered(object="uint32", link="string"),
    "Relation": _numbered(
        kind="string", triggers=["Trigger"], responder="uint32", stage="string", states=["uint32"], parameters="string"
    ),
    "Relations": _numbered(relations=["Relation"]),
}
"""Fields of each message, after those of the messages it is made of. `busybot.proto` says what they mean."""


@cache
def message_schema(name: str) -> bytes:
    """A serialized FileDescriptorSet with one of our messages and those it is made of: its schema in MCAP."""
    wanted = {name}
    for message in reversed(MESSAGES):
        if message in wanted:
            wanted |= {field.type for field in MESSAGES[message]}
    file = descriptor_pb2.FileDescriptorProto(name=FILE_NAME, package=PACKAGE, syntax="proto3")
    for message in (message for message in MESSAGES if message in wanted):
        described = file.message_type.add(name=message)
        for field in MESSAGES[message]:
            _add_field(described, field)
    return descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString(deterministic=True)


def _add_field(message: descriptor_pb2.DescriptorProto, field: Field) -> None:
    head, *tail = field.name.split("_")
    added = message.field.add(name=field.name, number=field.number, json_name=head + "".join(map(str.capitalize, tail)))
    added.label = _Field.LABEL_REPEATED if field.repeated else _Field.LABEL_OPTIONAL
    added.type = _SCALARS.get(field.type, _Field.TYPE_MESSAGE)
    if field.type not in _SCALARS:
        added.type_name = f".{PACKAGE}.{field.type}"


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
