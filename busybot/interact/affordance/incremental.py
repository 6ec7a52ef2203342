"""The position network, computed only where its input changed and its answer is wanted.

An action changes a hundredth of a picture, and objects cover a tenth of it. The network is local: what it says of a
pixel depends on some 110 pixels around it. So the outputs of its layers are kept from one picture of a board to the
next, and each layer is computed anew in those rectangles where both holds: something that they depend on has changed
since they were computed, and something that is wanted depends on them. The layers are the network's own, see the
numbers that they would see in a whole pass, and the same zeros beyond the border.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from busybot.interact.affordance.folding import FoldedBlock, FoldedPositionNet
from busybot.interact.affordance.inputs import Box, coarsened, halved, rectangles
from busybot.interact.affordance.networks import FOLD, double_size

TILES = {2: 4, 4: 2, 8: 1, 16: 1}
"""Rectangles are of whole squares of so many cells a side, powers of two, by the width of a cell in pixels."""
Scale = Literal["same", "finer", "coarser"]
Join = Callable[..., Tensor]


def _alone(source: Tensor) -> Tensor:
    """What a layer with one source reads."""
    return source


@dataclass(frozen=True)
class _Source:
    """What a layer reads: another layer's output as it is, pooled (it is finer) or interpolated (it is coarser)."""

    layer: "_Layer"
    scale: Scale


class _Layer:
    """A layer's output, kept in part.

    Args:
        blocks: what is computed one after the other; the convolutions among them reach `reach` cells in all.
        shape: rows and columns of the output.
        tile: side of the squares that rectangles consist of.
        sources: what is read, one, or a coarser one and one of its own size, which the network joins.

    Attributes:
        stale: uint8, like the output: cells that are not of the newest picture.
        values: (1, C, rows, columns).
        boxes: the rectangles to compute.
    """

    def __init__(
        self,
        blocks: Sequence[FoldedBlock],
        shape: tuple[int, int],
        tile: int,
        sources: Sequence[_Source] = (),
        join: Join = _alone,
    ) -> None:
        self.blocks, self.shape, self.tile, self.sources, self.join = blocks, shape, tile, sources, join
        self.reach = sum(block.reach for block in blocks)
        self.stale = np.ones(shape, np.uint8)
        self.needed = np.zeros(shape, np.uint8)
        self.boxes: list[Box] = []
        self.values = torch.empty(0)

    def mark(self, changed: Sequence[np.ndarray]) -> np.ndarray:
        """Cells that depend on what changed in the sources, by masks like the output; they are stale from now on."""
        reached = _grown(np.maximum.reduce(changed), self.reach)
        self.stale |= reached
        return reached

    def claim(self) -> np.ndarray:
        """Choose the rectangles to compute, around what is needed and stale; what they read, as a mask."""
        self.boxes = rectangles(self.needed & self.stale, self.tile)
        read = np.zeros(self.shape, np.uint8)
        for box in self.boxes:
            self.stale[box] = 0
            read[self._around(box, self.reach)] = 1
        self.needed[:] = 0
        return read

    def compute(self) -> None:
        """The rectangles that were claimed."""
        for box in self.boxes:
            reach = self.reach
            place = self._around(box, reach)
            x = self.join(*(_read(source, place) for source in self.sources))
            for block in self.blocks:
                reach -= block.reach
                inner = self._around(box, reach)
                x, place = block(x, _beyond(place, inner, block.reach)), inner
            self.values[:, :, *box] = x

    def start(self, channels: int, dtype: torch.dtype) -> None:
        """Know nothing yet."""
        empty = torch.zeros(1, channels, *self.shape, dtype=dtype)
        self.values = empty.contiguous(memory_format=torch.channels_last)

    def take_over(self, other: "_Layer", first: tuple[int, int]) -> None:
        """Take what lies on the same cells of another one, whose cell `first` is the first here; it may lie outside."""
        self.start(other.values.shape[1], other.values.dtype)
        here, there = _overlap(first, self.shape, other.shape)
        self.values[:, :, *here] = other.values[:, :, *there]
        self.stale[*here] = other.stale[*there]

    def _around(self, box: Box, reach: int) -> Box:
        """With so many cells more on each side, as far as there are any."""
        (top, bottom), (left, right) = ((side.start - reach, side.stop + reach) for side in box)
        rows, columns = self.shape
        return slice(max(0, top), min(rows, bottom)), slice(max(0, left), min(columns, right))


