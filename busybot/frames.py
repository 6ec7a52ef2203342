"""Recorded steps as a PyTorch dataset with random access: pictures, actions, rewards.

Only the pictures that are asked for are decoded. Nothing privileged is here: what learners may read, and no more.
"""

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Literal, get_args
from weakref import finalize

import numpy as np
import torch
from torch.utils.data import Dataset, Sampler, default_collate, get_worker_info

from busybot.common.errors import BusybotError
from busybot.common.remote import is_remote
from busybot.common.rng import generator
from busybot.datasets.dataset import REQUESTS_AT_ONCE
from busybot.datasets.dataset import Dataset as Recordings
from busybot.episodes.codec import decode_plain
from busybot.episodes.mcap.channels import DEPTH, RGB
from busybot.episodes.mcap.pictures import PictureFile
from busybot.episodes.tables import HINT_TABLES

Picture = Literal["rgb", "depth", "next_rgb", "next_depth"]
_COLUMNS = {
    "position": [f"position_{axis}" for axis in "xyz"],
    "direction": ["direction"],
    "reward": ["reward"],
    "images": ["image_before", "image_after"],
    "episode": ["episode"],
    "step": ["step"],
}
_FILE = ["episode", "width", "height", "checksum", "depth"]


class Frames(Dataset[dict[str, torch.Tensor]]):
    """Every recorded step of a dataset, in the order of its episodes. A `DataLoader` makes batches of them.

    | key | type | meaning |
    |---|---|---|
    | `rgb`, `next_rgb` | uint8 (H, W, 3) | before the step and after it |
    | `depth`, `next_depth` | float32 (H, W) | board units, 0 where nothing was hit |
    | `position` | float32 (3,) | where the gripper acted, board frame, board units |
    | `direction` | int64 () | index of the proposed direction among the 18 |
    | `reward` | int64 () | 1 if the picture changed, or where joint states reward, if one did |
    | `episode`, `step` | int64 () | which step it is; with them `Dataset.to_pandas` tells more |

    Encoded pictures that were read last are kept in memory (`episodes.mcap.pictures.KEPT_BYTES` in each process). Of a
    dataset that is larger, batches come faster in an order that stays with some episodes for a while: `shuffled`. With
    workers, `DataLoader(collate_fn=frames.collate)` hands batches over at half the cost.

    Args:
        pictures: keys of those that are wanted; the others are neither read nor decoded.

    Raises:
        BusybotError: there is no picture of that name, an episode has no depth that is asked for, or the tables are
            missing or not those of the episodes.
    """

    def __init__(self, dataset: Recordings, *pictures: Picture):
        unknown = [name for name in pictures if name not in get_args(Picture)]
        if unknown:
            raise BusybotError(f"there are no pictures {unknown[0]!r}", f"choose among {', '.join(get_args(Picture))}")
        self.pictures = pictures
        rows = dataset.table("steps", [column for columns in _COLUMNS.values() for column in columns])
        self._values = {
            key: np.stack([rows[name].to_numpy() for name in names], axis=-1) for key, names in _COLUMNS.items()
        }
        files = dataset.table("episodes", _FILE).to_pylist()
        if strangers := set(self._values["episode"][:, 0].tolist()) - {row["episode"] for row in files}:
            what = f"{dataset.path}: table steps has episode {min(strangers)}, table episodes has not"
            raise BusybotError(what, HINT_TABLES)
        flat = [row["episode"] for row in files if not row["depth"]]
        if flat and not {"depth", "next_depth"}.isdisjoint(pictures):
            raise BusybotError(
                f"{dataset.episode_path(flat[0])}: recorded without depth", "ask for `rgb` or `next_rgb`"
            )
        self._remote, self._blocks = is_remote(dataset.path), SharedBlocks()
        self._size = {row["episode"]: (row["width"], row["height"]) for row in files}
        self._files = {
            row["episode"]: PictureFile(dataset.episode_path(row["episode"]), row["checksum"]) for row in files
        }

    def __len__(self) -> int:
        return len(self._values["step"])

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        row = range(len(self))[index]
        value = {name: values[row] for name, values in self._values.items()}
        episode = int(value["episode"][0])
        before, after = (int(number) for number in value["images"])
        item: dict[str, torch.Tensor] = {
            name: self._decoded(episode, after if name.startswith("next_") else before, name.removeprefix("next_"))
            for name in self.pictures
        }
        item["position"] = torch.from_numpy(value["position"].astype(np.float32))
        return item | {name: torch.tensor(int(value[name][0])) for name in ("direction", "reward", "episode", "step")}

    def __getitems__(self, indices: Sequence[int]) -> list[dict[str, torch.Tensor]]:
        """What a `DataLoader` asks for to make a batch; recordings at an address are fetched several at a time."""
        if not self._remote:
            return [self[index] for index in indices]
        first = {int(self._values["episode"][index, 0]): index for index in reversed(indices)}.values()
        with ThreadPoolExecutor(REQUESTS_AT_ONCE) as threads:
            ready = dict(zip(first, threads.map(self.__getitem__, first), strict=True))
        return [ready[index] if index in ready else self[index] for index in indices]

    def collate(self, items: list[dict[str, torch.Tensor]]) -> dict[str, Any]:
        """A batch, for `DataLoader(collate_fn=...)`: with workers twice as fast as usual, see `SharedBlocks`."""
        if get_worker_info() is None:
            return default_collate(items)
        small = [{name: value for name, value in item.items() if name not in self.pictures} for item in items]
        return default_collate(small) | {
            name: self._blocks.stacked([item[name] for item in items]) for name in self.pictures
        }

    def shuffled(self, seed: int, together: int = 64) -> "Shuffled":
        """A sampler for `DataLoader(sampler=...)`: all steps once, those of `together` episodes at a time mixed."""
        return Shuffled(self._values["episode"][:, 0], seed, together)

    def _decoded(self, episode: int, image: int, part: str) -> torch.Tensor:
        file, size = self._files[episode], self._size[episode]
        encoded = file.holding(RGB if part == "rgb" else DEPTH, image)
        try:
            if part == "rgb":
                return torch.from_numpy(encoded.rgb(image, *size))
            return torch.from_numpy(encoded.scale.restore(decode_plain(encoded.pictures[image], *size)))
        except ValueError as error:
            raise BusybotError(f"{file.path}: image {image}: {error}", "record the episode again") from None


