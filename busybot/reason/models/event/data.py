"""Boards as graphs for the `event` model, any number of objects, and the vectors of facts that its networks read.

The model compares looks and never reads them: of the features it keeps how far the looks of one responder lie apart.
So it knows nothing of any encoder's axes, cannot memorise objects, and costs the same whatever the features' size.
Distances between looks are in units of the smallest change, those between contacts in board units. Nothing depends on
what objects look like, where a board stands or which way it is turned about its normal.

Letters: B boards, R responders of all boards, L known steps, Q steps asked for, 2K candidate looks.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import pad

from busybot.reason.inputs.board_dataset import step_targets, touches
from busybot.reason.inputs.sequence import BoardSequence, hidden_looks
from busybot.reason.pyg import Batch, HeteroData, scatter


def board_graph(sequence: BoardSequence) -> HeteroData:
    """One episode.

    | nodes and edges | attribute | shape | meaning |
    |---|---|---|---|
    | `trigger` | `pos` | float32 (K, 3) | board units |
    | `responder` | `distances` | float32 (R, T + 1, T + 1) | between its features in any two frames |
    | | `shown` | bool (R, T) | False for steps before or after which something hid it |
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
    hidden = torch.from_numpy(hidden_looks(sequence.features[:, responders]).T)
    graph["responder"].shown = ~(hidden[:, :-1] | hidden[:, 1:])
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
    longer = board.clone()
    longer["responder"].distances = pad(board["responder"].distances, (0, missing, 0, missing))
    longer["responder"].shown = pad(board["responder"].shown, (0, missing), value=True)
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
        shown: bool (R, L), False for steps of which it was not seen what they did to the responder.
        board: int (R,), each responder's board.
        edge_index: int (2, E), trigger and responder.
        pos: (K, 3), of triggers.
        owner: int (K,), each trigger's board.
    """

    distances: Tensor
    actions: Tensor
    acted: Tensor
    known: Tensor
    shown: Tensor
    board: Tensor
    edge_index: Tensor
    pos: Tensor
    owner: Tensor

    @cached_property
    def sizes(self) -> Tensor:
        """How far each responder's look moved in each step, (R, L)."""
        moved = self.distances.diagonal(offset=1, dim1=1, dim2=2)
        return torch.where(self.told, moved, 0.0)

    @cached_property
    def largest(self) -> Tensor:
        """The largest of `sizes` on the responder's board, (R, L)."""
        return scatter(self.sizes, self.board, dim_size=len(self.actions), reduce="max")[self.board]

    @cached_property
    def changes(self) -> Tensor:
        """How surely each responder, and anything on its board, changed in each step, (R, L, 2)."""
        return torch.stack([changed(self.sizes), changed(self.largest)], -1)

    @cached_property
    def past(self) -> tuple[Tensor, Tensor, Tensor]:
        """Each responder's greatest changes, as many as any has: (R, K), their sizes, steps, and whether it is one."""
        sure = self.changes[..., 0] > 0.5
        most = max(1, int(sure.sum(1).max())) if sure.numel() else 0
        size, step = self.sizes.topk(min(most, sure.shape[1]), dim=1)
        return size, step, sure.gather(1, step)

    @property
    def told(self) -> Tensor:
        """Of which steps it is known what they did to each responder, bool (R, L)."""
        return self.known[self.board] & self.shown

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
            shown=self.shown[:, :steps],
        )

    def after_each(self, steps: np.ndarray) -> "Context":
        """What was known after so many steps each, int (S,), of the only board there is, as S boards.

        To be asked for edges, not for effects: distances are as of all steps.
        """
        rows, triggers, count, on = len(self.board), len(self.owner), len(steps), self.board.device
        each = torch.arange(count, device=on)
        offsets = each[:, None, None] * torch.tensor([[triggers], [rows]], device=on)
        until = torch.from_numpy(steps).to(on)[:, None] > torch.arange(self.known.shape[1], device=on)
        return Context(
            distances=self.distances.repeat(count, 1, 1),
            actions=self.actions.expand(count, -1, -1),
            acted=torch.where(self.acted < 0, self.acted, self.acted + each[:, None] * triggers),
            known=self.known & until,
            shown=self.shown.repeat(count, 1),
            board=each.repeat_interleave(rows),
            edge_index=(self.edge_index + offsets).swapaxes(0, 1).flatten(1),
            pos=self.pos.repeat(count, 1),
            owner=each.repeat_interleave(triggers),
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
        real: bool (R, Q), False for steps that only fill up, or of which was not seen what they did to the responder.
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
        shown=batch["responder"].shown,
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
        ObservedOutcome(seen.distances[:, after, : steps + 1], moved, seen.told[:, before]),
    )


