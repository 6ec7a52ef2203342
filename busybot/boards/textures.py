"""The board's face: 5 textures and 8 colours (paper appendix "Board Generation"), made here from noise.

A texture is a grey-scale relief in 0..1 that the board's colour tints; nothing is read from files.
"""

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np

from busybot.boards.layout import footprint
from busybot.boards.spec import BoardSpec
from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.objects.model import ObjectModel

TEXTURES = ("wood", "plywood", "cork", "felt", "brushed")

COLORS: tuple[tuple[float, float, float], ...] = (
    (0.93, 0.83, 0.66),
    (0.80, 0.62, 0.42),
    (0.66, 0.80, 0.70),
    (0.62, 0.74, 0.88),
    (0.90, 0.72, 0.70),
    (0.94, 0.92, 0.86),
    (0.72, 0.68, 0.82),
    (0.62, 0.46, 0.33),
)
"""RGB tints in 0..1: maple, oak, sage, sky, rose, ivory, lilac, walnut."""

SHADOW, SHADOW_BLUR = 0.5, 0.05
"""How dark it gets beside an object, and how far its soft edge reaches, board units."""
LEAST_SIDE = 1e-3
"""A board that is smaller than this, board units, has the shadows of one that is as large: pixels can be counted."""
LAMP_FOOT = 0.8
"""A lamp's box is that of its shade; what it stands on is smaller."""
SIDE = 512
"""Of textures, pixels."""
WIDEST = SIDE / 4
"""No soft edge is wider (standard deviation, pixels): on a board as small as a switch all is in the shadow anyway, and
to blur so far would take minutes."""


@lru_cache(maxsize=len(TEXTURES))
def texture(name: str, size: int = SIDE) -> np.ndarray:
    """The texture's relief, float32 (size, size) in about 0.6..1, read-only; the same on every call.

    Raises:
        BusybotError: the name is not one of `TEXTURES`.
    """
    makers = {"wood": _wood, "plywood": _plywood, "cork": _cork, "felt": _felt, "brushed": _brushed}
    if name not in makers:
        raise BusybotError(f"unknown texture {name!r}", f"there are {', '.join(TEXTURES)}; draw the board again")
    relief = makers[name](size, generator(0, "surface", TEXTURES.index(name), "texture")).astype(np.float32)
    relief.flags.writeable = False
    return relief


def painted(
    name: str, color: tuple[float, float, float], size: int = SIDE, shade: np.ndarray | None = None
) -> np.ndarray:
    """The texture in a colour, uint8 RGB (size, size, 3).

    Args:
        shade: float32 (size, size) in 0..1, darkens it.
    """
    planes = []  # one after the other: pixels of three channels would take ten times as long
    for share in color:
        plane = np.rint((texture(name, size) * np.float32(share)).clip(0, 1) * 255)
        planes.append((plane if shade is None else plane * shade).astype(np.uint8))
    return cv2.merge(planes)


def contact_shadow(spec: BoardSpec, models: list[ObjectModel]) -> np.ndarray:
    """Soft darkening around what stands on the board, float32 (SIDE, SIDE) in 0..1; row 0 is the board's lower edge.

    Args:
        models: of `spec.objects`, in their order.
    """
    cover = np.zeros((SIDE, SIDE), np.uint8)
    scale = SIDE / np.maximum(spec.size, LEAST_SIDE)
    for placed, model in zip(spec.objects, models, strict=True):
        low, high = footprint(replace(model, scale=placed.scale), placed.yaw, margin=0.0)
        corner = (np.array(placed.position[:2]) + low + np.array(spec.size) / 2) * scale
        extent = (high - low) * scale
        if model.category == "Lamp":
            box = (tuple(map(float, corner + extent / 2)), tuple(map(float, extent * LAMP_FOOT)), 0.0)
            cv2.ellipse(cover, box, 255, -1)
        else:
            first, last = np.round(corner).astype(int).tolist(), np.round(corner + extent).astype(int).tolist()
            cv2.rectangle(cover, first, last, 255, -1)
    blurred = cv2.GaussianBlur(cover.astype(np.float32) / 255, (0, 0), min(SHADOW_BLUR * float(scale[0]), WIDEST))
    return 1 - SHADOW * blurred


