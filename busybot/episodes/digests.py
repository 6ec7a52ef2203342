"""Digests of an episode: three hashes over decoded values in a fixed order.

- board: the `BoardSpec` alone.
- trace: what was done and what came of it in discrete states. It holds no pixels, so the image format does not matter;
  but what a policy does may depend on what it sees, and positions come from the depth image.
- content: all of the recording, images as they decode from the file.

None depends on names, paths, times, the number of workers, the host, package versions or the bytes of a codec. They
are taken from a file as it was read back, so they also say that the file can be read.
"""

import hashlib
import struct
from collections.abc import Iterable, Sequence
from operator import attrgetter
from typing import Annotated, Any

import numpy as np
import pyarrow as pa
from pydantic import Field

from busybot.common.frozen_model import FrozenModel
from busybot.episodes.episode import Episode, Image, Step
from busybot.episodes.schema import STEP_FIELDS

Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class Digests(FrozenModel):
    """Of one episode or (`combine`) of a dataset."""

    board: Sha256
    trace: Sha256
    content: Sha256


class _Hasher:
    """SHA-256 over values, each with its type and length, so that no two sequences of values look alike."""

    def __init__(self, purpose: str):
        self._hash = hashlib.sha256()
        self.text(f"busybot {purpose} 1")

    def text(self, value: str) -> None:
        data = value.encode()
        self._hash.update(struct.pack("<cQ", b"t", len(data)) + data)

    def integers(self, *values: int) -> None:
        self._hash.update(struct.pack(f"<cQ{len(values)}q", b"i", len(values), *(int(v) for v in values)))

    def numbers(self, values: Sequence[float] | np.ndarray) -> None:
        """float64; all NaNs are alike, and so are both zeros."""
        flat = np.asarray(values, np.float64).ravel() + 0.0
        flat[np.isnan(flat)] = np.nan
        self._hash.update(struct.pack("<cQ", b"n", flat.size) + flat.astype("<f8").tobytes())

    def array(self, values: np.ndarray | None) -> None:
        if values is None:
            self._hash.update(b"-")
            return
        little = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
        self.text(little.dtype.str)
        self.integers(*little.shape)
        self._hash.update(little.data.cast("B") if little.size else b"")

    def hexadecimal(self) -> str:
        return self._hash.hexdigest()


def episode_digests(episode: Episode) -> Digests:
    """Digests of an episode that was read from its file."""
    trace = _trace_digest(episode)
    return Digests(board=episode.board.digest(), trace=trace, content=_content_digest(episode, trace))


def _trace_digest(episode: Episode) -> str:
    """Actions (pixel, position, directions, distance) and discrete states."""
    hasher = _Hasher("trace")
    hasher.integers(len(episode.steps))
    for step in episode.steps:
        _add_step(hasher, step, _TRACE)
    return hasher.hexadecimal()


def _content_digest(episode: Episode, trace: str) -> str:
    """Trace, rewards, joints, camera, links, positions, every stored image and the goal image, if there is one."""
    hasher = _Hasher("content")
    hasher.text(trace)
    hasher.integers(episode.camera.width, episode.camera.height)
    for values in (episode.camera.matrix, episode.camera.pose, episode.positions):
        hasher.numbers(values)
    for link in episode.links:
        hasher.integers(link.object, link.trigger)
        hasher.text(link.name)
    for step in episode.steps:
        _add_step(hasher, step, _CONTENT)
    hasher.integers(*episode.frame_of)
    for image in episode.images:
        _add_image(hasher, image)
    for image in episode.goals:
        hasher.text("goal")  # nothing of it where there is none: older recordings keep their hash
        _add_image(hasher, image)
    return hasher.hexadecimal()


_Layout = list[tuple[type, list[tuple[str, bool]]]]
"""What is hashed of a step, place by place: the type, and the names of the parts with whether they are lists."""


def _layout(digest: str) -> _Layout:
    fields = [field for field in STEP_FIELDS if field.hashed and field.hashed.digest == digest]
    found: dict[int, tuple[type, list[tuple[str, bool]]]] = {}
    for field in sorted(fields, key=attrgetter("hashed.place", "hashed.part")):
        assert field.hashed is not None
        kind = str if field.stored == pa.string() else field.stored.to_pandas_dtype()
        found.setdefault(field.hashed.place, (kind, []))[1].append((field.name, bool(field.shape)))
    return list(found.values())


_TRACE, _CONTENT = _layout("trace"), _layout("content")


def _add_step(hasher: _Hasher, step: Step, layout: _Layout) -> None:
    for kind, parts in layout:
        values: list[Any] = []
        for name, several in parts:
            value = getattr(step, name)
            values += value if several else (value,)
        if kind in (np.float32, np.float64):
            hasher.numbers(np.array(values, kind))
        elif kind is str:
            hasher.text(*values)
        else:
            hasher.integers(*values)


def _add_image(hasher: _Hasher, image: Image) -> None:
    for values in (image.rgb, image.depth, image.segmentation, image.boxes):
        hasher.array(values)


def combine(kind: str, digests: Iterable[tuple[int, str]]) -> str:
    """One hash over (index, digest) pairs of a dataset, ordered by index.

    Args:
        kind: `board`, `trace` or `content`.
    """
    hasher = _Hasher(f"dataset {kind}")
    for index, digest in sorted(digests):
        hasher.integers(index)
        hasher.text(digest)
    return hasher.hexadecimal()
