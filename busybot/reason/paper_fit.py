"""Training of the `paper` model: one iteration, and the order of the boards (paper section 3.2, appendix A.1).

Inference and dynamics networks are trained together on the mean squared error of the features after each of the steps
that follow the observed frames; every step starts from its true features. Adam; an iteration whose loss explodes is
left out.

What the paper leaves open, and what is chosen here:

- The error is the mean over responders: triggers have no features to be predicted, vacant nodes have nothing.
- Every epoch shuffles the boards; its last batch holds what is left.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from busybot.errors import BusybotError
from busybot.reason.paper_boards import Boards
from busybot.reason.paper_config import PaperReasonConfig
from busybot.reason.paper_networks import PaperHistoryNetwork, PaperNetwork, Relations
from busybot.rng import generator
from busybot.training.loop import descend
from busybot.training.weights import drawing

Network = PaperNetwork | PaperHistoryNetwork


@dataclass(frozen=True)
class Outcome:
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
    """A network with weights drawn for this seed."""
    with drawing(generator(seed, "train", 0, "initial weights/paper")):
        return PaperNetwork(config.network) if config.inference else PaperHistoryNetwork(config.network)


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
) -> Outcome:
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
        error, divergence = losses(network, boards, config, noise)
    loss = error + config.prior_weight * divergence
    taken = bool(loss < config.explosion * last)  # False for what is not a number, too
    if taken:
        descend(optimizer, loss)
    return Outcome(float(loss.detach()), float(error.detach()), float(divergence.detach()), taken)


def losses(
    network: Network, boards: Boards, config: PaperReasonConfig, noise: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """Mean squared error of the responders' features, and the edges' divergence from the prior."""
    if not boards.steps:
        raise BusybotError("boards on which nothing was done", "train on datasets with recorded steps")
    images = min(config.images, boards.steps)
    with torch.autocast(boards.features.device.type, torch.bfloat16, enabled=config.bfloat16):
        predicted, relations = network(boards, images, noise)
    after = boards.predicted(images)[1]
    error = functional.mse_loss(predicted[boards.responders].to(after), after[boards.responders])
    return error, divergence_from(relations, config.prior) if relations else torch.zeros_like(error)


def divergence_from(relations: Relations, prior: float) -> Tensor:
    """Kullback-Leibler divergence of the edges' types from the prior, nats, mean over pairs."""
    logs = relations.logits.float().log_softmax(-1)
    expected = logs.new_tensor([1 - prior, prior]).log()
    return (logs.exp() * (logs - expected)).sum(-1).mean()
