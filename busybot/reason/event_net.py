"""The networks of the `event` model: which trigger controls which responder, and what a contact does to it.

Two stages (protocol "Why the paper falls short"): does responder j change with this contact, and if so, to what. The
answer to the second is a look that j has had before, or something new: past changes are repeated or undone. Everything
is told by distances between looks, contact points and directions, so nothing depends on what objects look like.

Letters: B boards, R responders and E candidate pairs of all boards, L known steps, Q steps asked for.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch_geometric.utils import scatter

from busybot.reason.event_config import NetConfig
from busybot.reason.event_data import Asked, Seen

NEVER = -1e4
"""Logit of what is impossible."""
SMALL = 0.05
"""Added to distances before logarithms, in units of the smallest change."""
NEAR = (0.02, 0.05, 0.12)
"""Distances between contacts that tell links apart, board units: the same link is 0.045 away in the median, another one
0.123."""
UNSEEN = -0.85
"""Logit that a responder changes when its trigger is acted on, though it never did: with probability 0.3 this is a link
that was not touched before. If this were learnt, too, nothing would tell rare changes from improbable edges."""
CONTACT_FACTS, PAST_FACTS, LOOK_FACTS, STEP_FACTS = len(NEAR) + 5, 5, 6, 7
FAR = 0.5
"""Contacts farther apart are equally far, board units."""


@dataclass(frozen=True)
class Effects:
    """What steps do to responders whose trigger is acted on.

    Attributes:
        change: (R, Q), logit that the responder changes.
        choice: (R, Q, 2K + 1), log probability of each past look to change to, the last: something never seen.
        frames: int (R, 2K), which look that is, as an index into the L + 1 frames.
    """

    change: Tensor
    choice: Tensor
    frames: Tensor


def mlp(*widths: int) -> nn.Sequential:
    """Linear layers with ReLU between them."""
    layers: list[nn.Module] = []
    for inputs, outputs in zip(widths[:-1], widths[1:], strict=True):
        layers += [nn.Linear(inputs, outputs), nn.ReLU()]
    return nn.Sequential(*layers[:-1])


class EdgeHead(nn.Module):
    """Logits of the candidate pairs, from how the responder changed when the trigger was acted on and when not."""

    def __init__(self, width: int):
        super().__init__()
        self.token = mlp(4, width, width)
        self.pair = mlp(4 * width + 3, 2 * width, 1)

    def forward(self, seen: Seen) -> Tensor:
        """Logits (E,)."""
        sizes, (trigger, row) = seen.sizes, seen.pairs
        largest = scatter(sizes, seen.board, dim_size=len(seen.actions), reduce="max")[seen.board]  # (R, L)
        told = torch.stack([torch.log(sizes + SMALL), changed(sizes), sizes / (largest + SMALL), changed(largest)], -1)
        tokens = self.token(told)[row]  # (E, L, width)
        board = seen.board[row]
        on = (seen.acted[board] == trigger[:, None]) & seen.known[board]  # (E, L)
        off = seen.known[board] & ~on
        effective = on & (changed(largest)[row] > 0.5)
        counts = [torch.log1p(mask.sum(-1, keepdim=True).float()) for mask in (on, off, effective)]
        return self.pair(torch.cat([*_pooled(tokens, on), *_pooled(tokens, off), *counts], -1))[:, 0]


def _pooled(tokens: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and maximum (E, width) of tokens (E, L, width) over the steps of the mask, zeros where there are none."""
    shown = mask[..., None]
    mean = (tokens * shown).sum(1) / shown.sum(1).clamp(min=1)
    most = tokens.masked_fill(~shown, NEVER).amax(1) if tokens.shape[1] else mean
    return mean, torch.where(mask.any(1, keepdim=True), most, 0.0)


def changed(sizes: Tensor) -> Tensor:
    """How surely a change of this size is one, 0 to 1."""
    return torch.sigmoid(4 * torch.log(sizes + SMALL))


