"""Oracles, for rows that are marked as such: nothing here is offered to any other agent.

- `OracleAgent`: brings every trigger link to its goal state, by contacts that work.
- `OracleProposals`: in place of the interaction model's candidates, one that works for every link ("true candidates").
- `OracleRelations`: a reasoner that is told the relations ("true relations").
"""

import time

import numpy as np

from busybot.boards.directions import DIRECTIONS
from busybot.boards.spec import BoardSpec
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Observation
from busybot.plan.contact_proposals import SURE, ContactProposals, sure_contact
from busybot.plan.interfaces import Act, Contact, DecisionState, Stop, TaskContext
from busybot.reason.inputs.observation import ObservedEpisode
from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.base import InferredGraph, Reasoner
from busybot.sim.builtin_policies import TrueContact, true_contacts
from busybot.sim.interaction import InteractionConfig
from busybot.sim.policy import privileged
from busybot.sim.scene.board_scene import BoardScene


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
    """Moves trigger links that are not in their goal state until all are.

    Args:
        scene: as it stands.
        goal: goal state of every trigger link, in the scene's order.
        contacts: the same that it is offered.
    """

    name = "oracle"

    def __init__(self, scene: BoardScene, goal: tuple[int, ...], contacts: OracleProposals):
        self._scene, self._goal, self._contacts = scene, goal, contacts

    def start(self, briefing: TaskContext) -> None:
        pass

    def decide(self, situation: DecisionState) -> Act | Stop:
        states = self._scene.trigger_states()
        if states == self._goal:
            return Stop("every trigger is in its goal state")
        for contact, truth in zip(situation.candidates, self._contacts.now, strict=True):
            state, goal = states[truth.number], self._goal[truth.number]
            nearer = [other for other in truth.directions if abs(other - goal) < abs(state - goal)]
            if nearer:
                other = min(nearer, key=lambda one: abs(one - goal))
                return Act(contact, truth.directions[other], f"trigger link {truth.number} from {state} to {other}")
        return Stop("no link that is not in its goal state can be moved towards it")


class OracleRelations:
    """A reasoner whose graph is the board's."""

    def __init__(self, reasoner: Reasoner, board: BoardSpec):
        self.name, self.encoder, self._reasoner = f"{reasoner.name}+relations", reasoner.encoder, reasoner
        self._edges = np.array(board.relation_matrix(), float).reshape(len(board.objects), -1)

    def graph(self, seen: BoardSequence) -> InferredGraph:
        return InferredGraph(self.name, self._edges[None], prior=self._edges)

    def predict(self, seen: BoardSequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        return self._reasoner.predict(seen, current, actions, acted)
