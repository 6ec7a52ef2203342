"""What `dataset export` wrote as pictures and CSV (`images`) or as tables of both (`parquet`, `hf`), to a dataset.

What such an export holds comes back as it was: pictures, that of a goal among them, actions and their rewards, the
first boxes, the camera. What it does not hold is missing in the dataset, too: states, relations, joints, segmentation,
boxes of later frames, a task, depth of its goal; privileged tables are not read. So these recordings are like those of
a board without a simulator (`truth` is false). Objects get keys of the category `Unknown`. Colours are stored as PNG:
what a JPEG decoded to would not survive another JPEG.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError

from busybot.boards.directions import DIRECTIONS
from busybot.boards.spec import BoardSpec, PlacedObject
from busybot.common.atomic_io import refuse_taken
from busybot.common.errors import BusybotError, naming
from busybot.common.frozen_model import first_fault
from busybot.common.limits import MAX_PIXELS
from busybot.common.process_pool import Progress
from busybot.datasets.dataset import Dataset
from busybot.datasets.exporting.frames import EPISODES_FOLDER
from busybot.datasets.importing.csv_tables import (
    Maybe,
    Numbers,
    Pixel,
    Row,
    Text,
    Whole,
    absent,
    listed,
)
from busybot.datasets.importing.exported import HINT, ExportedRecording, exported_recordings
from busybot.datasets.importing.recording import Episodes, check_episodes, imported_info, store_episodes, unknown_step
from busybot.datasets.info import DatasetInfo, Seed
from busybot.episodes.codec import decode_plain, decode_rgb
from busybot.episodes.episode import Camera, Episode, Image, Step
from busybot.episodes.schema import UNKNOWN_PIXEL
from busybot.episodes.validation import check_camera

_SIDES = ("u0", "v0", "u1", "v1")


class _Frame(Row):
    """Of `frames.csv`: a frame, and the action that was taken there; the last has none."""

    frame: int
    rgb: str
    depth: Text = None
    pixel_u: Pixel = None
    pixel_v: Pixel = None
    position_x: Maybe = None
    position_y: Maybe = None
    position_z: Maybe = None
    direction: Whole = None
    executed: Annotated[tuple[int, ...] | None, BeforeValidator(lambda cell: listed(absent(cell)))] = None
    distance: Maybe = None
    changed_pixels: Whole = None
    reward: Whole = None


class _Object(Row):
    """Of `objects.csv`."""

    object: int
    role: str
    position_x: Maybe = None
    position_y: Maybe = None
    position_z: Maybe = None
    first_box_u0: Pixel = None
    first_box_v0: Pixel = None
    first_box_u1: Pixel = None
    first_box_v1: Pixel = None


class _Episode(Row):
    """Of `episodes.csv`, which has one line."""

    seed: Seed = 0
    split: Annotated[str, Field(min_length=1, max_length=64)] = "imported"
    appearance_group: Annotated[int, Field(ge=0, lt=2**31)] = 0
    policy: Annotated[str, Field(min_length=1, max_length=200)] = "unknown"
    oracle: bool = False
    objects: Whole = None
    width: int
    height: int
    camera_matrix: Numbers
    camera_pose: Numbers
    depth_offset: Annotated[float, Field(ge=-1e6, le=1e6)] = 0.0
    depth_scale: Annotated[float, Field(gt=0, le=1e3)] = 1.0


class _Goal(Row):
    """Of the same line; read by itself, as its picture stays in memory until the recording is forgotten."""

    goal: Text = None


def describe_export(recording: ExportedRecording) -> dict[str, object]:
    """What would be read of a recording, JSON values."""
    told = recording.rows("episodes", _Episode)[0]
    roles = [row.role for row in _objects(recording, told)]
    frames = recording.frames()
    return {
        "place": recording.place,
        "frames": frames,
        "width": told.width,
        "height": told.height,
        "actions": frames - 1,
        "triggers": roles.count("trigger"),
        "responders": roles.count("responder"),
        "relations": None,
    }


def import_export(
    source: Path, out: Path, progress: Progress | None = None, recordings: Sequence[ExportedRecording] = ()
) -> Dataset:
    """Make a dataset of the recordings of an export; it is there whole or not at all.

    Args:
        recordings: of the source, if they were looked for already.

    Raises:
        BusybotError: naming file and line, if something is missing or contradicts itself; or something is at `out`.
    """
    refuse_taken(out.absolute())
    recordings = recordings or exported_recordings(source)
    if not recordings:
        raise BusybotError(f"{source}: it has no folder {EPISODES_FOLDER}/000000 with a recording, and no tables", HINT)
    return store_episodes(out, *_made(recordings, out.absolute().name), progress)


def check_export(recordings: Sequence[ExportedRecording], progress: Progress | None = None) -> None:
    """Refuse what `import_export` would refuse, and write nothing."""
    info, _, made = _made(recordings, recordings[0].place)
    check_episodes(made, info.boards, progress)


def _made(recordings: Sequence[ExportedRecording], name: str) -> tuple[DatasetInfo, list[BoardSpec], Episodes]:
    """What a dataset of this name says of itself, its boards, and who makes their episodes."""
    told = [recording.rows("episodes", _Episode)[0] for recording in recordings]
    _check_alike(recordings, told)
    boards = [_board(index, found, one) for index, (found, one) in enumerate(zip(recordings, told, strict=True))]
    longest = max(recordings, key=lambda recording: recording.frames())
    where = f"{recordings[0].file('episodes')} and {longest.file('frames')}"
    collect = {"policy": told[0].policy, "steps": longest.frames() - 1, "seed": told[0].seed}
    info = imported_info(name, len(boards), collect, (where, HINT), told[0].split, told[0].seed)
    read = zip(recordings, told, boards, strict=True)
    made = ((Path(found.place), lambda found=found, one=one, b=b: _episode(found, one, b)) for found, one, b in read)
    return info, boards, made


def _check_alike(recordings: Sequence[ExportedRecording], told: Sequence[_Episode]) -> None:
    """Refuse recordings of several datasets: one says these things of all its recordings, and `verify` compares."""
    places = [f"{found.file('episodes')}: line {one.line}" for found, one in zip(recordings, told, strict=True)]
    for place, one in zip(places, told, strict=True):
        for name in ("policy", "seed", "split"):
            if (value := getattr(one, name)) != (first := getattr(told[0], name)):
                what = f"{place}: {name} is {value!r}, in {places[0]} it is {first!r}"
                raise BusybotError(what, "import recordings that differ in it into datasets of their own")


def _board(index: int, recording: ExportedRecording, told: _Episode) -> BoardSpec:
    """A board of which only is known what can be seen."""
    try:
        return BoardSpec(
            index=index,
            seed=told.seed,
            split=told.split,
            appearance_group=told.appearance_group,
            texture="unknown",
            color=(1.0, 1.0, 1.0),
            objects=tuple(_placed(row) for row in _objects(recording, told)),
            relations=(),
            relations_known=False,
        )
    except ValidationError as error:
        raise BusybotError(f"{recording.file('objects')}: {first_fault(error)}", HINT) from None


def _objects(recording: ExportedRecording, told: _Episode) -> list[_Object]:
    rows = recording.rows("objects", _Object)
    if not rows and told.objects:
        raise BusybotError(f"{recording.file('objects')}: it has no line with values, of {told.objects} objects", HINT)
    if [row.object for row in rows] != list(range(len(rows))):
        raise BusybotError(f"{recording.file('objects')}: its objects are not numbered 0, 1, 2, ...", HINT)
    return rows


def _placed(row: _Object) -> PlacedObject:
    x, y, z = (0.0 if value is None else value for value in _position(row))
    values = {"key": f"Unknown/object-{row.object}", "role": row.role, "position": (x, y, z), "yaw": 0, "scale": 1}
    return PlacedObject.model_validate(values)


def _position(row: _Object | _Frame) -> tuple[float | None, float | None, float | None]:
    return row.position_x, row.position_y, row.position_z


def _episode(recording: ExportedRecording, told: _Episode, board: BoardSpec) -> Episode:
    file, about = recording.file("frames"), recording.file("episodes")
    frames, objects = recording.rows("frames", _Frame), _objects(recording, told)
    goal = recording.rows("episodes", _Goal)[0].goal
    if [row.frame for row in frames] != list(range(len(frames))):
        raise BusybotError(f"{file}: its frames are not numbered 0, 1, 2, ...", HINT)
    if (len(told.camera_matrix), len(told.camera_pose)) != (9, 16):
        raise BusybotError(f"{about}: the camera's matrix has 9 numbers, its pose 16", HINT)
    matrix, pose = np.reshape(told.camera_matrix, (3, 3)), np.reshape(told.camera_pose, (4, 4))
    camera = Camera(told.width, told.height, matrix, pose)
    with naming(about):
        check_camera(camera)
    shown, frame_of = _stored(frames)
    pictures = len(shown) + (goal is not None)
    if pictures * told.width * told.height > MAX_PIXELS:
        what = f"{pictures} pictures of {told.width} x {told.height} pixels, at most {MAX_PIXELS} in all are read"
        raise BusybotError(f"{file}: {what}", "shorter recordings, or smaller pictures")
    episode = Episode(
        board=board,
        camera=camera,
        links=(),
        positions=np.array([_position(row) for row in objects], np.float32).reshape(-1, 3),
        images=list(_images(recording, shown, objects, told)),
        frame_of=frame_of,
        steps=[_step(row, f"{file}: line {row.line}") for row in frames[:-1]],
        policy=told.policy,
        oracle=told.oracle,
        goals=[] if goal is None else [_goal(recording, goal, told, len(objects))],
    )
    recording.forget()
    return episode


def _stored(frames: list[_Frame]) -> tuple[list[_Frame], list[int]]:
    """The frames that show something else than the one before, and which of them each frame shows."""
    shown, frame_of = [frames[0]], [0]
    for row in frames[1:]:
        if (row.rgb, row.depth) != (shown[-1].rgb, shown[-1].depth):
            shown.append(row)
        frame_of.append(len(shown) - 1)
    return shown, frame_of


def _images(
    recording: ExportedRecording, shown: list[_Frame], objects: list[_Object], told: _Episode
) -> Iterator[Image]:
    """Boxes are known of the first picture alone."""
    known = [[getattr(row, f"first_box_{side}") for side in _SIDES] for row in objects]
    boxes = np.array([[-1] * 4 if None in box else box for box in known], np.int16).reshape(-1, 4)
    for number, row in enumerate(shown):
        rgb, depth = recording.picture(row.rgb), None
        try:
            colours = decode_rgb(rgb, told.width, told.height)
            if row.depth is not None:
                steps = decode_plain(recording.picture(row.depth), told.width, told.height)
                depth = np.where(steps > 0, told.depth_offset + steps * told.depth_scale, 0).astype(np.float32)
        except ValueError as error:
            raise BusybotError(f"{recording.place}: frame {row.frame}: {error}", HINT) from None
        yield Image(colours, depth, None, boxes if number == 0 else np.full_like(boxes, -1))


def _goal(recording: ExportedRecording, name: str, told: _Episode, objects: int) -> Image:
    """The picture of a goal, of which nothing else is known."""
    data = recording.picture(name)
    try:
        return Image(decode_rgb(data, told.width, told.height), None, None, np.full((objects, 4), -1, np.int16))
    except ValueError as error:
        raise BusybotError(f"{recording.place}: the goal's picture: {error}", HINT) from None


def _step(row: _Frame, where: str) -> Step:
    x, y, z = _position(row)
    if row.direction is None or x is None or y is None or z is None:
        raise BusybotError(f"{where}: an action needs a position and a direction; only the last frame has none", HINT)
    if not 0 <= row.direction < len(DIRECTIONS):
        raise BusybotError(f"{where}: there are {len(DIRECTIONS)} directions, not {row.direction}", HINT)
    pixel = UNKNOWN_PIXEL if row.pixel_u is None or row.pixel_v is None else (row.pixel_u, row.pixel_v)
    position = (float(np.float32(x)), float(np.float32(y)), float(np.float32(z)))
    return replace(
        unknown_step(pixel, position, row.direction),
        executed=(row.direction,) if row.executed is None else row.executed,
        distance=0.0 if row.distance is None else float(np.float32(row.distance)),
        changed_pixels=row.changed_pixels or 0,
        reward=row.reward or 0,
    )
