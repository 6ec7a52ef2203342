"""Letting an agent play the task of a recorded board, in one simulator.

From a recorded history with a goal picture to what an agent is told before it starts.

Judges rollouts by the true states. For evaluators only.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from busybot.boards.spec import Relation
from busybot.boards.task import MAX_STEPS, affectable, reached, responder_states, start_states, task_of
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel
from busybot.common.rng import generator
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Episode
from busybot.interact.policy.board_memory import BoardMemory
from busybot.interact.policy.candidates import ActionModel
from busybot.interact.policy.config import PolicyConfig
from busybot.plan.agent_policy import AgentPolicy, Decision, OnlineFeatures
from busybot.plan.agents.oracle import OracleAgent, OracleProposals, OracleRelations
from busybot.plan.agents.registry import AgentSpec, MakeAgent, kind_of, name_of
from busybot.plan.contact_proposals import ContactProposals, LearnedProposals, memory_of, successful_actions
from busybot.plan.decision_log import notes
from busybot.plan.interfaces import Act, Agent, Stop, TaskContext
from busybot.plan.metrics import Cause, JudgedResponder, JudgedRollout
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.inputs.observation import ObservedEpisode, goal_of, observe_episode
from busybot.reason.inputs.sequence import sequence_of, threshold_of
from busybot.reason.models.base import Reasoner
from busybot.sim.interaction import InteractionConfig
from busybot.sim.recorder import record_episode
from busybot.sim.scene.board_scene import BoardScene, Simulator
from busybot.sim.scene.render import RenderConfig


def task_context(
    history: Episode, steps: int, encoder: str = "embedded", features: np.ndarray | None = None
) -> TaskContext:
    """What agents are told of a task.

    Args:
        history: the recorded interactions, with a goal.
        steps: so many actions are allowed.
        encoder: of the features.
        features: of the history, (T + 1, N, 256), if they are known already.

    Raises:
        BusybotError: the history has no goal, or there is no such encoder.
    """
    observed, goal, chosen = observe_episode(history), goal_of(history), make_extractor(encoder)
    if goal is None:
        what = f"board {history.board.index} has no goal"
        raise BusybotError(
            what, "make a dataset with tasks: busybot generate OUT --tasks one-to-one, busybot collect OUT"
        )
    worked = np.full(len(history.steps), -1)
    for one in successful_actions(history):
        worked[one.step] = one.direction
    return TaskContext(
        history=sequence_of(observed, chosen.of(observed) if features is None else features),
        pixels=np.array([step.pixel for step in history.steps], int).reshape(-1, 2),
        worked=worked,
        goal=OnlineFeatures(observed, chosen).see(goal),
        threshold=threshold_of(encoder),
        steps=steps,
    )


def judge_rollout(rollout: Episode, policy: AgentPolicy, briefing: TaskContext, edges: np.ndarray) -> JudgedRollout:
    """Put the truth beside what an agent did.

    Args:
        rollout: on a board with a task, with segmentation.
        policy: that acted.
        edges: bool (N, N), relations that the reasoner claims.
    """
    board, steps = rollout.board, rollout.steps
    start = responder_states(board, start_states(board))
    right = reached(board, steps[-1].responder_states_after if steps else start)
    asked = reached(board, start)
    differing = set(briefing.differing(policy.features).tolist())
    relations = {relation.responder: relation for relation in board.relations}
    last = policy.decisions[-1].answer if policy.decisions else None
    responders = []
    for index in affectable(board):
        cause: Cause = ""
        if not right[index]:
            cause = _cause(rollout, policy.decisions, relations[index], edges, index not in differing)
        responders.append(
            JudgedResponder(
                object=index,
                key=board.objects[index].key,
                kind=relations[index].kind,
                asked=not asked[index],
                reached=right[index],
                looks_reached=index not in differing,
                cause=cause,
            )
        )
    return JudgedRollout(
        agent=policy.name,
        steps=len(steps),
        succeeded=sum(step.success for step in steps),
        stopped=last.why if isinstance(last, Stop) else "",
        responders=tuple(responders),
        cpu_ms=tuple(round(one.cpu_ms, 3) for one in policy.decisions),
        model_ms=tuple(round(one.model_ms, 3) for one in policy.decisions),
        start_ms=round(policy.start_ms, 3),
    )


def _cause(
    rollout: Episode, decisions: Sequence[Decision], relation: Relation, edges: np.ndarray, looks_reached: bool
) -> Cause:
    """Why a responder is not in its goal state; the first of the reasons that applies."""
    link = (relation.triggers[0].object, relation.triggers[0].link)
    responder = relation.responder
    steps = rollout.steps
    meant = [isinstance(one.answer, Act) and one.answer.responder == responder for one in decisions[: len(steps)]]
    if any(step.success and (step.acted_object, step.acted_link) == link for step in steps):
        return "not noticed" if looks_reached else "wrong prediction"
    if not edges[link[0], responder]:
        return "wrong relation"
    if any(one and step.success for one, step in zip(meant, steps, strict=True)):
        return "wrong prediction"
    on_link = [(step.acted_object, step.acted_link) == link for step in steps]
    if any(one or on for one, on in zip(meant, on_link, strict=True)):
        return "physical failure"
    if looks_reached:
        return "not noticed"
    return "not tried" if _offered(rollout, decisions, link) else "no candidate"


def _offered(rollout: Episode, decisions: Sequence[Decision], link: tuple[int, str]) -> bool:
    """Whether the interaction model proposed a contact on a link, or was not even asked."""
    codes = [number + 1 for number, one in enumerate(rollout.links) if (one.object, one.name) == link]
    for number, decision in enumerate(decisions):
        segmentation = rollout.image(number).segmentation
        assert segmentation is not None
        if decision.proposed is None:
            return True
        if any(int(segmentation[v, u]) in codes for u, v in (contact.pixel for contact in decision.proposed)):
            return True
    return False


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
