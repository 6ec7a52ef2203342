"""Lets an agent play the task of a recorded board in one simulator, and judges what it did by the true states.

An agent is told of its task what the recorded history with its goal picture shows (`TaskContext`); judging is for
evaluators only.
"""

import json
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from busybot.boards.dynamics import Dynamics, Links
from busybot.boards.spec import Relation
from busybot.boards.task import MAX_STEPS, affectable, drivers, reached, start_states
from busybot.boards.worlds import links_of
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel
from busybot.common.rng import generator
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import with_unsaid
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Episode
from busybot.interact.policy.board_memory import BoardMemory
from busybot.interact.policy.candidates import ActionModel
from busybot.interact.policy.config import PolicyConfig
from busybot.plan.agent_policy import AgentPolicy, Decision, OnlineFeatures, notes
from busybot.plan.agents.oracle import OracleAgent, OracleProposals, OracleRelations
from busybot.plan.agents.registry import AgentSpec, MakeAgent, kind_of, name_of
from busybot.plan.contact_proposals import ContactProposals, LearnedProposals, memory_of
from busybot.plan.interfaces import Act, Stop, TaskContext
from busybot.plan.metrics import Cause, JudgedResponder, JudgedRollout
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.inputs.observation import ObservedEpisode, goal_of, observe_episode
from busybot.reason.inputs.sequence import sequence_of, threshold_of
from busybot.reason.models.base import Reasoner
from busybot.sim.interaction import InteractionConfig
from busybot.sim.recorder import record_episode
from busybot.sim.scene.board_scene import BoardScene, Simulator
from busybot.sim.scene.render import RenderConfig


class PlanConfig(FrozenModel):
    """How agents are measured.

    Attributes:
        boards: only so many tasks, the first ones; None for all.
        steps: so many actions an agent may take at most; goals are drawn so that `boards.task.MAX_STEPS` suffice.
        learned: constants of the interaction policy that take precedence over those on the model's card.
    """

    boards: Annotated[int, Field(ge=1)] | None = None
    steps: Annotated[int, Field(ge=1, le=1000)] = MAX_STEPS
    learned: dict[str, Any] = {}
    interaction: InteractionConfig = InteractionConfig()
    render: RenderConfig = RenderConfig()


def check_settings(dataset: Dataset, render: RenderConfig, interaction: InteractionConfig, place: str = "") -> None:
    """Compare how the histories were looked at, and how was acted, with how it will be on their boards again.

    Args:
        place: of `render` and `interaction` among the parameters, for the hint, with a point behind it.

    Raises:
        BusybotError: they differ. Pixels, looks and goal pictures, or rewards, of the one mean nothing in the other.
    """
    collect = dataset.info.collect
    recorded = {"render": collect.look(), "interaction": collect.group("interaction")} if collect else {}
    asked = {"render": with_unsaid(render.model_dump(mode="json")), "interaction": interaction.model_dump(mode="json")}
    differing = [
        (f"{group}.{name}", json.dumps(known[name]), json.dumps(asked[group][name]))
        for group, known in recorded.items()
        for name in sorted(known.keys() & asked[group].keys())
        if known[name] != asked[group][name]
    ]
    if differing:
        told = [f"{name} {known}, not {other}" for name, known, other in differing]
        again = [f"--set {shlex.quote(f'{place}{name}={known}')}" for name, known, _ in differing]
        raise BusybotError(f"{dataset.path}: its histories were recorded with {'; '.join(told)}", " ".join(again))


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
        steps: as of `PlanConfig`.
    """

    def __init__(
        self,
        simulator: Simulator,
        reasoner: Reasoner,
        model: ActionModel[Any],
        policy: PolicyConfig | None = None,
        interaction: InteractionConfig | None = None,
        seed: int = 0,
        steps: int = MAX_STEPS,
    ):
        self._simulator, self._reasoner, self._model = simulator, reasoner, model
        self._config, self._interaction = policy or PolicyConfig(), interaction or InteractionConfig()
        self._extractor = make_extractor(reasoner.encoder)
        self._seed, self._steps = seed, steps

    def prepare(self, history: Episode, features: np.ndarray | None = None) -> PreparedTask:
        """Read a history.

        Args:
            features: of the history, (T + 1, N, 256), if they are known already.

        Raises:
            BusybotError: it has no goal or no depth, or there is no encoder as the reasoner's.
        """
        observed, goal, rays = observe_episode(history, again=True), goal_of(history), Rays(history.camera)
        if goal is None:
            what = f"board {history.board.index} has no goal"
            raise BusybotError(
                what, "make a dataset with tasks: busybot generate OUT --tasks one-to-one, busybot collect OUT"
            )
        known = sequence_of(observed, self._extractor.of(observed) if features is None else features)
        briefing = TaskContext(
            history=known,
            pixels=np.array([step.pixel for step in history.steps], int).reshape(-1, 2),
            worked=np.array([step.executed[-1] if step.reward else -1 for step in history.steps], int),
            goal=OnlineFeatures(observed, self._extractor).see(goal),
            threshold=threshold_of(self._reasoner.encoder, known.features),
            steps=self._steps,
        )
        memory = memory_of(history, self._model, rays, self._config)
        edges = self._reasoner.graph(known).claimed(known.steps)
        return PreparedTask(history, observed, briefing, memory, rays, edges)

    def contacts(self, task: PreparedTask) -> LearnedProposals[Any]:
        """Proposals on a board of which nothing but the history is known."""
        return LearnedProposals(self._model, self._config, task.rays, task.observed, task.briefing, task.memory)

    def sight(self, task: PreparedTask) -> OnlineFeatures:
        """Features on a board of which only the history's first frame was seen."""
        return OnlineFeatures(task.observed, self._extractor)

    def play(self, task: PreparedTask, agent: str | MakeAgent) -> PlayedRollout:
        """Let an agent play; it is named as `kind_of` takes it, or given as what makes one of a reasoner."""
        kind, name = (kind_of(agent), name_of(agent)) if isinstance(agent, str) else (AgentSpec(agent), None)
        seat = (_OracleSeat if kind.oracle else _Seat)(lambda scene: self._policy(task, kind, name, scene))
        board = task.history.board
        episode = record_episode(self._simulator, board, seat, self._steps, self._interaction, self._seed)
        policy = seat.policy
        assert policy is not None
        episode.settings |= notes(policy.decisions)
        links = links_of([self._simulator.library.get(placed.key) for placed in board.objects])
        told = task.edges if kind.graph else None
        edges = np.array(board.relation_matrix(), bool) if kind.relations else told
        return PlayedRollout(episode, judge_rollout(episode, links, policy, task.briefing, edges))

    def _policy(self, task: PreparedTask, kind: AgentSpec, name: str | None, scene: BoardScene | None) -> AgentPolicy:
        """An agent that has what a robot has, and the truth about a scene if one is given, as a policy."""
        reasoner, make = self._reasoner, kind.make
        contacts: ContactProposals = self.contacts(task)
        if scene is not None:
            rng = generator(self._seed, scene.spec.split, scene.spec.index, "plan/true contacts")
            true = OracleProposals(scene, task.rays, self._interaction, task.observed, rng)
            reasoner = OracleRelations(reasoner, scene.spec) if kind.relations else reasoner
            contacts = true if kind.contacts else contacts
            make = make or (lambda _: OracleAgent(scene, true))
        assert make is not None
        return AgentPolicy(make(reasoner), task.briefing, contacts, self.sight(task), name)


