"""What the training loop asks of the `paper` model: the schedule of its iterations, and its judgements."""

import math
from collections.abc import Mapping
from functools import partial

import numpy as np
import torch

from busybot.errors import BusybotError
from busybot.reason.board_dataset import BoardDataset, BoardSource, batches_of, in_turn
from busybot.reason.paper_boards import board_graph, read_batch
from busybot.reason.paper_config import PaperReasonConfig
from busybot.reason.paper_fit import Network, batches, iterate, losses, make_network, make_optimizer
from busybot.reason.sequence import Sequence
from busybot.rng import generator
from busybot.training.checkpoint import Checkpoint
from busybot.training.device import device, repeat_exactly
from busybot.training.loop import Learner


class PaperLearner(Learner):
    """Boards are read when an iteration needs them.

    Args:
        boards: to train on.
        held_out: to judge by; the paper holds none out.
    """

    name = "paper"
    network: Network

    def __init__(
        self, config: PaperReasonConfig, boards: BoardSource[Sequence], held_out: BoardSource[Sequence], seed: int
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

    def iterate(self, iteration: int) -> tuple[float, float]:
        """One iteration of the schedule: an epoch's next batch."""
        epoch, place = divmod(iteration, self.batches)
        chosen = batches(len(self.boards), self.config.batch, self.seed, epoch)[place]
        boards = read_batch(next(batches_of(self.boards, [chosen]))).to(device())
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
        for batch in batches_of(self.held_out, in_turn(len(self.held_out), self.config.batch)):
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
