"""The records of an MCAP file that may be truncated, damaged or made to exhaust the reader.

One pass over the whole file, all checksums compared, sizes limited before anything is decompressed. What the file
says about itself is checked against what it holds; schemas in the file are never used to decode it.
"""

import io
import os
import shlex
import stat
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import zstandard
from google.protobuf.message import DecodeError
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, DataEnd, Footer, McapRecord, Message, Metadata, Schema

from busybot.common.atomic_io import read_regular
from busybot.common.errors import BusybotError
from busybot.common.limits import MAX_CHUNK_BYTES, MAX_RECORDING_BYTES, Budget
from busybot.common.remote import HINT_COPY, is_remote

MAGIC = b"\x89MCAP0\r\n"
FAULTS = (
    *(McapError, zstandard.ZstdError, struct.error, DecodeError, ValueError, KeyError, IndexError, TypeError),
    *(OverflowError, RecursionError, EOFError),
)
"""What the libraries raise at damaged bytes, or at values that should not be there. Too little memory is none of them:
budgets bound what bytes can ask for, and a file that another machine reads must not be repaired."""

RECORD_HEAD = 9
"""Bytes of a record's opcode and length."""
SUMMARY_CRC_AND_MAGIC = 12
_LENGTH, _MESSAGE = struct.Struct("<Q"), struct.Struct("<HIQQ")
"""Of a record; channel, number, time of logging and of publishing before the data of a message."""
DATA_END = struct.Struct("<BQI")
"""Opcode, length, CRC-32 over the data; the summary follows."""
FOOTER = struct.Struct("<BQQQI8s")
"""Opcode, length, where the summary and its offsets start, their CRC-32, and the file's last bytes."""


@dataclass
class Records:
    """What a file holds.

    Attributes:
        size: bytes of the file.
        schemas, channels: by the numbers that stand for them.
        messages: with their topics, in the order of the file.
        metadata: name to keys and values; attachments by name.
        checksum: CRC-32 over the file's data, which was compared with them.
    """

    size: int
    checksum: int = 0
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
    if not is_remote(path) and path.is_dir():
        hint = f"name a file, as {path / 'episodes' / '000000.mcap'}"
        raise BusybotError(f"{path}: there is no such file, it is a folder", hint)
    data = read_regular(path, MAX_RECORDING_BYTES)
    return parse_records(data, str(path))


class Fingerprint(NamedTuple):
    """What tells one recording from another without reading it: size in bytes, CRC-32 of its data, time of writing.

    The checksum is None where only a folder was listed.
    """

    bytes: int
    checksum: int | None
    written_ns: int


def fingerprint(name: str | Path, folder: int | None = None) -> Fingerprint:
    """Fingerprint of a regular file in a folder that is open: two small reads at its end; nothing is compared here.

    The checksum is -1 where the file has none, as one that was cut off.

    Raises:
        OSError: the file is a link or cannot be opened.
    """
    descriptor = os.open(name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=folder)
    try:
        facts, checksum = os.fstat(descriptor), -1
        if stat.S_ISREG(facts.st_mode):
            end = os.pread(descriptor, FOOTER.size, max(facts.st_size - FOOTER.size, 0))
            opcode, _, summary, _, _, magic = FOOTER.unpack(end.rjust(FOOTER.size, b"\0"))
            if opcode == Opcode.FOOTER and magic == MAGIC and DATA_END.size <= summary < facts.st_size:
                opcode, _, found = DATA_END.unpack(os.pread(descriptor, DATA_END.size, summary - DATA_END.size))
                checksum = found if opcode == Opcode.DATA_END else -1
        return Fingerprint(facts.st_size, checksum, facts.st_mtime_ns)
    finally:
        os.close(descriptor)


def parse_records(data: bytes, where: str) -> Records:
    """All records in a file's bytes; `where` names it in messages, see `read_records`."""
    with refusing(where, "not a whole MCAP file"):
        return _parse(data)


@contextmanager
def refusing(where: str, what: str) -> Iterator[None]:
    """Tell whatever a file's bytes cause as an error that names the file, and what to do about it.

    Args:
        what: the fault that an exception of other kinds amounts to.

    Raises:
        BusybotError: naming the file.
        MemoryError: naming the file; there is nothing wrong with it.
    """
    folder = Path(where).parent
    dataset = shlex.quote(str(folder.parent)) if folder.name == "episodes" else "DATASET"
    hint = f"`busybot dataset repair {dataset}` saves what can be saved, and says how the rest comes back"
    hint = HINT_COPY if "://" in where else hint
    try:
        yield
    except BusybotError as error:
        raise BusybotError(f"{where}: {error.what}", error.hint or hint) from None
    except FAULTS as error:
        raise BusybotError(f"{where}: {what}: {reason_of(error)}", hint) from None
    except MemoryError:
        raise MemoryError(where) from None


def reason_of(error: Exception) -> str:
    """What one of `FAULTS` says; the end of a file has no words."""
    return f"{type(error).__name__}: {error}" if str(error) else "it ends too early"


