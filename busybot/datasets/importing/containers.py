"""Pictures with times in one file: MCAP with Foxglove's compressed images, HDF5 episodes as recorders of ALOHA write.

HDF5: `observations/images/CAMERA`, (T, H, W, 3) as RGB, or (T, bytes) with a JPEG or PNG each, padded with zeros;
`observations/timestamp`, seconds; perhaps `busybox/state_json` and `busybox/timestamp`, states of a BusyBox's modules.
Of MCAP the time is that of logging. What such files link to outside of themselves is not followed.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from mcap.opcode import Opcode
from mcap.records import Chunk

from busybot.common.atomic_io import open_regular, read_regular
from busybot.common.errors import BusybotError, needs_extra
from busybot.common.limits import MAX_IMAGE_PIXELS, MAX_PICTURE_BYTES, MAX_RECORDING_BYTES, MAX_TABLE_BYTES, Budget
from busybot.episodes.mcap import channels
from busybot.episodes.mcap.records import (
    FAULTS,
    MAGIC,
    RECORD_HEAD,
    Records,
    decompress,
    each_record,
    read_content,
    reason_of,
    stream_of,
)

CONTAINERS = (".mcap", ".hdf5", ".h5")
IMAGE_SCHEMA, IMAGES, TIMES = "foxglove.CompressedImage", "observations/images", "observations/timestamp"
STATES, STATE_TIMES = "busybox/state_json", "busybox/timestamp"
MOST_FRAMES = 1_000_000
HINT = "--camera NAME takes one"


def camera_in(file: Path, wanted: str | None) -> str:
    """Name of the camera (HDF5) or topic (MCAP) to read.

    Raises:
        BusybotError: the file has none of that name, or several and none was named.
    """
    names = _topics(_records(file), file) if file.suffix.lower() == ".mcap" else _hdf5_cameras(file)
    if wanted is not None and wanted not in names:
        raise BusybotError(f"{file}: it has no camera {wanted!r}", f"it has {', '.join(names) or 'none'}")
    if wanted is None and len(names) != 1:
        what = (
            f"{file}: which of its {len(names)} cameras? {', '.join(names)}" if names else f"{file}: no camera is in it"
        )
        raise BusybotError(what, HINT)
    return wanted or names[0]


def container_times(file: Path, camera: str) -> list[float]:
    """When each picture was taken, seconds."""
    if file.suffix.lower() == ".mcap":
        return [message.log_time / 1e9 for topic, message in _records(file).messages if topic == camera]
    with _Hdf5(file) as opened:
        times, count = opened.array(TIMES, 1), len(opened.array(f"{IMAGES}/{camera}"))
        if len(times) != count:
            raise BusybotError(f"{file}: {len(times)} times for {count} pictures of {camera}", "record it again")
        return [float(at) for at in times[:]]


def container_pictures(file: Path, camera: str, numbers: Sequence[int]) -> Iterator[np.ndarray | bytes]:
    """Pictures in this order, each as colours, uint8 (H, W, 3), or as JPEG or PNG."""
    if file.suffix.lower() == ".parquet":
        yield from _of_table(file, camera, numbers)
        return
    if file.suffix.lower() == ".mcap":
        made, messages = channels.message_class(IMAGE_SCHEMA), _records(file).payloads[camera]
        for number in numbers:
            try:
                yield bytes(made.FromString(messages[number]).data)
            except FAULTS as error:
                what = f"{file}: picture {number} of {camera}: {reason_of(error)}"
                raise BusybotError(what, "record Foxglove's images as Protobuf") from None
        return
    with _Hdf5(file) as opened:
        images = opened.array(f"{IMAGES}/{camera}")
        most = MAX_PICTURE_BYTES if images.ndim == 2 else 3 * MAX_IMAGE_PIXELS
        if (
            images.dtype != np.uint8
            or images.ndim not in (2, 4)
            or images.shape[3:] not in ((), (3,))
            or int(np.prod(images.shape[1:])) > most
        ):
            what = f"{file}: {IMAGES}/{camera} is {images.dtype} {images.shape}"
            raise BusybotError(what, "pictures are uint8 (T, H, W, 3), or (T, bytes) with a JPEG each")
        for number in numbers:
            row = images[number]
            yield row if images.ndim == 4 else row.tobytes().rstrip(b"\0")


def _of_table(file: Path, column: str, numbers: Sequence[int]) -> Iterator[bytes]:
    """Rows of a column of pictures, as LeRobot and Hugging Face store them: bytes and a path, which is not followed."""
    try:
        data = pa.BufferReader(read_regular(file, MAX_TABLE_BYTES))
        rows = pq.read_table(data, columns=[column], use_threads=False)[column].take(pa.array(numbers))
    except (pa.ArrowException, KeyError, ValueError) as error:
        raise BusybotError(f"{file}: {column} cannot be read: {str(error)[:200]}", "write the table again") from None
    for number, row in zip(numbers, rows, strict=True):
        picture = row.as_py()
        found = picture.get("bytes") if isinstance(picture, dict) else picture
        if not isinstance(found, bytes):
            raise BusybotError(f"{file}: row {number}: {column} holds no picture", "put its bytes into the table")
        yield found


def logged_states(file: Path) -> list[tuple[str, str, float | None]]:
    """Lines of JSON about a device's states in an HDF5 file: where, text and seconds; none in other files."""
    if file.suffix.lower() in (".mcap", ".parquet"):
        return []
    with _Hdf5(file) as opened:
        if not opened.has(STATES):
            return []
        texts, times = opened.array(STATES, 1), opened.array(STATE_TIMES, 1)
        if len(texts) != len(times):
            raise BusybotError(f"{file}: {len(texts)} states at {len(times)} times", "record it again")
        lines = zip(texts[:], times[:], strict=True)
        return [(f"{file}: {STATES}[{n}]", bytes(text).decode(), float(at)) for n, (text, at) in enumerate(lines)]


