"""The `event` model: which trigger controls which responder, and what a contact does to it.

Two stages: does responder j change with this contact, and if so, to what. The
answer to the second is a look that j has had before, or something new: past changes are repeated or undone. All that
the networks read stands in `data`.

Letters: B boards, R responders and E candidate pairs of all boards, L known steps, Q steps asked for.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.base import InferredGraph
from busybot.reason.models.event.config import EventNetConfig
from busybot.reason.models.event.data import (
    CHANGE_FACTS,
    CONTACT_FACTS,
    COUNT_FACTS,
    FAR,
    LOOK_FACTS,
    NEAR,
    PAST_FACTS,
    SMALL,
    STEP_FACTS,
    Contacts,
    Context,
    Queries,
    apart,
    board_graph,
    change_facts,
    contacts_of,
    context_of,
    count_facts,
    look_facts,
    past_facts,
    reversed_facts,
    trigger_rows,
)
from busybot.reason.models.message_passing import GraphModule
from busybot.reason.pyg import Batch, scatter, softmax
from busybot.training.device import threads

NEVER = -1e4
"""Logit of what is impossible."""
UNSEEN = -0.85
"""Logit that a responder changes when its trigger is acted on, though it never did: with probability 0.3 this is a link
that was not touched before. If this were learnt, too, nothing would tell rare changes from improbable edges."""
LEAST_EDGE = 0.499
"""A responder copies a look if that is likelier than that nothing changes, so only where the edge from the trigger that
was held has a probability over 1/2; a little less, against rounding."""
AT_ONCE = 2**23
"""Beliefs after so many steps are computed together that the largest arrays have at most so many numbers, 32 MB."""


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


class EdgeHead(GraphModule):
    """Logits of the pairs, from how responder i changed in the steps on trigger j and in all others:

        t_il = MLP(facts of i in step l)
        z_ij = MLP(mean and max of t_il over l on j, mean and max of t_il over l not on j, numbers of steps)

    Shapes:
        input: see `Context`; triggers are the edges' sources, responders their targets.
        output: (E,).
    """

    def __init__(self, width: int):
        super().__init__(aggr=None)
        self.width = width
        self.token = mlp(CHANGE_FACTS, width, width)
        self.pair = mlp(4 * width + COUNT_FACTS, 2 * width, 1)

    def forward(self, seen: Context) -> Tensor:
        """Logits (E,)."""
        return self.edge_updater(
            seen.edge_index,
            token=(None, self.token(change_facts(seen))),  # (R, L, width)
            known=(None, seen.told),
            effective=(None, seen.changes[..., 1] > 0.5),
            touched=(seen.touched, None),
        )

    def edge_update(self, token_i: Tensor, known_i: Tensor, effective_i: Tensor, touched_j: Tensor) -> Tensor:
        """Tokens (E, L, width) and masks (E, L) of every pair to logits (E,)."""
        on, off = touched_j & known_i, known_i & ~touched_j
        counts = count_facts(on, off, on & effective_i)
        return self.pair(torch.cat([*_pooled(token_i, on), *_pooled(token_i, off), counts], -1))[:, 0]


def _pooled(tokens: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and maximum (E, width) of tokens (E, L, width) over the steps of the mask, zeros where there are none."""
    shown = mask[..., None]
    mean = (tokens * shown).sum(1) / shown.sum(1).clamp(min=1)
    most = tokens.masked_fill(~shown, NEVER).amax(1) if tokens.shape[1] else mean
    return mean, torch.where(mask.any(1, keepdim=True), most, 0.0)


