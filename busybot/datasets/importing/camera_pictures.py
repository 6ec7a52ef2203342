"""The pictures of a camera's folder: files in order, or frames of a video, found first and decoded when needed."""

import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from os.path import lexists
from pathlib import Path
from time import monotonic

import cv2
import numpy as np

from busybot.common.atomic_io import inside, read_regular
from busybot.common.errors import BusybotError, naming
from busybot.common.limits import (
    MAX_IMAGE_PIXELS,
    MAX_PICTURE_BYTES,
    MAX_RECORDING_BYTES,
    MAX_VIDEO_FRAMES,
    MAX_VIDEO_PIXELS,
    MAX_VIDEO_RATIO,
    MAX_VIDEO_SECONDS,
)
from busybot.datasets.importing.containers import CONTAINERS, Sealed, camera_in, container_pictures, container_times
from busybot.datasets.importing.csv_tables import Row, Text, read_table
from busybot.datasets.importing.time_alignment import read_time
from busybot.episodes.codec import PNG_MAGIC, image_size

FRAMES_FILE = "frames.csv"
HINT_LINES = f"{FRAMES_FILE} has a line for each of its frames"
_MARKER = re.compile(rb"\xff[^\x00\x01\xd0-\xd7\xff]")
"""Of a JPEG, where a segment begins: restarts and what is escaped lie among a picture's data."""
_BEGIN, _END, _PNG_END = b"\xff\xd8", b"\xff\xd9", b"IEND\xaeB`\x82"
PICTURES, VIDEOS = (".jpg", ".jpeg", ".png"), (".mp4", ".mov", ".avi", ".mkv", ".webm")


@dataclass(frozen=True)
class Shot:
    """A picture of the source.

    Attributes:
        name: of its file, or of the video's.
        number: of the frame of a video, -1 for a file.
        time: seconds, None where nobody told it.
        depth: name of the file with its depth.
        where: file and line, for messages.
        camera: of a file with several.
    """

    name: str
    number: int
    time: float | None
    depth: str | None
    where: str
    camera: str = ""


class _Frame(Row):
    file: Text = None
    time: Text = None
    depth: Text = None


def find_shots(folder: Path, fps: float | None, camera: str | None = None) -> list[Shot]:
    """The pictures of a folder in order.

    Args:
        fps: of a video without frames.csv.
        camera: of a file with several.

    Raises:
        BusybotError: there are none, some are missing, or it could be one thing or another.
    """
    table = folder / FRAMES_FILE
    rows = read_table(inside(folder, FRAMES_FILE), _Frame, "columns are file, time, depth") if lexists(table) else []
    told = [(read_time(row.time, f"{table}: line {row.line}"), row.depth, f"{table}: line {row.line}") for row in rows]
    if any(row.file is not None for row in rows):
        for row in rows:
            if row.file is None:
                raise BusybotError(f"{table}: line {row.line}: no file", "every line names a picture, or none does")
        return [Shot(row.file or "", -1, *one) for row, one in zip(rows, told, strict=True)]
    names = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
    videos = [name for name in names if Path(name).suffix.lower() in (*VIDEOS, *CONTAINERS)]
    pictures = [name for name in names if Path(name).suffix.lower() in PICTURES]
    if len(videos) > 1 or (videos and pictures):
        what = f"{folder}: it has {', '.join([*videos, *pictures][:4])}: which of them is the recording?"
        raise BusybotError(what, "leave one video in the folder; or name the pictures in frames.csv, column file")
    if videos and Path(videos[0]).suffix.lower() in CONTAINERS:
        return _container_shots(folder, videos[0], bool(rows), camera)
    if videos:
        return _video_shots(folder, videos[0], told, fps)
    if not pictures:
        raise BusybotError(f"{folder}: it has no pictures and no video", f"it reads {', '.join((*PICTURES, *VIDEOS))}")
    ordered = in_order(folder, pictures, "name those that are there in frames.csv, column file")
    if rows and len(rows) != len(ordered):
        what = f"{table}: {len(rows)} lines for {len(ordered)} pictures"
        raise BusybotError(what, "add a column file with the pictures' names")
    told = told or [(None, None, str(folder / name)) for name in ordered]
    return [Shot(name, -1, *one) for name, one in zip(ordered, told, strict=True)]


