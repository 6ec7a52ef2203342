"""Recordings that are whole, with right checksums, and mean harm: odd numbers and texts within, and bombs."""

import io
import re
import struct
import zlib
from dataclasses import replace
from functools import cache

import numpy as np
import zstandard
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from busybot.common.limits import Budget
from busybot.episodes.mcap import channels
from busybot.episodes.mcap.records import MAGIC, Records, each_record, parse_records
from tests.hostile.damage import Damage, deep, flipped, huge_word, odd_key, odd_text, odd_value, other_number


def written(records: Records) -> bytes:
    """A file of these records."""
    buffer = io.BytesIO()
    writer = Writer(buffer, chunk_size=8 << 20, compression=CompressionType.ZSTD, enable_data_crcs=True)
    writer.start()
    for name, values in records.metadata.items():
        writer.add_metadata(name, values)
    for name, one in records.attachments.items():
        writer.add_attachment(one.create_time, one.log_time, name, one.media_type, one.data)
    schemas = {key: writer.register_schema(one.name, one.encoding, one.data) for key, one in records.schemas.items()}
    numbers = {
        key: writer.register_channel(one.topic, one.message_encoding, schemas[one.schema_id])
        for key, one in records.channels.items()
    }
    for _, message in records.messages:
        number = numbers[message.channel_id]
        writer.add_message(number, message.log_time, message.data, message.publish_time, message.sequence)
    writer.finish()
    return buffer.getvalue()


def within(way: Damage) -> Damage:
    """The damage, done to the board or the settings inside of a recording."""

    def damaged(data: bytes, rng: np.random.Generator) -> bytes:
        records = parse_records(data, "pristine")
        name = (channels.BOARD_FILE, channels.RECORDING_FILE)[int(rng.random() < 0.7)]
        attachment = records.attachments[name]
        records.attachments[name] = replace(attachment, data=way(attachment.data, rng))
        return written(records)

    damaged.__name__ = f"{way.__name__} within"
    return damaged


def odd_metadata(data: bytes, rng: np.random.Generator) -> bytes:
    """A number or text of the metadata is another one."""
    records = parse_records(data, "pristine")
    facts = records.metadata[channels.METADATA]
    name = sorted(facts)[int(rng.integers(len(facts)))]
    values = ("-1", "1e999", "nan", "99999999999", "", "x", "0", "1e-320", "{}", "[" * 100_000, "7" * 5000)
    facts[name] = values[int(rng.integers(len(values)))]
    return written(records)


def odd_message(data: bytes, rng: np.random.Generator) -> bytes:
    """A message has other bits, twice the length, nothing in it, is there often or not at all."""
    records = parse_records(data, "pristine")
    place, kind = int(rng.integers(len(records.messages))), int(rng.integers(5))
    topic, message = records.messages[place]
    content = (flipped(message.data, rng) if message.data else b"", message.data * 2, b"")[min(kind, 2)]
    changed = [(topic, replace(message, data=content))]
    records.messages[place : place + 1] = [(topic, message)] * 1000 if kind == 3 else [] if kind == 4 else changed
    return written(records)


def picture_bomb(data: bytes, rng: np.random.Generator) -> bytes:
    """The camera says that its pictures are huge, and so do their heads."""
    records = parse_records(data, "pristine")
    side = int(rng.choice([2048, 8192, 60_000]))
    attachment = records.attachments[channels.RECORDING_FILE]
    text = re.sub(rb'"(height|width)": \d+', rb'"\1": ' + str(side).encode(), attachment.data)
    records.attachments[channels.RECORDING_FILE] = replace(attachment, data=text)
    return written(records)


@cache
def chunk_of(kind: str) -> bytes:
    """A chunk of 60 MiB that compresses to nearly nothing: empty records, empty messages, or one long message."""
    record = {"records": struct.pack("<BQ", 0x70, 0), "messages": struct.pack("<BQHIQQ", 5, 22, 1, 0, 0, 0)}
    size = 60 << 20
    content = record[kind] * (size // len(record[kind])) if kind in record else b""
    content = content or struct.pack("<BQHIQQ", 5, size, 1, 0, 0, 0) + bytes(size - 22)
    packed = zstandard.compress(content)
    head = struct.pack("<QQQI", 0, 0, len(content), zlib.crc32(content)) + struct.pack("<I", 4) + b"zstd"
    body = head + struct.pack("<Q", len(packed)) + packed
    return struct.pack("<BQ", Opcode.CHUNK, len(body)) + body


def record_bomb(data: bytes, rng: np.random.Generator) -> bytes:
    """Chunks that expand to gigabytes, in a file whose checksums are right."""
    kind, count = ("records", "messages", "zeros")[int(rng.integers(3))], int(rng.integers(1, 40))
    records = list(each_record(data, Budget(), len(MAGIC)))
    ends = {opcode: position for position, opcode, _, _ in records}
    start, stop = ends[Opcode.DATA_END], ends[Opcode.FOOTER]
    head = data[:start] + chunk_of(kind) * count
    head += struct.pack("<BQI", Opcode.DATA_END, 4, zlib.crc32(head))
    summary = data[start + 13 : stop] + struct.pack("<BQQQ", Opcode.FOOTER, 20, len(head), 0)
    return head + summary + struct.pack("<I", zlib.crc32(summary)) + MAGIC


WITHIN: tuple[Damage, ...] = (
    *(within(way) for way in (other_number, other_number, odd_value, odd_value, odd_text, odd_key, huge_word, deep)),
    *(odd_metadata, odd_message, odd_message, picture_bomb),
)
BOMBS: tuple[Damage, ...] = (record_bomb, record_bomb, picture_bomb)
