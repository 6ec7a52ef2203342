"""Trains the `mechanism` model, with the true parents of simulated boards as labels or from pictures alone.

*True parents* are those of simulated boards of the training split (amortised inference: Lorenz & others, AVICI, 2022);
with them it is told which way round links are (`known_links`).
*Pictures alone* tell, too: an explanation is as good after some actions as it foretells all that is seen later, while
it goes on learning. The network learns to know early which explanations will; no true relation or state is read.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits
from torch.utils.data import Dataset

from busybot.common.atomic_io import memory_on_disk
from busybot.common.errors import BusybotError
from busybot.common.process_pool import Progress
from busybot.common.rng import generator
from busybot.objects.resolve import find
from busybot.reason.inputs.board_dataset import RecordedBoards, batches_of, in_turn
from busybot.reason.models.mechanism.config import MechanismConfig
from busybot.reason.models.mechanism.networks import COUNTED, IMPOSSIBLE, MechanismNet, forbid, moments_of, world_number
from busybot.reason.models.mechanism.perception import perceive
from busybot.reason.models.mechanism.reasoner import MechanismReasoner
from busybot.reason.models.mechanism.training.known_links import KnownLinks
from busybot.reason.models.mechanism.training.labelled import LabelledTrace, draw_boards, labelled
from busybot.reason.models.mechanism.unseen import Touched
from busybot.reason.pyg import HeteroData, scatter
from busybot.training.checkpoint import initialise
from busybot.training.device import device, repeat_exactly
from busybot.training.loop import Learner, cosine_rate, descend

KNOWN = 6
"""What was counted of each board is kept after so many numbers of actions."""
SHELF = 2**26
"""Bytes of one file."""
JUDGED_AT_ONCE = 16
JUDGED_AFTER = (4, 10, 22, 30)
"""Held-out boards are judged after so many actions, or after all of them."""
ENDED = (0, 3, 6, 10, 16, 23, 30)
"""What links decide that nobody saw moving is learned from so many actions of each recording, as if it ended there:
what counts as a link is found in what was seen until then."""
MOST = 14.0
"""What was thought to be almost impossible costs no more than this, nats."""
FITS, DECAY = 100, 1e-4
"""Steps of a fit of two numbers, and weight of their distance from what changes nothing."""


def loss_of(net: MechanismNet, graph: HeteroData, rough: float, changes: float) -> Tensor:
    """Mean negative log probability of the responders' true parent sets, where some explanation reads them; without
    labels that of all that they showed later.

    Args:
        rough: weight of the same before messages were passed.
        changes: weight of the mean negative log probability of what is true of changes.
    """
    owner, node = graph["explanation", "explains", "responder"].edge_index[1], graph["explanation"]
    final, first, change = net(graph)
    if "right" not in node:
        return _surprise(final + node.later, owner).mean() + rough * _surprise(first + node.later, owner).mean()
    known = scatter(node.right.float(), owner, reduce="max") > 0
    right = torch.where(node.right, 0.0, IMPOSSIBLE)
    surprises = (_surprise(told + right, owner)[known].clamp(max=MOST) for told in (final, first))
    said, early = (each.sum() / max(1, len(each)) for each in surprises)
    loss = said + rough * early
    if change is None:
        return loss
    return loss + changes * binary_cross_entropy_with_logits(change, graph["responder"].changed.float())


def _surprise(logs: Tensor, owner: Tensor) -> Tensor:
    """Negative log of the sums over the explanations of each responder, (R, K)."""
    top = scatter(logs, owner, reduce="max").detach()
    return -(top + scatter((logs - top[owner]).exp(), owner, reduce="sum").log())


def mask_links(graph: HeteroData, share: float, rng: np.random.Generator) -> None:
    """Take all explanations that read any of so many of a batch's links, which are drawn, out of what is possible."""
    hidden = torch.from_numpy(rng.random(graph["input"].num_nodes) < share) & graph["input"].link
    forbid(graph, hidden[:, None])


@dataclass(frozen=True)
class GraphsByNumber(Dataset[HeteroData]):
    """Boards' graphs, made or looked up when a loader asks for them."""

    make: Callable[[int], HeteroData]

    def __getitem__(self, number: int) -> HeteroData:
        return self.make(number)


def logistic(said: Tensor, true: Tensor) -> tuple[float, float]:
    """By what to multiply log odds that were said, and what to add, to make what is true as probable as can be.

    Args:
        said: float (n,).
        true: float (n,), 0 or 1.
    """
    start = torch.tensor([1.0, 0.0])
    line = start.clone().requires_grad_()
    optimizer = torch.optim.LBFGS([line], max_iter=FITS, line_search_fn="strong_wolfe")

    def closure() -> Tensor:
        optimizer.zero_grad()
        loss = binary_cross_entropy_with_logits(line[0] * said + line[1], true) + DECAY * ((line - start) ** 2).sum()
        loss.backward()
        return loss

    optimizer.step(closure)
    scale, shift = line.tolist()
    return scale, shift


