"""The channels of a recording: their topics, what may be known from each, their schemas and the classes of messages.

Everything under /truth is privileged: what no camera shows, or what the simulator alone knows exactly.

Descriptors of the messages that no Foxglove schema covers are built from `MESSAGES`, which takes a step's from
`schema.STEP_FIELDS`. There is no generated code, which would be tied to the protobuf version that generated it.
`busybot.proto` says the same for people and other programs; a test compares.
"""

from functools import cache
from typing import Any, NamedTuple

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import FieldDescriptorProto

from busybot.episodes.schema import STEP_FIELDS

PACKAGE = "busybot.v1"
FILE_NAME = "busybot/episodes/busybot.proto"
"""Stands in every recording: it stays as it is, wherever the file lies."""

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

SCHEMAS = {
    RGB: "foxglove.CompressedImage",
    DEPTH: "foxglove.CompressedImage",
    CALIBRATION: "foxglove.CameraCalibration",
    TRANSFORMS: "foxglove.FrameTransforms",
    SCENE: "foxglove.SceneUpdate",
    LOG: "foxglove.Log",
    SEGMENTATION: "foxglove.CompressedImage",
    JOINTS: "foxglove.JointStates",
    GOAL_RGB: "foxglove.CompressedImage",
    GOAL_DEPTH: "foxglove.CompressedImage",
    GOAL_SEGMENTATION: "foxglove.CompressedImage",
    OBJECTS: f"{PACKAGE}.Objects",
    STEP: f"{PACKAGE}.Step",
    BOXES: f"{PACKAGE}.Boxes",
    LINKS: f"{PACKAGE}.Links",
    RELATIONS: f"{PACKAGE}.Relations",
    STEP_TRUTH: f"{PACKAGE}.StepTruth",
    GOAL_BOXES: f"{PACKAGE}.Boxes",
}
"""Name of each topic's schema, with its package."""

BOARD_FRAME, CAMERA_FRAME = "board", "camera"
METADATA = "busybot"
BOARD_FILE, RECORDING_FILE = "board.json", "recording.json"

SECOND = 1_000_000_000
"""Simulation time in ns between two frames: frame k is at k seconds, and so is step k, which starts from it."""


def _field(name: str, kind: str, number: int, repeated: bool) -> FieldDescriptorProto:
    """A field; `kind` is a scalar type or, with a capital letter, the name of another message of ours."""
    label = FieldDescriptorProto.LABEL_REPEATED if repeated else FieldDescriptorProto.LABEL_OPTIONAL
    head, *tail = name.split("_")
    camel_case = head + "".join(map(str.capitalize, tail))
    field = FieldDescriptorProto(name=name, number=number, label=label, json_name=camel_case)
    if kind.islower():
        field.type = FieldDescriptorProto.Type.Value(f"TYPE_{kind.upper()}")
    else:
        field.type, field.type_name = FieldDescriptorProto.TYPE_MESSAGE, f".{PACKAGE}.{kind}"
    return field


def _numbered(**kinds: str | list[str]) -> list[FieldDescriptorProto]:
    """Fields with numbers in their order, from 1: new ones come last. The type of a repeated one stands in a list."""
    return [
        _field(name, kind[0] if isinstance(kind, list) else kind, number, isinstance(kind, list))
        for number, (name, kind) in enumerate(kinds.items(), start=1)
    ]


def _of_step(privileged: bool) -> list[FieldDescriptorProto]:
    """The fields of a step that everybody may read, or those of its truth; both have the index."""
    fields = [
        _field(name, field.wire.type, field.wire.number + i, bool(field.shape) and not field.wire.each)
        for field in STEP_FIELDS
        if field.wire and (field.privileged == privileged or field.name == "index")
        for i, name in enumerate(field.wire_names)
    ]
    return sorted(fields, key=lambda field: field.number)


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
    """A serialized FileDescriptorSet with the named message and those it is made of: its schema in MCAP."""
    package, _, message = name.rpartition(".")
    if package != PACKAGE:
        import foxglove.messages

        schema: bytes = getattr(foxglove.messages, message).get_schema().data
        return schema
    wanted = {message}
    for whole in reversed(MESSAGES):
        if whole in wanted:
            wanted |= {field.type_name.rpartition(".")[2] for field in MESSAGES[whole]}
    file = descriptor_pb2.FileDescriptorProto(name=FILE_NAME, package=PACKAGE, syntax="proto3")
    for part in (part for part in MESSAGES if part in wanted):
        file.message_type.add(name=part, field=MESSAGES[part])
    return descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString(deterministic=True)


@cache
def message_class(name: str) -> Any:
    """The class of a message, by the name of its schema, e.g. "busybot.v1.Step"."""
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(message_schema(name)).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))
