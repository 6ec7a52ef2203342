"""The `mechanism` network: how probable each explanation of each responder is, at any time.

A graph of three kinds of nodes. An *explanation* of a responder (`contexts`) knows what was counted of it; a
*candidate* is a pair of an input and a responder; edges lead from each explanation to the candidates that it reads. Two
rounds of messages along them: candidates gather what their explanations say, weighted by how good they look, and hear
how much other responders seem to need the same input; explanations gather what their candidates say, and hear how all
responders of the board behave: where none has luck, or all come late, this one will not be otherwise. A softmax over
the explanations of a responder ends it: one of what explains it throughout, and one of what may explain it since a
change, weighed by how probable it is that its mechanism changed.

Letters: X explanations and C candidates of R responders of all boards, K moments.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import logsigmoid

from busybot.reason.models.mechanism.changes import KINDS as CHANGES
from busybot.reason.models.mechanism.changes import Changes, changes_of
from busybot.reason.models.mechanism.config import MechanismNetConfig
from busybot.reason.models.mechanism.contexts import INPUTS, MEMORIES, REMEMBERED, Trace, explanations_of, layout
from busybot.reason.models.mechanism.evidence import EVIDENCE, SCALE, WITNESSES, evidence_of
from busybot.reason.models.mechanism.rising import Rising, alike_of, explained, lawful, ways_of
from busybot.reason.models.mechanism.unseen import UnseenAlike, UnseenByWorld
from busybot.reason.models.message_passing import GraphModule
from busybot.reason.pyg import HeteroData, scatter

IMPOSSIBLE = -1e4
"""Logit of an explanation that a responder cannot have: one that reads itself."""
CERTAIN = 80.0
"""Log odds beyond it, of some hundreds of actions, are no more certain, and their exponentials no numbers."""


@dataclass(frozen=True)
class BoardFacts:
    """What is told of a board beside what was recorded of it.

    Attributes:
        world: number of its world, see `world_number`.
        rising: float (L,), log odds that the links' states are numbered as they rise; None if nobody knows.
        unsteady: whether the camera was not still.
    """

    world: int = 0
    rising: np.ndarray | None = None
    unsteady: bool = False

    def to(self, graph: HeteroData) -> None:
        """Put it into a board's graph."""
        graph["board"].world = torch.tensor([self.world])
        graph["board"].unsteady = torch.tensor([float(self.unsteady)])
        rising = torch.zeros(graph["input"].num_nodes)
        if self.rising is not None:
            rising[: len(self.rising)] = torch.from_numpy(self.rising).float()
        graph["input"].rising = rising


def explanation_graph(
    trace: Trace,
    after: Sequence[int],
    told: BoardFacts | None = None,
    parents: np.ndarray | None = None,
    changes: Changes | None = None,
) -> HeteroData:
    """One board after so many actions each of K moments; R responders, H explanations, I = L + R inputs.

    | nodes and edges | attribute | shape | meaning |
    |---|---|---|---|
    | `explanation` | `evidence` | float32 (R * H, K, 17) | `Evidence.explanations`, `Changes.since` / `SCALE`, and \
`alike_of` |
    | | `kind` | int64 (R * H,) | memory and number of inputs, see `KINDS` |
    | | `possible` | bool (R * H, K) | False where it reads its own responder |
    | | `right` | bool (R * H, K) | reads the true parents; with `parents` only |
    | `candidate` | `input` | int64 (R * I,) | number of the input, in all boards of a batch |
    | `responder` | `odds` | float32 (R, K, 3) | what speaks for a change of its mechanism, of `Changes` |
    | `input` | `rising` | float32 (I,) | log odds that a link's states are numbered as they rise, 0 for responders |
    | | `link` | bool (I,) | whether it is one |
    | `board` | `world` | int64 (1,) | which world is told, 0 for none |
    | | `unsteady` | float32 (1,) | 1 if the camera was not still |
    | `responder`, `lies on`, `board` | `edge_index` | int64 (2, R) | |
    | `explanation`, `reads`, `candidate` | `edge_index` | int64 (2, R * E) | |
    | | `witnesses` | float32 (R * E, K, 2) | `Evidence.inputs` |
    | | `ways` | int64 (R * E,) | of `ways_of` |
    | `explanation`, `explains`, `responder` | `edge_index` | int64 (2, R * H) | |
    | `candidate`, `moves`, `responder` | `edge_index` | int64 (2, R * I) | |

    Args:
        told: what is told beside the trace; nothing by default.
        parents: bool (K, I, R), the true parents at each moment.
        changes: of `changes_of` after as many actions each, if they are known already.
    """
    found, responders = explanations_of(trace), trace.responders.shape[1]
    graph = HeteroData()
    for kept, values in _structure(*(states.shape[1] for states in (trace.links, trace.responders))).items():
        for name, value in values.items():
            graph[kept][name] = value
    node, reads = graph["explanation"], graph["explanation", "reads", "candidate"]
    evidence, changes = evidence_of(trace, found, after), changes or changes_of(trace, found, after)
    since = torch.from_numpy(changes.since)[..., None] / SCALE
    node.evidence, reads.witnesses = (
        torch.cat([evidence.explanations, since, alike_of(trace, found, after)[..., None]], -1).flatten(0, 1),
        evidence.inputs.flatten(0, 1),
    )
    node.possible = node.possible[:, None].expand(-1, len(after))
    graph["responder"].odds = torch.from_numpy(changes.odds.transpose(1, 0, 2).copy())
    if parents is not None:
        right = (found.inputs[None, :, :, None] == parents[:, None]).all(2)  # (K, H, R)
        node.right = torch.from_numpy(right.transpose(2, 1, 0).reshape(responders * len(found.own), -1).copy())
    (told or BoardFacts()).to(graph)
    return graph