class Shelf:
    """Numbers in half precision in temporary files, which the system keeps in memory as long as nobody needs that."""

    def __init__(self) -> None:
        self._free = np.zeros(0, np.float16)

    def kept(self, values: Tensor) -> Tensor:
        """The same numbers, on the shelf."""
        flat = values.half().numpy().ravel()
        if len(self._free) < len(flat):
            self._free = np.frombuffer(memory_on_disk(max(SHELF, flat.nbytes)), np.float16)
        own, self._free = self._free[: len(flat)], self._free[len(flat) :]
        own[:] = flat
        return torch.from_numpy(own).view(values.shape)


class MechanismLearner(Learner):
    """One thread: sums have one order whatever the machine.

    Args:
        boards: to train on.
        held_out: to judge by.
    """

    name = "mechanism"
    learned_beside = "unseen.", "rising."
    network: MechanismNet

    def __init__(
        self, config: MechanismConfig, boards: Sequence[LabelledTrace], held_out: Sequence[LabelledTrace], seed: int
    ):
        torch.set_num_threads(1)
        repeat_exactly()
        if not len(boards):
            what = "no board is left to train on: none has responders and recorded steps"
            raise BusybotError(what, "train on boards with responders, recorded with collect")
        self.config, self.seed, self.iterations = config, seed, config.iterations
        self.boards, self.held_out = boards, held_out
        self._graphs: dict[int, HeteroData] = {}
        self._shelf = Shelf()
        self._judged: list[HeteroData] = []
        self.network = MechanismNet(config.net)
        draws = generator(seed, "train", 0, "initial weights/mechanism")
        initialise(self.network, torch.Generator().manual_seed(int(draws.integers(2**63))))
        self.network.to(device())
        self.optimizer = torch.optim.AdamW(
            self.network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay
        )

    def iterate(self, iteration: int) -> tuple[float, float]:
        """One step of the optimizer."""
        config, rng = self.config, generator(self.seed, "train", iteration, "reason/mechanism")
        chosen = rng.choice(len(self.boards), min(config.batch, len(self.boards)), replace=False)
        moments = torch.from_numpy(np.sort(rng.choice(KNOWN, min(config.moments, KNOWN), replace=False)))
        known = GraphsByNumber(lambda number: moments_of(self._known(number), moments))
        [graphs] = batches_of(known, [chosen.tolist()])
        told = torch.from_numpy(rng.random(len(chosen)) >= config.untold)
        graphs["board"].world = graphs["board"].world * told
        if config.labels == "pictures":
            mask_links(graphs, config.masked, rng)
        rate = cosine_rate(config.learning_rate, config.warm_up, iteration, config.iterations)
        self.network.train()
        loss = loss_of(self.network, graphs.to(device()), config.rough, config.changes)
        descend(self.optimizer, loss, rate, config.clip)
        return float(loss.detach()), rate

    def conclude(self) -> None:
        """Make what is said of changes as sure as it is right, and learn of links that nobody saw moving."""
        self._correct_changes()
        self._learn_unseen()

    def _correct_changes(self) -> None:
        """On the training's boards of worlds in which mechanisms change (Platt 1999). These are few: the training ends
        where the whole loss on held-out boards is least, wherever that leaves this part of it."""
        worlds = {board.world for board in self.boards if board.changed is not None and board.changed.any()}
        chosen = [number for number, board in enumerate(self.boards) if board.world in worlds]
        if not (chosen and self.config.net.changes):
            return
        said, true = [], []
        told = GraphsByNumber(lambda place: self._half_told(chosen[place]))
        for graphs in batches_of(told, in_turn(len(chosen), JUDGED_AT_ONCE, device())):
            with torch.no_grad():
                said.append(self.network(graphs.to(device()))[2].flatten().cpu())
            true.append(graphs["responder"].changed.float().flatten().cpu())
        self.network.correct_changes(*logistic(torch.cat(said), torch.cat(true)))

    def _half_told(self, number: int) -> HeteroData:
        """A board's graph after `KNOWN` numbers of actions; some are not told their world, as in training."""
        graph = moments_of(self._known(number), torch.arange(KNOWN))
        rng = generator(self.seed, "train", number, "reason/changes")
        graph["board"].world = graph["board"].world * int(rng.random() >= self.config.untold)
        return graph

    def _learn_unseen(self) -> None:
        """From the recorded boards."""
        if self.network.unseen is None:
            return
        reasoner, known, true = MechanismReasoner(self.network.cpu(), self.config.encoder), [], []
        for number, board in enumerate(self.boards):
            rng = generator(self.seed, "train", number, "reason/unseen")
            world = board.world if rng.random() >= self.config.untold else ""
            for part in board.triggers:
                end = [len(part.touched.acted)]
                touched = part.touched
                found, shares, _ = reasoner.explain(touched.trace, end, world, part.rising, touched.unsteady)
                pairs = touched.pairs(end, shares, found.inputs)
                known.append((pairs, world_number(self.config.net, world)))
                true.append(part.deciding[None])
        if known:
            self.network.unseen.learn(known, true)
        self.network.to(device())

    def _known(self, number: int) -> HeteroData:
        """A board's graph after `KNOWN` numbers of actions, counted once. They are spread evenly on a logarithmic
        scale: what to claim is hardest to tell when little was seen."""
        if number not in self._graphs:
            board, rng = self.boards[number], generator(self.seed, "train", number, "reason/mechanism/moments")
            drawn = (board.actions + 1) ** rng.random(KNOWN) - 0.5
            graph = self.graph(board, [int(each) for each in drawn])
            for kept, name in COUNTED:
                graph[kept][name] = self._shelf.kept(graph[kept][name])
            self._graphs[number] = graph
        return self._graphs[number]

    def graph(self, board: LabelledTrace, after: Sequence[int]) -> HeteroData:
        """A board's graph, with the world that is told."""
        return board.graph(after, world_number(self.config.net, board.world))

    @torch.no_grad()
    def judge(self) -> Mapping[str, float]:
        """Loss on held-out boards."""
        self.network.eval()
        self._judged = self._judged or [
            self.graph(board, [min(after, board.actions) for after in JUDGED_AFTER]) for board in self.held_out
        ]
        total, count = 0.0, 0
        for batch in batches_of(self._judged, in_turn(len(self._judged), JUDGED_AT_ONCE, device())):
            responders = int(batch["responder"].num_nodes)
            total += float(loss_of(self.network, batch.to(device()), 0.0, self.config.changes)) * responders
            count += responders
        return {"loss": total / count} if count else {}