class EffectHead(GraphModule):
    """What a step does to the responders that its trigger controls.

    Whether responder r changes in step q is told by attention over the known steps l on the same trigger, near ones
    first. These are edges: from (r, l) to (r, q). With several heads, h:

        t_rql = MLP(facts of contact l for q, facts of what l did to r)
        a_rqlh = softmax over l of (u_h . t_rql + s_h nearness_rql)
        z_rq = w (2 v_rq - 1) + MLP(sum over l of a_rqlh [t_rql, did_rl] for all h, facts of q, fit of the best look)

    where v is what the first head says of `did`. What it changes to is told by scores of its past looks (`_choice`).

    Shapes:
        input: see `Context` and `Queries`.
        output: see `Effects`.
    """

    def __init__(self, config: EventNetConfig):
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

    def forward(self, seen: Context, asked: Queries, contacts: Contacts | None = None) -> Effects:
        """See `Effects`; contacts are those of the steps asked for, if they are known already."""
        contacts = contacts or contacts_of(seen, asked.actions, asked.acted)
        choice, frames, fit = self._choice(seen, asked, contacts)
        return Effects(self._change(seen, asked, contacts, fit), choice, frames)

    def _change(self, seen: Context, asked: Queries, contacts: Contacts, fit: Tensor) -> Tensor:
        """Logits that responders change, (R, Q)."""
        board, change = seen.board, seen.changes
        rows, queries, steps = asked.current.shape[0], asked.current.shape[1], change.shape[1]
        same = contacts.same[board] & seen.shown[:, None]  # (R, Q, L)
        row, query, step = same.nonzero(as_tuple=True)
        place = (board[row] * queries + query) * steps + step  # in (B, Q, L)
        pooled = self.propagate(
            torch.stack([row * steps + step, row * queries + query]),
            size=(rows * steps, rows * queries),
            change=(change.flatten(0, 1), None),
            place=self.place(contacts.facts).flatten(0, 2).index_select(0, place),
            distance=contacts.distance.flatten().index_select(0, place),
            present=asked.current.unfold(2, 2, 1)[row, query, step],
        ).view(rows, queries, *self._pooled_shape)
        inputs = torch.cat([pooled.flatten(2), contacts.step[board], fit.unsqueeze(-1)], -1)
        learnt = self.trust * (2 * pooled[..., 0, -1] - 1) + self.change(inputs)[..., 0]
        return torch.where((same & (change[:, None, :, 0] > 0.5)).any(-1), learnt, UNSEEN)

    @property
    def _pooled_shape(self) -> tuple[int, int]:
        """Heads, and what each gathers."""
        return self.attend.out_features, self.attend.in_features + 1

    def message(
        self, change_j: Tensor, place: Tensor, distance: Tensor, present: Tensor, index: Tensor, size_i: int
    ) -> Tensor:
        """What each known contact says to a step asked for, weighted by attention, (P, heads, width + 1)."""
        did, worked = change_j.unbind(-1)
        tokens = self.token(place + self.past(past_facts(change_j, present)))  # (P, width)
        nearness = 4 * worked - distance.clamp(max=FAR) / NEAR[0]
        logits = self.attend(tokens) + self.sharpness * nearness[:, None]  # (P, heads)
        weights = softmax(logits, index, num_nodes=size_i)
        return weights[..., None] * torch.cat([tokens, did[:, None]], -1)[:, None]

    def _choice(self, seen: Context, asked: Queries, contacts: Contacts) -> tuple[Tensor, Tensor, Tensor]:
        """Log probabilities and frames as in `Effects`, and how well the best candidate begins where j is, (R, Q)."""
        size, step, sure = seen.past
        usable = sure.repeat(1, 2)[:, None]  # (R, 1, 2K)
        frames = torch.cat([step + 1, step], 1)  # repeated, undone
        near = _frames(asked.current, torch.cat([step, step + 1], 1))  # (R, Q, 2K), where the change began
        size = size.repeat(1, 2)[:, None].clamp(min=SMALL)
        undo = (torch.arange(2 * step.shape[1], device=step.device) >= step.shape[1]).to(near)
        looks = look_facts(near, _frames(asked.current, frames), size, undo)
        share = near / size
        scores = self.candidate(torch.cat([_places(seen, contacts, step), looks], -1))[..., 0] - self.match * share
        scores = scores.masked_fill(~usable, NEVER)
        unknown = self.unknown.expand(*scores.shape[:2], 1)
        fit = torch.exp(-2 * share).masked_fill(~usable, 0).amax(-1) if frames.shape[1] else unknown[..., 0] * 0
        return torch.log_softmax(torch.cat([scores, unknown], -1), -1), frames, fit


def _places(seen: Context, contacts: Contacts, step: Tensor) -> Tensor:
    """Contact facts of repeating and of undoing what responders did in known steps (R, K): (R, Q, 2K, 8)."""
    place = contacts.facts[seen.board]  # (R, Q, L, 8)
    repeated = place.gather(2, step[:, None, :, None].expand(-1, place.shape[1], -1, CONTACT_FACTS))
    return torch.cat([repeated, reversed_facts(repeated)], 2)


def _frames(distances: Tensor, frames: Tensor) -> Tensor:
    """Distances (R, Q, L + 1) to some frames (R, C): (R, Q, C)."""
    return distances.gather(2, frames[:, None].expand(-1, distances.shape[1], -1))


