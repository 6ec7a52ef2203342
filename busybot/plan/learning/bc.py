"""Behaviour cloning: imitate an oracle (paper appendix "Planning module", agent "BC").

The oracle takes a first step of a shortest way to the greatest success, among the same candidates that the agent has;
several may be as good, and any of them is right: the loss is - log of their joint probability. Rollouts are drawn anew
in every iteration, on boards drawn at random.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from torch import Tensor

from busybot.common.rng import generator
from busybot.plan.learning.board_graph import ExploredBoard, PracticeRollout
from busybot.plan.learning.config import BcConfig
from busybot.plan.learning.encoding import OBJECTS, STOP, Observation, stacked
from busybot.plan.learning.network import PolicyNetwork, rows_of, success_of
from busybot.training.checkpoint import drawing
from busybot.training.loop import Budget, Learner, descend


class BcLearner(Learner):
    """One thread: sums have one order whatever the machine.

    Args:
        boards: to train on.
        held_out: to judge by.
    """

    name = "bc"
    network: PolicyNetwork
    budget: Budget

    def __init__(self, config: BcConfig, boards: Sequence[ExploredBoard], held_out: Sequence[ExploredBoard], seed: int):
        torch.set_num_threads(1)
        self.config, self.seed, self.iterations = config, seed, config.iterations
        self.boards, self.held_out = boards, held_out
        with drawing(generator(seed, "train", 0, "initial weights/bc")):
            self.network = self.policy = PolicyNetwork(config.net)
        self.optimizer = torch.optim.AdamW(
            self.network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay
        )
        self.budget = Budget(config.minutes)

    def iterate(self, iteration: int) -> tuple[float, float]:
        """One step of the optimizer."""
        config, rng = self.config, generator(self.seed, "train", iteration, "plan/bc")
        chosen = [self.boards[index] for index in rng.integers(len(self.boards), size=config.batch)]
        orders = [rng.permutation(OBJECTS) if config.shuffle else None for _ in chosen]
        shown = [demonstrate(*one, rng, config.noise) for one in zip(chosen, orders, strict=True)]
        rate = config.rate(iteration)
        self.network.train()
        loss = imitation_loss(self.network, shown)
        descend(self.optimizer, loss, rate, config.clip)
        return float(loss.detach()), rate

    @torch.no_grad()
    def judge(self) -> Mapping[str, float]:
        """Success, and how well held-out demonstrations are imitated. What is to be least is the missing success.

        An agent that is seldom wrong, but then sure of it, still gets better where its imitation gets worse.
        """
        figures = success_of(self.network, self.boards, self.held_out)
        if self.held_out:
            rng = generator(self.seed, "train", 0, "plan/bc/judge")
            shown = [demonstrate(board, None, rng) for board in self.held_out]
            figures["imitation"] = float(imitation_loss(self.network, shown))
            figures["loss"] = 1 - figures["success"]
        return figures


Shown = tuple[Observation, np.ndarray]
"""A rollout's observations, and bool (D, 25): what was right at each of the D decisions at its end."""


def demonstrate(board: ExploredBoard, order: np.ndarray | None, rng: np.random.Generator, noise: float = 0.0) -> Shown:
    """The oracle plays.

    Args:
        order: of the objects, see `PracticeRollout`.
        noise: share of the steps in which something else is done.
    """
    rollout, seen, right = PracticeRollout(board, order), [], []
    while not rollout.over:
        seen.append(rollout.observation())
        right.append(rollout.right)
        actions = rollout.possible[rollout.possible != STOP]
        wrong = len(actions) > 0 and rng.random() < noise
        rollout.act(int(rng.choice(actions if wrong else np.flatnonzero(rollout.right))))
    history, decisions = rollout.history(), stacked(seen)
    return {name: np.concatenate([history[name], decisions[name]]) for name in history}, np.stack(right)


def imitation_loss(network: PolicyNetwork, shown: Sequence[Shown]) -> Tensor:
    """- log of the probability of what was right, nats, mean over decisions."""
    seen, lengths = rows_of([observations for observations, _ in shown])
    known, _ = network.read(seen, lengths)
    places = [
        (step, row)
        for row, (length, (_, right)) in enumerate(zip(lengths.tolist(), shown, strict=True))
        for step in range(length - len(right), length)
    ]
    steps, rows = torch.tensor(places).T
    decisions = {name: value[steps, rows] for name, value in seen.items()}
    scores = network.scores(known.at(steps, rows), decisions).log_softmax(dim=1)
    right = torch.from_numpy(np.concatenate([right for _, right in shown]))
    return -scores.masked_fill(~right, -torch.inf).logsumexp(dim=1).mean()
