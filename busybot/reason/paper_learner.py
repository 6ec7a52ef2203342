"""A training of the `paper` model that can be stopped after any iteration and goes on exactly where it was."""

import math
from collections.abc import Sequence as Several
from pathlib import Path

import numpy as np

from busybot.reason.paper_boards import boards_of
from busybot.reason.paper_config import PaperReasonConfig
from busybot.reason.paper_fit import Outcome, batches, iterate, make_network, make_optimizer
from busybot.reason.paper_history import PaperHistoryReasoner
from busybot.reason.paper_networks import PaperNetwork
from busybot.reason.paper_reasoner import PaperReasoner
from busybot.reason.reasoner import Reasoner
from busybot.reason.sequence import Sequence
from busybot.rng import generator
from busybot.training.checkpoint import restore_training, save_tensors, training_tensors
from busybot.training.device import device


class PaperLearner:
    """Networks, optimizer and the place in the schedule.

    Args:
        boards: how many there are to train on.
        checkpoint: file in which the training is kept; it goes on from there if the file exists.

    Attributes:
        iteration: how many are done.
        iterations: of the whole schedule.

    Raises:
        BusybotError: the checkpoint is damaged, or one of other networks.
    """

    def __init__(self, config: PaperReasonConfig, seed: int, boards: int, checkpoint: Path):
        self.config, self.seed, self.boards, self.checkpoint = config, seed, boards, checkpoint
        self.iterations = config.epochs * math.ceil(boards / config.batch)
        self.network = make_network(config, seed).to(device())
        self.optimizer = make_optimizer(self.network, config)
        self.iteration, self.last = 0, math.inf
        if checkpoint.exists():
            values = restore_training(checkpoint, self.network, self.optimizer).values
            self.iteration, self.last = int(values["iteration"]), float(values["last"])

    def chosen(self) -> np.ndarray:
        """Which boards the next iteration sees, int (batch,)."""
        epoch, place = divmod(self.iteration, math.ceil(self.boards / self.config.batch))
        return batches(self.boards, self.config.batch, self.seed, epoch)[place]

    def iterate(self, sequences: Several[Sequence]) -> Outcome:
        """The next iteration, on the boards that it chose."""
        boards = boards_of(sequences, self.config.network).to(device())
        rng = generator(self.seed, "train", self.iteration, "iteration/paper")
        outcome = iterate(self.network, self.optimizer, boards, self.config, rng, self.last)
        if outcome.taken:
            self.last = outcome.loss
        self.iteration += 1
        return outcome

    def save(self) -> None:
        """Write the checkpoint, whole or not at all."""
        values = {"iteration": self.iteration, "last": self.last}
        save_tensors(self.checkpoint, training_tensors(self.network, self.optimizer), values)

    def reasoner(self, encoder: str) -> Reasoner:
        """The networks as they are now."""
        if isinstance(self.network, PaperNetwork):
            return PaperReasoner(self.network, encoder)
        return PaperHistoryReasoner(self.network, encoder)
