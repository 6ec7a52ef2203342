"""Features as one Parquet file, for other programs. Training reads the store, which is mapped into memory."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from busybot.files import replacing
from busybot.reason.features import Features
from busybot.reason.sequence import CHANNELS

SCHEMA = pa.schema(
    [
        ("episode", pa.int32()),
        ("frame", pa.int32()),
        ("object", pa.int16()),
        ("feature", pa.list_(pa.float16(), CHANNELS)),
    ]
)
"""One row for every frame and object that has features; one row group for every episode."""


def write_table(path: Path, features: Features) -> None:
    """Write the file, whole or not at all; its metadata name the encoder."""
    schema = SCHEMA.with_metadata({"encoder": features.encoder, "key": features.key, "oracle": str(features.oracle)})
    options = {"compression": "zstd", "use_byte_stream_split": ["feature.list.element"], "use_dictionary": False}
    with replacing(path) as file, pq.ParquetWriter(file, schema, **options) as writer:
        for episode, values in features.items():
            writer.write_table(_rows(episode, values, schema))


def _rows(episode: int, values: np.ndarray, schema: pa.Schema) -> pa.Table:
    frames, objects = np.nonzero(np.broadcast_to(np.any(values, axis=(0, 2)), values.shape[:2]))
    flat = pa.array(np.ascontiguousarray(values[frames, objects]).ravel(), pa.float16())
    columns = [
        pa.array(np.full(len(frames), episode), pa.int32()),
        pa.array(frames, pa.int32()),
        pa.array(objects, pa.int16()),
        pa.FixedSizeListArray.from_arrays(flat, CHANNELS),
    ]
    return pa.Table.from_arrays(columns, schema=schema)