class EffectHead(nn.Module):
    """What a step does to the responders that its trigger controls."""

    def __init__(self, config: NetConfig):
        super().__init__()
        width, heads = config.width, config.heads
        self.place = nn.Linear(CONTACT_FACTS, width)
        self.past = nn.Linear(PAST_FACTS, width, bias=False)
        self.token = nn.Sequential(nn.ReLU(), nn.Linear(width, width), nn.ReLU())
        self.attend = nn.Linear(width, heads)
        self.change = mlp(heads * (width + 1) + STEP_FACTS + 1, width, 1)
        self.sharpness = nn.Parameter(torch.tensor([1.5] + [0.0] * (heads - 1)))
        self.trust = nn.Parameter(torch.tensor(3.0))
        self.candidate = mlp(CONTACT_FACTS + LOOK_FACTS, width, width, 1)
        self.match = nn.Parameter(torch.tensor(6.0))
        self.unknown = nn.Parameter(torch.tensor(-4.0))
        self.start_as_lookup()

    def start_as_lookup(self) -> None:
        """Before training the nearest contact that changed something decides, and the change that begins where j is."""
        for layers in (self.change, self.candidate):
            for parameter in layers[-1].parameters():
                nn.init.zeros_(parameter)

    def forward(self, seen: Seen, asked: Asked) -> Effects:
        """See `Effects`."""
        contacts = _contacts(seen, asked)
        choice, frames, fit = self._choice(seen, asked, contacts)
        return Effects(self._change(seen, asked, contacts, fit), choice, frames)

    def _change(self, seen: Seen, asked: Asked, contacts: "_Contacts", fit: Tensor) -> Tensor:
        """Attention over past contacts on the same trigger, near ones first; (R, Q)."""
        board, sizes = seen.board, seen.sizes
        largest = scatter(sizes, board, dim_size=len(seen.actions), reduce="max")
        did = changed(sizes)[:, None].expand(-1, asked.current.shape[1], -1)  # (R, Q, L)
        worked = changed(largest)[board][:, None].expand_as(did)
        before, after = asked.current[..., :-1], asked.current[..., 1:]
        told = torch.stack([did, worked, torch.exp(-before), torch.exp(-after), did * torch.exp(-before)], -1)
        tokens = self.token(self.place(contacts.told)[board] + self.past(told))  # (R, Q, L, width)
        nearness = 4 * worked - contacts.distance[board].clamp(max=FAR) / NEAR[0]
        logits = self.attend(tokens) + self.sharpness * nearness.unsqueeze(-1)  # (R, Q, L, heads)
        usable = contacts.same[board].unsqueeze(-1)
        weights = torch.softmax(logits.masked_fill(~usable, NEVER), 2) * usable if logits.shape[2] else logits
        pooled = torch.einsum("rqlh,rqlw->rqhw", weights, torch.cat([tokens, did.unsqueeze(-1)], -1))
        votes = pooled[..., 0, -1]
        inputs = torch.cat([pooled.flatten(2), contacts.step[board], fit.unsqueeze(-1)], -1)
        learnt = self.trust * (2 * votes - 1) + self.change(inputs)[..., 0]
        return torch.where(((did > 0.5) & usable[..., 0]).any(-1), learnt, UNSEEN)

    def _choice(self, seen: Seen, asked: Asked, contacts: "_Contacts") -> tuple[Tensor, Tensor, Tensor]:
        """Log probabilities and frames as in `Effects`, and how well the best candidate begins where j is, (R, Q)."""
        sizes = seen.sizes
        most = max(1, int((changed(sizes) > 0.5).sum(1).max())) if sizes.numel() else 0
        size, step = sizes.topk(min(most, sizes.shape[1]), dim=1)  # (R, K)
        usable = (changed(size) > 0.5).repeat(1, 2)[:, None]  # (R, 1, 2K)
        frames = torch.cat([step + 1, step], 1)  # repeated, undone
        near = _frames(asked.current, torch.cat([step, step + 1], 1))  # (R, Q, 2K), where the change began
        away = _frames(asked.current, frames)
        size = size.repeat(1, 2)[:, None].clamp(min=SMALL)
        told = self._told(seen, contacts, step, near, away, size)
        share = near / size
        scores = self.candidate(told)[..., 0] - self.match * share
        scores = scores.masked_fill(~usable, NEVER)
        unknown = self.unknown.expand(*scores.shape[:2], 1)
        fit = torch.exp(-2 * share).masked_fill(~usable, 0).amax(-1) if frames.shape[1] else unknown[..., 0] * 0
        return torch.log_softmax(torch.cat([scores, unknown], -1), -1), frames, fit

    def _told(
        self, seen: Seen, contacts: "_Contacts", step: Tensor, near: Tensor, away: Tensor, size: Tensor
    ) -> Tensor:
        """What is known of repeating or undoing each past change, (R, Q, 2K, ...)."""
        place = contacts.told[seen.board]  # (R, Q, L, ...)
        index = step[:, None, :, None].expand(-1, place.shape[1], -1, place.shape[3])
        repeated = place.gather(2, index)
        undone = repeated * contacts.reverse
        undo = torch.cat(
            [torch.zeros_like(near[..., : step.shape[1]]), torch.ones_like(near[..., step.shape[1] :])], -1
        )
        looks = [torch.log(near + SMALL), near / size, torch.log(away + SMALL), away / size]
        own = torch.stack([*looks, torch.log(size).expand_as(near), undo], -1)
        return torch.cat([torch.cat([repeated, undone], 2), own], -1)


