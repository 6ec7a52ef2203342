"""The policy of learned agents: an LSTM over the history and the rollout, and a score for every choice.

    e_i = ReLU(W_e [W_l looks_i, W_l goal_i, objects_i])        per object
    x_t = ReLU(W_x [e_1 .. e_10, action])
    h_t = LSTM(x_t, h_{t-1})                                    the history, then the decisions
    score_c = MLP([h_t, choices_c, touched_c, e_touched])       softmax over the choices that there are

The paper tells no more than that an LSTM encodes the history. A score for each choice from what is known of it, instead
of one output per index, is chosen here: candidates come in no fixed order.

With `memory: attention` every choice c also looks back at what was done, s, itself (Vaswani et al. 2017; of pairs, as
in relation networks, Santoro et al. 2017), and the score reads what each object i showed then, is to show, and shows:

    a_cs  = softmax_s MLP([c - s, |c - s|, cosine of their directions, same trigger, s worked, place of s in time])
    m_c   = mean_i ReLU(W_m [sum_s a_cs changed_si, sum_s a_cs W_l looks_si, W_l looks_i, W_l goal_i, objects_i])

with two heads a, whose sums stand beside each other.

A trained policy is a folder with `weights.safetensors` and `model.json`, which says what they are (`PolicyInfo`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import torch
from pydantic import Field, model_serializer
from torch import Tensor, nn
from torch.nn.utils.rnn import pack_padded_sequence, pad_packed_sequence, pad_sequence

from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel
from busybot.plan.learning.board_graph import ExploredBoard, PracticeRollout
from busybot.plan.learning.encoding import FACTS, OBJECTS, STOP, Observation, stacked
from busybot.reason.inputs.sequence import CHANNELS
from busybot.training.checkpoint import load_tensors, network_with
from busybot.training.model_cards import WEIGHTS_FILE, ModelCard, check_weights, find_folder, read_info

IMPOSSIBLE = -1e9
"""Score of what is no choice."""
SHOWN = 64
"""So many of the boards that are trained on are judged."""

Tensors = dict[str, Tensor]
"""Observations, `encoding.SHAPES` behind any leading axes."""
State = tuple[Tensor, ...]
"""Hidden and cell state of the LSTM, (1, B, hidden) each; with attention also what was done, (REMEMBERED, B, ...)."""
REMEMBERED = 48
"""So many of the last actions can be looked back at: a history of 30 and all of a rollout."""
HEADS, PAIR, PAIR_WIDTH = 2, 8, 32
"""Of the attention: heads, numbers that tell of a choice and an action, and the width of what judges them."""
Width = Annotated[int, Field(ge=1, le=1024)]
Name = Literal["bc", "ppo"]


class PolicyNetworkConfig(FrozenModel):
    """Size of the networks, and how they remember.

    Attributes:
        looks: numbers that an object's 256 features are compressed to.
        objects: width per object.
        token: width of what the LSTM reads.
        hidden: of the LSTM.
        choices: of the hidden layer that scores choices.
        memory: what choices know of the past: what the LSTM says, or by attention also what was done itself.
    """

    looks: Width = 16
    objects: Width = 32
    token: Width = 128
    hidden: Width = 128
    choices: Width = 64
    memory: Literal["lstm", "attention"] = "lstm"

    @model_serializer(mode="wrap")
    def _as_before(self, dump: Any) -> dict[str, Any]:
        """Trainings that had no choice of a memory go on, and cards are as they were."""
        told: dict[str, Any] = dump(self)
        return {name: value for name, value in told.items() if (name, value) != ("memory", "lstm")}


class Recollection(nn.Module):
    """What each choice finds when it looks back, see the module."""

    def __init__(self, config: PolicyNetworkConfig):
        super().__init__()
        self.looks = config.looks
        self.pairs = nn.Sequential(nn.Linear(PAIR, PAIR_WIDTH), nn.ReLU(), nn.Linear(PAIR_WIDTH, HEADS))
        each = HEADS * (1 + config.looks) + 2 * config.looks + FACTS
        self.objects = nn.Sequential(nn.Linear(each, config.objects), nn.ReLU())

    @staticmethod
    def width(config: PolicyNetworkConfig) -> int:
        """Numbers of what is kept of an observation."""
        return FACTS + OBJECTS * (2 + config.looks)

    def kept(self, seen: Tensors, looks: Tensor) -> Tensor:
        """What is kept of observations, (..., width): the action, the object acted on, what changed, what is shown."""
        return torch.cat([seen["action"], seen["objects"][..., 7], seen["objects"][..., 6], looks.flatten(-2)], dim=-1)

    def forward(self, kept: Tensor, seen: Tensors, looks: Tensor, goal: Tensor) -> Tensor:
        """Of every choice, (..., 25, objects).

        Args:
            kept: (..., REMEMBERED, width), the oldest first; zeros where there was nothing yet.
            seen: the observation with the choices.
            looks, goal: what objects show now and in the goal, (..., 10, looks).
        """
        action, acted, changed, shown = kept.split([FACTS, OBJECTS, OBJECTS, OBJECTS * self.looks], dim=-1)
        choices, deed = seen["choices"].unsqueeze(-2), action.unsqueeze(-3)  # (..., 25, 1, 8), (..., 1, S, 8)
        apart = choices[..., :3] - deed[..., :3]
        facts = [
            apart,
            apart.norm(dim=-1, keepdim=True),
            (choices[..., 3:6] * deed[..., 3:6]).sum(dim=-1, keepdim=True),
            (seen["touched"] @ acted.transpose(-1, -2)).unsqueeze(-1),
            deed[..., 6:7].expand(*apart.shape[:-1], 1),
            torch.linspace(0, 1, REMEMBERED, device=apart.device).unsqueeze(-1).expand(*apart.shape[:-1], 1),
        ]
        there = deed[..., 7:] > 0.5  # (..., 1, S, 1)
        weights = self.pairs(torch.cat(facts, dim=-1)).masked_fill(~there, IMPOSSIBLE).softmax(dim=-2) * there
        values = torch.cat([changed.unsqueeze(-1), shown.unflatten(-1, (OBJECTS, self.looks))], dim=-1)
        found = torch.einsum("...csh,...siv->...cihv", weights, values).flatten(-2)  # (..., 25, 10, heads * values)
        now = torch.cat([looks, goal, seen["objects"]], dim=-1).unsqueeze(-3)
        each = self.objects(torch.cat([found, now.expand(*found.shape[:-1], -1)], dim=-1))
        return each.mean(dim=-2)


@dataclass(frozen=True)
class Reading:
    """What is known after each of L observations in B rows.

    Attributes:
        hidden: (L, B, hidden), what the LSTM says.
        kept: (REMEMBERED - 1 + L, B, width), with attention what is kept of each and of those before them.
    """

    hidden: Tensor
    kept: Tensor | None = None

    def at(self, steps: Tensor, rows: Tensor) -> Tensor:
        """Of some observations, (D,) each: (D, hidden), with attention what could be looked back at behind it."""
        hidden = self.hidden[steps, rows]
        return hidden if self.kept is None else torch.cat([hidden, self.window(steps, rows).flatten(-2)], dim=-1)

    def window(self, steps: Tensor, rows: Tensor) -> Tensor:
        """What can be looked back at then, (D, REMEMBERED, width), the oldest first."""
        assert self.kept is not None
        return self.kept[steps.unsqueeze(-1) + torch.arange(REMEMBERED, device=steps.device), rows.unsqueeze(-1)]


class PolicyNetwork(nn.Module):
    """See the module."""

    def __init__(self, config: PolicyNetworkConfig):
        super().__init__()
        self.config = config
        self.looks = nn.Linear(CHANNELS, config.looks)
        self.objects = nn.Sequential(nn.Linear(2 * config.looks + FACTS, config.objects), nn.ReLU())
        self.token = nn.Sequential(nn.Linear(OBJECTS * config.objects + FACTS, config.token), nn.ReLU())
        self.lstm = nn.LSTM(config.token, config.hidden)
        known = config.hidden + FACTS + OBJECTS + config.objects
        self.recollection = Recollection(config) if config.memory == "attention" else None
        if self.recollection is not None:
            known += config.objects
        self.choices = nn.Sequential(nn.Linear(known, config.choices), nn.ReLU(), nn.Linear(config.choices, 1))
        self.stop = nn.Sequential(nn.Linear(config.hidden, config.choices), nn.ReLU(), nn.Linear(config.choices, 1))

    def _embed(self, seen: Tensors) -> Tensor:
        """Objects, (..., 10, objects)."""
        return self.objects(torch.cat([self.looks(seen["looks"]), self.looks(seen["goal"]), seen["objects"]], dim=-1))

    def tokens(self, seen: Tensors) -> Tensor:
        """What the LSTM reads, (..., token)."""
        return self.token(torch.cat([self._embed(seen).flatten(-2), seen["action"]], dim=-1))

    def read(self, seen: Tensors, lengths: Tensor, state: State | None = None) -> tuple["Reading", State]:
        """What is known after each observation of rows.

        Args:
            seen: (L, B, ...), the rows padded at their ends.
            lengths: int (B,), without padding.
            state: before the first observation; None at the beginning of the history.

        Returns:
            what is known after each, and the state after each row's last observation.
        """
        packed = pack_padded_sequence(self.tokens(seen), lengths, enforce_sorted=False)
        told, after = self.lstm(packed, None if state is None else state[:2])
        hidden = pad_packed_sequence(told)[0]
        if self.recollection is None:
            return Reading(hidden), after
        kept = self.recollection.kept(seen, self.looks(seen["looks"]))
        past = kept.new_zeros(REMEMBERED, *kept.shape[1:]) if state is None else state[2]
        reading = Reading(hidden, torch.cat([past[1:], kept]))
        latest = reading.window(lengths - 1, torch.arange(kept.shape[1]))
        return reading, (*after, latest.transpose(0, 1))

    def scores(self, hidden: Tensor, seen: Tensors) -> Tensor:
        """Of all choices, (..., 25); `IMPOSSIBLE` for those that there are not. Stop is always one.

        Args:
            hidden: (..., ...), of `Reading.at`.
        """
        choices, touched = seen["choices"], seen["touched"]
        told, past = hidden[..., : self.config.hidden], hidden[..., self.config.hidden :]
        spread = told.unsqueeze(-2).expand(*choices.shape[:-1], -1)
        known = [spread, choices, touched, touched @ self._embed(seen)]
        if self.recollection is not None:
            looks, goal = self.looks(seen["looks"]), self.looks(seen["goal"])
            known.append(self.recollection(past.unflatten(-1, (REMEMBERED, -1)), seen, looks, goal))
        scores = self.choices(torch.cat(known, dim=-1)).squeeze(-1).masked_fill(seen["allowed"] < 0.5, IMPOSSIBLE)
        return torch.cat([self.stop(told), scores[..., STOP + 1 :]], dim=-1)


def as_tensors(observation: Observation) -> Tensors:
    """Arrays as tensors."""
    return {name: torch.from_numpy(np.asarray(value, np.float32)) for name, value in observation.items()}


def rows_of(observations: Sequence[Observation]) -> tuple[Tensors, Tensor]:
    """Rows of observations, each with a first axis of its own length, as (L, B, ...), and their lengths."""
    rows = [as_tensors(row) for row in observations]
    lengths = torch.tensor([len(row["allowed"]) for row in rows])
    return {name: pad_sequence([row[name] for row in rows]) for name in rows[0]}, lengths


@torch.no_grad()
def play(network: PolicyNetwork, boards: Sequence[ExploredBoard]) -> np.ndarray:
    """Success (B,) at the end on every board, if the choice with the highest score is always taken."""
    rollouts = [PracticeRollout(board) for board in boards]
    _, state = network.read(*rows_of([rollout.history() for rollout in rollouts]))
    once = torch.ones(len(rollouts), dtype=torch.int64)
    while not all(rollout.over for rollout in rollouts):
        seen = as_tensors(stacked([rollout.observation() for rollout in rollouts]))
        known, state = network.read({name: value.unsqueeze(0) for name, value in seen.items()}, once, state)
        hidden = known.at(torch.zeros_like(once), torch.arange(len(once)))
        for rollout, choice in zip(rollouts, network.scores(hidden, seen).argmax(dim=1), strict=True):
            if not rollout.over:
                rollout.act(int(choice))
    return np.array([rollout.success for rollout in rollouts])


def success_of(
    network: PolicyNetwork, boards: Sequence[ExploredBoard], held_out: Sequence[ExploredBoard]
) -> dict[str, float]:
    """Mean success at the end of a task, on boards that are trained on and on those that are held out."""
    network.eval()
    found = {"success_seen": float(play(network, boards[:SHOWN]).mean())}
    return found | ({"success": float(play(network, held_out).mean())} if held_out else {})


class PolicyInfo(ModelCard):
    """What `model.json` says.

    Attributes:
        agent: how it was trained.
        encoder: which features it reads.
        net: size of the network.
    """

    agent: Name
    encoder: str
    net: PolicyNetworkConfig = PolicyNetworkConfig()


def read_policy(name_or_path: str | Path, agent: Name) -> tuple[PolicyInfo, PolicyNetwork]:
    """A shipped policy by its name, or any by its folder (a training's folder stands for its final model).

    Args:
        agent: that it must be of.

    Raises:
        BusybotError: there is no such policy, or its files are damaged or do not belong together.
    """
    folder = find_folder(name_or_path, agent)
    info = read_info(folder, PolicyInfo)
    if info.agent != agent:
        raise BusybotError(f"{folder}: a policy of agent {info.agent}, not {agent}", f"name it as {info.agent}")
    weights = folder / WEIGHTS_FILE
    check_weights(weights, info)
    network = network_with(lambda: PolicyNetwork(info.net), load_tensors(weights).tensors, weights)
    return info, network.eval()


load_policy = lru_cache(maxsize=4)(read_policy)
"""The same, read once in a process."""
