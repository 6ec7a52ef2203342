"""From recorded steps to training samples, by whitelist.

A sample is one proposed action: what the camera saw around its pixel before it, the directions that were executed, the
reward. Nothing else of an episode is read here: not segmentation or boxes, what the gripper held, states, relations.

The pictures of thousands of steps do not fit into memory and take too long to decode again and again. So each dataset
has a cache: a square around each sample's pixel, uncompressed, in one file that is memory-mapped, and an index that is
written last. The `paper` variant sees whole pictures: its caches hold each one once, however many actions left it as it
was. Caches are derived from the episodes alone and can be deleted.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import torch
from torch import Tensor

from busybot.boards.directions import DIRECTIONS
from busybot.common.atomic_io import make_folder, remove_leftovers, replacing
from busybot.common.errors import DAMAGED_ARRAY, BusybotError
from busybot.datasets.dataset import Dataset
from busybot.episodes.codec import LazyImages, decode_plain, decode_rgb
from busybot.episodes.episode import Camera, Episode, Step
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.schema import UNKNOWN_PIXEL
from busybot.interact.affordance.inputs import square_around
from busybot.interact.policy.config import Inputs

SIDE = 160
"""Side of the cached squares, pixels. The sample's pixel is pixel (SIDE / 2, SIDE / 2)."""
CACHE_VERSION = "1"
INDEX, SQUARES = "index.npz", "squares.bin"
COLUMNS = ("pixels", "executed", "worked", "scale")
ONE_CAMERA = "record all episodes of a dataset with the same --set render.* parameters"
ROW = "row"
"""A further column: which square or picture a sample saw. Former caches of squares, one per sample, lack it."""


