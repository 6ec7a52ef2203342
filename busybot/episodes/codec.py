"""Images to bytes and back, those of a file when they are asked for: what a frame costs and how exactly it comes back.

RGB is JPEG (quality 90, no chroma subsampling) or PNG. Without subsampling a JPEG block is 8 x 8 pixels and depends on
nothing else, so what did not change stays bit-equal; a restart marker per row of blocks makes unchanged rows equal as
bytes too, and the zstd chunk of the MCAP file stores them once (64 -> 7 kB for a typical frame after the first).
Depth is a 16-bit PNG of equidistant steps, segmentation a PNG of indices; both lossless and cheap: zlib's lowest level
without row filters is the fastest to encode and decode (1.1 and 0.4 ms) and the chunk's zstd finds the repetitions.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, overload

import cv2
import numpy as np

from busybot.common.errors import BusybotError
from busybot.episodes.episode import Image

ImageFormat = Literal["jpeg", "png"]
Part = Literal["rgb", "depth", "segmentation"]
"""A picture of an image."""

DEPTH_OFFSET, DEPTH_SCALE = 2.0, 4e-5
"""Board units. The camera is 4 above the board, objects reach up to 1.2: depth lies between 2.0 and 4.62."""

JPEG_QUALITY = 90
JPEG_BLOCK = 8
MAX_SIDE = 8192
PNG_MAGIC = b"\x89PNG\r\n\x1a\n"

_LARGEST = 65535
_FAST_PNG = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_DEFAULT]
_PLAIN = [*_FAST_PNG, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE]
_COLOURED = [*_FAST_PNG, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB]


@dataclass(frozen=True)
class DepthScale:
    """Stored value v >= 1 means `offset + v * scale` board units; 0 means that nothing was hit."""

    offset: float = DEPTH_OFFSET
    scale: float = DEPTH_SCALE

    @classmethod
    def covering(cls, depths: list[np.ndarray]) -> "DepthScale":
        """The default where it covers all depths (float32 (H, W), 0 for nothing), else one made to measure."""
        low, high = np.inf, 0.0
        for depth in depths:
            if not cv2.checkRange(depth)[0]:
                raise BusybotError("a depth image holds NaN or infinite values", "write 0 where nothing was hit")
            hit = (depth > 0).view(np.uint8)
            minimum, maximum, _, place = cv2.minMaxLoc(depth, hit)
            if place != (-1, -1):
                low, high = min(low, minimum), max(high, maximum)
        default = cls()
        if high == 0.0 or (default.offset + default.scale <= low and high <= default.offset + _LARGEST * default.scale):
            return default
        scale = max((high - low) / (_LARGEST - 2), low * 1e-6)
        return cls(offset=low - scale, scale=scale)

    def quantise(self, depth: np.ndarray) -> np.ndarray:
        """Board units, float32 (H, W), to uint16 (H, W); the error is at most half a step."""
        steps = np.multiply(depth, np.float32(1 / self.scale), dtype=np.float32)
        steps += np.float32(0.5 - self.offset / self.scale)
        np.clip(steps, 0, _LARGEST, out=steps)
        return np.multiply(steps.astype(np.uint16), depth > 0)

    def restore(self, steps: np.ndarray) -> np.ndarray:
        """Stored values, uint16 (H, W), to board units, float32 (H, W)."""
        return np.take(self._table, steps)

    @cached_property
    def _table(self) -> np.ndarray:
        values = self.offset + np.arange(_LARGEST + 1) * self.scale
        values[0] = 0
        return values.astype(np.float32)


def encode_rgb(rgb: np.ndarray, image_format: ImageFormat) -> bytes:
    """uint8 (H, W, 3) to JPEG or PNG."""
    bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    if image_format == "png":
        return _encode(".png", bgr, _COLOURED)
    parameters = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    parameters += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    parameters += [cv2.IMWRITE_JPEG_RST_INTERVAL, -(-rgb.shape[1] // JPEG_BLOCK)]
    return _encode(".jpg", bgr, parameters)


def encode_plain(values: np.ndarray) -> bytes:
    """uint8 or uint16 (H, W), or colours (H, W, 3 or 4) in the order of OpenCV, to PNG."""
    return _encode(".png", values, _PLAIN)


def _encode(suffix: str, image: np.ndarray, parameters: list[int]) -> bytes:
    done, data = cv2.imencode(suffix, image, parameters)
    if not done:
        raise BusybotError(f"OpenCV cannot encode an image of shape {image.shape} as {suffix}")
    return data.tobytes()


def decode_rgb(data: bytes, width: int, height: int) -> np.ndarray:
    """JPEG or PNG to uint8 (H, W, 3); ValueError if the data are not such an image of that size."""
    return _decode(data, cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION, (height, width, 3), (np.uint8,))


def decode_plain(data: bytes, width: int, height: int) -> np.ndarray:
    """Grey PNG to uint8 or uint16 (H, W); ValueError if the data are not such an image of that size."""
    return _decode(data, cv2.IMREAD_UNCHANGED, (height, width), (np.uint8, np.uint16))


def _decode(data: bytes, flags: int, shape: tuple[int, ...], types: tuple[type, ...]) -> np.ndarray:
    width, height = image_size(data)
    if (height, width) != shape[:2]:
        raise ValueError(f"an image of {width} x {height} pixels where {shape[1]} x {shape[0]} are expected")
    image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    if image is None or image.shape != shape or image.dtype not in types:
        raise ValueError("an image cannot be decoded")
    return image


def image_size(data: bytes) -> tuple[int, int]:
    """Width and height from a PNG's or JPEG's header, without decoding: a small file can claim a huge image."""
    if data[:8] == PNG_MAGIC and data[12:16] == b"IHDR" and len(data) >= 24:
        width, height = struct.unpack(">II", data[16:24])
        return width, height
    position = 2
    while data[:2] == b"\xff\xd8" and position + 9 <= len(data) and data[position] == 0xFF:
        marker, length = data[position + 1], struct.unpack(">H", data[position + 2 : position + 4])[0]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", data[position + 5 : position + 9])
            return width, height
        position += 2 + length
    raise ValueError("neither a PNG nor a JPEG image")


class RowDecoder:
    """Decodes pictures of one scene: rows of blocks that are as in the first picture are copied, not decoded.

    What it returns is equal to what `decode_rgb` does, for pictures of any kind; those of other encoders take as long.

    Args:
        first: JPEG or PNG.
    """

    def __init__(self, first: bytes, width: int, height: int):
        self._width, self._height = width, height
        self._shown = decode_rgb(first, width, height)
        self._head, self._rows = _split(first, width, height) or (b"", [])

    def decode(self, data: bytes) -> np.ndarray:
        """uint8 (H, W, 3); ValueError as `decode_rgb`."""
        head, rows = _split(data, self._width, self._height) or (None, [])
        if head != self._head:
            return decode_rgb(data, self._width, self._height)
        image = self._shown.copy()
        changed = [number for number, (row, first) in enumerate(zip(rows, self._rows, strict=True)) if row != first]
        if changed:
            strip = _joined(self._head, [rows[number] for number in changed])
            decoded = decode_rgb(strip, self._width, JPEG_BLOCK * len(changed))
            blocks = (-1, JPEG_BLOCK, self._width, 3)
            image.reshape(blocks)[changed] = decoded.reshape(blocks)
        return image


def _split(data: bytes, width: int, height: int) -> tuple[bytes, list[bytes]] | None:
    """Header and rows of blocks of a JPEG that begins anew with every row; None of any other picture."""
    segments = _segments(data)
    begin = segments.get(_SCAN)
    each = segments.get(_RESTART)
    if begin is None or each is None or _BASELINE not in segments or not data.endswith(b"\xff\xd9"):
        return None
    if struct.unpack_from(">H", data, each + 4)[0] != -(-width // JPEG_BLOCK):
        return None
    position = begin + 2 + struct.unpack_from(">H", data, begin + 2)[0]
    head = data[:position]
    rows: list[bytes] = []
    while (end := data.find(_restart(len(rows)), position)) >= 0:
        rows.append(data[position:end])
        position = end + 2
    rows.append(data[position:-2])
    # with an interval of so many blocks, other samplings of colours than 4:4:4 have fewer rows
    return (head, rows) if len(rows) * JPEG_BLOCK == height else None


def _joined(head: bytes, rows: list[bytes]) -> bytes:
    """A JPEG of some rows of blocks."""
    size = _segments(head)[_BASELINE] + 5
    parts = [head[:size], struct.pack(">H", JPEG_BLOCK * len(rows)), head[size + 2 :]]
    for number, row in enumerate(rows):
        parts += [row, _restart(number)]
    return b"".join([*parts[:-1], b"\xff\xd9"])


def _restart(number: int) -> bytes:
    return bytes((0xFF, 0xD0 + number % 8))


_BASELINE, _SCAN, _RESTART = 0xC0, 0xDA, 0xDD


def _segments(data: bytes) -> dict[int, int]:
    """Where a JPEG's segments begin, by their markers, up to its first scan."""
    found: dict[int, int] = {}
    position = 2
    while data[:2] == b"\xff\xd8" and position + 9 <= len(data) and data[position] == 0xFF and _SCAN not in found:
        found[data[position + 1]] = position
        position += 2 + struct.unpack_from(">H", data, position + 2)[0]
    return found


