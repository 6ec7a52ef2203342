"""From a recorded history with a goal picture to what an agent is told before it starts."""

import numpy as np

from busybot.common.errors import BusybotError
from busybot.episodes.episode import Episode
from busybot.plan.agent_policy import Sight
from busybot.plan.contact_proposals import worked_in
from busybot.plan.interfaces import Briefing
from busybot.reason.encoders.registry import choose
from busybot.reason.inputs.observation import goal_of, observe
from busybot.reason.inputs.sequence import sequence_of
from busybot.reason.inputs.state_clusters import threshold_of


def brief(history: Episode, steps: int, encoder: str = "embedded", features: np.ndarray | None = None) -> Briefing:
    """What agents are told of a task.

    Args:
        history: the recorded interactions, with a goal.
        steps: so many actions are allowed.
        encoder: of the features.
        features: of the history, (T + 1, N, 256), if they are known already.

    Raises:
        BusybotError: the history has no goal, or there is no such encoder.
    """
    observed, goal, chosen = observe(history), goal_of(history), choose(encoder)
    if goal is None:
        what = f"board {history.board.index} has no goal"
        raise BusybotError(
            what, "make a dataset with tasks: busybot generate OUT --tasks one-to-one, busybot collect OUT"
        )
    worked = np.full(len(history.steps), -1)
    for one in worked_in(history):
        worked[one.step] = one.direction
    return Briefing(
        history=sequence_of(observed, chosen.of(observed) if features is None else features),
        pixels=np.array([step.pixel for step in history.steps], int).reshape(-1, 2),
        worked=worked,
        goal=Sight(observed, chosen).see(goal),
        threshold=threshold_of(encoder),
        steps=steps,
    )
