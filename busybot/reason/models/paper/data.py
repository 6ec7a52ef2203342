"""Boards as graphs for the paper's networks: one `HeteroData` per episode, and batches of them in one list of nodes.

Node input: 256 visual features and the 3-D position, zeros in place of a trigger's features; vacant nodes are zeros
(paper appendix A.1 "Training details"). An action belongs to the object acted on; the others' action is zeros.

Letters: M nodes and P edges of all B boards, T recorded steps, F frames.
"""

from collections.abc import Sequence as Several
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from busybot.reason.inputs.board_dataset import BoardDataset, batches_of, step_targets, touches
from busybot.reason.inputs.sequence import CHANNELS, BoardSequence
from busybot.reason.models.paper.config import PaperNetworkConfig
from busybot.reason.pyg import Batch, HeteroData

STATE = CHANNELS + 3
ACTION = 6


def board_graph(seen: BoardSequence, config: PaperNetworkConfig) -> HeteroData:
    """One board of N nodes, vacant ones last, watched for T steps.

    | nodes and edges | attribute | shape | meaning |
    |---|---|---|---|
    | `object` | `features` | float32 (N, T + 1, 256) | in every frame |
    | | `pos` | float32 (N, 3) | board units |
    | | `responder` | bool (N,) | |
    | `step` | `action` | float32 (T, 6) | position (board units) and direction |
    | `object`, `acts_on`, `object` | `edge_index` | int64 (2, P) | all pairs, or trigger to responder, by target |
    | `step`, `touches`, `object` | `edge_index` | int64 (2, A) | what an action was on; none for a miss |
    """
    size = len(seen.positions)
    if config.pairs == "all":
        size = max(config.objects, size)
    connected = ~np.eye(size, dtype=bool) if config.pairs == "all" else seen.candidates.T
    receivers, senders = np.nonzero(connected)
    graph = HeteroData()
    graph["object"].features = _padded(seen.features.swapaxes(0, 1), size)
    graph["object"].pos = _padded(seen.positions, size)
    graph["object"].responder = _padded(seen.responders, size)
    graph["step"].action = torch.from_numpy(seen.actions)
    graph["step"].num_nodes = seen.steps
    graph["object", "acts_on", "object"].edge_index = torch.from_numpy(np.stack([senders, receivers]).astype(np.int64))
    graph["step", "touches", "object"].edge_index = touches(seen.acted)
    return graph


def _padded(values: np.ndarray, size: int) -> Tensor:
    """With zeros (or False) for vacant nodes."""
    padded = np.zeros((size, *values.shape[1:]), values.dtype)
    padded[: len(values)] = values
    return torch.from_numpy(padded)


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
        edge_index: int64 (2, P), where an edge begins (for a relation the trigger) and where it ends (the responder).
        sizes: number of nodes of each board, vacant ones included.
    """

    features: Tensor
    positions: Tensor
    actions: Tensor
    actors: Tensor
    responders: Tensor
    edge_index: Tensor
    sizes: tuple[int, ...]

    @property
    def steps(self) -> int:
        """T."""
        return self.actions.shape[1]

    def observed(self, images: int) -> Frames:
        """The first frames, at most `images`, with the actions between them."""
        images = min(images, self.steps + 1)
        return self._frames(0, images).first(images)

    def predicted(self, images: int, steps: int | None = None) -> tuple[Frames, Tensor]:
        """The steps after the first `images` frames: their frames before, and features after, (M, S, 256).

        Args:
            steps: at most so many; None for all.
        """
        end = self.steps if steps is None else min(self.steps, images - 1 + steps)
        return self._frames(images - 1, end), self.features[:, images : end + 1]

    def _frames(self, start: int, end: int) -> Frames:
        states = states_of(self.features[:, start:end], self.positions)
        missing = max(0, end - self.steps)
        actions = functional.pad(self.actions[:, start:end], (0, 0, 0, missing))
        return Frames(states, actions, functional.pad(self.actors[:, start:end], (0, missing), value=-1))

    def to(self, device: torch.device | str, dtype: torch.dtype = torch.float32) -> "Boards":
        """The same boards on a device, with numbers of a type."""
        tensors = {name: value for name, value in vars(self).items() if isinstance(value, Tensor)}
        types = {name: dtype if value.is_floating_point() else value.dtype for name, value in tensors.items()}
        return Boards(**{name: value.to(device, types[name]) for name, value in tensors.items()}, sizes=self.sizes)


def states_of(features: Tensor, positions: Tensor) -> Tensor:
    """Node inputs: features (M, F, 256) and positions (M, 3) as (M, F, 259)."""
    return torch.cat([features, positions[:, None].expand(-1, features.shape[1], -1)], -1)


def read_batch(batch: Batch) -> Boards:
    """A batch of graphs as the networks read it."""
    objects, steps = batch["object"], batch["step"].num_nodes // batch.num_graphs
    return Boards(
        features=objects.features,
        positions=objects.pos,
        actions=batch["step"].action.view(batch.num_graphs, steps, ACTION),
        actors=step_targets(batch, "object"),
        responders=objects.responder,
        edge_index=batch["object", "acts_on", "object"].edge_index,
        sizes=tuple(objects.ptr.diff().tolist()),
    )


def boards_of(sequences: Several[BoardSequence], config: PaperNetworkConfig) -> Boards:
    """Join boards; see `BoardDataset` for the errors."""
    dataset = BoardDataset(sequences, partial(board_graph, config=config))
    return read_batch(next(batches_of(dataset, [range(len(sequences))])))
