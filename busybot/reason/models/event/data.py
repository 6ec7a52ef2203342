"""Boards as graphs for the `event` model: one `HeteroData` per episode, any number of objects.

The model compares looks and never reads them: of the features it keeps how far the looks of one responder lie apart.
So it knows nothing of any encoder's axes, cannot memorise objects, and costs the same whatever the features' size.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import pad
from torch_geometric.data import Batch, HeteroData

from busybot.reason.inputs.board_dataset import step_targets, touches
from busybot.reason.inputs.sequence import BoardSequence


def board_graph(sequence: BoardSequence) -> HeteroData:
    """One episode.

    | nodes and edges | attribute | shape | meaning |
    |---|---|---|---|
    | `trigger` | `pos` | float32 (K, 3) | board units |
    | `responder` | `distances` | float32 (R, T + 1, T + 1) | between its features in any two frames |
    | `step` | `action` | float32 (T, 6) | position (board units) and direction |
    | | `known` | bool (T,) | False for steps that only fill up (`padded`) |
    | `trigger`, `controls`, `responder` | `edge_index` | int64 (2, E) | every pair, in the order of `candidates` |
    | `step`, `touches`, `trigger` | `edge_index` | int64 (2, A) | what an action was on; none for a miss |
    """
    triggers, responders = np.flatnonzero(sequence.triggers), np.flatnonzero(sequence.responders)
    looks = torch.from_numpy(np.ascontiguousarray(sequence.features[:, responders].swapaxes(0, 1), np.float32))
    graph = HeteroData()
    graph["trigger"].pos = torch.from_numpy(np.asarray(sequence.positions[triggers], np.float32))
    graph["responder"].distances = apart(looks, looks)
    graph["responder"].num_nodes = len(responders)
    graph["step"].action = torch.from_numpy(np.asarray(sequence.actions, np.float32))
    graph["step"].known = torch.ones(sequence.steps, dtype=torch.bool)
    graph["step"].num_nodes = sequence.steps
    pairs = np.stack(np.nonzero(np.ones((len(triggers), len(responders)))))
    graph["trigger", "controls", "responder"].edge_index = torch.from_numpy(pairs.astype(np.int64))
    graph["step", "touches", "trigger"].edge_index = touches(trigger_rows(sequence.triggers, sequence.acted))
    return graph


def trigger_rows(triggers: np.ndarray, acted: np.ndarray) -> np.ndarray:
    """Objects as places among the triggers, int64; -1 for what is none."""
    places = np.append(np.where(triggers, np.cumsum(triggers) - 1, -1), -1)  # the last one stands for no object
    return places[acted].astype(np.int64)


def apart(looks: Tensor, others: Tensor) -> Tensor:
    """Euclidean distances (R, A, C) between looks (R, A, 256) and others (R, C, 256); 0 between equal ones."""
    return torch.cdist(looks, others, compute_mode="donot_use_mm_for_euclid_dist")


def padded(boards: Iterable[HeteroData]) -> list[HeteroData]:
    """The same boards with as many steps as the longest; `known` tells which are real."""
    boards = list(boards)
    longest = max((board["step"].num_nodes for board in boards), default=0)
    return [_pad(board, longest - board["step"].num_nodes) for board in boards]


def _pad(board: HeteroData, missing: int) -> HeteroData:
    if not missing:
        return board
    longer = board.clone()
    longer["responder"].distances = pad(board["responder"].distances, (0, missing, 0, missing))
    longer["step"].action = pad(board["step"].action, (0, 0, 0, missing))
    longer["step"].known = pad(board["step"].known, (0, missing), value=False)
    longer["step"].num_nodes = board["step"].num_nodes + missing
    return longer


@dataclass(frozen=True)
class Context:
    """What is known of B boards after L steps: K triggers, R responders and E pairs of them on all boards together.

    Attributes:
        distances: (R, L + 1, L + 1), in units of the smallest change.
        actions: (B, L, 6).
        acted: int (B, L), trigger acted on, -1 for none.
        known: bool (B, L), False for steps that only fill up.
        board: int (R,), each responder's board.
        edge_index: int (2, E), trigger and responder.
        pos: (K, 3), of triggers.
        owner: int (K,), each trigger's board.
    """

    distances: Tensor
    actions: Tensor
    acted: Tensor
    known: Tensor
    board: Tensor
    edge_index: Tensor
    pos: Tensor
    owner: Tensor

    @property
    def sizes(self) -> Tensor:
        """How far each responder's look moved in each step, (R, L)."""
        moved = self.distances.diagonal(offset=1, dim1=1, dim2=2)
        return torch.where(self.known[self.board], moved, 0.0)

    @property
    def touched(self) -> Tensor:
        """Whether each step acted on each trigger, bool (K, L)."""
        return self.acted[self.owner] == torch.arange(len(self.owner), device=self.owner.device)[:, None]

    def first(self, steps: int) -> "Context":
        """What was known after so many steps."""
        return replace(
            self,
            distances=self.distances[:, : steps + 1, : steps + 1],
            actions=self.actions[:, :steps],
            acted=self.acted[:, :steps],
            known=self.known[:, :steps],
        )


@dataclass(frozen=True)
class Queries:
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
class ObservedOutcome:
    """What really followed.

    Attributes:
        look: (R, Q, L + 1), how far the look after the step lies from every look seen before the Q steps.
        moved: (R, Q), and from the look before the step.
        real: bool (B, Q), False for steps that only fill up.
    """

    look: Tensor
    moved: Tensor
    real: Tensor


def context_of(batch: Batch, scale: Tensor | float) -> Context:
    """All steps of a batch of boards; distances are divided by the scale."""
    boards, steps = batch.num_graphs, batch["step"].num_nodes // batch.num_graphs
    return Context(
        distances=batch["responder"].distances / scale,
        actions=batch["step"].action.view(boards, steps, 6),
        acted=step_targets(batch, "trigger"),
        known=batch["step"].known.view(boards, steps),
        board=batch["responder"].batch,
        edge_index=batch["trigger", "controls", "responder"].edge_index,
        pos=batch["trigger"].pos,
        owner=batch["trigger"].batch,
    )


def split(seen: Context, steps: int, most: int) -> tuple[Context, Queries, ObservedOutcome]:
    """The first steps as what is known, at most so many of the following ones as questions with their answers."""
    until = min(steps + most, seen.actions.shape[1])
    before, after = slice(steps, until), slice(steps + 1, until + 1)
    asked = Queries(seen.distances[:, before, : steps + 1], seen.actions[:, before], seen.acted[:, before])
    moved = seen.distances.diagonal(offset=1, dim1=1, dim2=2)[:, before]
    return (
        seen.first(steps),
        asked,
        ObservedOutcome(seen.distances[:, after, : steps + 1], moved, seen.known[:, before]),
    )
