"""The agents by name: which there are, and what each is made of."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from busybot.common.errors import BusybotError
from busybot.plan.agents.learned import learned
from busybot.plan.agents.paper import BusyBotAgent, PredictiveAgent, RelationAgent
from busybot.plan.agents.search import SearchAgent
from busybot.plan.agents.simple import NoopAgent, RandomAgent
from busybot.plan.interfaces import Agent
from busybot.plan.learning.network import Name, load_policy
from busybot.reason.models.base import Reasoner

MakeAgent = Callable[[Reasoner], Agent]


@dataclass(frozen=True)
class AgentSpec:
    """An agent by name.

    Attributes:
        make: None for the oracle, which is made of the truth.
        relations, contacts: whether it is told the true ones.
    """

    make: MakeAgent | None
    relations: bool = False
    contacts: bool = False

    @property
    def oracle(self) -> bool:
        """Whether it knows what only the simulator knows."""
        return self.relations or self.contacts


AGENTS: dict[str, AgentSpec] = {
    "noop": AgentSpec(lambda reasoner: NoopAgent()),
    "random": AgentSpec(lambda reasoner: RandomAgent()),
    "relation": AgentSpec(RelationAgent),
    "predictive": AgentSpec(PredictiveAgent),
    "busybot": AgentSpec(BusyBotAgent),
    "search": AgentSpec(SearchAgent),
    "search-true-relations": AgentSpec(SearchAgent, relations=True),
    "search-true-contacts": AgentSpec(SearchAgent, contacts=True),
    "search-true-both": AgentSpec(SearchAgent, relations=True, contacts=True),
    "oracle": AgentSpec(None, contacts=True),
}
"""The rows of Table 3 and those that attribute failures; trained agents are named with their models (`kind_of`)."""
TRAINED: tuple[Name, ...] = ("bc", "ppo")


def name_of(agent: str) -> str:
    """An agent's name in tables: `bc` of `bc=runs/bc`."""
    return agent.partition("=")[0]


def kind_of(agent: str) -> AgentSpec:
    """The agent of that name; of those in `TRAINED`, with its model: `bc=runs/bc`.

    Raises:
        BusybotError: there is none, or there is no such model.
    """
    name, given, model = agent.partition("=")
    for trained in TRAINED:
        if name == trained:
            if not model:
                what = f"agent {name} plays a trained policy, none was named"
                raise BusybotError(what, f"--agents {name}=DIR; `busybot train {name} --out DIR` makes one")
            load_policy(model, trained)
            return AgentSpec(partial(learned, trained, model))
    if name not in AGENTS or given:
        known = ", ".join([*AGENTS, *(f"{trained}=DIR" for trained in TRAINED)])
        raise BusybotError(f"there is no agent {agent!r}", f"choose from {known}")
    return AGENTS[name]