class IncrementalPositionNet:
    """`PositionNet` on the pictures of one board, one after the other, on a CPU.

    Args:
        network: what is run.
        size: rows and columns of the pictures, multiples of 16.
    """

    def __init__(self, network: FoldedPositionNet, size: tuple[int, int]):
        self._network, self._size, self._dtype = network, size, network.dtype
        self._changed = np.ones(size, np.uint8)  # since it was told last
        self._logits: Tensor | None = None  # before the first picture
        widths = [FOLD << level for level in range(len(network.encoders))]
        shapes = [(size[0] // width, size[1] // width) for width in widths]
        self._picture = _Layer((), shapes[0], TILES[widths[0]])
        encoders: list[_Layer] = []
        for encode, shape, width in zip(network.encoders, shapes, widths, strict=True):
            source = _Source(encoders[-1], "finer") if encoders else _Source(self._picture, "same")
            encoders.append(_Layer(encode, shape, TILES[width], [source]))
        after = [network.head, *network.lifts]  # nothing else reads what is before
        decoders = encoders[-1:]
        decoders[0].blocks = [*decoders[0].blocks, *after[len(encoders) - 1 :]]
        for level in reversed(range(len(network.decoders))):
            blocks = [network.decoders[level], *after[level : level + 1]]
            sources = [_Source(decoders[-1], "coarser"), _Source(encoders[level], "same")]
            decoders.append(_Layer(blocks, shapes[level], TILES[widths[level]], sources, network.joined))
        self._layers = [*encoders, *decoders[1:]]

    def __call__(self, features: Tensor, wanted: np.ndarray, changed: np.ndarray) -> Tensor:
        """Logits of the next picture.

        Shapes:
            features: float32 (C, H, W).
            wanted: uint8 (H, W), 1 where logits will be read.
            changed: uint8 (H, W), 1 where the picture may differ from the one before, if there was one.
            returns: (H, W), until the next call; what is not wanted may be of an earlier picture.
        """
        if self._logits is None:
            self._picture.start(FOLD**2 * len(features), self._dtype)
            for layer in self._layers:
                layer.start(len(layer.blocks[-1].weight), self._dtype)
            self._logits = torch.zeros(self._size, dtype=self._dtype)
        if (changed := changed | self._changed).any():
            self._mark(features, changed)
        self._compute(coarsened(wanted, FOLD), self._logits)
        self._changed = np.zeros(self._size, np.uint8)
        return self._logits

    def moved(self, first: tuple[int, int], size: tuple[int, int]) -> "IncrementalPositionNet":
        """For another part of the picture, with what can be kept of this one, which stays as it is.

        Args:
            first: row and column of this part at which the other one begins, multiples of 16; negative if before it.
            size: rows and columns of the other part.
        """
        other = IncrementalPositionNet(self._network, size)
        here, there = _overlap(first, size, self._size)
        if self._logits is None or any(side.start >= side.stop for side in here):
            return other
        for mine, its in zip([self._picture, *self._layers], [other._picture, *other._layers], strict=True):
            pixels = self._size[0] // mine.shape[0]
            its.take_over(mine, (first[0] // pixels, first[1] // pixels))
        other._logits = other._unfolded()
        other._changed = np.ones(size, np.uint8)
        other._changed[*here] = self._changed[*there]
        for lines, start, its_side, side in zip(
            (other._changed, other._changed.T), first, self._size, size, strict=True
        ):
            lines[: int(start > 0)] = 1  # along lines where the picture now ends the zeros are new
            lines[side - int(start + side < its_side) :] = 1
        return other

    def _mark(self, features: Tensor, changed: np.ndarray) -> None:
        """Take over what changed; what depends on it is stale."""
        cells = coarsened(changed, FOLD)
        for place in rectangles(cells, TILES[FOLD]):
            rows, columns = (slice(FOLD * side.start, FOLD * side.stop) for side in place)
            part = features[None, :, rows, columns].to(self._dtype)
            self._picture.values[:, :, *place] = functional.pixel_unshuffle(part, FOLD)
        masks = {self._picture: cells}
        for layer in self._layers:
            masks[layer] = layer.mark([_reached_from(source.scale, masks[source.layer]) for source in layer.sources])

    def _compute(self, wanted: np.ndarray, logits: Tensor) -> None:
        """What is wanted and stale, from the last layer back to the picture, then forward."""
        self._layers[-1].needed |= wanted
        for layer in reversed(self._layers):
            read = layer.claim()
            for source in layer.sources:
                source.layer.needed |= _needed_of(source.scale, read)
        for layer in self._layers:
            layer.compute()
        for rows, columns in self._layers[-1].boxes:
            part = slice(FOLD * rows.start, FOLD * rows.stop), slice(FOLD * columns.start, FOLD * columns.stop)
            logits[part] = self._unfolded(rows, columns)

    def _unfolded(self, rows: slice = slice(None), columns: slice = slice(None)) -> Tensor:
        """The last layer's output in these cells as logits of pixels."""
        return functional.pixel_shuffle(self._layers[-1].values[:, :, rows, columns], FOLD)[0, 0]


def _read(source: _Source, place: Box) -> Tensor:
    """The input of a layer at some of its cells, (1, C, rows, columns)."""
    values = source.layer.values
    if source.scale == "same":
        return values[:, :, *place]
    if source.scale == "finer":
        rows, columns = (slice(2 * side.start, 2 * side.stop) for side in place)
        return functional.max_pool2d(values[:, :, rows, columns], 2)
    # a cell more on each side, to interpolate with
    rows, columns = (slice(max(0, side.start // 2 - 1), -(-side.stop // 2) + 1) for side in place)
    within = [slice(side.start - 2 * coarse.start, side.stop - 2 * coarse.start)
              for side, coarse in zip(place, (rows, columns), strict=True)]  # fmt: skip
    return double_size(values[:, :, rows, columns])[:, :, *within]


def _beyond(place: Box, inner: Box, reach: int) -> list[int]:
    """Zeros that a convolution of `place` needs before and after columns and rows, to tell of `inner`."""
    return [
        missing
        for outer, side in zip(reversed(place), reversed(inner), strict=True)
        for missing in (outer.start + reach - side.start, side.stop + reach - outer.stop)
    ]


def _overlap(first: tuple[int, int], shape: tuple[int, int], other: tuple[int, int]) -> tuple[list[slice], list[slice]]:
    """Where two rectangles overlap, in one of `shape` and in the other, whose cell `first` is the first of the one."""
    lows = [max(0, -start) for start in first]
    highs = [min(size, its_size - start) for start, size, its_size in zip(first, shape, other, strict=True)]
    here = [slice(low, high) for low, high in zip(lows, highs, strict=True)]
    return here, [slice(one.start + start, one.stop + start) for one, start in zip(here, first, strict=True)]


def _grown(mask: np.ndarray, cells: int) -> np.ndarray:
    return cv2.dilate(mask, np.ones((2 * cells + 1, 2 * cells + 1), np.uint8)) if cells else mask


def _doubled(mask: np.ndarray) -> np.ndarray:
    return mask.repeat(2, 0).repeat(2, 1)


def _reached_from(scale: Scale, changed: np.ndarray) -> np.ndarray:
    """Where a layer's input changes, if its source did there."""
    if scale == "finer":
        return halved(changed)
    return changed if scale == "same" else _doubled(_grown(changed, 1))


def _needed_of(scale: Scale, read: np.ndarray) -> np.ndarray:
    """What a layer needs of its source, if its input is read there."""
    if scale == "finer":
        return _doubled(read)
    return read if scale == "same" else _grown(halved(read), 1)