COUNTED: tuple[tuple[Any, str], ...] = (
    ("explanation", "evidence"),
    (("explanation", "reads", "candidate"), "witnesses"),
)
_OF_MOMENTS = (
    *COUNTED,
    *(("explanation", name) for name in ("possible", "right", "later")),
    *(("responder", name) for name in ("odds", "changed")),
)


def moments_of(graph: HeteroData, moments: Tensor) -> HeteroData:
    """A board's graph after some of its numbers of actions; what was counted as float32."""
    chosen = copy(graph)
    for kept, name in _OF_MOMENTS:
        if name in graph[kept]:
            told = graph[kept][name][:, moments]
            chosen[kept][name] = told.float() if (kept, name) in COUNTED else told
    return chosen


def forbid(graph: HeteroData, hidden: Tensor) -> None:
    """Take all explanations that read any of these inputs out of what is possible, in one board's graph or a batch.

    Args:
        hidden: bool (I, K), at which moments; or (I, 1), at all.
    """
    source, target = graph["explanation", "reads", "candidate"].edge_index
    read, node = graph["candidate", "is", "input"].edge_index[1][target], graph["explanation"]
    reads = scatter(hidden[read].float(), source, dim_size=node.num_nodes, reduce="max") > 0
    node.possible = node.possible & ~reads


@lru_cache(maxsize=64)
def _structure(links: int, responders: int) -> dict[Any, dict[str, Any]]:
    """What the graphs of boards with so many links and responders have in common; they share its tensors."""
    found = layout(links, responders)
    (count, inputs), owner = found.inputs.shape, torch.arange(responders)
    kind = torch.from_numpy(found.memory + len(MEMORIES) * found.inputs.sum(1))
    (row, read), each = found.reads, np.arange(responders)[:, None]
    edges = {
        ("explanation", "reads", "candidate"): torch.from_numpy(
            np.stack([(row + each * count).ravel(), (read + each * inputs).ravel()])
        )
    }
    ways = torch.from_numpy(ways_of(links, responders)).repeat(responders)
    for name, targets in (
        (("explanation", "explains", "responder"), owner.repeat_interleave(count)),
        (("candidate", "moves", "responder"), owner.repeat_interleave(inputs)),
        (("candidate", "is", "input"), torch.arange(inputs).repeat(responders)),
        (("responder", "lies on", "board"), torch.zeros_like(owner)),
    ):
        edges[name] = torch.stack([torch.arange(len(targets)), targets])
    sizes = {"explanation": responders * count, "candidate": responders * inputs, "responder": responders}
    nodes = {name: {"num_nodes": size} for name, size in {**sizes, "input": inputs, "board": 1}.items()}
    nodes["explanation"] |= {
        "kind": kind.repeat(responders),
        "possible": torch.from_numpy(~found.inputs[:, links:].T.copy()).flatten(),
    }
    nodes["input"] |= {"link": torch.arange(inputs) < links}
    told = {name: {"edge_index": edge} for name, edge in edges.items()}
    told["explanation", "reads", "candidate"]["ways"] = ways
    return {**nodes, **told}


