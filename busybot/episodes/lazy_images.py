"""The images of an episode that was read from a file, decoded when they are asked for."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import overload

import numpy as np

from busybot.common.errors import BusybotError
from busybot.episodes.codec import DepthScale, decode_plain, decode_rgb, encode_rgb
from busybot.episodes.episode import Image


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


@dataclass
class LazyImages(Sequence[Image]):
    """Behaves like `Episode.images`; keeps the last two images decoded, those before and after a step.

    Attributes:
        where: the file, for messages.
        links: number of links that the segmentation may name.
        encoded: what was read; boxes and bytes are there without decoding.
    """

    where: str
    width: int
    height: int
    links: int
    depth_scale: DepthScale
    encoded: list[EncodedImage]
    _recent: dict[int, Image] = field(default_factory=dict, repr=False)
    _depths: np.ndarray | None = field(default=None, repr=False)

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
            image = self._decode(position)
            for old in list(self._recent)[:-1]:
                del self._recent[old]
            self._recent[position] = image
        return self._recent[position]

    def __iter__(self) -> Iterator[Image]:
        return (self[i] for i in range(len(self)))

    def as_stored(self, image: Image) -> Image:
        """Another image as it would come back from this file: through its codecs."""
        png = self.encoded[0].rgb.startswith(b"\x89PNG") if self.encoded else True
        rgb = decode_rgb(encode_rgb(image.rgb, "png" if png else "jpeg"), self.width, self.height)
        if self._depths is None:
            self._depths = self.depth_scale.table()
        depth = None if image.depth is None else np.take(self._depths, self.depth_scale.quantise(image.depth))
        return Image(rgb=rgb, depth=depth, segmentation=image.segmentation, boxes=image.boxes)

    def _decode(self, position: int) -> Image:
        encoded = self.encoded[position]
        try:
            rgb = decode_rgb(encoded.rgb, self.width, self.height)
            steps = None if encoded.depth is None else decode_plain(encoded.depth, self.width, self.height)
            segmentation = self._decode_segmentation(encoded.segmentation)
        except ValueError as error:
            raise BusybotError(f"{self.where}: image {position}: {error}", "record the episode again") from None
        depth = None
        if steps is not None:
            if self._depths is None:
                self._depths = self.depth_scale.table()
            depth = np.take(self._depths, steps)
        return Image(rgb=rgb, depth=depth, segmentation=segmentation, boxes=encoded.boxes)

    def _decode_segmentation(self, data: bytes | None) -> np.ndarray | None:
        if data is None:
            return None
        segmentation = decode_plain(data, self.width, self.height).astype(np.uint16)
        if int(segmentation.max()) > self.links:
            raise ValueError(f"the segmentation names link {int(segmentation.max())} of {self.links}")
        return segmentation
