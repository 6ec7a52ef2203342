"""The oracle follows a shortest plan, however long the plans are that its tasks were drawn with."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from busybot.boards.dynamics import Dynamics
from busybot.boards.spec import LinkRef, Task
from busybot.plan.agents.oracle import OracleAgent, OracleProposals
from busybot.plan.interfaces import Act, DecisionState, Stop, TaskContext
from busybot.sim.builtin_policies import TrueContact
from busybot.sim.scene.board_scene import BoardState
from tests.boards.worlds_by_hand import board, link, links, relation

NINE = (2,) * 9


@pytest.mark.parametrize(("steps", "acts"), [(9, True), (12, True), (8, False)])
def test_a_task_of_nine_actions_is_begun_where_nine_are_allowed(steps: int, acts: bool) -> None:
    lamps = [relation("one-to-one", 9 + number, [link(number)], (0, 1)) for number in range(9)]
    named = tuple(LinkRef(object=number, link="handle") for number in range(9))
    task = Task(kind="reach", links=named, goal=(1,) * 9, responders=(-1,) * 9 + (1,) * 9, shortest=9)
    spec = board(lamps, NINE, responders=9, task=task)
    held: Any = object()
    contacts = SimpleNamespace(now=[TrueContact(n, (n, 0), np.zeros(3, np.float32), {1: 4}) for n in range(9)])
    scene = SimpleNamespace(spec=spec, dynamics=Dynamics(spec, links(NINE)), save=lambda: BoardState((0,) * 9))
    oracle = OracleAgent(cast(Any, scene), cast(OracleProposals, contacts))
    oracle.start(cast(TaskContext, SimpleNamespace(steps=steps)))
    answer = oracle.decide(cast(DecisionState, SimpleNamespace(candidates=(held,) * 9)))
    assert isinstance(answer, Act) and answer.direction == 4 if acts else answer == Stop("no plan was found")
