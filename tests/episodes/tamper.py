"""Recordings that were changed after the fact, with checksums that fit again."""

import io
from collections.abc import Callable
from pathlib import Path

from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

Edit = Callable[[str, bytes], bytes | None]


def rewrite(
    path: Path,
    message: Edit = lambda topic, data: data,
    metadata: Callable[[dict[str, str]], dict[str, str]] = lambda values: values,
    attachment: Edit = lambda name, data: data,
    schema: Callable[[str], str] = lambda name: name,
) -> None:
    """Write the file again with edited messages (None drops one), metadata, attachments or schema names."""
    records = list(StreamReader(io.BytesIO(path.read_bytes())).records)
    buffer = io.BytesIO()
    writer = Writer(buffer, compression=CompressionType.ZSTD, enable_data_crcs=True)
    writer.start()
    schemas: dict[int, int] = {}
    channels: dict[int, tuple[int, str]] = {}
    for record in records:
        if isinstance(record, Schema) and record.id not in schemas:
            schemas[record.id] = writer.register_schema(schema(record.name), record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in channels:
            known = writer.register_channel(record.topic, record.message_encoding, schemas[record.schema_id])
            channels[record.id] = (known, record.topic)
        elif isinstance(record, Message):
            channel, topic = channels[record.channel_id]
            data = message(topic, record.data)
            if data is not None:
                writer.add_message(channel, record.log_time, data, record.log_time)
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, metadata(dict(record.metadata)))
        elif isinstance(record, Attachment):
            data = attachment(record.name, record.data)
            if data is not None:
                writer.add_attachment(0, 0, record.name, record.media_type, data)
    writer.finish()
    path.write_bytes(buffer.getvalue())