def _container_shots(folder: Path, name: str, timed: bool, camera: str | None) -> list[Shot]:
    file = inside(folder, name)
    if timed:
        raise BusybotError(
            f"{folder / FRAMES_FILE}: {name} tells itself when its pictures were taken", "remove the table"
        )
    chosen = camera_in(file, camera)
    times = container_times(file, chosen)
    if not times:
        raise BusybotError(
            f"{folder / name}: no picture of {chosen} is in it", "record it again; or name another camera"
        )
    return [Shot(name, n, at, None, f"{folder / name}: picture {n} of {chosen}", chosen) for n, at in enumerate(times)]


def _video_shots(
    folder: Path, name: str, told: Sequence[tuple[float | None, str | None, str]], fps: float | None
) -> list[Shot]:
    for time, depth, where in told:
        if time is None or depth is not None:
            what = f"{where}: a video's frames have a time each, and no depth"
            raise BusybotError(what, "fill the column time; with depth, save the frames as pictures")
    if told:
        return [Shot(name, number, *one) for number, one in enumerate(told)]
    if fps is None:
        what = f"{folder / name}: when was each of its frames taken? Rates that videos tell are often wrong"
        raise BusybotError(what, "frames.csv with a column time, a line for each frame; or --fps 30")
    count = _Video(folder / name).skip(MAX_VIDEO_FRAMES + 1)  # counted: what a file's header says may be wrong
    if not count:
        raise BusybotError(f"{folder / name}: no picture is in it", "was the video cut? Copy it again")
    return [Shot(name, number, number / fps, None, f"{folder / name}: frame {number}") for number in range(count)]


class _Video:
    """A video, decoded from its beginning by a program of its own, within a budget of frames, pixels and seconds.

    Raises:
        BusybotError: naming it, if it is none, or before and while it is decoded, if that is more than is left.
    """

    def __init__(self, video: Path):
        self._sealed = Sealed("video", video, MAX_RECORDING_BYTES, "save it as mp4, or its frames as pictures")
        self._frames, self._until = 0, monotonic() + MAX_VIDEO_SECONDS
        width, height = self._sealed.ask("size")
        self._check_size(width, height)
        self._pixels, self._most = width * height, MAX_VIDEO_PIXELS + MAX_VIDEO_RATIO * video.stat().st_size

    def skip(self, frames: int) -> int:
        """Decode so many frames, or all that are left; returns their number."""
        before, ended = self._frames, False
        while self._frames - before < frames and not ended:
            done = self._sealed.ask("grab", count=frames - (self._frames - before))
            ended = done < 0
            self._frames += -done - 1 if ended else done
            spent = (
                (self._frames > MAX_VIDEO_FRAMES, f"{MAX_VIDEO_FRAMES} frames"),
                (self._frames * self._pixels > self._most, f"{self._most} pixels in all its frames"),
                (monotonic() > self._until, f"the {MAX_VIDEO_SECONDS:.0f} s that decoding a video may take"),
            )
            for over, budget in spent:
                if over:
                    raise BusybotError(
                        f"{self._sealed.file}: more than {budget}", "cut it, or make its pictures smaller"
                    )
        return self._frames - before

    def picture(self, number: int) -> np.ndarray:
        """Colours of a frame after those that were decoded, uint8 (H, W, 3)."""
        self.skip(number + 1 - self._frames)
        if self._frames <= number:
            what = f"{self._sealed.file.name} ends before this frame, {number}; it has {self._frames}"
            raise BusybotError(what, f"was the video cut? {HINT_LINES}")
        data, (height, width) = self._sealed.ask_bytes("picture")
        self._check_size(width, height)  # a video may change it midway
        return np.frombuffer(data, np.uint8).reshape(height, width, 3)

    def _check_size(self, width: int, height: int) -> None:
        if not 0 < width * height <= MAX_IMAGE_PIXELS:
            what = f"{self._sealed.file}: frames of {width} x {height} pixels, at most {MAX_IMAGE_PIXELS} are read"
            raise BusybotError(what, "make its pictures smaller")