def each_record(data: bytes, budget: Budget, start: int = 0) -> Iterator[tuple[int, int, bytes, bool]]:
    """(where it begins, opcode, body, whether it is all there) of each record."""
    position, count = start, 0
    while position + RECORD_HEAD <= len(data) and count <= budget.records:
        count += 1
        position += RECORD_HEAD + _LENGTH.unpack_from(data, position + 1)[0]
    budget.spend(records=count)  # before anything is made of them
    position = start
    while position + RECORD_HEAD <= len(data):
        opcode, length = data[position], _LENGTH.unpack_from(data, position + 1)[0]
        body = data[position + RECORD_HEAD : position + RECORD_HEAD + length]
        yield position, opcode, body, len(body) == length
        position += RECORD_HEAD + length


def read_content(content: bytes, found: Records, budget: Budget) -> bool:
    """Take in what a chunk holds; returns whether all of it is there."""
    position = 0
    for position, opcode, body, whole in each_record(content, budget):
        if not whole:
            return False
        if opcode == Opcode.MESSAGE:
            channel, sequence, logged, published = _MESSAGE.unpack_from(body)
            found.add(Message(channel, logged, body[_MESSAGE.size :], published, sequence))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            found.add((Schema if opcode == Opcode.SCHEMA else Channel).read(stream_of(body)))
        position += RECORD_HEAD + len(body)
    return position == len(content)


def stream_of(body: bytes) -> ReadDataStream:
    """What the library's records are read from."""
    return ReadDataStream(io.BytesIO(body))


def read_attachment(body: bytes) -> Attachment:
    """An attachment, compared with its checksum."""
    if len(body) < 4 or zlib.crc32(body[:-4]) != struct.unpack("<I", body[-4:])[0]:
        raise BusybotError("an attachment does not match its checksum")
    return Attachment.read(stream_of(body))


def _parse(data: bytes) -> Records:
    if data and not data.startswith(MAGIC[: len(data)]):
        raise BusybotError("not an MCAP file")
    found, budget, footer, end = Records(len(data)), Budget(), Footer(0, 0, 0), 0
    for position, opcode, body, whole in each_record(data, budget, len(MAGIC)):
        if not whole:
            break
        if opcode == Opcode.CHUNK:
            content = decompress(Chunk.read(stream_of(body)), budget)
            if not read_content(content, found, budget):
                raise BusybotError("a chunk ends within a record")
        elif opcode == Opcode.ATTACHMENT:
            found.add(read_attachment(body))
        elif opcode == Opcode.METADATA:
            found.add(Metadata.read(stream_of(body)))
        elif opcode == Opcode.DATA_END:
            found.checksum = DataEnd.read(stream_of(body)).data_section_crc
            if found.checksum and found.checksum != zlib.crc32(memoryview(data)[:position]):
                raise BusybotError("the data do not match their checksum")
        elif opcode == Opcode.FOOTER:
            footer, end = Footer.read(stream_of(body)), position + RECORD_HEAD + len(body)
            break
    if not data.startswith(MAGIC, end) or not end:
        raise EOFError
    if not found.checksum:
        raise BusybotError("the file has no checksum over its data")
    end += len(MAGIC)
    if end != len(data):
        raise BusybotError(f"{len(data) - end} bytes follow the end of the recording")
    summary = data[footer.summary_start : len(data) - SUMMARY_CRC_AND_MAGIC]
    if footer.summary_start == 0 or zlib.crc32(summary) != footer.summary_crc:
        raise BusybotError("the index does not match its checksum")
    return found


@contextmanager
def telling_lack_of_memory() -> Iterator[None]:
    """Zstandard tells of too little memory as of damaged bytes; raise MemoryError instead."""
    try:
        yield
    except zstandard.ZstdError as error:
        if "Allocation error" in str(error):
            raise MemoryError from None
        raise


def decompress(chunk: Chunk, budget: Budget) -> bytes:
    """Content of a chunk, which is within the budget, compared with its checksum."""
    if chunk.uncompressed_size > MAX_CHUNK_BYTES:
        raise BusybotError(f"a chunk with more than {MAX_CHUNK_BYTES} bytes of content")
    budget.spend(bytes=chunk.uncompressed_size)
    if chunk.compression == "zstd":
        claimed = zstandard.frame_content_size(chunk.data)
        if claimed not in (-1, chunk.uncompressed_size):
            raise BusybotError("a chunk contradicts itself about its size")
        decompressor = zstandard.ZstdDecompressor(max_window_size=1 << 27)
        with telling_lack_of_memory():
            content = decompressor.decompress(chunk.data, max_output_size=max(chunk.uncompressed_size, 1))
    elif chunk.compression == "":
        content = chunk.data
    else:
        raise BusybotError(f"a chunk is compressed with {chunk.compression!r}, not zstd")
    if len(content) != chunk.uncompressed_size or zlib.crc32(content) != chunk.uncompressed_crc:
        raise BusybotError("a chunk does not match its checksum")
    return content
