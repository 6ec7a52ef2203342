"""The records of an MCAP file that may be truncated, damaged or made to exhaust the reader.

One pass over the whole file, all checksums compared, sizes limited before anything is decompressed. What the file
says about itself is checked against what it holds; schemas in the file are never used to decode it.
"""

import io
import shlex
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import zstandard
from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Chunk, DataEnd, Footer, McapRecord, Message, Metadata, Schema
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
        size: bytes of the file.
        schemas, channels: by the numbers that stand for them.
        messages: with their topics, in the order of the file.
        metadata: name to keys and values; attachments by name.
    """

    size: int
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    messages: list[tuple[str, Message]] = field(default_factory=list)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, Attachment] = field(default_factory=dict)

    def add(self, record: McapRecord) -> None:
        """Take a record in; those of other kinds say nothing about the episode."""
        if isinstance(record, Schema):
            self.schemas[record.id] = record
        elif isinstance(record, Channel):
            self.channels[record.id] = record
        elif isinstance(record, Message):
            self.messages.append((self.channels[record.channel_id].topic, record))
        elif isinstance(record, Metadata):
            self.metadata[record.name] = record.metadata
        elif isinstance(record, Attachment):
            self.attachments[record.name] = record

    @cached_property
    def payloads(self) -> dict[str, list[bytes]]:
        """Contents of the messages by topic, in the order of the file."""
        found: dict[str, list[bytes]] = {}
        for topic, message in self.messages:
            found.setdefault(topic, []).append(message.data)
        return found

    @property
    def schema_names(self) -> dict[str, str]:
        """Name of the schema of each channel, by its topic; empty where it has none."""
        return {
            channel.topic: self.schemas[channel.schema_id].name if channel.schema_id else ""
            for channel in self.channels.values()
        }


def read_records(path: Path) -> Records:
    """All records of the file.

    Raises:
        BusybotError: naming the file, if it is absent, too large, not a whole MCAP file, or damaged.
    """
    try:
        if path.is_dir():
            hint = f"name a file, as {path / 'episodes' / '000000.mcap'}"
            raise BusybotError(f"{path}: there is no such file, it is a folder", hint)
        if not path.is_file():
            raise BusybotError(f"{path}: there is no such file")
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise BusybotError(f"{path}: {size} bytes are more than an episode may have ({MAX_FILE_BYTES})")
        data = path.read_bytes()
    except OSError as error:
        raise BusybotError(f"{path}: cannot be read: {error.strerror}") from None
    return parse_records(data, str(path))


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


def _parse(data: bytes) -> Records:
    if data and not data.startswith(MAGIC[: len(data)]):
        raise BusybotError("not an MCAP file")
    stream = io.BytesIO(data)
    found, budget = Records(len(data)), MAX_CONTENT_BYTES
    checked, footer = False, Footer(0, 0, 0)
    for record in StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=len(data)).records:
        if isinstance(record, Chunk):
            content = decompress(record, budget)
            budget -= len(content)
            for inner in breakup_chunk(replace(record, compression="", data=content)):
                found.add(inner)
        elif isinstance(record, DataEnd):
            checked = record.data_section_crc != 0
        elif isinstance(record, Footer):
            footer = record
        elif isinstance(record, Metadata | Attachment):
            found.add(record)
    if not checked:
        raise BusybotError("the file has no checksum over its data")
    if stream.tell() != len(data):
        raise BusybotError(f"{len(data) - stream.tell()} bytes follow the end of the recording")
    summary = data[footer.summary_start : len(data) - _SUMMARY_CRC_AND_MAGIC]
    if footer.summary_start == 0 or zlib.crc32(summary) != footer.summary_crc:
        raise BusybotError("the index does not match its checksum")
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
