"""Trains the `paper` model: one iteration, the schedule of all, and judgements (paper section 4.2, appendix A.1).

Inference and dynamics networks are trained together on the mean squared error of the features after each of the steps
that follow the observed frames; every step starts from its true features. Adam; an iteration whose loss explodes is
left out.

What the paper leaves open, and what is chosen here:

- The error is the mean over responders: triggers have no features to be predicted, vacant nodes have nothing.
- Every epoch shuffles the boards; its last batch holds what is left.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.reason.inputs.board_dataset import BoardDataset, batches_of, in_turn
from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.paper.config import PaperReasonConfig
from busybot.reason.models.paper.data import Boards, board_graph, read_batch
from busybot.reason.models.paper.networks import Network, Relations, network_of
from busybot.reason.models.paper.resident import ResidentBoards
from busybot.training.checkpoint import Checkpoint, drawing
from busybot.training.device import device, mixed, repeat_exactly
from busybot.training.loop import Learner, descend


@dataclass(frozen=True)
class IterationOutcome:
    """What an iteration did.

    Attributes:
        loss: error + prior_weight x divergence.
        error: mean squared error of the predicted features of responders.
        divergence: of the edges from the prior, nats, mean over pairs; 0 without a graph.
        taken: whether the weights were changed; False for a loss that exploded.
    """

    loss: float
    error: float
    divergence: float
    taken: bool


def make_network(config: PaperReasonConfig, seed: int) -> Network:
    """A network with weights drawn for this seed: as PyTorch draws them, but for those that embed actions, which are
    Xavier's normal with biases of 0, as in the authors' program."""
    with drawing(generator(seed, "train", 0, "initial weights/paper")):
        network = network_of(config)
        for layer in network.actions.modules():
            if isinstance(layer, nn.Linear):
                nn.init.xavier_normal_(layer.weight)
                nn.init.zeros_(layer.bias)
    return network


def make_optimizer(network: nn.Module, config: PaperReasonConfig) -> torch.optim.Optimizer:
    """Adam at the paper's learning rate."""
    return torch.optim.Adam(network.parameters(), lr=config.learning_rate)


def batches(boards: int, batch: int, seed: int, epoch: int) -> list[np.ndarray]:
    """Which boards each iteration of an epoch sees."""
    order = generator(seed, "train", epoch, "order/paper").permutation(boards)
    return [order[start : start + batch] for start in range(0, boards, batch)]


def iterate(
    network: Network,
    optimizer: torch.optim.Optimizer,
    boards: Boards,
    config: PaperReasonConfig,
    rng: np.random.Generator,
    last: float = np.inf,
) -> IterationOutcome:
    """One iteration.

    Args:
        rng: of this iteration alone; all its random numbers come from here.
        last: loss of the last iteration that was taken, infinite before the first one. It belongs to what a training
            must keep to go on exactly.

    Raises:
        BusybotError: the boards were watched for less than a step.
    """
    network.train()
    with drawing(rng):
        exponential = torch.empty(boards.edge_index.shape[1], 2).exponential_()
        noise = -exponential.log().to(boards.features)
        images = int(rng.choice(config.observed)) if config.observed else config.images
        error, divergence = losses(network, boards, config, noise, images, config.steps or None)
    loss = error + config.prior_weight * divergence
    taken = bool(loss < config.explosion * last)  # False for what is not a number, too
    if taken:
        descend(optimizer, loss)
    return IterationOutcome(float(loss.detach()), float(error.detach()), float(divergence.detach()), taken)


def losses(
    network: Network,
    boards: Boards,
    config: PaperReasonConfig,
    noise: Tensor | None = None,
    images: int | None = None,
    steps: int | None = None,
) -> tuple[Tensor, Tensor]:
    """Mean squared error of the responders' features, and the edges' divergence from the prior.

    Args:
        noise, steps: as of `PaperNetwork`.
        images: frames from which the graph is inferred; None for those of the configuration.
    """
    if not boards.steps:
        raise BusybotError("boards on which nothing was done", "train on datasets with recorded steps")
    images = min(images or config.images, boards.steps)
    on = boards.features.device
    with torch.autocast(on.type, torch.bfloat16) if config.bfloat16 else mixed(on):
        predicted, relations = network(boards, images, noise, steps)
    after = boards.predicted(images, steps)[1]
    error = functional.mse_loss(predicted[boards.responders].to(after), after[boards.responders])
    return error, divergence_from(relations, config.prior) if relations else torch.zeros_like(error)


