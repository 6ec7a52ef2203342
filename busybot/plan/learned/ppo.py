"""Proximal policy optimisation: maximise the success rate (paper appendix "Planning module", agent "PPO").

RecurrentPPO of sb3-contrib learns on `GoalEnv`. Every iteration starts its environments and its random numbers anew
from the seed, so a training that was killed goes on from its checkpoint as if nothing had happened; the episodes that
are cut off at an iteration's end count as far as they came. sb3's own files are pickles: none is written or read.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import torch

from busybot.errors import BusybotError
from busybot.plan.goal_env import GoalEnv
from busybot.plan.learned.config import PpoConfig
from busybot.plan.learned.explored import Explored
from busybot.plan.learned.network import PolicyNetwork, success_of
from busybot.rng import generator
from busybot.training.loop import Budget, Learner
from busybot.training.weights import drawing

MOST = 2**31
"""Seeds of sb3 are smaller."""


def check_installed() -> None:
    """BusybotError if sb3-contrib is not."""
    try:
        import sb3_contrib  # noqa: F401
    except ImportError:
        raise BusybotError("sb3-contrib is not installed", "pip install 'busybot[baselines]'") from None


class PpoLearner(Learner):
    """One thread: sums have one order whatever the machine.

    Args:
        boards: to train on.
        held_out: to judge by.

    Raises:
        BusybotError: sb3-contrib is not installed.
    """

    name = "ppo"
    budget: Budget

    def __init__(self, config: PpoConfig, boards: Sequence[Explored], held_out: Sequence[Explored], seed: int):
        check_installed()
        torch.set_num_threads(1)
        self.config, self.seed, self.iterations = config, seed, config.iterations
        self.boards, self.held_out = boards, held_out
        with drawing(generator(seed, "train", 0, "initial weights/ppo")):
            self._model = _recurrent_ppo(config, boards)
        self.network, self.optimizer = self._model.policy, self._model.policy.optimizer  # actor and critic
        self.budget = Budget(config.minutes)

    @property
    def policy(self) -> PolicyNetwork:
        """The actor, which is all that plays."""
        return self._model.policy.network

    def iterate(self, iteration: int) -> tuple[float, float]:
        """Collect experience and learn from it."""
        from stable_baselines3.common.utils import set_random_seed

        rng, rate = generator(self.seed, "train", iteration, "plan/ppo"), self.config.rate(iteration)
        with drawing(rng):
            # sb3 draws from the global generators of torch and numpy
            set_random_seed(int(rng.integers(MOST)))
            self._model.env.seed(int(rng.integers(MOST)))
            self._model.lr_schedule = lambda _: rate
            self._model.learn(self.config.envs * self.config.steps, log_interval=self.config.iterations + 1)
        return float(self._model.logger.name_to_value["train/loss"]), rate

    def judge(self) -> Mapping[str, float]:
        """Success; what is to be least is the success that is missing on held-out boards."""
        figures = success_of(self.policy, self.boards, self.held_out)
        return figures | ({"loss": 1 - figures["success"]} if self.held_out else {})


def _recurrent_ppo(config: PpoConfig, boards: Sequence[Explored]) -> Any:
    from sb3_contrib import RecurrentPPO
    from stable_baselines3.common.vec_env import DummyVecEnv

    from busybot.plan.learned.ppo_policy import GoalPolicy

    return RecurrentPPO(
        GoalPolicy,
        DummyVecEnv([lambda: GoalEnv(boards, config.shuffle)] * config.envs),
        learning_rate=config.learning_rate,
        n_steps=config.steps,
        batch_size=config.batch,
        n_epochs=config.epochs,
        gamma=config.discount,
        gae_lambda=config.gae,
        clip_range=config.clip_range,
        ent_coef=config.entropy,
        vf_coef=config.value,
        max_grad_norm=config.clip,
        policy_kwargs={"net": config.net},
        device="cpu",
    )
