"""An episode as tables that other tools open: a row per frame, with the pictures as they were recorded.

`TABLES` says what there is. The first three hold what a robot has and nothing else; those whose names begin with
`privileged` hold what only the simulator knows, and are made only for who asks for them. Row `frame` of `frames` is
what was seen, and the action that was then taken; after the last action there is a frame more, without an action.

Pictures are columns of the structure (bytes, path) that Hugging Face's `Image` has, the bytes those of the recording:
JPEG or PNG for colours, a 16-bit PNG for depth. A stored depth v >= 1 is depth_offset + v * depth_scale board units
(both in table `episodes`), 0 is nothing.
"""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pyarrow as pa

from busybot.episodes.codec import PNG_MAGIC, LazyImages
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.schema import SCHEMA_VERSION, Column
from busybot.episodes.schema import TABLES as RECORDED
from busybot.episodes.tables import object_columns, step_columns

EPISODES_FOLDER = "episodes"
IMAGE = pa.struct([pa.field("bytes", pa.binary()), pa.field("path", pa.string())])
PRIVILEGED = "privileged_"

_EPISODE = RECORDED["episodes"][0]
_FRAME = Column("frame", pa.int32(), "frame 0 is the initial observation, frame k what k actions have left")
_OBJECT = Column("object", pa.int16(), "index of the object on its board")
_KEYS = {"episode", "step", "frame", "object", "image_before", "image_after", "bytes", "image_format"}


def _image(name: str, description: str, privileged: bool = False) -> Column:
    return Column(name, IMAGE, description, privileged=privileged, nullable=True)


def _of(table: str, privileged: bool) -> tuple[Column, ...]:
    """The columns of a recorded table that learners may read, or those that they may not; keys are left out."""
    found = (column for column in RECORDED[table] if column.privileged == privileged and column.name not in _KEYS)
    return tuple(replace(column, nullable=True) for column in found)


TABLES: Mapping[str, tuple[Column, ...]] = MappingProxyType(
    {
        "frames": (
            _EPISODE,
            _FRAME,
            _image("rgb", "the board in colours"),
            _image("depth", "distance along the camera's axis as a 16-bit PNG, null if not recorded"),
            *_of("steps", privileged=False),
        ),
        "objects": (_EPISODE, _OBJECT, *_of("objects", privileged=False)),
        "episodes": (
            _EPISODE,
            *_of("episodes", privileged=False),
            Column("depth_offset", pa.float64(), "depth of a stored value v >= 1 is offset + v * scale", "board unit"),
            Column("depth_scale", pa.float64(), "see there", "board unit"),
            _image("goal", "the board in colours in the goal of its task, null without one"),
        ),
        f"{PRIVILEGED}frames": (
            _EPISODE,
            _FRAME,
            _image("segmentation", "PNG of indices: 0 for board and background, else 1 + index into `links`", True),
            *_of("steps", privileged=True),
        ),
        f"{PRIVILEGED}objects": (_EPISODE, _FRAME, _OBJECT, *_of("objects", privileged=True)),
        f"{PRIVILEGED}episodes": (
            _EPISODE,
            *_of("episodes", privileged=True),
            Column(
                "links", pa.string(), "JSON: object, name and whether it is a trigger of each link", privileged=True
            ),
            Column("board_spec", pa.string(), "JSON: the board with its relations", privileged=True),
        ),
    }
)
"""By name: what a robot has, and with it what was done; then what only the simulator knows."""


def table_names(privileged: bool) -> list[str]:
    """Names of the tables that an export has."""
    return [name for name in TABLES if privileged or not name.startswith(PRIVILEGED)]


def arrow_schema(table: str) -> pa.Schema:
    """Schema of a table; its metadata tell Hugging Face's readers which columns are pictures."""
    pictures = [column.name for column in TABLES[table] if column.type == IMAGE]
    metadata = image_features(pictures) | {"busybot_schema_version": SCHEMA_VERSION, "busybot_table": table}
    return pa.schema([column.field() for column in TABLES[table]], metadata=metadata)


def image_features(names: list[str]) -> dict[str, str]:
    """Metadata of a schema in which these columns are pictures."""
    features = {name: {"_type": "Image"} for name in names}
    return {"huggingface": json.dumps({"info": {"features": features}})} if names else {}


def episode_tables(path: Path, row: dict[str, Any], privileged: bool) -> dict[str, pa.Table]:
    """The tables of one recording.

    Args:
        row: of the dataset's table `episodes`.

    Raises:
        BusybotError: the file cannot be read.
    """
    episode = read_episode(path, "lazy")
    stored = _stored(episode)
    columns = {"frames": _frames(episode, row["episode"]), "objects": _objects(episode)}
    columns["episodes"] = {
        **{name: [value] for name, value in row.items()},
        "depth_offset": [stored.depth_scale.offset],
        "depth_scale": [stored.depth_scale.scale],
        "goal": [_goal(episode, row["episode"])],
    }
    links = [{"object": link.object, "name": link.name, "trigger": link.trigger} for link in episode.links]
    board = {"links": [json.dumps(links)], "board_spec": [episode.board.model_dump_json()]}
    columns[f"{PRIVILEGED}frames"] = columns["frames"]
    columns[f"{PRIVILEGED}objects"] = object_columns(episode)
    columns[f"{PRIVILEGED}episodes"] = columns["episodes"] | board
    return {name: _table(name, row["episode"], columns[name]) for name in table_names(privileged)}


def _table(name: str, index: int, columns: dict[str, Any]) -> pa.Table:
    schema = arrow_schema(name)
    count = len(next(iter(columns.values())))
    values = columns | {"episode": [index] * count}
    return pa.table({column: pa.array(values[column], schema.field(column).type) for column in schema.names}, schema)


def _stored(episode: Episode) -> LazyImages:
    assert isinstance(episode.images, LazyImages)
    return episode.images


def _frames(episode: Episode, index: int) -> dict[str, Any]:
    """A row per frame: its pictures, and the values of the step that begins there, null in the last one."""
    encoded = _stored(episode).encoded
    shown = [(encoded[image], image) for image in episode.frame_of]
    columns: dict[str, Any] = {
        "frame": list(range(len(shown))),
        **{kind: [_picture(getattr(one, kind), index, kind, image) for one, image in shown] for kind in _KINDS},
    }
    return columns | {name: [*values, None] for name, values in step_columns(episode).items()}


_KINDS = ("rgb", "depth", "segmentation")


def _picture(data: bytes | None, index: int, kind: str, image: int) -> dict[str, Any] | None:
    if data is None:
        return None
    suffix = "png" if data.startswith(PNG_MAGIC) else "jpg"
    return {"bytes": data, "path": f"{EPISODES_FOLDER}/{index:06d}/{kind}/{image:05d}.{suffix}"}


def _goal(episode: Episode, index: int) -> dict[str, Any] | None:
    goals = episode.goals
    return _picture(goals.encoded[0].rgb, index, "goal", 0) if isinstance(goals, LazyImages) and len(goals) else None


def _objects(episode: Episode) -> dict[str, Any]:
    """A row per object: what the first image shows."""
    count = len(episode.board.objects)
    return {name: values[:count] for name, values in object_columns(episode).items()}