@dataclass(frozen=True)
class EncodedImage:
    """One stored observation as it lies in the file.

    Attributes:
        rgb: JPEG or PNG.
        depth: 16-bit PNG or None.
        segmentation: 8- or 16-bit PNG or None.
        boxes: as in `Image`.
    """

    rgb: bytes
    depth: bytes | None
    segmentation: bytes | None
    boxes: np.ndarray


def encode_image(image: Image, rgb: ImageFormat, scale: DepthScale, links: int) -> EncodedImage:
    """An image as files keep it; `links` is the number of links that its segmentation may name."""
    depth, labels = image.depth, image.segmentation
    return EncodedImage(
        encode_rgb(image.rgb, rgb),
        None if depth is None else encode_plain(scale.quantise(depth)),
        None if labels is None else encode_plain(labels.astype(np.uint8) if links < 256 else labels),
        image.boxes,
    )


class LazyImage(Image):
    """One of `LazyImages`: each of its pictures is decoded when it is first asked for."""

    _images: "LazyImages"
    _encoded: EncodedImage
    _position: int

    @classmethod
    def of(cls, images: "LazyImages", encoded: EncodedImage, position: int = -1) -> "LazyImage":
        """Image `position` of a file, not decoded yet."""
        image = cls.__new__(cls)
        image._images, image._encoded, image._position, image.boxes = images, encoded, position, encoded.boxes
        return image

    @cached_property
    def rgb(self) -> np.ndarray:  # type: ignore[override]
        """uint8 (H, W, 3)."""
        return self._decoded("rgb")

    @cached_property
    def depth(self) -> np.ndarray | None:  # type: ignore[override]
        """float32 (H, W), board units."""
        return self._decoded("depth")

    @cached_property
    def segmentation(self) -> np.ndarray | None:  # type: ignore[override]
        """uint16 (H, W)."""
        return self._decoded("segmentation")

    def whole(self) -> Image:
        """The same with all that it has decoded."""
        return Image(self.rgb, self.depth, self.segmentation, self.boxes)

    def _decoded(self, part: Part) -> Any:
        return self._images.decode(self._encoded, part, self._position)


