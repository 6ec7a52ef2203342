"""Features of a dataset's objects: 256 numbers for every frame and object, computed once and kept beside the dataset.

The store of a dataset in `data/boards` is the folder `data/boards.features`:

embedded-0a1b2c3d/                   an encoder, with a digest of all that decides its numbers
    000012-89abcdef01234567.npy      episode 12 with the beginning of its content digest: float16 (T + 1, N, 256),
                                     then the whole digest and a checksum of the numbers

An episode that was recorded again has another digest, so features never belong to other pictures than they seem to.
Files are there whole or not at all; what is missing is computed when it is asked for. Nothing is written into the
dataset, which may be frozen; where nothing can be written beside it either, the store lies in the user's cache.

Training reads the store, which is mapped into memory. `write_table` makes one Parquet file of it for other programs.
"""

import hashlib
import os
import re
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from io import BytesIO
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from busybot.common.atomic_io import make_folder, remove, remove_leftovers, replacing, write_atomically
from busybot.common.errors import DAMAGED_ARRAY, BusybotError
from busybot.common.process_pool import Progress, default_workers, share
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import collect_command
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.objects.cache import cache_folder
from busybot.reason.encoders.registry import DEFAULT, make_extractor
from busybot.reason.inputs.observation import observe_episode
from busybot.reason.inputs.sequence import CHANNELS, BoardSequence, sequence_of

EPISODES_PER_WORKER = 20
"""A process more costs about as much time as so many episodes."""

_END = struct.Struct("<32sI")
"""What follows the array in a file: content digest of the episode, CRC-32 of the values."""
_NAME = re.compile(r"^(\d{6,9})-[0-9a-f]{16}\.npy$")


@dataclass(frozen=True)
class Features(Mapping[int, np.ndarray]):
    """Features by episode: float16 (T + 1, N, 256), memory-mapped; zeros for triggers and objects without a box.

    Attributes:
        encoder: its name.
        key: the name with a digest of all that decides the numbers.
        oracle: whether they hold what only the simulator knows.
        folder: where they lie.
        new: how many episodes were computed now.
    """

    encoder: str
    key: str
    oracle: bool
    folder: Path
    new: int
    _files: dict[int, Path]
    _digests: dict[int, str]
    _dataset: Dataset

    def __getitem__(self, episode: int) -> np.ndarray:
        values = _load(self._files[episode], self._digests[episode])
        if values is None:
            what = f"{self._files[episode]}: it was changed since it was written"
            raise BusybotError(what, "compute the features again (`busybot features`)")
        return values

    def __iter__(self) -> Iterator[int]:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)

    def sequence(self, episode: int) -> BoardSequence:
        """What models of relations see of the board; pictures are decoded when asked for, and kept as long as it is."""
        return sequence_of(observe_episode(self.episode(episode), again=True), self[episode])

    def episode(self, episode: int) -> Episode:
        """The recording, whose pictures are decoded when asked for."""
        return read_episode(self.file(episode), "lazy")

    def file(self, episode: int) -> Path:
        """Of the recording."""
        return self._dataset.episode_path(episode)


