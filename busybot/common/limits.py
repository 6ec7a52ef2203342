"""What large files from outside may cost at most: recordings, tables, pictures, videos, weights.

A limit that one reader alone needs stands beside it: of objects' files, configurations, manifests, and single values.

`docs/reference/limits.md` has the table, which is made of this module (`python -m tools.docs`).
"""

import time
from dataclasses import dataclass, field

from busybot.common.errors import BusybotError

MIB = 1 << 20
MAX_RECORDING_BYTES = 512 * MIB
"""Of a recording's file."""
MAX_CONTENT_BYTES = 768 * MIB
"""Of all that is in a recording, decompressed."""
MAX_CHUNK_BYTES = 64 * MIB
"""Of one of its chunks, decompressed; ours have 8 MiB."""
MAX_RECORDS = 600_000
"""In a recording: 100,000 steps with 20,000 images need no more."""
MAX_DECODED_BYTES = 64 * MIB
"""Of the messages of a kind that are decoded, pictures left out."""
MAX_ATTACHED_BYTES = 4 * MIB
"""Of the board and the settings of a recording, as JSON."""
MAX_SECONDS = 60.0
"""To take a recording's records in."""
MAX_IMAGE_PIXELS = 8_400_000
"""Of one image: 3840 x 2160 is less."""
MAX_PIXELS = 1_000_000_000
"""Of all images of a recording: 3,255 of 640 x 480, decoded in 13 s of one core."""
MAX_WATCHED_PIXELS = 64_000_000
"""Of all triggers' boxes in all frames before a camera that is not still: six of 60 x 60 in 2,900 frames. Each takes up
to 16 bytes, three times."""
MAX_VIDEO_FRAMES = 100_000
"""Of a video: 55 minutes at 30 frames per second."""
MAX_VIDEO_PIXELS = 4_000_000_000
"""Of all its frames: a minute of 1920 x 1080 at 30 frames per second, whatever the file's size."""
MAX_VIDEO_RATIO = 1_000
"""So many pixels more for each byte of the file: films have fewer to a byte, files that swell have more."""
MAX_VIDEO_SECONDS = 600.0
"""To decode a video's frames."""
MAX_TABLE_BYTES = 1024 * MIB
"""Of a Parquet file of a table."""
MAX_ANSWERS_BYTES = 32 * MIB
"""Of a file of answers to questions "what if": some thousands of boards."""
MAX_LINES_BYTES = 256 * MIB
"""Of a file with a line of JSON per board."""
MAX_JSON_BYTES = 64 * MIB
"""Of any other file of JSON, but the manifest."""
MAX_WEIGHTS_BYTES = 2048 * MIB
"""Of a file of weights."""
MAX_PICTURE_BYTES = 64 * MIB
"""Of a picture that a report shows."""
MAX_PICTURE_PIXELS = 64_000_000
"""Of one that a report makes smaller."""
MAX_HASHED_BYTES = 8192 * MIB
"""Of any file whose SHA-256 is asked for."""


@dataclass
class Budget:
    """What reading a recording may still cost; spent before and while it is decoded."""

    bytes: int = MAX_CONTENT_BYTES
    records: int = MAX_RECORDS
    until: float = field(default_factory=lambda: time.monotonic() + MAX_SECONDS)

    def spend(self, bytes: int = 0, records: int = 0) -> None:
        """Take it off.

        Raises:
            BusybotError: it is more than is left.
        """
        self.bytes -= bytes
        self.records -= records
        if self.bytes < 0:
            raise BusybotError(f"more than the {MAX_CONTENT_BYTES} bytes of content that a recording may have")
        if self.records < 0:
            raise BusybotError(f"more than the {MAX_RECORDS} records that a recording may have")
        if time.monotonic() > self.until:
            raise BusybotError(f"its records are not read after {MAX_SECONDS:.0f} s")
