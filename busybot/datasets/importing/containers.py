"""Pictures with times in one file: MCAP with Foxglove's compressed images, HDF5 episodes as recorders of ALOHA write.

HDF5: `observations/images/CAMERA`, (T, H, W, 3) as RGB, or (T, bytes) with a JPEG or PNG each, padded with zeros;
`observations/timestamp`, seconds; perhaps `busybox/state_json` and `busybox/timestamp`, states of a BusyBox's modules.
Of MCAP the time is that of logging. What such files link to outside of themselves is not followed.
"""

import atexit
import base64
import json
import math
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from importlib.util import find_spec
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from mcap.opcode import Opcode
from mcap.records import Chunk

from busybot.common.atomic_io import open_regular, read_regular
from busybot.common.errors import BusybotError, needs_extra
from busybot.common.limits import (
    MAX_CONTENT_BYTES,
    MAX_IMAGE_PIXELS,
    MAX_PICTURE_BYTES,
    MAX_RECORDING_BYTES,
    MAX_TABLE_BYTES,
    Budget,
)
from busybot.common.line_child import Child, NoAnswerError
from busybot.datasets.importing import sealed_reader
from busybot.datasets.importing.time_alignment import LATEST_S
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
PIECE_SECONDS = 20.0
"""To wait for a piece of an HDF5 file or a video."""
HDF5_HINT = "copy it again; docs/guides/own-recordings.md tells what such a file has"


def camera_in(file: Path, wanted: str | None) -> str:
    """Name of the camera (HDF5) or topic (MCAP) to read.

    Raises:
        BusybotError: the file has none of that name, or several and none was named; or its pictures cannot be read.
    """
    records = _records(file) if file.suffix.lower() == ".mcap" else None
    names = _Hdf5(file).names(IMAGES) if records is None else _topics(records)
    if wanted is not None and wanted not in names:
        raise BusybotError(f"{file}: it has no camera {wanted!r}", f"it has {', '.join(names) or 'none'}")
    if wanted is None and len(names) != 1:
        what = (
            f"{file}: which of its {len(names)} cameras? {', '.join(names)}" if names else f"{file}: no camera is in it"
        )
        raise BusybotError(what, HINT)
    chosen = wanted or names[0]
    for channel in () if records is None else records.channels.values():
        if channel.topic == chosen and channel.message_encoding != "protobuf":
            what = f"{file}: {chosen} is encoded as {channel.message_encoding}"
            raise BusybotError(what, "record Foxglove's images as Protobuf")
    return chosen


def container_times(file: Path, camera: str) -> list[float]:
    """When each picture was taken, seconds."""
    if file.suffix.lower() == ".mcap":
        return [message.log_time / 1e9 for topic, message in _records(file).messages if topic == camera]
    opened = _Hdf5(file)
    times, pictures = opened.times(TIMES), opened.shape(f"{IMAGES}/{camera}")[0][0]
    if len(times) != pictures:
        raise BusybotError(f"{file}: {len(times)} times for {pictures} pictures of {camera}", "record it again")
    return times


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
    opened, path = _Hdf5(file), f"{IMAGES}/{camera}"
    shape, dtype = opened.shape(path)
    most = MAX_PICTURE_BYTES if len(shape) == 2 else 3 * MAX_IMAGE_PIXELS
    fits = len(shape) in (2, 4) and shape[3:] in ((), (3,)) and 0 < math.prod(shape[1:]) <= most
    if dtype != "uint8" or not fits:
        what = f"{file}: {path} is {dtype} {shape}"
        raise BusybotError(what, "pictures are uint8 (T, H, W, 3), or (T, bytes) with a JPEG each")
    for number in numbers:
        row = opened.row(path, number)
        yield row if len(shape) == 2 else np.frombuffer(row, np.uint8).reshape(shape[1:])


def read_rows(file: Path, columns: Sequence[str], batch: int, first: int = 0) -> Iterator[dict[str, Any]]:
    """Rows of a table from `first` on, so many at once, so that equal ones that are stored once fill no memory.

    Raises:
        BusybotError: naming the file, if it is damaged, lacks a column, or has too many rows.
    """
    hint, opened = "write the table again", open_regular(file, MAX_TABLE_BYTES)
    try:
        table = pq.ParquetFile(opened)
        names, told = table.schema_arrow.names, table.metadata
        for name in columns:
            if names.count(name) != 1:
                raise BusybotError(f"{file}: it has {names.count(name)} columns {name!r}", hint)
        if told.num_rows > MOST_FRAMES:
            raise BusybotError(f"{file}: {told.num_rows} rows, at most {MOST_FRAMES} are read", hint)
        counts = [told.row_group(group).num_rows for group in range(told.num_row_groups)]
        skipped = int(np.searchsorted(np.cumsum(counts), first, side="right"))
        groups, first = list(range(skipped, len(counts))), first - sum(counts[:skipped])
        for rows in table.iter_batches(batch, groups, list(columns), use_threads=False):
            yield from rows.slice(min(first, rows.num_rows)).to_pylist()
            first = max(0, first - rows.num_rows)
    except (pa.ArrowException, OSError, KeyError, ValueError, OverflowError, MemoryError) as error:
        what = f"{file}: {', '.join(columns)} cannot be read: {type(error).__name__}: {str(error)[:200]}"
        raise BusybotError(what, hint) from None
    finally:
        opened.close()


