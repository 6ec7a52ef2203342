"""What an episode is, as three hashes over decoded values in a fixed order.

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
from dataclasses import dataclass

import numpy as np

from busybot.episodes.episode import Episode, Image, Step


@dataclass(frozen=True)
class Digests:
    """SHA-256, hexadecimal, of one episode or (`combine`) of a dataset."""

    board: str
    trace: str
    content: str


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
        self._hash.update(little.data.cast("B"))

    def hexadecimal(self) -> str:
        return self._hash.hexdigest()


def episode_digests(episode: Episode) -> Digests:
    """Digests of an episode that was read from its file."""
    return Digests(episode.board.digest(), trace_digest(episode), content_digest(episode))


def trace_digest(episode: Episode) -> str:
    """Actions (pixel, position, directions, distance) and discrete states."""
    hasher = _Hasher("trace")
    hasher.integers(len(episode.steps))
    for step in episode.steps:
        _add_trace(hasher, step)
    return hasher.hexadecimal()


def content_digest(episode: Episode) -> str:
    """Trace, rewards, joints, camera, links, positions, every stored image and the goal image, if there is one."""
    hasher = _Hasher("content")
    hasher.text(trace_digest(episode))
    hasher.integers(episode.camera.width, episode.camera.height)
    for values in (episode.camera.matrix, episode.camera.pose, episode.positions):
        hasher.numbers(values)
    for link in episode.links:
        hasher.integers(link.object, link.trigger)
        hasher.text(link.name)
    for step in episode.steps:
        hasher.integers(step.changed_pixels, step.reward)
        hasher.numbers(step.joint_positions_before)
        hasher.numbers(step.joint_positions_after)
    hasher.integers(*episode.frame_of)
    for image in episode.images:
        _add_image(hasher, image)
    for image in episode.goals:
        hasher.text("goal")  # nothing of it where there is none: older recordings keep their hash
        _add_image(hasher, image)
    return hasher.hexadecimal()


def _add_trace(hasher: _Hasher, step: Step) -> None:
    hasher.integers(*step.pixel, step.direction)
    hasher.integers(*step.executed)
    hasher.numbers(np.array([*step.position, step.distance], np.float32))
    hasher.integers(step.acted_object, step.success, step.vetoed)
    hasher.text(step.acted_link)
    for states in (
        step.trigger_states_before,
        step.trigger_states_after,
        step.responder_states_before,
        step.responder_states_after,
    ):
        hasher.integers(*states)


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
