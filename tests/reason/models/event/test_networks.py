"""The event model's networks: shapes, orders that must not matter, and attention along edges as it is on arrays."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor
from torch_geometric.data import Batch
from torch_geometric.utils import scatter

from busybot.reason.models.event.config import EventNetConfig
from busybot.reason.models.event.data import (
    FAR,
    NEAR,
    Context,
    ObservedOutcome,
    Queries,
    board_graph,
    changed,
    contacts_of,
    context_of,
    padded,
    past_facts,
    split,
)
from busybot.reason.models.event.networks import NEVER, UNSEEN, EventNet
from tests.reason.boards import Board, make_boards

CONFIG = EventNetConfig(width=8, heads=3)
KNOWN, ASKED = 14, 5


def trained(config: EventNetConfig = CONFIG) -> EventNet:
    """A network none of whose weights is zero."""
    torch.manual_seed(0)
    network = EventNet(config, 3.0).double()
    for parameter in network.parameters():
        if parameter.dim():
            torch.nn.init.normal_(parameter, std=0.3)
    return network


def questions(boards: list[Board]) -> tuple[Context, Queries, ObservedOutcome]:
    batch = Batch.from_data_list(padded(board_graph(board.seen) for board in boards))
    seen = context_of(batch, 3.0)
    as_double = {name: getattr(seen, name).double() for name in ("distances", "actions", "pos")}
    return split(Context(**{**vars(seen), **as_double}), KNOWN, ASKED)


def mixed() -> list[Board]:
    """Boards of different sizes; one of them was watched for fewer steps than are known of the others."""
    return [*make_boards(2, 1, steps=20), *make_boards(1, 2, triggers=4, responders=9, steps=9)]


def seen_by(board: Board, unsteady: bool, hidden: slice) -> Board:
    """The board as a camera sees it that is not still, or that is, with the first responder behind a hand meanwhile."""
    features = board.seen.features.copy()
    responders = np.flatnonzero(board.seen.responders)
    if unsteady:
        noise = np.random.default_rng(0).normal(0, 0.02, features[:, responders].shape)
        features[:, responders] += noise.astype(np.float32)
    features[hidden, responders[0]] = features[hidden.start - 1, responders[0]]
    return replace(board, seen=replace(board.seen, features=features))


def test_what_a_hand_hides_tells_no_edge() -> None:
    """Whether a responder looks otherwise when the hand has gone says nothing of what was touched then."""
    (board,), hidden = make_boards(1, 3, steps=24), slice(9, 12)
    told = []
    for look in (0.0, 5.0):
        moved = seen_by(board, True, hidden)
        moved.seen.features[hidden.stop :, np.flatnonzero(board.seen.responders)[0]] += look
        seen, _, _ = questions([moved])
        told.append((seen.shown[0], trained().log_edges(seen)[0][seen.edge_index[1] == 0]))
    assert (~told[0][0]).nonzero()[:, 0].tolist() == [8, 9, 10, 11]
    torch.testing.assert_close(told[0][1], told[1][1], atol=1e-3, rtol=0)


def test_who_has_no_box_does_not_tell_that_the_camera_was_still() -> None:
    """An object of which no look is known looks alike in all frames, whatever the camera."""
    (board,), hidden = make_boards(1, 3, responders=3, steps=24), slice(9, 12)
    moved = seen_by(board, True, hidden)
    moved.seen.features[:, np.flatnonzero(board.seen.responders)[1:]] = 0
    shown = questions([moved])[0].shown
    assert (~shown[0]).nonzero()[:, 0].tolist() == [8, 9, 10, 11] and bool(shown[1:].all())


def test_a_still_camera_hides_nothing() -> None:
    """Equal looks are then what nothing changed."""
    (board,) = make_boards(1, 3, steps=24)
    assert bool(questions([seen_by(board, False, slice(9, 12))])[0].shown.all())
    assert bool(questions([seen_by(board, True, slice(1, 1))])[0].shown.all())


def attention_on_arrays(network: EventNet, seen: Context, asked: Queries) -> Tensor:
    """Logits of change (R, Q) as `EffectHead` has them, with an axis of all known steps and a mask."""
    head, contacts, sizes, board = (
        network.effects,
        contacts_of(seen, asked.actions, asked.acted),
        seen.sizes,
        seen.board,
    )
    largest = scatter(sizes, board, dim_size=len(seen.actions), reduce="max")[board]
    change = torch.stack([changed(sizes), changed(largest)], -1)[:, None].expand(-1, asked.current.shape[1], -1, -1)
    facts = past_facts(change, torch.stack([asked.current[..., :-1], asked.current[..., 1:]], -1))
    tokens = head.token(head.place(contacts.facts)[board] + head.past(facts))  # (R, Q, L, width)
    did, worked = change.unbind(-1)
    nearness = 4 * worked - contacts.distance[board].clamp(max=FAR) / NEAR[0]
    logits = head.attend(tokens) + head.sharpness * nearness[..., None]
    usable = contacts.same[board][..., None]
    weights = torch.softmax(logits.masked_fill(~usable, NEVER), 2) * usable
    pooled = torch.einsum("rqlh,rqlw->rqhw", weights, torch.cat([tokens, did[..., None]], -1))
    fit = head._choice(seen, asked, contacts)[2]
    inputs = torch.cat([pooled.flatten(2), contacts.step[board], fit[..., None]], -1)
    learnt = head.trust * (2 * pooled[..., 0, -1] - 1) + head.change(inputs)[..., 0]
    return torch.where(((did > 0.5) & usable[..., 0]).any(-1), learnt, UNSEEN)


def test_attention_along_edges_is_attention_on_arrays() -> None:
    network, (seen, asked, _) = trained(), questions(mixed())
    results = []
    for compute in (lambda: network.effects(seen, asked).change, lambda: attention_on_arrays(network, seen, asked)):
        network.zero_grad()
        change = compute()
        change.sin().sum().backward()
        gradients = {n: p.grad.clone() for n, p in network.effects.named_parameters() if p.grad is not None}
        results.append((change.detach(), gradients))
    (one, gradients), (other, expected) = results
    assert (one == UNSEEN).any() and (one != UNSEEN).sum() > 10
    torch.testing.assert_close(one, other, rtol=1e-10, atol=1e-12)
    torch.testing.assert_close(gradients, expected, rtol=1e-8, atol=1e-10)
    assert {n.split(".")[0] for n in gradients} >= {"place", "past", "token", "attend", "change", "sharpness", "trust"}


def test_shapes() -> None:
    network, (seen, asked, _) = trained(), questions(mixed())
    rows = sum(int(board.seen.responders.sum()) for board in mixed())
    edges = sum(int(board.seen.candidates.sum()) for board in mixed())
    effects = network.effects(seen, asked)
    choices = effects.frames.shape[1]
    assert effects.change.shape == (rows, ASKED) and effects.choice.shape == (rows, ASKED, choices + 1)
    assert effects.frames.min() >= 0 and effects.frames.max() <= KNOWN
    torch.testing.assert_close(effects.choice.exp().sum(-1), torch.ones(rows, ASKED, dtype=torch.float64))
    log_edges, log_none = network.log_edges(seen)
    assert log_edges.shape == (edges,) and log_none.shape == (rows,)
    total = scatter(log_edges.exp(), seen.edge_index[1], dim_size=rows, reduce="sum") + log_none.exp()
    torch.testing.assert_close(total, torch.ones_like(total))


@pytest.mark.parametrize("exclusive", [True, False])
def test_a_board_is_judged_alike_alone_and_among_others_in_any_order(exclusive: bool) -> None:
    network, boards = trained(EventNetConfig(width=8, heads=3, exclusive=exclusive)), make_boards(3, 1, steps=20)
    alone = [(network.log_edges(s)[0], network.effects(s, a).change) for s, a, _ in (questions([b]) for b in boards)]
    for order in ([0, 1, 2], [2, 0, 1]):
        seen, asked, _ = questions([boards[number] for number in order])
        log_edges, change = network.log_edges(seen)[0], network.effects(seen, asked).change
        torch.testing.assert_close(log_edges, torch.cat([alone[number][0] for number in order]))
        torch.testing.assert_close(change, torch.cat([alone[number][1] for number in order]))


def test_what_was_not_recorded_does_not_matter() -> None:
    """Steps that only fill up, whatever they hold."""
    network, board = trained(), make_boards(1, 4, steps=9)[0]
    short = padded([board_graph(board.seen), board_graph(make_boards(1, 5, steps=30)[0].seen)])[0]
    results = []
    for filling in (0.0, 7.0):
        graph = short.clone()
        graph["step"].action[9:] = filling
        graph["responder"].distances[:, 10:] = filling
        seen = context_of(Batch.from_data_list([graph]), 3.0)
        results.append(network.float().log_edges(seen)[0])
    assert torch.equal(*results)
