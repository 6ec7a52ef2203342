"""The agents by name: which there are, and what each is made of; among them those that play a trained network.

`bc` and `ppo` (paper appendix "Planning module") see the same and differ in their training; the choice with the highest
score is taken. Packages bring more agents, in the entry-point group `busybot.agents`
(docs/extending/write-an-agent.md).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import get_args

import torch

from busybot.boards.directions import DIRECTIONS
from busybot.common import plugins
from busybot.common.errors import BusybotError, UsageError
from busybot.plan.agents.mechanism import MechanismAgent
from busybot.plan.agents.paper import NO_CANDIDATE, BusyBotAgent, NoopAgent, PredictiveAgent, RandomAgent, RelationAgent
from busybot.plan.agents.search import SearchAgent
from busybot.plan.interfaces import Act, Agent, DecisionState, Stop, TaskContext
from busybot.plan.learning.encoding import OBJECTS, STOP, ActionOutcome, Observation, ObservationEncoder, offer, stacked
from busybot.plan.learning.network import Name, PolicyNetwork, State, load_policy, rows_of
from busybot.reason.models.base import Reasoner

MakeAgent = Callable[[Reasoner], Agent]


class LearnedAgent:
    """An agent that plays a trained policy.

    Args:
        name: of the agent.
    """

    def __init__(self, name: str, network: PolicyNetwork):
        self.name, self._network = name, network
        self._state: State | None = None
        self._encoder: ObservationEncoder | None = None

    def start(self, briefing: TaskContext) -> None:
        self._encoder = self._state = None
        if len(briefing.history.triggers) <= OBJECTS:
            self._encoder = ObservationEncoder(briefing)
            self._read(self._encoder.history())

    def decide(self, situation: DecisionState) -> Act | Stop:
        if self._encoder is None:
            return Stop(f"the board has more than {OBJECTS} objects, for which there is no place in the network")
        offered, choices = offer(situation.candidates)
        if not choices:
            return Stop(NO_CANDIDATE)
        last = situation.attempts[-1] if situation.attempts else None
        deed = None
        if last is not None:
            direction = DIRECTIONS[last.executed[-1] if last.reward else last.direction]
            deed = ActionOutcome(last.contact.position, direction, last.contact.trigger, last.reward)
        before = situation.features if last is None else last.before
        scores = self._read(stacked([self._encoder.seen(situation.features, before, deed, offered)]))
        chances = scores.softmax(dim=0)
        chosen = int(scores.argmax())
        why = f"chosen with {float(chances[chosen]):.0%}"
        return Stop(why) if chosen == STOP else Act(*choices[chosen - 1], why)

    @torch.no_grad()
    def _read(self, row: Observation) -> torch.Tensor:
        """Go on reading; returns the scores after the last observation, (25,)."""
        seen, lengths = rows_of([row])
        known, self._state = self._network.read(seen, lengths, self._state)
        hidden = known.at(lengths - 1, torch.zeros_like(lengths))[0]
        return self._network.scores(hidden, {name: value[-1, 0] for name, value in seen.items()})


def learned(agent: Name, path: str, reasoner: Reasoner) -> LearnedAgent:
    """The agent of a trained policy.

    Raises:
        BusybotError: there is no such policy, or it reads other features than the reasoner.
    """
    info, network = load_policy(path, agent)
    if info.encoder != reasoner.encoder:
        what = f"{path}: agent {agent} reads features of {info.encoder}, the reasoner those of {reasoner.encoder}"
        raise BusybotError(what, "choose a reasoner of the same encoder")
    return LearnedAgent(agent, network)


@dataclass(frozen=True)
class AgentSpec:
    """An agent by name.

    Attributes:
        make: None for the oracle, which is made of the truth.
        relations, contacts: whether it is told the true ones.
        graph: whether it reads the reasoner's graph, so that a relation which that lacks may be why it fails. Of agents
            that packages bring it is taken for true.
    """

    make: MakeAgent | None
    relations: bool = False
    contacts: bool = False
    graph: bool = True

    @property
    def oracle(self) -> bool:
        """Whether it knows what only the simulator knows."""
        return self.relations or self.contacts


AGENTS: dict[str, AgentSpec] = {
    "noop": AgentSpec(lambda _: NoopAgent(), graph=False),
    "random": AgentSpec(lambda _: RandomAgent(), graph=False),
    "relation": AgentSpec(RelationAgent),
    "predictive": AgentSpec(PredictiveAgent, graph=False),
    "busybot": AgentSpec(BusyBotAgent),
    "search": AgentSpec(SearchAgent),
    "mechanism": AgentSpec(MechanismAgent, graph=False),
    "search-true-relations": AgentSpec(SearchAgent, relations=True),
    "search-true-contacts": AgentSpec(SearchAgent, contacts=True),
    "search-true-both": AgentSpec(SearchAgent, relations=True, contacts=True),
    "oracle": AgentSpec(None, contacts=True, graph=False),
}
"""The rows of Table 3 and those that attribute failures; trained agents are named with their models (`kind_of`)."""
TRAINED: tuple[Name, ...] = get_args(Name)


def name_of(agent: str) -> str:
    """An agent's name in tables: `bc` of `bc=runs/bc`."""
    return agent.partition("=")[0]


def kind_of(agent: str) -> AgentSpec:
    """The agent of that name; of those in `TRAINED`, with its model: `bc=runs/bc`.

    Raises:
        BusybotError: there is none, or there is no such model.
    """
    name, given, model = agent.partition("=")
    if trained := next((one for one in TRAINED if one == name), None):
        if not model:
            what = f"agent {name} plays a trained policy, none was named"
            raise UsageError(what, f"--agents {name}=DIR; `busybot train {name} --out DIR` makes one")
        load_policy(model, trained)
        return AgentSpec(partial(learned, trained, model), graph=False)
    brought = plugins.names("agents")
    if name in brought and name not in AGENTS and not given:
        return AgentSpec(partial(plugins.make, "agents", name))
    if name not in AGENTS or given:
        known = ", ".join([*AGENTS, *brought, *(f"{trained}=DIR" for trained in TRAINED)])
        raise UsageError(f"there is no agent {agent!r}", f"choose from {known}")
    return AGENTS[name]
