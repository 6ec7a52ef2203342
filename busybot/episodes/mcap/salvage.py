"""Recovers the readable part of an MCAP file that was cut off or damaged.

Whole chunks are taken if their checksum fits. Of the chunk in which a file was cut off, all that decompresses is taken:
there no checksum vouches for it, so the caller compares with what else is known. A damaged chunk is not taken, because
nobody can tell which part of it is right. Whole steps are kept, with the images that belong to them, byte for byte; a
step counts as whole when its action, its truth, its joints and, if it changed something, its pictures are there.

What depth means stands in the metadata, which have no checksum of their own: without the one over all data they are
believed where they say what nearly every recording says. A damaged scale does not become that by chance.
"""

import io
import json
import zlib
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import zstandard
from mcap.opcode import Opcode
from mcap.records import Chunk, DataEnd, Message, Metadata
from mcap.writer import CompressionType, Writer

from busybot.common.errors import BusybotError
from busybot.common.limits import MAX_CHUNK_BYTES, Budget
from busybot.episodes.codec import DepthScale
from busybot.episodes.episode import SALVAGED
from busybot.episodes.mcap import channels
from busybot.episodes.mcap.pictures import depth_scale
from busybot.episodes.mcap.records import (
    FAULTS,
    MAGIC,
    Records,
    decompress,
    each_record,
    read_attachment,
    read_content,
    reason_of,
    stream_of,
    telling_lack_of_memory,
)
from busybot.episodes.mcap.writer import CHUNK_BYTES

_PIECE = 1 << 16


@dataclass(frozen=True)
class Salvaged:
    """A file made of what could be saved.

    Attributes:
        data: of a whole MCAP file.
        steps: how many it holds, `of` so many.
        certain: False if its depth may have been measured otherwise than it says.
    """

    data: bytes
    steps: int
    of: int
    certain: bool

    @property
    def whole(self) -> bool:
        return self.steps == self.of


def salvage(data: bytes) -> Salvaged:
    """Save what can be saved of a file's bytes.

    Raises:
        BusybotError: nothing can be saved; says why.
        MemoryError: there is too little memory to find out.
    """
    try:
        with telling_lack_of_memory():
            return _rebuild(*_read(data))
    except FAULTS as error:
        raise BusybotError(f"what is left of it cannot be read: {reason_of(error)}") from None


def _read(data: bytes) -> tuple[Records, bool]:
    """All that can be read, and whether what follows is lost because a chunk is damaged."""
    if data[: len(MAGIC)] != MAGIC:
        raise BusybotError("it does not begin like an MCAP file")
    found, damaged, budget = Records(len(data)), False, Budget()
    for position, opcode, body, whole in each_record(data, budget, len(MAGIC)):
        if opcode == Opcode.CHUNK:
            content = _content(body, whole, budget)
            read_content(content, found, budget)
            damaged = whole and not content
        elif whole and opcode == Opcode.ATTACHMENT:
            with suppress(BusybotError):
                found.add(read_attachment(body))
        elif whole and opcode == Opcode.METADATA:
            found.add(Metadata.read(stream_of(body)))
        elif whole and opcode == Opcode.DATA_END:
            told = DataEnd.read(stream_of(body)).data_section_crc
            found.checksum = told if told == zlib.crc32(memoryview(data)[:position]) else 0
        if damaged or opcode == Opcode.DATA_END:
            break
    return found, damaged


def _content(body: bytes, whole: bool, budget: Budget) -> bytes:
    """What a chunk holds, of a cut off one the beginning; nothing of a damaged one, or of one cut off in its header."""
    try:
        chunk = Chunk.read(stream_of(body))
    except FAULTS:
        return b""
    if whole:
        try:
            return decompress(chunk, budget)
        except (BusybotError, zstandard.ZstdError):
            return b""
    limit = min(chunk.uncompressed_size, MAX_CHUNK_BYTES, budget.bytes)
    if chunk.compression != "zstd":
        return chunk.data[:limit]
    content = bytearray()
    reader = zstandard.ZstdDecompressor(max_window_size=1 << 27).stream_reader(io.BytesIO(chunk.data))
    with suppress(zstandard.ZstdError), telling_lack_of_memory():  # the beginning is what was asked for
        while len(content) < limit and (piece := reader.read(min(_PIECE, limit - len(content)))):
            content += piece
    return bytes(content)


