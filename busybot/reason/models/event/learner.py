"""Trains the `event` model. Neither relations nor states are known to it: it learns from what happened next.

Its loss is the likelihood of what happened, by its two stages and the edges. After a step a responder looks as before,
or, if its trigger was acted on, as before or after a past change of it, or like nothing seen yet. Around each known
look there is a bell, so a step has a likelihood; a responder's steps together have one for each possible trigger, and
the edge probabilities weigh those. The sum over triggers is exact: they are few, so no edges need be drawn (Gumbel) as
in the paper.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.reason.inputs.board_dataset import BoardDataset, batches_of, in_turn
from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.event.config import EventConfig, LossConfig
from busybot.reason.models.event.data import Context, ObservedOutcome, Queries, board_graph, context_of, padded, split
from busybot.reason.models.event.networks import Effects, EventNet, likeliest_frames, log_sum
from busybot.reason.pyg import HeteroData, scatter
from busybot.training.checkpoint import initialise
from busybot.training.device import device, repeat_exactly
from busybot.training.loop import Learner, cosine_rate, descend


def loss_of(
    net: EventNet, seen: Context, asked: Queries, outcome: ObservedOutcome, config: LossConfig
) -> tuple[Tensor, Tensor]:
    """Loss of the steps asked for, given the known ones.

    Returns:
        what is minimised, and the part of it that is the mean negative log likelihood of a responder's step; scalars.
    """
    log_edges, log_none = net.log_edges(seen)
    controlled, idle = log_likelihoods(net.effects(seen, asked), outcome, config)  # (R, Q) each
    real = outcome.real
    trigger, row = seen.edge_index
    on = (asked.acted[seen.board[row]] == trigger[:, None]) & real[row]  # (E, Q)
    gain = ((controlled - idle)[row] * on).sum(1)
    if net.exclusive:
        explained = log_sum(log_edges + gain, log_none, row)
    else:
        mixed = torch.logaddexp(log_edges + gain, log_not(log_edges))
        explained = scatter(mixed, row, dim_size=len(seen.board), reduce="sum")
    surprise = -((idle * real).sum() + explained.sum()) / real.sum().clamp(min=1)
    apart = divergence(log_edges, log_none, row, config.prior, net.exclusive)
    return surprise + config.divergence * apart, surprise


def log_likelihoods(effects: Effects, outcome: ObservedOutcome, config: LossConfig) -> tuple[Tensor, Tensor]:
    """Of what each responder looks like afterwards, (R, Q): if its trigger was acted on, and if not."""

    def bell(distance: Tensor) -> Tensor:
        return torch.exp(-0.5 * (distance / config.blur) ** 2)

    stayed = bell(outcome.moved)
    copies = bell(outcome.look.gather(2, effects.frames[:, None].expand(-1, outcome.look.shape[1], -1)))
    choice = torch.exp(effects.choice)
    became = (choice[..., :-1] * copies).sum(-1) + choice[..., -1] * config.unknown
    change = torch.sigmoid(effects.change)
    controlled = (1 - change) * stayed + change * became
    return _log(controlled, config.floor), _log(stayed, config.floor)


def _log(likelihood: Tensor, floor: float) -> Tensor:
    return torch.log(floor + (1 - floor) * likelihood)


def log_not(log_probability: Tensor) -> Tensor:
    """log(1 - p) for log p <= 0."""
    return torch.log(-torch.expm1(log_probability.clamp(max=-1e-6)))


def divergence(log_edges: Tensor, log_none: Tensor, row: Tensor, prior: float, exclusive: bool) -> Tensor:
    """Kullback-Leibler divergence of the edges (E,) from edges of probability `prior` each, mean over responders (R,).

    For exclusive edges the odds of each against "no trigger" are those of the prior.
    """
    odds = torch.logit(log_edges.new_tensor(prior)).expand_as(log_edges)
    if exclusive:
        none = -log_sum(odds, torch.zeros_like(log_none), row)
        per_pair = log_edges.exp() * (log_edges - odds - none[row])
        per_row = log_none.exp() * (log_none - none)
    else:
        absent = log_not(log_edges)
        present = log_edges.exp() * (log_edges - functional.logsigmoid(odds))
        per_pair = present + absent.exp() * (absent - functional.logsigmoid(-odds))
        per_row = torch.zeros_like(log_none)
    return (scatter(per_pair, row, dim_size=len(log_none), reduce="sum") + per_row).mean()


JUDGED_AT_ONCE = 64
BINS = 100


class EventLearner(Learner):
    """One thread: sums have one order whatever the machine.

    Args:
        boards: to train on.
        held_out: to judge by.
    """

    name = "event"
    network: EventNet

    def __init__(
        self, config: EventConfig, boards: Iterable[BoardSequence], held_out: Iterable[BoardSequence], seed: int
    ):
        torch.set_num_threads(1)
        repeat_exactly()
        self.config, self.seed, self.iterations = config, seed, config.iterations
        self.boards = BoardDataset(padded(board_graph(board) for board in boards))
        self.held_out = BoardDataset(padded(board_graph(board) for board in held_out))
        if not any(int(board["step"].known.sum()) > 1 for board in self.boards):
            raise BusybotError("no board on which two steps were recorded", "train on datasets with more steps")
        self.network = EventNet(config.net, smallest_change(self.boards))
        draws = generator(seed, "train", 0, "initial weights/event")
        initialise(self.network, torch.Generator().manual_seed(int(draws.integers(2**63))))
        self.network.effects.start_as_lookup()
        self.network.to(device())
        self.optimizer = torch.optim.AdamW(
            self.network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay
        )

    def iterate(self, iteration: int) -> tuple[float, float]:
        """One step of the optimizer."""
        config = self.config
        rng = generator(self.seed, "train", iteration, "reason/event")
        chosen = rng.choice(len(self.boards), min(config.batch, len(self.boards)), replace=False)
        everything = context_of(next(batches_of(self.boards, [chosen])).to(device()), self.network.scale)
        everything = _noisy(everything, config.noise, rng)
        seen, asked, outcome = split(everything, self._images(everything, rng) - 1, config.questions)
        rate = cosine_rate(config.learning_rate, config.warm_up, iteration, self.iterations)
        self.network.train()
        loss, _ = loss_of(self.network, seen, asked, outcome, config.loss)
        descend(self.optimizer, loss, rate, config.clip)
        return float(loss.detach()), rate

    def _images(self, seen: Context, rng: np.random.Generator) -> int:
        """How many images are seen; at least one step remains to be predicted.

        Drawn numbers are spread evenly on a logarithmic scale: what to claim is hardest to tell when little was seen.
        """
        longest = seen.actions.shape[1]
        usual, drawn = min(self.config.images, longest), int(2 * ((longest + 1) / 2) ** rng.random())
        return usual if rng.random() < 0.5 else drawn

    @torch.no_grad()
    def judge(self) -> Mapping[str, float]:
        """Loss, and shares of steps in which all responders look as predicted, also of steps that changed something."""
        self.network.eval()
        totals = np.zeros(6)
        for batch in batches_of(self.held_out, in_turn(len(self.held_out), JUDGED_AT_ONCE, device())):
            everything = context_of(batch.to(device()), self.network.scale)
            steps = min(self.config.images, everything.actions.shape[1]) - 1
            if steps < 1:  # nothing is known before the first step
                continue
            seen, asked, outcome = split(everything, steps, self.config.questions)
            answers = float(outcome.real.sum())
            surprise = float(loss_of(self.network, seen, asked, outcome, self.config.loss)[1])
            right, changed = _right(self.network, seen, asked, outcome, self.config.loss.blur)
            real = scatter(outcome.real.float(), seen.board, dim_size=len(right), reduce="max") > 0
            counts = (real, right & real, changed, right & changed)
            totals += [surprise * answers, answers, *(float(count.sum()) for count in counts)]
        surprise, answers, judged, right_steps, changes, right_changes = totals.tolist()
        if not judged:
            return {}
        figures = {"loss": surprise / answers, "right": right_steps / judged}
        return figures | ({"right_changes": right_changes / changes} if changes else {})


def _noisy(seen: Context, most: float, rng: np.random.Generator) -> Context:
    """Looks of different frames lie farther apart, as independent noise in all frames would have them."""
    level = torch.from_numpy(rng.uniform(0, most, (len(seen.board), 1, 1)).astype(np.float32)).to(seen.distances)
    between = 1 - torch.eye(seen.distances.shape[1], device=level.device)
    return replace(seen, distances=torch.sqrt(seen.distances**2 + level**2 * between))


def _right(
    network: EventNet, seen: Context, asked: Queries, outcome: ObservedOutcome, blur: float
) -> tuple[Tensor, Tensor]:
    """Whether all responders of a board that were seen look as predicted, and whether any changed, bool (B, Q)."""
    frame = likeliest_frames(network, seen, asked, blur)
    copied = outcome.look.gather(2, frame.clamp(min=0).unsqueeze(-1))[..., 0]
    error = torch.where(frame >= 0, copied, outcome.moved)
    boards = len(seen.actions)
    worst = scatter(error * outcome.real, seen.board, dim_size=boards, reduce="max")
    moved = scatter(outcome.moved * outcome.real, seen.board, dim_size=boards, reduce="max")
    return worst < 1, moved > 1


def smallest_change(boards: Iterable[HeteroData]) -> float:
    """The distance between looks that parts changes from noise: the threshold that splits the logarithms of all steps'
    distances into the two groups of least variance (Otsu's method), without labels.

    Raises:
        BusybotError: nothing ever changes.
    """
    moved = [board["responder"].distances.diagonal(offset=1, dim1=1, dim2=2) for board in boards]
    sizes = np.concatenate([np.asarray(each).ravel() for each in moved])
    largest = float(sizes.max(initial=0))
    if largest <= 0:
        raise BusybotError("no responder ever changes its look", "train on boards on which something was moved")
    logs = np.log(np.maximum(sizes, 1e-2 * largest))
    counts, ends = np.histogram(logs, BINS)
    middles = (ends[1:] + ends[:-1]) / 2
    below = np.cumsum(counts)[:-1]
    above = len(logs) - below
    total = np.cumsum(counts * middles)
    with np.errstate(invalid="ignore", divide="ignore"):
        between = np.nan_to_num(below * above * (total[:-1] / below - (total[-1] - total[:-1]) / above) ** 2)
    best = np.flatnonzero(between >= between.max() * (1 - 1e-9))
    return float(np.exp(ends[1:-1][best].mean()))
