"""Encoders by name.

A name is that of an encoder, alone or with the pixels that it is given: `embedded` takes an object's own pixels as
depth tells them, `embedded-box` those of its box (from pictures without depth), `embedded-mask` those that the
simulator's segmentation calls its own (an oracle). `resnet50-centre` takes one pixel of the whole picture, as the
paper's authors do. Packages bring more, in the entry-point group `busybot.encoders` (docs/extending/add-an-encoder.md).
"""

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from busybot.common import plugins
from busybot.common.errors import BusybotError, UsageError
from busybot.episodes.episode import Episode
from busybot.reason.inputs.appearances import Appearance, appearances_of
from busybot.reason.inputs.object_masks import MASKS, MaskConfig, ObjectMasks, OracleMasks
from busybot.reason.inputs.observation import ObservedEpisode, observe_episode
from busybot.reason.inputs.sequence import CHANNELS
from busybot.reason.inputs.steady import steadied

ENCODERS = ("embedded", "resnet50", "resnet50keras", "random")
PIXELS = {
    "own": "an object's own pixels, told by depth",
    "box": "the pixels of an object's first-frame box",
    "mask": "an object's own pixels, told by the segmentation",
    "centre": "the pixel of the whole picture at the centre of an object's first-frame box",
}
DEFAULT = "embedded"


class Encoder(Protocol):
    """Turns looks into numbers.

    Attributes:
        key: says which of all encoders of its name this is: versions, weights.
    """

    key: str

    def encode(self, looks: list[Appearance]) -> np.ndarray:
        """float32 (n, 256)."""


@runtime_checkable
class PlaceEncoder(Encoder, Protocol):
    """Turns single places of whole pictures into numbers, too; what comes with `-centre` behind its name."""

    def encode_at(self, pictures: list[np.ndarray], places: np.ndarray) -> np.ndarray:
        """float32 (n, K, 256) of K places (u, v), in shares of width and height, in n pictures uint8 (H, W, 3)."""


@dataclass(frozen=True)
class FeatureExtractor:
    """An encoder and the pixels that it is given.

    Attributes:
        name: as asked for.
        key: the name with a digest of all that decides the numbers.
        pixels: one of `PIXELS`.
    """

    name: str
    key: str
    pixels: str
    encoder: Encoder

    @property
    def oracle(self) -> bool:
        """Whether the features hold what only the simulator knows."""
        return self.pixels == "mask"

    def of(self, observed: ObservedEpisode) -> np.ndarray:
        """Features of every frame and object, float16 (T + 1, N, 256); zeros for triggers and without a box.

        Raises:
            BusybotError: the encoder is an oracle: it needs the episode (`of_episode`).
        """
        if self.oracle:
            what = f"{self.name} needs the segmentation, which is not among what a reasoner may read"
            raise BusybotError(what, "choose an encoder without `-mask`, or a model that was trained with one")
        observed = steadied(observed)
        if self.pixels == "centre":
            numbers, frames = np.unique(observed.image_of, return_inverse=True)
            return self.of_pictures(observed, [observed.images[number].rgb for number in numbers])[frames]
        return self._encode(observed, ObjectMasks(observed, MaskConfig(depth=self.pixels == "own")))

    def of_episode(self, episode: Episode) -> np.ndarray:
        """The same from an episode, of which only an oracle reads what is privileged."""
        observed = observe_episode(episode)
        return self._encode(observed, OracleMasks(episode)) if self.oracle else self.of(observed)

    def _encode(self, observed: ObservedEpisode, pixels: ObjectMasks | OracleMasks) -> np.ndarray:
        looks = appearances_of(observed, pixels)
        # the last row is that of objects without looks
        rows = np.concatenate([self.encoder.encode(looks.looks), np.zeros((1, CHANNELS), np.float32)])
        return np.asarray(rows[looks.of], np.float16)

    def of_pictures(self, observed: ObservedEpisode, pictures: list[np.ndarray]) -> np.ndarray:
        """Features at the centres of the board's boxes in pictures of it, float16 (n, N, 256), with `-centre` alone.

        Whatever is at a centre is taken for the object: its box is all that is known.
        """
        assert isinstance(self.encoder, PlaceEncoder)
        low, high = observed.boxes[:, :2].astype(np.float32), observed.boxes[:, 2:].astype(np.float32)
        shown = np.intersect1d(observed.responders, np.flatnonzero(np.all(high > low, axis=1)))
        features = np.zeros((len(pictures), len(low), CHANNELS), np.float16)
        features[:, shown] = self.encoder.encode_at(pictures, (low + high)[shown] / 2 / pictures[0].shape[1::-1])
        return features


@lru_cache(maxsize=4)
def make_extractor(name: str = DEFAULT, weights: Path | None = None) -> FeatureExtractor:
    """The encoder of that name.

    Args:
        weights: of `resnet50`: a file with torchvision's layout; None for the official one.

    Raises:
        BusybotError: there is no such encoder, or its weights cannot be had.
    """
    base, _, pixels = name.partition("-")
    pixels = pixels or "own"
    known = [*ENCODERS, *plugins.names("encoders")]
    if base not in known or pixels not in PIXELS or name.endswith("-"):
        what = f"choose one of {', '.join(known)}, also with -{', -'.join(list(PIXELS)[1:])} behind it"
        raise UsageError(f"there is no encoder {name!r}", what)
    if weights is not None and base != "resnet50":
        raise UsageError(f"{weights}: {base} takes no weights", "they go with `--encoder resnet50`")
    encoder = _make(base, weights)
    if pixels == "centre" and not isinstance(encoder, PlaceEncoder):
        raise UsageError(
            f"{base} does not encode single places", "-centre goes with resnet50, resnet50keras and random"
        )
    facts = f"{base} {encoder.key} {pixels} {MASKS} {MaskConfig().model_dump_json()}"
    return FeatureExtractor(name, f"{name}-{hashlib.sha256(facts.encode()).hexdigest()[:8]}", pixels, encoder)


def _make(base: str, weights: Path | None) -> Encoder:
    if base not in ENCODERS:
        encoder: Encoder = plugins.make("encoders", base)
        return encoder
    if base == "embedded":
        from busybot.reason.encoders.descriptor import Descriptor

        return Descriptor()
    # torch only where it is needed
    from busybot.reason.encoders.keras_weights import from_keras
    from busybot.reason.encoders.resnet import drawn, pretrained

    if base == "resnet50keras":
        return from_keras()
    return drawn() if base == "random" else pretrained(weights)