@dataclass(frozen=True)
class Samples:
    """N recorded steps in the order of datasets, episodes, steps.

    Attributes:
        camera: of all of them.
        inputs: what the squares show.
        first: number of the first sample among all that were ever recorded; older ones have left the window.
        squares: one array per dataset, memory-mapped: uint16 (n, SIDE, SIDE) depth as stored, or uint8
            (n, SIDE, SIDE, 3) colours; or whole pictures (n, H, W[, 3]).
        dataset, row: int (N,), where sample i lies: `squares[dataset[i]][row[i]]`.
        scale: float32 (N, 2), offset and step of the stored depths, board units; stored 0 means nothing was hit.
        pixels: int (N, 2), the (u, v) acted on.
        executed: bool (N, 18), directions that were tried.
        worked: int (N,), the direction that was rewarded, -1 for none.
    """

    camera: Camera
    inputs: Inputs
    first: int
    squares: tuple[np.ndarray, ...]
    dataset: np.ndarray
    row: np.ndarray
    scale: np.ndarray
    pixels: np.ndarray
    executed: np.ndarray
    worked: np.ndarray

    def __len__(self) -> int:
        return len(self.row)

    @property
    def reward(self) -> np.ndarray:
        """The position label, bool (N,)."""
        return self.worked >= 0

    def picture(self, number: int) -> np.ndarray:
        """The square or whole picture of a sample, as stored."""
        return self.squares[self.dataset[number]][self.row[number]]

    def depths(self, chosen: np.ndarray, stored: np.ndarray, on: torch.device | str = "cpu") -> Tensor:
        """Stored depths (B, h, w) of the chosen samples in board units, float32; 0 where nothing was hit.

        Args:
            on: where they are computed, to which half as many bytes travel as would of the result.
        """
        codes = torch.from_numpy(stored.view(np.int16)).to(on).int() & 0xFFFF  # PyTorch hardly computes with uint16
        offset, step = torch.from_numpy(self.scale[chosen]).to(on).T[:, :, None, None]
        return torch.where(codes > 0, offset + codes * step, 0.0)

    def direction_labels(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which directions worked and of which that is known, both bool (B, 18), for the chosen samples.

        Every executed direction is known to work (the last one of a rewarded action) or not (all others), at
        positions where something worked; elsewhere the position is at fault, not the direction.
        """
        known = self.executed[chosen] & self.reward[chosen, None]
        return known & (np.arange(len(DIRECTIONS)) == self.worked[chosen, None]), known


def cache_samples(dataset: Dataset, folder: Path, inputs: Inputs, whole: bool = False) -> Path:
    """Make the cache of a dataset's finished episodes inside `folder`, if it is not there; returns its place.

    Args:
        whole: pictures instead of squares.
    """
    content = dataset.hashes().content
    place = folder / f"{content[:16]}-{inputs}-{'whole-' if whole else ''}{CACHE_VERSION}"
    if (place / INDEX).exists():
        return place
    make_folder(place, folder.parent)
    remove_leftovers(place, folder.parent)
    columns: dict[str, list[np.ndarray]] = defaultdict(list)
    camera: Camera | None = None
    with replacing(place / SQUARES, folder.parent) as file:
        for index in sorted(dataset.finished()):
            episode = read_episode(dataset.episode_path(index), "lazy")
            camera = _same_camera(camera, episode.camera, dataset.episode_path(index))
            if any(step.pixel == UNKNOWN_PIXEL for step in episode.steps):
                what = f"{dataset.episode_path(index)}: nobody says at which pixel it acted"
                raise BusybotError(what, "train on what `busybot collect` records")
            for name, values in _labels(episode).items():
                columns[name].append(values)
            columns[ROW].append(_write(file, episode, inputs, whole))
    if camera is None:
        raise BusybotError(f"{dataset.path}: no episode has been recorded", "`busybot collect` records them")
    size = np.array([camera.width, camera.height])
    arrays: dict[str, Any] = {"size": size, "matrix": camera.matrix, "pose": camera.pose}
    arrays |= {name: np.concatenate(parts) for name, parts in columns.items()}
    with replacing(place / INDEX, folder.parent) as index_file:
        np.savez(index_file, **arrays)
    return place


def _same_camera(known: Camera | None, camera: Camera, where: Path) -> Camera:
    if known is None:
        return camera
    if not all(np.array_equal(getattr(known, name), getattr(camera, name)) for name in known.__dataclass_fields__):
        raise BusybotError(f"{where}: recorded with another camera than the episodes before it", ONE_CAMERA)
    return camera


def _write(file: BinaryIO, episode: Episode, inputs: Inputs, whole: bool) -> np.ndarray:
    """Append a square for each step, or each picture that was acted on; returns which of the file's is each step's."""
    rows: list[int] = []
    for picture, steps in _seen(episode, inputs):
        size = picture.shape[:2]
        shown = [picture] if whole else [picture[square_around(step.pixel, SIDE, *size)] for step in steps]
        first = file.tell() // shown[0].nbytes
        rows += [first] * len(steps) if whole else range(first, first + len(steps))
        for one in shown:
            file.write(one.tobytes())
    return np.array(rows, np.int32)


def _seen(episode: Episode, inputs: Inputs) -> Iterator[tuple[np.ndarray, list[Step]]]:
    """Every picture that was acted on, and the steps before which it was seen."""
    images = episode.images
    assert isinstance(images, LazyImages)
    for number, seen in groupby(zip(episode.frame_of, episode.steps, strict=False), itemgetter(0)):
        yield _decode(images, number, inputs), [step for _, step in seen]


def _labels(episode: Episode) -> dict[str, np.ndarray]:
    """What was done in each step and what came of it, by `COLUMNS`."""
    images, steps = episode.images, episode.steps
    assert isinstance(images, LazyImages)
    # an imported action may tell nothing but what was proposed
    tried = [step.executed or (step.direction,) for step in steps]
    executed = np.zeros((len(steps), len(DIRECTIONS)), bool)
    for row, directions in enumerate(tried):
        executed[row, list(directions)] = True
    worked = [directions[-1] if step.reward else -1 for step, directions in zip(steps, tried, strict=True)]
    scale = np.array([images.depth_scale.offset, images.depth_scale.scale], np.float32)
    return {
        "pixels": np.array([step.pixel for step in steps], np.int32).reshape(-1, 2),
        "executed": executed,
        "worked": np.array(worked, np.int8),
        "scale": np.tile(scale, (len(steps), 1)),
    }


def _decode(images: LazyImages, number: int, inputs: Inputs) -> np.ndarray:
    """Depth as stored, uint16 (H, W), or colours, uint8 (H, W, 3)."""
    encoded = images.encoded[number]
    if inputs == "rgb":
        return decode_rgb(encoded.rgb, images.width, images.height)
    if encoded.depth is None:
        raise BusybotError(f"{images.where}: it has no depth images", "train with --set inputs=rgb")
    return decode_plain(encoded.depth, images.width, images.height).astype(np.uint16)


def open_samples(caches: Sequence[Path], inputs: Inputs, window: int, whole: bool = False) -> Samples:
    """The last `window` samples of several caches, the oldest first.

    Args:
        whole: the caches hold whole pictures.

    Raises:
        BusybotError: the datasets were recorded with different cameras, nothing was done in one, or a cache is damaged.
    """
    camera: Camera | None = None
    squares, parts, rows = [], [], []
    for place in caches:
        try:
            with np.load(place / INDEX, allow_pickle=False) as index:
                width, height = (int(side) for side in index["size"])
                camera = _same_camera(camera, Camera(width, height, index["matrix"], index["pose"]), place)
                parts.append({name: index[name] for name in COLUMNS})
                rows.append(index[ROW] if ROW in index else np.arange(len(index["worked"])))
        except DAMAGED_ARRAY as error:
            raise BusybotError(f"{place / INDEX}: damaged: {error}", f"remove {place}, it is made again") from None
        if not len(rows[-1]):
            raise BusybotError(f"{place}: its dataset has no recorded action to learn from", "busybot collect DATASET")
        count, sides = int(rows[-1].max(initial=-1)) + 1, (height, width) if whole else (SIDE, SIDE)
        squares.append(_map_pixels(place / SQUARES, inputs, (count, *sides)))
    assert camera is not None
    sizes = [len(part["worked"]) for part in parts]
    return Samples(
        camera=camera,
        inputs=inputs,
        first=max(0, sum(sizes) - window),
        squares=tuple(squares),
        dataset=np.repeat(np.arange(len(sizes)), sizes)[-window:],
        row=np.concatenate(rows)[-window:],
        **{name: np.concatenate([part[name] for part in parts])[-window:] for name in COLUMNS},
    )


def _map_pixels(file: Path, inputs: Inputs, shape: tuple[int, int, int]) -> np.ndarray:
    kind = np.uint16 if inputs == "depth" else np.uint8
    try:
        return np.memmap(file, kind, "r", shape=shape if inputs == "depth" else (*shape, 3))
    except (OSError, ValueError) as error:
        raise BusybotError(f"{file}: damaged: {error}", f"remove {file.parent}, it is made again") from None