class EventNet(nn.Module):
    """Both heads; `scale` is the smallest change in the encoder's units."""

    scale: Tensor

    def __init__(self, config: EventNetConfig, scale: float = 1.0):
        super().__init__()
        self.edges, self.effects = EdgeHead(config.width), EffectHead(config)
        self.inference, self.exclusive = config.inference, config.exclusive and config.inference
        self.register_buffer("scale", torch.tensor(float(scale)))

    def log_edges(self, seen: Context) -> tuple[Tensor, Tensor]:
        """Log probability that each pair is an edge, (E,), and that a responder has no trigger, (R,).

        At most one trigger per responder: a softmax over the triggers and "none". Otherwise each pair has a
        probability of its own, and the second value is the log probability that none of them is an edge. Without
        inference every pair is an edge.
        """
        row, rows = seen.edge_index[1], len(seen.board)
        if not self.inference:
            return seen.distances.new_zeros(len(row)), seen.distances.new_full((rows,), NEVER)
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


class EventReasoner:
    """The trained networks as a `Reasoner`.

    Judges one board at a time, in one thread: networks so small gain nothing from more, which wait for each other.

    Args:
        network: trained.
        encoder: which features it was trained on.
        blur: looks so near each other are the same, in units of the smallest change (`LossConfig.blur`).
    """

    name = "event"

    def __init__(self, network: EventNet, encoder: str, blur: float = 0.5):
        self.network, self.encoder, self.blur = network.eval(), encoder, blur

    @threads(1)
    @torch.no_grad()
    def graph(self, seen: BoardSequence) -> InferredGraph:
        """Edge probabilities after each step, and before the first: the prior. Zeros but for candidates.

        A network without inference claims no relation.
        """
        beliefs = np.zeros((seen.steps + 1, *seen.candidates.shape))
        if not self.network.inference:
            return InferredGraph(self.name, beliefs[: max(1, seen.steps)])
        known = self._context_of(seen)
        tokens = known.edge_index.shape[1] * seen.steps * self.network.edges.width
        most = max(1, AT_ONCE // max(1, tokens, known.distances.numel()))
        for some in np.split(np.arange(len(beliefs)), range(most, len(beliefs), most)):
            told = self.network.log_edges(known.after_each(some))[0].exp().view(len(some), -1)
            beliefs[some[0] : some[-1] + 1, seen.candidates] = told.numpy()  # pairs stand in the candidates' order
        return InferredGraph(self.name, beliefs[1:] if seen.steps else beliefs, prior=beliefs[0])

    @threads(1)
    @torch.no_grad()
    def predict(self, seen: BoardSequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """Features after each of S steps, as `Reasoner.predict`: each is a copy, of the current ones or of earlier."""
        result = np.array(current, np.float32)
        responders = np.flatnonzero(seen.responders)
        if not len(responders) or not len(actions) or not seen.steps:
            return result
        known, log_edges = self._known(seen)
        looks = torch.from_numpy(np.ascontiguousarray(seen.features[:, responders].swapaxes(0, 1)))
        now = torch.from_numpy(np.ascontiguousarray(result[:, responders].swapaxes(0, 1)))
        asked = Queries(
            apart(now, looks) / self.network.scale,
            torch.from_numpy(np.asarray(actions, np.float32))[None],
            torch.from_numpy(trigger_rows(seen.triggers, np.asarray(acted, np.int64)))[None],
        )
        frame = likeliest_frames(self.network, known, asked, self.blur, log_edges).numpy()
        row, step = np.nonzero(frame >= 0)
        result[step, responders[row]] = seen.features[frame[row, step], responders[row]]
        return result

    @threads(1)
    @torch.no_grad()
    def what_if(self, seen: BoardSequence, steps: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """As `Imagining`: what `predict` would say, one action after the other. Each look is that of an observed frame,
        so that frames stand for looks, and how far they lie apart is known."""
        responders, result = np.flatnonzero(seen.responders), np.repeat(seen.features[steps, None], acted.shape[1], 1)
        if not (len(responders) and acted.size and seen.steps):
            return result
        on = trigger_rows(seen.triggers, np.asarray(acted, np.int64))
        done = torch.from_numpy(np.asarray(actions, np.float32)), torch.from_numpy(on)
        frames = self._frames_after(seen, torch.from_numpy(np.asarray(steps, np.int64)), *done)
        result[:, :, responders] = seen.features[frames.permute(1, 2, 0).numpy(), responders]
        return result

    def _frames_after(self, seen: BoardSequence, start: Tensor, actions: Tensor, acted: Tensor) -> Tensor:
        """The frames whose looks responders have after each of K actions in Q questions, int (R, Q, K).

        A responder copies a look only where its trigger was held (`LEAST_EDGE`). So each waits for its own steps alone:
        the first of every responder and question are worked out together, then the second, and so on.

        Args:
            start: int (Q,), the frames that questions begin with.
            actions: (Q, K, 6).
            acted: int (Q, K), rows of triggers.
        """
        known, log_edges = self._known(seen)
        done = Queries(known.distances[:, :0], actions.flatten(0, 1)[None], acted.view(1, -1))
        contacts = contacts_of(known, done.actions, done.acted)
        likely = (edges_of(known, done, log_edges) > LEAST_EDGE).view(-1, *acted.shape)  # (R, Q, K)
        turns = (likely.cumsum(2) * likely).flatten(1)  # (R, Q K): when a step is worked out, 0 for never
        frame = start.expand(len(likely), -1).clone()  # (R, Q)
        copied = torch.full_like(turns, -1)
        for turn in range(1, int(turns.max()) + 1):
            step = (turns == turn).any(0).nonzero()[:, 0]  # of all questions' steps
            question = step // acted.shape[1]
            current = known.distances.gather(
                1, frame[:, question, None].expand(-1, -1, known.distances.shape[2])
            )  # (R, steps, L + 1)
            asked = Queries(current, done.actions[:, step], done.acted[:, step])
            then = likeliest_frames(self.network, known, asked, self.blur, log_edges, contacts.part(step))
            row, column = ((turns[:, step] == turn) & (then >= 0)).nonzero(as_tuple=True)
            frame[row, question[column]] = copied[row, step[column]] = then[row, column]
        told = torch.cat([start[None, :, None].expand(len(likely), -1, 1), copied.view(likely.shape)], 2)
        last = torch.where(told >= 0, torch.arange(told.shape[2]), 0).cummax(2).values
        return told.gather(2, last)[..., 1:]

    def _known(self, seen: BoardSequence) -> tuple[Context, Tensor]:
        """What was seen, and `log_edges` of it; whoever asks for one step after the other asks about the same."""

        def known() -> tuple[Context, Tensor]:
            context = self._context_of(seen)
            return context, self.network.log_edges(context)[0]

        return seen.once((self, "known"), known)

    def _context_of(self, seen: BoardSequence) -> Context:
        return context_of(Batch.from_data_list([board_graph(seen)]), self.network.scale)


def likeliest_frames(
    network: EventNet,
    seen: Context,
    asked: Queries,
    blur: float,
    log_edges: Tensor | None = None,
    contacts: Contacts | None = None,
) -> Tensor:
    """The frame whose look every responder is likeliest to copy in every step, int (R, Q); -1 where it stays as it is.

    Args:
        blur: as of `EventReasoner`.
        log_edges: `network.log_edges(seen)`, if they are known already, (E,).
        contacts: of the steps asked for, if they are known already.
    """
    effects = network.effects(seen, asked, contacts)
    log_edges = network.log_edges(seen)[0] if log_edges is None else log_edges
    change = edges_of(seen, asked, log_edges) * torch.sigmoid(effects.change)
    if not effects.frames.shape[1]:
        return effects.frames.new_full(change.shape, -1)
    likely, best = (change.unsqueeze(-1) * _mass(effects, seen, blur)).max(-1)
    frame = effects.frames[:, None].expand(-1, change.shape[1], -1).gather(2, best.unsqueeze(-1))[..., 0]
    return torch.where(likely > 1 - change, frame, -1)


def edges_of(seen: Context, asked: Queries, log_edges: Tensor) -> Tensor:
    """How probable it is that the trigger held in each step controls each responder, (R, Q)."""
    trigger, row = seen.edge_index
    on = asked.acted[seen.board[row]] == trigger[:, None]  # (E, Q)
    return scatter(log_edges.exp()[:, None] * on, row, dim_size=len(seen.board), reduce="sum")


def _mass(effects: Effects, seen: Context, blur: float) -> Tensor:
    """Probability of the look of each candidate, (R, Q, 2K): candidates that look alike support each other."""
    frames = effects.frames
    rows = seen.distances.gather(1, frames[:, :, None].expand(-1, -1, seen.distances.shape[2]))
    between = rows.gather(2, frames[:, None].expand(-1, frames.shape[1], -1))  # (R, 2K, 2K)
    alike = torch.exp(-0.5 * (between / blur) ** 2)
    return torch.einsum("rqc,rcd->rqd", effects.choice[..., :-1].exp(), alike)
