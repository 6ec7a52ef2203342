"""The contract between recording, training and viewing: tables, columns, units, frames, and who may know what.

The version is the schema's own. Same major version: an older reader may ignore new columns and messages. Values that a
recording cannot know (a real board has no joints, perhaps no depth) are null.

Columns marked privileged hold what is kept from learners: they select with
`public_columns`. The MCAP files are the source, tables can always be made again from them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from types import MappingProxyType
from typing import Literal, NamedTuple

import pyarrow as pa

SCHEMA_VERSION = "1.2"
"""1.1: boards with tasks, goal images. 1.2: boards of other worlds, what their mechanisms remember."""

BOARD = "board: x right, y up in the picture, z towards the camera"
PIXELS = "image: column u, row v from the upper left corner"

UNKNOWN_PIXEL = (-1, -1)
"""Of an action that was not chosen in an image."""

_NUMBERS = pa.list_(pa.field("element", pa.float64()))
_INTEGERS = pa.list_(pa.field("element", pa.int32()))
_SMALL_NUMBERS = pa.list_(pa.field("element", pa.int8()))


@dataclass(frozen=True)
class Column:
    """One column: `unit` and `frame` are empty where a value has none.

    Attributes:
        later: whether tables of the first version do not have it; they are read as if it were null there.
    """

    name: str
    type: pa.DataType
    description: str
    unit: str = ""
    frame: str = ""
    privileged: bool = False
    nullable: bool = False
    later: bool = False

    def field(self) -> pa.Field:
        """The pyarrow field, with unit, frame, description and privilege as its metadata."""
        metadata = {"description": self.description, "privileged": str(self.privileged).lower()}
        metadata |= {key: value for key, value in (("unit", self.unit), ("frame", self.frame)) if value}
        return pa.field(self.name, self.type, nullable=self.nullable, metadata=metadata)


def _vector(name: str, description: str, unit: str, nullable: bool = False) -> list[Column]:
    return [
        Column(f"{name}_{axis}", pa.float32(), f"{description}, {axis}", unit, BOARD, nullable=nullable)
        for axis in "xyz"
    ]


def _box(name: str, description: str, privileged: bool) -> list[Column]:
    sides = (("u0", "left"), ("v0", "top"), ("u1", "right, exclusive"), ("v1", "bottom, exclusive"))
    return [
        Column(f"{name}_{side}", pa.int16(), f"{description}: {text}", "pixel", PIXELS, privileged, nullable=True)
        for side, text in sides
    ]


def _truth(name: str, kind: pa.DataType, description: str, unit: str = "", later: bool = False) -> Column:
    return Column(name, kind, description, unit, privileged=True, nullable=True, later=later)


_EPISODE = Column("episode", pa.int32(), "index of the episode in its dataset, and of its board")

_EPISODES = (
    _EPISODE,
    Column("board", pa.int32(), "index of the board as the board itself records it"),
    Column("seed", pa.int64(), "seed of the dataset from which the board was drawn"),
    Column("split", pa.string(), "train, novel-config, novel-object, or a name given by who recorded"),
    Column("appearance_group", pa.int32(), "boards of a group share everything but their relations"),
    Column("policy", pa.string(), "name of the policy that chose the actions"),
    Column("oracle", pa.bool_(), "whether the policy knew what only the simulator knows"),
    Column("steps", pa.int32(), "number of proposed actions"),
    Column("images", pa.int32(), "number of stored images: frames that show no change share one"),
    Column("objects", pa.int16(), "number of objects on the board"),
    Column("bytes", pa.int64(), "size of the MCAP file", "byte"),
    Column("image_format", pa.string(), "encoding of RGB: jpeg or png"),
    Column("depth", pa.bool_(), "whether depth was recorded"),
    Column("segmentation", pa.bool_(), "whether segmentation was recorded"),
    Column("truth", pa.bool_(), "whether states were recorded; false for a board without a simulator"),
    Column("delta", pa.int32(), "changed pixels that a reward must exceed", "pixel", nullable=True),
    Column("strict", pa.bool_(), "whether moves off the annotated directions were vetoed", nullable=True),
    Column("width", pa.int16(), "image width", "pixel"),
    Column("height", pa.int16(), "image height", "pixel"),
    Column("camera_matrix", _NUMBERS, "3 x 3 intrinsics, row by row", "pixel"),
    Column("camera_pose", _NUMBERS, "4 x 4 camera to board, row by row", "board unit", BOARD),
    Column("schema_version", pa.string(), "version of this schema with which the file was written"),
    _truth("checksum", pa.int64(), "CRC-32 over the data of the MCAP file, as its own end tells it", later=True),
    Column("settings", pa.string(), "everything else that decided the outcome, JSON"),
    Column("renderer", pa.string(), "fingerprint of the renderer, JSON"),
    Column("versions", pa.string(), "package versions at recording, JSON"),
    Column("successes", pa.int32(), "steps whose action changed a trigger state", privileged=True, nullable=True),
    Column("board_digest", pa.string(), "SHA-256 over the board's values", privileged=True),
    Column("trace_digest", pa.string(), "SHA-256 over actions and discrete states", privileged=True),
    Column("content_digest", pa.string(), "SHA-256 over all that was recorded, images decoded", privileged=True),
)


Compared = Literal["action", "state", "reward", "joints"]


class Wire(NamedTuple):
    """Where Protobuf keeps a value: type and number of its field; with `each`, a field for each of its columns."""

    type: str
    number: int
    each: bool = False


class Hashed(NamedTuple):
    """Where a value enters a hash over steps: values of one place make one list, in the order of their parts."""

    digest: Literal["trace", "content"]
    place: int
    part: int = 1


@dataclass(frozen=True)
class StepField:
    """One value of a recorded step: what it is, where it is stored, how it is hashed and compared.

    Messages, reader, writer, tables, hashes, comparison and reference follow from it. A new value needs an attribute of
    `episode.Step`, a number that no message ever used, and in `since` the version that brings it.

    Attributes:
        name: of the attribute of `episode.Step`; `index`, `image_before` and `image_after` say where the step stands.
        columns: of table `steps`; meaning, type, unit, frame and privilege of the value are theirs.
        wire: in message `Step`, or `StepTruth` if privileged; None for what follows from another value.
        hashed: None for what follows from other values, and for the order of images, which is hashed by itself.
        compared: what differs when it differs, see `episode_diff.Difference`; the number of joints counts as state.
        shape: () for a scalar; else how many components there are, or of what there is one each.
        unknown: null in the table, likewise privileged scalars of a recording without truth.
        tolerance: differences up to here do not count.
        since: the version of the schema that brought it.
    """

    name: str
    columns: tuple[Column, ...]
    wire: Wire | None = None
    hashed: Hashed | None = None
    compared: Compared | None = None
    shape: tuple[int | Literal["directions", "triggers", "objects", "memories"], ...] = ()
    unknown: tuple[int, ...] | None = None
    tolerance: float = 0.0
    since: str = "1.0"

    @cached_property
    def privileged(self) -> bool:
        """Whether learners are kept from it."""
        return self.columns[0].privileged

    @cached_property
    def stored(self) -> pa.DataType:
        """Type in the table of the value or of each of its components: the precision that is hashed and compared."""
        kind = self.columns[0].type
        return kind.value_type if pa.types.is_list(kind) else kind

    @cached_property
    def wire_names(self) -> tuple[str, ...]:
        """Names of its fields in Protobuf."""
        return tuple(column.name for column in self.columns) if self.wire and self.wire.each else (self.name,)


_PIXEL = "null if the action was not chosen in an image"
_STEPS = (
    _EPISODE,
    Column("step", pa.int32(), "step k leads from frame k to frame k + 1"),
    Column("image_before", pa.int32(), "index of the stored image that shows the frame before"),
    Column("image_after", pa.int32(), "index of the stored image that shows the frame after"),
    Column("pixel_u", pa.int16(), f"chosen column; {_PIXEL}", "pixel", PIXELS, nullable=True),
    Column("pixel_v", pa.int16(), f"chosen row; {_PIXEL}", "pixel", PIXELS, nullable=True),
    *_vector("position", "where the gripper acts", "board unit"),
    Column("direction", pa.int8(), "index of the proposed direction among the 18"),
    *_vector("direction", "unit vector of the proposed direction", "1"),
    Column("executed", _SMALL_NUMBERS, "directions that were tried, in order, vetoed ones among them"),
    Column("distance", pa.float32(), "reached in the last executed direction when the motion stopped", "board unit"),
    Column("changed_pixels", pa.int32(), "pixels that differ between the raw images before and after", "pixel"),
    Column("reward", pa.int8(), "1 if changed_pixels exceeds delta, or, if joint states reward, if one changed"),
    _truth("vetoed", pa.bool_(), "strict mode vetoed every direction, so that nothing could move"),
    _truth("acted_object", pa.int16(), "index of the object that the gripper held, -1 for a miss"),
    _truth("acted_link", pa.string(), "name of the link that the gripper held, empty for a miss"),
    _truth("success", pa.bool_(), "a trigger state changed because of the action"),
    _truth("trigger_states_before", _SMALL_NUMBERS, "discrete state of every trigger link"),
    _truth("trigger_states_after", _SMALL_NUMBERS, "discrete state of every trigger link"),
    _truth("responder_states_before", _SMALL_NUMBERS, "state of every object, -1 for triggers"),
    _truth("responder_states_after", _SMALL_NUMBERS, "state of every object, -1 for triggers"),
    _truth("memory_after", _INTEGERS, "what the mechanisms remember, if anything", later=True),
    _truth("joint_positions_before", _NUMBERS, "of every trigger link", "radian or board unit"),
    _truth("joint_positions_after", _NUMBERS, "of every trigger link", "radian or board unit"),
)


def _of(*names: str) -> tuple[Column, ...]:
    return tuple(column for column in _STEPS if column.name in names)


def _scalar(name: str, wire: Wire, hashed: Hashed | None = None, compared: Compared | None = None) -> StepField:
    return StepField(name, _of(name), wire, hashed, compared)


def _states(name: str, number: int, each: Literal["triggers", "objects"]) -> StepField:
    return StepField(name, _of(name), Wire("sint32", number), Hashed("trace", number), "state", (each,), ())


def _joints(name: str, number: int, place: int) -> StepField:
    wire, hashed = Wire("double", number), Hashed("content", place)
    return StepField(name, _of(name), wire, hashed, "joints", ("triggers",), (), tolerance=1e-5)


_PIXEL_COLUMNS, _POSITION_COLUMNS = _of("pixel_u", "pixel_v"), _of("position_x", "position_y", "position_z")
STEP_FIELDS: tuple[StepField, ...] = (
    StepField("index", _of("step"), Wire("uint32", 1)),
    _scalar("image_before", Wire("uint32", 2)),
    _scalar("image_after", Wire("uint32", 3)),
    StepField("pixel", _PIXEL_COLUMNS, Wire("sint32", 4, each=True), Hashed("trace", 1), "action", (2,), UNKNOWN_PIXEL),
    StepField("position", _POSITION_COLUMNS, Wire("float", 6), Hashed("trace", 3), "action", (3,)),
    _scalar("direction", Wire("uint32", 7), Hashed("trace", 1, part=2), "action"),
    StepField("direction_vector", _of("direction_x", "direction_y", "direction_z"), shape=(3,)),
    StepField("executed", _of("executed"), Wire("uint32", 8), Hashed("trace", 2), "action", ("directions",)),
    _scalar("distance", Wire("double", 9), Hashed("trace", 3, part=2), "action"),
    _scalar("changed_pixels", Wire("uint32", 10), Hashed("content", 1), "reward"),
    _scalar("reward", Wire("uint32", 11), Hashed("content", 1, part=2), "reward"),
    _scalar("vetoed", Wire("bool", 5), Hashed("trace", 4, part=3), "state"),
    _scalar("acted_object", Wire("sint32", 2), Hashed("trace", 4), "state"),
    _scalar("acted_link", Wire("string", 3), Hashed("trace", 5), "state"),
    _scalar("success", Wire("bool", 4), Hashed("trace", 4, part=2), "state"),
    _states("trigger_states_before", 6, "triggers"),
    _states("trigger_states_after", 7, "triggers"),
    _states("responder_states_before", 8, "objects"),
    _states("responder_states_after", 9, "objects"),
    StepField(
        "memory_after",
        _of("memory_after"),
        Wire("sint32", 12),
        Hashed("trace", 9, part=2),
        "state",
        ("memories",),
        (),
        since="1.2",
    ),
    _joints("joint_positions_before", 10, 2),
    _joints("joint_positions_after", 11, 3),
)
"""The one description of a recorded step, in the order of the table's columns."""