def in_order(folder: Path, names: Sequence[str], otherwise: str) -> list[str]:
    """By the numbers in the names, 2 before 10; `otherwise` is what to do where what is missing is lost.

    Raises:
        BusybotError: a number is left out where the others count by one: all later pictures would show something else.
    """

    def parts(name: str) -> list[str | int]:
        """Words and numbers in turn."""
        return [int(part) if place % 2 else part for place, part in enumerate(re.split(r"([0-9]+)", name))]

    ordered = sorted(names, key=parts)
    numbers = [[part for part in parts(Path(name).stem) if isinstance(part, int)] for name in ordered]
    steps = np.diff([own[-1] if own else -1 for own in numbers])
    if len(steps) > 1 and (steps > 0).all() and (steps == 1).mean() > 0.5 and steps.max() > 1:
        gap = int(steps.argmax())
        what = f"{folder}: {steps[gap] - 1} missing between {ordered[gap]} and {ordered[gap + 1]}"
        raise BusybotError(what, f"put them back; or {otherwise}")
    return ordered


def first_size(folder: Path, chosen: Sequence[Shot]) -> tuple[int, int]:
    """Width and height of the first of these pictures; all are there.

    Raises:
        BusybotError: naming one that is not.
    """
    first = {name: shot for shot in reversed(chosen) for name in (shot.name, shot.depth) if name}
    for name, shot in reversed(first.items()):  # each file once: a table may hold all pictures
        with naming(shot.where):
            if not inside(folder, name).is_file():
                raise BusybotError(f"there is no picture {folder / name}", "put it there, or correct the name")
    _, rgb = next(each_colours(folder, chosen[:1]))
    return rgb.shape[1], rgb.shape[0]


def each_colours(folder: Path, chosen: Sequence[Shot]) -> Iterator[tuple[Shot, np.ndarray]]:
    """Colours of pictures in order, uint8 (H, W, 3), turned as the camera was held."""
    if chosen[0].number < 0:
        yield from ((shot, decode_picture(folder, shot, shot.name, cv2.IMREAD_COLOR_RGB)) for shot in chosen)
        return
    video = inside(folder, chosen[0].name)
    if chosen[0].camera:
        rows = container_pictures(video, chosen[0].camera, [shot.number for shot in chosen])
        for shot, row in zip(chosen, rows, strict=True):
            with naming(shot.where):
                yield shot, decode_bytes(row, shot.where) if isinstance(row, bytes) else row
        return
    film = _Video(video)
    for shot in chosen:
        with naming(shot.where):
            rgb = film.picture(shot.number)
        yield shot, rgb
    if film.skip(1):  # the last picture of all is always among them
        what = f"{chosen[-1].where}: the last line, but {video.name} goes on"
        raise BusybotError(what, f"was the table cut? {HINT_LINES}")


def decode_picture(folder: Path, shot: Shot, name: str, flags: int) -> np.ndarray:
    """A whole JPEG or PNG, as OpenCV's flags say."""
    with naming(shot.where):
        data = read_regular(inside(folder, name), MAX_PICTURE_BYTES, "put the picture there, or correct its name")
        return decode_bytes(data, str(folder / name), flags)


def decode_bytes(data: bytes, named: str, flags: int = cv2.IMREAD_COLOR_RGB) -> np.ndarray:
    """The same of bytes.

    Raises:
        BusybotError: they are no such picture, a huge one, or one that was cut.
    """
    try:
        width, height = image_size(data)
    except ValueError as error:
        raise BusybotError(f"{named}: {error}", "save it as JPEG or PNG") from None
    if width * height > MAX_IMAGE_PIXELS:
        what = f"{named}: {width} x {height} pixels, at most {MAX_IMAGE_PIXELS} are read"
        raise BusybotError(what, "save smaller pictures")
    whole = _png_ends(data) if data[:8] == PNG_MAGIC else _jpeg_ends(data)  # decoders fill what is missing with grey
    found = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if whole else None
    if found is None:
        raise BusybotError(f"{named}: the picture is cut, or damaged", "copy it again from the camera")
    return found


def _jpeg_ends(data: bytes) -> bool:
    """Whether a JPEG's own end is there, not that of a preview in it or of a picture behind it; phones append films."""
    place = len(_BEGIN)
    while (found := _MARKER.search(data, place)) and found[0] not in (_BEGIN, _END):
        place = found.end() + int.from_bytes(data[found.end() : found.end() + 2])
    return found is not None and found[0] == _END


def _png_ends(data: bytes) -> bool:
    """Whether a PNG's last chunk is there, whatever comes behind it."""
    place, kind = len(PNG_MAGIC), b""
    while kind != b"IEND" and place + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, place)
        place += 12 + length
    return data[place - len(_PNG_END) : place] == _PNG_END