SMALL = 0.05
"""Added to distances before logarithms, in units of the smallest change."""
NEAR = (0.02, 0.05, 0.12)
"""Distances between contacts that tell links apart, board units: the same link is 0.045 away in the median, another one
0.123."""
FAR = 0.5
"""Contacts farther apart are equally far, board units."""
CHANGE_FACTS, COUNT_FACTS, CONTACT_FACTS, PAST_FACTS, LOOK_FACTS, STEP_FACTS = 4, 3, 8, 5, 6, 7
"""Numbers in each vector."""
ALIKE = 4
"""The column of `Contacts.facts` whose sign turns where a change is undone."""


def changed(sizes: Tensor) -> Tensor:
    """How surely a change of this size is one, 0 to 1."""
    return torch.sigmoid(4 * torch.log(sizes + SMALL))


def change_facts(seen: Context) -> Tensor:
    """What a known step did to a responder, (R, L, 4).

    | column | meaning |
    |---|---|
    | 0 | log(size + 0.05), how far its look moved |
    | 1 | how surely that is a change, 0 to 1 |
    | 2 | size / (largest + 0.05) |
    | 3 | how surely something on the board changed, 0 to 1 |
    """
    sizes, (itself, anything) = seen.sizes, seen.changes.unbind(-1)
    return torch.stack([torch.log(sizes + SMALL), itself, sizes / (seen.largest + SMALL), anything], -1)


def count_facts(on: Tensor, off: Tensor, effective: Tensor) -> Tensor:
    """How often a pair of trigger and responder was tried, (E, 3), from three masks (E, L).

    | column | log(1 + number of steps) |
    |---|---|
    | 0 | on the trigger |
    | 1 | on anything else, or nothing |
    | 2 | on the trigger that changed something |
    """
    return torch.stack([torch.log1p(mask.sum(-1).float()) for mask in (on, off, effective)], -1)


def past_facts(change: Tensor, present: Tensor) -> Tensor:
    """What a known step did to a responder, seen from a step asked for, (..., 5).

    | column | meaning |
    |---|---|
    | 0 | how surely it changed, 0 to 1 |
    | 1 | how surely something on the board changed, 0 to 1 |
    | 2 | exp(-distance from its look before the known step to its present look) |
    | 3 | exp(-distance from its look after it) |
    | 4 | column 0 x column 2 |

    Shapes:
        change: (..., 2), columns 0 and 1.
        present: (..., 2), the distances of columns 2 and 3.
    """
    near = torch.exp(-present)
    return torch.cat([change, near, change[..., :1] * near[..., :1]], -1)


def look_facts(near: Tensor, away: Tensor, size: Tensor, undo: Tensor) -> Tensor:
    """What copying a look would mean, (R, Q, 2K, 6).

    | column | meaning |
    |---|---|
    | 0 | log(near + 0.05), from the present look to the one that the past change began with |
    | 1 | near / size |
    | 2 | log(away + 0.05), from the present look to the one that would be copied |
    | 3 | away / size |
    | 4 | log(size of the past change) |
    | 5 | 1 if the change is undone, 0 if it is repeated |

    Shapes:
        near, away: (R, Q, 2K).
        size, undo: broadcast to them.
    """
    columns = (torch.log(near + SMALL), near / size, torch.log(away + SMALL), away / size, torch.log(size), undo)
    return torch.stack([column.expand_as(near) for column in columns], -1)


