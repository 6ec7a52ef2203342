"""Proximal policy optimisation: maximise the success rate (paper appendix "Planning module", agent "PPO").

RecurrentPPO of sb3-contrib learns on `GoalEnv`, with our network as its policy; the value of a state is read from the
same LSTM and trains it, too, and is left behind when the policy is exported. RecurrentPPO keeps the hidden and the cell
state of an LSTM; with `memory: attention`, what was done is kept with them, one half beside each. Every iteration
starts its environments and its random numbers anew from the seed, so a training that was killed goes on from its
checkpoint as if nothing had happened; the episodes that are cut off at an iteration's end count as far as they came.
sb3's own files are pickles: none is written or read.

Needs the extra `baselines`, so it is imported only where an agent is trained so (`train.make_learner`).
"""

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
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
from busybot.plan.learning.encoding import STOP
from busybot.plan.learning.network import (
    IMPOSSIBLE,
    REMEMBERED,
    PolicyNetwork,
    PolicyNetworkConfig,
    Reading,
    Recollection,
    State,
    Tensors,
    success_of,
)
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
        # RecurrentPPO asks this one for the size of what it keeps
        del self.lstm_actor
        done = 0 if self.network.recollection is None else REMEMBERED * Recollection.width(net)
        self.__dict__["lstm_actor"] = SimpleNamespace(num_layers=1, hidden_size=net.hidden + done // 2)
        self.action_net, self.value_net = nn.Identity(), nn.Linear(net.hidden, 1)
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)

    def _read(self, seen: Tensors, state: State, starts: Tensor) -> tuple[Reading, State]:
        """What is known after each of L observations in B rows, and the state afterwards.

        Args:
            seen: (B * L, ...), row by row.
            state: as RecurrentPPO keeps it, (1, B, ...) each.
            starts: (B * L,), 1 where an episode starts. RecurrentPPO cuts rows there, so that it is a row's first.
        """
        rows = state[0].shape[1]
        fresh = starts.unflatten(0, (rows, -1))[:, :1]
        seen = {name: value.unflatten(0, (rows, -1)).transpose(0, 1) for name, value in seen.items()}
        lengths = torch.full((rows,), len(seen["allowed"]))
        known, after = self.network.read(seen, lengths, self._apart([(1 - fresh) * part for part in state]))
        return known, self._together(after)

    def _apart(self, kept: Sequence[Tensor]) -> State:
        """The network's state, of what RecurrentPPO keeps."""
        hidden = self.network.config.hidden
        state = tuple(part[..., :hidden].contiguous() for part in kept)
        if self.network.recollection is None:
            return state
        done = torch.cat([part[0, :, hidden:] for part in kept], dim=-1)
        return (*state, done.unflatten(-1, (REMEMBERED, -1)).transpose(0, 1))

    def _together(self, state: State) -> State:
        """What RecurrentPPO keeps, of the network's state."""
        if self.network.recollection is None:
            return state
        *state_of_lstm, done = state
        halves = done.transpose(0, 1).flatten(1).chunk(2, dim=-1)
        return tuple(
            torch.cat([part, half.unsqueeze(0)], dim=-1) for part, half in zip(state_of_lstm, halves, strict=True)
        )

    def _values(self, known: Reading) -> Tensor:
        """(B * L, 1)."""
        return torch.as_tensor(self.value_net(known.hidden.transpose(0, 1).flatten(0, 1)))

    def _distribution(self, known: Reading, seen: Tensors) -> Any:
        """Of actions. Scores are computed only where something may be chosen, one observation in six."""
        scores = torch.full_like(seen["allowed"], IMPOSSIBLE)
        scores[:, STOP] = 0
        deciding = seen["allowed"][:, STOP + 1 :].any(dim=1).nonzero().squeeze(1)
        length = len(known.hidden)
        told = known.at(deciding % length, deciding // length)
        scores[deciding] = self.network.scores(told, {name: value[deciding] for name, value in seen.items()})
        return self.action_dist.proba_distribution(scores)

    def forward(
        self, obs: Tensors, lstm_states: Any, episode_starts: Tensor, deterministic: bool = False
    ) -> tuple[Tensor, Tensor, Tensor, Any]:
        """Actions, values, log-probabilities, and the states."""
        known, state = self._read(obs, lstm_states.pi, episode_starts)
        distribution = self._distribution(known, obs)
        actions = distribution.get_actions(deterministic=deterministic)
        return actions, self._values(known), distribution.log_prob(actions), RNNStates(state, state)

    def get_distribution(self, obs: Tensors, lstm_states: State, episode_starts: Tensor) -> tuple[Any, State]:
        """Of actions, and the state."""
        known, state = self._read(obs, lstm_states, episode_starts)
        return self._distribution(known, obs), state

    def predict_values(self, obs: Tensors, lstm_states: State, episode_starts: Tensor) -> Tensor:
        """Values, (B, 1)."""
        return self._values(self._read(obs, lstm_states, episode_starts)[0])

    def evaluate_actions(
        self, obs: Tensors, actions: Tensor, lstm_states: Any, episode_starts: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Values, log-probabilities of the actions, and entropies."""
        known, _ = self._read(obs, lstm_states.pi, episode_starts)
        distribution = self._distribution(known, obs)
        return self._values(known), distribution.log_prob(actions), distribution.entropy()


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