_OBJECTS = (
    _EPISODE,
    Column("frame", pa.int32(), "frame 0 is the initial observation"),
    Column("object", pa.int16(), "index of the object on its board"),
    Column("role", pa.string(), "trigger or responder"),
    *_vector("position", "visible centre in the first image", "board unit", nullable=True),
    *_box("first_box", "box in the first image", privileged=False),
    *_box("box", "box in this frame's image; a door's tells its state", privileged=True),
    _truth("category", pa.string(), "kind of object"),
    _truth("instance", pa.string(), "which object of its kind"),
    _truth("yaw", pa.float32(), "turn about z, counter-clockwise", "radian"),
    _truth("scale", pa.float32(), "object units to board units"),
)

TABLES: Mapping[str, tuple[Column, ...]] = MappingProxyType(dict(episodes=_EPISODES, steps=_STEPS, objects=_OBJECTS))


@cache
def arrow_schema(table: str) -> pa.Schema:
    """The pyarrow schema of `episodes`, `steps` or `objects`; the version is in its metadata."""
    metadata = {"busybot_schema_version": SCHEMA_VERSION, "busybot_table": table}
    return pa.schema([column.field() for column in TABLES[table]], metadata=metadata)


def public_columns(table: str) -> list[str]:
    """Names of the columns that learners may read."""
    return [column.name for column in TABLES[table] if not column.privileged]