def features_of(
    dataset: Dataset,
    encoder: str = DEFAULT,
    *,
    weights: Path | None = None,
    store: Path | None = None,
    episodes: Iterable[int] | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Features:
    """The features of a dataset's finished episodes; those that are missing are computed and stored.

    Args:
        encoder: see `encoders.registry.make_extractor`.
        weights: of `resnet50`, see there.
        store: folder of the store; None for the one beside the dataset.
        episodes: only these.
        workers: processes; None for one per core, as far as there are episodes enough to pay for starting them.
        progress: episodes done and all that were missing.

    Raises:
        BusybotError: no episode is finished, one is damaged, or there is no such encoder.
    """
    chosen = make_extractor(encoder, weights)
    digests = _digests(dataset, episodes)
    # a store that was named may be a link, as any folder that the user names; the one beside the dataset may not
    place = store or store_of(dataset)
    root = place if store else place.parent
    folder = place / chosen.key
    make_folder(folder, root)
    remove_leftovers(folder, root)
    files = {index: folder / f"{index:06d}-{digest[:16]}.npy" for index, digest in digests.items()}
    missing = [index for index, file in files.items() if _load(file, digests[index]) is None]
    processes = workers or min(default_workers(), 1 + len(missing) // EPISODES_PER_WORKER)
    tasks = [(dataset.episode_path(index), files[index], digests[index]) for index in missing]
    for done, _ in enumerate(share(partial(_compute, encoder, weights, root), tasks, processes), start=1):
        if progress is not None:
            progress(done, len(missing))
    if store is None:  # a store that was named may hold those of other datasets, too
        _remove_outdated(folder, files, root)
    return Features(encoder, chosen.key, chosen.oracle, folder, len(missing), files, digests, dataset)


def store_of(dataset: Dataset) -> Path:
    """Where the features of a dataset lie by default: beside it, or in the cache where that cannot be written."""
    place = dataset.path.resolve()
    beside = place.with_name(f"{place.name}.features")
    if os.access(beside if beside.is_dir() else place.parent, os.W_OK):
        return beside
    return cache_folder() / "features" / f"{place.name}-{hashlib.sha256(str(place).encode()).hexdigest()[:8]}"


def _digests(dataset: Dataset, episodes: Iterable[int] | None) -> dict[int, str]:
    """Content digests of the wanted episodes."""
    rows = dataset.episodes_table().select(["episode", "content_digest"]).to_pydict()
    known = dict(zip(rows["episode"], rows["content_digest"], strict=True))
    wanted = sorted(known) if episodes is None else sorted(set(episodes))
    absent = [index for index in wanted if index not in known]
    if not known or absent:
        what = f"board {absent[0]} has no" if known else f"none of its {dataset.info.boards} boards has an"
        raise BusybotError(f"{dataset.path}: {what} episode", collect_command(dataset.path, dataset.info))
    return {index: known[index] for index in wanted}


def _compute(encoder: str, weights: Path | None, root: Path, task: tuple[Path, Path, str]) -> None:
    recorded, file, digest = task
    try:
        values = make_extractor(encoder, weights).of_episode(read_episode(recorded, "lazy"))
    except BusybotError as error:
        where = "" if str(recorded) in error.what else f"{recorded}: "
        raise BusybotError(f"{where}{error.what}", error.hint) from None
    data = BytesIO()
    np.save(data, values, allow_pickle=False)
    data.write(_END.pack(bytes.fromhex(digest), zlib.crc32(np.ascontiguousarray(values).data)))
    write_atomically(file, data.getvalue(), root)


def _load(file: Path, digest: str) -> np.ndarray | None:
    """A stored array, memory-mapped; None where there is none that can be used: what was changed has another checksum.

    Args:
        digest: of the episode's content, which the file must name.
    """
    if file.is_symlink() or not file.is_file():
        return None
    try:
        values = np.load(file, mmap_mode="r", allow_pickle=False)
    except DAMAGED_ARRAY:
        return None
    sound = isinstance(values, np.memmap) and values.dtype == np.float16 and values.shape[2:] == (CHANNELS,)
    if not sound or values.ndim != 3:
        return None
    with open(file, "rb") as stored:
        stored.seek(values.offset + values.nbytes)
        end = stored.read(_END.size + 1)
    if len(end) != _END.size:  # of an earlier version
        return None
    made_of, checksum = _END.unpack(end)
    right = made_of.hex() == digest and zlib.crc32(np.ascontiguousarray(values).data) == checksum
    return values if right else None


def _remove_outdated(folder: Path, files: dict[int, Path], root: Path) -> None:
    """Delete features of episodes that were recorded again since."""
    for file in folder.iterdir():
        match = _NAME.match(file.name)
        if match and files.get(int(match[1]), file) != file:
            remove(file, root)


SCHEMA = pa.schema(
    [
        ("episode", pa.int32()),
        ("frame", pa.int32()),
        ("object", pa.int16()),
        ("feature", pa.list_(pa.float16(), CHANNELS)),
    ]
)
"""One row for every frame and object that has features; one row group for every episode."""


def write_table(path: Path, features: Features) -> None:
    """Write the file, whole or not at all; its metadata name the encoder."""
    schema = SCHEMA.with_metadata({"encoder": features.encoder, "key": features.key, "oracle": str(features.oracle)})
    options = {"compression": "zstd", "use_byte_stream_split": ["feature.list.element"], "use_dictionary": False}
    with replacing(path) as file, pq.ParquetWriter(file, schema, **options) as writer:
        for episode, values in features.items():
            writer.write_table(_rows(episode, values, schema))


def _rows(episode: int, values: np.ndarray, schema: pa.Schema) -> pa.Table:
    frames, objects = np.nonzero(np.broadcast_to(np.any(values, axis=(0, 2)), values.shape[:2]))
    flat = pa.array(np.ascontiguousarray(values[frames, objects]).ravel(), pa.float16())
    columns = [
        pa.array(np.full(len(frames), episode), pa.int32()),
        pa.array(frames, pa.int32()),
        pa.array(objects, pa.int16()),
        pa.FixedSizeListArray.from_arrays(flat, CHANNELS),
    ]
    return pa.Table.from_arrays(columns, schema=schema)