def _records(file: Path) -> Records:
    """Schemas, channels and messages, also of a file without checksums, which other programs write."""
    data, hint = read_regular(file, MAX_RECORDING_BYTES), "copy it again; was the recording cut?"
    found, budget, ended = Records(len(data)), Budget(), False
    try:
        for position, opcode, body, whole in each_record(data, budget, len(MAGIC)) if data.startswith(MAGIC) else ():
            ended = opcode == Opcode.FOOTER
            if ended or not whole:
                break
            if opcode == Opcode.CHUNK:
                whole = read_content(decompress(Chunk.read(stream_of(body)), budget), found, budget)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
                read_content(data[position : position + RECORD_HEAD + len(body)], found, budget)
            if not whole:
                break
    except BusybotError as error:
        raise BusybotError(f"{file}: {error.what}", hint) from None
    except FAULTS as error:
        raise BusybotError(f"{file}: not a whole MCAP file: {reason_of(error)}", hint) from None
    if not ended:
        raise BusybotError(f"{file}: not a whole MCAP file", hint)
    return found


def _topics(records: Records, file: Path) -> list[str]:
    topics = sorted(topic for topic, schema in records.schema_names.items() if schema == IMAGE_SCHEMA)
    for channel in records.channels.values():
        if channel.topic in topics and channel.message_encoding != "protobuf":
            what = f"{file}: {channel.topic} is encoded as {channel.message_encoding}"
            raise BusybotError(what, "record Foxglove's images as Protobuf")
    return topics


def _hdf5_cameras(file: Path) -> list[str]:
    with _Hdf5(file) as opened:
        return opened.names(IMAGES)


class _Hdf5:
    """An HDF5 file whose links to other files are refused."""

    def __init__(self, file: Path):
        try:
            import h5py
        except ImportError:
            raise needs_extra("h5py", "import") from None
        self._h5py, self._file = h5py, file

    def __enter__(self) -> "_Hdf5":
        open_regular(self._file, 64 * MAX_RECORDING_BYTES, "cut it into episodes").close()
        try:
            self._root = self._h5py.File(self._file, "r")
        except (OSError, RuntimeError):
            raise BusybotError(f"{self._file}: it cannot be read as HDF5", "copy it again; was it cut?") from None
        return self

    def __exit__(self, *_: object) -> None:
        self._root.close()

    def has(self, path: str) -> bool:
        return path in self._root

    def names(self, path: str) -> list[str]:
        return sorted(self._found(path)) if path in self._root else []

    def array(self, path: str, axes: int | None = None) -> Any:
        """A dataset, whose rows are read when asked for."""
        found = self._found(path)
        if not isinstance(found, self._h5py.Dataset) or found.is_virtual or found.external or len(found.shape) < 1:
            raise BusybotError(f"{self._file}: {path} is no array in this file", "save all of it in one file")
        if (axes is not None and found.ndim != axes) or len(found) > MOST_FRAMES:
            raise BusybotError(
                f"{self._file}: {path} has the shape {found.shape}", f"at most {MOST_FRAMES} rows are read"
            )
        return found

    def _found(self, path: str) -> Any:
        place = self._root
        for part in path.split("/"):
            if part not in place or not isinstance(place.get(part, getlink=True), self._h5py.HardLink):
                raise BusybotError(f"{self._file}: it has no {path}", "docs/guides/own-recordings.md tells what it has")
            place = place[part]
        return place
