"""Boards as the graph networks read them: all nodes of a batch in one list, and the pairs of nodes that are connected.

Node input: 256 visual features and the 3-D position, zeros in place of a trigger's features; vacant nodes are zeros
(paper appendix A.1 "Training details"). An action belongs to the object acted on; the others' action is zeros.
"""

from collections.abc import Sequence as Several
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from busybot.errors import BusybotError
from busybot.reason.paper_config import PaperNetworkConfig
from busybot.reason.paper_pairs import Pairs
from busybot.reason.sequence import CHANNELS, Sequence

STATE = CHANNELS + 3
ACTION = 6


@dataclass(frozen=True)
class Frames:
    """F frames of all boards, each with the action that follows it.

    Attributes:
        states: (M, F, 259), of all M nodes.
        actions: (B, F, 6), on B boards.
        actors: int64 (B, F), the node acted on; -1 for no action on any node.
    """

    states: Tensor
    actions: Tensor
    actors: Tensor

    def first(self, frames: int) -> "Frames":
        """The first frames, without the action after the last of them."""
        actors = self.actors[:, :frames].clone()
        actors[:, -1] = -1
        return Frames(self.states[:, :frames], self.actions[:, :frames], actors)


@dataclass(frozen=True)
class Boards:
    """B boards watched for T steps: M nodes and P ordered pairs of them in all.

    Attributes:
        features: (M, T + 1, 256).
        positions: (M, 3).
        actions: (B, T, 6).
        actors: int64 (B, T), as in `Frames`.
        responders: bool (M,).
        receivers: int64 (P,), where an edge ends: for a relation the responder.
        senders: int64 (P,), where it begins: for a relation the trigger.
        sizes: number of nodes of each board, vacant ones included.
    """

    features: Tensor
    positions: Tensor
    actions: Tensor
    actors: Tensor
    responders: Tensor
    receivers: Tensor
    senders: Tensor
    sizes: tuple[int, ...]

    @property
    def steps(self) -> int:
        """T."""
        return self.actions.shape[1]

    @property
    def pairs(self) -> Pairs:
        """The connected nodes."""
        return Pairs(self.receivers, self.senders, len(self.positions))

    def observed(self, images: int) -> Frames:
        """The first frames, at most `images`, with the actions between them."""
        images = min(images, self.steps + 1)
        return self._frames(0, images).first(images)

    def predicted(self, images: int) -> tuple[Frames, Tensor]:
        """The steps after the first `images` frames: their frames before, and features after, (M, S, 256)."""
        return self._frames(images - 1, self.steps), self.features[:, images:]

    def _frames(self, start: int, end: int) -> Frames:
        states = states_of(self.features[:, start:end], self.positions)
        missing = max(0, end - self.steps)
        actions = functional.pad(self.actions[:, start:end], (0, 0, 0, missing))
        return Frames(states, actions, functional.pad(self.actors[:, start:end], (0, missing), value=-1))

    def to(self, device: torch.device | str, dtype: torch.dtype = torch.float32) -> "Boards":
        """The same boards on a device, with numbers of a type."""
        tensors = {name: value for name, value in vars(self).items() if isinstance(value, Tensor)}
        floats = {name: value.to(device, dtype) for name, value in tensors.items() if value.is_floating_point()}
        others = {name: value.to(device) for name, value in tensors.items() if not value.is_floating_point()}
        return Boards(**floats, **others, sizes=self.sizes)


def states_of(features: Tensor, positions: Tensor) -> Tensor:
    """Node inputs: features (M, F, 256) and positions (M, 3) as (M, F, 259)."""
    return torch.cat([features, positions[:, None].expand(-1, features.shape[1], -1)], -1)


def boards_of(sequences: Several[Sequence], config: PaperNetworkConfig) -> Boards:
    """Join boards.

    Raises:
        BusybotError: boards were watched for different numbers of steps.
    """
    lengths = sorted({seen.steps for seen in sequences})
    if len(lengths) != 1:
        what = f"boards with {', '.join(map(str, lengths))} steps in one batch"
        raise BusybotError(what, "train on datasets whose episodes have equally many steps")
    sizes = [len(seen.positions) for seen in sequences]
    if config.pairs == "all":
        sizes = [max(config.objects, size) for size in sizes]
    offsets = np.cumsum([0, *sizes[:-1]])
    padded = list(zip(sequences, sizes, strict=True))
    connected = [_pairs(seen, size, config) + offset for (seen, size), offset in zip(padded, offsets, strict=True)]
    receivers, senders = np.concatenate(connected, axis=1)
    actors = [np.where(seen.acted >= 0, seen.acted + at, -1) for seen, at in zip(sequences, offsets, strict=True)]
    return Boards(
        features=_joined([_padded(seen.features.swapaxes(0, 1), size) for seen, size in padded]),
        positions=_joined([_padded(seen.positions, size) for seen, size in padded]),
        actions=torch.from_numpy(np.stack([seen.actions for seen in sequences])),
        actors=torch.from_numpy(np.stack(actors)),
        responders=_joined([_padded(seen.responders, size) for seen, size in padded]),
        receivers=torch.from_numpy(receivers),
        senders=torch.from_numpy(senders),
        sizes=tuple(sizes),
    )


def _pairs(seen: Sequence, size: int, config: PaperNetworkConfig) -> np.ndarray:
    """Receivers and senders, int64 (2, P): all nodes but with themselves, or responders with triggers."""
    connected = ~np.eye(size, dtype=bool) if config.pairs == "all" else seen.candidates.T
    return np.stack(np.nonzero(connected)).astype(np.int64)


def _padded(values: np.ndarray, size: int) -> np.ndarray:
    """Zeros (or False) for vacant nodes, which come last."""
    return np.concatenate([values, np.zeros((size - len(values), *values.shape[1:]), values.dtype)])


def _joined(values: list[np.ndarray]) -> Tensor:
    return torch.from_numpy(np.concatenate(values))
