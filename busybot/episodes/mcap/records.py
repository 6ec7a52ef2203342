"""The records of an MCAP file that may be truncated, damaged or made to exhaust the reader.

One pass over the whole file, all checksums compared, sizes limited before anything is decompressed. What the file
says about itself is checked against what it holds; schemas in the file are never used to decode it.
"""

import io
import shlex
import struct
import zlib
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import zstandard
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Chunk, DataEnd, Footer, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from busybot.common.errors import BusybotError

MAX_FILE_BYTES = 1 << 30
MAX_CONTENT_BYTES = 2 << 30
MAGIC = b"\x89MCAP0\r\n"

_SUMMARY_CRC_AND_MAGIC = 12


@dataclass
class Records:
    """What a file holds.

    Attributes:
        messages: topic to (log time in ns, payload) in the order of the file.
        schemas: topic to the name of its schema.
        metadata: name to keys and values; attachments: name to bytes.
        size: bytes of the file.
    """

    size: int
    messages: dict[str, list[tuple[int, bytes]]] = field(default_factory=lambda: defaultdict(list))
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
    if data and not data.startswith(MAGIC[: len(data)]):
        raise BusybotError(f"{where}: not an MCAP file", hint_of(where))
    try:
        return _parse(data)
    except BusybotError as error:
        raise BusybotError(f"{where}: {error.what}", hint_of(where)) from None
    except (McapError, ValueError, struct.error, zstandard.ZstdError, KeyError, OverflowError, MemoryError) as error:
        reason = str(error) or "it ends too early"
        raise BusybotError(f"{where}: not a whole MCAP file: {reason}", hint_of(where)) from None


def hint_of(where: str) -> str:
    """What to do about a damaged episode; names its dataset where the path tells it."""
    folder = Path(where).parent
    dataset = shlex.quote(str(folder.parent)) if folder.name == "episodes" else "DATASET"
    return (
        f"`busybot dataset repair {dataset}` saves what can be saved, then `busybot collect {dataset}` records the rest"
    )


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
            _parse_chunk(content, found, channels, schemas)
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


def _parse_chunk(content: bytes, found: Records, channels: dict[int, str], schemas: dict[int, str]) -> None:
    plain = Chunk(
        compression="", data=content, message_end_time=0, message_start_time=0,
        uncompressed_crc=0, uncompressed_size=len(content),
    )  # fmt: skip
    for record in breakup_chunk(plain):
        if isinstance(record, Schema):
            schemas[record.id] = record.name
        elif isinstance(record, Channel):
            channels[record.id] = record.topic
            found.schemas[record.topic] = schemas[record.schema_id] if record.schema_id else ""
        elif isinstance(record, Message):
            found.messages[channels[record.channel_id]].append((record.log_time, record.data))


def _check_summary(data: bytes, footer: Footer) -> None:
    summary = data[footer.summary_start : len(data) - _SUMMARY_CRC_AND_MAGIC]
    if footer.summary_start == 0 or zlib.crc32(summary) != footer.summary_crc:
        raise BusybotError("the index does not match its checksum")