def _of_table(file: Path, column: str, numbers: Sequence[int]) -> Iterator[bytes]:
    """Rows of a column of pictures, as LeRobot and Hugging Face store them: bytes and a path, which is not followed."""
    wanted = iter(numbers)
    number = next(wanted, None)
    for place, row in enumerate(read_rows(file, [column], 8, min(numbers)), min(numbers)):
        if place != number:
            continue
        found = row[column].get("bytes") if isinstance(row[column], dict) else row[column]
        if not isinstance(found, bytes):
            raise BusybotError(f"{file}: row {number}: {column} holds no picture", "put its bytes into the table")
        yield found
        if (number := next(wanted, None)) is None:
            return
    raise BusybotError(f"{file}: it has no row {number}", "write the table again")


def logged_states(file: Path) -> list[tuple[str, str, float | None]]:
    """Lines of JSON about a device's states in an HDF5 file: where, text and seconds; none in other files."""
    if file.suffix.lower() in (".mcap", ".parquet"):
        return []
    opened, (group, _, name) = _Hdf5(file), STATES.partition("/")
    if name not in opened.names(group):
        return []
    texts, times = opened.texts(STATES), opened.times(STATE_TIMES)
    if len(texts) != len(times):
        raise BusybotError(f"{file}: {len(texts)} states at {len(times)} times", "record it again")
    lines = zip(texts, times, strict=True)
    return [(f"{file}: {STATES}[{n}]", text, at) for n, (text, at) in enumerate(lines)]


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


def _topics(records: Records) -> list[str]:
    """Those with images. Of another channel the file may lack the schema: what nobody reads is no fault."""
    names = {number: schema.name for number, schema in records.schemas.items()}
    return sorted({one.topic for one in records.channels.values() if names.get(one.schema_id) == IMAGE_SCHEMA})


class Sealed:
    """A file that a program of its own reads (`sealed_reader`), with little memory, which may hang or die.

    Args:
        kind: hdf5 or video.
        most: bytes that it may have.
        hint: for every fault of it.
    """

    serials = count()

    def __init__(self, kind: str, file: Path, most: int, hint: str):
        open_regular(file, most, "cut it into shorter ones").close()
        self.file, self._hint = file, hint
        self._key = {"kind": kind, "file": str(file.absolute()), "serial": next(self.serials)}

    def ask(self, do: str, **more: Any) -> Any:
        """The answer of the program to `do` with these arguments.

        Raises:
            BusybotError: naming the file, if it is damaged, or no answer comes.
        """
        reader = _reader()
        try:
            told = json.loads(reader.ask(self._key | {"do": do} | more))
        except NoAnswerError as error:
            atexit.unregister(reader.close)
            reader.close()
            _reader.cache_clear()
            end = f"no end after {PIECE_SECONDS:g} s" if error.end == "timeout" else "the library that reads it gave up"
            at = f" at {more['path']}" if "path" in more else ""
            raise BusybotError(f"{self.file}: it is damaged: {end}{at}", self._hint) from None
        if "fault" in told:
            raise BusybotError(f"{self.file}: {told['fault']}", self._hint)
        return told["answer"]

    def ask_bytes(self, do: str, **more: Any) -> tuple[bytes, list[Any]]:
        """The bytes of an answer that comes in pieces, and what stands in it beside them."""
        data, size, beside = b"", 1, list[Any]()
        while len(data) < size:
            piece, size, *beside = self.ask(do, start=len(data), **more)
            data += base64.b64decode(piece)
        return data, beside


class _Hdf5:
    """An HDF5 file; what it links to elsewhere is refused."""

    def __init__(self, file: Path):
        if find_spec("h5py") is None:
            raise needs_extra("h5py", "import")
        self._file, self._sealed = file, Sealed("hdf5", file, 64 * MAX_RECORDING_BYTES, HDF5_HINT)

    def names(self, path: str) -> list[str]:
        return list(self._sealed.ask("names", path=path))

    def shape(self, path: str, axes: int | None = None) -> tuple[tuple[int, ...], str]:
        """Shape and type of an array of at most `MOST_FRAMES` rows."""
        shape, dtype = self._sealed.ask("facts", path=path)
        if (axes is not None and len(shape) != axes) or shape[0] > MOST_FRAMES:
            what = f"{self._file}: {path} has the shape {tuple(shape)}"
            raise BusybotError(what, f"at most {MOST_FRAMES} rows are read")
        return tuple(shape), dtype

    def times(self, path: str) -> list[float]:
        """A list of seconds."""
        found = self._values(path)
        for number, at in enumerate(found):
            if not isinstance(at, float) or not abs(at) < LATEST_S:
                raise BusybotError(f"{self._file}: {path}[{number}] is no time: {str(at)[:40]}", "seconds, as numbers")
        return found

    def texts(self, path: str) -> list[str]:
        found = self._values(path)
        if any(not isinstance(text, str) for text in found):
            raise BusybotError(f"{self._file}: {path} holds numbers", "texts of JSON are read")
        return found

    def row(self, path: str, number: int) -> bytes:
        """The bytes of a row."""
        return self._sealed.ask_bytes("row", path=path, number=number)[0]

    def _values(self, path: str) -> list[Any]:
        (rows,), _ = self.shape(path, 1)
        found: list[Any] = []
        while len(found) < rows:
            found += self._sealed.ask("values", path=path, start=len(found))
        return found


@cache
def _reader() -> Child:
    """The program that reads HDF5 and videos, waiting for the next file until this process ends or it hangs."""
    words = [sys.executable, "-P", str(Path(sealed_reader.__file__)), str(MAX_CONTENT_BYTES)]
    reader = Child(words, PIECE_SECONDS, 8 * sealed_reader.PIECE)
    atexit.register(reader.close)
    return reader
