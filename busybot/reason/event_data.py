"""Boards as graphs for the `event` model: torch-geometric `Data`, one per episode, any number of objects.

The model compares looks and never reads them: of the features it keeps how far the looks of one responder lie apart.
So it knows nothing of any encoder's axes, cannot memorise objects, and costs the same whatever the features' size.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch_geometric.data import Batch, Data

from busybot.reason.sequence import Sequence


def board_data(sequence: Sequence) -> Data:
    """One episode.

    Attributes of the result (N objects, of which R responders; E candidate pairs; T steps):
        pos: float32 (N, 3), board units.
        edge_index: int64 (2, E), trigger -> responder.
        responder_index: int64 (R,), objects.
        distances: float32 (R, T + 1, T + 1) between the features of a responder in any two frames.
        actions: float32 (1, T, 6).
        acted_index: int64 (T,), object acted on; 0 for a miss, which `missed`, bool (T,), tells.
        length: int64 (1,), T.
    """
    responders = np.flatnonzero(sequence.responders)
    looks = torch.from_numpy(np.ascontiguousarray(sequence.features[:, responders].swapaxes(0, 1), np.float32))
    return Data(
        pos=torch.from_numpy(np.asarray(sequence.positions, np.float32)),
        edge_index=torch.from_numpy(np.stack(np.nonzero(sequence.candidates)).astype(np.int64)),
        responder_index=torch.from_numpy(responders.astype(np.int64)),
        distances=apart(looks, looks),
        actions=torch.from_numpy(np.asarray(sequence.actions, np.float32))[None],
        acted_index=torch.from_numpy(np.maximum(sequence.acted, 0).astype(np.int64)),
        missed=torch.from_numpy(np.asarray(sequence.acted < 0)),
        length=torch.tensor([sequence.steps]),
    )


def apart(looks: Tensor, others: Tensor) -> Tensor:
    """Euclidean distances (R, A, C) between looks (R, A, 256) and others (R, C, 256); 0 between equal ones."""
    return torch.cdist(looks, others, compute_mode="donot_use_mm_for_euclid_dist")


def padded(boards: Iterable[Data]) -> list[Data]:
    """The same boards with as many steps as the longest; `length` tells what is real."""
    boards = list(boards)
    longest = max((board.actions.shape[1] for board in boards), default=0)
    return [_pad(board, longest - board.actions.shape[1]) for board in boards]


def _pad(board: Data, missing: int) -> Data:
    if not missing:
        return board
    longer = board.clone()
    longer.distances = torch.nn.functional.pad(board.distances, (0, missing, 0, missing))
    longer.actions = torch.nn.functional.pad(board.actions, (0, 0, 0, missing))
    longer.acted_index = torch.nn.functional.pad(board.acted_index, (0, missing))
    longer.missed = torch.nn.functional.pad(board.missed, (0, missing), value=True)
    return longer


@dataclass(frozen=True)
class Seen:
    """What is known of B boards after L steps: R responders and E candidate pairs on all of them together.

    Attributes:
        distances: (R, L + 1, L + 1), in units of the smallest change.
        actions: (B, L, 6).
        acted: int (B, L), object acted on, -1 for none.
        known: bool (B, L), False for steps that only fill up.
        board: int (R,), each responder's board.
        pairs: int (2, E), trigger (object) and responder (row of the R).
        pos: (N, 3).
    """

    distances: Tensor
    actions: Tensor
    acted: Tensor
    known: Tensor
    board: Tensor
    pairs: Tensor
    pos: Tensor

    @property
    def sizes(self) -> Tensor:
        """How far each responder's look moved in each step, (R, L)."""
        moved = self.distances.diagonal(offset=1, dim1=1, dim2=2)
        return torch.where(self.known[self.board], moved, 0.0)

    def first(self, steps: int) -> "Seen":
        """What was known after so many steps."""
        return Seen(
            self.distances[:, : steps + 1, : steps + 1],
            self.actions[:, :steps],
            self.acted[:, :steps],
            self.known[:, :steps],
            self.board,
            self.pairs,
            self.pos,
        )


@dataclass(frozen=True)
class Asked:
    """Q steps on each board whose outcome is wanted.

    Attributes:
        current: (R, Q, L + 1), how far the look before the step lies from every look seen before.
        actions: (B, Q, 6).
        acted: int (B, Q), -1 for none.
    """

    current: Tensor
    actions: Tensor
    acted: Tensor


@dataclass(frozen=True)
class Outcome:
    """What really followed.

    Attributes:
        look: (R, Q, L + 1), how far the look after the step lies from every look seen before the Q steps.
        moved: (R, Q), and from the look before the step.
        real: bool (B, Q), False for steps that only fill up.
    """

    look: Tensor
    moved: Tensor
    real: Tensor


def seen_of(batch: Batch, scale: Tensor | float) -> Seen:
    """All steps of a batch of boards; distances are divided by the scale."""
    boards, steps = batch.actions.shape[:2]
    acted = torch.where(batch.missed, -1, batch.acted_index).view(boards, steps)
    known = torch.arange(steps, device=acted.device) < batch.length[:, None]
    row = torch.full((batch.pos.shape[0],), -1, device=acted.device)
    row[batch.responder_index] = torch.arange(len(batch.responder_index), device=acted.device)
    return Seen(
        distances=batch.distances / scale,
        actions=batch.actions,
        acted=torch.where(known, acted, -1),
        known=known,
        board=batch.batch[batch.responder_index],
        pairs=torch.stack([batch.edge_index[0], row[batch.edge_index[1]]]),
        pos=batch.pos,
    )


def split(seen: Seen, steps: int, most: int) -> tuple[Seen, Asked, Outcome]:
    """The first steps as what is known, at most so many of the following ones as questions with their answers."""
    until = min(steps + most, seen.actions.shape[1])
    before, after = slice(steps, until), slice(steps + 1, until + 1)
    asked = Asked(seen.distances[:, before, : steps + 1], seen.actions[:, before], seen.acted[:, before])
    moved = seen.distances.diagonal(offset=1, dim1=1, dim2=2)[:, before]
    return seen.first(steps), asked, Outcome(seen.distances[:, after, : steps + 1], moved, seen.known[:, before])
