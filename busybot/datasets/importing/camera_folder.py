"""A camera's folder to recordings: pictures or a video, a CSV of actions, and what else somebody knows.

    actions.csv      u, v (pixel) or x, y, z (point); direction; time where pictures have times
    *.jpg, *.png     in the order of their names; or a video (mp4, mov, avi, mkv, webm), or one file of `containers`
    frames.csv       file (not of a video), time, depth (a 16-bit PNG): a line for each picture, in order
    objects.csv      name, role (trigger or responder), u0, v0, u1, v1 (box in the first picture), x, y, z, state
    states.jsonl     a device's log of its states; `state` of objects.csv names what it says of an object (`states`)
    relations.csv    cause, effect: names or numbers (from 0) of objects, for judging only
    camera.json      or .yaml: matrix (3 x 3), pose (4 x 4, camera to board) or corners, unit, depth_scale, depth_offset

Only the actions and the pictures must be there. Such a folder is a recording; one with several such folders is several.

**Which picture shows what**: without times there is one picture more than actions, the first before all. With times the
picture before an action is the last one that is older than the action, the last of all shows what the last action left.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from os.path import lexists
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
from pydantic import Field, ValidationError

from busybot.boards.directions import direction_named, direction_of
from busybot.common.atomic_io import folders_with, inside, read_json, read_text
from busybot.common.config import parse_yaml
from busybot.common.errors import BusybotError, UsageError, naming
from busybot.common.frozen_model import FrozenModel, first_fault
from busybot.common.limits import MAX_JSON_BYTES
from busybot.datasets.importing.camera_pictures import (
    FRAMES_FILE,
    VIDEOS,
    Shot,
    decode_picture,
    each_colours,
    find_shots,
    first_size,
)
from busybot.datasets.importing.csv_tables import Maybe, Pixel, Row, Text, absent, read_table
from busybot.datasets.importing.proposals import MAX_OBJECTS
from busybot.datasets.importing.recording import (
    BOARD,
    KnownAction,
    KnownObject,
    Picture,
    Recording,
)
from busybot.datasets.importing.states import read_states
from busybot.datasets.importing.time_alignment import frames_around, read_time
from busybot.episodes.episode import Camera
from busybot.episodes.validation import check_camera

ACTIONS_FILE = "actions.csv"
HINT = "docs/guides/own-recordings.md tells which files a camera's folder has"


@dataclass(frozen=True)
class ImportOptions:
    """What a folder does not say.

    Attributes:
        fps: of a video without frames.csv, frames per second; its first frame is at 0 s.
        shift: seconds to add to the times of actions.
        width: make pictures so wide; None to keep them.
        camera: of a file or dataset with several.
        tables: folder with actions of a dataset that does not tell them.
        proposed: propose boxes and roles from motion and depth where no objects are told.
    """

    fps: float | None = None
    shift: float = 0.0
    width: int | None = None
    camera: str | None = None
    tables: Path | None = None
    proposed: bool = False


class _Action(Row):
    time: Text = None
    u: Maybe = None
    v: Maybe = None
    x: Maybe = None
    y: Maybe = None
    z: Maybe = None
    direction: Text = None
    dx: Maybe = None
    dy: Maybe = None
    dz: Maybe = None


class _Object(Row):
    name: str = ""
    role: str
    u0: Pixel = None
    v0: Pixel = None
    u1: Pixel = None
    v1: Pixel = None
    x: Maybe = None
    y: Maybe = None
    z: Maybe = None
    state: Text = None


class _Relation(Row):
    cause: str
    effect: str


Matrix = tuple[tuple[Annotated[float, Field(allow_inf_nan=False)], ...], ...]


class _Camera(FrozenModel):
    """Of `camera.json`; lengths, also those of actions and depth, are divided by `unit`."""

    matrix: Matrix
    pose: Matrix | None = None
    corners: Matrix | None = None
    unit: Annotated[float, Field(gt=0, le=1e6)] = 1.0
    depth_scale: Annotated[float, Field(gt=0, le=1e3)] | None = None
    depth_offset: Annotated[float, Field(ge=-1e6, le=1e6)] = 0.0


def camera_folders(source: Path) -> list[Path]:
    """The folder itself, or those in it that hold a recording; none where there are no actions."""
    if lexists(source / ACTIONS_FILE):
        return [source]
    return folders_with(source, ACTIONS_FILE)


def refuse_idle(source: Path, folders: Sequence[Path], options: ImportOptions) -> None:
    """Refuse a rate where none of these folders has a video that it is for, and a shift where none tells times.

    Raises:
        UsageError: an option would change nothing.
    """
    if options.fps is not None and not any(map(_has_bare_video, folders)):
        raise UsageError(f"{source}: no video without frames.csv lies there", "--fps is for one: leave it out")
    if options.shift and not any(map(_tells_times, folders)):
        what = f"{source}: no actions.csv there tells times"
        raise UsageError(what, "--shift is for a column time: leave it out, or add the column")


def _has_bare_video(folder: Path) -> bool:
    return not lexists(folder / FRAMES_FILE) and any(file.suffix.lower() in VIDEOS for file in folder.iterdir())


def _tells_times(folder: Path) -> bool:
    return any(row.time is not None for row in read_table(inside(folder, ACTIONS_FILE), _Action, HINT))


def read_camera_folder(
    folder: Path, options: ImportOptions, pictures: tuple[Path, list[Shot]] | None = None
) -> Recording:
    """Read a recording; its pictures are decoded later.

    Args:
        pictures: that lie elsewhere, with the folder that their names begin at.

    Raises:
        BusybotError: naming file and line, if something is missing, contradicts itself or may mean several things.
    """
    file = inside(folder, ACTIONS_FILE)
    rows, told = read_table(file, _Action, HINT), _camera(folder)
    base, shots = pictures or (folder, find_shots(folder, options.fps, options.camera))
    actions = [_action(f"{file}: line {row.line}", row, told) for row in rows]
    times = [read_time(row.time, one.where) for row, one in zip(rows, actions, strict=True)]
    whens = [None if at is None else at + options.shift for at in times]
    wheres = [one.where for one in actions]
    frames = frames_around(file, list(zip(whens, wheres, strict=True)), [(shot.time, shot.where) for shot in shots])
    chosen = [shots[number] for number in frames]
    if options.camera is not None and not chosen[0].camera:
        raise UsageError(f"{folder}: its pictures are of one camera", "--camera is for HDF5 and MCAP: leave it out")
    size = first_size(base, chosen)
    if any(shot.depth for shot in chosen) and (told is None or told.depth_scale is None):
        what = f"{folder / FRAMES_FILE}: it names depth, whose unit nobody told"
        raise BusybotError(what, "camera.json with matrix, pose and depth_scale tells it; or leave the column out")
    objects, keys = _objects(folder, 1.0 if told is None else told.unit)
    container = base / chosen[0].name if chosen[0].camera else None
    recording = Recording(
        place=folder,
        size=size,
        pictures=partial(pictures_of, base, chosen, size, told),
        shown=[shot.name if shot.number < 0 else f"{shot.name}, frame {shot.number}" for shot in chosen],
        actions=actions,
        objects=objects,
        camera=None if told is None else _pinhole(folder, told, size),
        relations=_relations(folder, objects),
        depth=any(shot.depth for shot in chosen),
        states=read_states(folder, container, keys, [shot.time for shot in chosen]),
    )
    return recording if options.width is None else narrowed(recording, options.width)


def narrowed(recording: Recording, width: int) -> Recording:
    """The recording with smaller pictures: noise averages out, and files are smaller."""
    old, height = recording.size, max(1, round(recording.size[1] * width / recording.size[0]))
    if width >= old[0]:
        return recording
    across, down = width / old[0], height / old[1]

    def pictures() -> Iterator[Picture]:
        for rgb, depth in recording.pictures():
            small = cv2.resize(rgb, (width, height), interpolation=cv2.INTER_AREA)
            yield small, None if depth is None else cv2.resize(depth, (width, height), interpolation=cv2.INTER_NEAREST)

    def box(one: tuple[int, int, int, int] | None) -> tuple[int, int, int, int] | None:
        if one is None:
            return None
        u0, v0 = math.floor(one[0] * across), math.floor(one[1] * down)
        return u0, v0, max(u0 + 1, round(one[2] * across)), max(v0 + 1, round(one[3] * down))

    camera = recording.camera
    if camera is not None:
        camera = Camera(width, height, np.diag([across, down, 1.0]) @ camera.matrix, camera.pose)

    def pixel(one: tuple[int, int] | None) -> tuple[int, int] | None:  # one outside of the picture stays outside
        return None if one is None else (math.floor(one[0] * across), math.floor(one[1] * down))

    moved = [replace(one, pixel=pixel(one.pixel)) for one in recording.actions]
    objects = [replace(one, box=box(one.box)) for one in recording.objects]
    small = {"size": (width, height), "pictures": pictures, "camera": camera, "actions": moved, "objects": objects}
    return replace(recording, **small)  # type: ignore[arg-type]


def pictures_of(
    folder: Path, chosen: Sequence[Shot], size: tuple[int, int], camera: _Camera | None
) -> Iterator[Picture]:
    for shot, rgb in each_colours(folder, chosen):
        depth = None
        if shot.depth and camera is not None and camera.depth_scale is not None:
            steps = decode_picture(folder, shot, shot.depth, cv2.IMREAD_UNCHANGED)
            if steps.ndim != 2:
                raise BusybotError(f"{shot.where}: {shot.depth} is no grey picture", "save depth as 16-bit PNG")
            far = (camera.depth_offset + steps * camera.depth_scale) / camera.unit
            depth = np.where(steps > 0, far, 0).astype(np.float32)
        for picture in (rgb, depth):
            if picture is not None and picture.shape[:2] != size[::-1]:
                found = f"{picture.shape[1]} x {picture.shape[0]}"
                what = f"{shot.where}: {shot.name} has {found} pixels, the first picture {size[0]} x {size[1]}"
                raise BusybotError(what, "pictures and depth have one size throughout")
        yield rgb, depth


def _action(where: str, row: _Action, camera: _Camera | None) -> KnownAction:
    point = None if row.x is None or row.y is None else (row.x, row.y, row.z or 0.0)
    pixel = None if row.u is None or row.v is None else (math.floor(row.u), math.floor(row.v))
    if pixel is None and point is None:
        raise BusybotError(f"{where}: where was the action?", "give columns u and v (pixel), or x, y and z (point)")
    if point is not None and camera is None:
        hint = "camera.json tells where the camera was; or give the pixel, columns u and v"
        raise BusybotError(f"{where}: a point, but nobody knows what it is in the picture", hint)
    if point is not None and camera is not None:
        point = (point[0] / camera.unit, point[1] / camera.unit, point[2] / camera.unit)
    with naming(where):
        if row.direction is not None:
            return KnownAction(pixel, point, direction_named(row.direction), where)
        if row.dx is None or row.dy is None or row.dz is None:
            raise BusybotError("in which direction was it moved?", "add a column direction: left, up-left, press, ...")
        return KnownAction(pixel, point, direction_of((row.dx, row.dy, row.dz)), where)


def _objects(folder: Path, unit: float) -> tuple[list[KnownObject], list[str | None]]:
    """The objects, and by which key a log of states tells of each."""
    if not lexists(folder / "objects.csv"):
        return [], []
    keys: list[str | None] = []
    found: list[KnownObject] = []
    file = inside(folder, "objects.csv")
    rows = read_table(file, _Object, "columns are name, role, u0, v0, u1, v1")
    if len(rows) > MAX_OBJECTS:  # each is compared with all before it, and with a log of states
        raise BusybotError(f"{file}: it has {len(rows)} objects", f"at most {MAX_OBJECTS} stand on a board")
    for row in rows:
        where, name = f"{file}: line {row.line}", row.name.strip()
        if row.role.strip() not in ("trigger", "responder"):
            raise BusybotError(f"{where}: role {row.role[:40]!r}", "it is trigger or responder, one of them")
        for one in found:
            if name and one.name == name:
                what = f"{where}: {name!r} stands in {one.where.rpartition(': ')[2]} already"
                raise BusybotError(what, "an object has one line, one name and one role")
        sides = (row.u0, row.v0, row.u1, row.v1)
        if None in sides and any(side is not None for side in sides):
            raise BusybotError(f"{where}: a side of the box is missing", "fill u0, v0, u1 and v1, or none of them")
        box = None if row.u0 is None or row.v0 is None or row.u1 is None or row.v1 is None else sides
        point = None if row.x is None or row.y is None else (row.x / unit, row.y / unit, (row.z or 0.0) / unit)
        found.append(KnownObject(name, row.role.strip(), box, point, where))  # type: ignore[arg-type]
        keys.append(row.state)
    return found, keys


def _relations(folder: Path, objects: Sequence[KnownObject]) -> tuple[tuple[int, int], ...] | None:
    """Pairs of objects from relations.csv or relations.json; None where there is neither."""
    table, list_ = folder / "relations.csv", folder / "relations.json"
    hint = "a relation is a cause and an effect, by the names or numbers of objects.csv"
    if lexists(table):
        rows = read_table(inside(folder, table.name), _Relation, hint)
        told = [(f"{table}: line {row.line}", row.cause, row.effect) for row in rows if absent(row.cause + row.effect)]
    elif lexists(list_):
        values = read_json(inside(folder, list_.name))
        pairs = values if isinstance(values, list) else [None]
        if any(not isinstance(pair, list) or len(pair) != 2 for pair in pairs):
            raise BusybotError(f"{list_}: not a list of pairs", f'[["switch", "lamp"], [0, 3]]; {hint}')
        told = [(f"{list_}: relation {number}", str(a), str(b)) for number, (a, b) in enumerate(pairs)]
    else:
        return None
    names = {one.name: number for number, one in enumerate(objects) if one.name}
    names = {str(number): number for number in range(len(objects))} | names
    found = []
    for where, cause, effect in told:
        for name, role in ((cause, "trigger"), (effect, "responder")):
            if name.strip() not in names:
                raise BusybotError(f"{where}: objects.csv has no object {name[:40]!r}", hint)
            if (is_role := objects[names[name.strip()]].role) != role and role == "responder":
                raise BusybotError(f"{where}: {name[:40]!r} is a {is_role}, not a {role}", hint)
        if names[cause.strip()] == names[effect.strip()]:
            raise BusybotError(f"{where}: {cause[:40]!r} is its own cause", hint)
        found.append((names[cause.strip()], names[effect.strip()]))
    return tuple(found)


def _camera_files(folder: Path) -> list[str]:
    return [name for name in ("camera.json", "camera.yaml", "camera.yml") if lexists(folder / name)]


def _camera(folder: Path) -> _Camera | None:
    there = _camera_files(folder)
    if not there:
        return None
    file, hint = inside(folder, there[0]), "matrix: [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], and pose or corners"
    if len(there) > 1:
        raise BusybotError(f"{folder}: {' and '.join(there)}: which of them tells of the camera?", "leave one of them")
    try:
        found = _Camera.model_validate(parse_yaml(read_text(file, MAX_JSON_BYTES, hint), str(file)))
    except ValidationError as error:
        raise BusybotError(f"{file}: {first_fault(error)}", hint) from None
    if (found.pose is None) == (found.corners is None):
        raise BusybotError(f"{file}: give pose, or corners", hint)
    return found


def _pinhole(folder: Path, told: _Camera, size: tuple[int, int]) -> Camera:
    """The camera; where the pose is not told, from where the corners of the board are in the picture."""
    with naming(folder / _camera_files(folder)[0]):
        camera = _told_camera(told, size)
        check_camera(camera)
    return camera


def _told_camera(told: _Camera, size: tuple[int, int]) -> Camera:
    try:
        matrix = np.array(told.matrix, float).reshape(3, 3)
        if told.pose is not None:
            pose = np.array(told.pose, float).reshape(4, 4)
            pose[:3, 3] /= told.unit
            return Camera(*size, matrix, pose)
        corners = np.array(told.corners, float).reshape(4, 1, 2)
    except ValueError:
        hint = "matrix has 3 x 3 numbers, pose 4 x 4, corners 4 x 2: upper left, upper right, lower right, lower left"
        raise BusybotError("the camera's numbers are not as many as they must be", hint) from None
    half = BOARD / 2
    board = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
    try:
        done, turn, shift = cv2.solvePnP(board, corners, matrix, None, flags=cv2.SOLVEPNP_SQPNP)
        if not done or not np.isfinite(shift).all():
            raise ValueError
    except (cv2.error, ValueError):
        raise BusybotError("no camera sees a board with such corners", "upper left, then clockwise") from None
    pose = np.eye(4)
    pose[:3, :3] = cv2.Rodrigues(turn)[0].T
    pose[:3, 3] = -pose[:3, :3] @ shift.ravel()
    return Camera(*size, matrix, pose)