@dataclass
class _Seat:
    """What `record_episode` makes the policy of an agent with; `policy` is it afterwards."""

    make: Callable[[BoardScene | None], AgentPolicy]
    policy: AgentPolicy | None = None
    name: str = "plan"  # the same draws whoever plays

    def make_policy(self, rays: Rays) -> AgentPolicy:
        self.policy = self.make(None)
        return self.policy


class _OracleSeat(_Seat):
    """The same of an oracle."""

    def make_oracle(self, scene: BoardScene, rays: Rays, config: InteractionConfig) -> AgentPolicy:
        self.policy = self.make(scene)
        return self.policy


def judge_rollout(
    rollout: Episode, links: Links, policy: AgentPolicy, briefing: TaskContext, edges: np.ndarray | None
) -> JudgedRollout:
    """Put the truth beside what an agent did: what shows at its end, also where luck or memory has a part in it.

    Args:
        rollout: on a board with a task, with segmentation.
        links: the board's trigger links.
        policy: that acted.
        edges: bool (N, N), relations that the agent was told: those that the reasoner claims, or the true ones; None
            for an agent that is told none.
    """
    board, steps = rollout.board, rollout.steps
    start = Dynamics(board, links).start(start_states(board)).shown
    right = reached(board, steps[-1].responder_states_after if steps else start)
    asked = reached(board, start)
    differing = set(briefing.differing(policy.features).tolist())
    relations = {relation.responder: relation for relation in board.relations}
    last = policy.decisions[-1].answer if policy.decisions else None
    responders = [
        JudgedResponder(
            object=index,
            key=board.objects[index].key,
            kind=relations[index].kind,
            asked=not asked[index],
            reached=right[index],
            looks_reached=index not in differing,
            cause="" if right[index] else _cause(rollout, policy.decisions, relations[index], edges, differing),
        )
        for index in affectable(board)
    ]
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
    rollout: Episode, decisions: Sequence[Decision], relation: Relation, edges: np.ndarray | None, differing: set[int]
) -> Cause:
    """Why a responder is not in its goal state; the first of the reasons that applies."""
    responder, steps = relation.responder, rollout.steps
    links, looks_reached = drivers(rollout.board, responder), responder not in differing
    meant = [isinstance(one.answer, Act) and one.answer.responder == responder for one in decisions[: len(steps)]]
    on_link = [(step.acted_object, step.acted_link) in links for step in steps]
    if any(on and step.success for on, step in zip(on_link, steps, strict=True)):
        return "not noticed" if looks_reached else "wrong prediction"
    if edges is not None and not all(edges[trigger.object, responder] for trigger in relation.triggers):
        return "wrong relation"
    if any(one and step.success for one, step in zip(meant, steps, strict=True)):
        return "wrong prediction"
    if any(one or on for one, on in zip(meant, on_link, strict=True)):
        return "physical failure"
    if looks_reached:
        return "not noticed"
    return "not tried" if all(_offered(rollout, decisions, link) for link in links) else "no candidate"


def _offered(rollout: Episode, decisions: Sequence[Decision], link: tuple[int, str]) -> bool:
    """Whether a contact on a link was offered, or the interaction model not even asked for one."""
    codes = [number + 1 for number, one in enumerate(rollout.links) if (one.object, one.name) == link]
    for number, decision in enumerate(decisions):
        segmentation = rollout.image(number).segmentation
        assert segmentation is not None
        if decision.proposed is None:
            return True
        offered = (contact.pixel for contact in (*decision.repeats, *decision.proposed))
        if any(int(segmentation[v, u]) in codes for u, v in offered):
            return True
    return False