@dataclass
class LazyImages(Sequence[Image]):
    """Behaves like `Episode.images`; keeps what was decoded of the images that were asked for last.

    Attributes:
        where: the file, for messages.
        links: number of links that the segmentation may name.
        encoded: what was read; boxes are there without decoding.
        keeps: number of images that are kept; two by default, those before and after a step.
    """

    where: str
    width: int
    height: int
    links: int
    depth_scale: DepthScale
    encoded: Sequence[EncodedImage]
    keeps: int = 2
    _recent: dict[int, Image] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self.encoded)

    @overload
    def __getitem__(self, index: int) -> Image: ...

    @overload
    def __getitem__(self, index: slice) -> list[Image]: ...

    def __getitem__(self, index: int | slice) -> Image | list[Image]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        position = range(len(self))[index]
        if position not in self._recent:
            image = LazyImage.of(self._alone, self.encoded[position], position)
            if not self.keeps:
                return image
            while len(self._recent) >= self.keeps:
                del self._recent[next(iter(self._recent))]
            self._recent[position] = image
        return self._recent[position]

    @cached_property
    def _alone(self) -> "LazyImages":
        """What its images decode themselves by: as they do not hold each other, all are freed with their last use."""
        return replace(self, encoded=(), _recent={})

    def as_stored(self, image: Image) -> Image:
        """Another image as it would come back from this file: through its codecs."""
        png = self.encoded[0].rgb.startswith(PNG_MAGIC) if self.encoded else True
        return LazyImage.of(self, encode_image(image, "png" if png else "jpeg", self.depth_scale, self.links)).whole()

    def decode(self, encoded: EncodedImage, part: Part, position: int = -1) -> Any:
        """One picture of an image, as in `Image`; None if it was not recorded.

        Raises:
            BusybotError: naming the file and the image, which is `position` there, if it cannot be decoded.
        """
        data = getattr(encoded, part)
        try:
            return None if data is None else self._decode(data, part)
        except ValueError as error:
            raise BusybotError(f"{self.where}: image {position}: {error}", "record the episode again") from None

    def _decode(self, data: bytes, part: Part) -> np.ndarray:
        if part == "rgb":
            return decode_rgb(data, self.width, self.height)
        if part == "depth":
            return self.depth_scale.restore(decode_plain(data, self.width, self.height))
        return self._decode_segmentation(data)

    def _decode_segmentation(self, data: bytes) -> np.ndarray:
        segmentation = decode_plain(data, self.width, self.height).astype(np.uint16)
        if int(segmentation.max()) > self.links:
            raise ValueError(f"the segmentation names link {int(segmentation.max())} of {self.links}")
        return segmentation
