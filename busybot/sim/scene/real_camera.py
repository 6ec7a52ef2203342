"""What a real camera makes of a rendered picture, and what an agent with such a camera gets (`--camera real`).

A `Photo` is made from the clean picture, the number of its frame and generators of its own, term by term in the order
of `TERMS`: first what lies in front of the camera (hand, shadow), then how it hangs (shake), its lens (blur), its
sensor (exposure, noise, edges and holes of depth) and its codec (JPEG). Every draw comes from
`generator(seed, split, board, "camera/TERM/FRAME")`, or `.../trackN` for what lasts longer than a frame: a photo can be
made again without those before it, and a term makes what it makes whatever the others do.

Only colours and depth are the camera's. Segmentation and boxes stay those of the clean picture: they are privileged,
as is `Photo.surface`, the true depth. The clean picture itself is not recorded, because the simulator gives it again to
the last bit (`sim.replay`): a recording holds what a robot would have.

The gripper is not told either. Its place is what the photo's depth says at the chosen pixel, in the frame of the camera
that does not shake: a shake displaces what is aimed at by as many pixels. It holds what truly lies there, at that pixel
of the clean picture, if that lies no farther than `REACH` from where it went; in a hole of the depth, and on the hand,
it holds nothing.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import cv2
import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from busybot.common.frozen_model import FrozenModel
from busybot.common.rng import generator
from busybot.episodes.codec import decode_rgb
from busybot.episodes.comparing import SQUARE, TOLERANCE, changed_squares
from busybot.episodes.episode import Image

REACH = 0.05
"""A place farther than this from the true surface at its pixel (along the optical axis, board units) holds nothing."""
GOAL_FRAME = -1
"""Number of a goal's photo; nothing passes in it."""
PERIOD = 10
"""Frames 1 to 10, 11 to 20, ...: in each such stretch a hand and a shadow pass at most once, never in frame 0."""
SHADOW_CHANCE, SHADOW_FRAMES = 0.5, 5
"""In how many stretches a shadow passes, and for how many frames at most."""
HAND_FRAMES = 4
HAND_NEAR = 0.8
"""The hand is nearer than all else: its depth as a share of the smallest one."""
SKIN = ((224, 172, 138), (198, 140, 104), (141, 93, 66), (96, 62, 46))