KINDS = len(MEMORIES) * (INPUTS + 1)
"""Memories by number of inputs."""
RARER = -3.0
"""Log odds of explanations by three inputs to those by two of their family, which no training board tells."""
UNTRAINED = -1.0
"""Log odds of explanations that remember what only new kinds of mechanisms do, to others of their family. Chosen on 60
validation boards of `time` and 60 of new kinds that are in no frozen set: with less, too little is believed of known
kinds after few actions; with more, of new ones."""


def families() -> list[int]:
    """Of each of `KINDS` a number, the same where only how late inputs show differs, in which way presses count,
    whether it is their number or the time since, or whether inputs are two or three."""
    alike = [("since" if one.what == "odd" else one.what, one.delay > 0, one.own) for one in REMEMBERED]
    distinct = list(dict.fromkeys(alike))
    return [len(distinct) * min(inputs, 2) + distinct.index(one) for inputs in range(INPUTS + 1) for one in alike]


def rarer_kinds() -> list[float]:
    """Of each of `KINDS` its log odds to others of its family, as far as no training board tells them."""
    untrained = [UNTRAINED * (one.delay > 1 or one.what == "odd") for one in REMEMBERED]
    return [RARER * (inputs > 2) + own for inputs in range(INPUTS + 1) for own in untrained]


def world_number(config: MechanismNetConfig, name: str) -> int:
    """Of a world that may be told, 0 for others."""
    return config.worlds.index(name) + 1 if name in config.worlds else 0


def mlp(*widths: int) -> nn.Sequential:
    """Linear layers with ReLU between them."""
    layers: list[nn.Module] = []
    for before, after in zip(widths[:-1], widths[1:], strict=True):
        layers += [nn.Linear(before, after), nn.ReLU()]
    return nn.Sequential(*layers[:-1])


class Gather(GraphModule):
    """The weighted sum of what the sources of each node's edges say, and of what is known of the edges."""

    def forward(self, edges: Tensor, said: Tensor, known: Tensor, weights: Tensor, size: tuple[int, int]) -> Tensor:
        """(target nodes, K, width) of said (source nodes, K, width), known (edges, K, width) and weights (source
        nodes, K), one for all or each its own."""
        weights = weights[..., None].expand(len(said), -1, 1)
        return self.propagate(edges, said=(said, None), known=known, weight=(weights, None), size=size)

    def message(self, said_j: Tensor, known: Tensor, weight_j: Tensor) -> Tensor:
        return weight_j * torch.relu(said_j + known)


@dataclass(frozen=True)
class _Whose:
    """What belongs to what in a batch: X explanations, E inputs that they read, C candidates, R responders, B boards.

    Attributes:
        source, target: int64 (E,), the explanation that reads an input, and the candidate that it reads.
        owner: int64 (X,), the responder that an explanation explains.
        responder, input: int64 (C,), the responder that a candidate may move, and the input that it is.
        board: int64 (R,).
        world: int64 (R,), number of the world that is told.
        explanations, candidates, responders, inputs, boards: how many there are.
    """

    source: Tensor
    target: Tensor
    owner: Tensor
    responder: Tensor
    input: Tensor
    board: Tensor
    world: Tensor
    explanations: int
    candidates: int
    responders: int
    inputs: int
    boards: int

    @staticmethod
    def of(graph: HeteroData) -> "_Whose":
        """Of a batch of `explanation_graph`."""
        source, target = graph["explanation", "reads", "candidate"].edge_index
        board = graph["responder", "lies on", "board"].edge_index[1]
        return _Whose(
            source=source,
            target=target,
            owner=graph["explanation", "explains", "responder"].edge_index[1],
            responder=graph["candidate", "moves", "responder"].edge_index[1],
            input=graph["candidate", "is", "input"].edge_index[1],
            board=board,
            world=graph["board"].world[board],
            explanations=graph["explanation"].num_nodes,
            candidates=graph["candidate"].num_nodes,
            responders=graph["responder"].num_nodes,
            inputs=graph["input"].num_nodes,
            boards=graph["board"].num_nodes,
        )