def divergence_from(relations: Relations, prior: float) -> Tensor:
    """Kullback-Leibler divergence of the edges' types from the prior, nats, mean over pairs."""
    logs = relations.logits.float().log_softmax(-1)
    expected = logs.new_tensor([1 - prior, prior]).log()
    return (logs.exp() * (logs - expected)).sum(-1).mean()


class PaperLearner(Learner):
    """Boards are read when an iteration needs them.

    Args:
        boards: to train on.
        held_out: to judge by; the paper holds none out.
        resident: read all of them now, and keep them where the network is: a GPU does not wait for batches then.
    """

    name, leaves_out = "paper", True
    network: Network

    def __init__(
        self,
        config: PaperReasonConfig,
        boards: Sequence[BoardSequence],
        held_out: Sequence[BoardSequence],
        seed: int,
        resident: bool = False,
    ):
        torch.set_num_threads(config.threads)
        repeat_exactly()
        if not len(boards):
            raise BusybotError("no board to train on", "hold fewer out: --set loop.held_out=0")
        self.config, self.seed = config, seed
        graph = partial(board_graph, config=config.network)
        self.boards, self.held_out = BoardDataset(boards, graph), BoardDataset(held_out, graph)
        self.batches = math.ceil(len(boards) / config.batch)
        self.iterations = config.epochs * self.batches
        self.network = make_network(config, seed).to(device())
        self.optimizer = make_optimizer(self.network, config)
        self.last = math.inf
        parts = np.array_split(np.arange(len(boards)), self.batches)
        self.resident = ResidentBoards(map(self._read, parts)) if resident else None

    def _read(self, chosen: np.ndarray) -> Boards:
        """Boards as a batch, where the network is."""
        return read_batch(next(batches_of(self.boards, [chosen]))).to(device())

    def iterate(self, iteration: int) -> tuple[float, float]:
        """One iteration of the schedule: an epoch's next batch."""
        epoch, place = divmod(iteration, self.batches)
        chosen = batches(len(self.boards), self.config.batch, self.seed, epoch)[place]
        boards = self.resident.batch(chosen) if self.resident else self._read(chosen)
        rng = generator(self.seed, "train", iteration, "reason/paper")
        outcome = iterate(self.network, self.optimizer, boards, self.config, rng, self.last)
        if outcome.taken:
            self.last = outcome.loss
        return outcome.loss, self.config.learning_rate

    @torch.no_grad()
    def judge(self) -> Mapping[str, float]:
        """Mean squared error of the predictions, and that of predicting that nothing changes."""
        self.network.eval()
        sums, answers = np.zeros(2), 0
        for batch in batches_of(self.held_out, in_turn(len(self.held_out), self.config.batch, device())):
            boards = read_batch(batch).to(device())
            error, _ = losses(self.network, boards, self.config)
            frames, after = boards.predicted(min(self.config.images, boards.steps))
            still = (frames.states[..., : after.shape[-1]] - after)[boards.responders].square().mean()
            weight = int(boards.responders.sum())
            sums += weight * np.array([float(error), float(still)])
            answers += weight
        return dict(zip(("loss", "loss_of_no_change"), sums / answers, strict=True)) if answers else {}

    def state(self) -> Checkpoint:
        """The loss below twice of which the next one must stay."""
        return Checkpoint({}, {"last": None if math.isinf(self.last) else self.last})

    def restore(self, saved: Checkpoint) -> None:
        """Put back that loss."""
        last = saved.values["last"]
        self.last = math.inf if last is None else float(last)