@dataclass(frozen=True)
class Contacts:
    """The steps asked for beside the known ones.

    `facts`, of a known contact as seen from one asked for:

    | column | meaning |
    |---|---|
    | 0, 1, 2 | exp(-(distance / s)^2) for s = 0.02, 0.05, 0.12 |
    | 3 | min(distance, 0.5) / 0.12 |
    | 4 | cosine of the angle between the directions |
    | 5 | its absolute value |
    | 6 | how far along the asked direction the known contact lies, -0.5 to 0.5, / 0.05: a link that has moved is \
touched elsewhere |
    | 7 | 1 if both are on the same trigger |

    `step`, of an action itself:

    | column | meaning |
    |---|---|
    | 0 | its direction along the board's normal |
    | 1 | the absolute value of that |
    | 2 | its direction along the line from the trigger to the contact, in the board's plane |
    | 3 | the absolute value of that |
    | 4 | height of the contact above the trigger, board units |
    | 5 | distance to the nearest known contact on the same trigger, at most 0.5, / 0.12 |
    | 6 | log(1 + known contacts on the same trigger) |

    Attributes:
        facts: (B, Q, L, 8).
        distance: (B, Q, L), board units.
        same: bool (B, Q, L), both on the same trigger.
        step: (B, Q, 7).
    """

    facts: Tensor
    distance: Tensor
    same: Tensor
    step: Tensor

    def part(self, which: Tensor) -> "Contacts":
        """Of some of the steps asked for, by index."""
        return Contacts(self.facts[:, which], self.distance[:, which], self.same[:, which], self.step[:, which])


def contacts_of(seen: Context, actions: Tensor, acted: Tensor) -> Contacts:
    """Compare those of steps asked for, as of `Queries`, with the known ones."""
    there, here = seen.actions[:, None], actions[:, :, None]
    offset = there[..., :3] - here[..., :3]  # (B, Q, L, 3)
    distance = offset.norm(dim=-1)
    same = (seen.acted[:, None] == acted[:, :, None]) & (acted >= 0)[:, :, None] & seen.known[:, None]
    alike = (there[..., 3:] * here[..., 3:]).sum(-1)
    along = (offset * here[..., 3:]).sum(-1).clamp(-FAR, FAR) / NEAR[1]
    nearness = [torch.exp(-((distance / scale) ** 2)) for scale in NEAR]
    facts = [*nearness, distance.clamp(max=FAR) / NEAR[2], alike, alike.abs(), along, same.float()]
    return Contacts(torch.stack(facts, -1), distance, same, _step_facts(seen, actions, acted, distance, same))


def _step_facts(seen: Context, actions: Tensor, acted: Tensor, distance: Tensor, same: Tensor) -> Tensor:
    """`Contacts.step`."""
    nowhere = distance.new_full((*distance.shape[:2], 1), FAR)
    closest = torch.cat([distance.masked_fill(~same, FAR), nowhere], -1).amin(-1)
    places = torch.cat([seen.pos, seen.pos.new_zeros(1, 3)])  # the last one for a miss, which has no trigger
    arm = actions[..., :3] - places[acted]
    direction = actions[..., 3:]
    outward = (arm[..., :2] * direction[..., :2]).sum(-1) / (arm[..., :2].norm(dim=-1) + SMALL)
    upward, count = direction[..., 2], torch.log1p(same.sum(-1).float())
    return torch.stack([upward, upward.abs(), outward, outward.abs(), arm[..., 2], closest / NEAR[2], count], -1)


def reversed_facts(facts: Tensor) -> Tensor:
    """Contact facts of a change that is undone: an opposite direction is then what a like one is for a repetition."""
    sign = facts.new_ones(CONTACT_FACTS)
    sign[ALIKE] = -1
    return facts * sign
