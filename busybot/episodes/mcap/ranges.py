"""One chunk of a long recording at an address, found by the index at the file's end: a few ranges, not the whole file.

The index and the chunk are compared with their checksums, sizes are limited as of whole files (`records`). The checksum
over all data is what the file says: it tells one recording from another, and whoever reads the whole file compares it.
"""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Metadata, MetadataIndex, Schema

from busybot.common.errors import BusybotError
from busybot.common.limits import MAX_ATTACHED_BYTES, MAX_RECORDING_BYTES, MIB, Budget
from busybot.common.remote import RemotePath
from busybot.episodes.mcap import channels
from busybot.episodes.mcap.records import (
    DATA_END,
    FOOTER,
    MAGIC,
    RECORD_HEAD,
    SUMMARY_CRC_AND_MAGIC,
    Records,
    decompress,
    each_record,
    read_content,
    stream_of,
)

WHOLE_BYTES = MIB
"""Files of at most so many bytes are read at once: that is faster than to ask for their index first."""
_TAIL_BYTES = 16 << 10
_MESSAGE_INDEX = 15
"""Bytes of the record that lists the messages of a channel in a chunk, beside 16 for each message."""


@dataclass(frozen=True)
class Index:
    """What a recording says of itself at its end.

    Attributes:
        records: its channels, metadata and checksum; no messages.
        chunks: where they lie, in the order of the file.
    """

    path: RemotePath
    records: Records
    chunks: list[ChunkIndex]

    def holding(self, topic: str, position: int) -> tuple[int, int] | None:
        """(number of the chunk, number of its first message on the topic) for a message; None if there is none."""
        before = 0
        for number, count in enumerate(self._counts(topic)):
            if before <= position < before + count:
                return number, before
            before += count
        return None

    def read(self, number: int, topic: str) -> list[bytes]:
        """Contents of the messages on a topic in chunk `number`."""
        place, budget = self.chunks[number], Budget()
        data = self.path.read(place.chunk_start_offset, place.chunk_start_offset + place.chunk_length)
        content = decompress(Chunk.read(stream_of(_record(data, Opcode.CHUNK))), budget)
        found = Records(len(data), schemas=dict(self.records.schemas), channels=dict(self.records.channels))
        if not read_content(content, found, budget):
            raise BusybotError("a chunk ends within a record")
        messages = found.payloads.get(topic, [])
        if len(messages) != list(self._counts(topic))[number]:
            raise BusybotError(f"chunk {number} does not hold what the index says")
        return messages

    def _counts(self, topic: str) -> Iterator[int]:
        """How many messages on the topic each chunk has."""
        channels = [number for number, channel in self.records.channels.items() if channel.topic == topic]
        for chunk in self.chunks:
            end = chunk.chunk_start_offset + chunk.chunk_length + chunk.message_index_length
            offsets = sorted({*chunk.message_index_offsets.values(), end})
            until = dict(pairwise(offsets))
            starts = [
                chunk.message_index_offsets[number] for number in channels if number in chunk.message_index_offsets
            ]
            yield sum((until[start] - start - _MESSAGE_INDEX) // 16 for start in starts)


def read_index(path: RemotePath, size: int) -> Index:
    """The index of a recording of `size` bytes; BusybotError or one of `records.FAULTS` where it has none."""
    if size > MAX_RECORDING_BYTES:
        raise BusybotError(f"{size} bytes are more than the {MAX_RECORDING_BYTES} that a recording may have")
    begin = max(size - _TAIL_BYTES, 0)
    tail = path.read(begin, size)
    opcode, _, start, _, checksum, magic = FOOTER.unpack(tail[-FOOTER.size :])
    if opcode != Opcode.FOOTER or magic != MAGIC or not DATA_END.size <= start < size:
        raise BusybotError("not a whole MCAP file")
    first = start - DATA_END.size
    if size - first > MAX_ATTACHED_BYTES:
        raise BusybotError(f"an index of more than {MAX_ATTACHED_BYTES} bytes")
    tail = (path.read(first, begin) if first < begin else b"") + tail[max(first - begin, 0) :]
    summary = tail[DATA_END.size : -SUMMARY_CRC_AND_MAGIC]
    opcode, _, found = DATA_END.unpack(tail[: DATA_END.size])
    if opcode != Opcode.DATA_END or zlib.crc32(summary) != checksum:
        raise BusybotError("the index does not match its checksum")
    index, told = Index(path, Records(size, found), []), None
    for _, opcode, body, _ in each_record(summary, Budget()):
        if opcode == Opcode.SCHEMA:
            index.records.add(Schema.read(stream_of(body)))
        elif opcode == Opcode.CHANNEL:
            index.records.add(Channel.read(stream_of(body)))
        elif opcode == Opcode.CHUNK_INDEX:
            index.chunks.append(ChunkIndex.read(stream_of(body)))
        elif opcode == Opcode.METADATA_INDEX:
            at = MetadataIndex.read(stream_of(body))
            told = at if at.name == channels.METADATA else told
    if told is not None:  # one, however many are named: each is a request
        data = path.read(told.offset, told.offset + min(told.length, MAX_ATTACHED_BYTES))
        index.records.add(Metadata.read(stream_of(_record(data, Opcode.METADATA))))
    index.chunks.sort(key=lambda chunk: chunk.chunk_start_offset)
    return index


def _record(data: bytes, expected: Opcode) -> bytes:
    """The body of the one record that the index says is there."""
    if data[:1] != bytes((expected,)) or int.from_bytes(data[1:RECORD_HEAD], "little") != len(data) - RECORD_HEAD:
        raise BusybotError("the index names places where other things lie")
    return data[RECORD_HEAD:]