class SharedBlocks:
    """Shared memory in which a worker hands over batches, used again when the receiver needs a batch no more.

    New shared memory for each batch, as PyTorch takes it, costs more than decoding its pictures: the system clears
    every page of it. The last byte of a block says whether it is lent.
    """

    def __init__(self) -> None:
        self._blocks: list[torch.Tensor] = []

    def stacked(self, values: list[torch.Tensor]) -> "Lent":
        """Tensors of one shape in a block of their own, until the receiver has let go of it."""
        shape, size = (len(values), *values[0].shape), sum(value.nbytes for value in values)
        block = next((one for one in self._blocks if len(one) > size and not one[-1]), None)
        if block is None:
            block = torch.zeros(size + 1, dtype=torch.uint8).share_memory_()
            self._blocks.append(block)
        block[-1] = 1
        lent = Lent(block, values[0].dtype, shape)
        torch.stack(values, out=_within(block[:size], lent.dtype, shape))
        return lent


@dataclass(frozen=True)
class Lent:
    """A block on its way out of a worker: it arrives as a tensor."""

    block: torch.Tensor
    dtype: torch.dtype
    shape: tuple[int, ...]

    def __reduce__(self) -> tuple[Any, ...]:
        return _received, (self.block, self.dtype, self.shape)


def _received(block: torch.Tensor, dtype: torch.dtype, shape: tuple[int, ...]) -> torch.Tensor:
    """The tensor; when it and all views of it are gone, the block is free again."""
    shared = block.numpy()
    own = shared[: math.prod(shape) * dtype.itemsize]  # which the tensor keeps
    finalize(own, shared.__setitem__, -1, 0).atexit = False
    return _within(torch.from_numpy(own), dtype, shape)


def _within(block: torch.Tensor, dtype: torch.dtype, shape: tuple[int, ...]) -> torch.Tensor:
    return block.view(dtype).view(shape)


class Shuffled(Sampler[int]):
    """Every index once, another order in each epoch; steps of few episodes lie near each other.

    Args:
        episodes: of each index, int (N,).
        seed: of the order.
        together: steps of so many episodes are mixed with each other.
    """

    def __init__(self, episodes: np.ndarray, seed: int, together: int):
        self._episodes, self._seed, self._together, self._epoch = episodes, seed, together, 0

    def __len__(self) -> int:
        return len(self._episodes)

    def __iter__(self) -> Iterator[int]:
        rng = generator(self._seed, "frames", self._epoch, "shuffled")
        self._epoch += 1
        known = rng.permutation(np.unique(self._episodes))
        for start in range(0, len(known), self._together):
            own = np.flatnonzero(np.isin(self._episodes, known[start : start + self._together]))
            yield from rng.permutation(own).tolist()
