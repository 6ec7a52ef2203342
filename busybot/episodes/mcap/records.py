"""The records of an MCAP file that may be truncated, damaged or made to exhaust the reader.

One pass over the whole file, all checksums compared, sizes limited before anything is decompressed. What the file
says about itself is checked against what it holds; schemas in the file are never used to decode it.
"""

import io
import shlex
import struct
import zlib
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import zstandard
from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Chunk, DataEnd, Footer, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from busybot.common.errors import BusybotError

MAX_FILE_BYTES = 1 << 30
MAX_CONTENT_BYTES = 2 << 30
MAGIC = b"\x89MCAP0\r\n"
FAULTS = (
    *(McapError, zstandard.ZstdError, struct.error, DecodeError, ValueError, KeyError, IndexError, TypeError),
    *(OverflowError, RecursionError, MemoryError),
)
"""What the libraries raise at damaged bytes, or at values that should not be there."""

_SUMMARY_CRC_AND_MAGIC = 12


@dataclass
class Records:
    """What a file holds.

    Attributes:
        messages: topic to payloads in the order of the file.
        schemas: topic to the name of its schema.
        metadata: name to keys and values; attachments: name to bytes.
        size: bytes of the file.
    """

    size: int
    messages: dict[str, list[bytes]] = field(default_factory=lambda: defaultdict(list))
    schemas: dict[str, str] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)


def read_records(path: Path) -> Records:
    """All records of the file.

    Raises:
        BusybotError: naming the file, if it is absent, too large, not a whole MCAP file, or damaged.
    """
    return parse_records(_read_bytes(path), str(path))


def parse_records(data: bytes, where: str) -> Records:
    """All records in a file's bytes; `where` names it in messages, see `read_records`."""
    with refusing(where, "not a whole MCAP file"):
        return _parse(data)


@contextmanager
def refusing(where: str, what: str) -> Iterator[None]:
    """Tell whatever a file's bytes cause as an error that names the file, and what to do about it.

    Args:
        what: the fault that an exception of other kinds amounts to.
    """
    folder = Path(where).parent
    dataset = shlex.quote(str(folder.parent)) if folder.name == "episodes" else "DATASET"
    hint = (
        f"`busybot dataset repair {dataset}` saves what can be saved, then `busybot collect {dataset}` records the rest"
    )
    try:
        yield
    except BusybotError as error:
        raise BusybotError(f"{where}: {error.what}", error.hint or hint) from None
    except FAULTS as error:
        raise BusybotError(f"{where}: {what}: {reason_of(error)}", hint) from None


def reason_of(error: Exception) -> str:
    """What one of `FAULTS` says; the end of a file has no words."""
    return f"{type(error).__name__}: {error}" if str(error) else "it ends too early"


def _read_bytes(path: Path) -> bytes:
    try:
        if path.is_dir():
            raise BusybotError(
                f"{path}: there is no such file, it is a folder", f"name a file, as {path / 'episodes' / '000000.mcap'}"
            )
        if not path.is_file():
            raise BusybotError(f"{path}: there is no such file")
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise BusybotError(f"{path}: {size} bytes are more than an episode may have ({MAX_FILE_BYTES})")
        return path.read_bytes()
    except OSError as error:
        raise BusybotError(f"{path}: cannot be read: {error.strerror}") from None


def _parse(data: bytes) -> Records:
    if data and not data.startswith(MAGIC[: len(data)]):
        raise BusybotError("not an MCAP file")
    stream = io.BytesIO(data)
    reader = StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=len(data))
    found = Records(size=len(data))
    channels: dict[int, str] = {}
    schemas: dict[int, str] = {}
    budget = MAX_CONTENT_BYTES
    checked, footer = False, Footer(0, 0, 0)
    for record in reader.records:
        if isinstance(record, Chunk):
            content = decompress(record, budget)
            budget -= len(content)
            _parse_chunk(record, content, found, channels, schemas)
        elif isinstance(record, Metadata):
            found.metadata[record.name] = record.metadata
        elif isinstance(record, Attachment):
            found.attachments[record.name] = record.data
        elif isinstance(record, DataEnd):
            checked = record.data_section_crc != 0
        elif isinstance(record, Footer):
            footer = record
    if not checked:
        raise BusybotError("the file has no checksum over its data")
    if stream.tell() != len(data):
        raise BusybotError(f"{len(data) - stream.tell()} bytes follow the end of the recording")
    _check_summary(data, footer)
    return found


def decompress(chunk: Chunk, limit: int) -> bytes:
    """Content of a chunk of at most `limit` bytes, compared with its checksum."""
    if chunk.uncompressed_size > limit:
        raise BusybotError(f"more than {MAX_CONTENT_BYTES} bytes of content")
    if chunk.compression == "zstd":
        claimed = zstandard.frame_content_size(chunk.data)
        if claimed not in (-1, chunk.uncompressed_size):
            raise BusybotError("a chunk contradicts itself about its size")
        decompressor = zstandard.ZstdDecompressor(max_window_size=1 << 27)
        content = decompressor.decompress(chunk.data, max_output_size=max(chunk.uncompressed_size, 1))
    elif chunk.compression == "":
        content = chunk.data
    else:
        raise BusybotError(f"a chunk is compressed with {chunk.compression!r}, not zstd")
    if len(content) != chunk.uncompressed_size or zlib.crc32(content) != chunk.uncompressed_crc:
        raise BusybotError("a chunk does not match its checksum")
    return content


def _parse_chunk(
    chunk: Chunk, content: bytes, found: Records, channels: dict[int, str], schemas: dict[int, str]
) -> None:
    for record in breakup_chunk(replace(chunk, compression="", data=content)):
        if isinstance(record, Schema):
            schemas[record.id] = record.name
        elif isinstance(record, Channel):
            channels[record.id] = record.topic
            found.schemas[record.topic] = schemas[record.schema_id] if record.schema_id else ""
        elif isinstance(record, Message):
            found.messages[channels[record.channel_id]].append(record.data)


def _check_summary(data: bytes, footer: Footer) -> None:
    summary = data[footer.summary_start : len(data) - _SUMMARY_CRC_AND_MAGIC]
    if footer.summary_start == 0 or zlib.crc32(summary) != footer.summary_crc:
        raise BusybotError("the index does not match its checksum")