def learner_of(
    config: MechanismConfig,
    boards: RecordedBoards,
    held_out: RecordedBoards,
    seed: int,
    progress: Progress | None = None,
) -> MechanismLearner:
    """A learner from recordings, with as many drawn boards of their worlds as the configuration asks for.

    Args:
        progress: is told of each recorded board that was looked at.
    """
    worlds = sorted({boards.episode(number).board.told_world for number in range(len(boards))} - {""})
    library, total = find("procedural"), len(boards) + len(held_out)
    told = progress or (lambda done, of: None)
    traces = list(_looked_at(boards, config, config.net.unseen, lambda done: told(done, total)))
    judged = list(_looked_at(held_out, config, False, lambda done: told(len(boards) + done, total)))
    for world in worlds if config.drawn and config.labels == "parents" else ():
        drawn = draw_boards(world, config.drawn, seed, library, config.actions, config.blur)
        traces += [trace for _, trace in drawn]
    if not config.net.rising:
        return MechanismLearner(config, traces, judged, seed)
    links = KnownLinks.of(traces, generator(seed, "train", 0, "reason/mechanism/known links"))
    purposes = "reason/mechanism/rising", "reason/mechanism/rising, held out"
    traces, judged = (
        [links.heard(one, generator(seed, "train", number, purpose)) for number, one in enumerate(each)]
        for each, purpose in zip((traces, judged), purposes, strict=True)
    )
    learner = MechanismLearner(config, traces, judged, seed)
    assert learner.network.rising is not None
    learner.network.rising.learn(links.forms, links.rises)
    return learner


def _looked_at(
    boards: RecordedBoards, config: MechanismConfig, parts: bool, progress: Callable[[int], None]
) -> Iterator[LabelledTrace]:
    """What pictures show of recorded boards; one on which nobody acted, or without responders, teaches nothing.

    Args:
        parts: look at what their first actions alone show, too; there are labels for that.

    Raises:
        BusybotError: labels are wanted that nobody has.
    """
    for number in range(len(boards)):
        sequence, episode = boards[number], boards.episode(number)
        if config.labels == "parents" and not episode.board.relations_known:
            what = f"{boards.file(number)}: nobody knows what controls what on this board"
            raise BusybotError(what, "train with --set labels=pictures, or on other datasets")
        if not sequence.steps or not sequence.responders.any():
            progress(number + 1)
            continue
        seen = perceive(sequence, config.encoder)
        ended = [sequence.first(actions + 1) for actions in ENDED if parts and actions <= sequence.steps]
        if config.labels == "pictures":
            yield LabelledTrace(seen.trace, sequence.world)
        else:
            yield labelled(episode, seen, [Touched.of(one, perceive(one, config.encoder)) for one in ended])
        progress(number + 1)