def _noise(rng: np.random.Generator, size: int, sigma: float | tuple[float, float]) -> np.ndarray:
    """Smooth noise that wraps around, zero mean, unit deviation."""
    smooth = _blurred(rng.standard_normal((size, size)), sigma)
    return (smooth - smooth.mean()) / smooth.std()


def _blurred(image: np.ndarray, sigma: float | tuple[float, float]) -> np.ndarray:
    """A square image under a Gaussian, by rows and columns, that wraps around: a product of Fourier transforms."""
    across, along = (_gaussian(len(image), width) for width in np.broadcast_to(sigma, 2))
    transfer = np.fft.fft(across)[:, None] * np.fft.rfft(along)
    return np.fft.irfft2(np.fft.rfft2(image) * transfer, s=image.shape)


def _gaussian(size: int, sigma: float) -> np.ndarray:
    """Weights of a Gaussian around cell 0 of a ring, cut off at four standard deviations."""
    reach = int(4 * sigma + 0.5)
    offsets = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (offsets / sigma) ** 2)
    ring = np.zeros(size)
    np.add.at(ring, offsets % size, weights / weights.sum())
    return ring


def _scaled(relief: np.ndarray, low: float, high: float) -> np.ndarray:
    inner, outer = np.percentile(relief, [1, 99])
    return low + (high - low) * ((relief - inner) / (outer - inner)).clip(0, 1)


def _wood(size: int, rng: np.random.Generator) -> np.ndarray:
    """Planks with long grain: rings of a trunk cut lengthwise."""
    rows = np.arange(size)[:, None] / size
    warp = 0.05 * _noise(rng, size, (size / 24, size / 4)) + 0.012 * _noise(rng, size, (size / 64, size / 8))
    rings = 0.5 + 0.5 * np.sin(2 * np.pi * 11 * (rows + warp))
    fibre = _noise(rng, size, (0.6, size / 20))
    relief = _scaled(rings**1.5 + 0.25 * fibre, 0.80, 1.0)
    plank = size // 4
    for index in range(4):
        relief[index * plank : (index + 1) * plank] *= 1 - 0.05 * rng.random()
        relief[index * plank : index * plank + 2] *= 0.78
    return relief


def _plywood(size: int, rng: np.random.Generator) -> np.ndarray:
    """Broad flowing figure without planks."""
    rows = np.arange(size)[:, None] / size
    warp = 0.12 * _noise(rng, size, (size / 12, size / 5))
    figure = np.sin(2 * np.pi * (5 * rows + 2.2 * warp))
    pores = np.minimum(_noise(rng, size, (0.5, size / 90)), 0)
    return _scaled(figure + 0.22 * pores, 0.84, 1.0)


def _cork(size: int, rng: np.random.Generator) -> np.ndarray:
    """Granules of several sizes."""
    grains = _noise(rng, size, 2.2) + 0.7 * _noise(rng, size, 4.5)
    specks = _noise(rng, size, 1.3) < -1.9
    return _scaled(np.tanh(grains), 0.78, 1.0) * np.where(_blurred(specks * 1.0, 0.8) > 0.3, 0.72, 1)


def _felt(size: int, rng: np.random.Generator) -> np.ndarray:
    """Short fibres in two directions over soft clouds."""
    fibres = _noise(rng, size, (0.6, 2.5)) + _noise(rng, size, (2.5, 0.6))
    return _scaled(fibres + 0.6 * _noise(rng, size, size / 40), 0.86, 1.0)


def _brushed(size: int, rng: np.random.Generator) -> np.ndarray:
    """Fine straight strokes, as on brushed metal."""
    return _scaled(_noise(rng, size, (0.5, size / 10)) + 0.4 * _noise(rng, size, (2, size / 3)), 0.87, 1.0)
