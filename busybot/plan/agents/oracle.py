"""Oracles, for rows that are marked as such: nothing here is offered to any other agent.

- `OracleAgent`: brings every trigger link to its goal state, by contacts that work. Where the goal is one of
  responders, which may have to be reached in a certain order, it follows a shortest plan, found anew every time.
- `OracleProposals`: in place of the interaction model's candidates, one that works for every link ("true candidates").
- `OracleRelations`: a reasoner that is told the relations ("true relations").
"""

import time

import numpy as np

from busybot.boards.directions import DIRECTIONS
from busybot.boards.dynamics import Dynamics
from busybot.boards.spec import BoardSpec
from busybot.boards.task import MAX_STEPS, task_of, way_to_goal
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Observation
from busybot.plan.contact_proposals import SURE, ContactProposals, sure_contact
from busybot.plan.interfaces import Act, Contact, DecisionState, Stop, TaskContext
from busybot.reason.inputs.observation import ObservedEpisode
from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.base import InferredGraph, Reasoner
from busybot.sim.builtin_policies import TrueContact, motion_at, true_contacts
from busybot.sim.interaction import InteractionConfig
from busybot.sim.policy import privileged
from busybot.sim.scene.board_scene import BoardScene

PLANNED = 20_000
"""Plans are looked for among so many states."""


class OracleProposals(ContactProposals):
    """Contacts that work, one for every visible trigger link; of the history nothing is offered.

    Attributes:
        now: the last picture's, in the order of the contacts that were proposed for it.
    """

    def __init__(
        self,
        scene: BoardScene,
        rays: Rays,
        config: InteractionConfig,
        observed: ObservedEpisode,
        rng: np.random.Generator,
    ):
        self._scene, self._rays, self._config, self._observed, self._rng = scene, rays, config, observed, rng
        self.now: list[TrueContact] = []

    def propose(self, seen: Observation) -> tuple[Contact, ...]:
        began = time.process_time()
        self.now = true_contacts(self._scene, privileged(seen), self._rays, self._config, self._rng)
        self.proposing_s += time.process_time() - began
        return tuple(self._contact(one) for one in self.now)

    def _contact(self, one: TrueContact) -> Contact:
        directions = np.zeros(len(DIRECTIONS))
        directions[list(one.directions.values())] = SURE
        return sure_contact(self._observed, one.pixel, one.position, one.number + 1, directions)


class OracleAgent:
    """Moves trigger links that are not in their goal state until all are, or follows a shortest plan.

    Args:
        scene: as it stands, of a board with a task.
        contacts: the same that it is offered.
    """

    name = "oracle"

    def __init__(self, scene: BoardScene, contacts: OracleProposals):
        self._scene, self._contacts, self._task = scene, contacts, task_of(scene.spec)
        self._law = Dynamics(scene.spec, scene.dynamics.links, lucky=False)

    def start(self, briefing: TaskContext) -> None:
        self._ahead = max(MAX_STEPS, briefing.steps)  # tasks may be drawn that take more (`BoardConfig.plan`)

    def decide(self, situation: DecisionState) -> Act | Stop:
        if self._task.responders is not None:
            return self._follow(situation)
        states, goals = self._scene.trigger_states(), self._task.goal
        if states == goals:
            return Stop("every trigger is in its goal state")
        for contact, truth in zip(situation.candidates, self._contacts.now, strict=True):
            state, goal = states[truth.number], goals[truth.number]
            nearer = [other for other in truth.directions if abs(other - goal) < abs(state - goal)]
            if nearer:
                other = min(nearer, key=lambda one: abs(one - goal))
                return Act(contact, truth.directions[other], f"trigger link {truth.number} from {state} to {other}")
        return Stop("no link that is not in its goal state can be moved towards it")

    def _follow(self, situation: DecisionState) -> Act | Stop:
        """The first action of a shortest plan from here."""
        saved = self._scene.save()
        state = saved.dynamics or self._law.start(saved.triggers)
        way = way_to_goal(self._scene.spec, self._law, saved.triggers, state, self._ahead, PLANNED)
        if way is None:
            return Stop("no plan was found")
        if not way:
            return Stop("every responder is in its goal state")
        if way[0] == saved.triggers:
            return self._wait(situation)
        for contact, truth in zip(situation.candidates, self._contacts.now, strict=True):
            here, there = saved.triggers[truth.number], way[0][truth.number]
            if here != there and there in truth.directions:
                return Act(contact, truth.directions[there], f"trigger link {truth.number} from {here} to {there}")
        return Stop("the link that the plan moves cannot be taken hold of")

    def _wait(self, situation: DecisionState) -> Act | Stop:
        """An action that moves nothing: across the way in which a link gives."""
        for contact, truth in zip(situation.candidates, self._contacts.now, strict=True):
            motion = motion_at(self._scene.triggers[truth.number], truth.position)
            return Act(contact, int(np.abs(DIRECTIONS @ motion).argmin()), "waits")
        return Stop("there is nothing to be touched while waiting")


class OracleRelations:
    """A reasoner whose graph is the board's."""

    def __init__(self, reasoner: Reasoner, board: BoardSpec):
        self.name, self.encoder, self._reasoner = f"{reasoner.name}+relations", reasoner.encoder, reasoner
        self._edges = np.array(board.relation_matrix(), float).reshape(len(board.objects), -1)

    def graph(self, seen: BoardSequence) -> InferredGraph:
        return InferredGraph(self.name, self._edges[None], prior=self._edges)

    def predict(self, seen: BoardSequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        return self._reasoner.predict(seen, current, actions, acted)
