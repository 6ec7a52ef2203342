"""Encoded pictures of recordings, read when they are asked for; those read last are kept, up to `KEPT_BYTES`.

So episodes and datasets of any size can be open at once: what a process holds of all their pictures has one limit.
"""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from threading import Lock

import numpy as np

from busybot.common.errors import BusybotError
from busybot.common.limits import MAX_IMAGE_PIXELS, MIB
from busybot.common.remote import is_remote
from busybot.episodes.codec import DepthScale, EncodedImage, RowDecoder, decode_rgb, image_size
from busybot.episodes.mcap import channels
from busybot.episodes.mcap.ranges import WHOLE_BYTES, Index, read_index
from busybot.episodes.mcap.records import Records, read_records, refusing

KEPT_BYTES = 256 * MIB
"""Of all recordings, in a process: RGB of about 110 episodes of 30 steps, 640 x 480."""


@dataclass(frozen=True)
class Encoded:
    """Pictures of a topic by their numbers, all or those of a chunk, and what stored depth means."""

    pictures: dict[int, bytes]
    scale: DepthScale
    _rows: list[RowDecoder | None] = field(default_factory=list, repr=False, compare=False)

    def rgb(self, position: int, width: int, height: int) -> np.ndarray:
        """RGB picture `position`, uint8 (H, W, 3); ValueError if it is none of that size."""
        if not self._rows:  # to decode the first picture beside this one pays from the second time on
            self._rows.append(None)
            return decode_rgb(self.pictures[position], width, height)
        rows = self._rows[0] = self._rows[0] or RowDecoder(self._first, width, height)
        return rows.decode(self.pictures[position])

    @property
    def _first(self) -> bytes:
        return next(iter(self.pictures.values()))

    @cached_property
    def bytes(self) -> int:
        """In memory, with one picture that is decoded."""
        width, height = image_size(self._first) if self.pictures else (0, 0)
        return sum(map(len, self.pictures.values())) + 3 * width * height


class Kept:
    """What was read last, of at most so many bytes."""

    def __init__(self, most: int):
        self.most, self._bytes = most, 0
        self._entries: OrderedDict[Hashable, Encoded] = OrderedDict()
        self._lock = Lock()

    def get(self, key: Hashable, read: Callable[[], Encoded]) -> Encoded:
        """What is kept under a key, else what reading gives."""
        with self._lock:
            if key in self._entries:
                self._entries.move_to_end(key)
                return self._entries[key]
        found = read()
        with self._lock:
            if key not in self._entries:
                self._entries[key] = found
                self._bytes += found.bytes
            while self._bytes > self.most:
                self._bytes -= self._entries.popitem(last=False)[1].bytes
        return found


_KEPT = Kept(KEPT_BYTES)


@dataclass(frozen=True)
class PictureFile:
    """The pictures of a recording, without holding them.

    Attributes:
        checksum: of the recording (`Records.checksum`); another one in its place is refused. None for any.
    """

    path: Path
    checksum: int | None = None

    def holding(self, topic: str, position: int) -> Encoded:
        """Pictures of a topic, of which number `position` is one, from memory if they are kept.

        Raises:
            BusybotError: there is none of that number, the file is damaged, or it is another one than before.
        """
        with refusing(str(self.path), "not a recording of this project"):
            chunk, first = (0, 0) if self._index is None else self._index.holding(topic, position) or (0, 0)
            found = _KEPT.get((self.path, self.checksum, topic, chunk), lambda: self._read(topic, chunk, first))
            if position not in found.pictures:
                raise BusybotError(f"there is no picture {position} on {topic}")
            return found

    @cached_property
    def _index(self) -> Index | None:
        """Of a long recording at an address; all others are read as a whole."""
        if not is_remote(self.path) or (size := self.path.size()) <= WHOLE_BYTES:
            return None
        return read_index(self.path, size)

    def _read(self, topic: str, chunk: int, first: int) -> Encoded:
        records = read_records(self.path) if self._index is None else self._index.records
        if self.checksum not in (None, records.checksum):
            what = "it was recorded again since it was opened, or its tables were made"
            raise BusybotError(what, "open the dataset again; `busybot dataset repair DATASET` mends tables")
        messages = records.payloads.get(topic, []) if self._index is None else self._index.read(chunk, topic)
        decode = channels.message_class(channels.SCHEMAS[channels.RGB]).FromString
        pictures = {number: decode(data).data for number, data in enumerate(messages, first)}
        if any(w * h > MAX_IMAGE_PIXELS for w, h in map(image_size, pictures.values())):
            raise ValueError(f"a picture of more than {MAX_IMAGE_PIXELS} pixels")
        return Encoded(pictures, depth_scale(records))


class StoredImage(EncodedImage):
    """An image of a recording that is read from its file whenever it is asked for."""

    _file: PictureFile
    _topics: tuple[str | None, ...]
    _position: int

    @classmethod
    def of(cls, file: PictureFile, place: channels.Pictures, position: int, read: EncodedImage) -> "StoredImage":
        """The same as one that was read: where it lies instead of its pictures."""
        image = cls.__new__(cls)
        parts = (read.rgb, read.depth, read.segmentation)
        topics = tuple(None if part is None else topic for topic, part in zip(place, parts, strict=False))
        vars(image).update(_file=file, _topics=topics, _position=position, boxes=read.boxes)
        return image

    @property
    def rgb(self) -> bytes:
        """JPEG or PNG."""
        data = self._part(0)
        assert data is not None
        return data

    @property
    def depth(self) -> bytes | None:
        """16-bit PNG or None."""
        return self._part(1)

    @property
    def segmentation(self) -> bytes | None:
        """8- or 16-bit PNG or None."""
        return self._part(2)

    def _part(self, number: int) -> bytes | None:
        topic = self._topics[number]
        return None if topic is None else self._file.holding(topic, self._position).pictures[self._position]


def depth_scale(records: Records) -> DepthScale:
    """What stored depth means; ValueError where it cannot be."""
    metadata = records.metadata[channels.METADATA]
    scale = DepthScale(float(metadata["depth_offset"]), float(metadata["depth_scale"]))
    if not (np.isfinite((scale.offset, scale.scale)).all() and 0 < scale.scale < 1e3 and abs(scale.offset) < 1e6):
        raise ValueError(f"depth scale {scale}")
    return scale