def _rebuild(remains: Records, damaged: bool) -> Salvaged:
    names = {channels.BOARD_FILE, channels.RECORDING_FILE}
    if channels.METADATA not in remains.metadata or not names <= remains.attachments.keys():
        raise BusybotError("its beginning is lost, and with it the board or the camera")
    groups = _groups(remains)
    of = int(remains.metadata[channels.METADATA]["steps"])
    steps = len(groups) - 1
    if steps < 0 or steps == 0 < of:
        raise BusybotError("a chunk is damaged and no whole step before it" if damaged else "no step is whole")
    remains.messages = [pair for group in groups for pair in group]
    return Salvaged(_write(remains, steps, of), steps, of, _is_certain(remains))


def _is_certain(remains: Records) -> bool:
    """Whether the scale of depth is right, where there is depth; see the module's beginning."""
    deep = not {channels.CAMERA.depth, channels.GOAL.depth}.isdisjoint(remains.payloads)
    return bool(remains.checksum) or not deep or depth_scale(remains) == DepthScale()


Group = list[tuple[str, Message]]
"""Messages that belong together, with their topics."""


def _groups(remains: Records) -> list[Group]:
    """Messages of the start and of each whole step; the writer keeps the messages of a step together."""
    groups: list[Group] = [[]]
    for topic, message in remains.messages:
        if topic == channels.STEP:
            groups.append([])
        groups[-1].append((topic, message))
    first = {topic for topic, _ in groups[0]}
    required = first & {channels.RGB, channels.DEPTH, channels.SEGMENTATION, channels.BOXES}
    if not {channels.RGB, channels.BOXES, channels.LINKS, channels.OBJECTS} <= first:
        return []
    if remains.metadata[channels.METADATA].get("goals", "0") != "0" and channels.GOAL_BOXES not in first:
        return []  # a goal's boxes come last: without them a part of it is lost
    whole = groups[:1]
    for group in groups[1:]:
        step = channels.message_class(channels.SCHEMAS[channels.STEP]).FromString(group[0][1].data)
        wanted = {channels.STEP_TRUTH} | (required if step.image_after != step.image_before else set())
        wanted |= {channels.LOG} | (first & {channels.JOINTS})
        if not wanted <= {topic for topic, _ in group}:
            break
        whole.append(group)
    return whole


def _write(remains: Records, steps: int, of: int) -> bytes:
    buffer = io.BytesIO()
    writer = Writer(buffer, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True)
    writer.start()
    images = sum(topic == channels.BOXES for topic, _ in remains.messages)
    facts = remains.metadata[channels.METADATA] | {"steps": str(steps), "images": str(images)}
    writer.add_metadata(channels.METADATA, facts)
    for name, attachment in remains.attachments.items():
        data = attachment.data
        if name == channels.RECORDING_FILE and steps < of:
            data = _marked(data, of)
        writer.add_attachment(attachment.create_time, attachment.log_time, name, attachment.media_type, data)
    schemas = {
        key: writer.register_schema(schema.name, schema.encoding, schema.data)
        for key, schema in sorted(remains.schemas.items())
    }
    registered = {
        key: writer.register_channel(channel.topic, channel.message_encoding, schemas[channel.schema_id])
        for key, channel in sorted(remains.channels.items())
    }
    for _, message in remains.messages:
        channel = registered[message.channel_id]
        writer.add_message(channel, message.log_time, message.data, message.publish_time, message.sequence)
    writer.finish()
    return buffer.getvalue()


def _marked(recording: bytes, of: int) -> bytes:
    values: dict[str, Any] = json.loads(recording)
    settings = dict(values["settings"])
    before = settings.get(SALVAGED)
    of = before.get("of", of) if isinstance(before, dict) else of  # it may have been saved before
    return json.dumps({**values, "settings": {**settings, SALVAGED: {"of": of}}}, sort_keys=True).encode()
