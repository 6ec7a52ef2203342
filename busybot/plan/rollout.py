"""Letting an agent play the task of a recorded board, in one simulator."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from busybot.boards.task import MAX_STEPS, task_of
from busybot.common.frozen_model import FrozenModel
from busybot.common.rng import generator
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Episode
from busybot.interact.policy.board_memory import BoardMemory
from busybot.interact.policy.candidates import ActionModel
from busybot.interact.policy.config import PolicyConfig
from busybot.plan.agent_policy import AgentPolicy, OnlineFeatures
from busybot.plan.agents.oracle import OracleAgent, OracleProposals, OracleRelations
from busybot.plan.agents.registry import AgentSpec, MakeAgent, kind_of, name_of
from busybot.plan.contact_proposals import ContactProposals, LearnedProposals, memory_of, successful_actions
from busybot.plan.decision_log import notes
from busybot.plan.interfaces import Agent, TaskContext
from busybot.plan.metrics import JudgedRollout
from busybot.plan.outcomes import judge_rollout
from busybot.plan.task_context import task_context
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.inputs.observation import ObservedEpisode, observe_episode
from busybot.reason.models.base import Reasoner
from busybot.sim.interaction import InteractionConfig
from busybot.sim.recorder import record_episode
from busybot.sim.scene.board_scene import BoardScene, Simulator
from busybot.sim.scene.render import RenderConfig


class PlanConfig(FrozenModel):
    """How agents are measured.

    Attributes:
        boards: only so many tasks, the first ones; None for all.
        learned: constants of the interaction policy that take precedence over those on the model's card.
    """

    boards: int | None = None
    learned: dict[str, Any] = {}
    interaction: InteractionConfig = InteractionConfig()
    render: RenderConfig = RenderConfig()


@dataclass(frozen=True)
class PreparedTask:
    """A recorded history with a goal, read once for all agents.

    Attributes:
        edges: bool (N, N), relations that the reasoner claims.
    """

    history: Episode
    observed: ObservedEpisode
    briefing: TaskContext
    memory: BoardMemory
    rays: Rays
    edges: np.ndarray


@dataclass(frozen=True)
class PlayedRollout:
    """A rollout and what it came to."""

    episode: Episode
    judged: JudgedRollout


class RolloutRunner:
    """Lets agents play in one simulator, with one pair of models.

    Args:
        reasoner: relations and predictions.
        model: action candidates.
        policy: constants of the candidates.
        seed: of the agents' draws.
    """

    def __init__(
        self,
        simulator: Simulator,
        reasoner: Reasoner,
        model: ActionModel[Any],
        policy: PolicyConfig | None = None,
        interaction: InteractionConfig | None = None,
        seed: int = 0,
    ):
        self._simulator, self._reasoner, self._model = simulator, reasoner, model
        self._config, self._interaction = policy or PolicyConfig(), interaction or InteractionConfig()
        self._seed = seed

    def prepare(self, history: Episode, features: np.ndarray | None = None) -> PreparedTask:
        """Read a history.

        Args:
            features: of the history, (T + 1, N, 256), if they are known already.

        Raises:
            BusybotError: it has no goal or no depth.
        """
        briefing = task_context(history, MAX_STEPS, self._reasoner.encoder, features)
        rays = Rays(history.camera)
        memory = memory_of(history, self._model, rays, self._config)
        edges = self._reasoner.graph(briefing.history).claimed(briefing.history.steps)
        return PreparedTask(history, observe_episode(history), briefing, memory, rays, edges)

    def play(self, task: PreparedTask, agent: str | MakeAgent, name: str | None = None) -> PlayedRollout:
        """Let an agent play.

        Args:
            agent: as `kind_of` takes it, or what makes one of a reasoner.
            name: in the result; by default that of the agent.
        """
        kind = kind_of(agent) if isinstance(agent, str) else AgentSpec(agent)
        seat = _Seat(self, task, kind, name or (name_of(agent) if isinstance(agent, str) else None))
        factory = _OracleSeat(seat) if kind.oracle else seat
        board = task.history.board
        episode = record_episode(self._simulator, board, factory, MAX_STEPS, self._interaction, self._seed)
        policy = seat.policy
        assert policy is not None
        episode.settings |= notes(policy.decisions)
        return PlayedRollout(episode, judge_rollout(episode, policy, task.briefing, task.edges))

    def policy(self, task: PreparedTask, kind: AgentSpec, name: str | None) -> AgentPolicy:
        """An agent that has what a robot has, as a policy."""
        assert kind.make is not None
        return self._policy(task, kind.make(self._reasoner), self._contacts(task), name)

    def oracle(self, task: PreparedTask, kind: AgentSpec, name: str | None, scene: BoardScene) -> AgentPolicy:
        """An agent that is told the truth about a scene, as a policy."""
        rng = generator(self._seed, scene.spec.split, scene.spec.index, "plan/true contacts")
        reasoner = OracleRelations(self._reasoner, scene.spec) if kind.relations else self._reasoner
        true = OracleProposals(scene, task.rays, self._interaction, task.observed, rng)
        agent = kind.make(reasoner) if kind.make else OracleAgent(scene, task_of(scene.spec).goal, true)
        return self._policy(task, agent, true if kind.contacts else self._contacts(task), name)

    def _contacts(self, task: PreparedTask) -> ContactProposals:
        worked = successful_actions(task.history)
        return LearnedProposals(self._model, self._config, task.rays, task.observed, worked, task.memory)

    def _policy(self, task: PreparedTask, agent: Agent, contacts: ContactProposals, name: str | None) -> AgentPolicy:
        sight = OnlineFeatures(task.observed, make_extractor(self._reasoner.encoder))
        return AgentPolicy(agent, task.briefing, contacts, sight, name)


@dataclass
class _Seat:
    """What `record_episode` makes the policy of an agent with; `policy` is it afterwards."""

    player: RolloutRunner
    task: PreparedTask
    kind: AgentSpec
    agent_name: str | None
    policy: AgentPolicy | None = None
    name: str = "plan"  # the same draws whoever plays

    def make_policy(self, rays: Rays) -> AgentPolicy:
        self.policy = self.player.policy(self.task, self.kind, self.agent_name)
        return self.policy


@dataclass
class _OracleSeat:
    """The same of an oracle."""

    seat: _Seat
    name: str = _Seat.name

    def make_oracle(self, scene: BoardScene, rays: Rays, config: InteractionConfig) -> AgentPolicy:
        seat = self.seat
        seat.policy = seat.player.oracle(seat.task, seat.kind, seat.agent_name, scene)
        return seat.policy
