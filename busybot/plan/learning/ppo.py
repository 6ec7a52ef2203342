"""Proximal policy optimisation: maximise the success rate (paper appendix "Planning module", agent "PPO").

RecurrentPPO of sb3-contrib learns on `GoalEnv`, with our network as its policy; the value of a state is read from the
same LSTM and trains it, too, and is left behind when the policy is exported. Every iteration starts its environments
and its random numbers anew from the seed, so a training that was killed goes on from its checkpoint as if nothing had
happened; the episodes that are cut off at an iteration's end count as far as they came. sb3's own files are pickles:
none is written or read.

Needs the extra `baselines`, so it is imported only where an agent is trained so (`train.make_learner`).
"""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from sb3_contrib import RecurrentPPO
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from sb3_contrib.common.recurrent.type_aliases import RNNStates
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import DummyVecEnv
from torch import Tensor, nn

from busybot.common.rng import generator
from busybot.plan.learning.board_graph import ExploredBoard, GoalEnv
from busybot.plan.learning.config import PpoConfig
from busybot.plan.learning.network import PolicyNetwork, PolicyNetworkConfig, State, Tensors, success_of
from busybot.training.checkpoint import drawing
from busybot.training.loop import Budget, Learner

MOST = 2**31
"""Seeds of sb3 are smaller."""


class GoalPolicy(RecurrentActorCriticPolicy):
    """Actor and critic in one network."""

    def __init__(
        self, observation_space: Any, action_space: Any, lr_schedule: Any, net: PolicyNetworkConfig, **others: Any
    ):
        sizes = {"net_arch": [], "lstm_hidden_size": net.hidden, "shared_lstm": True, "enable_critic_lstm": False}
        super().__init__(observation_space, action_space, lr_schedule, **sizes, ortho_init=False, **others)
        self.network = PolicyNetwork(net)
        # RecurrentPPO asks this one for its size; it is no part of its own, so that there is one copy of the weights
        del self.lstm_actor
        self.__dict__["lstm_actor"] = self.network.lstm
        self.action_net, self.value_net = nn.Identity(), nn.Linear(net.hidden, 1)
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)

    def _read(self, seen: Tensors, state: State, starts: Tensor) -> tuple[Tensor, State]:
        """What the LSTM says, (B, hidden), and its state afterwards, reset where an episode starts."""
        return self._process_sequence(self.network.tokens(seen), state, starts, self.network.lstm)

    def _distribution(self, hidden: Tensor, seen: Tensors) -> Any:
        return self.action_dist.proba_distribution(self.network.scores(hidden, seen))

    def forward(
        self, obs: Tensors, lstm_states: Any, episode_starts: Tensor, deterministic: bool = False
    ) -> tuple[Tensor, Tensor, Tensor, Any]:
        """Actions, values, log-probabilities, and the states of the LSTM."""
        hidden, state = self._read(obs, lstm_states.pi, episode_starts)
        distribution = self._distribution(hidden, obs)
        actions = distribution.get_actions(deterministic=deterministic)
        return actions, self.value_net(hidden), distribution.log_prob(actions), RNNStates(state, state)

    def get_distribution(self, obs: Tensors, lstm_states: State, episode_starts: Tensor) -> tuple[Any, State]:
        """Of actions, and the state of the LSTM."""
        hidden, state = self._read(obs, lstm_states, episode_starts)
        return self._distribution(hidden, obs), state

    def predict_values(self, obs: Tensors, lstm_states: State, episode_starts: Tensor) -> Tensor:
        """Values, (B, 1)."""
        return torch.as_tensor(self.value_net(self._read(obs, lstm_states, episode_starts)[0]))

    def evaluate_actions(
        self, obs: Tensors, actions: Tensor, lstm_states: Any, episode_starts: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Values, log-probabilities of the actions, and entropies."""
        hidden, _ = self._read(obs, lstm_states.pi, episode_starts)
        distribution = self._distribution(hidden, obs)
        return self.value_net(hidden), distribution.log_prob(actions), distribution.entropy()


class PpoLearner(Learner):
    """One thread: sums have one order whatever the machine.

    Args:
        boards: to train on.
        held_out: to judge by.
    """

    name = "ppo"
    budget: Budget

    def __init__(
        self, config: PpoConfig, boards: Sequence[ExploredBoard], held_out: Sequence[ExploredBoard], seed: int
    ):
        torch.set_num_threads(1)
        self.config, self.seed, self.iterations = config, seed, config.iterations
        self.boards, self.held_out = boards, held_out
        with drawing(generator(seed, "train", 0, "initial weights/ppo")):
            self._model: Any = RecurrentPPO(
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
        self.network, self.optimizer = self._model.policy, self._model.policy.optimizer  # actor and critic
        self.policy: PolicyNetwork = self._model.policy.network  # the actor, which is all that plays
        self.budget = Budget(config.minutes)

    def iterate(self, iteration: int) -> tuple[float, float]:
        """Collect experience and learn from it."""
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