class MechanismNet(nn.Module):
    """Log probabilities of explanations.

    Shapes:
        input: a batch of `explanation_graph`.
        output: (X, K); the same before messages were passed, which training holds near the truth, too; (R, K), log odds
            that another mechanism than at first decides a responder, None if it does not say so.
    """

    family: Tensor
    rarer: Tensor

    def __init__(self, config: MechanismNetConfig):
        super().__init__()
        self.config, width = config, config.width
        family = families() if config.families else list(range(KINDS))  # of each kind; each is its own otherwise
        self.register_buffer("family", torch.tensor(family), persistent=False)
        rarer = rarer_kinds() if config.families else [0.0] * KINDS
        self.register_buffer("rarer", torch.tensor(rarer), persistent=False)
        self.kind = nn.Linear(max(family) + 1, width, bias=False)
        heard = EVIDENCE + 1 + config.rising
        self.evidence = nn.Linear(heard, width)
        self.token = nn.Sequential(nn.ReLU(), nn.Linear(width, width), nn.ReLU(), nn.Linear(width, width))
        self.rough = nn.Linear(width, 1)
        self.sharpness = nn.Parameter(torch.tensor(0.6 * SCALE))
        self.straight = nn.Linear(heard, 1, bias=False)
        self.witnesses = nn.Linear(WITNESSES, 3 * width)
        self.candidate = mlp(2 * width + 2, width, width)
        self.board = mlp(width, width, width)
        self.final = mlp(4 * width, width, 1)
        self.world = nn.Linear(len(config.worlds) + 1, width, bias=False)
        self.unsteady = nn.Linear(1, width, bias=False) if config.unsteady else None
        self.prior = nn.Linear(max(family) + 1, len(config.worlds) + 1, bias=False)
        odds = 2 * len(CHANGES) * (1 + config.unsteady) + config.unsteady
        self.change, self.odds = mlp(2 * width + odds, width, 1), nn.Linear(odds, 1, bias=False)
        self.anew = nn.Linear(width, 1)
        self.gather = Gather()
        # learned afterwards, see there
        unseen = UnseenByWorld if config.apart else UnseenAlike
        self.unseen = unseen(len(config.worlds)) if config.unseen else None
        self.rising = Rising() if config.rising else None  # learned before all else

    def forward(self, graph: HeteroData) -> tuple[Tensor, Tensor, Tensor | None]:
        """See above."""
        whose, node = _Whose.of(graph), graph["explanation"]
        matters, there, back = self.witnesses(graph["explanation", "reads", "candidate"].witnesses).chunk(3, -1)
        kind = self.family[node.kind]
        prior = (SCALE * self.prior.weight[whose.world[whose.owner], kind] + self.rarer[node.kind])[:, None]
        evidence = self._evidence(graph, whose, prior)
        token = self._tokens(graph, whose, kind, evidence, matters)
        rough = prior + (self.rough(token) + self.straight(evidence))[..., 0]
        first = self._shares(rough + self.sharpness * node.evidence[..., 0], node, whose.owner)
        weight = first.exp()
        summary = scatter(weight[..., None] * token, whose.owner, dim_size=whose.responders, reduce="sum")
        board = scatter(self.board(summary), whose.board, dim_size=whose.boards, reduce="mean")
        around = torch.cat([summary, board[whose.board]], -1)  # (R, K, 2 width)
        said = self._messages(whose, token, weight, summary, there, back)
        logits = first + self.final(torch.cat([token, said, around[whose.owner]], -1))[..., 0]
        shares = self._shares(logits, node, whose.owner)
        if not self.config.changes:
            return shares, first, None
        change = self._change(graph, whose, around)
        anew = prior + self.anew(token)[..., 0] + self.sharpness * node.evidence[..., EVIDENCE]
        anew = self._shares(anew, node, whose.owner)
        told = shares + logsigmoid(-change)[whose.owner], anew + logsigmoid(change)[whose.owner]
        return torch.logaddexp(*told), first, change

    def _evidence(self, graph: HeteroData, whose: "_Whose", prior: Tensor) -> Tensor:
        """What was counted of the explanations, (X, K, EVIDENCE + 1), and, if the network hears it, how much more
        probable they are for which way round links seem to be."""
        node = graph["explanation"]
        told = node.evidence[..., :-1]
        if not self.config.rising:
            return torch.as_tensor(told)
        read, ways = whose.input[whose.target], graph["explanation", "reads", "candidate"].ways
        ratio = explained(graph["input"].rising, read, whose.source, ways, node.evidence[..., -1])
        counted = self._shares(prior + self.sharpness * node.evidence[..., 0], node, whose.owner)
        rising = lawful(ratio, counted.detach().exp(), whose.owner, whose.board, whose.boards)
        return torch.cat([told, rising[..., None]], -1)

    def _tokens(self, graph: HeteroData, whose: "_Whose", kind: Tensor, evidence: Tensor, matters: Tensor) -> Tensor:
        """What is known of each explanation by itself, (X, K, width): its kind, the board, what was counted of it, and
        of the inputs that it reads."""
        known = self.kind.weight.T[kind] + self.world.weight.T[whose.world[whose.owner]]
        if self.unsteady is not None:
            known = known + self.unsteady(graph["board"].unsteady[whose.board][whose.owner, None])
        mattering = scatter(matters.relu(), whose.source, dim_size=whose.explanations, reduce="sum")
        return torch.as_tensor(self.token(self.evidence(evidence) + known[:, None] + mattering))

    def _messages(
        self, whose: "_Whose", token: Tensor, weight: Tensor, summary: Tensor, there: Tensor, back: Tensor
    ) -> Tensor:
        """What each explanation hears of the inputs that it reads, (X, K, width): who else needs them, for this
        responder and for others.

        Args:
            token: (X, K, width), of explanations.
            weight: (X, K), how probable each seems by itself.
            summary: (R, K, width), of responders.
            there, back: (E, width), of what inputs were seen to do, on the way to them and back.
        """
        edges = torch.stack([whose.source, whose.target])
        size = whose.explanations, whose.candidates
        heard = self.gather(edges, token, there, weight, size)
        needed = scatter(weight[whose.source], whose.target, dim_size=whose.candidates, reduce="sum")[..., None]
        others = scatter(needed, whose.input, dim_size=whose.inputs, reduce="sum")[whose.input] - needed
        told = torch.cat([heard / (needed + 1e-3), summary[whose.responder], needed, others], -1)
        share = 1 / scatter(torch.ones_like(whose.source), whose.source, dim_size=whose.explanations).clamp(min=1)
        said = self.gather(edges.flip(0), self.candidate(told), back, needed.new_ones(1, 1), size[::-1])
        return torch.as_tensor(share[:, None, None] * said)

    def _change(self, graph: HeteroData, whose: "_Whose", around: Tensor) -> Tensor:
        """Log odds that another mechanism than at first decides a responder, (R, K)."""
        odds = graph["responder"].odds.clamp(max=CERTAIN)
        rivals = scatter(odds.exp(), whose.board, dim_size=whose.boards, reduce="sum")[whose.board].log()
        told = torch.cat([odds, rivals], -1) / SCALE
        if self.config.unsteady:  # before such a camera much looks like a change that is none
            unsteady = graph["board"].unsteady[whose.board][:, None, None]
            told = torch.cat([told * (1 - unsteady), told * unsteady, unsteady.expand(-1, told.shape[1], 1)], -1)
        return torch.as_tensor((self.change(torch.cat([around, told], -1)) + self.odds(told))[..., 0])

    @torch.no_grad()
    def correct_changes(self, scale: float, shift: float) -> None:
        """Put `scale` times what was said of changes, and `shift` more, in its place: log odds."""
        last = self.change[-1]
        assert isinstance(last, nn.Linear)
        for weights in (last.weight, last.bias, self.odds.weight):
            weights.mul_(scale)
        last.bias.add_(shift)

    def _shares(self, logits: Tensor, node: HeteroData, owner: Tensor) -> Tensor:
        """Log softmax over the explanations of each responder."""
        logits = logits.masked_fill(~node.possible, IMPOSSIBLE)
        top = scatter(logits, owner, reduce="max").detach()[owner]
        total = scatter((logits - top).exp(), owner, reduce="sum")[owner]
        return logits - top - total.log()


def parents_of(log_shares: Tensor, graph: HeteroData) -> Tensor:
    """Probability that an input is a parent, (C, K) for candidates."""
    source, target = graph["explanation", "reads", "candidate"].edge_index
    return scatter(log_shares.exp()[source], target, dim_size=graph["candidate"].num_nodes, reduce="sum")
