"""Our network as a policy of sb3-contrib's RecurrentPPO. Needs the extra `baselines`; only `ppo` imports it.

The value of a state is read from the same LSTM and trains it, too; it is left behind when the policy is exported.
"""

from typing import Any

import torch
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from sb3_contrib.common.recurrent.type_aliases import RNNStates
from torch import Tensor, nn

from busybot.plan.learned.network import NetConfig, PolicyNetwork, State, Tensors


class GoalPolicy(RecurrentActorCriticPolicy):
    """Actor and critic in one network."""

    def __init__(self, observation_space: Any, action_space: Any, lr_schedule: Any, net: NetConfig, **others: Any):
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