class CameraConfig(FrozenModel):
    """Terms of the real camera with their strengths; 0 leaves a term out, and without any the camera is clean.

    Attributes:
        hand: share of frames, from frame 1 on, in which a hand hides a part of the board, for 2 to 4 frames on end,
            longer where two meet.
        shadow: share of light that a soft band takes which moves over the board for 2 to 5 frames now and then.
        shake: displacement of each frame, up to so many pixels in any direction.
        blur: standard deviation of the blur, pixels; each frame has between half and all of it.
        exposure: aperture stops by which brightness drifts up and down, over tens of frames.
        noise: standard deviation of the sensor's noise, share of the range, for each channel of each pixel.
        depth_edges: each pixel's depth is that of a place beside it, so many pixels away (standard deviation): edges
            fray, surfaces stay.
        depth_holes: share of pixels without depth, in patches, others in each frame.
        jpeg: quality of the encoding, 1 to 100.
        tolerance: photos differ at a pixel by more than this share of the range (`changed_area`).

    JSON has only what differs from a clean camera.
    """

    hand: Annotated[float, Field(ge=0, le=0.25)] = 0.0
    shadow: Annotated[float, Field(ge=0, le=1)] = 0.0
    shake: Annotated[float, Field(ge=0, le=32)] = 0.0
    blur: Annotated[float, Field(ge=0, le=16)] = 0.0
    exposure: Annotated[float, Field(ge=0, le=4)] = 0.0
    noise: Annotated[float, Field(ge=0, le=1)] = 0.0
    depth_edges: Annotated[float, Field(ge=0, le=16)] = 0.0
    depth_holes: Annotated[float, Field(ge=0, le=1)] = 0.0
    jpeg: Annotated[int, Field(ge=0, le=100)] = 0
    tolerance: Annotated[float, Field(ge=0, le=1)] = TOLERANCE

    @property
    def clean(self) -> bool:
        """Whether pictures stay as they are rendered."""
        return not any(getattr(self, term) for term in TERMS)

    @model_serializer(mode="wrap")
    def _what_differs(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        fields = type(self).model_fields
        return {name: value for name, value in handler(self).items() if value != fields[name].default}


REAL = {
    "hand": 0.04,
    "shadow": 0.35,
    "shake": 2.0,
    "blur": 0.8,
    "exposure": 0.25,
    "noise": 0.012,
    "depth_edges": 1.0,
    "depth_holes": 0.01,
    "jpeg": 80,
}
"""Strengths of `--camera real`, see docs/guides/camera.md."""

Draw = Callable[[str], np.random.Generator]
"""The generator of one term of one board, for a frame (its number) or for what lasts longer (`track...`)."""
Views = tuple[np.ndarray, np.ndarray]
"""RGB, uint8 (H, W, 3), and depth, float32 (H, W)."""
Origin = tuple[int, str, int]
"""What with the configuration determines all photos of an episode: the collection's seed, the board's split, index."""


@dataclass
class Photo(Image):
    """A picture of the real camera.

    Attributes:
        surface: the true depth, float32 (H, W); privileged.
        config, origin, frame: what the photo was made with.
    """

    surface: np.ndarray
    config: CameraConfig
    origin: Origin
    frame: int

    def next(self, clean: Image) -> "Photo":
        """The camera's photo of the frame that follows."""
        return take_photo(clean, self.config, self.origin, self.frame + 1)


def take_photo(clean: Image, config: CameraConfig, origin: Origin, frame: int) -> Photo:
    """What the real camera shows of a rendered picture; the same for the same arguments."""
    assert clean.depth is not None
    views: Views = (clean.rgb, clean.depth)
    for term, apply in TERMS.items():
        if strength := getattr(config, term):
            views = apply(views, strength, frame, partial(_drawn, origin, term))
    return Photo(*views, clean.segmentation, clean.boxes, clean.depth, config, origin, frame)


def true_depth(image: Image) -> np.ndarray:
    """Depth of what truly lies at each pixel, float32 (H, W). Privileged."""
    depth = image.surface if isinstance(image, Photo) else image.depth
    assert depth is not None
    return depth


def changed_area(before: np.ndarray, after: np.ndarray, tolerance: float) -> int:
    """Number of pixels, of two photos uint8 (H, W, 3), in `changed_squares`."""
    return min(int(changed_squares(before, after, tolerance).sum()) * SQUARE**2, before.shape[0] * before.shape[1])


def _drawn(origin: Origin, term: str, purpose: str) -> np.random.Generator:
    return generator(*origin, f"camera/{term}/{purpose}")


def _passing(frame: int, chance: float, longest: int, draw: Draw) -> tuple[float, np.random.Generator] | None:
    """How far on its way (0..1) something is that passes in a frame, and the generator of its looks; None if nothing.

    Args:
        chance: that something passes in a stretch of frames.
        longest: it is there for so many frames at most, and for half as many at least.
    """
    stretch, place = divmod(frame - 1, PERIOD)
    if stretch < 0:
        return None
    rng = draw(f"track{stretch}")
    passes, length = rng.random() < chance, int(rng.integers(longest // 2, longest + 1))
    start = int(rng.integers(PERIOD - length + 1))
    return ((place - start + 0.5) / length, rng) if passes and start <= place < start + length else None


def _hand(views: Views, strength: float, frame: int, draw: Draw) -> Views:
    mean_frames = (HAND_FRAMES // 2 + HAND_FRAMES) / 2
    passing = _passing(frame, strength * PERIOD / mean_frames, HAND_FRAMES, draw)
    if passing is None:
        return views
    rgb, depth = views
    cover = _arm(depth.shape, *passing)
    roundness = cv2.distanceTransform((cover > 0).astype(np.uint8), cv2.DIST_L2, 3) / (depth.shape[0] / 20)
    skin = np.array(SKIN[int(passing[1].integers(len(SKIN)))]) * (0.6 + 0.4 * roundness.clip(0, 1))[..., None]
    opaque = cover[..., None] / np.float32(255)
    # where nothing was hit anywhere, nobody knows how near that is: then the hand has no depth either
    near = HAND_NEAR * depth[depth > 0].min() if (depth > 0).any() else 0.0
    return (rgb * (1 - opaque) + skin * opaque).astype(np.uint8), np.where(cover > 127, np.float32(near), depth)


def _arm(size: tuple[int, ...], along: float, rng: np.random.Generator) -> np.ndarray:
    """Coverage of an arm with a hand that reaches in from the border, uint8 (H, W); it moves on its way."""
    height, width = size
    unit = height / 12
    middle = np.array([width, height]) * rng.uniform(0.25, 0.75, 2)
    turn = rng.uniform(0, 2 * np.pi)
    reach, aside = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    palm = middle + aside * unit * 3 * (along - 0.5) - reach * unit
    cover = np.zeros(size, np.uint8)

    def limb(start: np.ndarray, end: np.ndarray, thickness: float) -> None:
        ends = [tuple(int(value) for value in point.round()) for point in (start, end)]
        cv2.line(cover, ends[0], ends[1], 255, max(1, round(thickness * unit)), cv2.LINE_AA)

    limb(palm - reach * (width + height), palm, 1.3)
    limb(palm - reach * 0.3 * unit, palm + reach * 0.4 * unit, 1.9)
    for place, length in ((-0.75, 1.7), (-0.25, 2.1), (0.25, 2.0), (0.75, 1.5)):
        knuckle = palm + (aside * place + reach * 0.8) * unit
        limb(knuckle, knuckle + (reach + aside * place * 0.3) * length * unit, 0.45)
    limb(palm - aside * 0.8 * unit, palm + (reach * 0.9 - aside * 1.7) * unit, 0.5)
    return cover


def _shadow(views: Views, strength: float, frame: int, draw: Draw) -> Views:
    passing = _passing(frame, SHADOW_CHANCE, SHADOW_FRAMES, draw)
    if passing is None:
        return views
    along, rng = passing
    rgb, depth = views
    height, width = depth.shape
    turn, half_width, soft = rng.uniform(0, 2 * np.pi), rng.uniform(0.08, 0.2), rng.uniform(0.04, 0.1)
    across = np.arange(width) / width - 0.5
    down = (np.arange(height) - height / 2) / width
    place = across * np.cos(turn) + (down * np.sin(turn))[:, None]
    outside = ((np.abs(place - (along - 0.5)) - half_width) / soft).clip(0, 1)
    light = 1 - strength * (1 - outside * outside * (3 - 2 * outside))
    return (rgb * light[..., None]).astype(np.uint8), depth


def _shake(views: Views, strength: float, frame: int, draw: Draw) -> Views:
    rng = draw(str(frame))
    turn, length = rng.uniform(0, 2 * np.pi), strength * np.sqrt(rng.random())
    right, down = length * np.cos(turn), length * np.sin(turn)
    (rgb, depth), (height, width) = views, views[1].shape
    shift = np.array([[1, 0, right], [0, 1, down]])
    rows = (np.arange(height) - round(down)).clip(0, height - 1)
    columns = (np.arange(width) - round(right)).clip(0, width - 1)
    return cv2.warpAffine(rgb, shift, (width, height), borderMode=cv2.BORDER_REPLICATE), depth[np.ix_(rows, columns)]


def _blur(views: Views, strength: float, frame: int, draw: Draw) -> Views:
    deviation = strength * draw(str(frame)).uniform(0.5, 1)
    return cv2.GaussianBlur(views[0], (0, 0), deviation), views[1]


def _exposure(views: Views, strength: float, frame: int, draw: Draw) -> Views:
    rng = draw("track")
    periods, phases = rng.uniform(8, 40, 2), rng.uniform(0, 1, 2)
    drift = np.sin(2 * np.pi * (frame / periods + phases)).mean()
    levels = (np.arange(256) * 2 ** (strength * drift)).round().clip(0, 255)
    return cv2.LUT(views[0], levels.astype(np.uint8)), views[1]


def _noise(views: Views, strength: float, frame: int, draw: Draw) -> Views:
    rgb, depth = views
    field = draw(str(frame)).standard_normal(rgb.shape, np.float32) * np.float32(255 * strength)
    return cv2.add(rgb.astype(np.float32), field, dtype=cv2.CV_8U), depth


def _depth_edges(views: Views, strength: float, frame: int, draw: Draw) -> Views:
    rgb, depth = views
    beside = (draw(str(frame)).standard_normal((2, *depth.shape), np.float32) * np.float32(strength)).round()
    rows, columns = (
        side + offset.astype(np.intp) for side, offset in zip(np.indices(depth.shape), beside, strict=True)
    )
    height, width = depth.shape
    return rgb, depth[rows.clip(0, height - 1), columns.clip(0, width - 1)]


def _depth_holes(views: Views, strength: float, frame: int, draw: Draw) -> Views:
    rgb, depth = views
    height, width = depth.shape
    coarse = draw(str(frame)).random((-(-height // 8), -(-width // 8)), np.float32)
    field = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    return rgb, np.where(field <= np.quantile(field, strength), np.float32(0), depth)


def _jpeg(views: Views, strength: float, frame: int, draw: Draw) -> Views:
    _, data = cv2.imencode(".jpg", cv2.cvtColor(views[0], cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, int(strength)])
    return decode_rgb(data.tobytes(), views[0].shape[1], views[0].shape[0]), views[1]


TERMS: dict[str, Callable[[Views, float, int, Draw], Views]] = {
    "hand": _hand,
    "shadow": _shadow,
    "shake": _shake,
    "blur": _blur,
    "exposure": _exposure,
    "noise": _noise,
    "depth_edges": _depth_edges,
    "depth_holes": _depth_holes,
    "jpeg": _jpeg,
}
"""What each term makes of a picture, in the order in which they are applied."""