def _frames(distances: Tensor, frames: Tensor) -> Tensor:
    """Distances (R, Q, L + 1) to some frames (R, C): (R, Q, C)."""
    return distances.gather(2, frames[:, None].expand(-1, distances.shape[1], -1))


@dataclass(frozen=True)
class _Contacts:
    """The steps asked for beside the known ones.

    Attributes:
        told: (B, Q, L, CONTACT_FACTS), how near each known contact was and how its direction relates to this one.
        reverse: (CONTACT_FACTS,), -1 where undoing a change turns the sign, else 1.
        distance: (B, Q, L), board units.
        same: bool (B, Q, L), both on the same trigger.
        step: (B, Q, STEP_FACTS), the action itself.
    """

    told: Tensor
    reverse: Tensor
    distance: Tensor
    same: Tensor
    step: Tensor


def _contacts(seen: Seen, asked: Asked) -> _Contacts:
    there, here = seen.actions[:, None], asked.actions[:, :, None]
    offset = there[..., :3] - here[..., :3]  # (B, Q, L, 3)
    distance = offset.norm(dim=-1)
    same = (seen.acted[:, None] == asked.acted[:, :, None]) & (asked.acted >= 0)[:, :, None] & seen.known[:, None]
    alike = (there[..., 3:] * here[..., 3:]).sum(-1)
    # a link that has moved is touched elsewhere: along the action or against it
    along = (offset * here[..., 3:]).sum(-1).clamp(-FAR, FAR) / NEAR[1]
    nearness = [torch.exp(-((distance / scale) ** 2)) for scale in NEAR]
    told = torch.stack([*nearness, distance.clamp(max=FAR) / NEAR[2], alike, alike.abs(), along, same.float()], -1)
    reverse = told.new_ones(CONTACT_FACTS)
    reverse[len(NEAR) + 1] = -1  # of `alike`
    return _Contacts(told, reverse, distance, same, _step_facts(seen, asked, distance, same))


def _step_facts(seen: Seen, asked: Asked, distance: Tensor, same: Tensor) -> Tensor:
    """The action relative to its trigger, whatever way the board is turned: (B, Q, STEP_FACTS)."""
    nowhere = distance.new_full((*distance.shape[:2], 1), FAR)
    closest = torch.cat([distance.masked_fill(~same, FAR), nowhere], -1).amin(-1)
    arm = asked.actions[..., :3] - seen.pos[asked.acted.clamp(min=0)]
    direction = asked.actions[..., 3:]
    outward = (arm[..., :2] * direction[..., :2]).sum(-1) / (arm[..., :2].norm(dim=-1) + SMALL)
    upward, count = direction[..., 2], torch.log1p(same.sum(-1).float())
    return torch.stack([upward, upward.abs(), outward, outward.abs(), arm[..., 2], closest / NEAR[2], count], -1)


class EventNet(nn.Module):
    """Both heads; `scale` is the smallest change in the encoder's units."""

    scale: Tensor

    def __init__(self, config: NetConfig, scale: float = 1.0):
        super().__init__()
        self.edges, self.effects = EdgeHead(config.width), EffectHead(config)
        self.inference, self.exclusive = config.inference, config.exclusive and config.inference
        self.register_buffer("scale", torch.tensor(float(scale)))

    def log_edges(self, seen: Seen) -> tuple[Tensor, Tensor]:
        """Log probability that each pair is an edge, (E,), and that a responder has no trigger, (R,).

        At most one trigger per responder: a softmax over the triggers and "none". Otherwise each pair has a
        probability of its own, and the second value is the log probability that none of them is an edge. Without
        inference every pair is an edge.
        """
        row, rows = seen.pairs[1], len(seen.board)
        if not self.inference:
            return torch.zeros(len(row)), torch.full((rows,), NEVER)
        logits = self.edges(seen)
        if not self.exclusive:
            none = scatter(functional.logsigmoid(-logits), row, dim_size=rows, reduce="sum")
            return functional.logsigmoid(logits), none
        total = log_sum(logits, logits.new_zeros(rows), row)
        return logits - total[row], -total


def log_sum(values: Tensor, base: Tensor, row: Tensor) -> Tensor:
    """log(exp(base) + sum of exp(values) by row), (R,), for values (E,) and base (R,)."""
    top = scatter(values, row, dim_size=len(base), reduce="max").maximum(base).detach()
    total = scatter(torch.exp(values - top[row]), row, dim_size=len(base), reduce="sum")
    return top + torch.log(total + torch.exp(base - top))
